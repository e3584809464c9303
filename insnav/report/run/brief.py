"""A run in at most 15 lines for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.plain_text import plain_text
from insnav.quantity import Quantity
from insnav.report.page import Page, Table, cell
from insnav.report.run.verdict import run_merits
from insnav.report.terminal import WIDTH, light_text, table_text

LINES = 14  # the command adds the files
_WARNINGS, _ASSUMED = 3, 2  # rows of each at most; the others are on the page


def brief_lines(page: Page, found: EvaluatedRun, width: int | None = WIDTH) -> list[str]:
    """Sum up a run: verdict, figures of merit of both solutions, warnings, what was assumed.

    `page`: that of the run; `width`: of the lines, which may cut long texts; none: nothing is wrapped or cut.
    """
    title = _rows(f"{page.title}: {page.summary[0]}" if page.summary else page.title, 2, width)
    verdict = (
        [] if page.verdict is None else _rows(f"{light_text(page.verdict.light)}: {page.verdict.reason}", 2, width)
    )
    table = _table(run_merits(found))
    warnings = _listed("warning", page.warnings, _WARNINGS, width)
    assumed = _listed("assumed", page.assumptions, _ASSUMED, width)
    return [*title, *verdict, *table, *warnings, *assumed][:LINES]


def _table(merits: dict[str, tuple[Quantity, ...]]) -> list[str]:
    """One row a figure, one column a solution."""
    if not merits:
        return []
    first = next(iter(merits.values()))
    names = [f"{each.label} [{each.shown_unit}]" if each.shown_unit else each.label for each in first]
    rows = tuple((name, *(cell(own[i]) for own in merits.values())) for i, name in enumerate(names))
    return table_text(Table("", ("", *merits), rows)).splitlines()


def _listed(name: str, texts: Sequence[str], most: int, width: int | None) -> list[str]:
    """The first texts of some, one row each, and how many more there are."""
    of = f" (first {most} of {len(texts)})" if len(texts) > most else ""
    shown = [f"{name}{'' if i else of}: {text}" for i, text in enumerate(texts[:most])]
    return [line for text in shown for line in _rows(text, 2 if len(texts) == 1 else 1, width)]


def _rows(text: str, most: int, width: int | None) -> list[str]:
    """A text in at most so many rows, the rest of it cut; whole in one row without a width."""
    if width is None:
        return [plain_text(text)]
    rows = textwrap.wrap(plain_text(text), width, subsequent_indent="  ", break_on_hyphens=False) or [""]
    if len(rows) > most:
        rows = [*rows[:most]]
        rows[-1] = f"{rows[-1][: width - 1]}…"
    return rows
