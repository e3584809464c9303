"""IMU error specification: standard deviations and noise densities of sensors, initial state and clock.

``error_terms.toml`` lists the error terms of IMU files, budgets, simulations and reports. A new term needs one row of
this file, if its process and signal exist in this module.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, field, make_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from insnav.types import FloatArray
from insnav.units import G0

Sensor = Literal["gyro", "accel"]
Process = Literal["constant", "ramp", "white", "random walk", "Gauss-Markov", "flicker", "quantisation"]
Spread = Literal["vector", "diagonal", "off-diagonal", "matrix"]
Drive = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

SENSORS: tuple[Sensor, Sensor] = ("gyro", "accel")
AXES = "xyz"  # names of the sensor axes
ELEMENTS: dict[Spread, tuple[tuple[int, int], ...]] = {  # sensitive axis i and signal axis j of each scalar error
    "vector": ((0, 0), (1, 1), (2, 2)),
    "diagonal": ((0, 0), (1, 1), (2, 2)),
    "off-diagonal": ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)),
    "matrix": tuple((i, j) for i in range(3) for j in range(3)),
}


@dataclass(frozen=True, slots=True)
class ErrorTerm:
    """Error term of the gyros or of the accelerometers."""

    sensor: Sensor  # triad that has the error
    key: str  # name in the IMU file and in `insnav.imu.SensorSpec`
    name: str  # name in an error budget
    # dimension and display unit of its size; see `insnav.units.UNITS`
    dimension: str
    unit: str
    process: Process  # stochastic process: how the error changes with time
    spread: Spread  # one error per axis, or one per element (i, j) of the sensor matrix
    # signals ``(n, 3)`` that multiply the error: element (i, j) adds signal j to axis i. Arguments: angular rate
    # [rad/s], specific force [m/s^2], both ``(n, 3)``, time [s], ``(n, 1)``. None: the term depends on further
    # signals, and only simulations include it.
    drive: Drive | None = None
    text: str = ""  # impact on navigation, in words
    datasheet: Literal["", "often", "usual"] = ""  # how frequently datasheets state the term
    allan: str = ""  # name of its coefficient in an Allan deviation; see `insnav.lab.noise.allan`

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
        """Number of integrations from this error to position: 2 for accelerometers; gyros have one more, to tilt."""
        return 3 if self.sensor == "gyro" else 2

    @property
    def elements(self) -> tuple[tuple[int, int], ...]:
        """Sensitive axis i and signal axis j of each independent scalar error."""
        return ELEMENTS[self.spread]

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the `elements`: ``x`` for an axis, ``xy`` for an element of a matrix."""
        return tuple(AXES[i] if self.spread == "vector" else AXES[i] + AXES[j] for i, j in self.elements)


@dataclass(frozen=True, slots=True)
class _Signal:
    """Function for `ErrorTerm.drive`, by name: one, time, rate or force, with suffix ``_size`` or ``_squared``."""

    name: str

    def __call__(self, w: FloatArray, f: FloatArray, t: FloatArray) -> FloatArray:
        """Compute the signals; see `ErrorTerm.drive`."""
        base, _, shape = self.name.partition("_")
        signal: FloatArray = {"one": np.ones_like(w), "time": t * np.ones(3), "rate": w, "force": f}[base]
        if shape == "size":
            return np.abs(signal)
        return signal * signal if shape == "squared" else signal


def _terms() -> Iterator[ErrorTerm]:
    """Yield the rows of ``error_terms.toml``."""
    table = tomllib.loads(Path(__file__).with_name("error_terms.toml").read_text(encoding="utf-8"))
    for key, row in table.items():
        for sensor in SENSORS:
            if sensor in row:
                dimension, unit, *optional = row[sensor]
                drive, text = optional or ("", "")
                attributes = row["name"], dimension, unit, row["process"], row["spread"]
                references = row.get("datasheet", ""), row.get("allan", "")
                yield ErrorTerm(sensor, key, *attributes, _Signal(drive) if drive else None, text, *references)


TERMS = tuple(_terms())


def terms_of(sensor: Sensor) -> tuple[ErrorTerm, ...]:
    """Return the terms of the gyros or of the accelerometers, in table order."""
    return tuple(term for term in TERMS if term.sensor == sensor)


