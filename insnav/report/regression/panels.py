"""Accuracy over versions, error growth, predicted against actual error: a panel for every case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from insnav.regression.accuracy_metrics import FAILS_FROM, Metric
from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import GROWTH
from insnav.regression.history import Entry
from insnav.regression.run_corpus import CaseResult
from insnav.report.colours import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, SKY, VERMILLION
from insnav.report.panels import Curve, Panel
from insnav.report.run.panels import GROUPS
from insnav.types import BoolArray, FloatArray

COLUMNS = 4  # of panels side by side
_TICKS = 5  # versions named below a panel, at most


def history_panels(history: Sequence[Entry], baseline: Baseline | None, metric: Metric) -> list[Panel]:
    """Draw one figure of merit over the versions, with its interval and the baseline."""
    last, place = history[-1], np.arange(len(history), dtype=np.float64)
    versions = [each.origin.version for each in history]
    first = [i for i, name in enumerate(versions) if i == 0 or name != versions[i - 1]]
    shown = first if len(first) <= _TICKS else [first[k] for k in np.linspace(0, len(first) - 1, _TICKS).astype(int)]
    ticks, ends = tuple((float(i), versions[i]) for i in shown), np.array([-0.5, len(history) - 0.5])
    panels = []
    for name, metrics in last.metrics.items():
        if metric.key not in metrics:
            continue
        curves = _versions(history, place, name, metric)
        old = None if baseline is None else baseline.cases.get(name)
        if old is not None and old.digest == last.digests.get(name) and metric.key in old.measured.values:
            level = np.full(2, metric.typical(old.measured.values[metric.key]))
            curves.insert(0, Curve("", ends, (1 + FAILS_FROM) * level, GREY, "band", (1 - FAILS_FROM) * level))
            curves.append(Curve("", ends, level, GREY, "dashed"))
        seen = np.concatenate([edge for each in curves for edge in (each.y, each.y if each.low is None else each.low)])
        low, high = float(np.nanmin(seen)), float(np.nanmax(seen))
        span = high - low or abs(high) or 1.0
        limits = max(0.0, low - 0.25 * span), high + 0.15 * span
        panels.append(
            Panel(name, name, "", "version", tuple(curves), "versions", limits=limits, ticks=ticks, height=135)
        )
    return panels


def _versions(history: Sequence[Entry], place: FloatArray, name: str, metric: Metric) -> list[Curve]:
    """One case over the versions, broken where it had changed; where it became better or worse than the baseline."""
    unknown = (np.nan, np.nan, np.nan)
    value = np.array([each.metrics.get(name, {}).get(metric.key, unknown) for each in history], dtype=np.float64)
    digests = [each.digests.get(name) for each in history]
    starts = [0, *(i for i in range(1, len(history)) if digests[i] != digests[i - 1]), len(history)]
    curves = []
    for start, end in pairwise(starts):
        at, (middle, low, high) = place[start:end], value[start:end].T
        bars = np.column_stack((low, high, np.full(len(at), np.nan))).ravel()
        curves.append(Curve("", np.repeat(at, 3), bars, BLUE, "thin"))
        curves += [Curve("", at, middle, BLUE, "line"), Curve("", at, middle, BLUE, "points")]
    for verdict, colour in (("better", GREEN), ("worse", VERMILLION)):
        now_so = [each.verdicts.get(name, {}).get(metric.key) == verdict for each in history]
        begun = [i for i, now in enumerate(now_so) if now and not (i and now_so[i - 1])]
        curves.append(Curve("", place[begun], value[begun, 0], colour, "crosses"))
    return curves


def growth_panels(cases: Mapping[str, CaseResult], baseline: Baseline | None) -> list[Panel]:
    """Draw the error without GPS over time, now and in the baseline."""
    panels: list[Panel] = []
    for name, case in cases.items():
        if not case.measured.growth[:, 0].any():
            continue
        old = None if baseline is None else baseline.cases.get(name)
        grown = [("predicted now", case.measured.growth, 2, SKY), ("now", case.measured.growth, 1, BLUE)]
        if old is not None and old.digest == case.digest:
            grown.append(("baseline", old.measured.growth, 1, BLACK))
        curves = tuple(  # named in the first panel alone
            Curve(
                "" if panels else each, np.array(GROWTH), _grown(of, i), colour, "dashed" if colour == BLACK else "line"
            )
            for each, of, i, colour in grown
        )
        panels.append(Panel(name, name, "error [m]", "time without GPS [s]", curves, "growth", log_x=True, log_y=True))
    return panels


def _grown(growth: FloatArray, column: int) -> FloatArray:
    count = growth[:, 0]
    return np.sqrt(np.where(count > 0, growth[:, column] / np.maximum(count, 1.0), np.nan))


@dataclass(frozen=True, slots=True)
class Line:
    """Straight line through logarithms: exponent with its 95 % interval, value at the middle, coefficient R²."""

    slope: float
    low: float
    high: float
    offset: float
    r2: float


def fitted(predicted: FloatArray, actual: FloatArray) -> Line | None:
    """Regress the logarithm of the actual error on that of the predicted one, by least squares.

    `predicted`, `actual` (n,): above zero.
    """
    if len(predicted) < 3:
        return None
    x, y = np.log10(predicted), np.log10(actual)
    dx, dy = x - x.mean(), y - y.mean()
    total = float(dx @ dx)
    if total == 0.0:
        return None
    slope = float(dx @ dy) / total
    rest = dy - slope * dx
    degrees = len(x) - 2
    half = float(stdtrit(degrees, 0.975)) * float(np.sqrt(rest @ rest / degrees / total))
    spread = float(dy @ dy)
    r2 = 1.0 - float(rest @ rest) / spread if spread > 0.0 else 0.0
    return Line(slope, slope - half, slope + half, float(y.mean() - slope * x.mean()), r2)


def predicted_panels(cases: Mapping[str, CaseResult]) -> list[Panel]:
    """Draw the actual error over the predicted standard deviation, with the regression line.

    `cases`: each gives eight points, one a part of its drives, for every axis.
    """
    known = [case.measured.spread for case in cases.values() if case.measured.values]
    panels = []
    for i, (title, unit, _, names) in enumerate(GROUPS if known else ()):
        part = np.sqrt(np.concatenate(known))[:, 3 * i : 3 * i + 3]
        usable: BoolArray = np.logical_and.reduce(np.isfinite(part) & (part > 0.0), axis=2)
        predicted = part[:, :, 1][usable]
        ends = np.array([predicted.min(), predicted.max()]) if usable.any() else np.array([0.1, 1.0])
        curves = [
            Curve(name, part[usable[:, k], k, 1], part[usable[:, k], k, 0], colour, "points")
            for k, (name, colour) in enumerate(zip(names, AXIS_COLOURS, strict=True))
        ]
        line, head = fitted(predicted, part[:, :, 0][usable]), title
        curves.append(Curve("right", ends, ends, GREY))
        if line is not None:
            curves.append(Curve("regression", ends, 10.0**line.offset * ends**line.slope, BLACK))
            head = f"{title}: slope {line.slope:.2f} ({line.low:.2f} to {line.high:.2f}), R² {line.r2:.2f}"
        labels = f"actual RMS error [{unit}]", f"predicted sd [{unit}], n {len(predicted)}"
        panels.append(Panel(title, head, *labels, tuple(curves), log_x=True, log_y=True, height=330))
    return panels
