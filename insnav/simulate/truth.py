"""Exact motion over the rotating Earth: analytic functions of position and attitude curves.

Nothing is integrated between motion and sensors: velocity, angular rate and specific force are derivatives of the same
curves, which are smooth functions of time. They agree to rounding at every instant. `Truth` is the interface of every
motion. `LevelTruth` has curves of latitude, longitude, height and of roll, pitch, heading. Its curves can be formulas,
as in `straight` and `circle`, which serve tests and the certification of integrators.

`EarthTruth` also represents motion across a pole, with the nose straight up, or inverted. Its position is a curve in
Earth-fixed axes, and its attitude a quaternion relative to these axes: no latitude and no pitch is singular.

`imu_from_truth`, `gps_from_truth` and `reference` measure a motion without errors.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import factorial
from typing import Literal, Protocol

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from insnav import earth
from insnav.attitude import (
    dcm_from_rph,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rph_from_quat,
    wrap_pi,
    wrap_two_pi,
)
from insnav.exceptions import ConfigError
from insnav.spill import by_blocks
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Trajectory

Gravity = Literal["full", "plumb", "linear"]  # gravity model, see `Truth`
Vector = tuple[FloatArray, FloatArray, FloatArray]  # separate components: numpy is twice as fast on contiguous arrays
_LONGEST_PIECE = 0.02  # [s]; five nodes per piece integrate motion up to 15 Hz to 1e-13 of an increment
_FINE = 4.2  # pieces per knot interval above which four nodes suffice: motion is slower than the knots
_CHUNK = 1024  # pieces at a time: the arrays of one chunk fit in the cache
_SLIVER = 1e-9  # a knot closer to a sample time than this needs no separate piece [s]
_SMALL = 1e-3  # squared angle below which the series in `turn_factors` is exact to rounding [rad^2]

Quaternion = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


class Curve(Protocol):
    """Interface of three smooth functions of time, such as position or attitude components.

    Attributes
    ----------
    knots : (m,) array
        Times at which some high derivative jumps [s]; empty if there is none. Quadrature stops there.
    """

    @property
    def knots(self) -> FloatArray:
        """Times at which some high derivative jumps [s]."""
        ...

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate derivative number `order` (0, 1 or 2), ``(n, 3)``, at times `t` ``(n,)`` [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Harmonic:
    """Straight line plus one harmonic: ``offset + rate t + cosine cos(w t) + sine sin(w t)``."""

    # (3,) coefficients, in the unit of the curve (`rate` per second)
    offset: FloatArray
    rate: FloatArray
    cosine: FloatArray
    sine: FloatArray
    omega: float = 0.0  # angular frequency w [rad/s]

    @property
    def knots(self) -> FloatArray:
        """Empty array, as all derivatives are continuous."""
        return np.empty(0)

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate derivative number `order`, ``(n, 3)``, at times `t` ``(n,)`` [s]."""
        t = t[:, None]
        phase = self.omega * t + order * (np.pi / 2)
        value: FloatArray = self.omega**order * (self.cosine * np.cos(phase) + self.sine * np.sin(phase))
        if order == 0:
            value += self.offset + self.rate * t
        elif order == 1:
            value += self.rate
        return value


