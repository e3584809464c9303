"""Structure of every report: sections of quantities and figures, written as text, as a page and as JSON.

A report contains each quantity once. `insnav.report.terminal`, `insnav.report.html` and `insnav.report.save` are
the three writers; they are independent of the subject of a report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from insnav.findings import Code, Finding, Severity
from insnav.messages import At, form, moment, phrase, render, sentence, shows_time, translated
from insnav.plain_text import Name, plain_text
from insnav.quantity import Quantity
from insnav.report.style import number, rounded

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
    from pandas import DataFrame as DataFrame

    from insnav.report.panels import Drawing
else:
    DataFrame = Figure = Any  # their libraries are imported on use

Show = Literal["all", "page", "json"]
Light = Literal["good", "attention", "bad", "unknown"]
STATISTICS = {
    "rms": "RMS",
    "p95": "95 %",
    "max": "max",
    "mean": "mean",
    "predicted": "predicted sd",
}  # members of a mapping value


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """Figure that is drawn on request."""

    name: str  # file name without suffix; also the name in `insnav.result.Result.plot`
    caption: str  # caption
    draw: Callable[[], Figure]  # called inside `insnav.report.figures.drawing`


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result in one sentence, with its reliability."""

    light: Light
    reason: str  # reason for the light
    sentence: str

    @property
    def rating(self) -> str:
        """Light in words, with its reason."""
        return phrase("terminal.line", name=phrase(f"light.{self.light}"), text=translated(self.reason))


def by_warnings(sentence: str, findings: Sequence[Finding], without: tuple[Light, str]) -> Verdict:
    """Build a verdict: needs attention if there are warnings; otherwise, or if worse, `without` (light and reason)."""
    warnings = [each for each in findings if each.severity >= Severity.WARNING]
    if lost := [each for each in warnings if each.severity is Severity.UNUSABLE]:
        return Verdict("bad", render(lost[0]).title, sentence)
    if not warnings or without[0] in ("attention", "bad"):
        return Verdict(*without, sentence)
    title, more = render(warnings[0]).title, len(warnings) - 1
    reason = phrase("page.more_warnings", title=title, count=more) if more else title
    return Verdict("attention", reason, sentence)


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell of a matrix."""

    text: str  # a few letters
    tone: str  # its colour: ``better1`` to ``better3``, ``worse1`` to ``worse3``, ``same``, ``unclear``, ``fails``
    title: str  # full text, shown on hover
    key: str = ""  # id in the page, if it opens details
    behind: tuple[Table, ...] = ()  # tables that it opens


@dataclass(frozen=True, slots=True)
class Matrix:
    """Coloured cells, on the page only; each opens its details."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell | None, ...]], ...]  # row names and cells
    tones: tuple[tuple[str, str], ...]  # colours and their meaning

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells with details."""
        return tuple(cell for _, row in self.rows for cell in row if cell is not None and cell.behind)


class Later(Sequence[Any]):
    """Drawings that are made on first access: output of tables alone makes none."""

    def __init__(self, make: Callable[[], Sequence[Drawing]]) -> None:
        self._make = cache(make)

    def __len__(self) -> int:
        return len(self._make())

    def __getitem__(self, at: Any) -> Any:
        return self._make()[at]


@dataclass(frozen=True, slots=True)
class Section:
    """Related quantities: single ones, or rows of a table, one row per item."""

    # position of its quantities in JSON; empty: next to the parent's quantities, ``name[]``: next entry of a list
    key: str
    title: str = ""  # heading; may be empty
    items: tuple[Quantity, ...] = ()  # single quantities
    # a table: quantities of one key are a column, the first names the row. Without a `key` the table is on the page
    # only: JSON has the same quantities elsewhere, in another shape.
    rows: tuple[tuple[Quantity, ...], ...] = ()
    # below its tables: on the page without panels, as files on request
    figures: tuple[FigureSpec, ...] = ()
    panels: Sequence[Drawing] = ()  # interactive drawings, above its tables on the page
    columns: int = 1  # of panels side by side, on a wide page
    parts: tuple[Section, ...] = ()  # subsections
    note: str = ""  # explanation
    show: Show = "all"  # everywhere, on the page and in JSON, or in JSON only
    keyed: bool = False  # in JSON the rows are keyed by name, not listed
    folded: bool = False  # on the page only its title is visible until opened
    matrix: Matrix | None = None  # above its tables on the page


@dataclass(frozen=True, slots=True)
class Page:
    """Complete report."""

    title: str  # action and subject
    summary: tuple[str, ...]  # the result in a few sentences
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...] = ()  # most important first
    method: tuple[str, ...] = ()  # method of the figures, and their basis
    at: At = moment  # format of record times
    starts_at: float = 0.0  # zero of these times, in the time of the data [s]
    verdict: Verdict | None = None  # the first thing on the page
    merits: tuple[Quantity, ...] = ()  # figures of merit, about six; also in the sections
    merits_note: str = ""  # subject of the merits
    merits_by: Mapping[str, tuple[Quantity, ...]] | None = None  # merits at each position of the switch
    names: frozenset[str] = frozenset()  # names that the user chose: not translated within a text; see `Name`

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings; the first with a time states the time origin."""
        texts, hint = [], abs(self.starts_at) > 1.0
        for finding in (each for each in self.findings if each.severity >= Severity.WARNING):
            hinted = hint and shows_time(finding)
            texts.append(sentence(finding, at=self.at) + form("hint") * hinted)
            hint = hint and not hinted
        return tuple(texts)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions: defaults, validity, sources."""
        return (*self._texts(Severity.ASSUMPTION), *self.method)

    @property
    def notes(self) -> tuple[str, ...]:
        """Findings that insnav has handled."""
        return self._texts(Severity.NOTE)

    def _texts(self, severity: Severity) -> tuple[str, ...]:
        return tuple(sentence(each, at=self.at) for each in self.findings if each.severity is severity)

    @property
    def lists(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Headings and lines of the lists below the tables, if any."""
        both = (("notes", self.notes), ("assumptions", self.assumptions))
        return tuple((phrase(f"page.{name}"), lines) for name, lines in both if lines)

    @property
    def figures(self) -> tuple[FigureSpec, ...]:
        """All figures, in page order."""
        return tuple(figure for section in self.sections for each in _with_parts(section) for figure in each.figures)

    @property
    def embedded(self) -> tuple[FigureSpec, ...]:
        """Figures shown on the page: of sections without panels."""
        parts = (each for section in self.sections for each in _with_parts(section) if not each.panels)
        return tuple(figure for each in parts for figure in each.figures)

    @property
    def panels(self) -> tuple[Drawing, ...]:
        """All interactive drawings, in page order."""
        return tuple(panel for section in self.sections for each in _with_parts(section) for panel in each.panels)


@dataclass(frozen=True, slots=True)
class Table:
    """Quantities laid out as a table."""

    title: str  # subject of the rows
    columns: tuple[str, ...]  # headings, units in brackets
    rows: tuple[tuple[str, ...], ...]  # cells, as many as columns; the first names the row
    note: str = ""  # explanation


def one_each(key: str, title: str, items: Mapping[str, Sequence[Quantity]], first: str = "", note: str = "") -> Section:
    """Lay out equal quantities of several things: keyed by name in JSON, in text a table with a row per thing.

    `items`: name to quantities; a name without quantities is None in JSON, and has no row.
    """
    unknown = tuple(only_json("", Quantity(name, None)) for name, own in items.items() if not own)
    rows = tuple((Quantity("name", name, meaning=first), *own) for name, own in items.items() if own)
    return Section(key, title, rows=rows, parts=unknown, note=note, keyed=True)


def drawn(name: str, caption: str, drawings: Iterable[Drawing], note: str = "", *, columns: int = 1) -> Section:
    """Build drawings that are panels on the page and one figure for papers, with panels in `columns` columns."""
    panels = tuple(drawings)

    def draw() -> Figure:
        from insnav.report.figures import draw_drawings  # imports matplotlib, only for a requested figure

        return draw_drawings(panels, caption, note, columns=columns)

    figures = (FigureSpec(name, caption, draw),) if panels else ()
    return Section("", panels=panels, figures=figures, columns=columns)


def beside(*sections: Section) -> Section:
    """Join drawings with a map first. On a wide page the map stays in view next to the others."""
    panels, figures = (tuple(one for each in sections for one in getattr(each, k)) for k in ("panels", "figures"))
    return Section("", panels=panels, figures=figures)


def only_json(key: str, *items: Quantity, parts: tuple[Section, ...] = ()) -> Section:
    """Build quantities for ``run.json`` alone."""
    return Section(key, items=items, parts=parts, show="json")


def _with_parts(section: Section) -> tuple[Section, ...]:
    return (section, *(each for part in section.parts for each in _with_parts(part)))


def section_tables(section: Section, shown: Sequence[Show] = ("all",)) -> list[Table]:
    """Lay out a section and its parts.

    `shown`: other sections are omitted.
    Returns: a table of the single quantities, a table of the rows, then the tables of the parts.
    """
    if section.show not in shown:
        return []
    tables = []
    if section.items:
        rows = tuple((f"{each.label}{_bracket(each)}", cell(each)) for each in section.items)
        tables.append(Table(section.title, ("", ""), rows, "" if section.rows else section.note))
    if section.rows:
        tables.append(_rows_table(section))
    return [*tables, *(table for part in section.parts for table in section_tables(part, shown))]


