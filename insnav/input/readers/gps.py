"""Fixes of a satellite receiver from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from insnav.input.formats.table import Table
from insnav.input.interpret.clean import GPS_KINDS
from insnav.input.interpret.schema import GPS_SCHEMA
from insnav.input.readers.positions import Height, read_positions
from insnav.input.readers.reading import Reading
from insnav.types import GpsData


def read_gps(
    path: str | Path | Table, *, columns: Mapping[str, str] | None = None, height: Height | None = None
) -> Reading[GpsData]:
    """Read GPS fixes.

    Parameters
    ----------
    path : str or Path
        A data file of any supported format, or ``-`` for standard input.
    columns : mapping of str to str, optional
        Quantity, with or without unit, to header: ``{"sd_n_m": "sigma"}``; an empty header leaves it out.
    height : {"ellipsoidal", "msl"}, optional
        What the heights are; default: by the header, else ellipsoidal, and reported so.

    Returns
    -------
    Reading of GpsData

    Raises
    ------
    InputError
        The file cannot be used.
    ConfigError
        A column is named that does not exist.
    """
    reading = read_positions(path, "GPS", GPS_SCHEMA, GPS_KINDS, columns=columns, height=height)
    read = reading.data
    heading = read.columns.get("heading")
    data = GpsData(
        read.columns["time"],
        read.lla,
        read.v_n,
        read.stacked(("sd_n", "sd_e", "sd_d")),
        read.stacked(("sd_vn", "sd_ve", "sd_vd")),
        reading.fix,
        None if heading is None else heading % (2.0 * np.pi),
    )
    return Reading(data, reading.events, reading.facts)
