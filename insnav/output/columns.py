"""Columns on their way into files: rounded, without NaN, and with their names unquoted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

Decimals = tuple[
    tuple[str, int], ...
]  # pattern that is found in the name of a column, and its decimals; the first counts


def rounded(name: str, values: NDArray[Any], decimals: Decimals) -> NDArray[Any]:
    """Round a column, unless it counts, to its decimals; zero has no sign, and a heading is below 360 deg."""
    if values.dtype.kind == "i":
        return values
    values = np.round(values, next(places for pattern, places in decimals if re.search(pattern, name))) + 0.0
    return np.where(values == 360.0, 0.0, values) if name == "heading_deg" else values


def arrow_table(columns: Mapping[str, Any]) -> pa.Table:
    """Table of numbers, null where they are not finite, and of text."""
    return pa.table({name: _arrow_array(values) for name, values in columns.items()})


def _arrow_array(values: Any) -> Any:
    # by builder and from the buffer: pyarrow.array imports pandas, which takes longer than writing the file
    if not isinstance(values, np.ndarray):
        texts = pa.lib.StringBuilder()
        texts.append_values(values)
        return texts.finish()
    values = np.ascontiguousarray(values)
    known = np.isfinite(values)
    bitmap = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [bitmap, pa.py_buffer(values)])


def write_csv(table: pa.Table, stream: Any, *, header: bool = True) -> None:
    """Write a header without quotation marks, and the rows."""
    if header:
        stream.write((",".join(table.column_names) + "\n").encode())
    pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False, quoting_style="needed"))
