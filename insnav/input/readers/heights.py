"""Heights over time, as a barometer or a surveyed profile gives them, from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.clean import REFERENCE_KINDS
from insnav.input.interpret.columns import understand
from insnav.input.interpret.schema import IMU_SCHEMA, REFERENCE_SCHEMA
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import FloatArray

_SLOWEST = 1000.0  # longest interval between rows [s]
_KEYS = ("height", "baro", "height_msl")  # the first there is counts
_SCHEMA = tuple({q.key: q for q in (*REFERENCE_SCHEMA, *IMU_SCHEMA) if q.key in ("time", *_KEYS)}.values())


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights over time."""

    time: FloatArray  # (n,) [s], strictly increasing
    height: FloatArray  # (n,) as in the file [m]


def read_heights(path: str | Path | Table) -> Reading[Heights]:
    """Read a time and a height from a data file; whatever else it holds is not looked at.

    Raises: InputError: the file cannot be used.
    """
    table = open_table(path)
    name = table.name
    found, notes = understand(table.headers, table.units, _SCHEMA, where=name)
    key = next((key for key in _KEYS if key in found), None)
    if key is None or "time" not in found:
        raise InputError("input.no_heights", where=name, known=tuple(filter(None, table.headers)))
    rows = read_rows(table, found, ("time", key), REFERENCE_KINDS, slowest=_SLOWEST)
    rows.columns["height"] = rows.columns.pop(key) * found[key].factor
    cleaned = rows.clean()
    time, height = cleaned.columns["time"], cleaned.columns["height"]
    longest = Finding.of(Code.READ_HEIGHT_INTERPOLATED, step_s=np.diff(time).max())
    columns = {"time_s": found["time"].describe(rows.time_unit), "height_m": found[key].describe()}
    return rows.reading("heights", Heights(time, height), cleaned, columns, (longest, *notes), gaps=False)
