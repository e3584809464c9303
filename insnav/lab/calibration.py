"""Common parts of all bench methods: least squares, options, reading, fitting, findings, result and its impact.

A method is a module with `read` and `fit` (see `Method`); `METHODS` has the module of each command. Linear least
squares: G. A. F. Seber and A. J. Lee, Linear Regression Analysis, 2nd ed. (2003), chapters 3 (estimation), 5
(confidence intervals) and 10 (deleted residuals).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, Protocol, TypedDict, TypeVar, cast

import numpy as np
from scipy.special import stdtrit

from insnav.earth import radii
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.model import AxisMap, DynamicMap, ImuErrors, correct, corrupt
from insnav.imu.specification import zero_matrix, zeros
from insnav.input.formats.table import Table
from insnav.lab.multi_position.triad import Triad
from insnav.quantity import Quantity
from insnav.sample_statistics import rms
from insnav.simulate.truth import circle, imu_from_truth, reference, straight
from insnav.strapdown import increments, intervals, navigate
from insnav.types import BoolArray, FloatArray, ImuData, Trajectory
from insnav.units import DEG, G0, UNITS

RANK_TOLERANCE = 1e-9  # smaller singular values of the scaled design, relative to the largest, count as zero
AFFINE = ("sensitivity to x", "to y", "to z", "bias")  # parameters of one sensor: sensitivity to three axes, and bias
LEVEL = 0.95  # confidence level of an interval, unless stated otherwise
FALSE_ALARM = 0.05  # probability that any row of a good fit is reported as an outlier
R = TypeVar("R")
D = TypeVar("D")

METHODS = {
    "gyro": "single_axis.rate_table",
    "accel": "single_axis.tumble",
    "imu": "rate_sweep",
    "nine": "nine_position",
    "poses": "multi_position.method",
    "rotor": "rotor_inertia",
}
WRONG_UNIT = 0.25  # a larger scale factor error of a sensor with outputs in SI units means a wrong unit
MINUTE = 60.0  # length of the navigation that is simulated for the impact of a calibration [s]
RATE = 50  # sampling rate of the simulated navigation [Hz]
PLACE = np.array([45.0 * DEG, 0.0, 0.0])  # start of this navigation: latitude [rad], longitude [rad], height [m]
SAMPLES, SEED = 24, 1  # number of sampled sets of true errors, and their random seed
TURN = 10.0 * DEG  # turn rate on the simulated circle [rad/s]
SPEED = 10.0  # speed on the simulated circle [m/s]


@dataclass(frozen=True, slots=True)
class Fit:
    """Result of linear least squares."""

    names: tuple[str, ...]  # names of the k parameters
    value: FloatArray  # (k,) estimates
    covariance: FloatArray  # (k, k) covariance of the estimates, from the scatter of the residuals
    residual: FloatArray  # (n,) measured minus fitted, in the unit of the measurement
    sigma: float  # standard deviation of a measurement: root of the sum of squares over `dof`
    dof: int  # degrees of freedom, ``n - k``
    condition: float  # condition number of the design with columns of length 1, independent of units

    @property
    def sd(self) -> FloatArray:
        """One standard deviation of each estimate, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals: the sum of squares over n, not over `dof`."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def worst(self) -> int:
        """Row of the largest residual."""
        return int(np.argmax(np.abs(self.residual)))

    def half_width(self, level: float = LEVEL) -> FloatArray:
        """Compute the half width of the confidence interval of each estimate, (k,).

        `level`: probability that the interval contains the true value, for normally distributed errors.
        """
        return self.sd * coverage_factor(self.dof, level)


def coverage_factor(dof: float, level: float = LEVEL) -> float:
    """Compute the half width of a confidence interval in standard deviations: Student's t.

    `dof`: degrees of freedom of the standard deviation, infinite if it is known. `level`: probability of the interval.
    """
    return float(stdtrit(min(dof, 1e9), 0.5 + 0.5 * level))


