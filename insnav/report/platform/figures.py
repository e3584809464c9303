"""The platform: where it went, how fast, how its gyros are torqued, and how its errors swing."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from insnav.earth import ned_offset
from insnav.errors.metrics import distance_and_time
from insnav.errors.platform_errors import PlatformComparison
from insnav.errors.schuler import StaticErrors
from insnav.gimbal import PlatformRun, torquing_rates
from insnav.report.colours import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, VERMILLION
from insnav.report.map_drawing import finish_map, map_figure
from insnav.report.numbers import distance_text
from insnav.report.series import Clock
from insnav.report.style import (
    legend_above,
    line,
    over_time,
    stacked,
)
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG, DEG_PER_H

_HOUR = 3600.0


def draw_platform_track(run: PlatformRun, ref: Trajectory | None) -> Figure:
    """Draw the track of the platform, without its errors and of a reference where there are such, from above."""
    solution = run.solution
    tracks = [("solution", solution, BLUE, 1.4)]
    if run.undisturbed is not solution:
        tracks.insert(0, ("without the platform's errors", run.undisturbed, GREEN, 1.4))
    if ref is not None:
        tracks.insert(0, ("reference", ref, GREY, 3.0))
    origin = solution.lla[0]
    points = [(name, ned_offset(each.lla, origin), colour, width) for name, each, colour, width in tracks]
    every = np.concatenate([ned for _, ned, _, _ in points])
    length, _ = distance_and_time(solution)
    figure, axes = map_figure(
        every[:, 1],
        every[:, 0],
        f"Track of a north-pointing platform, {distance_text(length)}",
        f"start at latitude {np.degrees(origin[0]):.5f}°, longitude {np.degrees(origin[1]):.5f}°; "
        f"integrator {run.integrator}, vertical channel {run.vertical}",
    )
    for name, ned, colour, width in points:
        axes.plot(ned[:, 1], ned[:, 0], color=colour, linewidth=width, label=name)
    finish_map(axes, points[-1][1][:, :2])
    return figure


def draw_platform_velocity(run: PlatformRun) -> Figure:
    """Draw velocity East, North, Up, and the height if it is computed."""
    v_n, rows = run.solution.v_n, [("east [m/s]", 1, 1.0), ("north [m/s]", 0, 1.0), ("up [m/s]", 2, -1.0)]
    computed = run.vertical != "off"
    panels = [
        (label, [("", sign * v_n[:, column], BLUE)], 1e-3) for label, column, sign in rows[: 3 if computed else 2]
    ]
    if computed:
        panels.append(("height [m]", [("", run.solution.lla[:, 2], BLUE)], 0.01))
    note = f"integrator {run.integrator}, vertical channel {run.vertical}"
    return over_time(run.solution.time, panels, "Velocity computed on the platform", note)[0]


def draw_torquing(run: PlatformRun) -> Figure:
    """Draw the rates at which the gyros are torqued, about East, North, Up."""
    rates = torquing_rates(run.solution) / DEG_PER_H
    columns = (("about east [deg/h]", 1, 1.0), ("about north [deg/h]", 0, 1.0), ("about up [deg/h]", 2, -1.0))
    panels = [(label, [("", sign * rates[:, column], BLUE)], 1e-3) for label, column, sign in columns]
    note = "Earth rate plus transport rate, as computed; the Earth turns at 15.041 deg/h"
    return over_time(run.solution.time, panels, "Commanded torquing rates", note)[0]


def draw_platform_errors(run: PlatformRun, theory: StaticErrors | None) -> Figure:
    """Draw what the platform's errors do to position, velocity and to its own attitude."""
    note = "solution minus the same without the platform's errors"
    figure, panels = stacked(3, "Impact of the platform's errors", note + ("; black: closed form" if theory else ""))
    time = run.solution.time
    clock = Clock.of(time)
    position = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    velocity = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    arcmin = DEG / 60.0
    blocks: list[tuple[str, FloatArray, FloatArray | None]] = [
        ("position [m]", position, theory.position if theory else None),
        ("velocity [m/s]", velocity, theory.velocity if theory else None),
        ("tilt [arcmin]", run.tilt / arcmin, theory.tilt / arcmin if theory else None),
    ]
    for (axes,), (label, values, expected) in zip(panels, blocks, strict=True):
        for column, name in enumerate(("north", "east", "down")[: values.shape[1]]):
            line(axes, clock(time), values[:, column], AXIS_COLOURS[column], name, linewidth=1.8)
            if expected is not None:
                line(axes, clock(time), expected[:, column], BLACK, "", linewidth=0.7, linestyle="--")
        axes.set_ylabel(label)
    legend_above(panels[0][0], panels[2][0])
    panels[-1][0].set_xlabel(clock.label)
    return figure


def draw_platform_and_strapdown(
    found: PlatformComparison, theory: StaticErrors | None, motion: str, errors: str
) -> Figure:
    """Draw the position error of a platform and of a strapdown navigator with the same errors."""
    figure, panels = stacked(2 if theory is None else 3, f"Platform and strapdown: {motion}", errors)
    hours = (found.time - found.time[0]) / _HOUR
    both = (("platform", found.platform, BLUE, 2.6, 0.55), ("strapdown", found.strapdown, VERMILLION, 1.2, 1.0))
    for column, ((axes,), axis) in enumerate(zip(panels[:2], ("north", "east"), strict=True)):
        for name, error, colour, width, alpha in both:
            line(axes, hours, error[:, column] / 1000.0, colour, name, linewidth=width, alpha=alpha)
        if theory is not None:
            line(axes, hours, theory.position[:, column] / 1000.0, BLACK, "closed form", linewidth=0.9, linestyle="--")
        axes.set_ylabel(f"{axis} error [km]")
    last = panels[-1][0]
    if theory is not None:
        for name, error, colour, width, alpha in both:
            off = np.hypot(*(error[:, :2] - theory.position).T)
            line(last, hours, off, colour, name, linewidth=width, alpha=alpha)
        last.set_ylabel("difference to closed form [m]")
    if hours[-1] > 12.0:
        last.xaxis.set_major_locator(MultipleLocator(3.0))
    legend_above(panels[0][0])
    last.set_xlabel("time since start [h]")
    return figure
