"""Simulated data as files that every command reads: IMU, GPS and reference in the canonical columns.

The same data give the same bytes: numbers are rounded to fixed decimals and written as short as they go, and
compressed files carry no time of writing.
"""

from __future__ import annotations

import contextlib
import gzip
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from insnav import spill
from insnav.exceptions import writing
from insnav.output.columns import TEXT_ROWS, Decimals, arrow_table, write_csv, write_numbers
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
    known = [name for name, values in data.columns().items() if not np.isnan(values).all()]
    with _opened(path) as stream:
        for rows in spill.blocks(len(data.time), size=TEXT_ROWS):
            columns = data.rows(rows).columns()
            write_numbers({name: columns[name] for name in known}, _DECIMALS, stream, header=rows.start == 0)


def csv_text(columns: Mapping[str, FloatArray], digits: int) -> str:
    """Text of a csv table of columns ``(n,)``, each number in so many significant digits."""
    lines = (",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(list(columns.values())))
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_table(path: Path, columns: Mapping[str, FloatArray | IntArray]) -> None:
    """Write columns ``(n,)``, already rounded, as csv, compressed if the name ends in ``.gz``; NaN is an empty cell.

    Raises: OutputError: the file cannot be written.
    """
    with _opened(path) as stream:
        write_csv(arrow_table({name: np.asarray(values) for name, values in columns.items()}), stream)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """File to be written, compressed if its name says so."""
    with writing("output.file_unwritable", path), path.open("wb") as stream:
        if path.suffix == ".gz":
            with gzip.GzipFile("", "wb", 9, stream, 0) as packed:
                yield packed
        else:
            yield stream