def outliers(fit: Fit, design: FloatArray) -> tuple[int, ...]:
    """Find the rows of a fit with outlying residuals.

    Each residual is compared with the scatter of all other rows (deleted residual: Seber and Lee, section 10.2). A good
    fit has an outlier with probability `FALSE_ALARM`.

    `design` (n, k): design matrix of the fit.
    """
    if fit.dof < 2 or fit.sigma <= 0.0:
        return ()
    leverage = np.sum((design @ (fit.covariance / fit.sigma**2)) * design, axis=1)
    spare = np.maximum(fit.dof * fit.sigma**2 * (1.0 - leverage) - fit.residual**2, 1e-300)
    deleted = np.abs(fit.residual) * np.sqrt((fit.dof - 1) / spare)
    limit = coverage_factor(fit.dof - 1, 1.0 - FALSE_ALARM / fit.residual.size)
    return tuple(int(row) for row in np.flatnonzero(deleted > limit))


def linear_fit(design: FloatArray, measured: FloatArray, names: Sequence[str], *, where: str = "") -> Fit:
    """Fit ``measured = design @ parameters`` by least squares.

    `design` (n, k): derivative of each measurement by each parameter. `measured` (n,): measurements with independent
    errors of equal variance.
    Raises: InputError: a value that is not finite, no more measurements than parameters, or undetermined parameters.
    """
    design = np.asarray(design, dtype=np.float64)
    measured = np.asarray(measured, dtype=np.float64)
    n, k = design.shape
    finite = np.isfinite(design).all(axis=1) & np.isfinite(measured)
    if not finite.all():
        raise InputError("lab.not_finite", where=where, row=int(np.argmin(finite)) + 1)
    if n <= k:
        raise InputError("lab.few_measurements", where=where, parameters=tuple(names), count=n, unknowns=k, limit=k + 1)
    lengths = np.linalg.norm(design, axis=0)
    zero_columns = [name for name, length in zip(names, lengths, strict=True) if not length > 0.0]
    if zero_columns:
        raise InputError("lab.parameters_idle", where=where, parameters=tuple(zero_columns))
    left, singular, right = np.linalg.svd(design / lengths, full_matrices=False)
    weak = singular <= RANK_TOLERANCE * singular[0]
    if weak.any():
        shares = np.sqrt(np.sum(right[weak] ** 2, axis=0))  # weight of each parameter in the undetermined combinations
        involved = [name for name, share in zip(names, shares, strict=True) if share > 1e-6]
        raise InputError("lab.parameters_mixed", where=where, parameters=tuple(involved))
    value = right.T @ ((left.T @ measured) / singular) / lengths
    residual = measured - design @ value
    dof = n - k
    sigma = float(np.sqrt(np.sum(residual**2) / dof))
    inverse = (right.T / singular) / lengths[:, None]
    return Fit(
        names=tuple(names),
        value=value,
        covariance=sigma**2 * inverse @ inverse.T,
        residual=residual,
        sigma=sigma,
        dof=dof,
        condition=float(singular[0] / singular[-1]),
    )


def affine_fits(
    true: FloatArray, measured: FloatArray, where: Sequence[str], used: BoolArray | None = None
) -> tuple[Fit, ...]:
    """Fit each column of `measured` (n, m) by the columns of `true` (n, 3) and a bias. `used` (n, m): rows to fit."""
    design = np.column_stack((true, np.ones(len(true))))
    rows = np.ones(measured.shape, dtype=np.bool_) if used is None else used
    sensors = zip(measured.T, rows.T, where, strict=True)
    return tuple(linear_fit(design[keep], column[keep], AFFINE, where=name) for column, keep, name in sensors)


