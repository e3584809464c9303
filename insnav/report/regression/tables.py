"""What a comparison with the baseline says, in words and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from insnav.regression.baseline import Baseline
from insnav.regression.paired_tests import ALPHA
from insnav.regression.peers.run_peers import LATEST, LONGEST, PeerRow
from insnav.regression.provenance import Origin
from insnav.regression.run_corpus import Result
from insnav.regression.verdict import CPU_FAILS_FROM, FAILS_FROM, Change, Comparison
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.terminal import table_text

_PEER_NOTE = (
    f"RMS over the first {LONGEST:g} s of the first drive of each case (more where the heading needs it), from "
    f"{LATEST:g} s on at the latest; same samples, fixes, start and sensor figures; gtsam at the fixes alone"
)
HEADLINES = ("north_rms_m", "east_rms_m", "down_rms_m", "roll_pitch_rms_deg", "heading_rms_deg", "outage_60s_m")


def change_text(change: Change) -> str:
    """Say one change in a line: case, metric, old and new value."""
    unit = f" {change.metric.unit}" if change.metric.unit else ""
    head = f"{change.case}: {change.metric.label}: {number(change.old)} -> {number(change.new)}{unit}"
    if change.metric.kind == "cpu":
        return f"{head} ({change.shift.change + 1.0:.1f} times)"
    return f"{head} ({100.0 * change.shift.change:+.1f} %, p {change.adjusted:.1g})"


def case_table(result: Result, comparison: Comparison | None) -> Table:
    """One row a case: headline figures, and how many figures are better, the same, worse.

    Parameters
    ----------
    result : Result
    comparison : Comparison or None
        None without a baseline.
    """
    from insnav.regression.accuracy_metrics import BY_KEY

    rows = []
    for name, case in result.cases.items():
        values = {} if case.measured is None else case.measured.values
        cells = [number(BY_KEY[key].typical(values[key])) if key in values else number(None) for key in HEADLINES]
        rows.append((name, *cells, *_counts(name, comparison)))
    columns = ("case", "N [m]", "E [m]", "D [m]", "tilt [deg]", "heading [deg]", "60 s without GPS [m]")
    return Table(
        "Accuracy, and figures that changed",
        (*columns, "better", "same", "worse"),
        tuple(rows),
        "RMS, geometric mean over the drives (seeds) of a case, or over the pieces of a recorded drive",
    )


def _counts(name: str, comparison: Comparison | None) -> tuple[str, str, str]:
    changes = [] if comparison is None else [change for change in comparison.changes if change.case == name]
    if not changes:
        return ("–", "–", "–")
    better, same, worse = (
        str(sum(change.verdict == verdict for change in changes)) for verdict in ("better", "same", "worse")
    )
    return better, same, worse


def peer_table(peers: Sequence[PeerRow]) -> Table:
    """Other programs on the same drives, in one table."""
    rows = tuple(
        (
            row.case,
            row.program,
            *(number(value) for value in row.rms),
            number(row.attitude_deg[0]),
            number(row.attitude_deg[1]),
            number(row.cpu_us),
            row.remark,
        )
        for row in peers
    )
    columns = ("case", "program", "N [m]", "E [m]", "D [m]", "tilt [deg]", "heading [deg]", "CPU a sample [us]", "")
    return Table("The same drives by other programs", columns, rows, _PEER_NOTE)


def peer_lines(peers: Sequence[PeerRow]) -> list[str]:
    """Write the table of the other programs for the terminal; nothing without them."""
    return ["", *table_text(peer_table(peers)).splitlines()] if peers else []


def regression_lines(result: Result, comparison: Comparison | None, baseline: Baseline | None) -> list[str]:
    """Write the result of a run for the terminal.

    Parameters
    ----------
    result : Result
    comparison : Comparison or None
    baseline : Baseline or None

    Returns
    -------
    list of str
    """
    lines = table_text(case_table(result, comparison)).splitlines()
    if comparison is None or baseline is None:
        return [*lines, "", "there is no baseline to compare with: --update-baseline makes one"]
    lines.append("")
    for name in ("better", "worse"):
        chosen = [change for change in comparison.changes if change.verdict == name and not change.fails]
        lines += [f"{name:<8}{change_text(change)}" for change in chosen]
    lines += [f"apart   {name}: {why}" for name, why in comparison.apart.items()]
    lines += [f"BROKEN  {name}: {why}" for name, why in comparison.broken.items()]
    lines += [f"FAILS   {change_text(change)}" for change in comparison.failing]
    lines.append(verdict_text(comparison, baseline.origin))
    return lines


def verdict_text(comparison: Comparison, then: Origin) -> str:
    """Sum up a comparison in a sentence."""
    tested = [change for change in comparison.changes if change.metric.kind != "cpu"]
    better, worse = (sum(change.verdict == name for change in comparison.changes) for name in ("better", "worse"))
    which = f"version {then.version} ({then.commit or 'no commit'}, {then.date})"
    outcome = "passed" if comparison.passed else f"FAILED: {len(comparison.failing) + len(comparison.broken)}"
    return f"{outcome}: {better} better, {worse} worse of {len(tested)} figures against {which}"


def rules() -> tuple[str, ...]:
    """The rules by which figures are compared."""
    return (
        "A figure is compared drive by drive, by the logarithm of new over old: Student's t over the seeds of a "
        "simulated case, a standard error by moving-block bootstrap over the pieces of a recorded drive.",
        f"Holm's correction holds the probability of any false call over all figures of all cases to {ALPHA:g}.",
        f"Better and worse are significant changes of 1 % and more; {100 * FAILS_FROM:g} % worse fails.",
        f"CPU time is that of a sample over that of a turn of a fixed loop beside it. It is noisy: it fails only from "
        f"{CPU_FAILS_FROM:g} times the baseline's on, in the median over five drives or more of a case.",
        "NEES and NIS are judged by the factor by which they are off one, either way.",
    )


def regression_facts(
    result: Result, comparison: Comparison | None, now: Origin, then: Baseline | None
) -> dict[str, Any]:
    """Gather everything, JSON-ready, units in the keys.

    Parameters
    ----------
    result : Result
    comparison : Comparison or None
    now : Origin
    then : Baseline or None
    """
    from dataclasses import asdict

    from insnav.regression.accuracy_metrics import BY_KEY

    cases = {
        name: {
            "digest": case.digest,
            "failures": case.failures,
            "values": {}
            if case.measured is None
            else {key: BY_KEY[key].typical(value) for key, value in case.measured.values.items()},
        }
        for name, case in result.cases.items()
    }
    changes = [] if comparison is None else comparison.changes
    ready: dict[str, Any] = json_ready(
        {
            "origin": asdict(now),
            "baseline": None if then is None else asdict(then.origin),
            "quick": result.quick,
            "passed": None if comparison is None else comparison.passed,
            "cases": cases,
            "skipped": result.skipped,
            "apart": {} if comparison is None else comparison.apart,
            "broken": {} if comparison is None else comparison.broken,
            "changes": [
                {
                    "case": change.case,
                    "metric": change.metric.key,
                    "old": change.old,
                    "new": change.new,
                    "change": change.shift.change,
                    "p": change.adjusted,
                    "verdict": change.verdict,
                    "fails": change.fails,
                }
                for change in changes
            ],
        }
    )
    return ready
