"""Comparison of two versions on the same drives: paired tests, corrected for their number.

Figures of merit are compared by the logarithm of their ratio, drive by drive: by seed for simulated drives, by piece
for recorded ones. The mean of these logarithms is the change. It is tested

- by Student's t for seeds, which are independent;
- for successive pieces of one drive, which are dependent, with a standard error from the moving-block bootstrap
(Kuensch, "The jackknife and the bootstrap for general stationary observations", Annals of Statistics 17 (1989)
1217-1241), and one degree of freedom per block.

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
from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import METRICS, Accuracy, CaseResult, Metric
from insnav.sample_statistics import CONFIDENCE, block_rows
from insnav.types import FloatArray

ALPHA = 0.01  # probability of any false change in the whole corpus
POWER = 0.8  # a change is excluded if the test would find it with this probability
FEWEST = 5  # fewer pairs give no change
SMALLEST = 0.01  # a smaller change is ignored, however significant
MOST_ALIKE = 0.9  # correlation of successive pieces
BLOCK = 2  # successive pieces that are resampled together
_SAMPLES = 2000
_SEED = 20260101
Verdict = Literal["better", "same", "worse"]
CPU_FAILS_FROM = 3.0  # ratio to the baseline, in the median over five drives or more; else CPU time is only displayed


@dataclass(frozen=True, slots=True)
class Shift:
    """Change of one figure of merit."""

    # ratio of new to old, minus one; for NEES and NIS the ratio of distances from one, caution at half weight
    change: float
    # 95 % interval of that
    low: float
    high: float
    p: float  # two-sided probability of such a change by chance
    # standard error of the log ratio, infinite with too few pairs; and its degrees of freedom
    error: float = 0.0
    degrees: float = np.inf


def shift(old: FloatArray, new: FloatArray, metric: Metric, *, pieces: bool) -> Shift:
    """Test whether a figure of merit has changed.

    `old`, `new` (n,): values of the same drives, or pieces, in the same order; NaN if unknown.
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
    sure = 1.0 if mean == 0.0 else 0.0  # all equal
    p = 2.0 * float(stdtr(degrees, -abs(mean) / error)) if error > 0.0 else sure
    half = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * error
    before = float(np.mean(then[known]))
    # significance refers to the logarithm; its meaning for a ratio depends on the side of one
    worse = [metric.badness(before + mean + each) - metric.badness(before) for each in (0.0, -half, half)]
    return Shift(float(np.expm1(worse[0])), float(np.expm1(min(worse))), float(np.expm1(max(worse))), p, error, degrees)


def detectable(found: Shift, tests: int) -> float:
    """Compute the smallest relative change found with probability `POWER`, among so many tests.

    Notes
    -----
    The level is the strictest of Holm's correction. The t distribution shifted by the change approximates the
    noncentral one from five pairs on (Cohen, "Statistical Power Analysis", 1988, section 12.3).
    """
    if found.error == 0.0 or not np.isfinite(found.error):
        return found.error
    level = stdtrit(found.degrees, 1.0 - 0.5 * ALPHA / max(tests, 1))
    return float(np.expm1(found.error * (level + stdtrit(found.degrees, POWER))))


def detectable_apart(value: FloatArray, metric: Metric, *, pieces: bool, tests: int) -> float:
    """Compute the smallest relative change of a figure found with probability `POWER`, NaN for few values.

    The scatter is between the drives, as if both versions had independent errors. This is an upper limit, as equal
    seeds correlate most errors. `tests`: number of figures that share the level `ALPHA`, as in Holm's first step.

    Notes
    -----
    The noncentrality at which Student's t exceeds its critical value with this probability, times ``s sqrt(2 / n)``
    (Cohen, "Statistical Power Analysis", 2nd ed. 1988, chapter 2).
    """
    logarithm = metric.logarithm(value[np.isfinite(value)])
    if len(logarithm) < FEWEST:
        return float("nan")
    error, degrees = standard_error(logarithm, pieces=pieces)
    critical = stdtrit(degrees, 1.0 - 0.5 * ALPHA / tests)
    return float(np.expm1(nctdtrinc(degrees, 1.0 - POWER, critical) * np.sqrt(2.0) * error))


