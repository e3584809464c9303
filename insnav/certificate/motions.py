"""Motions in closed form: coning, sculling, a swell, and paths across and around a pole, in Earth-fixed axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import quat_from_dcm, quat_from_rotvec, quat_multiply
from insnav.earth import E2, A
from insnav.simulate import LevelTruth, Truth
from insnav.simulate.truth import EarthTruth, Harmonic
from insnav.types import FloatArray
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class Cone:
    """Coning: the z axis of the body moves around a cone; a rotation vector of constant length turns in the x-y plane.

    References
    ----------
    Savage (1998), part 1, section on coning: the classical test motion; here without approximation for small angles.
    """

    half_angle: float  # length of the rotation vector [rad]
    omega: float  # angular frequency [rad/s]

    def quaternion(self, time: FloatArray) -> FloatArray:
        """Compute the attitude at times ``(n,)`` [s], ``(n, 4)``."""
        c, s, phase = np.cos(0.5 * self.half_angle), np.sin(0.5 * self.half_angle), self.omega * time
        return np.stack([np.full_like(time, c), s * np.cos(phase), s * np.sin(phase), np.zeros_like(time)], -1)

    def angle(self, time: FloatArray) -> FloatArray:
        """Compute the integral of the body rate [rad], twice the vector part of ``q* q'``; ``(n, 3)``."""
        s, phase = np.sin(self.half_angle), self.omega * time
        return np.stack([s * np.cos(phase), s * np.sin(phase), (np.cos(self.half_angle) - 1) * phase], -1)

    def rate(self, time: FloatArray) -> FloatArray:
        """Compute the body rate [rad/s], ``(n, 3)``."""
        s, phase = np.sin(self.half_angle), self.omega * time
        turn = np.stack([-s * np.sin(phase), s * np.cos(phase), np.full_like(time, np.cos(self.half_angle) - 1)], -1)
        return np.asarray(self.omega * turn)


@dataclass(frozen=True, slots=True)
class Scull:
    """Sculling: rotation ``A sin wt`` about x, specific force ``a sin wt`` along y; mean force ``a J1(A)`` along z."""

    amplitude: float  # amplitude of the rotation [rad]
    omega: float  # angular frequency [rad/s]
    force: float  # amplitude of the specific force [m/s^2]

    def rotation(self, time: FloatArray) -> FloatArray:
        """Compute the rotation vector, also the integral of the body rate [rad], ``(n, 3)``."""
        return _column(self.amplitude * np.sin(self.omega * time), 0)

    def impulse(self, time: FloatArray) -> FloatArray:
        """Compute the integral of the sensed specific force [m/s], ``(n, 3)``."""
        return _column(-self.force / self.omega * np.cos(self.omega * time), 1)

    def gained(self, begin: float, end: float) -> float:
        """Compute the velocity gained along z of non-rotating axes [m/s], by quadrature of the exact product."""
        pieces = max(1, round((end - begin) * self.omega))
        node, weight = np.polynomial.legendre.leggauss(8)
        edges = np.linspace(begin, end, pieces + 1)
        t = (edges[:-1, None] + 0.5 * np.diff(edges)[:, None] * (node + 1.0)).ravel()
        values = self.force * np.sin(self.omega * t) * np.sin(self.amplitude * np.sin(self.omega * t))
        return float(0.5 * (end - begin) / pieces * np.sum(values.reshape(pieces, -1) @ weight))


def swell(duration: float, place: FloatArray) -> LevelTruth:
    """Build a motion on a swell about a place: all angles oscillate by degrees while the vehicle follows a wave."""
    swing = np.array([3.0, 2.0, 4.0]) * DEG
    rate, cosine, sine = np.array([2e-6, 3e-6, 0.0]), np.array([0, 0, 0.2]), np.array([2e-7, 0, 0.1])
    attitude = Harmonic(np.array([0.02, -0.01, 0.5]), np.zeros(3), 0.7 * swing, np.roll(swing, 1), 6.0)
    return LevelTruth(place, Harmonic(np.zeros(3), rate, cosine, sine, 2.0), attitude, duration)


