"""Structure of every report: sections of quantities and figures, and their layout as tables.

A report contains each quantity once. Three writers work for every kind of report: `insnav.report.terminal` writes
text, `insnav.report.html` a web page, `insnav.report.save` JSON.
"""

from __future__ import annotations

from collections import Counter
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
    DataFrame = Figure = Any  # matplotlib and pandas are slow to import: only functions that need them do so

REPEATED = 20  # largest number of listed notes, or assumptions, with one title
Show = Literal["all", "page", "json"]
Light = Literal["good", "attention", "bad", "unknown"]
# labels of statistics in tables, for a `Quantity` with several values; by their names in JSON
STATISTICS = {"rms": "RMS", "p95": "95 %", "max": "max", "mean": "mean", "predicted": "predicted sd"}


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """Name and caption of a matplotlib figure, and the function that draws it."""

    name: str  # file name without suffix; also the name in `insnav.result.Result.plot`
    caption: str  # title of the figure
    draw: Callable[[], Figure]  # draws the figure; call it inside `insnav.report.figures.drawing`


@dataclass(frozen=True, slots=True)
class Verdict:
    """Main result in one sentence, and a traffic light that rates its reliability."""

    light: Light
    reason: str  # reason for the traffic light
    sentence: str

    @property
    def rating(self) -> str:
        """Traffic light in words, with its reason."""
        return phrase("terminal.line", name=phrase(f"light.{self.light}"), text=translated(self.reason))


def by_warnings(sentence: str, findings: Sequence[Finding], without: tuple[Light, str]) -> Verdict:
    """Build a verdict: with warnings at best "attention", if unusable "bad". `without`: light and reason otherwise."""
    warnings = [finding for finding in findings if finding.severity >= Severity.WARNING]
    if unusable := [finding for finding in warnings if finding.severity is Severity.UNUSABLE]:
        return Verdict("bad", render(unusable[0]).title, sentence)
    if not warnings or without[0] in ("attention", "bad"):
        return Verdict(*without, sentence)
    title, further = render(warnings[0]).title, len(warnings) - 1
    reason = phrase("page.more_warnings", title=title, count=further) if further else title
    return Verdict("attention", reason, sentence)


@dataclass(frozen=True, slots=True)
class Cell:
    """Coloured cell of a `Matrix`."""

    text: str  # a few characters
    tone: str  # colour: ``better1`` to ``better3``, ``worse1`` to ``worse3``, ``same``, ``unclear``, ``fails``
    title: str  # full text, shown on hover
    key: str = ""  # id of the cell in the page, if a click on it opens details
    behind: tuple[Table, ...] = ()  # details: tables that a click on the cell opens


@dataclass(frozen=True, slots=True)
class Matrix:
    """Table of coloured cells that open details; only the HTML page has it."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell | None, ...]], ...]  # name and cells of each row
    tones: tuple[tuple[str, str], ...]  # each `Cell.tone` and its meaning, for the legend

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells that open details."""
        return tuple(cell for _, row in self.rows for cell in row if cell is not None and cell.behind)


class Later(Sequence[Any]):
    """Sequence of drawings that are computed on first access, so that text and JSON output never computes them."""

    def __init__(self, make: Callable[[], Sequence[Drawing]]) -> None:
        self._make = cache(make)

    def __len__(self) -> int:
        return len(self._make())

    def __getitem__(self, at: Any) -> Any:
        return self._make()[at]


@dataclass(frozen=True, slots=True)
class Section:
    """Part of a report: related quantities, single or as rows of a table, with their figures and subsections."""

    # JSON key of the section's quantities. Empty: they join the quantities of the parent section. ``name[]``: they
    # become the next entry of the list ``name``
    key: str
    title: str = ""  # heading; may be empty
    items: tuple[Quantity, ...] = ()  # single quantities
    # rows of a table: quantities with equal keys form a column, the first quantity of a row is its name. Rows of a
    # section without `key` are not written to JSON, which has these quantities elsewhere
    rows: tuple[tuple[Quantity, ...], ...] = ()
    figures: tuple[FigureSpec, ...] = ()  # image files on request; also below the tables of a page without panels
    panels: Sequence[Drawing] = ()  # interactive drawings, above the tables of the page
    columns: int = 1  # number of panels side by side on a wide page
    parts: tuple[Section, ...] = ()  # subsections
    note: str = ""  # explanation
    # outputs with this section. "all": text, page and JSON; "page": page and JSON; "json": JSON only
    show: Show = "all"
    keyed: bool = False  # in JSON the rows are a mapping by row name, not a list
    folded: bool = False  # on the page only the title is visible until the reader opens the section
    matrix: Matrix | None = None  # table of coloured cells, above the tables of the page


