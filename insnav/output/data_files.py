"""Simulated data as files that every command reads: IMU, GPS and reference in the canonical columns.

The same data give the same bytes: numbers are rounded to fixed decimals and written as short as they go, and
compressed files carry no time of writing.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa

from insnav.exceptions import OutputError
from insnav.output.columns import AXES, NED, Column, Fields, arrow_array, cells_of, degrees, labels, rounded, write_csv
from insnav.types import FloatArray, GpsData, ImuData, IntArray, Trajectory

# Decimals far below what any sensor resolves or any test looks at.
_TIME = ("time", (Column("time_s", 9),))
_EXTRAS: Fields = (
    ("temperature", (Column("temperature_c", 3),)),
    ("odometer", (Column("odometer_m_s", 6),)),
    ("baro", (Column("baro_height_m", 6),)),
)
_RATES: Fields = (
    _TIME,
    ("gyro", labels("gyro_{}_rad_s", AXES, 9)),
    ("accel", labels("accel_{}_m_s2", AXES, 9)),
    *_EXTRAS,
)
_INCREMENTS: Fields = (
    _TIME,
    ("gyro", labels("dtheta_{}_rad", AXES, 13)),
    ("accel", labels("dvel_{}_m_s", AXES, 13)),
    *_EXTRAS,
)
_POSITION: Fields = (
    _TIME,
    ("lla", (*degrees(11, "lat", "lon"), Column("height_m", 6))),
    ("v_n", labels("v{}_m_s", NED, 6)),
)
_GPS: Fields = (
    *_POSITION,
    ("position_sd", labels("sd_{}_m", NED, 6)),
    ("velocity_sd", labels("sd_v{}_m_s", NED, 6)),
    ("heading", degrees(8, "heading")),
    ("fix", (Column("fix", 0),)),
)
_REFERENCE: Fields = (*_POSITION, ("rph", degrees(8, "roll", "pitch", "heading")))


def write_data(path: Path, data: ImuData | GpsData | Trajectory) -> None:
    """Write samples, fixes or a reference as csv, compressed if the name ends in ``.gz``.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    data : ImuData, GpsData or Trajectory
        Columns of which nothing is known are left out. Sampling and timestamp convention of an IMU are not in the
        file: they are options of whoever reads it.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    if isinstance(data, ImuData):
        fields = _INCREMENTS if data.sampling == "increment" else _RATES
    else:
        fields = _GPS if isinstance(data, GpsData) else _REFERENCE
    known = {name: cells for name, cells in cells_of(data, fields).items() if not np.isnan(cells[0]).all()}
    write_table(path, {name: v if v.dtype.kind == "i" else rounded(v, column) for name, (v, column) in known.items()})


def csv_text(columns: Mapping[str, FloatArray], digits: int) -> str:
    """Write columns as text of a csv table, each number in so many significant digits.

    Parameters
    ----------
    columns : mapping of str to (n,) array
    digits : int
    """
    lines = (",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(list(columns.values())))
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_table(path: Path, columns: Mapping[str, FloatArray | IntArray]) -> None:
    """Write columns ``(n,)``, already rounded, as csv, compressed if the name ends in ``.gz``; NaN is an empty cell.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    text = io.BytesIO()
    write_csv(pa.table({name: arrow_array(np.asarray(values)) for name, values in columns.items()}), text)
    content = text.getvalue()
    if path.suffix == ".gz":
        content = gzip.compress(content, compresslevel=9, mtime=0)
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError(
            f"{path.name} cannot be written",
            where=str(path),
            why=error.strerror or str(error),
            fix="choose a folder that exists and that you may write to",
        ) from error
