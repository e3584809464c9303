"""Tables of delimited text: Arrow reads them fast; if it fails, a slow reader finds the error's line and column."""

from __future__ import annotations

import contextlib
import itertools
import mmap
import re
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from insnav import spill
from insnav.deferred import library
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import Numbers, Table, arrow_floats
from insnav.input.formats.text_dialect import SNIFF_BYTES, Dialect, is_comment, parse_number, sniff, split_line
from insnav.input.formats.text_values import form_of, values_of
from insnav.input.formats.unsupported import unsupported
from insnav.plain_text import plain_text

pa = library("pyarrow")
csv = library("pyarrow.csv")

name = "delimited text"
suffixes = (".csv", ".txt")

_BLOCK_BYTES, _BLOCKS = 1 << 20, 8  # size of a block, and number of blocks before memory is released
_SAMPLE_BYTES = 1 << 16  # bytes examined at the start of a text
_TAIL_BYTES = 1 << 13  # bytes examined at the end of a text
_TAIL_ROWS = 20
_FIRST_ROWS = 20
_LONGEST_WAIT = 1.0  # for a thread of Arrow that still uses the data [s]
T = TypeVar("T")


def recognise(source: Source) -> bool:
    """Accept any text, and files of zeros, which `read` refuses: the registry tries this format last."""
    text = bytes(decoded(source.head)).rstrip(b"\0")
    return not source.members and not unsupported(text)


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    dialect = sniff(text[:SNIFF_BYTES], whole=len(text) <= SNIFF_BYTES, where=source.name)
    cells = TextCells(source.name, text, dialect, zeros)
    return {"": Table(source.name, source.sha256, dialect.headers, cells, dialect.units)}


