"""What every report is made of: sections of quantities and figures, written as text, as a page and as JSON.

A report says each quantity once. `insnav.report.terminal`, `insnav.report.html` and `insnav.report.run_json` are the
three writers; none of them knows what a report is about.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from insnav.findings import Code, Finding, Severity
from insnav.messages import At, form, moment, phrase, render, sentence, shows_time
from insnav.plain_text import plain_text
from insnav.quantity import Quantity
from insnav.report.numbers import number, rounded

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
    from pandas import DataFrame as DataFrame

    from insnav.report.panels import Drawing
else:
    DataFrame = Figure = Any  # their libraries are imported where some are made

Show = Literal["all", "page", "json"]
Light = Literal["good", "attention", "bad", "unknown"]
STATISTICS = {
    "rms": "RMS",
    "p95": "95 %",
    "max": "max",
    "mean": "mean",
    "predicted": "predicted sd",
}  # members of a value that is a mapping


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """A figure that is drawn when it is asked for."""

    name: str  # of its file, without suffix; `insnav.result.Result.plot` knows it by this name
    caption: str  # what it shows
    draw: Callable[[], Figure]  # draws it; called inside `insnav.report.figures.drawing`


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result in one sentence, and whether it can be relied on."""

    light: Light
    reason: str  # of the light
    sentence: str

    @property
    def rating(self) -> str:
        """The light in words, with its reason."""
        return phrase("terminal.line", name=phrase(f"light.{self.light}"), text=self.reason)


def by_warnings(sentence: str, findings: Sequence[Finding], without: tuple[Light, str]) -> Verdict:
    """Give a result that needs attention if it has warnings; `without` any, or where worse, this light and reason."""
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
    """One cell of a matrix."""

    text: str  # a few letters
    tone: str  # its colour: ``better1`` to ``better3``, ``worse1`` to ``worse3``, ``same``, ``unclear``, ``fails``
    title: str  # what it says in full, shown when it is pointed at
    key: str = ""  # its id in the page, if there is something behind it
    behind: tuple[Table, ...] = ()  # what it opens


@dataclass(frozen=True, slots=True)
class Matrix:
    """Cells in colour, on the page only; each opens what is behind it."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell | None, ...]], ...]  # name of each row and its cells
    tones: tuple[tuple[str, str], ...]  # colours and what they mean

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells that open something."""
        return tuple(cell for _, row in self.rows for cell in row if cell is not None and cell.behind)


class Later(Sequence[Any]):
    """Drawings that are made when they are looked at first: where only tables are written they are not."""

    def __init__(self, make: Callable[[], Sequence[Drawing]]) -> None:
        self._make = cache(make)

    def __len__(self) -> int:
        return len(self._make())

    def __getitem__(self, at: Any) -> Any:
        return self._make()[at]


@dataclass(frozen=True, slots=True)
class Section:
    """Quantities that belong together: single ones, or rows of a table, one row an item."""

    # where its quantities stand in JSON; empty puts them beside those of its parent, ``name[]`` makes them the next of
    # a list
    key: str
    title: str = ""  # heading; empty for none
    items: tuple[Quantity, ...] = ()  # single quantities
    # a table: quantities of one key are a column, the first names the row. Without a `key` the table is on the page
    # only: the same quantities stand elsewhere in JSON, in another shape.
    rows: tuple[tuple[Quantity, ...], ...] = ()
    # below its tables: on the page where it has no panels, as files where they are asked for
    figures: tuple[FigureSpec, ...] = ()
    panels: Sequence[Drawing] = ()  # interactive drawings, above its tables on the page
    columns: int = 1  # of panels side by side, where the page is wide
    parts: tuple[Section, ...] = ()  # what it consists of
    note: str = ""  # how to read it
    show: Show = "all"  # everywhere; on the page and in JSON; in JSON only
    keyed: bool = False  # in JSON the rows stand under their names, not in a list
    folded: bool = False  # on the page only its title is seen until it is asked for
    matrix: Matrix | None = None  # above its tables on the page


