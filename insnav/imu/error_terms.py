"""Every error term of a sensor triad, once: the IMU file, the budget, the simulation and the reports read this table.

A new term needs a row of `TERMS` and a field of `insnav.imu.SensorSpec`, both with the same key.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.types import FloatArray

Sensor = Literal["gyro", "accel"]
Process = Literal["constant", "ramp", "white", "random walk", "Gauss-Markov", "flicker", "quantisation"]
Spread = Literal["vector", "diagonal", "off-diagonal", "matrix"]
Drive = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

ELEMENTS: dict[Spread, tuple[tuple[int, int], ...]] = {
    "vector": ((0, 0), (1, 1), (2, 2)),
    "diagonal": ((0, 0), (1, 1), (2, 2)),
    "off-diagonal": ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)),
    "matrix": tuple((i, j) for i in range(3) for j in range(3)),
}


@dataclass(frozen=True, slots=True)
class ErrorTerm:
    """One kind of error of the gyros or of the accelerometers."""

    sensor: Sensor  # which triad
    key: str  # key of the IMU file and field of `insnav.imu.SensorSpec`
    name: str  # in a budget
    # what its size is and the unit in which it is written and shown; see `insnav.units.UNITS`
    dimension: str
    unit: str
    process: Process  # how it changes in time
    spread: Spread  # whether there is one error for each axis, or one for elements (i, j) of the sensor matrix
    # of angular rate [rad/s], specific force [m/s^2], both ``(n, 3)``, and time [s], ``(n, 1)``, the ``(n, 3)`` signals
    # by which the error is multiplied: element (i, j) adds signal j to axis i. None: the term depends on more than
    # these, and only simulations have it.
    drive: Drive | None = None
    text: str = ""  # its impact on navigation, in words

    @property
    def family(self) -> str:
        """Name with the sensor, such as ``gyro bias``."""
        return f"{self.sensor} {self.name}"

    @property
    def usual(self) -> bool:
        """Whether datasheets give it, so that a file without it is incomplete."""
        return self.key in ("bias", "bias_instability", "random_walk", "scale_factor", "misalignment")

    @property
    def in_budget(self) -> bool:
        """Whether the budget has it; otherwise it is only simulated."""
        return self.drive is not None

    @property
    def integrals(self) -> int:
        """How often it is integrated to a position error: a gyro error once more, from rate to tilt."""
        return 3 if self.sensor == "gyro" else 2

    @property
    def elements(self) -> tuple[tuple[int, int], ...]:
        """Axis that shows the error and axis of the signal, for each of its independent scalar errors."""
        return ELEMENTS[self.spread]


def _one(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return np.ones_like(w)


def _time(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return t * np.ones(3)


def _rate(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return w


def _rate_size(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return np.abs(w)


def _rate_squared(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return w * w


def _force(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return f


def _force_size(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return np.abs(f)


def _force_squared(w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
    return f * f


@dataclass(frozen=True, slots=True)
class _Of:
    """What a term is for one of the triads, in the words of `ErrorTerm`."""

    dimension: str
    unit: str
    drive: Drive | None = None
    text: str = ""


def _term(shared: tuple[str, str, Process, Spread], gyro: _Of, accel: _Of | None = None) -> tuple[ErrorTerm, ...]:
    """Key, name, process and spread of a term, and what it is for the gyros and the accelerometers."""
    given: tuple[tuple[Sensor, _Of | None], ...] = (("gyro", gyro), ("accel", accel))
    key, name, process, spread = shared
    return tuple(
        ErrorTerm(sensor, key, name, of.dimension, of.unit, process, spread, of.drive, of.text)
        for sensor, of in given
        if of is not None
    )


TERMS: tuple[ErrorTerm, ...] = (
    *_term(
        ("bias", "bias", "constant", "vector"),
        _Of("rate", "deg/h", _one, "tilts the level at a steady rate: g ε t³ / 6"),
        _Of("acceleration", "ug", _one, "is taken for motion: B t² / 2"),
    ),
    *_term(
        ("bias_instability", "bias instability", "Gauss-Markov", "vector"),
        _Of("rate", "deg/h", _one, "in-run bias (Gauss-Markov): as a bias within its correlation time"),
        _Of("acceleration", "ug", _one, "in-run bias (Gauss-Markov): as a bias within its correlation time"),
    ),
    *_term(
        ("random_walk", "white noise", "white", "vector"),
        _Of("angle random walk", "deg/sqrt(h)", _one, "angle random walk N: g N √(t⁵ / 20)"),
        _Of("velocity random walk", "m/s/sqrt(h)", _one, "velocity random walk N: N √(t³ / 3)"),
    ),
    *_term(
        ("scale_factor", "scale factor", "constant", "diagonal"),
        _Of("ratio", "ppm", _rate, "a part of every turn is missed; at rest only of the Earth's"),
        _Of("ratio", "ppm", _force, "a part of gravity is missed vertically, and of accelerations horizontally"),
    ),
    *_term(
        ("misalignment", "misalignment", "constant", "off-diagonal"),
        _Of("angle", "mrad", _rate, "turns about one axis show as turns about another"),
        _Of("angle", "mrad", _force, "gravity shows in the level axes as a bias of m g"),
    ),
    *_term(
        ("rate_random_walk", "rate random walk", "random walk", "vector"),
        _Of("rate random walk", "deg/h/sqrt(h)", _one, "random walk of the bias, K: g K √(t⁷ / 252)"),
        _Of("acceleration random walk", "ug/sqrt(h)", _one, "random walk of the bias, K: K √(t⁵ / 20)"),
    ),
    *_term(
        ("flicker", "flicker noise", "flicker", "vector"),
        _Of("rate", "deg/h", _one, "bias that changes on every time scale alike"),
        _Of("acceleration", "ug", _one, "bias that changes on every time scale alike"),
    ),
    *_term(
        ("rate_ramp", "bias ramp", "ramp", "vector"),
        _Of("rate ramp", "deg/h/h", _time, "the bias grows steadily, R: g R t⁴ / 24"),
        _Of("acceleration ramp", "ug/h", _time, "the bias grows steadily, R: R t³ / 6"),
    ),
    *_term(
        ("quantisation", "quantisation", "quantisation", "vector"),
        _Of("angle", "arcsec", _one, "steps of the angle, white and bounded, Q: g Q √(Δt t³ / 3)"),
        _Of("velocity", "m/s", _one, "steps of the velocity, white and bounded, Q: Q √(Δt t)"),
    ),
    *_term(("resolution", "resolution", "white", "vector"), _Of("rate", "deg/s"), _Of("acceleration", "mg")),
    *_term(("range", "end of the range", "constant", "vector"), _Of("rate", "deg/s"), _Of("acceleration", "g")),
    *_term(
        ("vibration_rectification", "vibration rectification", "constant", "vector"),
        _Of("rate per acceleration squared", "deg/h/g^2"),
        _Of("per acceleration", "ug/g^2"),
    ),
    *_term(
        ("asymmetry", "asymmetry", "constant", "diagonal"),
        _Of("ratio", "ppm", _rate_size, "scale factors of left and right turns differ"),
        _Of("ratio", "ppm", _force_size, "scale factors of both signs differ; at rest as a scale factor"),
    ),
    *_term(
        ("quadratic", "non-linearity", "constant", "diagonal"),
        _Of("per rate", "ppm/(deg/s)", _rate_squared, "a part of the square of the rate shows as a bias"),
        _Of("per acceleration", "ug/g^2", _force_squared, "a part of the square of the force shows as a bias"),
    ),
    *_term(
        ("bias_slope", "bias by temperature", "constant", "vector"),
        _Of("rate per kelvin", "deg/h/K"),
        _Of("acceleration per kelvin", "ug/K"),
    ),
    *_term(
        ("scale_slope", "scale factor by temperature", "constant", "diagonal"),
        _Of("ratio per kelvin", "ppm/K"),
        _Of("ratio per kelvin", "ppm/K"),
    ),
    *_term(
        ("g_sensitivity", "g-sensitivity", "constant", "matrix"),
        _Of("rate per acceleration", "deg/h/g", _force, "specific force shows as a rate; at rest a bias of one g"),
    ),
)


def terms_of(sensor: Sensor) -> tuple[ErrorTerm, ...]:
    """Terms of the gyros or of the accelerometers, in the order of the table."""
    return tuple(term for term in TERMS if term.sensor == sensor)
