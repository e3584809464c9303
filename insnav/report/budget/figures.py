"""The error budget on one page: growth on linear and on logarithmic axes, the columns, and the error contributions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.errors.budget.error_budget import Budget
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.page import Table
from insnav.report.style import (
    blank,
    logarithmic,
)
from insnav.types import FloatArray

WIDTH = 8.27  # A4 [inch]
_LEFT, _RIGHT = 0.7, 0.22  # margins [inch]
_TOP, _CURVES, _ROW, _NOTE, _GAP = 0.9, 2.75, 0.158, 0.142, 0.5  # heights [inch]
_SHOWN = 5  # families with a line of their own
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)


def horizontal(parts: FloatArray) -> FloatArray:
    """Horizontal position error, the root of N^2 + E^2, of ``(..., 9)`` [m]."""
    return np.hypot(parts[..., 0], parts[..., 1])


def ranked(budget: Budget) -> list[int]:
    """Families by what they make of the horizontal error in the end, the largest first."""
    last = budget.chosen[-1]
    size = horizontal(budget.covariance.parts[last])
    vertical = budget.covariance.parts[last, :, 2]
    return sorted(range(len(budget.families)), key=lambda k: (-size[k], -vertical[k]))


def shares(budget: Budget) -> FloatArray:
    """Part of each family in the variance of the horizontal error in the end, ``(f,)``."""
    square = horizontal(budget.covariance.parts[budget.chosen[-1]]) ** 2
    whole = float(square.sum())
    return np.asarray(square / whole if whole > 0.0 else square)


def draw_budget(budget: Budget, title: str, note: str, columns: Table, sources: Table, notes: Sequence[str]) -> Figure:
    """Draw the page.

    `sources`: what each family does, in the order of `ranked`, sums below; the share is drawn as a bar behind the last
    column.
    """
    heights = [_CURVES, _ROW * (len(columns.rows) + 3), _ROW * (len(sources.rows) + 3), _NOTE * (len(notes) + 2)]
    height = _TOP + sum(heights) + _GAP + 0.2
    figure = blank(WIDTH, height, title, note)
    width = WIDTH - _LEFT - _RIGHT
    low = height - _TOP - _CURVES

    def place(left: float, wide: float, bottom: float, high: float) -> Axes:
        return figure.add_axes((left / WIDTH, bottom / height, wide / WIDTH, high / height))

    linear = place(_LEFT, 0.43 * width, low, _CURVES - 0.15)
    growth = place(_LEFT + 0.56 * width, 0.44 * width, low, _CURVES - 0.15)
    _draw_linear(linear, budget)
    _draw_growth(growth, budget)
    low -= _GAP + heights[1]
    _write_table(place(0.2, WIDTH - 0.4, low, heights[1]), columns, (1.0,) + (1.15,) * (len(columns.columns) - 1))
    low -= heights[2]
    widths = (3.2, 2.5, *(1.35,) * (len(sources.columns) - 3), 2.6)
    _write_table(place(0.2, WIDTH - 0.4, low, heights[2]), sources, widths, shares(budget)[ranked(budget)])
    low -= heights[3]
    _write_notes(place(0.2, WIDTH - 0.4, low, heights[3]), notes)
    return figure


def _draw_linear(axes: Axes, budget: Budget) -> None:
    """Horizontal error over time: analytic, covariance, simulated, recorded; shaded up to the worst-case sum."""
    time, whole = budget.time, budget.covariance
    sd, worst = horizontal(whole.total), budget.worst[:, 3]
    axes.fill_between(time, sd, worst, color=SKY, alpha=0.25, linewidth=0.0, label="up to the worst-case sum")
    axes.plot(time, sd, color=BLACK, linewidth=1.8, label="covariance, 1 sd")
    axes.plot(time, horizontal(budget.analytic.total), color=BLUE, linewidth=1.4, linestyle="--", label="analytic")
    _mark_measured(axes, budget)
    axes.set_xlim(0.0, 1.03 * time[-1])
    axes.set_ylim(0.0, 1.08 * float(worst[-1]))
    axes.set_xlabel("time without aiding [s]")
    axes.set_ylabel("horizontal position error [m]")
    axes.legend(loc="upper left", fontsize=7.5)
    axes.set_title("all sources together")


def _mark_measured(axes: Axes, budget: Budget) -> None:
    """Marks of what was simulated and recorded."""
    simulated, recorded = budget.simulated, budget.recorded
    if simulated is not None:
        at = budget.chosen
        value = horizontal(simulated.total[at])
        low, high = simulated.band
        # the true sd lies within these bounds with 95 %, were the errors in both axes one
        bars = np.array([value * (1.0 - 1.0 / high), value * (1.0 / low - 1.0)])
        axes.errorbar(
            budget.time[at],
            value,
            bars,
            fmt="o",
            color=VERMILLION,
            markersize=3.5,
            capsize=2.0,
            linewidth=1.0,
            label=f"simulated, {simulated.runs} runs",
        )
    if recorded is not None:
        axes.plot(
            recorded.time,
            recorded.corrected[:, 3],
            "s",
            color=PURPLE,
            markersize=4.0,
            label=f"recorded, {recorded.windows} windows",
        )


def _draw_growth(axes: Axes, budget: Budget) -> None:
    """The same on logarithmic axes, the largest families alone, and how t, t^2 and t^3 grow."""
    time = budget.time
    total = horizontal(budget.covariance.total)
    for colour, k in zip(_COLOURS, ranked(budget)[:_SHOWN], strict=False):
        value = horizontal(budget.covariance.parts[:, k])
        if value[-1] > 0.0:
            axes.plot(time, np.where(value > 0.0, value, np.nan), color=colour, label=budget.families[k])
    axes.plot(time, total, color=BLACK, linewidth=1.8, label="all")
    _mark_measured_plain(axes, budget)
    axes.set_xscale("log")
    axes.set_yscale("log")
    top, left = 2.0 * float(total[-1]), float(time[0])
    bottom = max(min(float(total[0]), 1e-3 * float(total[-1])), 1e-6 * float(total[-1]))
    axes.set_xlim(left, 1.05 * time[-1])
    axes.set_ylim(bottom, top)
    anchor = 0.06 * float(total[-1])
    for power, words in ((1, "t"), (2, "t²"), (3, "t³")):
        guide = anchor * (time / time[-1]) ** power
        axes.plot(time, guide, color=GREY, linewidth=0.8, linestyle=":", zorder=1.0)
        at = int(np.argmin(np.abs(np.log(np.maximum(guide, 1e-300) / (bottom * (top / bottom) ** 0.12)))))
        at = max(at, int(np.searchsorted(time, left * (time[-1] / left) ** 0.06)))
        axes.annotate(words, (time[at], guide[at]), fontsize=8.0, color="#555555", ha="right", va="bottom")
    logarithmic(axes.xaxis)
    logarithmic(axes.yaxis)
    axes.set_xlabel("time without aiding [s]")
    axes.set_ylabel("horizontal position error [m]")
    axes.set_title("by source, 1 sd; dotted: growth with t, t², t³")
    axes.legend(loc="upper left", fontsize=7.0, handlelength=1.4)


def _mark_measured_plain(axes: Axes, budget: Budget) -> None:
    """Marks without bars, which logarithmic axes would make invisible anyway."""
    if budget.simulated is not None:
        value = horizontal(budget.simulated.total[budget.chosen])
        axes.plot(budget.time[budget.chosen], value, "o", color=VERMILLION, markersize=3.0)
    if budget.recorded is not None:
        axes.plot(budget.recorded.time, budget.recorded.corrected[:, 3], "s", color=PURPLE, markersize=3.5)


def _write_table(axes: Axes, table: Table, widths: Sequence[float], bars: FloatArray | None = None) -> None:
    """Write a table into a panel: title, headings, rows; numbers to the right, the first column to the left."""
    axes.set_axis_off()
    count = len(table.rows) + 3
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(count, 0.0)
    edges = np.concatenate([[0.0], np.cumsum(widths) / np.sum(widths)])
    axes.text(0.0, 0.45, table.title, fontsize=9.0, fontweight="bold", va="center")
    axes.plot([0.0, 1.0], [2.05, 2.05], color=GREY, linewidth=0.8)
    for number, row in enumerate((table.columns, *table.rows)):
        y = 1.5 + number + (0.1 if number else 0.0)
        for column, text in enumerate(row):
            first = column == 0
            x = edges[0] if first else edges[column + 1] - 0.004
            style = "#444444" if number == 0 else BLACK
            axes.text(x, y, text, fontsize=7.2, color=style, ha="left" if first else "right", va="center")
        if number % 2:
            axes.axhspan(y - 0.5, y + 0.5, color="#F2F2F2", linewidth=0.0, zorder=0.0)
    if bars is not None:
        under = 2.1 + len(bars)
        axes.plot([0.0, 1.0], [under, under], color=GREY, linewidth=0.8)
        left, wide = edges[-2] + 0.01, 0.6 * (edges[-1] - edges[-2])
        for number, share in enumerate(bars):
            axes.barh(2.6 + number, wide * float(share), height=0.62, left=left, color=SKY, zorder=1.5)


def _write_notes(axes: Axes, notes: Sequence[str]) -> None:
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(notes) + 2, 0.0)
    axes.text(0.0, 0.5, "How to read it, and what was assumed", fontsize=9.0, fontweight="bold", va="center")
    for number, line in enumerate(notes):
        axes.text(0.0, 1.6 + number, line, fontsize=7.2, va="center")
