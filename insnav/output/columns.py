"""What tables are made of: columns with their unit and decimals, taken from the fields of a dataclass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from insnav.types import FloatArray
from insnav.units import DEG

AXES, NED = ("x", "y", "z"), ("n", "e", "d")


@dataclass(frozen=True, slots=True)
class Column:
    """One column: its name with unit, the SI value of that unit, and the decimals worth writing."""

    name: str
    decimals: int
    unit: float = 1.0


Fields = tuple[tuple[str, tuple[Column, ...]], ...]  # field of a dataclass and its columns, in the order of the table
Cells = tuple[FloatArray, Column]


def degrees(decimals: int, *names: str) -> tuple[Column, ...]:
    """Columns of angles."""
    return tuple(Column(f"{name}_deg", decimals, DEG) for name in names)


def cells_of(data: object, fields: Fields) -> dict[str, Cells]:
    """Values of the fields that are not None, in the units of their columns."""
    found: dict[str, Cells] = {}
    for field, columns in fields:
        values = getattr(data, field)
        if values is not None:
            parts = values.T if values.ndim > 1 else (values,)
            found |= {c.name: (v if c.unit == 1.0 else v / c.unit, c) for c, v in zip(columns, parts, strict=True)}
    return found


def rounded(values: FloatArray, column: Column) -> FloatArray:
    """Round to the decimals of the column; zero has no sign, and a heading is below 360 deg."""
    values = np.round(values, column.decimals) + 0.0
    return np.where(values == 360.0, 0.0, values) if column.name == "heading_deg" else values


def arrow_array(values: Any) -> Any:
    """Arrow array of numbers, null where they are not finite, or of text."""
    if not isinstance(values, np.ndarray):
        return pa.array(values, pa.string())
    # from the buffer: pyarrow's way from an array imports pandas, which takes longer than writing the file
    values = np.ascontiguousarray(values)
    known = np.isfinite(values)
    bitmap = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [bitmap, pa.py_buffer(values)])


def write_csv(table: pa.Table, stream: Any) -> None:
    """Write a header without quotation marks, and the rows."""
    stream.write((",".join(table.column_names) + "\n").encode())
    pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False, quoting_style="needed"))


def labels(template: str, names: Sequence[str], decimals: int, unit: float = 1.0) -> tuple[Column, ...]:
    """One column for each name put into a template."""
    return tuple(Column(template.format(name), decimals, unit) for name in names)