def start_of(truth: Truth, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and attitude at the end of the first interval of the edges ``(n + 1,)`` [s]."""
    state = truth.evaluate(time[1:2])
    return state.lla[0], state.v_n[0], state.rph[0]


def even(duration: float, rate: float) -> FloatArray:
    """Return edges of sampling intervals [s]: `duration` [s] at `rate` [Hz]."""
    return np.asarray(np.arange(round(duration * rate) + 1) / rate)


def uneven(duration: float) -> FloatArray:
    """Return edges of sampling intervals of 8 to 11 ms, as from irregular loggers [s].

    A file does not contain the start of its first interval: readers assume the mean length, which is true here.
    """
    steps = np.random.default_rng(4).uniform(0.008, 0.011, round(duration * 120.0))
    steps = steps[np.cumsum(steps) <= duration - 0.011]
    steps[0] = np.mean(steps[1:])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _column(values: FloatArray, axis: int, count: int = 3) -> FloatArray:
    full = np.zeros((values.size, count))
    full[:, axis] = values
    return full


_AXIS = np.array([0.0, 0.0, 1.0])
_X, _Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
_POLAR_RADIUS = A / np.sqrt(1.0 - E2)  # radius of curvature at a pole [m]


@dataclass(frozen=True, slots=True)
class PolarPosition:
    """Point at constant height on an ellipsoid normal that moves around a circle, in Earth-fixed axes [m]."""

    # unit normal: its vectors are orthogonal, cosine and sine have equal length, ``|offset|^2 + |sine|^2 = 1``
    normal: Harmonic
    height: float  # height above the ellipsoid [m]

    @property
    def knots(self) -> FloatArray:
        """Knots: none, as all derivatives are continuous."""
        return self.normal.knots

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate position ``(n, 3)``, or its first or second derivative, ``(n,)`` [s] after the start.

        Groves (2013), eq. 2.112, with the normal instead of latitude and longitude, and its derivatives.
        """
        flat = np.array([1.0, 1.0, 1.0 - E2])
        n0, n1, n2 = (self.normal(t, k) for k in range(3))
        s, ds, dds = n0[:, 2:], n1[:, 2:], n2[:, 2:]
        w2 = 1.0 - E2 * s * s
        radius = A / np.sqrt(w2)
        slope = radius * E2 * s / w2  # first derivative of the radius by s; second derivative: `bend`
        bend = radius * E2 / w2 + 3.0 * slope * E2 * s / w2
        if order == 0:
            return np.asarray(radius * flat * n0 + self.height * n0)
        if order == 1:
            return np.asarray(slope * ds * flat * n0 + radius * flat * n1 + self.height * n1)
        rate = bend * ds * ds + slope * dds
        return np.asarray(rate * flat * n0 + 2.0 * slope * ds * flat * n1 + radius * flat * n2 + self.height * n2)


@dataclass(frozen=True, slots=True)
class PolarAttitude:
    """Attitude in Earth-fixed axes: forward along the circle of the normal, down opposite to it, oscillating roll."""

    normal: Harmonic
    swing: float = 0.0  # amplitude [rad] and angular frequency [rad/s] of the roll
    swing_omega: float = 0.0

    @property
    def knots(self) -> FloatArray:
        """Knots: none, as all derivatives are continuous."""
        return self.normal.knots

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate the quaternion ``(n, 4)``, or its first derivative, ``(n,)`` [s] after the start."""
        start, forward = self.normal(np.zeros(1))[0], self.normal.sine / np.linalg.norm(self.normal.sine)
        at_start = quat_from_dcm(np.column_stack([forward, np.cross(forward, start), -start]))
        # rotation about the axis of the circle, then roll
        axis = np.cross(self.normal.cosine, self.normal.sine)
        axis = self.normal.omega * axis / np.linalg.norm(axis)
        rotated = quat_multiply(quat_from_rotvec(t[:, None] * axis), at_start)
        q = quat_multiply(rotated, quat_from_rotvec(_column(self.swing * np.sin(self.swing_omega * t), 0)))
        if order == 0:
            return q
        rolling = self.swing * self.swing_omega * np.cos(self.swing_omega * t)
        return np.asarray(0.5 * (quat_multiply(np.append(0.0, axis), q) + quat_multiply(q, _column(rolling, 1, 4))))


def polar_truth(
    normal: Harmonic, height: float, duration: float, swing: float = 0.0, swing_omega: float = 0.0
) -> EarthTruth:
    """Build a motion of `duration` [s] at a height [m] on a normal that moves around a circle; see `PolarAttitude`."""
    position, attitude = PolarPosition(normal, height), PolarAttitude(normal, swing, swing_omega)
    return EarthTruth(np.zeros(3), position, attitude, None, duration)


def over_pole(
    speed: float, duration: float, *, height: float = 10e3, miss: float = 0.0, south: bool = False
) -> EarthTruth:
    """Build a great circle that passes the pole at the distance `miss` [m] at half time; roll oscillates by 5 deg.

    `speed` [m/s], `duration` [s], `height` above the ellipsoid [m].
    """
    radius, lon = _POLAR_RADIUS + height, 0.3  # longitude of the start, if `miss` is zero [rad]
    side, ahead = np.array([-np.sin(lon), np.cos(lon), 0.0]), -np.array([np.cos(lon), np.sin(lon), 0.0])
    top = np.cos(miss / radius) * _AXIS * (-1.0 if south else 1.0) + np.sin(miss / radius) * side
    omega = speed / radius
    half = 0.5 * omega * duration
    cosine, sine = np.cos(half) * top - np.sin(half) * ahead, np.sin(half) * top + np.cos(half) * ahead
    return polar_truth(Harmonic(np.zeros(3), np.zeros(3), cosine, sine, omega), height, duration, np.radians(5.0), 2.0)


def around_pole(
    speed: float, radius: float, duration: float, *, height: float = 100.0, south: bool = False
) -> EarthTruth:
    """Build a motion on a parallel of a radius [m] about a pole, eastward, at a speed [m/s] for a time [s]."""
    angle = radius / (_POLAR_RADIUS + height)
    top = np.cos(angle) * _AXIS * (-1.0 if south else 1.0)
    normal = Harmonic(top, np.zeros(3), np.sin(angle) * _X, np.sin(angle) * _Y, speed / radius)
    return polar_truth(normal, height, duration)
