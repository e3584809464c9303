"""An ensemble of runs: errors, the standard deviations that the filter stated, and whether the two agree."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.ensemble import BAND, GROUPS, Ensemble, band, inside
from insnav.report.colours import AXIS_COLOURS, BLUE, GREY, VERMILLION
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.style import (
    blank,
    legend_above,
    line,
    logarithmic,
    stacked,
)
from insnav.types import FloatArray

_LABELS = (
    ("north [m]", "east [m]", "down [m]"),
    ("north [m/s]", "east [m/s]", "down [m/s]"),
    ("roll [deg]", "pitch [deg]", "heading [deg]"),
)
_TITLES = ("position", "velocity", "attitude")


def draw_ensemble(found: Ensemble, runs: int) -> Figure:
    """Draw root mean square error and stated standard deviation of all nine components over time."""
    clock = Clock.of(found.time)
    low, high = (np.sqrt(limit)[:, None] for limit in band(found.count))
    figure = blank(
        11.4,
        7.4,
        f"Errors of {runs} simulated runs, and the sd stated by the filter",
        f"if the filter is right, {100 * BAND:.0f} % of the RMS errors lie within the band about its sd",
    )
    panels = figure.subplots(3, 3, sharex=True, squeeze=False, gridspec_kw={"hspace": 0.14, "wspace": 0.26})
    time, columns = broken_at_gaps(
        clock(found.time), np.column_stack((found.rms, found.sd, low * found.sd, high * found.sd))
    )
    for group, (labels, title) in enumerate(zip(_LABELS, _TITLES, strict=True)):
        unit = 180.0 / np.pi if title == "attitude" else 1.0
        for axis, label in enumerate(labels):
            axes, column = panels[axis][group], 3 * group + axis
            error, sd, least, most = (unit * columns[:, 9 * part + column] for part in range(4))
            axes.fill_between(
                time, least, most, color=BLUE, alpha=0.22, linewidth=0.0, label=f"{100 * BAND:.0f} % band"
            )
            line(axes, time, sd, BLUE, "stated sd")
            line(axes, time, error, VERMILLION, "RMS error")
            axes.set_yscale("log")
            logarithmic(axes.yaxis)
            # by the stated sd: at rest before the start an error may be as good as none
            axes.set_ylim(0.5 * np.nanmin(least), 1.5 * max(np.nanmax(most), np.nanmax(error)))
            axes.set_ylabel(label)
        panels[0][group].set_title(title)
        panels[-1][group].set_xlabel(clock.label)
    legend_above(panels[0][2], lift=1.1)
    return figure


def draw_nees(found: Ensemble) -> Figure:
    """Draw the mean normalised error squared of position, velocity and attitude over time."""
    clock = Clock.of(found.nees_time)
    low, high = band(3 * found.nees_count)
    share = inside(found).mean(axis=0)
    figure, panels = stacked(
        3,
        "Normalised error squared at the fixes, mean over the runs and the three axes",
        f"1 if the stated covariance is right; band: {100 * BAND:.0f} % of the means of a consistent filter",
    )
    time, columns = broken_at_gaps(clock(found.nees_time), np.column_stack((found.nees, low, high)))
    for row, (name, colour) in enumerate(zip(GROUPS, AXIS_COLOURS, strict=True)):
        axes = panels[row][0]
        axes.fill_between(time, columns[:, 3], columns[:, 4], color=GREY, alpha=0.3, linewidth=0.0)
        line(axes, time, columns[:, row], colour, name)
        axes.axhline(1.0, color=GREY, linewidth=0.8)
        axes.set_ylim(0.0, _top(columns[:, row], columns[:, 4]))
        axes.set_ylabel("NEES / 3 [-]")
        axes.set_title(f"{name}: {100.0 * share[row]:.0f} % of the fixes inside the band")
    panels[-1][0].set_xlabel(clock.label)
    return figure


def _top(value: FloatArray, limit: FloatArray) -> float:
    """Upper end of the axis: nearly all values, and the band."""
    known = value[np.isfinite(value)]
    return 1.1 * max(float(np.percentile(known, 99.5)) if known.size else 1.0, float(np.nanmax(limit)))
