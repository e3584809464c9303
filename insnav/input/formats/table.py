"""Columns of numbers from a table in text or parquet, with errors that name file, line and column."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv

from insnav.exceptions import InputError
from insnav.input.formats.source import Source, open_source
from insnav.input.formats.text_dialect import HEAD_BYTES, Dialect, is_comment, parse_number, sniff, split_line
from insnav.plain_text import plain_text
from insnav.types import FloatArray

_BLOCK_BYTES = 1 << 20
_SAMPLE_BYTES = 1 << 16
_TAIL_BYTES = 1 << 13
_TAIL_ROWS = 20


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose header has been read.

    Attributes
    ----------
    source : Source
        Its bytes.
    headers : tuple of str
        Names of the columns.
    units : tuple of str or None
        Row of units under the header.
    dialect : Dialect or None
        How the text is written; None for parquet.
    """

    source: Source
    headers: tuple[str, ...]
    units: tuple[str, ...] | None
    dialect: Dialect | None

    @property
    def name(self) -> str:
        """The file, fit to be printed."""
        return self.source.name

    def place(self, row: int, index: int | None = None) -> str:
        """``file:line:column`` of a cell.

        Parameters
        ----------
        row : int
            Row of the table, counted from 0.
        index : int, optional
            Column.
        """
        column = "" if index is None else f":{self.headers[index]}"
        if self.dialect is None:
            return f"{self.name}:row {row + 1}{column}"
        line = next(itertools.islice(_rows(self.source.data, self.dialect), row, None), None)
        return f"{self.name}:{line[0] if line else self.dialect.first_line + row}{column}"


@dataclass(frozen=True, slots=True)
class Numbers:
    """Columns of a table.

    Attributes
    ----------
    columns : dict of int to (n,) array
        By index of the column; NaN for an empty cell.
    n_rows : int
        Number of rows.
    cut : str
        Why a last row was left out; empty if none was.
    """

    columns: dict[int, FloatArray]
    n_rows: int
    cut: str = ""


def open_table(path: str | Path) -> Table:
    """Open a table and read its header.

    Parameters
    ----------
    path : str or Path
        ``.csv``, ``.txt`` (also with ``.gz``), ``.parquet``, or ``-`` for standard input.

    Raises
    ------
    InputError
        It is not a table.
    """
    source = open_source(path)
    if source.parquet:
        headers = _parquet_headers(source)
        return Table(source, headers, None, None)
    head = source.data[:HEAD_BYTES]
    dialect = sniff(head, whole=len(source.data) <= HEAD_BYTES, where=source.name)
    return Table(source, dialect.headers, dialect.units, dialect)


def read_numbers(table: Table, indices: Sequence[int]) -> Numbers:
    """Read columns as numbers.

    Parameters
    ----------
    table : Table
        From `open_table`.
    indices : sequence of int
        Which columns.

    Raises
    ------
    InputError
        A cell is not a number, or a row has too few or too many cells.
    """
    if table.dialect is None:
        return _read_parquet(table, indices)
    data, dialect = table.source.data, table.dialect
    if dialect.delimiter == " ":
        data = _semicolons(data[dialect.offset :])
        table = replace(
            table,
            source=replace(table.source, data=data),
            dialect=replace(dialect, delimiter=";", offset=0),
        )
        dialect = table.dialect or dialect
    try:
        numbers = _read_quickly(data, dialect, indices)
    except pa.ArrowInvalid:
        # The quick reader does not say where it stumbled, and knows neither remarks nor cut rows.
        numbers = _scan(table, indices)
    if not numbers.cut and (cut := _cut_number(table, indices, numbers.n_rows)):
        numbers = Numbers({i: c[:-1] for i, c in numbers.columns.items()}, numbers.n_rows - 1, cut)
    if not numbers.cut and table.source.zeros:
        numbers = replace(numbers, cut=f"{table.source.zeros} zero bytes at the end of the file")
    return numbers


def _read_quickly(data: object, dialect: Dialect, indices: Sequence[int]) -> Numbers:
    body = pa.py_buffer(data).slice(dialect.offset)
    if body.size == 0:
        return Numbers({i: np.empty(0) for i in indices}, 0)
    names = [str(i) for i in range(len(dialect.headers))]
    wanted = [names[i] for i in indices]
    stream = csv.open_csv(
        pa.BufferReader(body),
        # One thread: two need more CPU time in all and gain a tenth of a second on an hour at 200 Hz.
        read_options=csv.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, column_names=names),
        parse_options=csv.ParseOptions(delimiter=dialect.delimiter),
        convert_options=csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.float64()),
            include_columns=wanted,
            null_values=[""],
            decimal_point=dialect.decimal,
            check_utf8=False,
        ),
    )
    start = bytes(body[:_SAMPLE_BYTES])
    rows = int(1.1 * body.size / len(start) * (start.count(b"\n") + 1)) + 1  # memory is taken as it is filled
    columns = [np.empty(rows) for _ in indices]
    n = 0
    with stream:
        for batch in stream:
            end = n + batch.num_rows
            if end > len(columns[0]):
                columns = [np.concatenate((column[:n], np.empty(n + batch.num_rows))) for column in columns]
            for column, part in zip(columns, batch.columns, strict=True):
                column[n:end] = _floats(part)
            n = end
    return Numbers({i: column[:n] for i, column in zip(indices, columns, strict=True)}, n)


