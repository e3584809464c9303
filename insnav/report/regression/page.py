"""Report of the accuracy of this version of insnav against a baseline: page, terminal text, Markdown section."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import writing
from insnav.findings import Code, Finding
from insnav.messages import sentence, speaking, translated
from insnav.output.folder import write_text
from insnav.quantity import Quantity
from insnav.regression.baseline import Baseline, Origin
from insnav.regression.evaluate import BY_KEY, FAILS_FROM, LIKELY, CaseResult
from insnav.regression.regress import Regression
from insnav.regression.verdict import ALPHA, CPU_FAILS_FROM, POWER, Change, Comparison, detectable_apart, interval
from insnav.report.figures import drawing, save
from insnav.report.html import page_html
from insnav.report.page import DataFrame, Page, Section, Verdict, drawn, only_json, rows_frame, section_tables
from insnav.report.regression import panels
from insnav.report.tables import of_section, of_table
from insnav.report.terminal import entry, hanging, table_text
from insnav.result import Result
from insnav.sample_statistics import rms

PAGE, SECTION = "accuracy.html", "accuracy.md"
OVER_VERSIONS = ("cep50_m", "down_rms_m", "roll_pitch_rms_deg", "heading_rms_deg", "outage_60s_m", "nees_position")
_WARNED = 3  # largest number of failing figures with a warning of their own
_IN_SECTION = ("accuracy_cep50_m", "accuracy_growth")
PEERS = "The same drives by other programs"
UNDETECTABLE = 10.0  # a test that detects only larger changes than this is useless [%]
OVERCONFIDENT = 1.25  # a case is over-confident if the 95 % interval of its NEES / 3 lies above this value
_POWER = {
    "north_rms_m": "N",
    "velocity_rms_m_s": "velocity",
    "heading_rms_deg": "heading",
    "outage_60s_m": "60 s without GPS",
    "nees_velocity": "NEES, velocity",
    "innovation_position_m": "innovations",
}
HEADLINES = {
    "north_rms_m": "N [m]",
    "east_rms_m": "E [m]",
    "down_rms_m": "D [m]",
    "roll_pitch_rms_deg": "tilt [deg]",
    "heading_rms_deg": "heading [deg]",
    "outage_60s_m": "60 s without GPS [m]",
}

# findings that explain how the figures of two versions are compared
RULES = (
    Finding.of(Code.REGRESSION_PAIRED),
    Finding.of(Code.REGRESSION_HOLM, level=ALPHA),
    Finding.of(Code.REGRESSION_LIMITS, limit=FAILS_FROM, limit_likelihood=LIKELY),
    Finding.of(Code.REGRESSION_CPU, limit=CPU_FAILS_FROM),
    Finding.of(Code.REGRESSION_NEES),
)


def page(result: Result[Regression]) -> Page:
    """Lay out the accuracy of this version on all cases, and its changes since the baseline."""
    found = result.found
    accuracy, baseline, comparison = found.accuracy, found.baseline, found.comparison
    first = []
    changes: Sequence[Change] = ()
    changed: tuple[Section, ...] = ()
    if comparison is not None and baseline is not None:
        changes = comparison.changes
        matrix = panels.change_matrix(accuracy, comparison, baseline, found.history)
        first.append(Section("", "Change since the baseline, %", matrix=matrix, show="page"))
        changed = (Section("", "Figures that changed", rows=change_rows([x for x in changes if x.verdict != "same"])),)
    origins = {"origin": found.origin, "baseline": None if baseline is None else baseline.origin}
    figures = tuple(each for section in _drawings(found) for each in section.figures)
    return Page(
        "insnav: accuracy over versions",
        (made_line(found.origin),),
        (
            *first,
            case_section(found),
            *changed,
            only_json(
                "",
                *(Quantity(name, None if each is None else asdict(each)) for name, each in origins.items()),
                Quantity("quick", accuracy.quick),
                Quantity("passed", None if comparison is None else comparison.passed),
                Quantity("skipped", _sentences(accuracy.skipped)),
                Quantity("apart", {} if comparison is None else _sentences(comparison.apart)),
                Quantity("broken", {} if comparison is None else _sentences(comparison.broken)),
            ),
            Section("cases", rows=tuple(starmap(_case, accuracy.cases.items())), show="json", keyed=True),
            Section("changes", rows=change_rows(changes), show="json"),
            Section("", "Plots", figures=figures),
        ),
        (*_warnings(found), *RULES),
        verdict=_verdict(found),
        merits=_merits(found),
    )


def frame(result: Result[Regression]) -> DataFrame:
    """Build a table of headline figures of every case, with counts of better, equal, worse figures."""
    return rows_frame(case_section(result.found).rows)


def text(result: Result[Regression], width: int | None = None) -> str:
    """Write the report for the terminal: accuracy of all cases, changes since the baseline, and the verdict."""
    found = result.found
    comparison, baseline = found.comparison, found.baseline
    lines = [*_text(case_section(found)), ""]
    if comparison is None or baseline is None:
        return "\n".join([*lines, translated("there is no baseline to compare with: --update-baseline makes one")])
    for name in ("better", "worse"):
        changes = [change for change in comparison.changes if change.verdict == name and not change.fails]
        lines += [entry(name, change_text(change)) for change in changes]
    lines += _notes(baseline)
    lines += [entry("apart", sentence(each)) for each in comparison.apart.values()]
    lines += [entry("BROKEN", sentence(each)) for each in comparison.broken.values()]
    lines += [entry("FAILS", change_text(change)) for change in comparison.failing]
    return "\n".join([*lines, *hanging([translated(verdict_text(comparison, baseline.origin))], width)])


def _text(section: Section) -> list[str]:
    return [line for table in section_tables(section) for line in table_text(table).splitlines()]


def _drawings(found: Regression) -> tuple[Section, ...]:
    """Build the figures: accuracy over versions, error growth, actual over predicted error; without data, none."""
    history, baseline, cases = found.history, found.baseline, found.accuracy.cases
    note = (
        f"with 95 % intervals. Grey: the baseline and {100 * FAILS_FROM:g} % about it. Crosses: from here on better "
        "(green) or worse (red) than the baseline of that time. Breaks: the case had changed"
    )
    over_versions = []
    for key in OVER_VERSIONS if history else ():
        unit = f" [{BY_KEY[key].unit}]" if BY_KEY[key].unit else ""
        title = f"{BY_KEY[key].label}{unit}: {len(history)} versions, {history[-1].origin.version} the last"
        lines = panels.history_panels(history, baseline, BY_KEY[key])
        over_versions.append(drawn(f"accuracy_{key}", title, lines, note, columns=panels.COLUMNS))
    growth, title = panels.growth_panels(cases, baseline), "Horizontal error without GPS, now and in the baseline"
    note = "RMS over all windows of all drives of a case; other aiding (NHC, ZUPT) is used if available"
    predicted = "Actual error against predicted standard deviation"
    points = "points: RMS over the drives of a case in an eighth of their time; above the grey line: over-confident"
    return (
        *over_versions,
        drawn("accuracy_growth", title, growth, note, columns=panels.COLUMNS),
        drawn("accuracy_predicted", predicted, panels.predicted_panels(cases), points, columns=3),
    )


def _warnings(found: Regression) -> Iterator[Finding]:
    """Yield warnings: failing figures, broken cases, cases that could not be compared, skipped cases."""
    comparison = found.comparison
    if comparison is not None:
        yield from map(_failing, comparison.failing[:_WARNED])
        more = len(comparison.failing) - _WARNED
        if more > 0:
            yield Finding.of(Code.REGRESSION_MORE_FAIL, count=more)
        yield from (*comparison.broken.values(), *comparison.apart.values())
    yield from found.accuracy.skipped.values()


def _failing(change: Change) -> Finding:
    relative = change.shift.change
    times = {"times": relative + 1.0} if change.metric.kind == "cpu" else {"change": relative, "p": change.adjusted}
    figures: dict[str, Any] = {**times, "old": change.old, "new": change.new, "metric": change.metric.label}
    return Finding.of(Code.REGRESSION_FAILS, subject=change.case, **figures, metric_unit=change.metric.unit)


def _sentences(findings: Mapping[str, Finding]) -> dict[str, str]:
    return {name: sentence(each) for name, each in findings.items()}


def _verdict(found: Regression) -> Verdict:
    """Rate this version: whether a figure is worse than in the baseline, as far as the drives can show it."""
    comparison, baseline = found.comparison, found.baseline
    if comparison is None or baseline is None:
        return Verdict("unknown", "there is no baseline", "Nothing to compare with: --update-baseline makes one.")
    text = verdict_text(comparison, baseline.origin)
    unclear = panels.unclear_changes(comparison)
    outcome = f"{text[0].upper()}{text[1:]}; for {unclear} a change of 5 % is neither shown nor excluded."
    if not comparison.passed:
        return Verdict("bad", f"{len(comparison.failing) + len(comparison.broken)} figures or cases fail", outcome)
    if comparison.apart:
        return Verdict("attention", f"{len(comparison.apart)} cases could not be compared", outcome)
    return Verdict("good", "no figure is worse by 5 % or more beyond chance", outcome)


def verdict_text(comparison: Comparison, then: Origin) -> str:
    """Summarise the comparison with the baseline `then` in a sentence: numbers of better and worse figures."""
    better, worse = (sum(change.verdict == name for change in comparison.changes) for name in ("better", "worse"))
    version = f"version {then.version} ({then.commit or 'no commit'}, {then.date})"
    outcome = "passed" if comparison.passed else f"FAILED: {len(comparison.failing) + len(comparison.broken)}"
    return f"{outcome}: {better} better, {worse} worse of {panels.figures_tested(comparison)} figures against {version}"


def _merits(found: Regression) -> tuple[Quantity, ...]:
    """Return the numbers of cases, figures and changes."""
    cases, comparison = Quantity("cases", len(found.accuracy.cases)), found.comparison
    if comparison is None:
        return (cases,)
    verdicts = [change.verdict for change in comparison.changes]
    return (
        cases,
        Quantity("figures", panels.figures_tested(comparison), meaning="figures compared"),
        *(Quantity(name, verdicts.count(name)) for name in ("better", "worse")),
        Quantity("failing", len(comparison.failing) + len(comparison.broken), meaning="fail"),
        Quantity("unclear", panels.unclear_changes(comparison), meaning="undecided"),
    )


def _case(name: str, case: CaseResult) -> tuple[Quantity, ...]:
    failures = {str(number): each.code if each else None for number, each in case.failures.items()}
    values = {key: BY_KEY[key].typical(value) for key, value in case.measured.values.items()}
    return of_table("regression.case", case, case=name, failures=failures, values=values)


def case_section(found: Regression) -> Section:
    """Tabulate the cases: headline figures, and counts of better, equal, worse figures."""
    rows, changes = [], found.comparison.changes if found.comparison else ()
    for name, case in found.accuracy.cases.items():
        values = case.measured.values
        cells = (
            Quantity(key, rms(values[key]) if key in values else None, meaning=label)
            for key, label in HEADLINES.items()
        )
        verdicts = [change.verdict for change in changes if change.case == name]
        counts = (Quantity(each, verdicts.count(each) if verdicts else None) for each in ("better", "same", "worse"))
        rows.append((Quantity("case", name), *cells, *counts))
    return of_section("regression.accuracy", rows)


def change_text(change: Change) -> str:
    """Write the change of one figure in a line, with its relative size and its p value."""
    if change.metric.kind == "cpu":
        return panels.change_head(change, translated(f"{change.shift.change + 1.0:.1f} times"))
    return panels.change_head(change, f"{100.0 * change.shift.change:+.1f} %, p {change.adjusted:.1g}")


def change_rows(changes: Sequence[Change]) -> tuple[tuple[Quantity, ...], ...]:
    """Build a table row for each changed figure."""
    return tuple(of_table("regression.change", change) for change in changes)


def power_section(baseline: Baseline) -> Section:
    """Tabulate the change of each figure that is detected with probability `POWER`, from the scatter of the drives."""
    tests = sum(key != "cpu_ratio" for case in baseline.cases.values() for key in case.measured.values)
    rows = []
    for name, case in baseline.cases.items():
        for key, values in case.measured.values.items():
            if key == "cpu_ratio" or key not in BY_KEY:
                continue
            finite = values[np.isfinite(values)]
            least = detectable_apart(finite, BY_KEY[key], pieces=case.pieces, tests=tests)
            row = Quantity("case", name), Quantity("metric", key, meaning=BY_KEY[key].label)
            drives = Quantity("drives", finite.size, meaning="pieces" if case.pieces else "drives")
            rows.append((*row, drives, Quantity("detectable", least if least <= UNDETECTABLE else None, "%")))
    return of_section("regression.power", rows, {"power": 100 * POWER, "level": ALPHA})


def power_lines(baseline: Baseline) -> list[str]:
    """Write a short table of the detectable changes of every case, then notes on over-confident baseline cases."""
    section = power_section(baseline)
    detectable: dict[str, dict[str, Any]] = {}
    for case, metric, _, change in section.rows:
        detectable.setdefault(str(case.value), {})[str(metric.value)] = change.value
    rows = tuple(
        (Quantity("case", name), *(Quantity(key, values.get(key), "%", meaning=label) for key, label in _POWER.items()))
        for name, values in detectable.items()
    )
    return [*_text(replace(section, rows=rows)), "", *_notes(baseline)]


def overconfident(baseline: Baseline) -> Iterator[Finding]:
    """Yield a finding for each baseline case whose errors exceed the stated sd: it is no standard for comparison."""
    for name, case in baseline.cases.items():
        for key in ("nees_position", "nees_velocity", "nees_attitude"):
            if key not in case.measured.values:
                continue
            middle, low, _ = interval(case.measured.values[key], BY_KEY[key], pieces=case.pieces)
            if low > OVERCONFIDENT:
                code, label = Code.REGRESSION_OVERCONFIDENT, BY_KEY[key].label
                yield Finding.of(code, subject=name, nees=middle, low=low, limit=OVERCONFIDENT, metric=label)


def _notes(baseline: Baseline) -> list[str]:
    return [entry("note", sentence(each)) for each in overconfident(baseline)]


def write_pages(folder: Path, result: Result[Regression]) -> list[Path]:
    """Write figures, HTML page and Markdown section into a folder; files of equal names are replaced."""
    shown = page(result)
    with writing("output.file_unwritable", folder), drawing():
        folder.mkdir(parents=True, exist_ok=True)
        files = {each.name: save(each.draw(), folder / each.name, "png") for each in shown.figures}
    write_text(folder / PAGE, page_html(shown, files))
    chosen = [(each.caption, files[each.name].name) for each in shown.figures if each.name in _IN_SECTION]
    section = folder / SECTION
    kept = peers_of(section.read_text(encoding="utf-8")) if section.is_file() else ()
    with speaking("en"):
        write_text(section, markdown(result.found, chosen, kept))
    return [*files.values(), folder / PAGE, folder / SECTION]


def markdown(found: Regression, pictures: Sequence[tuple[str, str]], kept: Sequence[str] = ()) -> str:
    """Write the Markdown section: plots, table, rules. `kept`: lines on other programs from an earlier section."""
    lines = ["# Accuracy on the corpus", "", made_line(found.origin), ""]
    for caption, name in pictures:
        lines += [f"![{caption}]({name})", ""]
    lines += markdown_table(case_section(found))
    return "\n".join([*lines, *kept, *(f"- {sentence(rule)}" for rule in RULES), ""])


def markdown_table(section: Section) -> list[str]:
    """Write the one table of a section in Markdown, with title and note."""
    (table,) = section_tables(section)
    rule = ("---", *("---:" for _ in table.columns[1:]))
    rows = (f"| {' | '.join(cells)} |" for cells in (table.columns, rule, *table.rows))
    return [f"## {table.title}", "", *rows, "", table.note, ""]


def peers_of(text: str) -> list[str]:
    """Return the lines about other programs from the text of a Markdown section."""
    match = re.search(rf"^## {PEERS}\n.*?(?=^## |^- |\Z)", text, re.DOTALL | re.MULTILINE)
    return match[0].splitlines() if match else []


def made_line(now: Origin, command: str = "insnav regress --plot") -> str:
    """Write which version of insnav made the figures, when, on which computer, and by which command."""
    commit = f", commit {now.commit}" if now.commit else ""
    return f"Version {now.version}{commit}, {now.date}, {now.computer}; made by `{command}`."
