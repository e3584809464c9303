"""The short-duration mechanization against the full one, over the time since both were started."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.short_duration_errors import LENGTH, ShortWindow
from insnav.report.colours import BLACK, BLUE, GREY, ORANGE
from insnav.report.style import (
    legend_above,
    stacked,
)
from insnav.types import FloatArray


def draw_short(windows: Sequence[ShortWindow]) -> Figure:
    """Draw how far the short form is from the full one in every window, and what the dropped terms explain."""
    figure, panels = stacked(
        3,
        f"Short-duration mechanization minus the full one: {len(windows)} windows of {LENGTH:g} s",
        "no Earth and transport rate, velocity by Euler's rule; both free-inertial from the same state",
        height=7.2,
    )
    elapsed = windows[0].elapsed
    blocks = (
        ("horizontal position [m]", "position", "dropped"),
        ("horizontal velocity [m/s]", "velocity", ""),
        ("horizontal position [m]", "untilted", ""),
    )
    for (axes,), (label, name, theory) in zip(panels, blocks, strict=True):
        size = _sizes(windows, name, elapsed)
        for number, each in enumerate(size):
            axes.plot(elapsed, each, color=GREY, linewidth=0.6, alpha=0.6, label="" if number else "each window")
        axes.plot(elapsed, np.sqrt(np.mean(size**2, axis=0)), color=BLUE, linewidth=2.0, label="RMS")
        axes.plot(elapsed, size.max(axis=0), color=ORANGE, linewidth=1.3, label="largest")
        if theory:
            dropped = np.sqrt(np.mean(_sizes(windows, theory, elapsed) ** 2, axis=0))
            axes.plot(elapsed, dropped, color=BLACK, linestyle="--", label="RMS by the dropped terms")
            euler = np.sqrt(np.mean(_sizes(windows, "rest", elapsed) ** 2, axis=0))
            axes.plot(elapsed, euler, color=BLACK, linestyle=":", label="RMS by Euler's rule")
        axes.set_ylabel(label)
    note = "the same, if Earth and transport rate are dropped from the attitude too"
    panels[-1][0].text(0.015, 0.9, note, transform=panels[-1][0].transAxes, va="top")
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel("time since the start of the window [s]")
    return figure


def _sizes(windows: Sequence[ShortWindow], name: str, elapsed: FloatArray) -> FloatArray:
    return np.array(
        [np.interp(elapsed, window.elapsed, np.hypot(*getattr(window, name)[:, :2].T)) for window in windows]
    )
