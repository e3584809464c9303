"""Estimated sensor errors over time, with their standard deviations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.report.colours import AXIS_COLOURS
from insnav.report.series import Clock
from insnav.report.style import (
    band,
    legend_above,
    line,
    stacked,
)
from insnav.types import FloatArray, Run
from insnav.units import DEG_PER_H, G0, PPM

_GROUPS = (
    ("gyro bias", "deg/h", DEG_PER_H, 0),
    ("accelerometer bias", "mg", 1e-3 * G0, 3),
    ("gyro scale factor", "ppm", PPM, 6),
    ("accelerometer scale factor", "ppm", PPM, 9),
)


def draw_sensor_errors(run: Run) -> Figure:
    """Draw the estimated biases and scale factor errors."""
    estimated = run.sensor_errors
    groups = [g for g in _GROUPS if np.isfinite(estimated.value[:, g[3] : g[3] + 3]).any()]
    clock = Clock.of(run.solution.time)
    figure, panels = stacked(
        len(groups), "Estimated sensor errors", "line: estimate; band: ±3 sd", height=1.0 + 2.0 * len(groups)
    )
    time = clock(estimated.time)
    for (axes,), (name, unit_name, unit, first) in zip(panels, groups, strict=True):
        value = estimated.value[:, first : first + 3] / unit
        half = 3.0 * estimated.sd[:, first : first + 3] / unit
        for axis, (label, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
            band(axes, time, value[:, axis], half[:, axis], colour, "")
            line(axes, time, value[:, axis], colour, label)
        _settled_limits(axes, value, half)
        axes.set_ylabel(f"[{unit_name}]")
        axes.set_title(name)
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure


def _settled_limits(axes: Axes, value: FloatArray, half: FloatArray) -> None:
    """Show all of the estimates, and the bands as they are after a fifth of the run."""
    later = len(value) // 5
    low = min(float(np.nanmin(value)), float(np.nanmin((value - half)[later:])))
    high = max(float(np.nanmax(value)), float(np.nanmax((value + half)[later:])))
    margin = 0.05 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)
