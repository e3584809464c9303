"""Table of numbers: its header, and columns that are read on demand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from insnav.findings import Finding
from insnav.types import FloatArray

if TYPE_CHECKING:
    from insnav.input.formats.source import Source
    from insnav.input.formats.text_values import TextValues


@dataclass(frozen=True, slots=True)
class Numbers:
    """Columns that were read from a table."""

    columns: dict[int, FloatArray]  # (n,) by index of the column; NaN for an empty cell
    n_rows: int  # number of rows
    cut: Finding | None = None  # reason for dropping the last row, if dropped
    texts: Mapping[int, TextValues] = field(default_factory=dict)  # converted text columns, by index


class Cells(Protocol):
    """Interface of the rows of a table, in any format."""

    def read(self, indices: Sequence[int]) -> Numbers:
        """Read columns as numbers; refuse invalid cells and damaged rows."""
        ...

    def line(self, row: int) -> str:
        """Return the location of a row, counted from 0, such as a line number."""
        ...


@dataclass(frozen=True, slots=True)
class ArrayCells:
    """Rows of a fully converted format: columns ``(n,)`` in the order of the headers; see `Cells`."""

    columns: tuple[FloatArray, ...]
    line: Callable[[int], str]
    cut: Finding | None = None

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `Cells`."""
        return Numbers({i: self.columns[i] for i in indices}, len(self.columns[0]), self.cut)


@dataclass(frozen=True, slots=True)
class Table:
    """Table of a file: its header is read, its rows are read on demand."""

    name: str  # printable file name
    sha256: str  # digest of the file
    headers: tuple[str, ...]  # names of the columns
    cells: Cells  # rows, read on demand
    units: tuple[str, ...] | None = None  # row of units under the header
    notes: tuple[Finding, ...] = ()  # findings on the format, such as the time scale
    format: str = ""  # name of its format
    week: float | None = None  # GPS week of the time origin, if known
    axes: str = ""  # directions of the sensor's x, y, z in the format's definition; empty if undefined
    parts: Mapping[str, int] = field(default_factory=dict)  # index of columns, by header, that form composed columns
    unusable: tuple[str, ...] = ()  # names of logs with unusable samples, in a file without usable samples

    def place(self, row: int, index: int | None = None) -> str:
        """Format ``file:line:column`` of a cell; rows are counted from 0."""
        column = "" if index is None else f":{self.headers[index]}"
        return f"{self.name}:{self.cells.line(row)}{column}"


def column_table(
    source: Source,
    columns: Mapping[str, FloatArray],
    notes: Iterable[Finding | None] = (),
    *,
    row: str = "row",
    cut: Finding | None = None,
    axes: str = "",
    week: float | None = None,
) -> Table:
    """Build a table of columns ``(n,)`` by canonical name, for formats that convert a whole file.

    `row`: unit of a row in the file, such as ``NAV-PVT``. `cut`: reason for dropping the last row. `axes`, `week`: see
    `Table`.
    """
    cells = ArrayCells(tuple(columns.values()), lambda number: f"{row} {number + 1}", cut)
    kept_notes = tuple(note for note in notes if note)
    return Table(source.name, source.sha256, tuple(columns), cells, notes=kept_notes, axes=axes, week=week)


def arrow_floats(part: Any) -> FloatArray:
    """Convert an Arrow array of doubles to ``(n,)``, NaN for null; Arrow's `to_numpy` would import pandas (0.3 s)."""
    validity, buffer = part.buffers()
    end = part.offset + len(part)
    values = np.frombuffer(buffer, dtype=np.float64, count=end)[part.offset :]
    if part.null_count and validity is not None:
        bits = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")
        values = np.where(bits[part.offset : end] == 1, values, np.nan)
    return values
