"""Bias over a record at rest, in means over parts of several lengths."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from insnav.lab.acceptance import Stability
from insnav.report.figures.style import AXIS_COLOURS, GREY, Clock, legend_above, line, stacked

_SHADES = (0.35, 0.75, 1.0, 1.0)


def draw_stability(sensors: Sequence[tuple[str, Sequence[Stability], tuple[str, float]]]) -> Figure:
    """Draw the means of the parts, less the mean of all.

    Parameters
    ----------
    sensors : sequence of (str, sequence of Stability, (str, float))
        Name, stabilities from the shortest parts to the longest, and unit with its factor to SI.
    """
    note = "means over equal parts of the record, less that of the whole; the longer the parts the darker"
    figure, panels = stacked(len(sensors), "Bias at rest", note)
    clock = Clock.of(sensors[0][1][0].time)
    for row, (axes,), (name, stabilities, (unit, factor)) in zip(range(len(sensors)), panels, sensors, strict=True):
        colour = AXIS_COLOURS["xyz".index(name[-1])]
        middle = stabilities[0].spread.values.mean()
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for place, each in enumerate(stabilities):
            values = (each.spread.values - middle) / factor
            shade = GREY if place == 0 else colour
            how = {"marker": "o", "markersize": 3.5} if values.size <= 200 and place else {}
            line(
                axes,
                clock(each.time),
                values,
                shade,
                f"{each.length:g} s" if row == 0 else "",
                alpha=_SHADES[min(place, 3)],
                **how,
            )
        axes.set_ylabel(f"{name} [{unit}]")
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure
