"""Bias over a record at rest, in means over parts of several lengths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from insnav.lab.acceptance.figures_of_merit import Stability
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.panels import Curve, Kind, Panel
from insnav.report.series import Clock
from insnav.units import UNITS


def stability_panels(sensors: Sequence[tuple[str, Sequence[Stability], str]]) -> Iterator[Panel]:
    """Draw the means of the parts, less the mean of all.

    `sensors`: name, stabilities from the shortest parts to the longest, and unit.
    """
    clock = Clock.of(sensors[0][1][0].time)
    note = "less the mean of the whole record; the scatter of the means is the bias stability"
    for name, stabilities, unit in sensors:
        middle = stabilities[0].spread.values.mean()
        curves = []
        for place, each in enumerate(stabilities):
            at, values = clock(each.time), (each.spread.values - middle) / UNITS[unit][1]
            shade = (GREY, AXIS_COLOURS["xyz".index(name[-1])], BLACK)[min(place, 2)]
            kinds: tuple[Kind, ...] = ("line", "points") if place and values.size <= 200 else ("line",)
            curves += [Curve(f"means over {each.length:g} s", at, values, shade, kind) for kind in kinds]
        key, title = f"stability_{name.replace(' ', '_')}", f"Bias of {name} at rest"
        yield Panel(key, title, f"{name} [{unit}]", clock.label, tuple(curves), "rest", note)
