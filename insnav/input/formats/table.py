"""A table of numbers: its header, and columns that are read when asked for."""

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
    """Columns of a table."""

    columns: dict[int, FloatArray]  # (n,) by index of the column; NaN for an empty cell
    n_rows: int  # number of rows
    cut: Finding | None = None  # why a last row was left out, if one was
    texts: Mapping[int, TextValues] = field(default_factory=dict)  # columns that were text, by index


class Cells(Protocol):
    """The rows of a table, in any format."""

    def read(self, indices: Sequence[int]) -> Numbers:
        """Read columns as numbers; a cell that is none, or damaged rows, are refused."""
        ...

    def line(self, row: int) -> str:
        """Where a row, counted from 0, is found in the file, such as a line number."""
        ...


@dataclass(frozen=True, slots=True)
class ArrayCells:
    """Rows of a format that is converted as a whole: columns ``(n,)`` in the order of the headers; see `Cells`."""

    columns: tuple[FloatArray, ...]
    line: Callable[[int], str]
    cut: Finding | None = None

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `Cells`."""
        return Numbers({i: self.columns[i] for i in indices}, len(self.columns[0]), self.cut)


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose header has been read."""

    name: str  # the file, fit to be printed
    sha256: str  # digest of the file
    headers: tuple[str, ...]  # names of the columns
    cells: Cells  # its rows
    units: tuple[str, ...] | None = None  # row of units under the header
    notes: tuple[Finding, ...] = ()  # how the format was read, such as the time scale
    format: str = ""  # name of the format it was read from
    week: float | None = None  # GPS week from whose start the times count, if that is known
    axes: str = ""  # where the sensor's x, y, z point by the definition of the format; empty if it has none
    parts: Mapping[str, int] = field(default_factory=dict)  # columns by header of which others were made
    unusable: tuple[str, ...] = ()  # messages of the file with samples that insnav cannot use

    def place(self, row: int, index: int | None = None) -> str:
        """``file:line:column`` of a cell; rows are counted from 0."""
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
    """Table of columns ``(n,)`` by canonical name, as formats make it that convert a file as a whole.

    `row`: what stands in the file for a row, such as ``NAV-PVT``. `cut`: why a last one was left out. `axes`, `week`:
    see `Table`.
    """
    cells = ArrayCells(tuple(columns.values()), lambda number: f"{row} {number + 1}", cut)
    given = tuple(note for note in notes if note)
    return Table(source.name, source.sha256, tuple(columns), cells, notes=given, axes=axes, week=week)


def arrow_floats(part: Any) -> FloatArray:
    """Values ``(n,)`` of an Arrow array of doubles, NaN for null. Arrow's own `to_numpy` imports pandas (0.3 s)."""
    validity, buffer = part.buffers()
    end = part.offset + len(part)
    values = np.frombuffer(buffer, dtype=np.float64, count=end)[part.offset :]
    if part.null_count and validity is not None:
        bits = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")
        values = np.where(bits[part.offset : end] == 1, values, np.nan)
    return values
