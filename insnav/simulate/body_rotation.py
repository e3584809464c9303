"""Turns of the body against the vehicle that carries it, by rotation vectors: spinning, tumbling, coning, exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import quat_from_rotvec, quat_multiply
from insnav.simulate.curves import Spline
from insnav.simulate.truth import Vector, components
from insnav.types import FloatArray

_SMALL = 1e-3  # squared angle below which the series of the factors are exact to rounding [rad^2]

Quaternion = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Turns:
    """Attitude ``q_vb`` of the body b against the vehicle v: constant attitudes, each followed by a rotation vector."""

    # (m,) times at which the next stretch begins [s], increasing; the first one is the start of the motion
    edges: FloatArray
    base: FloatArray  # (m, 4) quaternion at the beginning of each stretch
    # rotation vector since the beginning of the stretch [rad]. It jumps at `edges`, back to zero, and with it goes all
    # it had turned into `base`; its derivatives do not.
    rotvec: Spline

    @property
    def knots(self) -> FloatArray:
        """Times at which some high derivative jumps [s]."""
        return self.rotvec.knots

    def __call__(self, tau: FloatArray) -> tuple[Quaternion, Vector]:
        """Attitude and rate at times ``(n,)`` [s].

        Returns: `q_vb` (n,): attitude; `w_vb_b` (n,): rate of the body against the vehicle, body axes [rad/s]: Bortz,
        "A new mathematical formulation for strapdown inertial navigation", IEEE Trans. AES-7 (1971) 61-66, solved for
        the rate.
        """
        stretch = np.clip(np.searchsorted(self.edges, tau, side="right") - 1, 0, len(self.edges) - 1)
        rotvec, rate = self.rotvec(tau), self.rotvec(tau, 1)
        angle2 = np.einsum("ij,ij->i", rotvec, rotvec)
        across = np.cross(rotvec, rate)
        first, second = turn_factors(angle2)
        w = rate - first[:, None] * across + second[:, None] * np.cross(rotvec, across)
        q = quat_multiply(self.base[stretch], quat_from_rotvec(rotvec))
        return (q[:, 0], q[:, 1], q[:, 2], q[:, 3]), components(w)


def turn_factors(angle2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``(1 - cos a) / a^2`` and ``(a - sin a) / a^3`` of squared angles ``a^2`` ``(n,)`` [rad^2]."""
    safe = np.where(angle2 < _SMALL, 1.0, angle2)
    angle = np.sqrt(safe)
    series = 1 / 6 - angle2 / 120 * (1 - angle2 / 42 * (1 - angle2 / 72))
    first = 0.5 * np.sinc(np.sqrt(angle2) / (2 * np.pi)) ** 2
    return first, np.where(angle2 < _SMALL, series, (angle - np.sin(angle)) / (safe * angle))
