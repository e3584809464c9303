"""Comparison of two versions of insnav on the same drives: paired tests, corrected for multiple testing.

Each figure of merit is compared by the logarithm of the ratio of the new to the old value. Pairs are equal seeds of a
simulated drive, or equal pieces of a recorded one. Student's t tests whether the mean of the logarithms is zero:

- seeds are independent: the standard error is s / sqrt(n);
- successive pieces of one drive are correlated: the standard error is from the moving-block bootstrap (Kuensch, "The
jackknife and the bootstrap for general stationary observations", Annals of Statistics 17 (1989) 1217-1241), with about
one degree of freedom per block.

Holm's correction covers all pairs of case and metric: Holm, "A simple sequentially rejective multiple test procedure",
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

ALPHA = 0.01  # significance level: probability of one or more false changes in the whole corpus
POWER = 0.8  # power of the test: probability of detecting the smallest detectable change
FEWEST = 5  # smallest number of pairs for a test
SMALLEST = 0.01  # smaller relative changes are "same", however significant; or `Metric.fails_from`, if smaller
MOST_ALIKE = 0.9  # upper limit of the estimated correlation of successive pieces
BLOCK = 2  # number of successive pieces in a bootstrap block
_SAMPLES = 2000  # bootstrap samples
_SEED = 20260101
Verdict = Literal["better", "same", "worse"]
CPU_FAILS_FROM = 3.0  # a larger median ratio of CPU time to the baseline fails; it needs `FEWEST` drives or more


@dataclass(frozen=True, slots=True)
class Shift:
    """Relative change of one figure of merit, with its significance."""

    # ratio of new to old, minus one; for NEES and NIS ``exp(d) - 1`` with the change d of `Metric.badness`
    change: float
    low: float  # lower end of the 95 % confidence interval of `change`
    high: float  # upper end of this interval
    p: float  # two-sided p-value: probability of so large a change by chance
    error: float = 0.0  # standard error of the mean log ratio; infinite with fewer than `FEWEST` pairs
    degrees: float = np.inf  # degrees of freedom of the standard error


def shift(old: FloatArray, new: FloatArray, metric: Metric, *, pieces: bool) -> Shift:
    """Test whether a figure of merit has changed.

    `old`, `new` (n,): values of the same drives or pieces, in the same order; NaN if unknown. `pieces`: the values are
    of successive pieces of one drive, thus correlated.
    """
    n = min(len(old), len(new))
    log_old, log_new = metric.logarithm(np.asarray(old[:n])), metric.logarithm(np.asarray(new[:n]))
    known = np.isfinite(log_old) & np.isfinite(log_new)
    score = (log_new - log_old)[known]
    if not score.size:
        return Shift(float("nan"), float("nan"), float("nan"), 1.0)
    mean = float(np.mean(score))
    error, degrees = standard_error(score, pieces=pieces)
    if len(score) < FEWEST:
        return Shift(float(np.expm1(mean)), -1.0, float("inf"), 1.0, float("inf"))
    p_exact = 1.0 if mean == 0.0 else 0.0  # p-value if all pairs change by the same factor: zero scatter
    p = 2.0 * float(stdtr(degrees, -abs(mean) / error)) if error > 0.0 else p_exact
    half_width = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * error
    base = float(np.mean(log_old[known]))
    # the same change of a NEES or NIS is better or worse, depending on which side of one it is
    worse = [metric.badness(base + mean + offset) - metric.badness(base) for offset in (0.0, -half_width, half_width)]
    return Shift(float(np.expm1(worse[0])), float(np.expm1(min(worse))), float(np.expm1(max(worse))), p, error, degrees)


def detectable(found: Shift, tests: int) -> float:
    """Compute the smallest relative change of a figure that the paired test detects with probability `POWER`.

    `found`: the shift, for its standard error. `tests`: number of simultaneous tests.

    Notes
    -----
    The level is ``ALPHA / tests``, the strictest of Holm's correction. The t distribution shifted by the change
    approximates the noncentral one from five pairs on (Cohen, "Statistical Power Analysis", 1988, section 12.3).
    """
    if found.error == 0.0 or not np.isfinite(found.error):
        return found.error
    level = stdtrit(found.degrees, 1.0 - 0.5 * ALPHA / max(tests, 1))
    return float(np.expm1(found.error * (level + stdtrit(found.degrees, POWER))))


def detectable_apart(value: FloatArray, metric: Metric, *, pieces: bool, tests: int) -> float:
    """Compute the smallest relative change that an unpaired test detects with probability `POWER`; NaN for few values.

    `value` (n,): the figure of each drive or piece, of one version. `tests`: number of figures that share `ALPHA`.
    The result is an upper limit for the paired test, because equal seeds correlate the errors of both versions.

    Notes
    -----
    The log ratio is the noncentrality at which Student's t exceeds its critical value with this probability, times the
    standard error of the difference, ``s sqrt(2 / n)`` (Cohen, "Statistical Power Analysis", 2nd ed. 1988, chapter 2).
    """
    logarithm = metric.logarithm(value[np.isfinite(value)])
    if len(logarithm) < FEWEST:
        return float("nan")
    error, degrees = standard_error(logarithm, pieces=pieces)
    critical = stdtrit(degrees, 1.0 - 0.5 * ALPHA / tests)
    return float(np.expm1(nctdtrinc(degrees, 1.0 - POWER, critical) * np.sqrt(2.0) * error))


def interval(value: FloatArray, metric: Metric, *, pieces: bool) -> tuple[float, float, float]:
    """Compute typical value and 95 % interval of a figure of merit. `value` (n,): one per drive or piece."""
    known = value[np.isfinite(value)]
    middle = metric.typical(known)
    if len(known) < FEWEST or metric.kind == "cpu":
        return middle, float("nan"), float("nan")
    floor = 1e-6 if metric.kind == "ratio" else metric.floor
    logarithm = np.log(known + floor)
    error, degrees = standard_error(logarithm, pieces=pieces)
    half_width = float(stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * error
    low, high = (float(max(np.exp(np.mean(logarithm) + sign * half_width) - floor, 0.0)) for sign in (-1.0, 1.0))
    return middle, low, high


def standard_error(value: FloatArray, *, pieces: bool) -> tuple[float, float]:
    """Compute the standard error of the mean of `value` (n,), and its degrees of freedom."""
    n = len(value)
    if n < 2:
        return 0.0, 1.0
    if not pieces:
        return float(np.std(value, ddof=1) / np.sqrt(n)), n - 1.0
    length = min(BLOCK, n - 1)
    means = value[block_rows(n, length, _SAMPLES, _SEED, circular=False)].mean(axis=1)
    # the bootstrap underestimates the variance of the mean by about length / n: correct for it
    error = float(np.std(means) * np.sqrt(n / (n - length)))
    # Short blocks miss correlation over longer times. A first-order autoregression with coefficient r includes it, and
    # inflates the variance of the mean by (1 + r) / (1 - r). The estimate of r is too low by about (1 + 3 r) / n
    # (Kendall, Biometrika 41 (1954) 403-404)
    centred = value - value.mean()
    r = float(centred[1:] @ centred[:-1]) / max(float(centred @ centred), 1e-300)
    r = min(max(r + (1.0 + 3.0 * r) / n, 0.0), MOST_ALIKE)
    inflation = (1.0 + r) / (1.0 - r)
    error = max(error, float(np.std(value, ddof=1)) * np.sqrt(inflation / n))
    return error, max(n / max(inflation, length) - 1.0, 1.0)


def holm(p: Sequence[float]) -> FloatArray:
    """Correct p-values for multiple testing by Holm's method. Returns: (n,): corrected p-values."""
    value = np.asarray(p, dtype=np.float64)
    order = np.argsort(value)
    steps = (len(value) - np.arange(len(value))) * value[order]
    adjusted = np.empty_like(value)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted


@dataclass(frozen=True, slots=True)
class Change:
    """Comparison of one figure of merit of one case: old and new value, significance and verdict."""

    case: str
    metric: Metric
    # `Metric.typical` over the drives or pieces that both versions have
    old: float
    new: float
    shift: Shift  # relative change and its p-value, not yet corrected
    adjusted: float  # p-value by Holm's correction over all pairs of case and metric
    verdict: Verdict  # better or worse: a significant change of at least `SMALLEST`, or `Metric.fails_from` if smaller
    fails: bool  # worse by `Metric.fails_from` or more; CPU time by a factor above `CPU_FAILS_FROM`


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of the whole corpus with a baseline."""

    changes: tuple[Change, ...]  # in order of cases, then of metrics
    broken: dict[str, Finding]  # by case: error of a drive that did not fail in the baseline
    apart: dict[str, Finding]  # by case: reason why it cannot be compared

    @property
    def failing(self) -> tuple[Change, ...]:
        """Changes that fail."""
        return tuple(change for change in self.changes if change.fails)

    @property
    def passed(self) -> bool:
        """True if no drive is broken and no change fails."""
        return not self.failing and not self.broken


def compare(result: Accuracy, baseline: Baseline) -> Comparison:
    """Compare a result, full or quick, with a baseline on the drives that both contain."""
    broken: dict[str, Finding] = {}
    apart: dict[str, Finding] = {}
    shifts: list[tuple[str, Metric, float, float, Shift]] = []
    for name, current in result.cases.items():
        stored = baseline.cases.get(name)
        if stored is not None and stored.digest != current.digest:
            apart[name] = Finding.of(Code.REGRESSION_OTHER_CASE, subject=name)
            stored = None
        elif stored is None:
            apart[name] = Finding.of(Code.REGRESSION_NEW_CASE, subject=name)
        failed = sorted(current.failures.keys() - (() if stored is None else stored.failures.keys()))
        if failed:
            drive, cause = failed[0], current.failures[failed[0]] or ""
            broken[name] = Finding.of(Code.REGRESSION_BROKEN, subject=name, run=drive, cause=cause)
        if stored is not None:
            shifts += _shifts(name, current, stored)
    adjusted = iter(holm([row[-1].p for row in shifts if row[1].kind != "cpu"]))
    changes = [_change(*row, 1.0 if row[1].kind == "cpu" else float(next(adjusted))) for row in shifts]
    return Comparison(tuple(changes), broken, apart)


def _shifts(name: str, now: CaseResult, then: CaseResult) -> Iterator[tuple[str, Metric, float, float, Shift]]:
    old_values, new_values = then.measured.values, now.measured.values
    for metric in (item for item in METRICS if item.key in old_values and item.key in new_values):
        # a quick run has fewer seeds: the first n are common to both
        n = min(len(old_values[metric.key]), len(new_values[metric.key]))
        old, new = old_values[metric.key][:n], new_values[metric.key][:n]
        known = np.isfinite(old) & np.isfinite(new)
        old, new = old[known], new[known]
        change = _cpu(old, new) if metric.kind == "cpu" else shift(old, new, metric, pieces=now.pieces)
        if np.isfinite(change.change):
            yield name, metric, metric.typical(old), metric.typical(new), change


def _cpu(old: FloatArray, new: FloatArray) -> Shift:
    """Compare CPU time by the median ratio over the drives, robust against a busy computer and a slow first call."""
    change = float(np.median(new / old)) - 1.0 if len(old) and (old > 0.0).all() else float("nan")
    few = len(old) < FEWEST
    return Shift(change, -1.0 if few else change, float("inf") if few else change, 1.0)


def _change(case: str, metric: Metric, old: float, new: float, change: Shift, adjusted: float) -> Change:
    if metric.kind == "cpu":
        fails = change.low > CPU_FAILS_FROM - 1.0
        return Change(case, metric, old, new, change, 1.0, "worse" if fails else "same", fails)
    significant = adjusted < ALPHA and abs(change.change) >= min(SMALLEST, metric.fails_from)
    verdict: Verdict = "same" if not significant else "worse" if change.change > 0.0 else "better"
    fails = verdict == "worse" and change.change >= metric.fails_from
    return Change(case, metric, old, new, change, adjusted, verdict, fails)