def _floats(part: pa.Array) -> FloatArray:
    """Values of an Arrow array, NaN for null. Arrow's own `to_numpy` would import pandas first (0.3 s)."""
    validity, buffer = part.buffers()
    end = part.offset + len(part)
    values = np.frombuffer(buffer, dtype=np.float64, count=end)[part.offset :]
    if part.null_count and validity is not None:
        bits = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")
        values = np.where(bits[part.offset : end] == 1, values, np.nan)
    return values


def _semicolons(data: bytes) -> bytes:
    """Blank-separated rows with semicolons instead."""
    data = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", data)
    return re.sub(rb"[ \t]+", b";", data)


def _rows(data: object, dialect: Dialect) -> Iterator[tuple[int, str]]:
    """Line number and text of every row of numbers."""
    body = bytes(memoryview(data)[dialect.offset :])  # type: ignore[arg-type]
    for number, line in enumerate(body.splitlines(), dialect.first_line):
        if line.strip():
            text = line.decode("utf-8", errors="replace")
            if not is_comment(text):
                yield number, text


def _scan(table: Table, indices: Sequence[int]) -> Numbers:
    """Read row by row; slow, but finds the first bad cell."""
    dialect = table.dialect
    assert dialect is not None
    rows = list(_rows(table.source.data, dialect))
    width = len(table.headers)
    values: list[list[float]] = []
    for number, text in rows:
        last = number == rows[-1][0]
        cells = split_line(text, dialect.delimiter)
        if len(cells) != width:
            if last and len(cells) < width:
                return _as_numbers(values, indices, f"line {number} has {len(cells)} of {width} cells")
            raise InputError(
                f"a row has {len(cells)} cells where the header has {width} names",
                where=f"{table.name}:{number}",
                why=plain_text(text)[:80],
                fix="mend or delete the line" + (_thousands(text) if len(cells) > width else ""),
            )
        row: list[float] = []
        for i in indices:
            try:
                row.append(parse_number(cells[i], dialect.decimal))
            except ValueError as error:
                if last and i == width - 1 and not _ends_line(table.source.data):
                    return _as_numbers(values, indices, f"line {number} ends within a number")
                raise InputError(
                    f"{plain_text(cells[i])[:40]!r} is not a number",
                    where=f"{table.name}:{number}:{table.headers[i]}",
                    why=_why_not_a_number(cells[i]),
                    fix="write a number, or leave the cell empty if the value is not known",
                ) from error
        values.append(row)
    return _as_numbers(values, indices, "")


def _as_numbers(values: list[list[float]], indices: Sequence[int], cut: str) -> Numbers:
    array = np.array(values, dtype=np.float64).reshape(len(values), len(indices))
    return Numbers({i: array[:, k].copy() for k, i in enumerate(indices)}, len(values), cut)


def _thousands(text: str) -> str:
    return "; a number must not have a thousands separator" if '"' not in text else ""


def _why_not_a_number(cell: str) -> str:
    if re.match(r"^\d{4}-\d\d-\d\d|^\d{1,2}:\d\d:", cell):
        return "it looks like a date or a time of day; times must be seconds"
    if re.match(r"^[-+]?\d{1,3}(,\d{3})+", cell):
        return "it looks like a number with a thousands separator"
    return "every cell of this column must be a number"


def _ends_line(data: object) -> bool:
    return bytes(memoryview(data)[-1:]) in (b"\n", b"\r")  # type: ignore[arg-type]


def _cut_number(table: Table, indices: Sequence[int], n_rows: int) -> str:
    """Say so if the very last number of the file seems to be cut off.

    Without a line end nobody can know; a last cell shorter than all those above it is taken for cut.
    """
    dialect = table.dialect
    last = len(table.headers) - 1
    if dialect is None or last not in indices or n_rows < 4 or _ends_line(table.source.data):
        return ""
    start = max(dialect.offset, len(table.source.data) - _TAIL_BYTES)
    lines = [t.decode("utf-8", "replace") for t in table.source.data[start:].splitlines() if t.strip()]
    rows = lines[-(_TAIL_ROWS + 1) :] if start == dialect.offset else lines[1:][-(_TAIL_ROWS + 1) :]
    widths = [len(cells[last]) for cells in (split_line(r, dialect.delimiter) for r in rows) if len(cells) > last]
    if len(widths) > 3 and 0 < widths[-1] < min(widths[:-1]):
        return "the file ends without a line end, within a number that is shorter than those above it"
    return ""


def _parquet_headers(source: Source) -> tuple[str, ...]:
    from pyarrow import parquet  # only for parquet: it costs as much as reading a small file

    try:
        schema = parquet.read_schema(pa.BufferReader(pa.py_buffer(source.data)))
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            "the parquet file is damaged", where=source.name, why=plain_text(error), fix="write it again"
        ) from error
    return tuple(plain_text(name) for name in schema.names)


def _read_parquet(table: Table, indices: Sequence[int]) -> Numbers:
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(pa.BufferReader(pa.py_buffer(table.source.data)))
        schema = file.schema_arrow
        for i in indices:
            kind = schema.field(i).type
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                raise InputError(
                    f"column {table.headers[i]!r} does not hold numbers",
                    where=f"{table.name}:{table.headers[i]}",
                    why=f"its type is {kind}",
                    fix="save it as float64; times as seconds",
                )
        arrow = file.read([schema.names[i] for i in indices], use_threads=False)
        cast = {i: arrow.column(schema.names[i]).cast(pa.float64(), safe=False) for i in indices}
        columns = {i: np.concatenate([np.empty(0), *(_floats(c) for c in column.chunks)]) for i, column in cast.items()}
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            "the parquet file is damaged", where=table.name, why=plain_text(error), fix="write it again"
        ) from error
    return Numbers(columns, arrow.num_rows)