@dataclass(frozen=True, slots=True)
class Page:
    """Complete report, independent of the output format."""

    title: str  # action and subject
    summary: tuple[str, ...]  # the result in a few sentences
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...] = ()  # most important first
    method: tuple[str, ...] = ()  # how the quantities were computed, and their sources
    at: At = moment  # function that writes times of the record in the texts of findings
    starts_at: float = 0.0  # origin of the times that `at` writes, in the time of the data [s]
    verdict: Verdict | None = None  # main result with its rating, at the top of the page
    merits: tuple[Quantity, ...] = ()  # figures of merit, about six; also in the sections
    merits_note: str = ""  # explanation of the figures of merit
    # figures of merit by position of the page's switch, such as "filtered" and "smoothed"
    merits_by: Mapping[str, tuple[Quantity, ...]] | None = None
    names: frozenset[str] = frozenset()  # names that the user chose: not translated within a text; see `Name`

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning sentences; the first sentence with a time also explains the time origin, unless it is zero."""
        texts, must_explain = [], abs(self.starts_at) > 1.0
        for finding in (each for each in self.findings if each.severity >= Severity.WARNING):
            explains = must_explain and shows_time(finding)
            texts.append(sentence(finding, at=self.at) + form("hint") * explains)
            must_explain = must_explain and not explains
        return tuple(texts)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Sentences on assumptions: defaults, limits of validity, sources, and the method."""
        return (*self._texts(Severity.ASSUMPTION), *self.method)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on findings that need no action: insnav has corrected them or taken them into account."""
        return self._texts(Severity.NOTE)

    def _texts(self, severity: Severity) -> tuple[str, ...]:
        count, texts = Counter[str](), list[str]()
        for finding in (each for each in self.findings if each.severity is severity):
            count[title := render(finding).title] += 1
            if count[title] <= REPEATED:
                texts.append(sentence(finding, at=self.at))
        further = ((title, total - REPEATED) for title, total in count.items() if total > REPEATED)
        return (*texts, *(phrase("page.more_warnings", title=title, count=more) for title, more in further))

    @property
    def lists(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Heading and lines of each nonempty list below the tables: notes, assumptions."""
        lists = (("notes", self.notes), ("assumptions", self.assumptions))
        return tuple((phrase(f"page.{name}"), lines) for name, lines in lists if lines)

    @property
    def figures(self) -> tuple[FigureSpec, ...]:
        """All figures, in page order."""
        return tuple(figure for section in self.sections for part in _with_parts(section) for figure in part.figures)

    @property
    def embedded(self) -> tuple[FigureSpec, ...]:
        """Figures that the page shows as images: the figures of sections without panels."""
        parts = (part for section in self.sections for part in _with_parts(section) if not part.panels)
        return tuple(figure for part in parts for figure in part.figures)

    @property
    def panels(self) -> tuple[Drawing, ...]:
        """All interactive drawings, in page order."""
        return tuple(panel for section in self.sections for part in _with_parts(section) for panel in part.panels)


@dataclass(frozen=True, slots=True)
class Table:
    """Table of formatted text, ready to print."""

    title: str  # subject of the rows
    columns: tuple[str, ...]  # headings, units in brackets
    rows: tuple[tuple[str, ...], ...]  # cells, one per column; the first cell is the name of the row
    note: str = ""  # explanation


def one_each(key: str, title: str, items: Mapping[str, Sequence[Quantity]], first: str = "", note: str = "") -> Section:
    """Lay out the same quantities of several objects: in text a table row per object, in JSON a mapping by name.

    `items`: quantities by object name; an object without any has no row, and is null in JSON. `first`: names' heading.
    """
    absent = tuple(only_json("", Quantity(name, None)) for name, own in items.items() if not own)
    rows = tuple((Quantity("name", name, meaning=first), *own) for name, own in items.items() if own)
    return Section(key, title, rows=rows, parts=absent, note=note, keyed=True)


