"""Bias over a record at rest, in means over parts of several lengths."""

from __future__ import annotations

from collections.abc import Sequence

from insnav.lab.acceptance.figures_of_merit import Stability
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.panels import Curve, Panel
from insnav.report.series import Clock
from insnav.units import UNITS


def stability_panels(sensors: Sequence[tuple[str, Sequence[Stability], str]]) -> tuple[Panel, ...]:
    """Draw the means of the parts, less the mean of all.

    `sensors`: name, stabilities from the shortest parts to the longest, and unit.
    """
    panels = []
    clock = Clock.of(sensors[0][1][0].time)
    for name, stabilities, unit in sensors:
        colour = AXIS_COLOURS["xyz".index(name[-1])]
        middle = stabilities[0].spread.values.mean()
        curves = []
        for place, each in enumerate(stabilities):
            values = (each.spread.values - middle) / UNITS[unit][1]
            shade = GREY if place == 0 else BLACK if place > 1 else colour
            curves.append(Curve(f"means over {each.length:g} s", clock(each.time), values, shade))
            if place and values.size <= 200:
                curves.append(Curve(f"means over {each.length:g} s", clock(each.time), values, shade, "points"))
        panels.append(
            Panel(
                f"stability_{name.replace(' ', '_')}",
                f"Bias of {name} at rest",
                f"{name} [{unit}]",
                clock.label,
                tuple(curves),
                "rest",
                "less the mean of the whole record; the scatter of the means is the bias stability",
            )
        )
    return tuple(panels)
