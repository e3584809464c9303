"""Geoid undulations from a grid of PROJ, if pyproj and such a grid are installed (``projsync --file us_nga_egm``)."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from insnav.types import FloatArray
from insnav.units import DEG

GRIDS = ("us_nga_egm08_25.tif", "us_nga_egm96_15.tif")  # EGM2008 and EGM96; PROJ also finds their older names


def undulation(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, str] | None:
    """Return heights of the geoid above the ellipsoid [m] and the name of the grid; None without one.

    `lat`, `lon` (n,): [rad].
    """
    with suppress(ImportError):
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        for grid in GRIDS:
            with suppress(ProjError):
                shift = Transformer.from_pipeline(
                    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
                    f" +step +proj=vgridshift +grids={grid} +multiplier=1"
                )
                height = np.asarray(shift.transform(lon / DEG, lat / DEG, np.zeros(len(lat)))[2], dtype=np.float64)
                if np.isfinite(height).all():
                    return height, grid
    return None
