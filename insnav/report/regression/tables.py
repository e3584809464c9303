"""A comparison with the baseline in tables and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.findings import Code, Finding
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.regression.accuracy_metrics import BY_KEY, FAILS_FROM, LIKELY
from insnav.regression.baseline import Baseline
from insnav.regression.paired_tests import ALPHA, POWER, detectable_apart, interval
from insnav.regression.peers.run_peers import LATEST, LONGEST, PeerRow
from insnav.regression.provenance import Origin
from insnav.regression.run_corpus import Result
from insnav.regression.verdict import CPU_FAILS_FROM, Change, Comparison
from insnav.report.numbers import number
from insnav.report.page import Section, section_tables
from insnav.report.terminal import table_text
from insnav.sample_statistics import rms

_PEER_NOTE = (
    f"RMS over the first {LONGEST:g} s of the first drive of each case (more where the heading needs it), from "
    f"{LATEST:g} s on at the latest; same samples, fixes, start and sensor figures; gtsam at the fixes alone"
)
PEERS = "The same drives by other programs"
UNDETECTABLE = 10.0  # a change beyond this is no statement
OVERCONFIDENT = 1.25  # NEES / 3 whose 95 % interval begins above this
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

# by which figures are compared
RULES = (
    Finding.of(Code.REGRESSION_PAIRED),
    Finding.of(Code.REGRESSION_HOLM, level=ALPHA),
    Finding.of(Code.REGRESSION_LIMITS, limit=FAILS_FROM, limit_likelihood=LIKELY),
    Finding.of(Code.REGRESSION_CPU, limit=CPU_FAILS_FROM),
    Finding.of(Code.REGRESSION_NEES),
)


def change_head(change: Change) -> str:
    """Say of one change case, metric, old and new value."""
    unit = f" {change.metric.unit}" if change.metric.unit else ""
    return f"{change.case}: {change.metric.label}: {number(change.old)} -> {number(change.new)}{unit}"


def change_text(change: Change) -> str:
    """Say one change in a line, with its size and significance."""
    if change.metric.kind == "cpu":
        return f"{change_head(change)} ({change.shift.change + 1.0:.1f} times)"
    return f"{change_head(change)} ({100.0 * change.shift.change:+.1f} %, p {change.adjusted:.1g})"


def case_section(result: Result, comparison: Comparison | None) -> Section:
    """One row a case: headline figures, and how many figures are better, the same, worse."""
    rows = []
    for name, case in result.cases.items():
        values = case.measured.values
        cells = (
            Quantity(key, rms(values[key]) if key in values else None, meaning=label)
            for key, label in HEADLINES.items()
        )
        verdicts = [change.verdict for change in (comparison.changes if comparison else ()) if change.case == name]
        counts = (Quantity(each, verdicts.count(each) if verdicts else None) for each in ("better", "same", "worse"))
        rows.append((Quantity("case", name), *cells, *counts))
    note = (
        "RMS over all drives (seeds) of a case, all pieces or outages of a recorded drive, as in the plots; whether a "
        "figure has changed is tested by logarithms, so that one bad drive does not decide it"
    )
    return Section("", "Accuracy, and figures that changed", rows=tuple(rows), note=note)


def change_rows(changes: Sequence[Change]) -> tuple[tuple[Quantity, ...], ...]:
    """One row a change."""
    return tuple(
        (
            Quantity("case", change.case),
            Quantity("metric", change.metric.key),
            Quantity("old", change.old),
            Quantity("new", change.new),
            Quantity("change", change.shift.change),
            Quantity("p", change.adjusted, meaning="p, corrected", digits=1),
            Quantity("verdict", change.verdict),
            Quantity("fails", change.fails),
        )
        for change in changes
    )


def power_section(baseline: Baseline) -> Section:
    """Smallest change of each figure that is found in `POWER` of all cases, by the scatter of the drives."""
    tests = sum(key != "cpu_ratio" for case in baseline.cases.values() for key in case.measured.values)
    rows = []
    for name, case in baseline.cases.items():
        for key, values in case.measured.values.items():
            if key == "cpu_ratio" or key not in BY_KEY:
                continue
            known = values[np.isfinite(values)]
            least = detectable_apart(known, BY_KEY[key], pieces=case.pieces, tests=tests)
            row = Quantity("case", name), Quantity("metric", key, meaning=BY_KEY[key].label)
            drives = Quantity("drives", known.size, meaning="pieces" if case.pieces else "drives")
            rows.append((*row, drives, Quantity("detectable", least if least <= UNDETECTABLE else None, "%")))
    return Section(
        "power",
        f"Smallest change of each figure that is found in {100 * POWER:g} % of all cases",
        rows=tuple(rows),
        note="by the scatter of the drives, as if both versions erred independently on them: an upper limit, as the "
        f"same seeds make most errors alike; –: more than tenfold; level {ALPHA:g} over all figures together",
    )


def power_lines(baseline: Baseline) -> list[str]:
    """The power of every case in a few columns, and where the baseline itself is over-confident."""
    section = power_section(baseline)
    found: dict[str, dict[str, Any]] = {}
    for case, metric, _, least in section.rows:
        found.setdefault(str(case.value), {})[str(metric.value)] = least.value
    rows = tuple(
        (
            Quantity("case", name),
            *(Quantity(key, values.get(key), "%", meaning=label) for key, label in _POWER.items()),
        )
        for name, values in found.items()
    )
    return [*_text(replace(section, rows=rows)), "", *_notes(baseline)]


def overconfident(baseline: Baseline) -> Iterator[Finding]:
    """Give the cases of the baseline whose errors exceed what it states: what is compared with them is no standard."""
    for name, case in baseline.cases.items():
        for key in ("nees_position", "nees_velocity", "nees_attitude"):
            if key not in case.measured.values:
                continue
            middle, low, _ = interval(case.measured.values[key], BY_KEY[key], pieces=case.pieces)
            if low > OVERCONFIDENT:
                over, label = Code.REGRESSION_OVERCONFIDENT, BY_KEY[key].label
                yield Finding.of(over, subject=name, nees=middle, low=low, limit=OVERCONFIDENT, metric=label)


def _notes(baseline: Baseline) -> list[str]:
    return [f"note    {sentence(each)}" for each in overconfident(baseline)]


def peer_section(peers: Sequence[PeerRow]) -> Section:
    """Other programs on the same drives, in one table."""
    rows = tuple(
        (
            Quantity("case", row.case),
            Quantity("program", row.program),
            *(Quantity(axis, value, "m") for axis, value in zip("NED", row.rms, strict=True)),
            Quantity("tilt", row.attitude_deg[0], meaning="tilt [deg]"),  # already in degrees
            Quantity("heading", row.attitude_deg[1], meaning="heading [deg]"),
            Quantity("cpu", row.cpu_us, "us", meaning="CPU a sample"),
            Quantity("remark", row.remark),
        )
        for row in peers
    )
    return Section("", PEERS, rows=rows, note=_PEER_NOTE)


def regression_lines(
    result: Result, comparison: Comparison | None, baseline: Baseline | None, peers: Sequence[PeerRow] = ()
) -> list[str]:
    """Write the result of a run for the terminal."""
    below = ["", *_text(peer_section(peers))] if peers else []
    lines = _text(case_section(result, comparison))
    if comparison is None or baseline is None:
        return [*lines, "", "there is no baseline to compare with: --update-baseline makes one", *below]
    lines.append("")
    for name in ("better", "worse"):
        chosen = [change for change in comparison.changes if change.verdict == name and not change.fails]
        lines += [f"{name:<8}{change_text(change)}" for change in chosen]
    lines += _notes(baseline)
    lines += [f"apart   {sentence(each)}" for each in comparison.apart.values()]
    lines += [f"BROKEN  {sentence(each)}" for each in comparison.broken.values()]
    lines += [f"FAILS   {change_text(change)}" for change in comparison.failing]
    return [*lines, verdict_text(comparison, baseline.origin), *below]


def _text(section: Section) -> list[str]:
    return [line for table in section_tables(section) for line in table_text(table).splitlines()]


def verdict_text(comparison: Comparison, then: Origin) -> str:
    """Sum up a comparison in a sentence."""
    tested = [change for change in comparison.changes if change.metric.kind != "cpu"]
    better, worse = (sum(change.verdict == name for change in comparison.changes) for name in ("better", "worse"))
    which = f"version {then.version} ({then.commit or 'no commit'}, {then.date})"
    outcome = "passed" if comparison.passed else f"FAILED: {len(comparison.failing) + len(comparison.broken)}"
    return f"{outcome}: {better} better, {worse} worse of {len(tested)} figures against {which}"