@dataclass(frozen=True, slots=True)
class Page:
    """A whole report."""

    title: str  # what was done, to what
    summary: tuple[str, ...]  # the result in a few sentences
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...] = ()  # what was detected, most important first
    method: tuple[str, ...] = ()  # how the figures were made, and what they rest on
    at: At = moment  # how times of the record are written
    starts_at: float = 0.0  # zero of these times, in the time of the data [s]
    verdict: Verdict | None = None  # the first thing on the page
    merits: tuple[Quantity, ...] = ()  # figures of merit, about six; they stand in the sections too
    merits_note: str = ""  # what they are of
    merits_by: Mapping[str, tuple[Quantity, ...]] | None = None  # those of each position of the switch

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must not overlook; the first with a time says from when times count."""
        texts, hint = [], abs(self.starts_at) > 1.0
        for finding in (each for each in self.findings if each.severity >= Severity.WARNING):
            hinted = hint and shows_time(finding)
            texts.append(sentence(finding, at=self.at) + form("hint") * hinted)
            hint = hint and not hinted
        return tuple(texts)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What was taken for granted: defaults, validity, sources."""
        return (*self.method, *self._texts(Severity.ASSUMPTION))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was detected and dealt with."""
        return self._texts(Severity.NOTE)

    def _texts(self, severity: Severity) -> tuple[str, ...]:
        return tuple(sentence(each, at=self.at) for each in self.findings if each.severity is severity)

    @property
    def lists(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Headings and lines of what stands below the tables, where there is any."""
        both = (("notes", self.notes), ("assumptions", self.assumptions))
        return tuple((phrase(f"page.{name}"), lines) for name, lines in both if lines)

    @property
    def figures(self) -> tuple[FigureSpec, ...]:
        """All figures, in the order of the page."""
        return tuple(figure for section in self.sections for each in _with_parts(section) for figure in each.figures)

    @property
    def embedded(self) -> tuple[FigureSpec, ...]:
        """Figures that the page shows: those of sections without panels."""
        parts = (each for section in self.sections for each in _with_parts(section) if not each.panels)
        return tuple(figure for each in parts for figure in each.figures)

    @property
    def panels(self) -> tuple[Drawing, ...]:
        """All interactive drawings, in the order of the page."""
        return tuple(panel for section in self.sections for each in _with_parts(section) for panel in each.panels)


@dataclass(frozen=True, slots=True)
class Table:
    """Quantities laid out to be read."""

    title: str  # what the rows are
    columns: tuple[str, ...]  # headings, units in brackets
    rows: tuple[tuple[str, ...], ...]  # cells, as many as columns; the first names the row
    note: str = ""  # how to read them


def one_each(key: str, title: str, items: Mapping[str, Sequence[Quantity]], first: str = "", note: str = "") -> Section:
    """The same quantities of several things: in JSON under the name of each, in text one table with a row for each.

    `items`: name to quantities; the value of one without any is None in JSON, and it has no row.
    """
    unknown = tuple(only_json("", Quantity(name, None)) for name, own in items.items() if not own)
    rows = tuple((Quantity("name", name, meaning=first), *own) for name, own in items.items() if own)
    return Section(key, title, rows=rows, parts=unknown, note=note, keyed=True)


def drawn(name: str, caption: str, drawings: Iterable[Drawing], note: str = "", *, columns: int = 1) -> Section:
    """Drawings that are panels on the page and one figure for papers, of panels side by side in so many columns."""
    panels = tuple(drawings)

    def draw() -> Figure:
        from insnav.report.figures import draw_drawings  # matplotlib, only where a figure is asked for

        return draw_drawings(panels, caption, note, columns=columns)

    figures = (FigureSpec(name, caption, draw),) if panels else ()
    return Section("", panels=panels, figures=figures, columns=columns)


def beside(*sections: Section) -> Section:
    """Join drawings of which the first is a map: on a wide page it stays in view beside the others."""
    panels, figures = (tuple(one for each in sections for one in getattr(each, k)) for k in ("panels", "figures"))
    return Section("", panels=panels, figures=figures)


def only_json(key: str, *items: Quantity, parts: tuple[Section, ...] = ()) -> Section:
    """Quantities for ``run.json`` alone."""
    return Section(key, items=items, parts=parts, show="json")


def _with_parts(section: Section) -> tuple[Section, ...]:
    return (section, *(each for part in section.parts for each in _with_parts(part)))


def section_tables(section: Section, shown: Sequence[Show] = ("all",)) -> list[Table]:
    """Lay out a section and its parts.

    `shown`: sections marked otherwise are left out.
    Returns: one for the single quantities, one for the rows, then those of the parts.
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
    """Rows as cells; a unit that a whole column shares stands in its heading unless in the title, others in cells."""
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
    """Columns of a quantity: one, or one for each member of a mapping."""
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
    """Write a quantity without its name and unit: ``12.3 ± 0.4``, ``12.3 (11.8 … 12.9)``, ``–`` if not known."""
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
        return plain_text(value) or number(None)
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
    """Make a data frame of rows of quantities.

    `rows`: a value of several figures is as many columns, such as ``horizontal_rms_m``.
    """
    import pandas as pd

    flat = ([each for whole in row for each in members(whole)] for row in rows)
    return pd.DataFrame([{key: value for each in row for key, value in each.facts().items()} for row in flat])
