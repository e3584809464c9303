"""How errors grow without GPS, on logarithmic axes, with what the filter predicts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.outage.gnss_outage import Outage
from insnav.errors.outage.statistics import Growth
from insnav.report.colours import BLACK, BLUE, GREY, SKY, VERMILLION
from insnav.report.outage.panels import longest_windows, over_time
from insnav.report.style import (
    legend_above,
    logarithmic,
    stacked,
)


def draw_outages(windows: Sequence[Outage], sums: Sequence[Growth], reference: str) -> Figure:
    """Draw horizontal and vertical error over the time without fixes."""
    chosen = longest_windows(windows)
    figure, panels = stacked(
        2,
        f"Error without GPS: {len(chosen)} windows of {chosen[0].length:g} s",
        f"against {reference}, whose own error is in all lines; smoothed: where predicted largest",
        height=7.2,
    )
    for (axes,), name, columns in zip(panels, ("horizontal", "vertical"), ((0, 1), (2,)), strict=True):
        for number, window in enumerate(chosen):
            size = np.linalg.norm(window.error[:, columns], axis=1)
            axes.plot(window.elapsed, size, color=GREY, linewidth=0.5, alpha=0.5, label="" if number else "each window")
        time, rms, high, predicted = over_time(chosen, columns)
        axes.plot(time, high, color=SKY, linewidth=1.4, label="95 %")
        axes.plot(time, rms, color=BLUE, linewidth=2.0, label="RMS")
        axes.plot(
            time, predicted, color=BLACK, linewidth=1.4, linestyle="--", label="predicted sd, solution and reference"
        )
        axes.plot(
            [each.length for each in sums],
            [each.corrected[-1, each.column(f"smoothed {name}")] for each in sums],
            "o-",
            color=VERMILLION,
            markersize=4.0,
            label="smoothed, RMS corrected",
        )
        axes.set_xscale("log")
        axes.set_yscale("log")
        logarithmic(axes.xaxis)
        logarithmic(axes.yaxis)
        floor = max(float(np.nanmin(rms)) / 10.0, 1e-3)
        axes.set_ylim(bottom=floor)
        axes.set_ylabel(f"{name} error [m]")
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel("time without GPS [s]")
    return figure