class BenchInputs(TypedDict, total=False):
    """Keywords of `BenchOptions`."""

    columns: Mapping[str, str] | None
    spike_limit: float | None
    gravity: float
    gravity_source: str
    name: str
    keep: tuple[float, float] | None
    intercepts: Mapping[str, float] | None
    counts: bool
    six: bool
    sections: Mapping[str, tuple[int, int]] | str | Path | None
    turn: float
    axes: str | None
    units: str | None
    sampling: str | None
    stamp: str | None
    fall_mass: float
    radius: float
    mass: float
    arm: float


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """Options of the calibration methods; each method uses its own. Raises: ConfigError: an invalid value."""

    columns: Mapping[str, str] | None = None  # header by quantity, for headers that insnav does not recognise
    # largest distance of samples from a polynomial through their dwell, in the unit of the output; default 0.005 V, no
    # limit for other units
    spike_limit: float | None = None
    gravity: float = G0  # local gravity at the bench [m/s^2]
    gravity_source: str = "as given"  # source of the gravity value
    name: str = ""  # name of the calibrated sensor
    # smallest and largest rate of a rate table to use [deg/s]; default all that are linear
    keep: tuple[float, float] | None = None
    # intercepts of pieces of a rate sweep's compensation, in place of fitted ones; "x2": second piece of gyro x [deg/s]
    intercepts: Mapping[str, float] | None = None
    counts: bool = False  # a multi-position record is in raw counts or volts
    six: bool = False  # a multi-position record consists of six positions and three turns
    # first sample and last sample plus one of each position and turn, or a file with them; default: detected
    sections: Mapping[str, tuple[int, int]] | str | Path | None = None
    turn: float = 2.0 * np.pi  # angle of each turn of a six-position record [rad]
    # interpretation of a multi-position record; see `insnav.input.read_imu`
    axes: str | None = None
    units: str | None = None
    sampling: str | None = None
    stamp: str | None = None
    fall_mass: float = 0.0  # falling weight that spins up a rotor [kg]
    radius: float = 0.0  # radius of the drum on which its cord is wound [m]
    mass: float = 0.0  # weight that makes a rotor precess [kg]
    arm: float = 0.0  # distance of this weight from the support [m]

    def __post_init__(self) -> None:
        if self.spike_limit is not None and not 0.0 < self.spike_limit < float("inf"):
            raise ConfigError("lab.spike_limit", where="--spike-limit", limit=self.spike_limit)
        if not 9.7 < self.gravity < 9.9:
            raise ConfigError("lab.gravity", where="--gravity", gravity_m_s2=self.gravity)


STANDARD = BenchOptions()