@dataclass(frozen=True, slots=True)
class Spline:
    """Piecewise polynomial, with coefficients of shape ``(degree + 1, pieces, m)``."""

    polynomials: PPoly

    @property
    def knots(self) -> FloatArray:
        """Times at which the polynomials meet [s]."""
        breaks: FloatArray = self.polynomials.x
        return breaks

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate derivative number `order`, ``(n, m)``, at times `t` ``(n,)`` [s]."""
        return by_blocks(lambda part: self._values(part, order), t)

    def _values(self, t: FloatArray, order: int) -> FloatArray:
        """Evaluate; differentiate only the pieces that contain `t`, as whole derivatives would take much memory."""
        c, x = self.polynomials.c, self.polynomials.x
        first, last = np.searchsorted(x[1:-1], (t.min(), t.max()), side="right")
        part = PPoly.construct_fast(c[:, first : last + 1], x[first : last + 2])
        for _ in range(order):
            part = part.derivative()
        values: FloatArray = part(t)
        return values

    def integral(self) -> Spline:
        """Return the integral, which is zero at the first knot."""
        return Spline(self.polynomials.antiderivative())


def spline_of(basis: BSpline) -> Spline:
    """Convert a B-spline to the polynomials between its knots."""
    breaks = np.unique(basis.t)
    taylor = np.empty((basis.k + 1, breaks.size - 1, *basis.c.shape[1:]))
    for k in range(basis.k + 1):
        taylor[basis.k - k] = basis(breaks[:-1], nu=k) / factorial(k)
    return Spline(PPoly(taylor, breaks))


def spline_through(t: FloatArray, values: FloatArray, degree: int = 7) -> Spline:
    """Interpolate values ``(m, 3)`` by a spline of odd degree, continuous in ``degree - 1`` derivatives."""
    return spline_of(make_interp_spline(t, values, k=degree))


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

    duration: float  # length of the motion [s]
    start: float  # time of the first instant [s]
    # normal gravity: ``full``; ``plumb`` without its north component above the ellipsoid (0.7 ug at 1 km). ``linear``
    # is also linear in height (error 0.5 ug at 1 km). ``plumb`` and ``linear`` are for comparisons with other packages
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
        """Evaluate the motion at times ``(n,)`` [s], in any order. Raises: ConfigError: a time outside the motion."""

    def elapsed(self, time: FloatArray) -> FloatArray:
        """Return the time since `start` ``(n,)`` [s]; refuse a time outside the motion."""
        tau: FloatArray = np.asarray(time, dtype=np.float64) - self.start
        slack = 4.0 * np.spacing(abs(self.start) + self.duration)  # times such as k * 0.01 may round to either side
        if tau.size and not (tau.min() >= -slack and tau.max() <= self.duration + slack):
            where, end = f"{np.min(time):.6f} to {np.max(time):.6f} s", self.start + self.duration
            raise ConfigError("sim.outside_motion", where=where, begin_s=self.start, end_s=end)
        return tau


@dataclass(frozen=True, slots=True)
class LevelTruth(Truth):
    """Motion in latitude, longitude, height and roll, pitch, heading: not at a pole, nor at a pitch of 90 deg."""

    # (3,) latitude [rad], longitude [rad], height [m]: origin of `position`, whose small numbers keep more digits
    origin: FloatArray
    # latitude, longitude [rad], height [m] minus `origin`, over time since `start` [s]; smooth in two derivatives or
    # more
    position: Curve
    # roll, pitch, heading [rad] without jumps, over time since `start` [s]; smooth in at least one derivative
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
        lla[:, 1] = wrap_pi(lla[:, 1])  # the curve may pass 180 deg of longitude
        rph = self.attitude(tau).copy()
        rph[:, 2] = wrap_two_pi(rph[:, 2])
        return Kinematics(lla, np.column_stack(v_n), rph, np.column_stack(w_ib_b), np.column_stack(f_b))


def _sensed(truth: LevelTruth, tau: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Compute angular rate [rad/s] and specific force [m/s^2] in body axes, and velocity North, East, Down [m/s].

    At times since the start [s]: Groves 2013, eq. 2.111 solved for the velocity, eq. 5.53 for the specific force.
    """
    lat, _, height = earth.components(truth.position(tau) + truth.origin)
    d_lat, d_lon, d_height = earth.components(truth.position(tau, 1))
    dd_lat, dd_lon, dd_height = earth.components(truth.position(tau, 2))
    meridian, transverse = earth.radii(lat)
    s, c = np.sin(lat), np.cos(lat)
    # Derivatives of the radii by latitude are 3 k meridian and k transverse (derived from Groves 2013, section 2.4.2).
    k = earth.E2 * s * c / (1.0 - earth.E2 * s * s)
    to_north, to_east = meridian + height, transverse + height
    v_north, v_east, v_down = to_north * d_lat, to_east * c * d_lon, -d_height
    a_north = to_north * dd_lat + (3.0 * k * meridian * d_lat + d_height) * d_lat
    a_east = to_east * (c * dd_lon - s * d_lat * d_lon) + (k * transverse * d_lat + d_height) * c * d_lon
    a_down = -dd_height

    # Earth rate plus transport rate (eq. 2.123, 5.44) from the rates of latitude and longitude. Then 2 w_ie + w_en.
    turn_north, turn_east, turn_down = (earth.OMEGA_EARTH + d_lon) * c, -d_lat, -(earth.OMEGA_EARTH + d_lon) * s
    p_north, p_down = turn_north + earth.OMEGA_EARTH * c, turn_down - earth.OMEGA_EARTH * s
    g_north, g_down = gravity_of(truth.gravity, lat, height)
    f_n = (
        a_north + turn_east * v_down - p_down * v_east - g_north,
        a_east + p_down * v_north - p_north * v_down,
        a_down + p_north * v_east - turn_east * v_north - g_down,
    )

    rph = earth.components(truth.attitude(tau))
    d_roll, d_pitch, d_heading = earth.components(truth.attitude(tau, 1))
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
    north, _, down = earth.components(earth.gravity_n(lat, height if model != "linear" else np.zeros_like(height)))
    if model == "full":
        return north, down
    return np.zeros_like(down), down if model == "plumb" else down * (1.0 - 2.0 * height / earth.A)


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
    position = Harmonic(_ZERO, along / earth.metres_per_unit(lla), _ZERO, _ZERO)
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
    # Coefficients of the position whose derivative is speed * (cos, sin)(heading + turn_rate t).
    radius, sin, cos = speed / turn_rate, math.sin(heading), math.cos(heading)
    cosine, sine = np.array([sin, -cos, 0.0]) * radius, np.array([cos, sin, 0.0]) * radius
    bank = math.atan2(speed * turn_rate, float(earth.gravity_n(lla[0], lla[2])[2]))
    position = Harmonic(_ZERO, _ZERO, cosine / earth.metres_per_unit(lla), sine / earth.metres_per_unit(lla), turn_rate)
    attitude = Harmonic(np.array([bank, 0.0, heading]), np.array([0.0, 0.0, turn_rate]), _ZERO, _ZERO)
    return LevelTruth(np.asarray(lla, dtype=np.float64), position, attitude, duration, start)


