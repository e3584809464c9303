"""Exact motion over the rotating Earth: analytic functions of position and attitude curves.

Nothing is integrated between motion and sensors: velocity, angular rate and specific force are derivatives of the same
curves. They agree to rounding at every instant. `Truth` is the interface of every motion. `LevelTruth` has curves of
latitude, longitude, height and of roll, pitch, heading, for use with formulas. `straight` and `circle` use one formula,
for tests and for certifying integrators. `insnav.simulate.earthfixed.EarthTruth` has no singularity at poles or at a
pitch of 90 deg.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.attitude import wrap_pi, wrap_two_pi
from insnav.earth import E2, OMEGA_EARTH, A, components, gravity_n, metres_per_unit, radii
from insnav.exceptions import ConfigError
from insnav.simulate.curves import Curve, Harmonic
from insnav.types import FloatArray

Gravity = Literal["full", "plumb", "linear"]  # see `Truth`
Vector = tuple[FloatArray, FloatArray, FloatArray]  # separate components: numpy is twice as fast on contiguous arrays


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Kinematic state at some instants."""

    lla: FloatArray  # (n, 3) latitude [rad], longitude [rad] in [-pi, pi), ellipsoidal height [m]
    v_n: FloatArray  # (n, 3) velocity North, East, Down [m/s]
    rph: FloatArray  # (n, 3) roll, pitch, heading [rad], heading in [0, 2 pi)
    w_ib_b: FloatArray  # (n, 3) angular rate of the body against inertial space, body axes [rad/s]
    f_b: FloatArray  # (n, 3) specific force, body axes [m/s^2]


class Truth(ABC):
    """A motion known exactly at every instant between `start` and `start` + `duration`."""

    __slots__ = ()

    duration: float  # length [s]
    start: float  # time of the first instant [s]
    # normal gravity: full, or without its north component above the ellipsoid (0.7 ug at 1 km). The third form is also
    # linear in height (error 0.5 ug at 1 km). The latter two serve comparisons with other packages
    gravity: Gravity

    @property
    @abstractmethod
    def knots(self) -> FloatArray:
        """Times since `start` at which some high derivative jumps [s]; quadrature stops there."""

    @abstractmethod
    def sensed(self, tau: FloatArray) -> tuple[Vector, Vector]:
        """Compute inertial angular rate [rad/s] and specific force [m/s^2] in body axes, at times since `start` [s]."""

    @abstractmethod
    def evaluate(self, time: FloatArray) -> Kinematics:
        """Evaluate the motion at times ``(n,)`` [s], in any order.

        Raises: ConfigError: a time outside the motion.
        """

    def elapsed(self, time: FloatArray) -> FloatArray:
        """Return the time since `start` ``(n,)`` [s]; refuse a time outside the motion."""
        tau: FloatArray = np.asarray(time, dtype=np.float64) - self.start
        slack = 4.0 * np.spacing(abs(self.start) + self.duration)  # times such as k * 0.01 may round to either side
        if tau.size and not (tau.min() >= -slack and tau.max() <= self.duration + slack):
            raise ConfigError(
                "sim.outside_motion",
                where=f"{np.min(time):.6f} to {np.max(time):.6f} s",
                begin_s=self.start,
                end_s=self.start + self.duration,
            )
        return tau


@dataclass(frozen=True, slots=True)
class LevelTruth(Truth):
    """Motion in latitude, longitude, height and roll, pitch, heading: not at a pole, nor at a pitch of 90 deg."""

    # (3,) latitude [rad], longitude [rad], height [m], the origin of `position`: small numbers keep digits
    origin: FloatArray
    # latitude [rad], longitude [rad] and height [m] minus `origin`, over the time since `start` [s]; smooth in at least
    # two derivatives
    position: Curve
    # roll, pitch, heading [rad] over the time since `start` [s], heading without jumps; smooth in at least one
    # derivative
    attitude: Curve
    # see `Truth`
    duration: float
    start: float = 0.0
    gravity: Gravity = "full"

    @property
    def knots(self) -> FloatArray:
        return np.concatenate([self.position.knots, self.attitude.knots])

    def sensed(self, tau: FloatArray) -> tuple[Vector, Vector]:
        w_ib_b, f_b, _ = _sensed(self, tau)
        return w_ib_b, f_b

    def evaluate(self, time: FloatArray) -> Kinematics:
        tau = self.elapsed(time)
        w_ib_b, f_b, v_n = _sensed(self, tau)
        lla = self.position(tau) + self.origin
        lla[:, 1] = wrap_pi(lla[:, 1])
        rph = self.attitude(tau).copy()
        rph[:, 2] = wrap_two_pi(rph[:, 2])
        return Kinematics(lla, np.column_stack(v_n), rph, np.column_stack(w_ib_b), np.column_stack(f_b))


