"""Whether one version is better or worse than another on the same drives: paired tests, corrected for their number.

Figures of merit are compared by the logarithm of their ratio, drive by drive: seed by seed where they are simulated,
piece by piece where they are recorded. The mean of these logarithms is the change, and is tested

- by Student's t for seeds, which are independent;
- for successive pieces of one drive, which are not, with a standard error from the moving-block bootstrap (Kuensch,
  "The jackknife and the bootstrap for general stationary observations", Annals of Statistics 17 (1989) 1217-1241),
  and as many degrees of freedom as there are blocks.

All pairs of case and metric are tested at once: Holm, "A simple sequentially rejective multiple test procedure",
Scandinavian Journal of Statistics 6 (1979) 65-70.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import nctdtrinc, stdtr, stdtrit

from insnav.findings import Code, Finding
from insnav.regression.accuracy_metrics import METRICS, Metric
from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import Accuracy, CaseResult
from insnav.sample_statistics import CONFIDENCE, block_rows
from insnav.types import FloatArray

ALPHA = 0.01  # of wrongly calling anything changed, over the whole corpus
POWER = 0.8  # with which a change must be found to count as excluded
FEWEST = 5  # pairs below which nothing is called changed
SMALLEST = 0.01  # a smaller change is none, however certain
MOST_ALIKE = 0.9  # correlation of successive pieces
BLOCK = 2  # successive pieces that are resampled together
_SAMPLES = 2000
_SEED = 20260101
Verdict = Literal["better", "same", "worse"]
CPU_FAILS_FROM = 3.0  # times the baseline's, in the median over five drives or more; else CPU time is only shown


@dataclass(frozen=True, slots=True)
class Shift:
    """Change of one figure of merit."""

    # ratio of new to old, less one; of a ratio (NEES, NIS) that of the distances from one, caution at half its weight
    change: float
    # 95 % interval of that
    low: float
    high: float
    p: float  # probability of a change as large if there is none, two-sided
    # standard error of the logarithm of the ratio, infinite where there are too few pairs; and its degrees of freedom
    error: float = 0.0
    degrees: float = np.inf


def shift(old: FloatArray, new: FloatArray, metric: Metric, *, pieces: bool) -> Shift:
    """Test whether a figure of merit has changed.

    `old`, `new` (n,): values of the same drives, or pieces, in the same order; NaN where not known.
    """
    n = min(len(old), len(new))
    then, now = metric.logarithm(np.asarray(old[:n])), metric.logarithm(np.asarray(new[:n]))
    known = np.isfinite(then) & np.isfinite(now)
    score = (now - then)[known]
    if not score.size:
        return Shift(float("nan"), float("nan"), float("nan"), 1.0)
    mean = float(np.mean(score))
    error, degrees = standard_error(score, pieces=pieces)
    if len(score) < FEWEST:
        return Shift(float(np.expm1(mean)), -1.0, float("inf"), 1.0, float("inf"))
    sure = 1.0 if mean == 0.0 else 0.0  # all the same
    p = 2.0 * float(stdtr(degrees, -abs(mean) / error)) if error > 0.0 else sure
    half = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * error
    before = float(np.mean(then[known]))
    # significance is that of the logarithm itself; what it means for a ratio depends on the side of one it is on
    worse = [metric.badness(before + mean + each) - metric.badness(before) for each in (0.0, -half, half)]
    return Shift(float(np.expm1(worse[0])), float(np.expm1(min(worse))), float(np.expm1(max(worse))), p, error, degrees)


def detectable(found: Shift, tests: int) -> float:
    """Smallest relative change that is found with the probability `POWER`, among so many tests.

    Notes
    -----
    At the strictest level of Holm's correction; by the t distribution shifted by the change, which is close to the
    noncentral one from five pairs on (Cohen, "Statistical Power Analysis", 1988, section 12.3).
    """
    if found.error == 0.0 or not np.isfinite(found.error):
        return found.error
    level = stdtrit(found.degrees, 1.0 - 0.5 * ALPHA / max(tests, 1))
    return float(np.expm1(found.error * (level + stdtrit(found.degrees, POWER))))


def detectable_apart(value: FloatArray, metric: Metric, *, pieces: bool, tests: int) -> float:
    """Smallest relative change of a figure that is found with the probability `POWER`, NaN for too few values.

    The scatter is that of the drives themselves, as if both versions erred independently: an upper limit, as the same
    seeds make most errors alike. `tests`: so many figures share the level `ALPHA`, as Holm's first step has it.

    Notes
    -----
    The non-centrality at which Student's t exceeds its critical value so often, times ``s sqrt(2 / n)`` (Cohen,
    "Statistical Power Analysis", 2nd ed. 1988, chapter 2).
    """
    logarithm = metric.logarithm(value[np.isfinite(value)])
    if len(logarithm) < FEWEST:
        return float("nan")
    error, degrees = standard_error(logarithm, pieces=pieces)
    critical = stdtrit(degrees, 1.0 - 0.5 * ALPHA / tests)
    return float(np.expm1(nctdtrinc(degrees, 1.0 - POWER, critical) * np.sqrt(2.0) * error))


def interval(value: FloatArray, metric: Metric, *, pieces: bool) -> tuple[float, float, float]:
    """Typical value of a figure of merit, and its 95 % interval.

    `value` (n,): one a drive, or a piece.
    """
    known = value[np.isfinite(value)]
    middle = metric.typical(known)
    if len(known) < FEWEST or metric.kind == "cpu":
        return middle, float("nan"), float("nan")
    floor = 1e-6 if metric.kind == "ratio" else metric.floor
    logarithm = np.log(known + floor)
    error, degrees = standard_error(logarithm, pieces=pieces)
    half = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * error
    low, high = (float(max(np.exp(np.mean(logarithm) + s * half) - floor, 0.0)) for s in (-1.0, 1.0))
    return middle, low, high


def standard_error(value: FloatArray, *, pieces: bool) -> tuple[float, float]:
    """Standard error of a mean, and its degrees of freedom.

    `value` (n,).
    """
    n = len(value)
    if n < 2:
        return 0.0, 1.0
    if not pieces:
        return float(np.std(value, ddof=1) / np.sqrt(n)), n - 1.0
    length = min(BLOCK, n - 1)
    means = value[block_rows(n, length, _SAMPLES, _SEED, circular=False)].mean(axis=1)
    # the bootstrap variance of few blocks is too small by the share of what it estimates from them
    error = float(np.std(means) * np.sqrt(n / (n - length)))
    # what lasts longer than a block does not show in it: as much as a first-order autoregression has, whose coefficient
    # n values show too small by about (1 + 3 r) / n (Kendall, Biometrika 41 (1954) 403-404)
    centred = value - value.mean()
    r = float(centred[1:] @ centred[:-1]) / max(float(centred @ centred), 1e-300)
    r = min(max(r + (1.0 + 3.0 * r) / n, 0.0), MOST_ALIKE)
    alike = (1.0 + r) / (1.0 - r)
    error = max(error, float(np.std(value, ddof=1)) * np.sqrt(alike / n))
    return error, max(n / max(alike, length) - 1.0, 1.0)


def holm(p: Sequence[float]) -> FloatArray:
    """Correct p-values for their number.

    Returns: (n,): adjusted: compare them with the level that is to hold for all together.
    """
    value = np.asarray(p, dtype=np.float64)
    order = np.argsort(value)
    steps = (len(value) - np.arange(len(value))) * value[order]
    adjusted = np.empty_like(value)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted


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


def _shifts(name: str, now: CaseResult, then: CaseResult) -> Iterator[tuple[str, Metric, float, float, Shift]]:
    before, after = then.measured.values, now.measured.values
    for metric in (each for each in METRICS if each.key in before and each.key in after):
        # values of the drives that both have
        n = min(len(before[metric.key]), len(after[metric.key]))
        old, new = before[metric.key][:n], after[metric.key][:n]
        known = np.isfinite(old) & np.isfinite(new)
        old, new = old[known], new[known]
        change = _cpu(old, new) if metric.kind == "cpu" else shift(old, new, metric, pieces=now.pieces)
        if np.isfinite(change.change):
            yield name, metric, metric.typical(old), metric.typical(new), change


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
