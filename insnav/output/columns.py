"""Columns on their way into files: rounded, without NaN, and with their names unquoted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from insnav.kernels.csv_rows import WIDEST, rows_as_text

Decimals = tuple[
    tuple[str, int], ...
]  # pattern that is found in the name of a column, and its decimals; the first counts

TEXT_ROWS = 1 << 13  # made text at a time: their numbers stay in the processor's cache


def rounded(name: str, values: NDArray[Any], decimals: Decimals) -> NDArray[Any]:
    """Round a column, unless it counts, to its decimals; zero has no sign, and a heading is below 360 deg."""
    if values.dtype.kind == "i":
        return values
    values = np.round(values, _places(name, decimals)) + 0.0
    return np.where(values == 360.0, 0.0, values) if name == "heading_deg" else values


def _places(name: str, decimals: Decimals) -> int:
    return next(places for pattern, places in decimals if re.search(pattern, name))


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


def write_numbers(columns: Mapping[str, NDArray[Any]], decimals: Decimals, stream: Any, *, header: bool) -> None:
    """Write columns of numbers, `rounded`, as `write_csv` does, in a third of its time."""
    numbers = np.empty((len(columns), len(next(iter(columns.values())))))
    for row, (name, values) in zip(numbers, columns.items(), strict=True):
        row[:] = rounded(name, values, decimals) if name == "heading_deg" else values
    places = [0 if v.dtype.kind == "i" else _places(name, decimals) for name, v in columns.items()]
    text = np.empty(numbers.size * WIDEST, np.uint8)
    size = rows_as_text(numbers, 10.0 ** np.array(places), np.array(places, np.uint64), text)
    if size < 0:
        table = arrow_table({name: rounded(name, values, decimals) for name, values in columns.items()})
        write_csv(table, stream, header=header)
        return
    if header:
        stream.write((",".join(columns) + "\n").encode())
    stream.write(text[:size].data)


def write_csv(table: pa.Table, stream: Any, *, header: bool = True) -> None:
    """Write a header without quotation marks, and the rows."""
    if header:
        stream.write((",".join(table.column_names) + "\n").encode())
    pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False, quoting_style="needed"))
