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

LINES = 15  # of a short report
_WORDS = 16  # least column width for wrapping
_MARGIN = 12  # width of the names in a summary


def entry(name: str, text: str) -> str:
    """Format one named line of a summary."""
    name = translated(name)
    return f"{name}{' ' * (_MARGIN - cell_len(name))}{translated(text)}"


def page_text(page: Page, width: int | None = None, shown: Sequence[Show] = ("all",)) -> str:
    """Write a report for the terminal: title, verdict, summary, tables, warnings, notes, assumptions.

    `width`: of the terminal; None: no wrapping. `shown`: other sections are omitted.
    Returns: lines without control characters.
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

    Sentences that do not fit are omitted. Warnings above a third of the lines become titles, and the last table ends
    early. `width`: of the terminal.
    """
    with speaking(language(), page.names):
        found = [each for each in page.findings if each.severity >= Severity.WARNING]
        whole, titles = (
            hanging([phrase("terminal.line", name=phrase("run.warning"), text=text) for text in texts], width)
            for texts in (page.warnings, dict.fromkeys(render(each).title for each in found))
        )
        warned = whole if len(whole) <= LINES // 3 else titles
        lines = [*_head(page, width, LINES - len(warned) - len(last)), *warned]
        for table in (each for section in page.sections for each in section_tables(section)):
            shown = _first_rows(table, width, LINES - len(lines) - len(last))
            lines += shown
            if not shown:
                break
    return "\n".join([*map(plain_text, lines), *last])


def _head(page: Page, width: int | None, room: float = math.inf) -> list[str]:
    """Write title and verdict, and the sentences of the summary that fit in `room` lines."""
    verdict = [] if page.verdict is None else [page.verdict.sentence, page.verdict.rating]
    lines = hanging(map(translated, [page.title, *verdict]), width)
    for text in page.summary:
        more = hanging([translated(text)], width)
        lines += more if len(lines) + len(more) <= room else []
    return lines


def _first_rows(table: Table, width: int | None, room: int) -> list[str]:
    """Fit a table into `room` lines. Else write first columns, some rows, and the count of others; else nothing."""
    lines, total = table_text(table, width).splitlines(), len(table.rows)
    for count in range(total, min(total, 2 if any(table.columns) else total) - 1, -1):
        if len(lines) > room:
            lines = table_text(replace(table, rows=table.rows[:count], note=""), width, parts=1).splitlines()
            lines += ["  " + phrase("terminal.more_rows", count=total - count)] * (count < total)
    return lines if len(lines) <= room else []


def hanging(lines: Iterable[str], width: int | None) -> list[str]:
    """Wrap plain lines to a width with hanging indent; unchanged without a width."""
    plain = [plain_text(line) for line in lines]
    if width is None:
        return plain
    indents = [" " * (2 + len(line) - len(line.lstrip())) for line in plain]
    split = (
        wrapped(line, width, subsequent_indent=indent, break_on_hyphens=False) or [""]
        for line, indent in zip(plain, indents, strict=True)
    )
    return [*chain.from_iterable(split)]


def table_text(table: Table, width: int | None = None, parts: int | None = None) -> str:
    """Write a table in columns: first column and text left-aligned, numbers right-aligned.

    `width`: of the terminal. A last column of text is wrapped. Other columns that do not fit follow below, with the row
    names repeated; with `parts`, so many times.
    """
    cells = [tuple(map(translated, row)) for row in (table.columns, *table.rows) if any(row)]
    widths = [max(cell_len(row[i]) for row in cells) for i in range(len(table.columns))]
    words = any(row[-1][:1].isalpha() and " " in row[-1] for row in table.rows)
    room = (width or 0) - 2 * len(widths) - sum(widths[:-1])
    if words and _WORDS <= room < widths[-1]:
        cells = [part for row in cells for part in _in_rows(row, room)]
        widths[-1] = room
    left = {0, len(widths) - 1} if words else {0}
    lines: list[str] = []
    for columns in _fitting(widths, width)[:parts]:
        for row in cells:
            spaces = {i: " " * (widths[i] - cell_len(row[i])) for i in columns}
            texts = (row[i] + spaces[i] if i in left else spaces[i] + row[i] for i in columns)
            lines.append("  ".join(texts).rstrip())
    head = [translated(table.title)] if table.title else []
    note = hanging([f"  {translated(table.note)}"], width) if table.note else []
    return "\n".join([*head, *(f"  {line}" for line in lines), *note])


def _in_rows(row: Sequence[str], room: int) -> Iterator[tuple[str, ...]]:
    """Wrap the text in the last cell of a row over several rows."""
    first, *more = wrapped(row[-1], room) or [""]
    yield *row[:-1], first
    yield from ((*("" for _ in row[:-1]), each) for each in more)


def _fitting(widths: Sequence[int], width: int | None) -> list[list[int]]:
    """Group columns that fit, with the first column in each group."""
    groups = [[0]]
    room = full = (width or 10**9) - 2 - widths[0]
    for column, own in enumerate(widths[1:], 1):
        if own + 2 > room and len(groups[-1]) > 1:
            groups.append([0])
            room = full
        groups[-1].append(column)
        room -= own + 2
    return groups