def _sensed(truth: LevelTruth, tau: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Compute angular rate [rad/s] and specific force [m/s^2] in body axes, and velocity North, East, Down [m/s].

    At times since the start [s]: Groves 2013, eq. 2.111 solved for the velocity, eq. 5.53 for the specific force.
    """
    lat, _, height = components(truth.position(tau) + truth.origin)
    d_lat, d_lon, d_height = components(truth.position(tau, 1))
    dd_lat, dd_lon, dd_height = components(truth.position(tau, 2))
    meridian, transverse = radii(lat)
    s, c = np.sin(lat), np.cos(lat)
    # d radii / d latitude: (3 k) meridian and k transverse, by differentiating Groves 2013, section 2.4.2.
    k = E2 * s * c / (1.0 - E2 * s * s)
    to_north, to_east = meridian + height, transverse + height
    v_north, v_east, v_down = to_north * d_lat, to_east * c * d_lon, -d_height
    a_north = to_north * dd_lat + (3.0 * k * meridian * d_lat + d_height) * d_lat
    a_east = to_east * (c * dd_lon - s * d_lat * d_lon) + (k * transverse * d_lat + d_height) * c * d_lon
    a_down = -dd_height

    # Earth rate plus transport rate (eq. 2.123, 5.44) in rates of latitude and longitude, and 2 w_ie + w_en.
    turn_north, turn_east, turn_down = (OMEGA_EARTH + d_lon) * c, -d_lat, -(OMEGA_EARTH + d_lon) * s
    p_north, p_down = turn_north + OMEGA_EARTH * c, turn_down - OMEGA_EARTH * s
    g_north, g_down = gravity_of(truth.gravity, lat, height)
    f_n = (
        a_north + turn_east * v_down - p_down * v_east - g_north,
        a_east + p_down * v_north - p_north * v_down,
        a_down + p_north * v_east - turn_east * v_north - g_down,
    )

    rph = components(truth.attitude(tau))
    d_roll, d_pitch, d_heading = components(truth.attitude(tau, 1))
    trig = tuple((np.sin(angle), np.cos(angle)) for angle in rph)
    (s_roll, c_roll), (s_pitch, c_pitch), _ = trig
    w_x, w_y, w_z = to_body(trig, (turn_north, turn_east, turn_down))
    # Rate of the body against the local level, from rates of Euler angles (Groves 2013, section 2.3.1).
    w_ib_b = (
        w_x + d_roll - d_heading * s_pitch,
        w_y + d_pitch * c_roll + d_heading * s_roll * c_pitch,
        w_z - d_pitch * s_roll + d_heading * c_roll * c_pitch,
    )
    return w_ib_b, to_body(trig, f_n), (v_north, v_east, v_down)


def gravity_of(model: Gravity, lat: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute North and Down gravity [m/s^2] by a model of `Truth`, at latitudes [rad] and heights [m]."""
    north, _, down = components(gravity_n(lat, height if model != "linear" else np.zeros_like(height)))
    if model == "full":
        return north, down
    return np.zeros_like(down), down if model == "plumb" else down * (1.0 - 2.0 * height / A)


def to_body(trig: tuple[tuple[FloatArray, FloatArray], ...], vector: Vector) -> Vector:
    """Compute ``C_bn @ vector`` by successive rotations: heading, pitch, roll (Groves 2013, eq. 2.22).

    `trig`: sine and cosine ``(n,)`` of roll, pitch and heading. `vector`: North, East, Down.
    """
    (s_roll, c_roll), (s_pitch, c_pitch), (s_heading, c_heading) = trig
    north, east, down = vector
    ahead = c_heading * north + s_heading * east
    right = c_heading * east - s_heading * north
    x = c_pitch * ahead - s_pitch * down
    below = s_pitch * ahead + c_pitch * down
    return x, c_roll * right + s_roll * below, c_roll * below - s_roll * right


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
    """Build a motion with constant rates of latitude, longitude and height, and constant attitude.

    Due east or west the speed is constant; otherwise the radii change it by parts in 1e5 over 100 km. Zero speed gives
    rest on the rotating Earth.

    `lla` (3,): start: latitude [rad], longitude [rad], height [m]. `speed`, `climb`: horizontal speed at the start, and
    rate of height [m/s]. `heading`, `roll`, `pitch`: heading, equal to the course at the start, and other angles [rad].
    `duration`, `start`: length, and time of the first instant [s].
    """
    along = np.array([speed * math.cos(heading), speed * math.sin(heading), climb])
    position = Harmonic(_ZERO, along / metres_per_unit(lla), _ZERO, _ZERO)
    attitude = Harmonic(np.array([roll, pitch, heading]), _ZERO, _ZERO, _ZERO)
    return LevelTruth(np.asarray(lla, dtype=np.float64), position, attitude, duration, start)


def circle(
    lla: FloatArray, speed: float, turn_rate: float, duration: float, *, heading: float = 0.0, start: float = 0.0
) -> LevelTruth:
    """Build a constant turn at constant height, banked so that a plumb line stays in the plane of symmetry.

    Latitude and longitude are harmonic: a circle of radius ``speed / turn_rate``, as far as its part of the Earth is
    flat. The heading rotates uniformly and equals the course to the same order.

    `lla` (3,): centre: latitude [rad], longitude [rad], height [m]. `speed` [m/s]. `turn_rate`: rate of heading
    [rad/s], positive to the right, not zero. `duration`, `start`: length, and time of the first instant [s]. `heading`:
    at the start [rad].
    Raises: ConfigError: zero turn rate.
    """
    if turn_rate == 0.0:
        raise ConfigError("sim.no_turn_rate", where="turn_rate")
    # Position whose derivative is speed * (cos, sin)(heading + turn_rate t).
    radius, sin, cos = speed / turn_rate, math.sin(heading), math.cos(heading)
    cosine, sine = np.array([sin, -cos, 0.0]) * radius, np.array([cos, sin, 0.0]) * radius
    bank = math.atan2(speed * turn_rate, float(gravity_n(lla[0], lla[2])[2]))
    position = Harmonic(_ZERO, _ZERO, cosine / metres_per_unit(lla), sine / metres_per_unit(lla), turn_rate)
    attitude = Harmonic(np.array([bank, 0.0, heading]), np.array([0.0, 0.0, turn_rate]), _ZERO, _ZERO)
    return LevelTruth(np.asarray(lla, dtype=np.float64), position, attitude, duration, start)