def interval(value: FloatArray, metric: Metric, *, pieces: bool) -> tuple[float, float, float]:
    """Compute the typical value of a figure of merit, and its 95 % interval. `value` (n,): one per drive or piece."""
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
    """Compute the standard error of a mean, and its degrees of freedom. `value` (n,)."""
    n = len(value)
    if n < 2:
        return 0.0, 1.0
    if not pieces:
        return float(np.std(value, ddof=1) / np.sqrt(n)), n - 1.0
    length = min(BLOCK, n - 1)
    means = value[block_rows(n, length, _SAMPLES, _SEED, circular=False)].mean(axis=1)
    # the bootstrap variance of few blocks is too small, by the share of its own estimate
    error = float(np.std(means) * np.sqrt(n / (n - length)))
    # Blocks miss correlation over longer times. A first-order autoregression with coefficient r includes it. The
    # estimate of r is too low by about (1 + 3 r) / n (Kendall, Biometrika 41 (1954) 403-404)
    centred = value - value.mean()
    r = float(centred[1:] @ centred[:-1]) / max(float(centred @ centred), 1e-300)
    r = min(max(r + (1.0 + 3.0 * r) / n, 0.0), MOST_ALIKE)
    alike = (1.0 + r) / (1.0 - r)
    error = max(error, float(np.std(value, ddof=1)) * np.sqrt(alike / n))
    return error, max(n / max(alike, length) - 1.0, 1.0)


def holm(p: Sequence[float]) -> FloatArray:
    """Correct p-values for their number. Returns: (n,): adjusted p-values, for comparison with the joint level."""
    value = np.asarray(p, dtype=np.float64)
    order = np.argsort(value)
    steps = (len(value) - np.arange(len(value))) * value[order]
    adjusted = np.empty_like(value)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted


@dataclass(frozen=True, slots=True)
class Change:
    """Figure of merit of one case, old and new."""

    case: str
    metric: Metric
    # geometric mean over the common drives, or pieces; median of CPU time
    old: float
    new: float
    shift: Shift  # paired change and its p-value
    adjusted: float  # the p-value corrected for the number of all pairs of case and metric
    verdict: Verdict  # better and worse are significant changes of at least 1 %
    fails: bool  # worse by 5 % and more; CPU time by a factor of three


@dataclass(frozen=True, slots=True)
class Comparison:
    """All changes, and cases without comparison."""

    changes: tuple[Change, ...]  # by case, then by metric
    broken: dict[str, Finding]  # cases with a newly failing drive, with the reason
    apart: dict[str, Finding]  # cases without comparison, with the reason

    @property
    def failing(self) -> tuple[Change, ...]:
        """Failing changes."""
        return tuple(change for change in self.changes if change.fails)

    @property
    def passed(self) -> bool:
        """True if no drive is broken and no change fails."""
        return not self.failing and not self.broken


def compare(result: Accuracy, baseline: Baseline) -> Comparison:
    """Compare a result, of the whole corpus or of a quick run, with a baseline on common drives."""
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
        # values of common drives
        n = min(len(before[metric.key]), len(after[metric.key]))
        old, new = before[metric.key][:n], after[metric.key][:n]
        known = np.isfinite(old) & np.isfinite(new)
        old, new = old[known], new[known]
        change = _cpu(old, new) if metric.kind == "cpu" else shift(old, new, metric, pieces=now.pieces)
        if np.isfinite(change.change):
            yield name, metric, metric.typical(old), metric.typical(new), change


def _cpu(old: FloatArray, new: FloatArray) -> Shift:
    """Compare CPU time: the median over the drives, robust against a busy computer and the first call."""
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
