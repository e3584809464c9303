"""Motions of the body whose samples and whose outcome are one formula: coning, sculling, a swell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.simulate import LevelTruth, Truth
from insnav.simulate.curves import Harmonic
from insnav.types import FloatArray
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class Cone:
    """The body's third axis runs round a cone: a rotation vector of constant length turns in the x-y plane.

    References
    ----------
    Savage (1998), part 1, section on coning: the classical test motion; here without approximation for small angles.
    """

    half_angle: float  # length of the rotation vector [rad]
    omega: float  # angular frequency [rad/s]

    def quaternion(self, time: FloatArray) -> FloatArray:
        """Attitude at times ``(n,)`` [s], ``(n, 4)``."""
        c, s, phase = np.cos(0.5 * self.half_angle), np.sin(0.5 * self.half_angle), self.omega * time
        return np.stack([np.full_like(time, c), s * np.cos(phase), s * np.sin(phase), np.zeros_like(time)], -1)

    def angle(self, time: FloatArray) -> FloatArray:
        """Integral of the body rate [rad], which is twice the vector part of ``q* q'``; ``(n, 3)``."""
        s, phase = np.sin(self.half_angle), self.omega * time
        return np.stack([s * np.cos(phase), s * np.sin(phase), (np.cos(self.half_angle) - 1) * phase], -1)

    def rate(self, time: FloatArray) -> FloatArray:
        """Body rate [rad/s], ``(n, 3)``."""
        s, phase = np.sin(self.half_angle), self.omega * time
        turn = np.stack([-s * np.sin(phase), s * np.cos(phase), np.full_like(time, np.cos(self.half_angle) - 1)], -1)
        return np.asarray(self.omega * turn)


@dataclass(frozen=True, slots=True)
class Scull:
    """Rotation ``A sin wt`` about x, specific force ``a sin wt`` along y, in phase: along z they make ``a J1(A)``."""

    amplitude: float  # of the rotation [rad]
    omega: float  # angular frequency [rad/s]
    force: float  # amplitude of the specific force [m/s^2]

    def rotation(self, time: FloatArray) -> FloatArray:
        """Rotation vector, which is the integral of the body rate too [rad], ``(n, 3)``."""
        return _column(self.amplitude * np.sin(self.omega * time), 0)

    def impulse(self, time: FloatArray) -> FloatArray:
        """Integral of the specific force as sensed [m/s], ``(n, 3)``."""
        return _column(-self.force / self.omega * np.cos(self.omega * time), 1)

    def gained(self, begin: float, end: float) -> float:
        """Velocity gained along z of the axes that do not turn [m/s], by quadrature of the exact product."""
        pieces = max(1, round((end - begin) * self.omega))
        node, weight = np.polynomial.legendre.leggauss(8)
        edges = np.linspace(begin, end, pieces + 1)
        t = (edges[:-1, None] + 0.5 * np.diff(edges)[:, None] * (node + 1.0)).ravel()
        values = self.force * np.sin(self.omega * t) * np.sin(self.amplitude * np.sin(self.omega * t))
        return float(0.5 * (end - begin) / pieces * np.sum(values.reshape(pieces, -1) @ weight))


def swell(duration: float, place: FloatArray) -> LevelTruth:
    """A ride on a swell about a place: all three angles swing by degrees while the vehicle travels along a wave."""
    swing = np.array([3.0, 2.0, 4.0]) * DEG
    return LevelTruth(
        place,
        Harmonic(np.zeros(3), np.array([2e-6, 3e-6, 0.0]), np.array([0, 0, 0.2]), np.array([2e-7, 0, 0.1]), 2.0),
        Harmonic(np.array([0.02, -0.01, 0.5]), np.zeros(3), 0.7 * swing, np.roll(swing, 1), 6.0),
        duration,
    )


def start_of(truth: Truth, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and attitude at the end of the first of the intervals with these edges ``(n + 1,)`` [s]."""
    at = truth.evaluate(time[1:2])
    return at.lla[0], at.v_n[0], at.rph[0]


def even(duration: float, rate: float) -> FloatArray:
    """Edges of sampling intervals [s]: `duration` [s] at `rate` [Hz]."""
    return np.asarray(np.arange(round(duration * rate) + 1) / rate)


def uneven(duration: float, seed: int = 4) -> FloatArray:
    """Edges of intervals of 8 to 11 ms, as loggers make them [s].

    A file does not tell where the first interval began, and the mean is taken; here it is so.
    """
    steps = np.random.default_rng(seed).uniform(0.008, 0.011, round(duration * 120.0))
    steps = steps[np.cumsum(steps) <= duration - 0.011]
    steps[0] = np.mean(steps[1:])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _column(values: FloatArray, axis: int) -> FloatArray:
    full = np.zeros((values.size, 3))
    full[:, axis] = values
    return full
