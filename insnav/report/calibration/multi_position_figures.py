"""Gravity and turns of a multi-position calibration, before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.lab.multi_position.many_positions import PosesCalibration
from insnav.lab.multi_position.six_positions import POSITIONS, SixPositions
from insnav.report.colours import AXIS_COLOURS, BLUE, GREY, ORANGE, VERMILLION
from insnav.report.style import (
    legend_above,
    logarithmic,
    stacked,
)
from insnav.units import DEG, G0

_MG = 1e-3 * G0


def draw_poses(found: PosesCalibration) -> Figure:
    """Draw the error of gravity in each pose and of each turn to the next."""
    number = np.arange(1, len(found.poses) + 1)
    figure, panels = stacked(
        3,
        f"Calibration by {len(found.poses)} poses: gravity and turns, before and after",
        "left out: each pose and turn by a calibration that has not seen it",
        height=7.6,
    )
    first = "one scale for all axes" if found.counts else "as recorded"
    (before,), (after,), (turns,) = panels
    before.bar(number, found.norm_before / _MG, color=GREY, width=0.7, label=first)
    before.set_ylabel("|f| - g, before [mg]")
    after.bar(number, found.norm_after / _MG, color=BLUE, width=0.7, label="calibrated")
    after.plot(number, found.norm_left_out / _MG, "D", color=ORANGE, markersize=3.5, label="left out")
    after.set_ylabel("|f| - g, after [mg]")
    between = number[:-1] + 0.5
    used = found.turn_used
    for angle, mark, colour, name in (
        (found.turn_before, "s", GREY, first),
        (found.turn_plain, "o", VERMILLION, "without g-sensitivity"),
        (found.turn_after, "o", BLUE, "calibrated"),
        (found.turn_left_out, "D", ORANGE, "left out"),
    ):
        shown = np.maximum(angle[used] / DEG, 1e-4)  # a simulated turn may close exactly
        turns.plot(between[used], shown, mark, color=colour, markersize=3.5, label=name)
    turns.set_yscale("log")
    logarithmic(turns.yaxis)
    turns.set_ylabel("error of turn [deg]")
    turns.set_xlabel("number of the pose; turns between")
    for (panel,) in panels:
        legend_above(panel)
    return figure


def draw_six_positions(found: SixPositions) -> Figure:
    """Draw the error of gravity in the six positions, and what is left across."""
    number = np.arange(len(POSITIONS))
    figure, panels = stacked(
        3,
        "Calibration by six positions: gravity, before and after",
        "bottom: tilt of the positions as measured by the level axes; opposite positions share it",
        height=7.0,
    )
    (before,), (after,), (across,) = panels
    first = "one scale for all axes" if found.counts else "as recorded"
    before.bar(number, found.norm_before / _MG, color=GREY, width=0.6, label=first)
    before.set_ylabel("|f| - g, before [mg]")
    after.bar(number, found.norm_after / _MG, color=BLUE, width=0.6, label="calibrated")
    after.set_ylabel("|f| - g, after [mg]")
    for axis, colour in enumerate(AXIS_COLOURS):
        across.bar(
            number + 0.2 * (axis - 1), found.force_after[:, axis] / _MG, color=colour, width=0.2, label="xyz"[axis]
        )
    across.set_ylabel("f - ideal, after [mg]")
    across.set_xticks(number, [f"{name[0]} {'up' if name.endswith('p') else 'down'}" for name in POSITIONS])
    across.set_xlabel("position")
    for (panel,) in panels:
        legend_above(panel)
    return figure
