"""Plots and pages of the accuracy over versions: PNG, one HTML page, and the section for the README."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from insnav.exceptions import writing
from insnav.findings import Code, Finding
from insnav.messages import sentence
from insnav.output.folder import write_text
from insnav.quantity import Quantity
from insnav.regression.accuracy_metrics import BY_KEY, FAILS_FROM
from insnav.regression.baseline import Baseline
from insnav.regression.history import Entry
from insnav.regression.peers.run_peers import PeerRow
from insnav.regression.provenance import Origin
from insnav.regression.published.replicas import Compared, FieldFactor
from insnav.regression.run_corpus import CaseResult, Result
from insnav.regression.verdict import Change, Comparison
from insnav.report.html import filled, page_html
from insnav.report.numbers import number
from insnav.report.page import Page, Section, Verdict, drawn, only_json, section_tables
from insnav.report.regression import tables
from insnav.report.regression.matrix import change_matrix, figures_tested, peer_matrix, unclear_changes
from insnav.report.regression.panels import COLUMNS, growth_panels, history_panels, predicted_panels
from insnav.report.style import drawing, save

PAGE, SECTION = "accuracy.html", "accuracy.md"
OVER_VERSIONS = ("cep50_m", "down_rms_m", "roll_pitch_rms_deg", "heading_rms_deg", "outage_60s_m", "nees_position")
_WARNED = 3  # failing figures that are said before the matrix
_MADE = "Version "  # how the line begins that says with what figures were made
_IN_SECTION = ("accuracy_cep50_m", "accuracy_growth")


FILE = "published.md"


def write_pages(
    folder: Path,
    result: Result,
    history: Sequence[Entry],
    baseline: Baseline | None,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow] = (),
) -> list[Path]:
    """Draw everything into a folder.

    `folder`: made if need be; files of the same names are replaced.
    Raises: OutputError: they cannot be written.
    """
    page = regression_page(result, baseline, comparison, now, peers, history)
    figures = tuple(each for section in _drawings(result, history, baseline) for each in section.figures)
    with writing("output.file_unwritable", folder), drawing():
        folder.mkdir(parents=True, exist_ok=True)
        files = {each.name: save(each.draw(), folder / each.name, "png") for each in figures}
    shown = replace(page, sections=(*page.sections, Section("", "Figures", figures=figures, folded=True)))
    write_text(folder / PAGE, page_html(shown, files))
    chosen = [(each.caption, files[each.name].name) for each in figures if each.name in _IN_SECTION]
    section = folder / SECTION
    kept = peers_of(section.read_text(encoding="utf-8")) if section.is_file() else ()
    write_text(section, markdown(result, comparison, now, peers, chosen, kept))
    return [*files.values(), folder / PAGE, folder / SECTION]


def _drawings(result: Result, history: Sequence[Entry], baseline: Baseline | None) -> tuple[Section, ...]:
    """Sections of figures: over the versions, error growth, predicted against actual error; empty ones without data."""
    note = (
        f"with 95 % intervals; grey: the baseline and {100 * FAILS_FROM:g} % about it; crosses: from here on better "
        "(green) or worse (red) than the baseline of its time; breaks: the case had changed"
    )
    over_versions = []
    for key in OVER_VERSIONS if history else ():
        unit = f" [{BY_KEY[key].unit}]" if BY_KEY[key].unit else ""
        title = f"{BY_KEY[key].label}{unit}: {len(history)} versions, {history[-1].origin.version} the last"
        panels = history_panels(history, baseline, BY_KEY[key])
        over_versions.append(drawn(f"accuracy_{key}", title, panels, note, columns=COLUMNS))
    growth = growth_panels(result.cases, baseline)
    rms = "RMS over all windows of all drives of a case; other aiding (NHC, ZUPT) is used where found"
    points = "points: RMS over the drives of a case in an eighth of their time; above the grey line: over-confident"
    return (
        *over_versions,
        drawn("accuracy_growth", "Horizontal error without GPS, now and in the baseline", growth, rms, columns=COLUMNS),
        drawn(
            "accuracy_predicted",
            "Actual error against predicted standard deviation",
            predicted_panels(result.cases),
            points,
            columns=3,
        ),
    )


def regression_page(
    result: Result,
    baseline: Baseline | None,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow] = (),
    history: Sequence[Entry] = (),
) -> Page:
    """Report the accuracy of this version, and what changed since the baseline."""
    first = []
    changes: Sequence[Change] = ()
    changed: tuple[Section, ...] = ()
    if comparison is not None and baseline is not None:
        changes = comparison.changes
        matrix = change_matrix(result, comparison, baseline, history)
        first.append(Section("", "Change since the baseline, %", matrix=matrix, show="page"))
        rows = tables.change_rows([change for change in changes if change.verdict != "same"])
        changed = (Section("", "Figures that changed", rows=rows),)
    others = peer_matrix(peers)
    if others is not None:
        title = "Errors of other programs over those of insnav, one drive each, smoothers over its smoother"
        first.append(Section("", title, matrix=others, show="page"))
    return Page(
        "insnav: accuracy over versions",
        (_where(now),),
        (
            *first,
            tables.case_section(result, comparison),
            *changed,
            *([replace(tables.peer_section(peers), folded=True)] if peers else []),
            only_json(
                "",
                Quantity("quick", result.quick),
                Quantity("passed", None if comparison is None else comparison.passed),
                Quantity("skipped", _sentences(result.skipped)),
                Quantity("apart", {} if comparison is None else _sentences(comparison.apart)),
                Quantity("broken", {} if comparison is None else _sentences(comparison.broken)),
            ),
            Section(
                "cases", rows=tuple(_case(name, case) for name, case in result.cases.items()), show="json", keyed=True
            ),
            Section("changes", rows=tables.change_rows(changes), show="json"),
        ),
        (*_warnings(result, comparison), *tables.RULES),
        verdict=_verdict(comparison, baseline),
        merits=_merits(result, comparison),
    )


def _warnings(result: Result, comparison: Comparison | None) -> Iterator[Finding]:
    """Give what fails, first the changes, and what was not compared."""
    if comparison is not None:
        yield from map(_failing, comparison.failing[:_WARNED])
        more = len(comparison.failing) - _WARNED
        if more > 0:
            yield Finding.of(Code.REGRESSION_MORE_FAIL, count=more)
        yield from (*comparison.broken.values(), *comparison.apart.values())
    yield from result.skipped.values()


def _failing(change: Change) -> Finding:
    relative = change.shift.change
    times = {"times": relative + 1.0} if change.metric.kind == "cpu" else {"change": relative, "p": change.adjusted}
    figures: dict[str, Any] = {**times, "old": change.old, "new": change.new, "metric": change.metric.label}
    return Finding.of(Code.REGRESSION_FAILS, subject=change.case, **figures, metric_unit=change.metric.unit)


def _sentences(findings: Mapping[str, Finding]) -> dict[str, str]:
    return {name: sentence(each) for name, each in findings.items()}


def _verdict(comparison: Comparison | None, baseline: Baseline | None) -> Verdict:
    """Whether this version is as good as the baseline, as far as the corpus can tell."""
    if comparison is None or baseline is None:
        return Verdict("unknown", "there is no baseline", "Nothing to compare with: --update-baseline makes one.")
    text = tables.verdict_text(comparison, baseline.origin)
    outcome = (
        f"{text[0].upper()}{text[1:]}; of {unclear_changes(comparison)} it cannot be told whether they changed by 5 %."
    )
    if not comparison.passed:
        return Verdict("bad", f"{len(comparison.failing) + len(comparison.broken)} figures or cases fail", outcome)
    if comparison.apart:
        return Verdict("attention", f"{len(comparison.apart)} cases could not be compared", outcome)
    return Verdict("good", "no figure is worse by 5 % or more beyond chance", outcome)


def _merits(result: Result, comparison: Comparison | None) -> tuple[Quantity, ...]:
    """How many cases, figures, changes."""
    if comparison is None:
        return (Quantity("cases", len(result.cases)),)
    verdicts = [change.verdict for change in comparison.changes]
    return (
        Quantity("cases", len(result.cases)),
        Quantity("figures", figures_tested(comparison), meaning="figures compared"),
        *(Quantity(name, verdicts.count(name)) for name in ("better", "worse")),
        Quantity("failing", len(comparison.failing) + len(comparison.broken), meaning="fail"),
        Quantity("unclear", unclear_changes(comparison), meaning="cannot be told"),
    )


def _case(name: str, case: CaseResult) -> tuple[Quantity, ...]:
    return (
        Quantity("case", name),
        Quantity("digest", case.digest),
        Quantity("failures", {str(number): why for number, why in case.failures.items()}),
        Quantity("values", {key: BY_KEY[key].typical(value) for key, value in case.measured.values.items()}),
    )


def markdown(
    result: Result,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow],
    pictures: Sequence[tuple[str, str]],
    kept: Sequence[str] = (),
) -> str:
    """Write the section for the README: plots and tables in Markdown; `kept`: other programs if none were run now."""
    made = _where(now)
    lines = ["# Accuracy on the corpus", "", made, ""]
    for caption, name in pictures:
        lines += [f"![{caption}]({name})", ""]
    lines += _table(tables.case_section(result, comparison))
    lines += _table(tables.peer_section(peers), made) if peers else kept
    return "\n".join([*lines, *(f"- {sentence(rule)}" for rule in tables.RULES), ""])


def _table(section: Section, made: str = "") -> list[str]:
    (table,) = section_tables(section)
    rule = ("---", *("---:" for _ in table.columns[1:]))
    rows = (f"| {' | '.join(cells)} |" for cells in (table.columns, rule, *table.rows))
    return [f"## {table.title}", "", *([made, ""] if made else []), *rows, "", table.note, ""]


def peers_of(text: str) -> list[str]:
    """Lines about other programs as they stand in such a section, with the version they are of."""
    lines = text.splitlines()
    head = f"## {tables.PEERS}"
    if head not in lines:
        return []
    below = lines[lines.index(head) + 1 :]
    end = next((i for i, line in enumerate(below) if line.startswith(("## ", "- "))), len(below))
    own = any(line.startswith(_MADE) for line in below[:end])
    made = next((line for line in lines if line.startswith(_MADE)), "")
    return [head, *([] if own else ["", made]), *below[:end]]


def _where(now: Origin) -> str:
    commit = f", commit {now.commit}" if now.commit else ""
    return f"{_MADE}{now.version}{commit}, {now.date}, {now.computer}; made by `insnav regress --plot`."


def write_published(folder: Path, compared: Sequence[Compared], field: FieldFactor, now: Origin) -> Path:
    """Write the table into a folder."""
    missing = sorted({f"{each.case.imu}: {', '.join(each.missing)}" for each in compared if each.missing})
    places = sorted({f"{each.case.source.split(',')[0]}: {each.case.where}" for each in compared})
    lists = {"compared": compared, "missing": missing, "places": places}
    path = folder / FILE
    text = filled("published.md.j2", field=field, now=now, number=number, **lists)
    write_text(path, text)
    return path
