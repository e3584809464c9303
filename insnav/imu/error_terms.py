"""The table of error terms, ``error_terms.toml``: the IMU file, budget, simulation and reports are driven from it.

A new term needs one row of that file, if its process and its signal are among those of this module.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from insnav.types import FloatArray

Sensor = Literal["gyro", "accel"]
Process = Literal["constant", "ramp", "white", "random walk", "Gauss-Markov", "flicker", "quantisation"]
Spread = Literal["vector", "diagonal", "off-diagonal", "matrix"]
Drive = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

SENSORS: tuple[Sensor, Sensor] = ("gyro", "accel")
AXES = "xyz"  # of the sensors
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
    key: str  # in the IMU file and in `insnav.imu.SensorSpec`
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
    datasheet: Literal["", "often", "usual"] = ""  # whether datasheets give it
    allan: str = ""  # its coefficient in an Allan deviation; see `insnav.lab.noise.noise_model`

    @property
    def family(self) -> str:
        """Name with the sensor, such as ``gyro bias``."""
        return f"{self.sensor} {self.name}"

    @property
    def usual(self) -> bool:
        """Whether a file without it is incomplete."""
        return self.datasheet == "usual"

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

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of these elements: ``x``, or ``xy`` for an element of a matrix."""
        return tuple(AXES[i] if self.spread == "vector" else AXES[i] + AXES[j] for i, j in self.elements)


@dataclass(frozen=True, slots=True)
class _Signal:
    """Drive by its name in the table: ``one``, ``time``, ``rate`` or ``force``; its ``_size``, or it ``_squared``."""

    name: str

    def __call__(self, w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
        """Return the signals; see `ErrorTerm.drive`."""
        of, _, shape = self.name.partition("_")
        signal: FloatArray = {"one": np.ones_like(w), "time": t * np.ones(3), "rate": w, "force": f}[of]
        if shape == "size":
            return np.abs(signal)
        return signal * signal if shape == "squared" else signal


def _terms() -> Iterator[ErrorTerm]:
    """Rows of ``error_terms.toml``."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    for key, row in table.items():
        for sensor in SENSORS:
            if sensor in row:
                dimension, unit, *more = row[sensor]
                drive, text = more or ("", "")
                process = row["name"], dimension, unit, row["process"], row["spread"]
                known = row.get("datasheet", ""), row.get("allan", "")
                yield ErrorTerm(sensor, key, *process, _Signal(drive) if drive else None, text, *known)


TERMS = tuple(_terms())


def terms_of(sensor: Sensor) -> tuple[ErrorTerm, ...]:
    """Terms of the gyros or of the accelerometers, in the order of the table."""
    return tuple(term for term in TERMS if term.sensor == sensor)
