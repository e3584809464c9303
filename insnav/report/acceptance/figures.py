"""Bias over a record at rest, in means over parts of several lengths."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from insnav.lab.acceptance.figures_of_merit import Stability
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.series import Clock
from insnav.report.style import (
    legend_above,
    line,
    stacked,
)


def draw_stability(sensors: Sequence[tuple[str, Sequence[Stability], tuple[str, float]]]) -> Figure:
    """Draw the means of the parts, less the mean of all.

    `sensors`: name, stabilities from the shortest parts to the longest, and unit with its factor to SI.
    """
    lengths = ", ".join(f"{each.length:g}" for each in sensors[0][1])
    note = f"means over parts of {lengths} s, less that of the whole record; their scatter is the bias stability"
    figure, panels = stacked(len(sensors), "Acceptance: bias at rest", note)
    clock = Clock.of(sensors[0][1][0].time)
    for (axes,), (name, stabilities, (unit, factor)) in zip(panels, sensors, strict=True):
        colour = AXIS_COLOURS["xyz".index(name[-1])]
        middle = stabilities[0].spread.values.mean()
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for place, each in enumerate(stabilities):
            values = (each.spread.values - middle) / factor
            shade = GREY if place == 0 else BLACK if place > 1 else colour
            dots = {"marker": "o", "markersize": 3.5} if place and values.size <= 200 else {}
            line(axes, clock(each.time), values, shade, f"{each.length:g} s", alpha=0.4 if place == 0 else 0.9, **dots)
        axes.set_ylabel(f"{name} [{unit}]")
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure
