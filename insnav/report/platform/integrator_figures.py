"""Integrators of the platform: what they do to a straight line and to a sine, and how far apart they end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from insnav.errors.metrics import TrajectoryErrors
from insnav.errors.platform_errors import Convergence
from insnav.gimbal import INTEGRATORS, Integrator, integral
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION
from insnav.report.series import Clock, thinned
from insnav.report.style import (
    blank,
    legend_above,
    stacked,
)
from insnav.types import FloatArray

COLOURS: Mapping[Integrator, str] = {"forward": VERMILLION, "backward": ORANGE, "mean": BLUE, "fourth": GREEN}
_STYLES: Mapping[Integrator, str] = {"forward": "-", "backward": "--", "mean": "-", "fourth": "-"}
_STEPS = 6  # of the straight line: few enough to be seen
_SMALLEST = 1e-9  # of a logarithmic axis [m]: what lies below is rounding


def draw_line() -> Figure:
    """Draw how forward, backward and mean integrate y = 2x, and what each makes of it."""
    figure = blank(8.4, 5.4, "Integrating y = 2x from 0 to 3 in six steps", "left: what is summed up; right: the sums")
    figure.subplots_adjust(wspace=0.28)
    areas, sums = figure.subplots(1, 2)
    x = np.linspace(0.0, 3.0, _STEPS + 1)
    y = 2.0 * x
    areas.fill_between(x, np.append(y[1:], y[-1]), step="post", color=ORANGE, alpha=0.3, label="backward")
    areas.fill_between(x, np.append(y[:-1], y[-2]), step="post", color=VERMILLION, alpha=0.45, label="forward")
    areas.plot(x, y, "o-", color=BLACK, markersize=3.5, label="y = 2x")
    areas.set_xlabel("x")
    areas.set_ylabel("y")
    areas.legend(loc="upper left")
    fine = np.linspace(0.0, 3.0, 200)
    sums.plot(fine, fine**2, color=BLACK, linewidth=3.0, alpha=0.25, label="truth, x²")
    for name, mark in zip(INTEGRATORS, "v^ox", strict=True):
        total = integral(x, y, name)
        label = f"{name}: {total[-1]:.4g}"
        sums.plot(x, total, f"{mark}-", color=COLOURS[name], markersize=5.0, label=label)
    sums.set_xlabel("x")
    sums.set_ylabel("integral from 0 to x")
    sums.legend(loc="upper left", title="at x = 3 (truth 9)")
    return figure


def draw_convergence(found: Sequence[Convergence]) -> Figure:
    """Draw the error of each integrator on y = sin t over the length of its steps."""
    figure = blank(
        7.4,
        5.0,
        "Order of convergence on y = sin t",
        "largest error of the integral from 0 to 5 s; the slope is the order",
    )
    axes = figure.subplots()
    for each in found:
        axes.loglog(
            each.step,
            each.error,
            "o",
            linestyle=_STYLES[each.integrator],
            color=COLOURS[each.integrator],
            markersize=8.0 if each.integrator == "forward" else 4.5,
            label=f"{each.integrator}: {each.order:.2f}",
        )
    axes.set_xticks(found[0].step, [f"{step:.3g}" for step in found[0].step])
    _plain_decades(axes)
    axes.minorticks_off()
    axes.set_xlabel("step [s]")
    axes.set_ylabel("error")
    axes.legend(loc="lower right", title="measured order")
    return figure


def draw_flight_errors(found: Mapping[float, Sequence[TrajectoryErrors]], motion: str) -> Figure:
    """Draw the position error of each integrator against truth, a panel for each sampling rate.

    `found`: by sampling rate [Hz], in the order of `INTEGRATORS`.
    """
    figure, panels = stacked(
        len(found), "Integrators against truth", f"{motion}; horizontal position error", height=1.3 + 2.2 * len(found)
    )
    clock = Clock.of(next(iter(found.values()))[0].time)
    lines = [each.horizontal for errors in found.values() for each in errors]
    for (axes,), (rate, errors) in zip(panels, found.items(), strict=True):
        for name, each in zip(INTEGRATORS, errors, strict=True):
            _log_line(axes, clock(each.time), each.horizontal, name)
        axes.set_ylabel(f"error at {rate:g} Hz [m]")
        _decades(axes, lines)
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure


def draw_differences(differences: Mapping[Integrator, TrajectoryErrors], against: str) -> Figure:
    """Draw how far the integrators are from one of them, or from a reference."""
    figure, panels = stacked(2, "Difference between the integrators", f"horizontal, against {against}", height=5.6)
    clock = Clock.of(next(iter(differences.values())).time)
    sizes = {
        "position [m]": {name: each.horizontal for name, each in differences.items()},
        "velocity [m/s]": {name: speed_of(each) for name, each in differences.items()},
    }
    for (axes,), (label, lines) in zip(panels, sizes.items(), strict=True):
        for name, each in differences.items():
            _log_line(axes, clock(each.time), lines[name], name)
        axes.set_ylabel(label)
        _decades(axes, list(lines.values()))
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure


def speed_of(errors: TrajectoryErrors) -> FloatArray:
    """Size of the horizontal velocity error, (n,) [m/s]."""
    return np.hypot(errors.velocity[:, 0], errors.velocity[:, 1])


def _log_line(axes: Axes, time: FloatArray, size: FloatArray, name: Integrator) -> None:
    wide = 3.0 if name == "forward" else 1.2  # backward lies on forward: both must be seen
    colour = SKY if name == "forward" else COLOURS[name]
    axes.semilogy(*thinned(time, np.maximum(size, _SMALLEST)), _STYLES[name], color=colour, linewidth=wide, label=name)


def _decades(axes: Axes, lines: Sequence[FloatArray]) -> None:
    """Show whole powers of ten that hold what the lines come to, not the zero they start from."""
    tops = [float(line.max()) for line in lines if line.size and line.max() > 0.0]
    if not tops:
        tops = [_SMALLEST]  # they do the same to the last bit, as at rest
    low = 10.0 ** np.floor(np.log10(max(min(tops) / 100.0, _SMALLEST)))
    axes.set_ylim(low, max(100.0 * low, 10.0 ** np.ceil(np.log10(max(tops)))))
    _plain_decades(axes)
    axes.axhline(low, color=GREY, linewidth=0.7)


def _plain_decades(axes: Axes) -> None:
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.minorticks_off()