def imu_from_truth(truth: Truth, time: FloatArray, sampling: Sampling = "increment") -> ImuData:
    """Measure a motion with a perfect IMU.

    `time` (n + 1,): edges of the sampling intervals [s], strictly increasing: sample i covers ``time[i]`` to
    ``time[i + 1]`` and is stamped with its end. ``instant`` has no intervals: (n,) times. `sampling` {"increment",
    "mean", "instant"}: integral over the interval, mean over it, or value at the instant. Returns: n samples, each
    integrated over its exact floating-point interval. Raises: ConfigError: times outside the motion, not increasing, or
    too few.
    """
    time = np.asarray(time, dtype=np.float64)
    if sampling == "instant":
        kinematics = truth.evaluate(time)
        return ImuData(time, kinematics.w_ib_b, kinematics.f_b, sampling="instant")
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise ConfigError("sim.no_increasing_times", where="time", count=len(time))
    tau = truth.elapsed(time)
    total = integrate(truth, tau)
    if sampling == "mean":
        total /= np.diff(tau)[:, None]
    return ImuData(time[1:], total[:, :3].copy(), total[:, 3:].copy(), sampling=sampling, stamp="end")


def integrate(truth: Truth, edges: FloatArray) -> FloatArray:
    """Integrate angular rate [rad] and specific force [m/s] between successive edges ``(n + 1,)`` [s], ``(n, 6)``.

    Gauss-Legendre quadrature on pieces that end at every edge and every knot, so that derivatives are continuous within
    a piece. The edges count from the start of the motion.
    """
    knots = truth.knots
    breaks = pieces(edges, knots)
    half = 0.5 * np.diff(breaks)
    fine = len(knots) > 1 and 2.0 * half.max() * _FINE < np.median(np.diff(np.unique(knots)))
    abscissae, weights = np.polynomial.legendre.leggauss(4 if fine else 5)
    middle = breaks[:-1] + half
    parts = np.empty((len(half), 6))
    for i in range(0, len(half), _CHUNK):
        part = slice(i, i + _CHUNK)
        nodes = middle[part, None] + half[part, None] * abscissae
        w_ib_b, f_b = truth.sensed(nodes.ravel())
        for column, values in enumerate(w_ib_b + f_b):
            parts[part, column] = half[part] * (values.reshape(nodes.shape) @ weights)
    if len(breaks) == len(edges):  # each interval is one piece
        return parts
    total: FloatArray = np.add.reduceat(parts, np.searchsorted(breaks, edges[:-1]), axis=0)
    return total


