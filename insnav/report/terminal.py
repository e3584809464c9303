"""Reports as text for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain

from rich.cells import cell_len

from insnav.findings import Severity
from insnav.messages import language, phrase, render, speaking, translated
from insnav.plain_text import plain_text, wrapped
from insnav.report.page import Page, Show, Table, section_tables

LINES = 15  # number of lines of a short report
_WORDS = 16  # a column of text is wrapped only if at least this width is left for it [characters]
_MARGIN = 12  # width of the column of names in a summary [characters]


def entry(name: str, text: str) -> str:
    """Format one line of a summary: the name, padded to a fixed width, then the text; both translated."""
    name = translated(name)
    return f"{name}{' ' * (_MARGIN - cell_len(name))}{translated(text)}"


def page_text(page: Page, width: int | None = None, shown: Sequence[Show] = ("all",)) -> str:
    """Write a report as plain text: title, verdict, summary, tables, warnings, notes, assumptions.

    `width`: line width [characters]; None: no wrapping. `shown`: include only sections with these values of `Show`.
    Returns: the text, without control characters.
    """
    with speaking(language(), page.names):
        blocks = ["\n".join(_head(page, width))]
        blocks += [table_text(table, width) for section in page.sections for table in section_tables(section, shown)]
        warnings = ((phrase("page.warnings"), page.warnings),) if page.warnings else ()
        for heading, lines in (*warnings, *page.lists):
            blocks.append("\n".join([heading, *hanging([f"  - {line}" for line in lines], width)]))
    return "\n".join(plain_text(line) for line in "\n\n".join(blocks).splitlines())


def brief_text(page: Page, width: int | None, last: Sequence[str] = ()) -> str:
    """Write a report in about `LINES` lines: verdict, summary, warnings, the first tables, and the lines `last`.

    Summary sentences that do not fit are omitted. If the warnings need more than a third of the lines, only their
    titles are written. Tables follow until one does not fit. `width`: line width of the terminal [characters].
    """
    with speaking(language(), page.names):
        findings = [finding for finding in page.findings if finding.severity >= Severity.WARNING]
        sentences, titles = (
            hanging([phrase("terminal.line", name=phrase("run.warning"), text=text) for text in texts], width)
            for texts in (page.warnings, dict.fromkeys(render(finding).title for finding in findings))
        )
        warnings = sentences if len(sentences) <= LINES // 3 else titles
        lines = [*_head(page, width, LINES - len(warnings) - len(last)), *warnings]
        for table in (table for section in page.sections for table in section_tables(section)):
            table_lines = _first_rows(table, width, LINES - len(lines) - len(last))
            lines += table_lines
            if not table_lines:
                break
    return "\n".join([*map(plain_text, lines), *last])


def _head(page: Page, width: int | None, room: float = math.inf) -> list[str]:
    """Write title and verdict, then each summary sentence that still fits into `room` lines."""
    verdict = [] if page.verdict is None else [page.verdict.sentence, page.verdict.rating]
    lines = hanging(map(translated, [page.title, *verdict]), width)
    for text in page.summary:
        sentence_lines = hanging([translated(text)], width)
        lines += sentence_lines if len(lines) + len(sentence_lines) <= room else []
    return lines


def _first_rows(table: Table, width: int | None, room: int) -> list[str]:
    """Write a table if it fits into `room` lines; else its first columns and rows, and the number of omitted rows.

    Returns: the lines; none if even this shortened table does not fit.
    """
    lines, total = table_text(table, width).splitlines(), len(table.rows)
    for count in range(total, min(total, 2 if any(table.columns) else total) - 1, -1):
        if len(lines) > room:
            lines = table_text(replace(table, rows=table.rows[:count], note=""), width, parts=1).splitlines()
            lines += ["  " + phrase("terminal.more_rows", count=total - count)] * (count < total)
    return lines if len(lines) <= room else []


def hanging(lines: Iterable[str], width: int | None) -> list[str]:
    """Wrap lines to a width and indent their continuations by two characters; without a width, do not wrap."""
    plain = [plain_text(line) for line in lines]
    if width is None:
        return plain
    indents = [" " * (2 + len(line) - len(line.lstrip())) for line in plain]
    wrapped_lines = (
        wrapped(line, width, subsequent_indent=indent, break_on_hyphens=False) or [""]
        for line, indent in zip(plain, indents, strict=True)
    )
    return [*chain.from_iterable(wrapped_lines)]


def table_text(table: Table, width: int | None = None, parts: int | None = None) -> str:
    """Write a table in aligned columns: the first column and a last column of text to the left, others to the right.

    `width`: line width of the terminal [characters]. A last column of text is wrapped. Columns that do not fit follow
    in further blocks below, which repeat the first column. `parts`: largest number of blocks; None: all.
    """
    cells = [tuple(map(translated, row)) for row in (table.columns, *table.rows) if any(row)]
    widths = [max(cell_len(row[i]) for row in cells) for i in range(len(table.columns))]
    last_is_text = any(row[-1][:1].isalpha() and " " in row[-1] for row in table.rows)
    room = (width or 0) - 2 * len(widths) - sum(widths[:-1])
    if last_is_text and _WORDS <= room < widths[-1]:
        cells = [part for row in cells for part in _in_rows(row, room)]
        widths[-1] = room
    left_aligned = {0, len(widths) - 1} if last_is_text else {0}
    lines: list[str] = []
    for columns in _fitting(widths, width)[:parts]:
        for row in cells:
            spaces = {i: " " * (widths[i] - cell_len(row[i])) for i in columns}
            texts = (row[i] + spaces[i] if i in left_aligned else spaces[i] + row[i] for i in columns)
            lines.append("  ".join(texts).rstrip())
    head = [translated(table.title)] if table.title else []
    note = hanging([f"  {translated(table.note)}"], width) if table.note else []
    return "\n".join([*head, *(f"  {line}" for line in lines), *note])


def _in_rows(row: Sequence[str], room: int) -> Iterator[tuple[str, ...]]:
    """Wrap the last cell of a row to `room` characters; the additional rows are empty except for this cell."""
    first, *more = wrapped(row[-1], room) or [""]
    yield *row[:-1], first
    yield from ((*("" for _ in row[:-1]), line) for line in more)


def _fitting(widths: Sequence[int], width: int | None) -> list[list[int]]:
    """Group column numbers into blocks no wider than `width`; every block begins with column 0, the row name."""
    groups = [[0]]
    room = full = (width or 10**9) - 2 - widths[0]
    for column, column_width in enumerate(widths[1:], 1):
        if column_width + 2 > room and len(groups[-1]) > 1:
            groups.append([0])
            room = full
        groups[-1].append(column)
        room -= column_width + 2
    return groups
