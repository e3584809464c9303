"""Exact motion in Earth-fixed axes: across a pole, with the nose straight up, and inverted.

Position is a curve in Earth-fixed axes and attitude a quaternion relative to them: no latitude and no pitch is
singular. Velocity, angular rate and specific force are derivatives of the same curves.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import quat_conjugate, quat_from_rotvec, quat_multiply, rph_from_quat
from insnav.earth import OMEGA_EARTH
from insnav.earth_fixed import components, geodetic, lla_from_earth, quat_earth_from_level
from insnav.simulate.truth import Curve, Gravity, Kinematics, Spline, Truth, Vector, gravity_of
from insnav.types import FloatArray

_SMALL = 1e-3  # squared angle below which the series of the factors are exact to rounding [rad^2]

Quaternion = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Turns:
    """Attitude ``q_vb`` of the body b relative to the vehicle v: constant attitudes, each followed by a rotation."""

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
        stretch = np.clip(np.searchsorted(self.edges, tau, side="right") - 1, 0, len(self.edges) - 1)
        rotvec, rate = self.rotvec(tau), self.rotvec(tau, 1)
        angle2 = np.einsum("ij,ij->i", rotvec, rotvec)
        across = np.cross(rotvec, rate)
        first, second = turn_factors(angle2)
        w = rate - first[:, None] * across + second[:, None] * np.cross(rotvec, across)
        q = quat_multiply(self.base[stretch], quat_from_rotvec(rotvec))
        return (q[:, 0], q[:, 1], q[:, 2], q[:, 3]), components(w)


def turn_factors(angle2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute ``(1 - cos a) / a^2`` and ``(a - sin a) / a^3`` of squared angles ``a^2`` ``(n,)`` [rad^2]."""
    safe = np.where(angle2 < _SMALL, 1.0, angle2)
    angle = np.sqrt(safe)
    series = 1 / 6 - angle2 / 120 * (1 - angle2 / 42 * (1 - angle2 / 72))
    first = 0.5 * np.sinc(np.sqrt(angle2) / (2 * np.pi)) ** 2
    return first, np.where(angle2 < _SMALL, series, (angle - np.sin(angle)) / (safe * angle))


@dataclass(frozen=True, slots=True)
class EarthTruth(Truth):
    """Motion in Earth-fixed axes."""

    origin: FloatArray  # (3,) origin of `position` [m]
    position: Curve  # position minus `origin` over the time since `start` [m]; smooth in at least two derivatives
    # quaternion ``q_ev`` of the vehicle over the time since `start`, of any length but zero; smooth in at least one
    # derivative. Divided by its length it is the attitude, so its four polynomials need not know of each other.
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
        """Compute the rates; see `Truth`: Groves 2013, section 2.5.5 solved for the specific force.

        The rate relative to the Earth follows from ``w = 2 vec(q* (x) q')`` for a unit quaternion. Another length adds
        a part along ``q``, which cancels, and a factor.
        """
        a, b, c, d = q = _columns(self.attitude(tau))
        da, db, dc, dd = _columns(self.attitude(tau, 1))
        twice = 2.0 / (a * a + b * b + c * c + d * d)
        w_e = turned_back(q, (np.zeros(1), np.zeros(1), np.full(1, OMEGA_EARTH)))
        w = (
            twice * (a * db - b * da - c * dd + d * dc) + w_e[0],
            twice * (a * dc - c * da - d * db + b * dd) + w_e[1],
            twice * (a * dd - d * da - b * dc + c * db) + w_e[2],
        )
        x, y, z = components(self.position(tau) + self.origin)
        vx, vy, _ = components(self.position(tau, 1))
        ax, ay, az = components(self.position(tau, 2))
        gx, gy, gz = gravity_e(x, y, z, self.gravity)
        f = turned_back(q, (ax - 2 * OMEGA_EARTH * vy - gx, ay + 2 * OMEGA_EARTH * vx - gy, az - gz))
        if self.turns is None:
            return w, f
        q_vb, w_vb_b = self.turns(tau)
        x, y, z = turned_back(q_vb, w)
        return (x + w_vb_b[0], y + w_vb_b[1], z + w_vb_b[2]), turned_back(q_vb, f)

    def evaluate(self, time: FloatArray) -> Kinematics:
        """Evaluate the motion; see `Truth`. At a pole the longitude is 0, which defines the heading."""
        tau = self.elapsed(time)
        w_ib_b, f_b = self.sensed(tau)
        r_e = self.position(tau) + self.origin
        lla = lla_from_earth(r_e)
        q_en = quat_earth_from_level(lla)
        q_eb = self.attitude(tau)
        q_eb = q_eb / np.linalg.norm(q_eb, axis=1, keepdims=True)
        if self.turns is not None:
            q_eb = quat_multiply(q_eb, np.column_stack(self.turns(tau)[0]))
        v_n = turned_back(_columns(q_en), components(self.position(tau, 1)))
        rph = rph_from_quat(quat_multiply(quat_conjugate(q_en), q_eb))
        return Kinematics(lla, np.column_stack(v_n), rph, np.column_stack(w_ib_b), np.column_stack(f_b))


def _columns(q: FloatArray) -> Quaternion:
    a, b, c, d = np.ascontiguousarray(q.T)
    return a, b, c, d


def turned_back(q: Quaternion, vector: Vector) -> Vector:
    """Compute ``C(q)^T @ vector``, for a body-to-`vector` quaternion of any length (Groves 2013, eq. 2.34)."""
    a, b, c, d = q
    x, y, z = vector
    twice = 2.0 / (a * a + b * b + c * c + d * d)
    # v + 2 u x (u x v - a v) / |q|^2 with u = (b, c, d)
    kx, ky, kz = c * z - d * y - a * x, d * x - b * z - a * y, b * y - c * x - a * z
    return x + twice * (c * kz - d * ky), y + twice * (d * kx - b * kz), z + twice * (b * ky - c * kx)


def gravity_e(x: FloatArray, y: FloatArray, z: FloatArray, gravity: Gravity) -> Vector:
    """Compute gravity including centrifugal acceleration in Earth-fixed axes [m/s^2], at Earth-fixed positions [m]."""
    p, lat, height = geodetic(x, y, z)
    north, down = gravity_of(gravity, lat, height)
    s, c = np.sin(lat), np.cos(lat)
    outward = -c * down - s * north
    along = -s * down + c * north
    outward /= np.maximum(p, 1e-9)  # on the axis x and y are zero
    return x * outward, y * outward, along
