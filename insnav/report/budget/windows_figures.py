"""Errors of free-inertial windows: growth and prediction, equivalent errors, recorded over predicted."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.errors.budget.from_windows import RecordedPart
from insnav.errors.diagnosis.causes import CAUSES
from insnav.errors.outage.statistics import COMPONENTS, components
from insnav.report.budget.windows_quantities import GROWS, UNITS
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from insnav.report.style import (
    blank,
    legend_above,
    logarithmic,
    stacked,
)
from insnav.types import FloatArray
from insnav.units import UNITS as FACTORS

_WINDOWS = 80  # drawn one by one
_MARKS = {"static": ("s", GREEN), "straight": ("o", BLUE), "turning": ("^", VERMILLION)}
_GUIDES = (("t", 1.0), ("t²", 2.0), ("t³", 3.0))


def draw_growth(part: RecordedPart, kind: str, reference: str) -> Figure:
    """Draw North, East and horizontal error over the time without fixes, the last also on logarithmic axes."""
    windows, curve = part.windows, part.curve
    figure = blank(
        9.6,
        7.4,
        f"Recorded error without GPS: {windows.count} windows of {windows.length:g} s, {kind}",
        f"against {reference}; thin grey: each window; 95 % bands, of the windows by block bootstrap",
    )
    axes = figure.subplots(2, 2, gridspec_kw={"hspace": 0.34, "wspace": 0.24})
    error = components(windows)[0]
    shown = np.linspace(0, windows.count - 1, min(_WINDOWS, windows.count)).astype(int)
    for panel, name in zip(axes.flat, ("north", "east", "horizontal", "horizontal"), strict=True):
        i = COMPONENTS.index(name)
        for number, row in enumerate(shown):
            values = error[row, :, i]
            panel.plot(
                windows.elapsed[row],
                values,
                color=GREY,
                linewidth=0.5,
                alpha=0.5,
                label="" if number else "each window",
            )
        _curves(panel, part, i, both_sides=name != "horizontal")
        largest = 1.1 * float(np.nanmax([np.nanmax(np.abs(error[:, :, i])), np.nanmax(curve.predicted[:, i])]))
        panel.set_ylim(-largest if name != "horizontal" else 0.0, largest)  # the band of few replicas is wide
        panel.set_ylabel(f"{name} error [m]")
        panel.set_xlabel("time without GPS [s]")
    last = axes[1, 1]
    last.set_xscale("log")
    last.set_yscale("log")
    _guides(last, curve.times, curve.corrected[:, COMPONENTS.index("horizontal")])
    logarithmic(last.xaxis)
    logarithmic(last.yaxis)
    legend_above(axes[0, 1], last)
    return figure


def _curves(panel: Axes, part: RecordedPart, i: int, *, both_sides: bool) -> None:
    """RMS with its interval, predicted, and the band of the replicas; of an axis to both sides of zero."""
    curve = part.curve
    rms = curve.corrected[:, i]
    for sign in (1.0, -1.0) if both_sides else (1.0,):
        first = sign > 0.0
        if part.replicas is not None:
            made = part.replicas
            panel.fill_between(
                made.times,
                sign * made.band[0][:, i],
                sign * made.band[1][:, i],
                color=ORANGE,
                alpha=0.25,
                linewidth=0.0,
                label="simulated replicas" if first else "",
            )
        if np.isfinite(curve.low[:, i]).any():
            panel.fill_between(
                curve.times,
                sign * curve.low[:, i],
                sign * curve.high[:, i],
                color=BLUE,
                alpha=0.25,
                linewidth=0.0,
            )
        panel.plot(curve.times, sign * rms, color=BLUE, linewidth=2.0, label="recorded RMS" if first else "")
        panel.plot(
            curve.times,
            sign * curve.predicted[:, i],
            color=BLACK,
            linewidth=1.4,
            linestyle="--",
            label="predicted sd" if first else "",
        )


def _guides(panel: Axes, times: FloatArray, rms: FloatArray) -> None:
    """Lines of pure t, t² and t³ that end where the error does."""
    end = float(rms[-1])
    if not end > 0.0:
        return
    for label, power in _GUIDES:
        panel.plot(times, end * (times / times[-1]) ** power, color=GREEN, linewidth=0.8, linestyle=":")
        k = max(1, len(times) // 6)
        panel.annotate(
            label,
            (times[k], end * (times[k] / times[-1]) ** power),
            color=GREEN,
            fontsize=8,
            ha="right",
            va="bottom",
        )
    positive = rms[rms > 0.0]
    panel.set_ylim(bottom=max(0.2 * float(positive.min()), 1e-4 * end))


def draw_causes(part: RecordedPart, kind: str) -> Figure:
    """Draw velocity, effective acceleration and drift of each window that was fitted, with the filter's sd."""
    diagnosis = part.diagnosis
    windows = diagnosis.windows
    figure, panels = stacked(
        3,
        f"Equivalent errors of {windows.count} windows, {kind}",
        "fit of t, t², t³ to each window; band: 1 sd of the filter, both axes; "
        + ("at rest or straight" if diagnosis.steady else "turns included, in which no curve is pure"),
        columns=2,
        height=7.0,
    )
    since = windows.start - windows.start[0]
    for column, axis in enumerate(diagnosis.axes):
        value = np.array([curve.value for curve in axis.curves])
        sd = np.array([curve.sd for curve in axis.curves])
        for row, (name, cause) in enumerate(zip(CAUSES, axis.causes, strict=True)):
            panel = panels[row][column]
            text = UNITS[name]
            unit = FACTORS[text][1]
            factor = 1.0 / unit if name != "drift" else 1.0 / unit / diagnosis.gravity
            panel.axhspan(
                -cause.filter_sd / unit, cause.filter_sd / unit, color=GREY, alpha=0.25, linewidth=0.0, label="filter"
            )
            for motion, (mark, colour) in _MARKS.items():
                chosen = windows.motion == motion
                if chosen.any():
                    panel.errorbar(
                        since[chosen],
                        value[chosen, row] * factor,
                        yerr=sd[chosen, row] * factor,
                        fmt=mark,
                        color=colour,
                        markersize=3.5,
                        linewidth=0.8,
                        label=motion,
                    )
            panel.set_ylabel(f"{axis.axis} {name} [{text}]")
            panel.set_title(f"{axis.axis} error grows with {GROWS[name]}")
        panels[-1][column].set_xlabel(f"start of the window, since {windows.start[0]:.1f} s [s]")
    legend_above(panels[0][1])
    return figure


