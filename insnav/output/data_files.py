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

from insnav.exceptions import OutputError
from insnav.output.columns import Decimals, arrow_table, rounded, write_csv
from insnav.types import FloatArray, GpsData, ImuData, IntArray, Trajectory

# Decimals far below what any sensor resolves or any test looks at.
_DECIMALS: Decimals = (
    ("^dtheta|^dvel", 13),
    ("^lat|^lon", 11),
    ("time|_rad_s|_m_s2", 9),
    ("_deg", 8),
    ("_m", 6),
    ("temperature", 3),
)


def write_data(path: Path, data: ImuData | GpsData | Trajectory) -> None:
    """Write samples, fixes or a reference as csv, compressed if the name ends in ``.gz``.

    `data`: columns of which nothing is known are left out. Sampling and timestamp convention of an IMU are not in the
    file: they are options of whoever reads it.
    Raises: OutputError: the file cannot be written.
    """
    columns = data.columns().items()
    write_table(path, {name: rounded(name, v, _DECIMALS) for name, v in columns if not np.isnan(v).all()})


def csv_text(columns: Mapping[str, FloatArray], digits: int) -> str:
    """Text of a csv table of columns ``(n,)``, each number in so many significant digits."""
    lines = (",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(list(columns.values())))
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_table(path: Path, columns: Mapping[str, FloatArray | IntArray]) -> None:
    """Write columns ``(n,)``, already rounded, as csv, compressed if the name ends in ``.gz``; NaN is an empty cell.

    Raises: OutputError: the file cannot be written.
    """
    text = io.BytesIO()
    write_csv(arrow_table({name: np.asarray(values) for name, values in columns.items()}), text)
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
