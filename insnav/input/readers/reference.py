"""A reference trajectory from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from insnav.input.formats.table import Table
from insnav.input.interpret.clean import REFERENCE_KINDS
from insnav.input.interpret.schema import REFERENCE_SCHEMA
from insnav.input.readers.positions import read_positions
from insnav.input.readers.reading import Reading
from insnav.types import Trajectory


def read_reference(path: str | Path | Table, *, columns: Mapping[str, str] | None = None) -> Reading[Trajectory]:
    """Read a reference: position, and velocity and attitude as far as the file has them; see `read_gps`.

    Returns
    -------
    Reading of Trajectory
        With `fix` if the file has fix types.

    Raises
    ------
    InputError
        The file cannot be used.
    """
    reading = read_positions(path, "reference", REFERENCE_SCHEMA, REFERENCE_KINDS, columns=columns)
    read = reading.data
    rph = read.stacked(("roll", "pitch", "heading"))
    rph[:, 2] %= 2.0 * np.pi
    sd = np.column_stack([read.stacked(("sd_n", "sd_e", "sd_d")), read.stacked(("sd_vn", "sd_ve", "sd_vd"))])
    known = np.hstack([sd, np.full_like(rph, np.nan)]) if np.isfinite(sd).any() else None
    data = Trajectory(read.columns["time"], read.lla, read.v_n, rph, known)
    return Reading(data, reading.events, reading.facts, reading.fix)
