"""Reports as text for the terminal."""

from __future__ import annotations

from insnav.plain_text import plain_text
from insnav.report.page import Page, Table, section_tables


def page_text(page: Page) -> str:
    """Write a report for the terminal: title, summary, tables, warnings, notes, assumptions.

    Returns: lines without control characters; sections that are shown on the page only are left out.
    """
    verdict = [] if page.verdict is None else [page.verdict.sentence]
    blocks = ["\n".join([page.title, *verdict, *page.summary])]
    blocks += [table_text(table) for section in page.sections for table in section_tables(section)]
    warnings = (("Warnings", page.warnings),) if page.warnings else ()
    blocks += ["\n".join([heading, *(f"  - {line}" for line in lines)]) for heading, lines in (*warnings, *page.lists)]
    return "\n".join(plain_text(line) for line in "\n\n".join(blocks).splitlines())


def table_text(table: Table) -> str:
    """Write a table in columns: the first to the left, numbers to the right."""
    cells = [row for row in (table.columns, *table.rows) if any(row)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]
    lines = [
        "  ".join(text.ljust(width) if i == 0 else text.rjust(width) for i, (text, width) in enumerate(row)).rstrip()
        for row in ([*zip(row, widths, strict=True)] for row in cells)
    ]
    head = [table.title] if table.title else []
    return "\n".join([*head, *(f"  {line}" for line in lines), *([f"  {table.note}"] if table.note else [])])
