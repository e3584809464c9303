"""Table of error terms, ``error_terms.toml``: the basis of IMU file, budget, simulation and reports.

A new term needs one row of that file, if its process and signal exist in this module.
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
    """Error term of the gyros or of the accelerometers."""

    sensor: Sensor  # which triad
    key: str  # in the IMU file and in `insnav.imu.SensorSpec`
    name: str  # in a budget
    # dimension and display unit of its size; see `insnav.units.UNITS`
    dimension: str
    unit: str
    process: Process  # process in time
    spread: Spread  # one error per axis, or one per element (i, j) of the sensor matrix
    # signals ``(n, 3)`` that multiply the error: element (i, j) adds signal j to axis i. Arguments: angular rate
    # [rad/s], specific force [m/s^2], both ``(n, 3)``, time [s], ``(n, 1)``. None: the term depends on more than these,
    # and only simulations have it.
    drive: Drive | None = None
    text: str = ""  # impact on navigation, in words
    datasheet: Literal["", "often", "usual"] = ""  # frequency in datasheets
    allan: str = ""  # its coefficient in an Allan deviation; see `insnav.lab.noise.allan`

    @property
    def family(self) -> str:
        """Name including the sensor, such as ``gyro bias``."""
        return f"{self.sensor} {self.name}"

    @property
    def usual(self) -> bool:
        """True if a file without the term is incomplete."""
        return self.datasheet == "usual"

    @property
    def in_budget(self) -> bool:
        """True if the budget includes the term; otherwise it is only simulated."""
        return self.drive is not None

    @property
    def integrals(self) -> int:
        """Number of integrations to a position error: one more for gyros, from rate to tilt."""
        return 3 if self.sensor == "gyro" else 2

    @property
    def elements(self) -> tuple[tuple[int, int], ...]:
        """Sensitive axis and axis of the signal, for each independent scalar error."""
        return ELEMENTS[self.spread]

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of these elements: ``x``, or ``xy`` for an element of a matrix."""
        return tuple(AXES[i] if self.spread == "vector" else AXES[i] + AXES[j] for i, j in self.elements)


@dataclass(frozen=True, slots=True)
class _Signal:
    """Drive by its name in the table: ``one``, ``time``, ``rate`` or ``force``; with ``_size`` or ``_squared``."""

    name: str

    def __call__(self, w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
        """Compute the signals; see `ErrorTerm.drive`."""
        of, _, shape = self.name.partition("_")
        signal: FloatArray = {"one": np.ones_like(w), "time": t * np.ones(3), "rate": w, "force": f}[of]
        if shape == "size":
            return np.abs(signal)
        return signal * signal if shape == "squared" else signal


def _terms() -> Iterator[ErrorTerm]:
    """Yield the rows of ``error_terms.toml``."""
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
    """Return the terms of the gyros or of the accelerometers, in table order."""
    return tuple(term for term in TERMS if term.sensor == sensor)
