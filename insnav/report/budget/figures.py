"""The error budget on two pages of A4: the result, growth and contributions; tables and assumptions."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.errors.budget.error_budget import Budget
from insnav.errors.budget.from_windows import RecordedPart
from insnav.errors.outage.statistics import COMPONENTS, components
from insnav.report.budget.contributions import horizontal, ranked, saved, shares
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.numbers import number
from insnav.report.page import Table, Verdict
from insnav.report.style import blank, logarithmic

WIDTH, HEIGHT = 8.27, 11.69  # A4 [inch]
_LEFT, _RIGHT = 0.7, 0.25  # margins [inch]
_ROW, _NOTE = 0.158, 0.142  # heights [inch]
_SHOWN = 5  # families with a line of their own
_BARS, _LEAST = 12, 1e-3  # families with a bar of their own: how many, least share of the variance
_LIGHTS = {"good": GREEN, "attention": ORANGE, "bad": VERMILLION, "unknown": GREY}
_WINDOWS = 80  # drawn one by one
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)
_NOTE_WIDTH = 150  # characters in a line of the notes


def draw_front(budget: Budget, part: RecordedPart | None, title: str, verdict: Verdict, estimates: Table) -> Figure:
    """Draw the first page: the result, the four estimates, growth, contributions.

    `part`: recorded windows, if there are any.
    """
    figure = blank(WIDTH, HEIGHT, title, textwrap.fill(f"Motion: {budget.motion}.", 115))
    figure.text(0.2 / WIDTH, 1.0 - 0.8 / HEIGHT, textwrap.fill(verdict.sentence, 84), va="top", fontsize=11.0)
    light = f"{verdict.light}: {verdict.reason}"
    figure.text(0.2 / WIDTH, 1.0 - 1.55 / HEIGHT, light, va="top", fontsize=8.5, color=_LIGHTS[verdict.light])
    place, high, width = _placer(figure), _ROW * (len(estimates.rows) + 3), WIDTH - _LEFT - _RIGHT
    low = HEIGHT - 1.8 - high
    widths = (0.8, *(1.3 if "(" in text else 0.9 for text in estimates.rows[-1][1:]))
    _write_table(place(0.2, WIDTH - 0.4, low, high), estimates, widths)
    _draw_linear(place(_LEFT, width, low - 3.9, 3.4), budget, part)
    _draw_growth(place(_LEFT, 0.45 * width, low - 7.9, 3.2), budget)
    _draw_bars(place(_LEFT + 0.7 * width, 0.3 * width, low - 7.9, 3.2), budget)
    return figure


def draw_back(title: str, tables: Sequence[Table], widths: Sequence[Sequence[float]], notes: Sequence[str]) -> Figure:
    """Draw the second page: tables with the widths of their columns, and how to read them as far as there is room."""
    figure = blank(WIDTH, HEIGHT, title, "")
    place, low = _placer(figure), HEIGHT - 0.5
    for table, wide in zip(tables, widths, strict=True):
        high = _ROW * (len(table.rows) + 3)
        low -= high
        _write_table(place(0.2, WIDTH - 0.4, low, high), table, wide)
    lines = [line for text in notes for line in textwrap.wrap(text, _NOTE_WIDTH, subsequent_indent="   ")]
    room = max(int((low - 0.3) / _NOTE) - 2, 1)
    if len(lines) > room:
        lines = [*lines[: room - 1], "… more in report.html"]
    high = _NOTE * (len(lines) + 2)
    _write_notes(place(0.2, WIDTH - 0.4, low - high, high), lines)
    return figure


def _placer(figure: Figure) -> Callable[[float, float, float, float], Axes]:
    """How to add axes by left edge, width, bottom edge and height [inch]."""

    def place(left: float, wide: float, bottom: float, high: float) -> Axes:
        return figure.add_axes((left / WIDTH, bottom / HEIGHT, wide / WIDTH, high / HEIGHT))

    return place


def _draw_linear(axes: Axes, budget: Budget, part: RecordedPart | None) -> None:
    """Horizontal error over time by all ways, recorded windows behind; shaded up to the worst-case sum."""
    time, whole = budget.time, budget.covariance
    sd, worst = horizontal(whole.total), budget.worst[:, 3]
    top = max(1.25 * float(sd[-1]), 0.0 if part is None else _draw_windows(axes, part))
    axes.fill_between(time, sd, worst, color=SKY, alpha=0.25, linewidth=0.0, label="up to the worst-case sum")
    axes.plot(time, sd, color=BLACK, linewidth=1.8, label="covariance, 1 sd")
    axes.plot(time, horizontal(budget.analytic.total), color=BLUE, linewidth=1.4, linestyle="--", label="analytic")
    _mark_measured(axes, budget)
    axes.set_xlim(0.0, 1.03 * time[-1])
    axes.set_ylim(0.0, min(top, 1.08 * float(worst[-1])) if part is None else top)
    axes.set_xlabel("time without aiding [s]")
    axes.set_ylabel("horizontal position error [m]")
    axes.legend(loc="upper left", fontsize=7.5)
    axes.set_title("all sources together")


def _draw_windows(axes: Axes, part: RecordedPart) -> float:
    """Draw every window, and their RMS with its interval; the top of a view of them."""
    i, windows, curve = COMPONENTS.index("horizontal"), part.windows, part.curve
    error = components(windows)[0][:, :, i]
    for number_, row in enumerate(np.linspace(0, windows.count - 1, min(_WINDOWS, windows.count)).astype(int)):
        label = "" if number_ else "each window"
        axes.plot(windows.elapsed[row], error[row], color=GREY, linewidth=0.5, alpha=0.5, label=label)
    if np.isfinite(curve.low[:, i]).any():
        axes.fill_between(
            curve.times,
            curve.low[:, i],
            curve.high[:, i],
            color=PURPLE,
            alpha=0.3,
            linewidth=0.0,
            label="95 % interval",
        )
    known = np.concatenate([curve.p95[:, i], curve.predicted[:, i]])
    return 1.15 * float(np.nanmax(known))


def _draw_bars(axes: Axes, budget: Budget) -> None:
    """Waterfall of the variance, and what halving each family saves."""
    part, gain = shares(budget), saved(budget)
    shown = [k for k in ranked(budget)[:_BARS] if part[k] > _LEAST]
    end = 100.0 * np.cumsum(part[shown])
    rows = np.arange(len(shown))
    axes.barh(rows, 100.0 * part[shown], left=end - 100.0 * part[shown], color=SKY, height=0.7)
    for row, k in enumerate(shown):
        right = end[row] > 55.0
        text = f"halved: −{number(float(gain[k]), 2)} m"
        place = end[row] - 100.0 * part[k] - 2.0 if right else end[row] + 2.0
        axes.text(place, row, text, va="center", ha="right" if right else "left", fontsize=6.5)
    axes.set_yticks(rows, [budget.families[k] for k in shown], fontsize=7.5)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(0.0, 100.0)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("share of the variance [%]")
    axes.set_title("what it is made of")


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


def _write_table(axes: Axes, table: Table, widths: Sequence[float]) -> None:
    """Write a table into a panel: title, headings, rows; numbers to the right, the first column to the left."""
    axes.set_axis_off()
    count = len(table.rows) + 3
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(count, 0.0)
    edges = np.concatenate([[0.0], np.cumsum(widths) / np.sum(widths)])
    axes.text(0.0, 0.45, table.title, fontsize=9.0, fontweight="bold", va="center")
    axes.plot([0.0, 1.0], [2.05, 2.05], color=GREY, linewidth=0.8)
    for row_number, row in enumerate((table.columns, *table.rows)):
        y = 1.5 + row_number + (0.1 if row_number else 0.0)
        for column, text in enumerate(row):
            first = column == 0
            x = edges[0] if first else edges[column + 1] - 0.004
            style = "#444444" if row_number == 0 else BLACK
            axes.text(x, y, text, fontsize=7.2, color=style, ha="left" if first else "right", va="center")
        if row_number % 2:
            axes.axhspan(y - 0.5, y + 0.5, color="#F2F2F2", linewidth=0.0, zorder=0.0)


def _write_notes(axes: Axes, notes: Sequence[str]) -> None:
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(notes) + 2, 0.0)
    axes.text(0.0, 0.5, "How to read it, and what was assumed", fontsize=9.0, fontweight="bold", va="center")
    for row_number, line in enumerate(notes):
        axes.text(0.0, 1.6 + row_number, line, fontsize=7.2, va="center")