def pieces(edges: FloatArray, knots: FloatArray) -> FloatArray:
    """Return the edges, the knots between edges, and further points that limit pieces to `_LONGEST_PIECE`."""
    knots = np.unique(knots[(knots > edges[0]) & (knots < edges[-1])])
    after = np.searchsorted(edges, knots)  # number of the edge after each knot
    separate = np.minimum(edges[after] - knots, knots - edges[after - 1]) > _SLIVER
    breaks = np.union1d(edges, knots[separate])
    count = np.ceil(np.diff(breaks) / _LONGEST_PIECE - 1e-6).astype(np.int64)
    if np.all(count <= 1):
        return breaks
    count = np.maximum(count, 1)
    step = np.repeat(np.diff(breaks) / count, count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    return np.append(np.repeat(breaks[:-1], count) + number * step, breaks[-1])


def reference(truth: Truth, time: FloatArray) -> Trajectory:
    """Sample position, velocity and attitude of the IMU at times ``(n,)`` [s], strictly increasing.

    Raises: ConfigError: times outside the motion.
    """
    kinematics = truth.evaluate(time)
    return Trajectory(np.asarray(time, dtype=np.float64), kinematics.lla, kinematics.v_n, kinematics.rph)


def gps_from_truth(truth: Truth, time: FloatArray, lever_b: FloatArray) -> GpsData:
    """Measure a motion with a perfect receiver at times ``(n,)`` [s]; its antenna is at `lever_b` ``(3,)`` [m].

    Returns: position and velocity of the antenna, v + C_nb (w_eb_b x lever) (Groves 2013, section 14.3.1). The lever
    arm is projected on the tangent plane, with an error of 1e-7 m per metre. Standard deviations are unknown.
    Raises: ConfigError: times outside the motion.
    """
    kinematics = truth.evaluate(time)
    C_nb = dcm_from_rph(kinematics.rph)
    w_eb_n = (C_nb @ kinematics.w_ib_b[:, :, None])[:, :, 0] - earth.earth_rate_n(kinematics.lla[:, 0])
    lever_n = C_nb @ np.asarray(lever_b, dtype=np.float64)
    unknown = np.full((len(kinematics.lla), 3), np.nan)
    return GpsData(
        time=np.asarray(time, dtype=np.float64),
        lla=earth.lla_offset(kinematics.lla, lever_n),
        v_n=kinematics.v_n + np.cross(w_eb_n, lever_n),
        position_sd=unknown,
        velocity_sd=unknown.copy(),
    )


@dataclass(frozen=True, slots=True)
class Turns:
    """Attitude ``q_vb`` of the body b relative to the vehicle v, in sections: a constant attitude, then a rotation."""

    # (m,) start times of the sections [s], increasing; the first is the start of the motion
    edges: FloatArray
    base: FloatArray  # (m, 4) quaternion at the start of each section
    # rotation vector since the start of the section [rad]. At `edges` it returns to zero and its rotation moves into
    # `base`; its derivatives are continuous.
    rotvec: Spline

    @property
    def knots(self) -> FloatArray:
        """Times at which some high derivative jumps [s]."""
        return self.rotvec.knots

    def __call__(self, tau: FloatArray) -> tuple[Quaternion, Vector]:
        """Evaluate attitude and rate at times ``(n,)`` [s].

        Returns: `q_vb` (n,): attitude. `w_vb_b` (n,): rate of the body against the vehicle, body axes [rad/s]: Bortz,
        "A new mathematical formulation for strapdown inertial navigation", IEEE Trans. AES-7 (1971) 61-66, solved for
        the rate.
        """
        section = np.clip(np.searchsorted(self.edges, tau, side="right") - 1, 0, len(self.edges) - 1)
        rotvec, rate = self.rotvec(tau), self.rotvec(tau, 1)
        angle2 = np.einsum("ij,ij->i", rotvec, rotvec)
        cross = np.cross(rotvec, rate)
        first, second = turn_factors(angle2)
        w = rate - first[:, None] * cross + second[:, None] * np.cross(rotvec, cross)
        q = quat_multiply(self.base[section], quat_from_rotvec(rotvec))
        return (q[:, 0], q[:, 1], q[:, 2], q[:, 3]), earth.components(w)


def turn_factors(angle2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute ``(1 - cos a) / a^2`` and ``(a - sin a) / a^3`` from squared angles ``a^2`` ``(n,)`` [rad^2]."""
    safe = np.where(angle2 < _SMALL, 1.0, angle2)
    angle = np.sqrt(safe)
    series = 1 / 6 - angle2 / 120 * (1 - angle2 / 42 * (1 - angle2 / 72))
    first = 0.5 * np.sinc(np.sqrt(angle2) / (2 * np.pi)) ** 2
    return first, np.where(angle2 < _SMALL, series, (angle - np.sin(angle)) / (safe * angle))


@dataclass(frozen=True, slots=True)
class EarthTruth(Truth):
    """Motion in Earth-fixed axes, valid also at the poles and at any pitch."""

    origin: FloatArray  # (3,) origin of `position` [m]
    position: Curve  # position minus `origin` over the time since `start` [m]; smooth in at least two derivatives
    # quaternion ``q_ev`` of the vehicle over the time since `start`, of any length except zero; smooth in at least one
    # derivative. Its direction alone is the attitude, so its four polynomials can be independent.
    attitude: Curve
    turns: Turns | None  # turns of the body in the vehicle; None if it is fixed
    # see `Truth`
    duration: float
    start: float = 0.0
    gravity: Gravity = "full"

    @property
    def knots(self) -> FloatArray:
        turns = [] if self.turns is None else [self.turns.knots]
        return np.concatenate([self.position.knots, self.attitude.knots, *turns])

    def sensed(self, tau: FloatArray) -> tuple[Vector, Vector]:
        """Compute angular rate and specific force, see `Truth`; Groves 2013, section 2.5.5 solved for the force.

        The rate relative to the Earth is ``w = 2 vec(q* (x) q')`` for a unit quaternion. For another length the product
        is divided by the squared length; the part of ``q'`` along ``q`` cancels.
        """
        a, b, c, d = q = _columns(self.attitude(tau))
        da, db, dc, dd = _columns(self.attitude(tau, 1))
        twice = 2.0 / (a * a + b * b + c * c + d * d)
        w_e = turned_back(q, (np.zeros(1), np.zeros(1), np.full(1, earth.OMEGA_EARTH)))
        w = (
            twice * (a * db - b * da - c * dd + d * dc) + w_e[0],
            twice * (a * dc - c * da - d * db + b * dd) + w_e[1],
            twice * (a * dd - d * da - b * dc + c * db) + w_e[2],
        )
        x, y, z = earth.components(self.position(tau) + self.origin)
        vx, vy, _ = earth.components(self.position(tau, 1))
        ax, ay, az = earth.components(self.position(tau, 2))
        gx, gy, gz = gravity_e(x, y, z, self.gravity)
        f = turned_back(q, (ax - 2 * earth.OMEGA_EARTH * vy - gx, ay + 2 * earth.OMEGA_EARTH * vx - gy, az - gz))
        if self.turns is None:
            return w, f
        q_vb, w_vb_b = self.turns(tau)
        x, y, z = turned_back(q_vb, w)
        return (x + w_vb_b[0], y + w_vb_b[1], z + w_vb_b[2]), turned_back(q_vb, f)

    def evaluate(self, time: FloatArray) -> Kinematics:
        """Evaluate the motion; see `Truth`. At a pole the longitude is 0, which defines the heading."""
        tau = self.elapsed(time)
        w_ib_b, f_b = self.sensed(tau)
        lla = earth.lla_from_earth(self.position(tau) + self.origin)
        q_en = earth.quat_earth_from_level(lla)
        q_eb = self.attitude(tau)
        q_eb = q_eb / np.linalg.norm(q_eb, axis=1, keepdims=True)
        if self.turns is not None:
            q_eb = quat_multiply(q_eb, np.column_stack(self.turns(tau)[0]))
        v_n = turned_back(_columns(q_en), earth.components(self.position(tau, 1)))
        rph = rph_from_quat(quat_multiply(quat_conjugate(q_en), q_eb))
        return Kinematics(lla, np.column_stack(v_n), rph, np.column_stack(w_ib_b), np.column_stack(f_b))


def _columns(q: FloatArray) -> Quaternion:
    a, b, c, d = np.ascontiguousarray(q.T)
    return a, b, c, d


def turned_back(q: Quaternion, vector: Vector) -> Vector:
    """Resolve `vector` in body axes: ``C(q)^T @ vector``, for a quaternion of any length (Groves 2013, eq. 2.34)."""
    a, b, c, d = q
    x, y, z = vector
    twice = 2.0 / (a * a + b * b + c * c + d * d)
    # v + 2 u x (u x v - a v) / |q|^2 with u = (b, c, d)
    kx, ky, kz = c * z - d * y - a * x, d * x - b * z - a * y, b * y - c * x - a * z
    return x + twice * (c * kz - d * ky), y + twice * (d * kx - b * kz), z + twice * (b * ky - c * kx)


def gravity_e(x: FloatArray, y: FloatArray, z: FloatArray, gravity: Gravity) -> Vector:
    """Compute gravity including centrifugal acceleration in Earth-fixed axes [m/s^2], at Earth-fixed positions [m]."""
    p, lat, height = earth.geodetic(x, y, z)
    north, down = gravity_of(gravity, lat, height)
    s, c = np.sin(lat), np.cos(lat)
    outward = -c * down - s * north
    along = -s * down + c * north
    outward /= np.maximum(p, 1e-9)  # avoids division by zero: on the axis x and y are zero
    return x * outward, y * outward, along