def drawn(name: str, caption: str, drawings: Iterable[Drawing], note: str = "", *, columns: int = 1) -> Section:
    """Build a section of drawings: interactive panels on the page, and one matplotlib figure with all of them.

    `columns`: number of panels side by side.
    """
    panels = tuple(drawings)

    def draw() -> Figure:
        from insnav.report.figures import draw_drawings  # imports matplotlib, only for a requested figure

        return draw_drawings(panels, caption, note, columns=columns)

    figures = (FigureSpec(name, caption, draw),) if panels else ()
    return Section("", panels=panels, figures=figures, columns=columns)


def beside(*sections: Section) -> Section:
    """Join sections of drawings into one, with a map first; a wide page keeps the map in view next to the others."""
    panels, figures = (tuple(part for each in sections for part in getattr(each, k)) for k in ("panels", "figures"))
    return Section("", panels=panels, figures=figures)


def only_json(key: str, *items: Quantity, parts: tuple[Section, ...] = ()) -> Section:
    """Build a section of quantities that is written to ``run.json`` only."""
    return Section(key, items=items, parts=parts, show="json")


def _with_parts(section: Section) -> tuple[Section, ...]:
    return (section, *(each for part in section.parts for each in _with_parts(part)))


def section_tables(section: Section, shown: Sequence[Show] = ("all",)) -> list[Table]:
    """Lay out a section as tables: its single quantities, its rows, then its subsections.

    `shown`: include only sections with these values of `Section.show`.
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
    """Lay out the rows of a section as a table.

    If a column has one unit, its heading shows it, unless the title does. Otherwise every cell shows its unit.
    """
    rows = [{each.key: each for quantity in row for each in members(quantity)} for row in section.rows]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    headings, unified = [], {}
    for key in columns:
        units = {row[key].shown_unit for row in rows if key in row}
        first = next(row[key] for row in rows if key in row)
        unified[key] = len(units) == 1
        bracket = _bracket(first).strip()
        headings.append(f"{first.label} {bracket}" if unified[key] and bracket not in section.title else first.label)
    cells = tuple(tuple(_cell_in_row(row.get(key), with_unit=not unified[key]) for key in columns) for row in rows)
    return Table(section.title, tuple(headings), cells, section.note)


def members(each: Quantity) -> list[Quantity]:
    """Split a quantity whose value is a mapping, such as RMS and maximum, into one quantity per table column."""
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
    """Write a quantity without name and unit: ``12.3 ± 0.4``, ``12.3 (11.8 … 12.9)``, ``–`` if unknown."""
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
    else:  # numbers of an array; `sd` is an array too, or one value for all
        sds = np.broadcast_to(np.nan if sd is None else np.asarray(sd, dtype=np.float64), np.shape(value)).ravel()
        parts = zip(np.ravel(np.asarray(value, dtype=np.float64)), sds, strict=True)
        text = ", ".join(_with_sd(float(v), float(s), each) for v, s in parts)
    if each.interval is None or not np.isfinite(each.interval).all():
        return text
    # the ends of the interval are rounded like the value
    has_sd = isinstance(sd, float) and np.isfinite(sd) and sd > 0.0
    low, high = (
        rounded(bound, sd) if has_sd else number(bound, each.digits) if bound else "0"
        for bound in (float(each.scaled(float(end))) for end in each.interval)
    )
    return f"{text} ({low} … {high})"


def _with_sd(value: float | None, sd: Any, each: Quantity) -> str:
    if value is None or not np.isfinite(value):
        return number(None)
    if each.decimals is not None:
        text = f"{round(float(value), each.decimals) + 0.0:.{each.decimals}f}"  # adding 0.0 turns -0.0 into 0.0
    elif sd is not None and np.isfinite(sd) and sd > 0.0:
        text = rounded(float(value), float(sd))
    else:
        return number(float(value), each.digits) if value else "0"
    return text if sd is None or not np.isfinite(sd) or not sd > 0.0 else f"{text} ± {number(float(sd), 2)}"


def rows_frame(rows: Iterable[Iterable[Quantity]]) -> DataFrame:
    """Build a data frame from rows of quantities, with the units in the column names.

    `rows`: a quantity with several values fills several columns, such as ``horizontal_rms_m``.
    """
    import pandas as pd

    flat = ([each for quantity in row for each in members(quantity)] for row in rows)
    return pd.DataFrame([{key: value for each in row for key, value in each.facts().items()} for row in flat])
