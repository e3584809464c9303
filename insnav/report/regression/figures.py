"""Accuracy over versions, error growth, predicted against actual error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from scipy.special import stdtrit

from insnav.regression.accuracy_metrics import FAILS_FROM, Metric
from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import GROWTH
from insnav.regression.history import Entry
from insnav.regression.run_corpus import CaseResult
from insnav.report.colours import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, SKY, VERMILLION
from insnav.report.style import blank, legend_above, logarithmic
from insnav.types import FloatArray

_COLUMNS = 4
_TICKS = 5  # versions named below a panel, at most
_GROUPS = (
    ("position", "m", slice(0, 3)),
    ("velocity", "m/s", slice(3, 6)),
    ("roll, pitch, heading", "deg", slice(6, 9)),
)
_AXES = (("north", "east", "down"), ("north", "east", "down"), ("roll", "pitch", "heading"))


def draw_history(history: Sequence[Entry], baseline: Baseline | None, metric: Metric) -> Figure | None:
    """Draw one figure of merit over the versions, a panel for every case."""
    last = history[-1]
    names = [name for name, metrics in last.metrics.items() if metric.key in metrics]
    if not names:
        return None
    figure, panels = _small(
        names,
        f"{metric.label}{f' [{metric.unit}]' if metric.unit else ''}: {len(history)} "
        f"version{'s' * (len(history) > 1)}, {last.origin.version} the last",
        f"with 95 % intervals; grey: the baseline and {100 * FAILS_FROM:g} % about it; triangles: from here on better "
        "(down) or worse (up) than the baseline of its time; breaks: the case had changed",
    )
    for name, axes in zip(names, panels, strict=True):
        _versions(axes, history, name, metric)
        old = None if baseline is None else baseline.cases.get(name)
        if old is not None and old.digest == last.digests.get(name) and metric.key in old.values:
            level = metric.typical(old.values[metric.key])
            axes.axhline(level, color=GREY, linewidth=1.0, linestyle="--", zorder=1.5)
            axes.axhspan((1 - FAILS_FROM) * level, (1 + FAILS_FROM) * level, color=GREY, alpha=0.18, linewidth=0.0)
        low, high = axes.get_ylim()
        axes.set_ylim(max(0.0, low - 0.25 * (high - low)), high + 0.15 * (high - low))
        axes.set_title(name)
    _name_versions(panels, history)
    return figure


def _versions(axes: Axes, history: Sequence[Entry], name: str, metric: Metric) -> None:
    """One case over the versions."""
    unknown = (np.nan, np.nan, np.nan)
    value = np.array([each.metrics.get(name, {}).get(metric.key, unknown) for each in history], dtype=np.float64)
    digests = [each.digests.get(name) for each in history]
    starts = [0, *(i for i in range(1, len(history)) if digests[i] != digests[i - 1]), len(history)]
    place = np.arange(len(history))
    few = len(history) <= 12
    for first, last in pairwise(starts):
        rows = slice(first, last)
        axes.plot(place[rows], value[rows, 0], "o-", color=BLUE, markersize=4.0 if few else 2.0, linewidth=1.0)
        if few:
            size = np.abs(value[rows, 1:] - value[rows, :1]).T
            axes.errorbar(place[rows], value[rows, 0], size, fmt="none", ecolor=BLUE, elinewidth=1.0, capsize=2.5)
        else:
            axes.fill_between(place[rows], value[rows, 1], value[rows, 2], color=BLUE, alpha=0.2, linewidth=0.0)
    for verdict, marker, colour in (("better", "v", GREEN), ("worse", "^", VERMILLION)):
        now_so = [each.verdicts.get(name, {}).get(metric.key) == verdict for each in history]
        begun = [i for i, now in enumerate(now_so) if now and not (i and now_so[i - 1])]
        axes.plot(place[begun], value[begun, 0], marker, color=colour, markersize=6.5, zorder=4.0)


def _name_versions(panels: Sequence[Axes], history: Sequence[Entry]) -> None:
    """Write versions below the panels, where each begins, as many as there is room for."""
    names = [each.origin.version for each in history]
    first = [i for i, name in enumerate(names) if i == 0 or name != names[i - 1]]
    shown = first if len(first) <= _TICKS else [first[k] for k in np.linspace(0, len(first) - 1, _TICKS).astype(int)]
    for axes in panels:
        axes.set_xlim(-0.5, len(history) - 0.5)
        axes.xaxis.set_major_locator(FixedLocator(shown))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: names[min(max(round(value), 0), len(names) - 1)]))


def draw_growth(cases: Mapping[str, CaseResult], baseline: Baseline | None) -> Figure | None:
    """Draw the error without GPS over time, now and in the baseline, a panel for every case."""
    known = {
        name: case for name, case in cases.items() if case.measured is not None and case.measured.growth[:, 0].any()
    }
    if not known:
        return None
    figure, panels = _small(
        list(known),
        "Horizontal error without GPS [m] over time [s]: now and in the baseline",
        "RMS over all windows of all drives of a case; other aiding (NHC, ZUPT) is used where found",
    )
    for (name, case), axes in zip(known.items(), panels, strict=True):
        assert case.measured is not None
        old = None if baseline is None else baseline.cases.get(name)
        if old is not None and old.digest == case.digest:
            axes.plot(GROWTH, _grown(old.growth, 1), "--", color=BLACK, linewidth=1.6, label="baseline")
        axes.plot(GROWTH, _grown(case.measured.growth, 2), color=SKY, linewidth=1.4, label="predicted now")
        axes.plot(GROWTH, _grown(case.measured.growth, 1), "o-", color=BLUE, markersize=3.5, label="now")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(FixedLocator([5.0, 10.0, 20.0, 60.0]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        logarithmic(axes.yaxis)
        axes.set_title(name)
    legend_above(panels[min(_COLUMNS, len(panels)) - 1], lift=1.16)
    return figure


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


def draw_predicted(cases: Mapping[str, CaseResult]) -> Figure | None:
    """Draw the actual error over the predicted standard deviation, with the regression line.

    `cases`: each gives eight points, one a part of its drives, for every axis.
    """
    known = [case.measured.spread for case in cases.values() if case.measured is not None]
    if not known:
        return None
    spread = np.sqrt(np.concatenate(known))
    figure = blank(
        11.4,
        4.7,
        "Actual error against predicted standard deviation",
        "each point: RMS over the drives of a case in an eighth of their time; on the diagonal the filter is "
        "consistent, above it over-confident",
    )
    panels = figure.subplots(1, 3, gridspec_kw={"wspace": 0.3})
    for axes, (title, unit, columns), labels in zip(panels, _GROUPS, _AXES, strict=True):
        part = spread[:, columns]
        for axis, (label, colour) in enumerate(zip(labels, AXIS_COLOURS, strict=True)):
            axes.plot(part[:, axis, 1], part[:, axis, 0], "o", color=colour, markersize=3.0, alpha=0.6, label=label)
        actual, predicted = part[:, :, 0].ravel(), part[:, :, 1].ravel()
        usable = np.isfinite(actual) & np.isfinite(predicted) & (actual > 0.0) & (predicted > 0.0)
        ends = np.array([predicted[usable].min(), predicted[usable].max()]) if usable.any() else np.array([0.1, 1.0])
        axes.plot(ends, ends, color=GREY, linewidth=1.0, label="right")
        line = fitted(predicted[usable], actual[usable])
        if line is not None:
            axes.plot(ends, 10.0**line.offset * ends**line.slope, color=BLACK, linewidth=1.4, label="regression")
            words = f"slope {line.slope:.2f} ({line.low:.2f} to {line.high:.2f})\nR² {line.r2:.2f}, n {usable.sum()}"
            axes.text(0.03, 0.97, words, transform=axes.transAxes, va="top", fontsize=8.0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        logarithmic(axes.xaxis)
        logarithmic(axes.yaxis)
        axes.tick_params(axis="x", labelrotation=60)
        axes.set_title(title)
        axes.set_xlabel(f"predicted sd [{unit}]")
        axes.set_ylabel(f"actual RMS error [{unit}]")
        axes.legend(loc="lower right")
    figure.subplots_adjust(bottom=0.2, left=0.08)
    return figure


def _small(names: Sequence[str], title: str, note: str) -> tuple[Figure, list[Axes]]:
    """Start a figure of small panels."""
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    width, height = 2.85 * columns + 0.4, 1.2 + 1.75 * rows
    figure = blank(max(width, 8.4), height, title, note)
    grid = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"hspace": 0.5, "wspace": 0.28})
    figure.subplots_adjust(left=0.06, bottom=0.45 / height, top=1.0 - 0.95 / height)
    panels = list(grid.flat)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    return figure, panels[: len(names)]
