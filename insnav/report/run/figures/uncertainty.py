"""Standard deviation of the filtered and of the smoothed solution over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.gps_gaps import outages
from insnav.report.colours import BLUE, VERMILLION
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.style import (
    legend_above,
    line,
    logarithmic,
    shade,
    stacked,
)
from insnav.types import FloatArray, Run


def draw_uncertainty(run: Run) -> Figure:
    """Draw the standard deviations of both solutions on logarithmic axes."""
    clock, spans = Clock.of(run.solution.time), outages(run)
    figure, panels = stacked(
        4,
        "Standard deviation of the solution",
        "filtered: from the fixes so far; smoothed (RTS): from all fixes",
    )
    smoothed = [] if run.smoothed is None else [("smoothed", run.smoothed.solution, VERMILLION)]
    for name, solution, colour in (("filtered", run.solution, BLUE), *smoothed):
        if solution.sd is None:
            continue
        time, columns = broken_at_gaps(clock(solution.time), _groups(solution.sd))
        for axis in range(4):
            line(panels[axis][0], time, columns[:, axis], colour, name)
    for (axes,), label in zip(
        panels, ("horizontal [m]", "height [m]", "horizontal velocity [m/s]", "heading [deg]"), strict=True
    ):
        axes.set_yscale("log")
        logarithmic(axes.yaxis)
        shade(axes, clock, spans)
        axes.set_ylabel(label)
    panels[-1][0].set_xlabel(clock.label)
    legend_above(panels[0][0])
    return figure


def _groups(sd: FloatArray) -> FloatArray:
    """Horizontal position [m], height [m], horizontal velocity [m/s], heading [deg]."""
    return np.column_stack((np.hypot(sd[:, 0], sd[:, 1]), sd[:, 2], np.hypot(sd[:, 3], sd[:, 4]), np.degrees(sd[:, 8])))