@dataclass(frozen=True, slots=True)
class CalibrationSd:
    """Uncertainty of calibrated errors: one standard deviation of each number, all independent."""

    gyro_bias: FloatArray = field(default_factory=zeros)  # (3,) gyro biases [rad/s]
    gyro_matrix: FloatArray = field(default_factory=zero_matrix)  # (3, 3) gyro sensitivities [-]
    accel_bias: FloatArray = field(default_factory=zeros)  # (3,) accelerometer biases [m/s^2]
    accel_matrix: FloatArray = field(default_factory=zero_matrix)  # (3, 3) accelerometer sensitivities [-]
    g_sensitivity: FloatArray = field(default_factory=zero_matrix)  # (3, 3) gyro g-sensitivities [rad/s/(m/s^2)]
    # (k, k) covariance of the errors at the knots of the map of each gyro [rad^2/s^2]
    gyro_map: tuple[FloatArray | None, ...] = (None, None, None)

    def corrected(self, errors: ImuErrors, rate: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the uncertainty of corrected rates and specific forces due to the calibration alone.

        `errors`: the calibrated errors. `rate`, `force` (n, 3): true rates and specific forces [rad/s], [m/s^2].
        Returns rate_sd, force_sd (n, 3): one standard deviation, for sensors that are nearly a perfect triad [rad/s],
        [m/s^2].
        """
        rate_variance = rate**2 @ self.gyro_matrix.T**2 + force**2 @ self.g_sensitivity.T**2 + self.gyro_bias**2
        maps = () if errors.gyro_map is None else zip(errors.gyro_map.axes, self.gyro_map, strict=True)
        for axis, (item, covariance) in enumerate(maps):
            if item is not None and covariance is not None:
                weights = np.column_stack([np.interp(rate[:, axis], item.rate, row) for row in np.eye(item.rate.size)])
                rate_variance[:, axis] += np.sum((weights @ covariance) * weights, axis=1)
        return np.sqrt(rate_variance), np.sqrt(force**2 @ self.accel_matrix.T**2 + self.accel_bias**2)


@dataclass(frozen=True, slots=True)
class Impact:
    """Horizontal position error after one minute of free inertial navigation, root mean square."""

    motion: str  # motion in words
    without: float  # error without the calibration [m]
    corrected: float  # error with the calibration [m]


@dataclass(frozen=True, slots=True, repr=False)
class Calibration(Generic[R, D]):
    """Result of a calibration method."""

    method: str  # name of the method, one of `METHODS`
    errors: ImuErrors | None  # as written to the calibration file; None if the method calibrates no IMU
    sd: CalibrationSd  # uncertainty of `errors` in SI units
    parameters: tuple[Quantity, ...]  # estimates with standard deviation and 95 % interval
    fits: Mapping[str, Fit]  # least-squares fits of the parameters, by sensor
    record: R  # input of the method; for samples, their interpretation
    detail: D  # further results, specific to the method
    options: BenchOptions  # options used
    warnings: tuple[Finding, ...] = ()
    # errors of rates and specific forces, if the file has errors of volts or counts; see `physical`
    sensed: ImuErrors | None = None
    impact: tuple[Impact, ...] = ()  # impact on navigation

    def __repr__(self) -> str:
        """Return method, number of parameters and number of warnings."""
        counts = f"{len(self.parameters)} parameters, {len(self.warnings)} warnings"
        return f"{type(self).__name__}({self.method!r}, {counts})"


class Method(Protocol[R, D]):
    """Interface of a calibration method."""

    def read(self, files: Sequence[str | Path | Table], how: BenchOptions) -> R:
        """Read the files of the bench."""

    def fit(self, record: R, how: BenchOptions) -> Calibration[R, D]:
        """Estimate the errors, and their uncertainty."""


def method_named(name: str) -> Method[Any, Any]:
    """Find a calibration method. Raises: ConfigError: no method has this name."""
    if name not in METHODS:
        raise ConfigError("lab.no_method", method=name, known=tuple(METHODS))
    return cast("Method[Any, Any]", import_module(f"insnav.lab.{METHODS[name]}"))


def physical(errors: ImuErrors) -> ImuErrors:
    """Convert to errors of rates and specific forces: the zero of volts or counts becomes a part of the bias."""
    gyro, accel = errors.gyro_raw, errors.accel_raw
    return replace(
        errors,
        gyro_bias=errors.gyro_bias + (0.0 if gyro is None else gyro.zero / gyro.scale),
        accel_bias=errors.accel_bias + (0.0 if accel is None else accel.zero / accel.scale),
        gyro_raw=None,
        accel_raw=None,
    )


def carried_over(new: ImuErrors, other: ImuErrors, kept: str) -> ImuErrors:
    """Copy the errors of one triad, `kept` (``gyro`` or ``accel``), from an earlier calibration into a new one."""
    fields = [field for field in new.__dataclass_fields__ if field.startswith(f"{kept}_")]
    return replace(new, **{field: getattr(other, field) for field in fields})


def measured(name: str, value: float, unit: str, sd: float | None = None, half_width: float | None = None) -> Quantity:
    """Build a quantity from values in the display unit.

    `value`, `sd`, `half_width`: estimate, standard deviation and half its 95 % interval, in `unit`. `unit`: one
    of `insnav.units`, from which values are converted to SI, or any other.
    """
    factor = UNITS[unit][1] if unit in UNITS else 1.0
    key = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_")
    interval = None
    if half_width is not None:
        interval = float(value - half_width) * factor, float(value + half_width) * factor
    return Quantity(key, float(value) * factor, unit, None if sd is None else float(sd) * factor, interval, name)


def fitted(fit: Fit, units: Sequence[str], sensor: str = "") -> tuple[Quantity, ...]:
    """Build a quantity of each parameter of a fit. `units`: display units. `sensor`: prefix of the names."""
    rows = zip(fit.names, fit.value, units, fit.sd, fit.half_width(), strict=True)
    return tuple(measured(f"{sensor} {name}".strip(), *row) for name, *row in rows)


def common_unit(units: Sequence[tuple[str, str]]) -> str:
    """Return the common unit of outputs. `units`: pairs of name and unit. Raises: InputError: the units differ."""
    if len({unit for _, unit in units}) > 1:
        raise InputError("lab.mixed_units", units=tuple(dict.fromkeys(f"{name}: {unit}" for name, unit in units)))
    return units[0][1]


BADLY_CONDITIONED = 30.0  # condition number beyond which parameters are hardly separated


def about(name: str, findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Add the name of a sensor or a file to the subjects of findings: ``gyro x (rates.csv)``."""
    return tuple(replace(item, subject=f"{item.subject} ({name})" if item.subject else name) for item in findings)


def badly_conditioned(fits: Mapping[str, Fit] | Mapping[str, Triad]) -> tuple[Finding, ...]:
    """Report fits that hardly separate their parameters. `fits`: by sensor."""
    return tuple(
        Finding.of(Code.BENCH_CONDITION, subject=name, condition=fit.condition, limit=BADLY_CONDITIONED)
        for name, fit in fits.items()
        if fit.condition > BADLY_CONDITIONED
    )


def few(what: str, count: int, usual: int, subject: str = "") -> tuple[Finding, ...]:
    """Report a smaller count than usual. `what`: name of the counted items in the catalogue, such as ``rates``."""
    finding = Finding.of(Code.BENCH_FEW, subject=subject, count=count, limit_count=usual, what=what)
    return (finding,) if count < usual else ()


def outlier(fit: Fit, row: int, angle_rad: float = math.nan) -> Finding:
    """Report an outlying row of a fit, one of `insnav.lab.calibration.outliers`."""
    residual_sigma = abs(float(fit.residual[row])) / fit.sigma
    return Finding.of(Code.BENCH_OUTLIER, residual_sigma=residual_sigma, row=row + 1, angle_rad=angle_rad)


def warming(temperature: FloatArray | None, limit: float) -> tuple[Finding, ...]:
    """Report a change of the temperature (n,) [deg C] by more than a limit [K]; empty if it is smaller."""
    if temperature is None or np.ptp(temperature) <= limit:
        return ()
    low, high = np.min(temperature), np.max(temperature)
    return (Finding.of(Code.BENCH_TEMPERATURE, change_k=high - low, limit_k=limit, low_c=low, high_c=high),)


def navigation_impact(errors: ImuErrors, sd: CalibrationSd) -> tuple[Impact, ...]:
    """Navigate a simulated minute at rest and on a circle, with and without the calibration.

    True errors are sampled about the calibrated errors with their uncertainty; sensors have no other errors. Navigation
    begins with the true state and is height-constrained.
    """
    known = physical(errors)
    rng = np.random.default_rng(SEED)
    truths = [_sampled(known, sd, rng) for _ in range(SAMPLES)]
    impacts = []
    for words, motion in (
        ("at rest", straight(PLACE, 0.0, 0.0, MINUTE)),
        (f"circle, {SPEED:g} m/s, turning {TURN / DEG:g} deg/s", circle(PLACE, SPEED, TURN, MINUTE)),
    ):
        perfect = imu_from_truth(motion, np.arange(int(MINUTE * RATE) + 1) / RATE)
        path = reference(motion, np.concatenate(([0.0], perfect.time)))
        measured = [corrupt(perfect, samples) for samples in truths]
        without = [_error(path, samples) for samples in measured]
        corrected = [_error(path, correct(samples, known)) for samples in measured]
        impacts.append(Impact(words, rms(without), rms(corrected)))
    return tuple(impacts)


def _sampled(known: ImuErrors, sd: CalibrationSd, rng: np.random.Generator) -> ImuErrors:
    gyro_map, terms = known.gyro_map, known.gyro_terms
    if gyro_map is not None:
        maps = zip(gyro_map.axes, sd.gyro_map, strict=True)
        gyro_map = DynamicMap(tuple(_sampled_map(item, spread, rng) for item, spread in maps))
    if terms is not None:
        terms = replace(terms, g_sensitivity=terms.g_sensitivity + sd.g_sensitivity * rng.standard_normal((3, 3)))
    return replace(
        known,
        gyro_bias=known.gyro_bias + sd.gyro_bias * rng.standard_normal(3),
        gyro_matrix=known.gyro_matrix + sd.gyro_matrix * rng.standard_normal((3, 3)),
        accel_bias=known.accel_bias + sd.accel_bias * rng.standard_normal(3),
        accel_matrix=known.accel_matrix + sd.accel_matrix * rng.standard_normal((3, 3)),
        gyro_map=gyro_map,
        gyro_terms=terms,
    )


def _sampled_map(item: AxisMap | None, spread: FloatArray | None, rng: np.random.Generator) -> AxisMap | None:
    if item is None or spread is None:
        return item
    return replace(item, error=item.error + np.linalg.cholesky(spread) @ rng.standard_normal(item.rate.size))


def _error(path: Trajectory, imu: ImuData) -> float:
    vertical = path.lla[1:, 2], path.v_n[1:, 2]
    n = len(imu.time)
    navigated = navigate(increments(intervals(imu)), path.lla[0], path.v_n[0], path.rph[0], vertical=vertical, every=n)
    meridian, transverse = radii(path.lla[-1, 0])
    north, east = (navigated.lla[-1] - path.lla[-1])[:2]
    return float(np.hypot(north * meridian, east * transverse * np.cos(path.lla[-1, 0])))
