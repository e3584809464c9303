"""Horizontal errors of several runs: over time, and how they are distributed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.comparison import Comparison
from insnav.report.comparison.panels import styled
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.style import legend_above, line, stacked


def draw_comparison(found: Comparison) -> Figure:
    """Draw the horizontal error of every solution over time; smoothed ones dashed."""
    figure, ((axes,),) = stacked(1, "Horizontal error against the reference", "dashed: smoothed", height=3.6)
    clock = Clock.of(found.compared[0].errors.time)
    for name, colour, smoothed, each in styled(found):
        time, error = broken_at_gaps(clock(each.time), each.horizontal)
        line(axes, time, error, colour, name, linestyle="--" if smoothed else "-")
    axes.set_xlabel(clock.label)
    axes.set_ylabel("horizontal error [m]")
    legend_above(axes)
    return figure


def draw_distributions(found: Comparison) -> Figure:
    """Draw the share of epochs below each horizontal error, for every solution."""
    figure, ((axes,),) = stacked(1, "Distribution of the horizontal error", "dashed: smoothed", height=3.6)
    for name, colour, smoothed, each in styled(found):
        error = np.sort(each.horizontal)
        line(
            axes,
            error,
            100.0 * np.arange(1, len(error) + 1) / len(error),
            colour,
            name,
            linestyle="--" if smoothed else "-",
        )
    axes.set_xlabel("horizontal error [m]")
    axes.set_ylabel("epochs below [%]")
    legend_above(axes)
    return figure
