"""Height, velocity and attitude over time, with what their standard deviations promise."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from insnav.errors.gps_gaps import outages
from insnav.report.colours import BLUE, GREY
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.style import (
    band,
    legend_above,
    line,
    shade,
    stacked,
)
from insnav.types import FloatArray, GpsData, Run, Trajectory

_MOST_TURNS = 1.5  # a heading that turns more than this is drawn within 0..360 deg
_NOTE = "band: ±3 sd of the solution; fixes as received, at the antenna"


def draw_height(run: Run, gps: GpsData | None) -> Figure:
    """Draw the height, from where the heights of the fixes are counted."""
    clock = Clock.of(run.solution.time)
    figure, ((axes,),) = stacked(1, "Height of the solution, counted as the heights of the fixes", _NOTE, height=3.4)
    fixes = None if gps is None else (gps.time, gps.lla[:, 2])
    _state(axes, clock, run.solution, run.solution.lla[:, 2], 2, 1.0, fixes)
    shade(axes, clock, outages(run))
    axes.set_ylabel("height [m]")
    axes.set_xlabel(clock.label)
    legend_above(axes)
    return figure


def draw_velocity(run: Run, gps: GpsData | None) -> Figure:
    """Draw the velocity North, East and Down."""
    clock = Clock.of(run.solution.time)
    spans = outages(run)
    figure, panels = stacked(3, "Velocity of the solution", _NOTE)
    for axis, name in enumerate(("north", "east", "down")):
        axes = panels[axis][0]
        known = gps is not None and bool(np.isfinite(gps.v_n[:, axis]).any())
        fixes = (gps.time, gps.v_n[:, axis]) if gps is not None and known else None
        _state(axes, clock, run.solution, run.solution.v_n[:, axis], 3 + axis, 1.0, fixes)
        shade(axes, clock, spans)
        axes.set_ylabel(f"{name} [m/s]")
    panels[-1][0].set_xlabel(clock.label)
    legend_above(panels[0][0])
    return figure


def draw_attitude(run: Run) -> Figure:
    """Draw roll, pitch and heading."""
    solution = run.solution
    clock = Clock.of(solution.time)
    spans = outages(run)
    figure, panels = stacked(3, "Attitude of the solution", "band: ±3 sd")
    degrees = np.degrees(solution.rph)
    degrees[:, 2], unwrapped = readable_heading(solution.rph[:, 2])
    for axis, name in enumerate(("roll", "pitch", "heading")):
        axes = panels[axis][0]
        _state(axes, clock, solution, degrees[:, axis], 6 + axis, 180.0 / np.pi, None)
        shade(axes, clock, spans)
        axes.set_ylabel(f"{name} [deg]")
    heading = panels[2][0]
    if unwrapped:
        heading.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value % 360.0:g}"))
    else:
        heading.set_ylim(-5.0, 365.0)
    heading.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 3, 4.5, 6, 9, 10]))
    heading.set_xlabel(clock.label)
    legend_above(panels[0][0])
    return figure


def _state(
    axes: Axes,
    clock: Clock,
    solution: Trajectory,
    value: FloatArray,
    column: int,
    unit: float,
    fixes: tuple[FloatArray, FloatArray] | None,
) -> None:
    """Draw one state with its band, over the fixes of the same quantity."""
    half = np.full_like(value, np.nan) if solution.sd is None else 3.0 * unit * solution.sd[:, column]
    time, columns = broken_at_gaps(clock(solution.time), np.column_stack((value, half)))
    if fixes is not None:
        axes.plot(clock(fixes[0]), fixes[1], ".", color=GREY, markersize=2.5, label="GPS fix")
    line(axes, time, columns[:, 0], BLUE, "solution")
    # The view is made for the state: a wide band at the start may leave it.
    axes.relim()
    axes.autoscale_view()
    limits = axes.get_ylim()
    middle, spread = 0.5 * (limits[0] + limits[1]), 0.5 * (limits[1] - limits[0])
    typical = float(np.nanmedian(half)) if np.isfinite(half).any() else 0.0
    band(axes, time, columns[:, 0], columns[:, 1], BLUE, "±3 sd")
    axes.set_ylim(middle - spread - 1.2 * typical, middle + spread + 1.2 * typical)


def readable_heading(heading: FloatArray) -> tuple[FloatArray, bool]:
    """Heading in degrees without jumps if it turns little, else within 0..360 with breaks at north."""
    smooth = np.degrees(np.unwrap(heading))
    if np.ptp(smooth) <= 360.0 * _MOST_TURNS:
        return smooth, True
    wrapped = np.degrees(heading) % 360.0
    jumps = np.flatnonzero(np.abs(np.diff(wrapped)) > 180.0)
    wrapped[jumps] = np.nan
    return wrapped, False
