"""Rate errors of swept gyros: after the matrix, with the pieces found in them, and after these."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.lab.rate_sweep.method import SweepCalibration
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.style import (
    legend_above,
    stacked,
)
from insnav.types import FloatArray
from insnav.units import DEG


def draw_sweeps(found: SweepCalibration) -> Figure:
    """Draw the error of each gyro over the rate about its axis: left after the matrix, right after the pieces too."""
    figure, panels = stacked(
        3,
        "Rate sweeps: error of each gyro after the matrix (left) and after the piecewise compensation (right)",
        "corrected rate minus rate of the table; diamonds are the borders of the pieces",
        columns=2,
        height=7.4,
    )
    for axis, ((left, right), rows, item) in enumerate(zip(panels, found.own, found.pieces, strict=True)):
        colour, rate = AXIS_COLOURS[axis], found.rate[rows, axis] / DEG
        for panel, error in ((left, found.error_matrix), (right, found.error_map)):
            panel.axhline(0.0, color=GREY, linewidth=0.8)
            panel.plot(rate, error[rows, axis] / DEG, "o", color=colour, markersize=3.5, label="dwells")
            panel.set_ylabel(f"{'xyz'[axis]} error [deg/s]")
        if item is None:
            right.set_title("nothing to compensate", loc="right", fontsize=8.0, color="#444444")
        else:
            left.plot(item.knot / DEG, item.value / DEG, color=BLACK, linewidth=1.0, label="pieces")
            inner = slice(1, -1)
            left.plot(item.knot[inner] / DEG, item.value[inner] / DEG, "D", color=BLACK, markersize=4.0)
        _zero_in_view(right, found.error_map[rows, axis] / DEG)
    legend_above(*(panel for panel, _ in panels))
    for panel in panels[-1]:
        panel.set_xlabel("rate of the table [deg/s]")
    return figure


def _zero_in_view(panel: Axes, error: FloatArray) -> None:
    largest = float(np.nanmax(np.abs(error)))
    if largest > 0.0:
        panel.set_ylim(-1.15 * largest, 1.15 * largest)
