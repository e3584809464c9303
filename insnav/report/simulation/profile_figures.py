"""A simulated motion, exactly as it is: its track, and everything that ideal sensors measure of it."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from insnav.attitude import dcm_from_quat
from insnav.earth_fixed import earth_from_lla, quat_earth_from_level
from insnav.report.colours import AXIS_COLOURS, BLUE, GREEN, ORANGE, VERMILLION
from insnav.report.map_drawing import finish_map, map_figure, map_limits
from insnav.report.numbers import distance_text, duration_text
from insnav.report.run.figures.states import readable_heading
from insnav.report.series import Clock
from insnav.report.style import (
    blank,
    line,
    over_time,
    widened,
)
from insnav.simulate.truth import Kinematics
from insnav.types import FloatArray

_TRACK_POINTS = 4000
_AT_REST = 0.01  # largest speed of a motion whose sketch shows rates instead [m/s]


def draw_simulated_track(time: FloatArray, motion: Kinematics, name: str) -> Figure:
    """Draw the track seen from above, coloured by speed.

    `time` (n,) [s].
    """
    step = max(1, len(time) // _TRACK_POINTS)
    rows = np.unique(np.append(np.arange(0, len(time), step), len(time) - 1))
    north, east = _on_map(motion.lla[rows])
    speed = np.linalg.norm(motion.v_n[rows], axis=1)
    lat, lon = np.degrees(motion.lla[0, :2])
    length = distance_text(track_length(time, motion))
    figure, axes = map_figure(
        east,
        north,
        f"Simulated motion {name}: {length} in {duration_text(float(time[-1] - time[0]))}",
        f"start at latitude {lat:.5f}°, longitude {lon:.5f}°, height {motion.lla[0, 2]:.1f} m; exact, without errors",
        beside=0.85,
    )
    points = np.column_stack((east, north))
    pieces = LineCollection(
        list(np.stack((points[:-1], points[1:]), axis=1)), cmap="cividis", linewidth=2.2, capstyle="round", zorder=2
    )
    pieces.set_array(0.5 * (speed[:-1] + speed[1:]))
    pieces.set_clim(0.0, max(float(speed.max()), 0.1))
    axes.add_collection(pieces)
    finish_map(axes, np.column_stack((north, east)))
    figure.colorbar(pieces, ax=axes, label="speed [m/s]", fraction=0.05, pad=0.02)
    return figure


def draw_motion(time: FloatArray, motion: Kinematics, name: str) -> Figure:
    """Draw speed, height, attitude, angular rate and specific force over time.

    `time` (n,) [s].
    """
    tilt, rate = np.degrees(motion.rph[:, :2]).T, np.degrees(motion.w_ib_b).T
    rows = (
        ("speed [m/s]", [("speed", np.linalg.norm(motion.v_n, axis=1), BLUE)], 0.1),
        ("height [m]", [("height", motion.lla[:, 2], BLUE)], 0.1),
        ("tilt [deg]", [*zip(("roll", "pitch"), tilt, (BLUE, VERMILLION), strict=True)], 0.1),
        ("heading [deg]", [("heading", readable_heading(motion.rph[:, 2])[0], GREEN)], 0.1),
        ("rate [deg/s]", [*zip("xyz", rate, AXIS_COLOURS, strict=True)], 1e-3),
        ("force [m/s²]", [*zip("xyz", motion.f_b.T, AXIS_COLOURS, strict=True)], 1e-2),
    )
    figure, panels = over_time(
        time,
        rows,
        f"Simulated motion {name}: what ideal sensors measure",
        "body axes x forward, y right, z down; rate against inertial space; specific force",
        height=10.4,
    )
    panels[3].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value % 360.0:g}"))
    panels[3].yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 3, 4.5, 6, 9, 10]))
    return figure


def draw_sketch(time: FloatArray, motion: Kinematics, name: str, purpose: str) -> Figure:
    """Draw the track and the speed side by side: enough to choose a profile by.

    `time` (n,) [s].
    """
    clock = Clock.of(time)
    figure = blank(8.4, 3.2, name, purpose)
    left, right = figure.subplots(1, 2, gridspec_kw={"wspace": 0.3})
    north, east = _on_map(motion.lla)
    x_limits, y_limits = map_limits(east, north)
    left.set_xlim(*x_limits)
    left.set_ylim(*y_limits)
    left.plot(east, north, color=BLUE)
    left.plot(east[0], north[0], "^", color=GREEN, markersize=9.0, markeredgecolor="white")
    left.set_aspect("equal")
    left.set_xlabel("East [m]")
    left.set_ylabel("North [m]")
    speed = np.linalg.norm(motion.v_n, axis=1)
    if speed.max() > _AT_REST:
        line(right, clock(time), speed, ORANGE, "speed")
        right.set_ylabel("speed [m/s]")
    else:
        line(right, clock(time), np.degrees(np.linalg.norm(motion.w_ib_b, axis=1)), ORANGE, "rate")
        right.set_ylabel("angular rate [deg/s]")
    widened(right, 0.1)
    right.set_xlabel(clock.label)
    return figure


def track_length(time: FloatArray, motion: Kinematics) -> float:
    """Length of the track [m], by the trapezoidal rule."""
    speed = np.linalg.norm(motion.v_n, axis=1)
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time)))


def _on_map(lla: FloatArray) -> tuple[FloatArray, FloatArray]:
    """North and East of the first place, on the plane that touches the Earth there [m]: no pole is special on it."""
    r_e = earth_from_lla(lla)
    north, east, _ = dcm_from_quat(quat_earth_from_level(lla[:1]))[0].T @ (r_e - r_e[0]).T
    return north, east