def _rows_table(section: Section) -> Table:
    """Format rows as cells. Headings show the unit of a whole column unless the title does. Cells show mixed units."""
    found = [{each.key: each for whole in row for each in members(whole)} for row in section.rows]
    columns = list(dict.fromkeys(key for row in found for key in row))
    headings, shared = [], {}
    for key in columns:
        units = {row[key].shown_unit for row in found if key in row}
        first = next(row[key] for row in found if key in row)
        shared[key] = len(units) == 1
        bracket = _bracket(first).strip()
        headings.append(f"{first.label} {bracket}" if shared[key] and bracket not in section.title else first.label)
    cells = tuple(tuple(_cell_in_row(row.get(key), with_unit=not shared[key]) for key in columns) for row in found)
    return Table(section.title, tuple(headings), cells, section.note)


def members(each: Quantity) -> list[Quantity]:
    """Return the columns of a quantity: one, or one for each member of a mapping."""
    if not isinstance(each.value, Mapping):
        return [each]
    return [
        replace(
            each, key=f"{each.key}_{name}", value=value, meaning=f"{each.label} {STATISTICS.get(name, name)}".strip()
        )
        for name, value in each.value.items()
    ]


def _bracket(each: Quantity) -> str:
    return f" [{each.shown_unit}]" if each.shown_unit else ""


def _cell_in_row(each: Quantity | None, *, with_unit: bool) -> str:
    if each is None:
        return ""
    text = cell(each)
    return f"{text} {each.shown_unit}" if with_unit and each.shown_unit and text != number(None) else text


def cell(each: Quantity) -> str:
    """Format a quantity without name and unit: ``12.3 ± 0.4``, ``12.3 (11.8 … 12.9)``, ``–`` if unknown."""
    text = _value_text(each)
    return f"{text} {each.mark}" if each.mark else text


def _value_text(each: Quantity) -> str:
    if isinstance(each.value, Mapping):
        members = ((name, cell(replace(each, value=one))) for name, one in each.value.items())
        return ", ".join(f"{plain_text(STATISTICS.get(name, name))} {text}" for name, text in members) or number(None)
    value, sd = each.scaled(each.value), each.scaled(each.sd)
    if isinstance(value, Code):
        return render(Finding.of(value)).title
    if isinstance(value, str):
        return (Name if isinstance(value, Name) else str)(plain_text(value)) or number(None)
    if isinstance(value, bool):
        return phrase("page.yes" if value else "page.no")
    if isinstance(value, int | np.integer):
        return str(value)
    if value is None or isinstance(value, float):
        text = _with_sd(value, sd, each)
    elif len(value) == 0:
        text = number(None)
    elif isinstance(value[0], str):
        text = ", ".join(plain_text(item) for item in value)
    else:
        sds = np.broadcast_to(np.nan if sd is None else np.asarray(sd, dtype=np.float64), np.shape(value)).ravel()
        parts = zip(np.ravel(np.asarray(value, dtype=np.float64)), sds, strict=True)
        text = ", ".join(_with_sd(float(v), float(s), each) for v, s in parts)
    if each.interval is None or not np.isfinite(each.interval).all():
        return text
    known = isinstance(sd, float) and np.isfinite(sd) and sd > 0.0
    low, high = (
        rounded(bound, sd) if known else number(bound, each.digits) if bound else "0"
        for bound in (float(each.scaled(float(end))) for end in each.interval)
    )
    return f"{text} ({low} … {high})"


def _with_sd(value: float | None, sd: Any, each: Quantity) -> str:
    if value is None or not np.isfinite(value):
        return number(None)
    if each.decimals is not None:
        text = f"{round(float(value), each.decimals) + 0.0:.{each.decimals}f}"  # no -0.0
    elif sd is not None and np.isfinite(sd) and sd > 0.0:
        text = rounded(float(value), float(sd))
    else:
        return number(float(value), each.digits) if value else "0"
    return text if sd is None or not np.isfinite(sd) or not sd > 0.0 else f"{text} ± {number(float(sd), 2)}"


def rows_frame(rows: Iterable[Iterable[Quantity]]) -> DataFrame:
    """Build a data frame from rows of quantities.

    `rows`: a value with several members fills several columns, such as ``horizontal_rms_m``.
    """
    import pandas as pd

    flat = ([each for whole in row for each in members(whole)] for row in rows)
    return pd.DataFrame([{key: value for each in row for key, value in each.facts().items()} for row in flat])