# defaults of dataclass fields: zeros, (3,) and (3, 3)
zeros, zero_matrix = partial(np.zeros, 3), partial(np.zeros, (3, 3))
# IMU grades with a preset, from the least to the most accurate.
# Each preset is one real IMU; its ``source`` separates figures of the datasheet from assumed figures. The same
# rules of interpretation apply to all datasheets:
#
# - a tolerance (+-) or a limit (<, also on an RMS) of a bias, a scale factor or an angle is read as two
#   standard deviations;
# - an error stated as one standard deviation (1 sigma, RMS) and a noise density are used unchanged;
# - ``bias_instability`` is the standard deviation of the bias about its turn-on value over an hour of use. The
#   lowest point of the Allan deviation is measured at constant temperature and would be too small. The value is
#   therefore the temperature coefficient times 5 K. Without coefficient: a tenth of the bias error over the full
#   temperature range (as a standard deviation). Without both: a fifth of the turn-on bias. Never less than the lowest
#   point of the Allan deviation over 0.664 (IEEE Std 952-1997, annex C). Its correlation time is assumed to be an hour.
PRESETS = ("consumer", "automotive", "industrial", "tactical", "navigation")
FOLDER = Path(__file__).parent / "grades"

if TYPE_CHECKING:

    class SensorSpec:
        """Error sizes of a sensor triad, one standard deviation or density per axis: (3,) for each term.

        `insnav.imu.specification.TERMS` defines the terms and their dimensions; a missing term is zero.
        """

        correlation_time: float  # correlation time of the in-run bias [s]; infinite without such a process
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

        def __init__(self, **sizes: FloatArray | float) -> None: ...
        def __getattr__(self, key: str) -> FloatArray: ...

else:
    _KEYS = dict.fromkeys(term.key for term in TERMS)
    _FIELDS = [(key, FloatArray, field(default_factory=zeros)) for key in _KEYS]
    _FIELDS.insert(2, ("correlation_time", float, math.inf))  # placed after the in-run bias, also in stored results
    SensorSpec = make_dataclass("SensorSpec", _FIELDS, frozen=True, slots=True, namespace={"__module__": __name__})


def noise_of(sensor: SensorSpec, process: Process) -> FloatArray:
    """Compute the root sum of squares of all budget terms of one process, such as ``white``, (3,)."""
    keys = dict.fromkeys(term.key for term in TERMS if term.process == process and term.in_budget)
    return np.asarray(np.hypot.reduce([getattr(sensor, key) for key in keys]))


def gyro_bias_sd(gyro: SensorSpec) -> FloatArray:
    """Compute the standard deviation of the total gyro bias, turn-on and in-run, (3,) [rad/s]."""
    return np.hypot(gyro.bias, gyro.bias_instability)


def level_bias_sd(accel: SensorSpec) -> FloatArray:
    """Compute the standard deviation of the total bias of nearly level accelerometers, turn-on and in-run, (3,)."""
    return np.hypot(level_bias(accel), accel.bias_instability)


def level_bias(accel: SensorSpec) -> FloatArray:
    """Compute the turn-on bias sd of nearly level accelerometers, with gravity by misalignment, (3,) [m/s^2]."""
    return np.hypot(accel.bias, G0 * accel.misalignment)


@dataclass(frozen=True, slots=True)
class InitialSpec:
    """Standard deviations of the initial state, for error budgets and simulation."""

    position: float = 0.0  # standard deviation of each component of position [m]
    velocity: float = 0.0  # standard deviation of each component of velocity [m/s]
    tilt: float = 0.0  # standard deviation of roll and pitch [rad]
    heading: float = 0.0  # standard deviation of heading [rad]


@dataclass(frozen=True, slots=True)
class ClockSpec:
    """Timestamp errors of an IMU, for simulation."""

    offset: float = 0.0  # timestamps are late by this [s]
    drift: float = 0.0  # timestamps are later by this share of the time since the start [-]
    jitter: float = 0.0  # standard deviation of each timestamp [s]
    # mean time between drop-outs, exponentially distributed, and their mean length [s]; zero: none
    lost_every: float = 0.0
    lost_length: float = 0.0


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """IMU error specification."""

    name: str  # name of the preset or part, or the name in the file
    # sizes of the errors of the gyros and of the accelerometers
    gyro: SensorSpec
    accel: SensorSpec
    initial: InitialSpec | None = None  # initial errors, if the file states them
    source: str = ""  # source of the figures
    absent: tuple[str, ...] = ()  # dotted names of missing figures, which are zero here
    clock: ClockSpec = field(default_factory=ClockSpec)  # errors of the timestamps
    # (3, 3) row i is the position of accelerometer i relative to the navigated point, body axes [m]
    positions: FloatArray = field(default_factory=zero_matrix)


def noise_of_both(spec: ImuSpec, process: Process) -> FloatArray:
    """Compute `noise_of` one process for the gyros and the accelerometers, (6,)."""
    return np.concatenate([noise_of(spec.gyro, process), noise_of(spec.accel, process)])
