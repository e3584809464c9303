"""A simulated motion, exactly as it is: its track, and everything that ideal sensors measure of it."""

from __future__ import annotations

import numpy as np

from insnav.attitude import dcm_from_quat
from insnav.earth_fixed import earth_from_lla, quat_earth_from_level
from insnav.report.colours import AXIS_COLOURS, BLUE, GREEN, ORANGE, VERMILLION
from insnav.report.panels import Panel, Shade, Track, over_time
from insnav.report.series import Clock, wrapped
from insnav.simulate.truth import Kinematics
from insnav.types import FloatArray

_AT_REST = 0.01  # largest speed of a motion whose sketch shows rates instead [m/s]


def simulated_track(time: FloatArray, motion: Kinematics, key: str = "track") -> Track:
    """Draw the track at times (n,) [s] seen from above, coloured by speed."""
    north, east = _on_map(motion.lla)
    shade = Shade("speed [m/s]", np.linalg.norm(motion.v_n, axis=1))
    lat, lon = np.degrees(motion.lla[0, :2])
    note = f"start at latitude {lat:.5f}°, longitude {lon:.5f}°, height {motion.lla[0, 2]:.1f} m; exact, without errors"
    return Track(key, "Track", east, north, Clock.of(time)(time), (shade,), "time", note=note)


def motion_panels(time: FloatArray, motion: Kinematics) -> tuple[Panel, ...]:
    """Draw speed, height, attitude, angular rate and specific force over times (n,) [s]."""
    tilt, rate = np.degrees(motion.rph[:, :2]).T, np.degrees(motion.w_ib_b).T
    rows = (
        ("Speed", "speed [m/s]", [("speed", np.linalg.norm(motion.v_n, axis=1), BLUE)], 0.1),
        ("Height", "height [m]", [("height", motion.lla[:, 2], BLUE)], 0.1),
        ("Tilt", "tilt [deg]", [*zip(("roll", "pitch"), tilt, (BLUE, VERMILLION), strict=True)], 0.1),
        ("Heading", "heading [deg]", [("heading", wrapped(np.degrees(motion.rph[:, 2])), GREEN)], 0.1),
        ("Angular rate", "rate [deg/s]", [*zip("xyz", rate, AXIS_COLOURS, strict=True)], 1e-3),
        ("Specific force", "force [m/s²]", [*zip("xyz", motion.f_b.T, AXIS_COLOURS, strict=True)], 1e-2),
    )
    return over_time(time, rows, "body axes x forward, y right, z down; rate against inertial space")


def sketch_panel(time: FloatArray, motion: Kinematics, key: str) -> Panel:
    """Draw the speed over times (n,) [s], of a motion at rest the rate: enough with the track to choose a profile."""
    speed = np.linalg.norm(motion.v_n, axis=1)
    if speed.max() > _AT_REST:
        row = ("Speed", "speed [m/s]", [("speed", speed, ORANGE)], 0.1)
    else:
        rate = np.degrees(np.linalg.norm(motion.w_ib_b, axis=1))
        row = ("Angular rate", "rate [deg/s]", [("rate", rate, ORANGE)], 0.1)
    return over_time(time, [row], link=key)[0]


def track_length(time: FloatArray, motion: Kinematics) -> float:
    """Length of the track [m], by the trapezoidal rule."""
    speed = np.linalg.norm(motion.v_n, axis=1)
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time)))


def _on_map(lla: FloatArray) -> tuple[FloatArray, FloatArray]:
    """North and East of the first place, on the plane that touches the Earth there [m]: no pole is special on it."""
    r_e = earth_from_lla(lla)
    north, east, _ = dcm_from_quat(quat_earth_from_level(lla[:1]))[0].T @ (r_e - r_e[0]).T
    return north, east
