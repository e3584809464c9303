"""How a car body moves on its wheels, and the position curve of a velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from insnav.earth import radii
from insnav.simulate.curves import Spline, spline_through
from insnav.simulate.imu_errors import Seed
from insnav.types import FloatArray

_TONES = 24
_REFERENCE_SPEED = 20.0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """How a car body moves on its wheels."""

    lean: float = 0.009  # roll per acceleration to the right [rad/(m/s^2)]; a car leans out of the turn
    squat: float = 0.006  # pitch per forward acceleration [rad/(m/s^2)]
    # standard deviation of the vibration velocity forward, right, down at 20 m/s [m/s]
    velocity_shake: tuple[float, float, float] = (0.01, 0.01, 0.04)
    # standard deviation of the vibration of roll, pitch, heading at 20 m/s [rad]
    angle_shake: tuple[float, float, float] = (0.0020, 0.0016, 0.0005)
    band: tuple[float, float] = (0.8, 6.0)  # lowest and highest frequency of the vibration [Hz]


def position_curve(t: FloatArray, velocity: FloatArray, lla: FloatArray) -> Spline:
    """Integral of a velocity North, East, up ``(n, 3)`` [m/s] over the ellipsoid: position minus its start `lla`.

    Latitude [rad], longitude [rad], height [m].
    """
    here = np.tile(np.asarray(lla, dtype=np.float64), (len(t), 1))
    # The rates need the position only for the radii and the parallel, which change by parts in 1e7 per metre:
    # trapezoids are good enough to find it, and each pass gains digits, five on 100 km.
    for _ in range(3):
        meridian, transverse = radii(here[:, 0])
        metres = np.column_stack([meridian + here[:, 2], (transverse + here[:, 2]) * np.cos(here[:, 0])])
        rates = np.column_stack([velocity[:, :2] / metres, velocity[:, 2]])
        here = lla + cumulative_trapezoid(rates, t, axis=0, initial=0.0)
    return spline_through(t, rates).integral()


def shake(t: FloatArray, speed: FloatArray, vehicle: Vehicle, seed: Seed) -> tuple[FloatArray, FloatArray]:
    """Vibration as a sum of tones, in proportion to the speed ``(n,)`` [m/s]: none at rest.

    Returns: `velocity` (n, 3): Forward, right, down [m/s]; `angle` (n, 3): roll, pitch, heading [rad].
    """
    rng = np.random.default_rng(seed)
    result = np.empty((len(t), 6))
    for i, sd in enumerate(vehicle.velocity_shake + vehicle.angle_shake):
        omega = 2.0 * np.pi * rng.uniform(*vehicle.band, _TONES)
        phase = rng.uniform(0.0, 2.0 * np.pi, _TONES)
        tones = np.zeros(len(t))
        for w, p in zip(omega, phase, strict=True):
            tones += np.sin(w * t + p)
        result[:, i] = sd * math.sqrt(2.0 / _TONES) * speed / _REFERENCE_SPEED * tones
    return result[:, :3], result[:, 3:]
