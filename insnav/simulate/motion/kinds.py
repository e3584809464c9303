"""Vehicle kinds: their limits, defaults, lean and vibration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insnav.simulate.imu_errors import Seed
from insnav.types import FloatArray
from insnav.units import G0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Motion of a car body on its wheels."""

    lean: float = 0.009  # roll per acceleration to the right [rad/(m/s^2)]; a car leans out of the turn
    squat: float = 0.006  # pitch per forward acceleration [rad/(m/s^2)]
    # standard deviation of the vibration velocity forward, right, down at 20 m/s [m/s]
    velocity_shake: tuple[float, float, float] = (0.01, 0.01, 0.04)
    # standard deviation of the vibration of roll, pitch, heading at 20 m/s [rad]
    angle_shake: tuple[float, float, float] = (0.0020, 0.0016, 0.0005)
    band: tuple[float, float] = (0.8, 6.0)  # lowest and highest frequency of the vibration [Hz]


_RIGID = Vehicle(lean=0.0, squat=0.0, velocity_shake=(0.0, 0.0, 0.0), angle_shake=(0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Kind:
    """Limits and defaults of a vehicle kind."""

    name: str
    # largest speed [m/s] and accelerations along and across the path [m/s^2]
    speed: float
    forward: float
    sideways: float
    grade: float  # steepest climb [rad]
    # defaults: along the path [m/s^2], jerk [m/s^3], upward path acceleration [m/s^2]
    acceleration: float
    jerk: float
    bend: float
    banks: bool = False  # the vehicle banks into turns, without lateral force
    on_the_spot: bool = False  # the vehicle can turn without moving
    body: Vehicle = _RIGID  # lean and vibration of the body


HIGHEST = 100.0 * G0  # of a laboratory device; beyond it the input is an error
FASTEST_SPIN = math.radians(4000.0)
_STEEPEST_BANK = G0 * math.tan(math.radians(75))  # as acceleration across the path [m/s^2]

KINDS = {
    kind.name: kind
    for kind in (
        Kind("car", 100.0, 10.0, 9.0, math.radians(25), 1.5, 2.0, 0.5, body=Vehicle()),
        Kind("aircraft", 1000.0, 50.0, _STEEPEST_BANK, math.radians(60), 2.0, 2.0, 2.0, banks=True),
        Kind("slide", 100.0, HIGHEST, HIGHEST, math.radians(60), 0.5, 5.0, 1.0, on_the_spot=True),
    )
}


_TONES = 24  # of a band, or of the suspension, on each axis
_REFERENCE_SPEED = 20.0  # speed of the specified vibration [m/s]
_STREAM = 1


@dataclass(frozen=True, slots=True)
class Vibration:
    """Vibration of a vehicle."""

    # suspension vibration relative to the vehicle's; proportional to speed
    suspension: float = 1.0
    # frequency [Hz] and amplitude [m/s^2] of each engine line, along all three axes, in phases drawn at random
    lines: tuple[tuple[float, float], ...] = ()
    # lowest and highest frequency [Hz], and one-sided density of the acceleration in between [(m/s^2)^2/Hz]
    bands: tuple[tuple[float, float, float], ...] = ()

    @property
    def highest(self) -> float:
        """Highest frequency of the vibration [Hz]."""
        return max([6.25, *(line[0] for line in self.lines), *(band[1] for band in self.bands)])


def shaken(
    t: FloatArray, speed: FloatArray, body: Vehicle, vibration: Vibration, seed: Seed
) -> tuple[FloatArray, FloatArray]:
    """Simulate vibration of velocity forward, right, down [m/s] and of roll, pitch, heading [rad], each ``(n, 3)``."""
    velocity, angle = _suspension(t, speed, body, vibration.suspension, seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    for frequency, size in vibration.lines:
        velocity += _tones(t, np.full((1, 3), frequency), size, rng)
    for low, high, density in vibration.bands:
        # one tone per slice of the band, with an equal share of the power
        slices = low + (high - low) * (np.arange(_TONES)[:, None] + rng.uniform(size=(_TONES, 3))) / _TONES
        velocity += _tones(t, slices, math.sqrt(2.0 * density * (high - low) / _TONES), rng)
    return velocity, angle


def _suspension(
    t: FloatArray, speed: FloatArray, vehicle: Vehicle, factor: float, seed: Seed
) -> tuple[FloatArray, FloatArray]:
    """Simulate `factor` times the vehicle's vibration: tones proportional to speed ``(n,)`` [m/s], none at rest."""
    rng = np.random.default_rng(seed)
    result = np.empty((len(t), 6))
    for i, sd in enumerate(vehicle.velocity_shake + vehicle.angle_shake):
        omega = 2.0 * np.pi * rng.uniform(*vehicle.band, _TONES)
        phase = rng.uniform(0.0, 2.0 * np.pi, _TONES)
        tones = np.zeros(len(t))
        for w, p in zip(omega, phase, strict=True):
            tones += np.sin(w * t + p)
        result[:, i] = factor * sd * math.sqrt(2.0 / _TONES) * speed / _REFERENCE_SPEED * tones
    return result[:, :3], result[:, 3:]


def _tones(t: FloatArray, frequency: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """Sum velocity tones of acceleration amplitude `size` ``(n, 3)``; frequencies ``(m, 3)`` [Hz]."""
    phase = rng.uniform(0.0, 2.0 * np.pi, frequency.shape)
    total = np.zeros((len(t), 3))
    for f, p in zip(frequency, phase, strict=True):
        omega = 2.0 * np.pi * f
        total += size / omega * np.sin(omega * t[:, None] + p)
    return total