def draw_regression(part: RecordedPart, kind: str) -> Figure:
    """Draw the size of North and East errors over what was predicted for them."""
    line = part.regression
    interval = f" ({line.low:.2f} to {line.high:.2f})" if np.isfinite(line.low) else ""
    figure = blank(
        6.4,
        5.6,
        f"Recorded over predicted error, {kind}",
        f"north and east: {line.slope:.2f} times as large{interval}, R² {line.r_squared:.2f}",
    )
    panel = figure.subplots()
    small = 1e-2 * float(np.median(line.recorded)) if len(line.recorded) else 1e-3
    panel.plot(
        line.predicted,
        np.maximum(line.recorded, small),
        ".",
        color=BLUE,
        markersize=4.0,
        alpha=0.6,
        label="a window at one time",
    )
    ends = np.array([float(line.predicted.min()), float(line.predicted.max())])
    panel.plot(ends, ends, color=BLACK, linestyle="--", label="as predicted")
    panel.plot(ends, line.slope * ends, color=VERMILLION, linewidth=1.8, label="regression")
    if np.isfinite(line.low):
        panel.fill_between(ends, line.low * ends, line.high * ends, color=VERMILLION, alpha=0.2, linewidth=0.0)
    panel.set_xscale("log")
    panel.set_yscale("log")
    logarithmic(panel.xaxis)
    logarithmic(panel.yaxis)
    panel.set_xlabel("predicted sd, reference included [m]")
    panel.set_ylabel("recorded |error| / 0.80 [m]")
    legend_above(panel)
    return figure
