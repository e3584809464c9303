"""Text dialect of a table: delimiter, decimal sign, comments, header, row of units."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

from insnav.exceptions import InputError
from insnav.input.interpret.schema import UNIT_SPELLINGS, compact
from insnav.plain_text import plain_text

SNIFF_BYTES = 1 << 16
_SAMPLE_ROWS = 20  # number of rows that are examined to detect the dialect
_FEWEST_NUMBERS = 4  # least count of numbers in a row that shows where a table begins
_COMMENT = ("#", "%", "//")
# In order of preference; blank means any run of blanks and tabs.
_DELIMITERS = (",", ";", "\t", "|", " ")
_WHOLE = re.compile(r"\s*[+-]?\d+\s*")
_DECIMAL_COMMA = re.compile(r"^[-+]?\d+,\d+([eE][-+]?\d+)?$")
_UNITS = {word for table in UNIT_SPELLINGS.values() for word in table}


@dataclass(frozen=True, slots=True)
class Dialect:
    """Text dialect of a table."""

    delimiter: str  # one character; a blank means any run of blanks and tabs
    decimal: str  # decimal sign, ``.`` or ``,``
    headers: tuple[str, ...]  # names of the columns
    units: tuple[str, ...] | None  # row of units under the header, if any
    offset: int  # position of the first row of numbers in the text [bytes]
    first_line: int  # first line of numbers, counted from 1


def is_comment(line: str) -> bool:
    """Return True if a line is a comment."""
    return line.lstrip().startswith(_COMMENT)


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a line into cells without quotes and surrounding blanks; a blank delimiter means any blanks and tabs."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    else:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def parse_number(cell: str, decimal: str) -> float:
    """Parse a cell as a number, NaN if empty; raise `ValueError` if invalid."""
    cell = cell.strip()
    if not cell:
        return float("nan")
    if "_" in cell or (decimal == "," and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(",", ".") if decimal == "," else cell)


def _is_number(cell: str) -> bool:
    try:
        parse_number(cell, ".")
    except ValueError:
        return False
    return bool(cell)


def _numbers(cells: Sequence[str]) -> int:
    """Count the cells that are numbers, with either decimal sign."""
    return sum(_is_number(cell) or bool(_DECIMAL_COMMA.match(cell)) for cell in cells)


def sniff(head: bytes, *, whole: bool, where: str) -> Dialect:
    """Detect the text dialect of a table.

    `head`: the first `SNIFF_BYTES` of the text, UTF-8 or Latin-1. `whole`: `head` is the complete text.
    Raises: InputError: only one column, or a header that does not fit the rows.
    """
    raw = head.splitlines(keepends=True)
    if not whole and len(raw) > 1:
        raw = raw[:-1]
    lines = [_decode(line).rstrip("\r\n") for line in raw]
    rows = [i for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    if not rows:
        raise InputError("format.only_comments", where=where)
    rows = _from_header(lines, rows)
    comments = [i for i, line in enumerate(lines[: rows[0]]) if is_comment(line)]
    body = rows[1:]
    cut = whole and not head.endswith((b"\n", b"\r")) and len(body) > 1  # a last row without line end may be truncated
    sample = [lines[i] for i in (body[:-1] if cut else body)][:_SAMPLE_ROWS]
    header_line = rows[0]
    delimiter = _delimiter(lines[header_line], sample)
    names = split_line(lines[header_line], delimiter)
    if 2 * _numbers(names) >= sum(map(bool, names)):
        # The header may be the last comment, as in numpy.savetxt and ROS.
        sample = [lines[header_line], *sample]
        body = rows
        header_line = next((i for i in reversed(comments) if _fits(lines[i], sample)), -1)
        if header_line < 0:
            return _headerless(raw, lines, rows, sample)
        header_text = _bare_comment(lines[header_line])
        delimiter = _delimiter(header_text, sample)
        names = split_line(header_text, delimiter)
    names = _trailing(names, sample, delimiter)
    units, body, sample = _units_row(lines, body, sample, delimiter, len(names))
    _check_width(names, sample, delimiter, where, header_line + 1)
    first = body[0] if body else len(lines)
    return Dialect(
        delimiter,
        _decimal(sample, delimiter),
        tuple(plain_text(name).strip().strip("'") for name in names),
        units,
        sum(len(line) for line in raw[:first]),
        first + 1,
    )


def _from_header(lines: Sequence[str], rows: list[int]) -> list[int]:
    """Drop rows above the header, such as logger name and version; rows of numbers have another width."""
    for k, (row, next_row) in enumerate(itertools.pairwise(rows[: _SAMPLE_ROWS + 1])):
        for delimiter in _DELIMITERS[:-1]:
            cells, next_cells = split_line(lines[row], delimiter), split_line(lines[next_row], delimiter)
            if len(cells) != len(next_cells) or _numbers(cells) < max(_FEWEST_NUMBERS, 0.7 * len(cells)):
                continue
            first = k
            while first > 0 and abs(len(split_line(lines[rows[first - 1]], delimiter)) - len(cells)) <= 1:
                first -= 1
            return rows[first:] if first < k else rows
    return rows


def _headerless(raw: Sequence[bytes], lines: Sequence[str], rows: Sequence[int], sample: Sequence[str]) -> Dialect:
    """Describe a table without header: its columns are named 1, 2, 3; a truncated first row is dropped."""
    delimiter = _delimiter(lines[rows[1]] if len(rows) > 1 else lines[rows[0]], sample)
    widths = [len(split_line(row, delimiter)) for row in sample]
    width = max(set(widths), key=widths.count)
    first = rows[0] if widths[0] == width or len(rows) < 2 else rows[1]
    headers = tuple(str(i + 1) for i in range(width))
    return Dialect(
        delimiter, _decimal(sample, delimiter), headers, None, sum(len(line) for line in raw[:first]), first + 1
    )


def _decode(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _bare_comment(line: str) -> str:
    return line.lstrip().lstrip("#%/").strip()


def _fits(comment: str, sample: Sequence[str]) -> bool:
    bare = _bare_comment(comment)
    delimiter = _delimiter(bare, sample)
    names = split_line(bare, delimiter)
    return len(names) > 1 and all(len(split_line(row, delimiter)) == len(names) for row in sample)


def _delimiter(header: str, sample: Sequence[str]) -> str:
    """Choose the delimiter that fits most rows; among equal ones, the delimiter that gives most columns."""

    def merit(delimiter: str) -> tuple[bool, float, int]:
        width = len(split_line(header, delimiter))
        counts = [len(split_line(row, delimiter)) for row in sample]
        fit = sum(n in (width, width + 1) for n in counts) / len(counts) if counts else 1.0
        return width > 1, fit, width

    best = max(_DELIMITERS, key=merit)
    single = best == " " and sample and all(_is_number(row.strip()) for row in sample)  # a header of several words
    return "," if single else best


def _units_row(
    lines: Sequence[str], body: list[int], sample: list[str], delimiter: str, width: int
) -> tuple[tuple[str, ...] | None, list[int], list[str]]:
    """Extract a row of units under the header: no numbers, and at least half of its words are units."""
    if not sample or not body:
        return None, body, sample
    cells = split_line(lines[body[0]], delimiter)
    words = [compact(cell) for cell in cells if compact(cell)]
    if not words or any(_is_number(cell) for cell in cells):
        return None, body, sample
    if sum(word in _UNITS for word in words) * 2 < len(words):
        return None, body, sample
    return tuple((cells + [""] * width)[:width]), body[1:], sample[1:]


def _trailing(names: list[str], sample: Sequence[str], delimiter: str) -> list[str]:
    """Add a nameless last column if all rows end with a delimiter."""
    if delimiter == " " or not sample:
        return names
    rows = [split_line(row, delimiter) for row in sample]
    if all(len(row) == len(names) + 1 and not row[-1] for row in rows):
        return [*names, ""]
    return names


def _check_width(names: Sequence[str], sample: Sequence[str], delimiter: str, where: str, line: int) -> None:
    rows = [split_line(row, delimiter) for row in sample]
    if len(names) < 2 and not (rows and all(len(row) == 1 and _is_number(row[0]) for row in rows)):
        raise InputError("format.one_column", where=f"{where}:{line}", header=plain_text(names[0])[:80])
    counts = [len(row) for row in rows]
    if counts and all(n != len(names) for n in counts):
        whole = all(_WHOLE.fullmatch(cell) for cell in rows[0])
        commas = delimiter == "," and whole and len(names) < counts[0] <= 2 * len(names)
        raise InputError(
            "format.commas_within_numbers" if commas else "format.header_width",
            where=f"{where}:{line}",
            names=len(names),
            cells=counts[0],
        )


def _decimal(sample: Sequence[str], delimiter: str) -> str:
    if delimiter == ",":
        return "."
    return "," if any(_DECIMAL_COMMA.match(c) for row in sample for c in split_line(row, delimiter)) else "."
