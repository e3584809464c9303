"""Motions whose position and attitude are one formula: for tests, and for certifying integrators."""

from __future__ import annotations

import math

import numpy as np

from insnav.earth import gravity_n, metres_per_unit
from insnav.exceptions import ConfigError
from insnav.simulate.curves import Harmonic
from insnav.simulate.truth import LevelTruth
from insnav.types import FloatArray

_ZERO = np.zeros(3)


def straight(
    lla: FloatArray,
    speed: float,
    heading: float,
    duration: float,
    *,
    climb: float = 0.0,
    roll: float = 0.0,
    pitch: float = 0.0,
    start: float = 0.0,
) -> LevelTruth:
    """Constant rates of latitude, longitude and height, constant attitude.

    Due east or west the speed is constant; else the radii change it by parts in 1e5 over 100 km. With zero
    speed it is the motion of a thing at rest on the turning Earth.

    `lla` (3,): start: latitude [rad], longitude [rad], height [m]; `speed`, `climb`: horizontal speed at the start, and
    rate of height [m/s]; `heading`, `roll`, `pitch`: heading, which is the course at the start, and the rest of the
    attitude [rad]; `duration`, `start`: length, and time of the first instant [s].
    """
    along = np.array([speed * math.cos(heading), speed * math.sin(heading), climb])
    attitude = Harmonic(np.array([roll, pitch, heading]), _ZERO, _ZERO, _ZERO)
    return LevelTruth(
        np.asarray(lla, dtype=np.float64),
        Harmonic(_ZERO, along / metres_per_unit(lla), _ZERO, _ZERO),
        attitude,
        duration,
        start,
    )


def circle(
    lla: FloatArray,
    speed: float,
    turn_rate: float,
    duration: float,
    *,
    heading: float = 0.0,
    start: float = 0.0,
) -> LevelTruth:
    """Constant turn at constant height, banked so that a plumb line stays in the plane of symmetry.

    Latitude and longitude are harmonic: a circle of radius ``speed / turn_rate`` as far as its part of the
    Earth is flat. The heading turns steadily and is the course to the same order.

    `lla` (3,): centre: latitude [rad], longitude [rad], height [m]; `speed`, `turn_rate` [m/s]; rate of heading
    [rad/s], positive to the right, not zero; `duration`, `start`: length, and time of the first instant [s]; `heading`:
    at the start [rad].
    Raises: ConfigError: no turn.
    """
    if turn_rate == 0.0:
        raise ConfigError("sim.no_turn_rate", where="turn_rate")
    # Position whose derivative is speed * (cos, sin)(heading + turn_rate t).
    radius, sin, cos = speed / turn_rate, math.sin(heading), math.cos(heading)
    cosine, sine = np.array([sin, -cos, 0.0]) * radius, np.array([cos, sin, 0.0]) * radius
    bank = math.atan2(speed * turn_rate, float(gravity_n(lla[0], lla[2])[2]))
    return LevelTruth(
        np.asarray(lla, dtype=np.float64),
        Harmonic(_ZERO, _ZERO, cosine / metres_per_unit(lla), sine / metres_per_unit(lla), turn_rate),
        Harmonic(np.array([bank, 0.0, heading]), np.array([0.0, 0.0, turn_rate]), _ZERO, _ZERO),
        duration,
        start,
    )
