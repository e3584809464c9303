"""Matrices of a regression run: every case by every figure of merit against the baseline, and peers against insnav."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.regression.accuracy_metrics import FAILS_FROM, METRICS
from insnav.regression.baseline import Baseline
from insnav.regression.history import Entry
from insnav.regression.paired_tests import detectable
from insnav.regression.peers.run_peers import PeerRow
from insnav.regression.run_corpus import Result
from insnav.regression.verdict import Change, Comparison
from insnav.report.numbers import number
from insnav.report.page import Cell, Matrix, Table
from insnav.report.regression.tables import change_head

_VERSIONS, _DRIVES = 8, 40  # shown of a history, and of the drives behind a cell
_STEPS = (0.05, 0.2)  # relative changes from which a colour is stronger
_TIE = 0.1  # a peer within this share of insnav is as good
_PEER_AXES = ("north", "east", "down", "tilt", "heading")
TONES = (
    ("better3", "better by 20 %"),
    ("better2", "5 %"),
    ("better1", "1 %"),
    ("same", "no change that counts"),
    ("worse1", "worse by 1 %"),
    ("worse2", "5 %"),
    ("worse3", "20 % and more"),
    ("fails", "fails"),
    ("unclear", f"too few drives to find a change of {100 * FAILS_FROM:g} %"),
)


def figures_tested(comparison: Comparison) -> int:
    """How many figures are tested at once."""
    return sum(change.metric.kind != "cpu" for change in comparison.changes)


def is_unclear(change: Change, tests: int) -> bool:
    """Whether a change that would fail may have been missed: neither found, nor likely to be found."""
    if change.verdict != "same" or change.metric.kind == "cpu":
        return False
    return detectable(change.shift, tests) > FAILS_FROM


def unclear_changes(comparison: Comparison) -> int:
    """How many figures may have changed without being found."""
    return sum(is_unclear(change, figures_tested(comparison)) for change in comparison.changes)


def change_matrix(result: Result, comparison: Comparison, baseline: Baseline, history: Sequence[Entry]) -> Matrix:
    """Every case by every figure of merit: its change since the baseline, its history and drives behind each cell."""
    tests, found = figures_tested(comparison), {(each.case, each.metric.key): each for each in comparison.changes}
    metrics = [metric for metric in METRICS if any(key == metric.key for _, key in found)]
    names = [name for name in result.cases if any(case == name for case, _ in found)]

    def cell(row: int, column: int) -> Cell | None:
        change = found.get((names[row], metrics[column].key))
        behind = () if change is None else _behind(change, result, baseline, history)
        return None if change is None else _cell(change, tests, f"cell-{row}-{column}", behind)

    rows = [(name, tuple(cell(row, column) for column in range(len(metrics)))) for row, name in enumerate(names)]
    return Matrix(tuple(metric.label for metric in metrics), tuple(rows), TONES)


def _cell(change: Change, tests: int, key: str, behind: tuple[Table, ...]) -> Cell:
    size = change.shift.change
    text = "·" if abs(size) < 0.005 else f"{100.0 * size:+.0f}"
    title = change_head(change)
    if change.metric.kind != "cpu":
        least = detectable(change.shift, tests)
        words = f"from {100.0 * least:.2g} % on a change is found" if np.isfinite(least) else "too few drives to test"
        title += f" ({100.0 * size:+.1f} %, p {change.adjusted:.1g}; {words})"
    return Cell(text, _tone(change, tests), title, key, behind)


def _tone(change: Change, tests: int) -> str:
    if change.fails:
        return "fails"
    if change.verdict == "same":
        return "unclear" if is_unclear(change, tests) else "same"
    ratio = abs(np.log1p(change.shift.change))
    return f"{change.verdict}{1 + sum(ratio >= np.log1p(step) for step in _STEPS)}"


def _behind(change: Change, result: Result, baseline: Baseline, history: Sequence[Entry]) -> tuple[Table, ...]:
    """History over the versions, and the drives, of one figure of one case."""
    name, metric = change.case, change.metric
    rows = []
    for each in list(history)[-_VERSIONS:]:
        value = each.metrics.get(name, {}).get(metric.key)
        if value is None:
            continue
        known = f"{number(value[1])} … {number(value[2])}" if value[1] is not None and np.isfinite(value[1]) else "–"
        same = "" if each.digests.get(name) == result.cases[name].digest else "another case"
        verdict = each.verdicts.get(name, {}).get(metric.key, "") or same
        rows.append((each.origin.version, each.origin.date[:10], number(value[0]), known, verdict))
    tables = []
    if rows:
        label = f"{metric.label} [{metric.unit}]" if metric.unit else metric.label
        tables.append(Table("over the versions", ("version", "date", label, "95 %", ""), tuple(rows)))
    old, new = (each[name].measured.values[metric.key] for each in (baseline.cases, result.cases))
    what = "piece" if result.cases[name].pieces else "drive"
    pairs = list(zip(old.tolist(), new.tolist(), strict=False))[:_DRIVES]
    columns = (what, *(str(k) for k in range(1, len(pairs) + 1)))
    then, now = (tuple(number(each) for each in side) for side in zip(*pairs, strict=True))
    return (*tables, Table(f"{what}s, baseline and now", columns, (("baseline", *then), ("now", *now))))


def peer_matrix(peers: Sequence[PeerRow]) -> Matrix | None:
    """Errors of other programs over those of insnav on the same drive, smoothers over its smoother; None without any.

    One drive a case: there is no significance.
    """
    programs = list(dict.fromkeys(row.program for row in peers if not row.program.startswith("insnav")))
    figures = {(row.case, row.program): (*row.rms, *row.attitude_deg) for row in peers}
    own = list(dict.fromkeys(row.case for row in peers if row.program == "insnav"))
    columns = [(program, axis) for program in programs for axis in range(len(_PEER_AXES))]
    if not own or not columns:
        return None

    none = (None,) * len(_PEER_AXES)

    def cell(name: str, program: str, axis: int) -> Cell | None:
        base = "insnav, smoothed" if program.endswith("smoothed") else "insnav"
        a, b = (figures.get((name, each), none)[axis] for each in (base, program))
        return _peer_cell(name, program, _PEER_AXES[axis], a, b)

    rows = tuple((name, tuple(cell(name, *column) for column in columns)) for name in own)
    tones = (
        ("better2", "insnav has smaller errors"),
        ("same", f"within {100 * _TIE:g} %"),
        ("worse2", "insnav has larger errors"),
    )
    return Matrix(tuple(f"{program}, {_PEER_AXES[axis]}" for program, axis in columns), rows, tones)


def _peer_cell(case: str, program: str, axis: str, own: float | None, other: float | None) -> Cell | None:
    if own is None or other is None or not own > 0.0 or not np.isfinite(other):
        return None
    ratio = other / own
    tone = "same" if abs(np.log(ratio)) < np.log1p(_TIE) else "better2" if ratio > 1.0 else "worse2"
    unit = "deg" if axis in ("tilt", "heading") else "m"
    title = f"{case}, {axis}: {program} {number(other)} {unit}, insnav {number(own)} {unit}"
    return Cell(f"{ratio:.2g}", tone, title)
