"""A way through given points: a smooth line over the ground, driven with the speeds that stand at the points."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator, make_interp_spline

from insnav.earth import ned_offset
from insnav.exceptions import ConfigError
from insnav.simulate.motion.assemble import Commands
from insnav.simulate.motion.kinds import Kind
from insnav.types import FloatArray

_SMOOTHING = 2.0  # time over which a change of acceleration is spread [s]
_FINE = 4001


def way_through(
    lla: FloatArray, speed: FloatArray, spacing: float, vehicle: Kind
) -> tuple[Commands | None, list[ConfigError]]:
    """Make the way through points at even instants `spacing` apart [s], or say what keeps it from being driven.

    Speeds of zero at the first and the last of the points `lla` make a drive from rest to rest. The problems name
    their points.

    Notes
    -----
    The line is a cubic spline through the points over the length of the chords, without curvature at its ends; between
    two points the square of the speed changes evenly with the way, that is at constant acceleration, and the speed over
    time is then smoothed. Heights follow a monotone interpolation: no hill where there is none.
    """
    offset = ned_offset(lla, lla[0])
    chords = np.linalg.norm(np.diff(offset[:, :2], axis=0), axis=1)
    legs = [f"waypoints {i + 1} and {i + 2}" for i in range(len(chords))]
    problems = [ConfigError("sim.same_place", where=legs[i]) for i in np.flatnonzero(chords < 1e-3)]
    both = (speed[:-1] == 0.0) & (speed[1:] == 0.0)
    problems += [ConfigError("sim.no_speed", where=legs[i]) for i in np.flatnonzero(both)]
    acceleration = np.abs(np.diff(speed**2)) / np.maximum(2.0 * chords, 1e-3)
    problems += [
        ConfigError(
            "sim.too_fast_acceleration",
            where=legs[i],
            vehicle=vehicle.name,
            acceleration_m_s2=float(acceleration[i]),
            limit_m_s2=vehicle.forward,
        )
        for i in np.flatnonzero(acceleration > vehicle.forward)
    ]
    problems += [
        ConfigError(
            "sim.too_fast",
            where=f"waypoint {i + 1}",
            vehicle=vehicle.name,
            speed_m_s=float(speed[i]),
            limit_m_s=vehicle.speed,
        )
        for i in np.flatnonzero(speed > vehicle.speed)
    ]
    if problems:
        return None, problems
    chord = np.concatenate([[0.0], np.cumsum(chords)])
    line = make_interp_spline(chord, offset[:, :2], k=3, bc_type="natural") if len(chord) > 2 else None
    fine = np.linspace(0.0, chord[-1], max(_FINE, 20 * len(chord)))
    slope = line(fine, nu=1) if line is not None else np.tile(offset[1, :2] / chord[1], (len(fine), 1))
    bend = line(fine, nu=2) if line is not None else np.zeros_like(slope)
    stretch = np.linalg.norm(slope, axis=1)
    curvature = np.abs(slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]) / stretch**3
    square = np.interp(fine, chord, speed**2)
    sideways = curvature * square
    worst = int(np.argmax(sideways))
    if sideways[worst] > vehicle.sideways:
        number = int(np.searchsorted(chord, fine[worst], side="right"))
        bent = ConfigError(
            "sim.sideways_at_waypoint",
            where=f"near waypoint {number}",
            vehicle=vehicle.name,
            acceleration_m_s2=float(sideways[worst]),
            limit_m_s2=vehicle.sideways,
        )
        return None, [bent]
    # along the line: its length, and the time, exact for constant acceleration between neighbouring instants
    length = np.concatenate([[0.0], np.cumsum(0.5 * (stretch[1:] + stretch[:-1]) * np.diff(fine))])
    v = np.sqrt(square)
    when = np.concatenate([[0.0], np.cumsum(np.diff(length) * 2.0 / np.maximum(v[1:] + v[:-1], 1e-9))])
    count = int(np.ceil((when[-1] + 2.0 * _SMOOTHING) / spacing)) + 1
    t: FloatArray = spacing * np.arange(count, dtype=np.float64)
    # the smoothed speed is even about each instant: the whole way stays as long as it was
    half = max(1, round(0.5 * _SMOOTHING / spacing))
    x = np.arange(-half, half + 1) / (half + 1.0)
    kernel = (1.0 - x**2) ** 4
    pace = np.interp(t - _SMOOTHING, when, v, left=float(v[0]), right=float(v[-1]))
    smooth = np.convolve(np.pad(pace, half, mode="edge"), kernel / kernel.sum(), mode="valid")
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * spacing)])
    travelled -= v[0] * _SMOOTHING
    at = np.interp(travelled, length, fine)
    course = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    rise = PchipInterpolator(chord, lla[:, 2])(at, nu=1) / np.interp(at, fine, stretch)
    heading = np.interp(at, fine, course)
    return Commands(t, smooth, heading, np.arctan(rise), np.zeros_like(t), float(t[-1])), []