@dataclass(frozen=True, slots=True)
class TextCells:
    """Rows of delimited text, in memory or mapped; `zeros`: number of zero bytes after the text."""

    name: str
    text: bytes | mmap.mmap
    dialect: Dialect
    zeros: int = 0

    def line(self, row: int) -> str:
        """See `insnav.input.formats.table.Cells`."""
        found = next(itertools.islice(self._rows(), row, None), None)
        return str(found[0] if found else self.dialect.first_line + row)

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `insnav.input.formats.table.Cells`."""
        if self.dialect.delimiter == " ":
            rows = (re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", piece) for piece in self._pieces())
            text = spill.together(re.sub(rb"[ \t]+", b";", piece) for piece in rows)
            return replace(self, text=text, dialect=replace(self.dialect, delimiter=";", offset=0)).read(indices)
        texts = self._texts(indices)
        plain = [i for i in indices if i not in texts]
        # Arrow fails on comments, truncated rows and invalid rows, and gives no position: then the slow reader follows.
        numbers = (_if_valid(_read_fast, self.text, self.dialect, plain) if plain else None) or self._scan(plain)
        if not numbers.cut and (cut := self._cut_number(plain, numbers.n_rows)):
            numbers = Numbers({i: c[:-1] for i, c in numbers.columns.items()}, numbers.n_rows - 1, cut)
        if texts:
            numbers = self._with_texts(numbers, texts)
        if not numbers.cut and self.zeros:
            numbers = replace(numbers, cut=self._cut(zeros=self.zeros))
        return numbers

    def labels(self, index: int) -> NDArray[Any]:
        """Return a column of words ``(n,)``, such as names of sensors; one empty word if Arrow cannot read it."""
        read = _if_valid(_read_texts, self.text, self.dialect, [index])
        return np.array([""] if read is None else read[index].to_pylist())

    def _texts(self, indices: Sequence[int]) -> list[int]:
        """Find columns whose first rows contain dates, times of day or angles in text."""
        lines = bytes(self.text[self.dialect.offset : self.dialect.offset + _SAMPLE_BYTES]).splitlines()[:_FIRST_ROWS]
        rows = [split_line(line.decode("utf-8", "replace"), self.dialect.delimiter) for line in lines]
        return [i for i in indices if any(len(row) > i and row[i] and form_of(row[i]) for row in rows)]

    def _with_texts(self, numbers: Numbers, texts: Sequence[int]) -> Numbers:
        """Convert columns of text to numbers."""
        read = _if_valid(_read_texts, self.text, self.dialect, texts)
        if read is None:
            rows = [split_line(text, self.dialect.delimiter) for _, text in self._rows()]
            read = {i: pa.array([row[i] if len(row) > i else "" for row in rows]) for i in texts}
        columns, forms = dict(numbers.columns), {}
        for i, column in read.items():
            converted = values_of(column.slice(0, numbers.n_rows), f"{self.name}: column {self.dialect.headers[i]!r}")
            columns[i], forms[i] = converted.values, converted
        return replace(numbers, columns=columns, texts=forms)

    def _rows(self) -> Iterator[tuple[int, str]]:
        """Yield line number and text of every numeric row."""
        lines = itertools.chain.from_iterable(piece.splitlines() for piece in self._pieces())
        for number, line in enumerate(lines, self.dialect.first_line):
            if line.strip():
                text = line.decode("utf-8", errors="replace")
                if not is_comment(text):
                    yield number, text

    def _pieces(self) -> Iterator[bytes]:
        """Yield the rows in pieces of whole lines, since a large file as a whole would fill the memory."""
        start = self.dialect.offset
        while start < len(self.text):
            end = self.text.find(b"\n", start + _BLOCK_BYTES) + 1 or len(self.text)
            yield self.text[start:end]
            spill.release()
            start = end

    def _scan(self, indices: Sequence[int]) -> Numbers:
        """Read row by row, slowly, to locate the first invalid cell."""
        rows, ahead = itertools.tee(self._rows())
        next(ahead, None)
        headers = self.dialect.headers
        width = len(headers)
        values, n = [array("d") for _ in indices], 0
        for (number, text), following in itertools.zip_longest(rows, ahead):
            last = following is None
            cells = split_line(text, self.dialect.delimiter)
            if len(cells) != width:
                if last and len(cells) < width:
                    return _as_numbers(values, indices, n, self._cut(line=number, cells=len(cells), columns=width))
                thousands = len(cells) > width and '"' not in text
                raise InputError(
                    "format.row_too_long" if thousands else "format.row_width",
                    where=f"{self.name}:{number}",
                    cells=len(cells),
                    names=width,
                    text=plain_text(text)[:80],
                )
            n += 1
            if tuple(cells) == headers:  # repeated header row, as in concatenated files
                for column in values:
                    column.append(np.nan)
                continue
            row: list[float] = []
            for i in indices:
                try:
                    row.append(parse_number(cells[i], self.dialect.decimal))
                except ValueError as error:
                    if last and i == width - 1 and not self._ends_line():
                        return _as_numbers(values, indices, n - 1, self._cut(line=number))
                    raise _no_number(cells[i], f"{self.name}:{number}:{headers[i]}") from error
            for column, value in zip(values, row, strict=True):
                column.append(value)
        return _as_numbers(values, indices, n, None)

    def _cut(self, **values: Any) -> Finding:
        """Build the finding for a last row that is dropped because it is truncated."""
        return Finding.of(Code.ROWS_CUT, file=PurePath(self.name).name, **values)

    def _ends_line(self) -> bool:
        return self.text[-1:] in (b"\n", b"\r")

    def _cut_number(self, indices: Sequence[int], n_rows: int) -> Finding | None:
        """Detect a truncated last number.

        Without a line end at the end of the file, the last cell is truncated if all cells above it are longer.
        """
        last = len(self.dialect.headers) - 1
        if last not in indices or n_rows < 4 or self._ends_line():
            return None
        start = max(self.dialect.offset, len(self.text) - _TAIL_BYTES)
        lines = [t.decode("utf-8", "replace") for t in self.text[start:].splitlines() if t.strip()]
        rows = lines[-(_TAIL_ROWS + 1) :] if start == self.dialect.offset else lines[1:][-(_TAIL_ROWS + 1) :]
        cells = (split_line(row, self.dialect.delimiter) for row in rows)
        widths = [len(row[last]) for row in cells if len(row) > last]
        if len(widths) > 3 and 0 < widths[-1] < min(widths[:-1]):
            return self._cut(characters=widths[-1], limit_characters=min(widths[:-1]))
        return None


def _if_valid(
    read: Callable[[object, Dialect, Sequence[int]], T], data: object, dialect: Dialect, indices: Sequence[int]
) -> T | None:
    """Read with Arrow; None if it fails.

    Arrow reads ahead in a thread, which needs the interpreter to release the data. If the interpreter ends before, as
    after an error, the process aborts. Therefore, this function waits until the thread has released the data.
    """
    references, result = sys.getrefcount(data), None
    with contextlib.suppress(pa.ArrowInvalid):
        result = read(data, dialect, indices)
    until = time.monotonic() + _LONGEST_WAIT
    while sys.getrefcount(data) > references and time.monotonic() < until:
        time.sleep(1e-4)
    return result


def _read_fast(data: object, dialect: Dialect, indices: Sequence[int]) -> Numbers:
    body = pa.py_buffer(data).slice(dialect.offset)
    if body.size == 0:
        return Numbers({i: np.empty(0) for i in indices}, 0)
    how = {"null_values": [""], "decimal_point": dialect.decimal, "check_utf8": False}
    stream = csv.open_csv(pa.BufferReader(body), **_options(dialect, indices, pa.float64(), **how))
    start = bytes(body[:_SAMPLE_BYTES])
    rows = int(1.1 * body.size / len(start) * (start.count(b"\n") + 1)) + 1  # unused rows take no memory
    columns = [spill.empty((rows,)) for _ in indices]
    n = 0
    with stream:
        for number, batch in enumerate(stream):
            end = n + batch.num_rows
            if end > len(columns[0]):
                columns = [spill.joined((column[:n], np.empty(n + batch.num_rows))) for column in columns]
            for column, part in zip(columns, batch.columns, strict=True):
                column[n:end] = arrow_floats(part)
            n = end
            if number % _BLOCKS == 0:
                spill.release()
    return Numbers({i: column[:n] for i, column in zip(indices, columns, strict=True)}, n)


def _read_texts(data: object, dialect: Dialect, indices: Sequence[int]) -> dict[int, Any]:
    """Read columns of text as Arrow arrays."""
    body = pa.py_buffer(data).slice(dialect.offset)
    table = csv.read_csv(pa.BufferReader(body), **_options(dialect, indices, pa.string()))
    return {i: table.column(str(i)).combine_chunks() for i in indices}


def _options(dialect: Dialect, indices: Sequence[int], kind: Any, **how: Any) -> dict[str, Any]:
    """Build the Arrow options to read some columns as one type; columns are named by number."""
    names = [str(i) for i in range(len(dialect.headers))]
    wanted = [names[i] for i in indices]
    types = dict.fromkeys(wanted, kind)
    return {
        # One thread: two use more total CPU time and save a tenth of a second per hour at 200 Hz.
        "read_options": csv.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, column_names=names),
        "parse_options": csv.ParseOptions(delimiter=dialect.delimiter),
        "convert_options": csv.ConvertOptions(column_types=types, include_columns=wanted, **how),
    }


def _as_numbers(values: Sequence[array[float]], indices: Sequence[int], n: int, cut: Finding | None) -> Numbers:
    return Numbers({i: np.array(column) for i, column in zip(indices, values, strict=True)}, n, cut)


def _no_number(cell: str, where: str) -> InputError:
    """Build the error for an invalid cell, by its appearance."""
    text = plain_text(cell)[:40]
    if "\0" in cell:
        return InputError("format.cell_with_zeros", where=where, text=text)
    if re.match(r"^\d{4}-\d\d-\d\d|^\d{1,2}:\d\d:", cell):
        return InputError("format.cell_is_time", where=where, text=text)
    if re.match(r"^[-+]?\d{1,3}(,\d{3})+(\.\d*)?$", cell):
        return InputError("format.cell_with_thousands", where=where, text=text)
    decimal = re.match(r"^[-+]?\d+,\d+$", cell)
    return InputError("format.cell_with_comma" if decimal else "format.cell_no_number", where=where, text=text)
