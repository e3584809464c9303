"""Moment of inertia I of a gyroscope's rotor by two methods: a falling weight that spins it up, and precession.

Falling weight m on a cord round radius r: energy gives ``m g h = (m v^2 + I w^2) / 2`` with ``v = r w``, and constant
acceleration ``h = v t / 2``, so ``t^2 = 2 h (I + m r^2) / (m g r^2)``. Precession under a weight m at arm R:
``w_P = m g R / (I w_R)``, so ``w_R = m g R T_P / (2 pi I)``. H. Goldstein, Classical Mechanics, 3rd ed. (2002),
sections 5.7 and 5.8 (fast top).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import schema
from insnav.lab import calibration
from insnav.lab.bench_data import BenchTable, read_bench
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, Fit, measured
from insnav.types import FloatArray

FALL, PRECESSION = schema("fall"), schema("precession")
WORST = 0.1  # largest relative standard deviation of a usable slope
USUAL = 5  # usual number of measurements
SLOW = 10.0  # least ratio of spin rate to precession rate for which the fast-top formula holds


@dataclass(frozen=True, slots=True)
class Inertia:
    """Moment of inertia by one method."""

    method: str  # name of the method in words
    value: float  # moment of inertia [kg m^2]
    sd: float  # standard deviation [kg m^2]
    half_width: float  # half its 95 % interval [kg m^2]
    fit: Fit  # fit of a line through the origin
    x: FloatArray  # (n,) fitted data x and y: height [m] and squared time [s^2], or period [s] and rotor rate [rad/s]
    y: FloatArray
    warnings: tuple[Finding, ...]
    powers: Fit | None = None  # exponents of torque and of spin in the precession rate, if both were varied


@dataclass(frozen=True, slots=True)
class Agreement:
    """Comparison of two moments of inertia."""

    difference: float  # first minus second, and its standard deviation [kg m^2]
    sd: float
    limit: float  # largest difference that their uncertainties explain, 95 % [kg m^2]
    mean: float  # weighted mean and its standard deviation [kg m^2]; meaningless if they disagree
    mean_sd: float

    @property
    def agree(self) -> bool:
        """True if the difference is within the limit."""
        return abs(self.difference) <= self.limit


@dataclass(frozen=True, slots=True)
class Inertias:
    """Moments of inertia by a falling weight and by precession, and their agreement."""

    fall: Inertia
    precession: Inertia
    agreement: Agreement


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> tuple[BenchTable, BenchTable]:
    """Read heights and times of a falling weight, and precession periods and rotor rates.

    Raises: ConfigError: an impossible mass or length.
    """
    fall, precession = files
    turns = read_bench(precession, PRECESSION, ("period", "rotor_rate"))
    for name in ("fall_mass", "radius", "mass", "arm"):
        value = getattr(how, name)
        if name == "mass" and name in turns.columns and value == 0.0:
            continue
        if not 0.0 < value < 100.0:
            raise ConfigError("lab.mass_or_length", where=f"--{name.replace('_', '-')}", value=value)
    return read_bench(fall, FALL, ("height", "fall_time"), alternatives={"fall_time": "time"}), turns


def fit(
    record: tuple[BenchTable, BenchTable], how: BenchOptions
) -> Calibration[tuple[BenchTable, BenchTable], Inertias]:
    """Compute the moment of inertia by `inertia_from_fall` and by `inertia_from_precession`, and compare both."""
    falls, turns = record
    time = falls.columns["fall_time" if "fall_time" in falls.columns else "time"]
    by_fall = inertia_from_fall(falls.columns["height"], time, how.fall_mass, how.radius, how.gravity, where=falls.name)
    mass = turns.columns.get("mass", how.mass)
    by_precession = inertia_from_precession(
        turns.columns["period"], turns.columns["rotor_rate"], mass, how.arm, how.gravity, where=turns.name
    )
    both, compared = (by_fall, by_precession), agreement(by_fall, by_precession)
    differ = Finding.of(Code.ROTOR_DISAGREE, difference_kg_m2=abs(compared.difference), limit_kg_m2=compared.limit)
    warnings = (*calibration.about("fall", by_fall.warnings), *calibration.about("precession", by_precession.warnings))
    parameters = tuple(
        measured(f"moment of inertia, {item.method}", item.value, "kg m^2", item.sd, item.half_width) for item in both
    )
    fits, inertias = {item.method: item.fit for item in both}, Inertias(by_fall, by_precession, compared)
    warnings = warnings if compared.agree else (differ, *warnings)
    return Calibration("rotor", None, CalibrationSd(), parameters, fits, record, inertias, how, warnings)


def inertia_from_fall(
    height: FloatArray, time: FloatArray, mass: float, radius: float, gravity: float, *, where: str = ""
) -> Inertia:
    """Compute the moment of inertia from a falling weight.

    `height` (n,): heights of fall [m]. `time` (n,): times of fall [s]. `mass`: of the weight [kg]. `radius`: of the
    drum the cord is wound on [m]; `gravity` [m/s^2].
    Raises: InputError: values that are not positive, too few, or a fall faster than free fall.
    """
    _positive(where, height=height, fall_time=time)
    squared = time**2
    if (squared <= 2.0 * height / gravity).any():
        row = int(np.argmax(squared <= 2.0 * height / gravity))
        free_fall = math.sqrt(2.0 * height[row] / gravity)
        raise InputError(
            "lab.faster_than_free", where=where, row=row + 1, height_m=height[row], fall_s=time[row], free_s=free_fall
        )
    fit = _slope(height, squared, where)
    factor = 0.5 * mass * gravity * radius**2
    value = float(fit.value[0]) * factor - mass * radius**2
    warnings = _suspicions(fit, height, squared, Code.ROTOR_FALL_ORIGIN)
    sd, half = float(fit.sd[0]) * factor, float(fit.half_width()[0]) * factor
    return Inertia("falling weight", value, sd, half, fit, height, squared, warnings)


def inertia_from_precession(
    period: FloatArray, rate: FloatArray, mass: float | FloatArray, arm: float, gravity: float, *, where: str = ""
) -> Inertia:
    """Compute the moment of inertia from precession, by one regression over all spins and torques.

    `period` (n,): precession periods [s]. `rate` (n,): rates of the rotor [rad/s]. `mass`: of the added weight [kg],
    one or (n,). `arm`: its distance from the support [m]. `gravity` [m/s^2]. With several weights, periods are
    converted to the mean weight, since the period is inversely proportional to the torque.
    Raises: InputError: values that are not positive, too few, or a rotor too slow for the formula.
    """
    weights = np.broadcast_to(mass, period.shape)
    _positive(where, precession_period=period, rotor_rate=rate, mass=weights)
    powers = _powers(period, rate, weights)
    mass = float(weights.mean())
    period = period * weights / mass
    ratio = rate * period / (2.0 * math.pi)
    if (ratio < SLOW).any():
        row = int(np.argmin(ratio))
        raise InputError("lab.slow_rotor", where=where, row=row + 1, ratio=ratio[row], limit=SLOW)
    fit = _slope(period, rate, where)
    value = mass * gravity * arm / (2.0 * math.pi) / float(fit.value[0])
    relative = float(fit.sd[0] / fit.value[0])
    if relative > WORST:
        raise InputError("lab.precession_slope", where=where, slope=fit.value[0], slope_sd=fit.sd[0])
    warnings = _suspicions(fit, period, rate, Code.ROTOR_PRECESSION_ORIGIN)
    half_width = value * relative * calibration.coverage_factor(fit.dof)
    if powers is not None and np.any(np.abs(powers.value[1:] - [1.0, -1.0]) > powers.half_width(0.99)[1:]):
        (first, second), (first_sd, second_sd) = powers.value[1:], powers.sd[1:]
        warnings += (Finding.of(Code.ROTOR_POWERS, torque=first, torque_sd=first_sd, spin=second, spin_sd=second_sd),)
    return Inertia("precession", value, value * relative, half_width, fit, period, rate, warnings, powers)


def _powers(period: FloatArray, rate: FloatArray, mass: FloatArray) -> Fit | None:
    """Fit the exponents of torque and of spin in the precession rate, ideally 1 and -1; None if one is constant."""
    if min(np.unique(mass).size, np.unique(rate).size) < 2 or period.size < 5:
        return None
    design = np.column_stack((np.ones_like(period), np.log(mass), np.log(rate)))
    return calibration.linear_fit(design, -np.log(period), ("constant", "power of the torque", "power of the spin"))


def agreement(first: Inertia, second: Inertia) -> Agreement:
    """Compare two moments of inertia: difference, its 95 % limit, and weighted mean.

    Welch-Satterthwaite gives the degrees of freedom of their difference: ISO/IEC Guide 98-3 (2008), eq. G.2b.
    """
    difference, sd = first.value - second.value, math.hypot(first.sd, second.sd)
    if sd == 0.0:
        return Agreement(difference, 0.0, 0.0, first.value, 0.0)
    dof = sd**4 / (first.sd**4 / first.fit.dof + second.sd**4 / second.fit.dof)
    if first.sd == 0.0 or second.sd == 0.0:
        mean, mean_sd = (first.value if first.sd == 0.0 else second.value), 0.0
    else:
        weights = np.array([first.sd, second.sd]) ** -2.0
        mean = float(weights @ [first.value, second.value] / weights.sum())
        mean_sd = float(weights.sum() ** -0.5)
    return Agreement(difference, sd, sd * calibration.coverage_factor(dof), mean, mean_sd)


def _slope(x: FloatArray, y: FloatArray, where: str) -> Fit:
    if np.unique(x).size < 3:
        raise InputError("lab.few_values", where=where, count=np.unique(x).size)
    return calibration.linear_fit(x[:, None], y, ("slope",), where=where)


def _suspicions(fit: Fit, x: FloatArray, y: FloatArray, missed: Code) -> tuple[Finding, ...]:
    """Report a line that misses the origin, few points, or an outlier."""
    warnings: list[Finding] = []
    if x.size > 3:
        affine = calibration.linear_fit(np.column_stack((np.ones_like(x), x)), y, ("intercept", "slope"))
        if abs(affine.value[0]) > affine.half_width(0.99)[0]:
            warnings.append(Finding.of(missed, intercept_sigma=abs(affine.value[0]) / affine.sd[0]))
    warnings += calibration.few("measurements", x.size, USUAL)
    return (*warnings, *(calibration.outlier(fit, row) for row in calibration.outliers(fit, x[:, None])))


def _positive(where: str, **columns: FloatArray) -> None:
    for name, values in columns.items():
        if not (values > 0.0).all():
            row = int(np.argmin(values > 0.0))
            raise InputError("lab.not_positive", where=where, row=row + 1, column=name, value=values[row])
