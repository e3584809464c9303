"""The verdict: which figures of which cases are better, the same or worse than in the baseline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.findings import Code, Finding
from insnav.regression.accuracy_metrics import METRICS, Metric
from insnav.regression.baseline import Baseline
from insnav.regression.paired_tests import ALPHA, FEWEST, SMALLEST, Shift, holm, shift
from insnav.regression.run_corpus import Accuracy, CaseResult
from insnav.types import FloatArray

Verdict = Literal["better", "same", "worse"]
CPU_FAILS_FROM = 3.0  # times the baseline's, in the median over five drives or more; else CPU time is only shown


@dataclass(frozen=True, slots=True)
class Change:
    """One figure of merit of one case, then and now."""

    case: str
    metric: Metric
    # geometric mean over the drives, or pieces, that both have; of CPU time the median
    old: float
    new: float
    shift: Shift  # paired change and its p-value
    adjusted: float  # the p-value corrected for the number of all pairs of case and metric
    verdict: Verdict  # better and worse are significant changes of at least 1 %
    fails: bool  # worse by 5 % and more; CPU time by a factor of three


@dataclass(frozen=True, slots=True)
class Comparison:
    """All changes, and what could not be compared."""

    changes: tuple[Change, ...]  # by case, then by metric
    broken: dict[str, Finding]  # cases in which a drive fails that did not, with the reason
    apart: dict[str, Finding]  # cases that could not be compared, with the reason

    @property
    def failing(self) -> tuple[Change, ...]:
        """The changes that fail."""
        return tuple(change for change in self.changes if change.fails)

    @property
    def passed(self) -> bool:
        """Nothing is broken, and nothing so much worse that it fails."""
        return not self.failing and not self.broken


def compare(result: Accuracy, baseline: Baseline) -> Comparison:
    """Compare a result, of the whole corpus or of a quick run, with a baseline: drives that both have count."""
    broken: dict[str, Finding] = {}
    apart: dict[str, Finding] = {}
    found: list[tuple[str, Metric, float, float, Shift]] = []
    for name, now in result.cases.items():
        then = baseline.cases.get(name)
        if then is not None and then.digest != now.digest:
            apart[name] = Finding.of(Code.REGRESSION_OTHER_CASE, subject=name)
            then = None
        elif then is None:
            apart[name] = Finding.of(Code.REGRESSION_NEW_CASE, subject=name)
        failed = sorted(now.failures.keys() - (() if then is None else then.failures.keys()))
        if failed:
            run, cause = failed[0], now.failures[failed[0]] or ""
            broken[name] = Finding.of(Code.REGRESSION_BROKEN, subject=name, run=run, cause=cause)
        if then is not None:
            found += _shifts(name, now, then)
    adjusted = iter(holm([each[-1].p for each in found if each[1].kind != "cpu"]))
    changes = [_change(*each, 1.0 if each[1].kind == "cpu" else float(next(adjusted))) for each in found]
    return Comparison(tuple(changes), broken, apart)


def _shifts(name: str, now: CaseResult, then: CaseResult) -> list[tuple[str, Metric, float, float, Shift]]:
    before, after = then.measured.values, now.measured.values
    found = []
    for metric in (each for each in METRICS if each.key in before and each.key in after):
        # values of the drives that both have
        n = min(len(before[metric.key]), len(after[metric.key]))
        old, new = before[metric.key][:n], after[metric.key][:n]
        known = np.isfinite(old) & np.isfinite(new)
        old, new = old[known], new[known]
        change = _cpu(old, new) if metric.kind == "cpu" else shift(old, new, metric, pieces=now.pieces)
        if np.isfinite(change.change):
            found.append((name, metric, metric.typical(old), metric.typical(new), change))
    return found


def _cpu(old: FloatArray, new: FloatArray) -> Shift:
    """Change of CPU time: the median over the drives, which a busy computer or the first call do not change."""
    change = float(np.median(new / old)) - 1.0 if len(old) and (old > 0.0).all() else float("nan")
    few = len(old) < FEWEST
    return Shift(change, -1.0 if few else change, float("inf") if few else change, 1.0)


def _change(case: str, metric: Metric, old: float, new: float, change: Shift, adjusted: float) -> Change:
    if metric.kind == "cpu":
        fails = change.low > CPU_FAILS_FROM - 1.0
        return Change(case, metric, old, new, change, 1.0, "worse" if fails else "same", fails)
    certain = adjusted < ALPHA and abs(change.change) >= min(SMALLEST, metric.fails_from)
    verdict: Verdict = "same" if not certain else "worse" if change.change > 0.0 else "better"
    fails = verdict == "worse" and change.change >= metric.fails_from
    return Change(case, metric, old, new, change, adjusted, verdict, fails)
