"""IMU error model: add known errors to true samples, remove them from measured samples, sample random errors.

measured = matrix @ true + bias, with matrix = I + S + M: scale factor errors S on the diagonal, misalignment M off it;
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013), eqs. 4.17 and
4.18. Raw outputs, volts or counts, are first converted to rates and specific forces.

Further errors are asymmetry a, curvature q, temperature slopes s (scale factor) and b (bias), g-sensitivity G, size
effect. With z = matrix @ true, the output before the bias is added is

    y = (1 + s dT) z + a |z| + q z^2 + b dT [+ G f for gyros],    dT = T - T_ref

with all terms per axis except the g-sensitivity ``G`` of gyros to the specific force ``f``. The accelerometers sense
``f`` at their own positions: ``f + dw/dt x r + w x (w x r)`` (the size effect). IEEE Std 952-1997 section 1.3 and IEEE
Std 1293-2018 annex A list these terms; Groves (2013), sections 4.4.3 to 4.4.6.

Dynamic compensation corrects the remaining non-linearity of gyros by a continuous, piecewise linear map. In each range
of the measured rate m the error is ``k m + b``, and the corrected rate ``m - (k m + b)``. The lines meet at the
borders, and every ``k`` is below 1, so the map has exactly one inverse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial

import numpy as np

from insnav import spill
from insnav.exceptions import ConfigError, InputError
from insnav.imu.specification import ImuSpec, SensorSpec, zero_matrix, zeros
from insnav.types import FloatArray, ImuData
from insnav.units import UNITS, units_of

REFERENCE_TEMPERATURE = 25.0  # default temperature of a calibration [deg C]
MAX_CONDITION = 1e6  # largest condition number of a matrix: beyond it, the inverse amplifies resolution errors too much
GAP = 1.75  # samples were lost in intervals longer than this multiple of the median interval
_eye = partial(np.eye, 3)


@dataclass(frozen=True, slots=True)
class RawScale:
    """Linear conversion of raw outputs (volts or counts) of a sensor triad: ``value = (output - zero) / scale``.

    It converts file columns to rates [rad/s] or specific forces [m/s^2] on reading, before axes are exchanged and known
    errors corrected.

    Raises ConfigError: another unit, another shape, a value that is not finite, or a scale of zero.
    """

    unit: str  # unit of the output: ``V``, ``mV``, ``uV`` or ``LSB``
    zero: FloatArray  # (3,) output of x, y, z at zero input [unit]
    # (3,) change of output per input [unit/(rad/s)] or [unit/(m/s^2)]; negative for a sensor mounted upside down
    scale: FloatArray

    def __post_init__(self) -> None:
        if self.unit not in units_of("signal"):
            raise ConfigError("imu.raw_unit", where="raw.unit", unit=self.unit, units=tuple(units_of("signal")))
        if np.shape(self.zero) != (3,) or np.shape(self.scale) != (3,):
            raise ConfigError("imu.raw_shape", where="raw.zero, raw.scale")
        if not (np.isfinite(self.zero).all() and np.isfinite(self.scale).all() and (self.scale != 0.0).all()):
            zero, scale = (str(np.asarray(each).tolist()) for each in (self.zero, self.scale))
            raise ConfigError("imu.raw_unusable", where="raw.zero, raw.scale", zero=zero, scale=scale)

    def value(self, output: FloatArray, axis: int, unit: str | None = None) -> FloatArray:
        """Convert outputs of one sensor to rate [rad/s] or specific force [m/s^2].

        `output` (n,): output of the sensor. `axis`: 0, 1, 2 for x, y, z. `unit`: unit of `output` if it is not
        `self.unit`, such as mV instead of V. Raises ConfigError: counts instead of volts, or volts instead of counts.
        """
        factor = 1.0
        if unit is not None and unit != self.unit:
            if "LSB" in (unit, self.unit):
                raise ConfigError("imu.raw_other_unit", where="raw.unit", unit=self.unit, other=unit)
            factor = UNITS[unit][1] / UNITS[self.unit][1]
        return np.asarray((output * factor - self.zero[axis]) / self.scale[axis])


@dataclass(frozen=True, slots=True)
class ErrorTerms:
    """Errors of a sensor triad besides bias and matrix, zero by default.

    Raises ConfigError: an array of another shape, a value that is not finite, or an asymmetry above 0.5.
    """

    # (3,) half the difference between the scale factors of positive and of negative inputs [-]
    asymmetry: FloatArray = field(default_factory=zeros)
    quadratic: FloatArray = field(default_factory=zeros)  # (3,) second-order non-linearity [1/(rad/s)] or [1/(m/s^2)]
    bias_slope: FloatArray = field(default_factory=zeros)  # (3,) change of bias per temperature [rad/s/K] or [m/s^2/K]
    scale_slope: FloatArray = field(default_factory=zeros)  # (3,) change of scale factor per temperature [1/K]
    # (3, 3) gyros only: rate error per specific force [rad/s/(m/s^2)]
    g_sensitivity: FloatArray = field(default_factory=zero_matrix)
    # (3, 3) accelerometers only: row i is the position of accelerometer i from the navigated point, body axes [m]
    positions: FloatArray = field(default_factory=zero_matrix)

    def __post_init__(self) -> None:
        for name, shape in SHAPES.items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                shown = str(value.tolist())[:100]
                raise ConfigError("imu.terms_shape", where=name, name=name, shape=shape, value=shown)
        if np.abs(self.asymmetry).max() > 0.5:
            raise ConfigError("imu.asymmetry", where="asymmetry")

    @property
    def by_temperature(self) -> bool:
        """True if an error depends on temperature."""
        return bool(np.any(self.bias_slope) or np.any(self.scale_slope))

    def shown(self, z: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """Compute the sensor output y of the module's formula, before bias and g-sensitivity are added, (n, 3).

        `z` (n, 3): matrix @ true input [rad/s] or [m/s^2]. `warmer` (n,): temperature above the reference [K]; None:
        nothing depends on temperature.
        """
        y = z * self._gain(warmer) + self.asymmetry * np.abs(z) + self.quadratic * z * z
        return np.asarray(y if warmer is None else y + warmer[:, None] * self.bias_slope)

    def meant(self, y: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """Invert `shown`: solve its quadratic equation for z, in a form without cancellation.

        `y` (n, 3): output without bias and g-sensitivity [rad/s] or [m/s^2]. `warmer` (n,): temperature above the
        reference [K]. Raises InputError: an output that no input gives, because of the curvature.
        """
        if warmer is not None:
            y = y - warmer[:, None] * self.bias_slope
        side = np.where(y < 0.0, -1.0, 1.0)
        slope = self._gain(warmer) + side * self.asymmetry
        discriminant = slope * slope + 4.0 * self.quadratic * y
        if np.any(discriminant < 0.0):
            raise InputError("imu.beyond_vertex", where="quadratic", count=int(np.sum(discriminant < 0.0)))
        return np.asarray(2.0 * y / (slope + np.sqrt(discriminant)))

    def _gain(self, warmer: FloatArray | None) -> FloatArray:
        return np.ones(3) if warmer is None else 1.0 + warmer[:, None] * self.scale_slope


SHAPES = {each.name: (3, 3) if each.default_factory is zero_matrix else (3,) for each in fields(ErrorTerms)}
_SAMPLED_TERMS = tuple(key for key in SHAPES if key != "positions")
SAMPLED = frozenset({"bias", "scale_factor", "misalignment", *_SAMPLED_TERMS})  # errors that `sample_errors` samples


def size_effect(rate: FloatArray, dt: FloatArray, positions: FloatArray) -> FloatArray:
    """Compute the additional specific force of accelerometers due to their positions (Groves 2013, eq. 4.15).

    `rate` (n, 3): angular rate [rad/s]. `dt` (n,): sampling intervals [s]. `positions` (3, 3): row i is the position of
    accelerometer i [m]. Returns (n, 3): [m/s^2]. Angular acceleration is the rate difference
    between samples, so the motion must be slow compared with the sampling.
    """
    time = np.cumsum(dt)
    angular_acceleration = np.gradient(rate, time, axis=0)
    force = np.empty_like(rate)
    for axis in range(3):
        r = positions[axis]
        force[:, axis] = (np.cross(angular_acceleration, r) + np.cross(rate, np.cross(rate, r)))[:, axis]
    return force


SMALLEST_SLOPE = 0.1  # smallest slope of the compensated against the measured rate; below it, the gyro is broken


@dataclass(frozen=True, slots=True)
class AxisMap:
    """Error of one gyro as a function of its measured rate, linear between knots and beyond the outermost knots.

    Raises ConfigError: invalid arrays, or a map without inverse.
    """

    rate: FloatArray  # (k,) measured rates at the knots [rad/s], increasing, at least two
    error: FloatArray  # (k,) error at the knots, measured minus true [rad/s]

    def __post_init__(self) -> None:
        rate, error = np.asarray(self.rate), np.asarray(self.error)
        if rate.ndim != 1 or rate.size < 2 or rate.shape != error.shape:
            raise ConfigError("imu.map_shape", where="gyro.map", rates=str(rate.shape), errors=str(error.shape))
        if not (np.isfinite(rate).all() and np.isfinite(error).all() and (np.diff(rate) > 0.0).all()):
            raise ConfigError("imu.map_not_increasing", where="gyro.map")
        steepest = float((np.diff(error) / np.diff(rate)).max())
        if steepest > 1.0 - SMALLEST_SLOPE:
            raise ConfigError("imu.map_not_invertible", where="gyro.map", slope=steepest, limit=1.0 - SMALLEST_SLOPE)

    def apply(self, measured: FloatArray) -> FloatArray:
        """Subtract the error from measured rates [rad/s]."""
        return _line(self.rate, self.rate - self.error, measured)

    def rate_error(self, measured: FloatArray) -> FloatArray:
        """Compute the error that `apply` subtracts from measured rates [rad/s]."""
        return _line(self.rate, self.error, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Convert compensated rates back to measured rates [rad/s]: the inverse of `apply`."""
        return _line(self.rate - self.error, self.rate, compensated)


@dataclass(frozen=True, slots=True)
class DynamicMap:
    """Maps of the rate-dependent errors of three gyros."""

    axes: tuple[AxisMap | None, ...]  # map of gyro x, y, z; None: no correction

    def apply(self, measured: FloatArray) -> FloatArray:
        """Subtract the errors from measured rates, (n, 3) [rad/s]."""
        return self._by_axis(AxisMap.apply, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Convert compensated rates back to measured rates, (n, 3) [rad/s]: the inverse of `apply`."""
        return self._by_axis(AxisMap.inverse, compensated)

    def _by_axis(self, change: Callable[[AxisMap, FloatArray], FloatArray], rate: FloatArray) -> FloatArray:
        columns = [c if a is None else change(a, c) for a, c in zip(self.axes, rate.T, strict=True)]
        return np.ascontiguousarray(np.column_stack(columns))


def _line(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate linearly between the points (x, y), and extrapolate linearly beyond them."""
    at = np.asarray(at, dtype=np.float64)
    piece = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    slope = np.diff(y) / np.diff(x)
    return np.asarray(y[piece] + slope[piece] * (at - x[piece]))


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Known errors of one IMU: measured = matrix @ true + bias, for the gyros and for the accelerometers.

    Raises: ConfigError: an array of another shape, a value that is not finite, or a singular matrix.
    """

    gyro_bias: FloatArray = field(default_factory=zeros)  # (3,) gyro bias [rad/s]
    # (3, 3) gyro sensitivity, identity plus scale factor errors (diagonal) plus misalignment (off-diagonal) [-]
    gyro_matrix: FloatArray = field(default_factory=_eye)
    accel_bias: FloatArray = field(default_factory=zeros)  # (3,) accelerometer bias [m/s^2]
    accel_matrix: FloatArray = field(default_factory=_eye)  # (3, 3) accelerometer sensitivity [-]
    name: str = ""  # name of the calibrated IMU
    date: str = ""  # calibration date
    # temperature of the calibration [deg C], at which temperature terms are zero; None: 25 deg C
    temperature: float | None = None
    gyro_map: DynamicMap | None = None  # error of non-linear gyros that remains after all other corrections
    # conversion of a file's volts or counts to rates and specific forces, if any. The reader applies it, not `correct`
    gyro_raw: RawScale | None = None
    accel_raw: RawScale | None = None
    # errors beyond bias and matrix
    gyro_terms: ErrorTerms | None = None
    accel_terms: ErrorTerms | None = None

    def __post_init__(self) -> None:
        for sensor, bias, matrix in (
            ("gyro", self.gyro_bias, self.gyro_matrix),
            ("accel", self.accel_bias, self.accel_matrix),
        ):
            if np.shape(bias) != (3,) or np.shape(matrix) != (3, 3):
                where, shapes = f"{sensor}.bias, {sensor}.matrix", (str(np.shape(bias)), str(np.shape(matrix)))
                raise ConfigError("imu.calibration_shape", where=where, sensor=sensor, bias=shapes[0], matrix=shapes[1])
            if not (np.isfinite(bias).all() and np.isfinite(matrix).all()):
                raise ConfigError("imu.calibration_not_finite", where=sensor, sensor=sensor)
            near = float(np.abs(matrix - np.eye(3)).sum()) < 0.5  # near the identity: the condition number is below 3
            if not near and not (condition := float(np.linalg.cond(matrix))) < MAX_CONDITION:
                raise ConfigError(
                    "imu.matrix_not_invertible", where=f"{sensor}.matrix", sensor=sensor, condition=condition
                )


def sample_intervals(imu: ImuData) -> FloatArray:
    """Compute the sampling interval of each sample.

    Interval: time since the previous sample. The first sample, and samples after a gap, get the median interval.

    Returns: (n,): interval lengths [s].
    Raises: InputError: fewer than two samples: the interval is unknown.
    """
    if imu.time.size < 2:
        raise InputError("data.few_samples", count=imu.time.size)
    spacing = spill.steps(imu.time)
    median = float(np.median(spacing))
    spacing[spacing > GAP * median] = median
    return spill.joined((np.array([median]), spacing))


def per_sample(imu: ImuData) -> FloatArray | float:
    """Return the factor from rates and specific forces to samples: 1, or the intervals of increments, (n, 1) [s]."""
    return sample_intervals(imu)[:, None] if imu.sampling == "increment" else 1.0


def corrupt(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Add known errors: convert true samples `imu` to the output of an IMU with these errors.

    `imu`: true rates and specific forces, or their integrals.
    Returns: ``matrix @ true + bias``, modified by the `ErrorTerms`; for increments the bias is multiplied by the
    sampling interval.
    Raises: InputError: increments of fewer than two samples, whose interval is unknown, or temperature-dependent terms
    without temperature.
    """
    if errors.gyro_terms is not None or errors.accel_terms is not None:
        return _bent(imu, errors)
    scale = per_sample(imu)
    if errors.gyro_map is not None:
        imu = replace(imu, gyro=errors.gyro_map.inverse(imu.gyro / scale) * scale)
    gyro = imu.gyro @ errors.gyro_matrix.T + errors.gyro_bias * scale
    accel = imu.accel @ errors.accel_matrix.T + errors.accel_bias * scale
    return replace(imu, gyro=gyro, accel=accel)


def correct(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Remove known errors from measured samples: the exact inverse of `corrupt`.

    `imu`: measured rates and specific forces, or their integrals.
    Returns: ``inverse(matrix) @ (measured - bias)``, after correction of the `ErrorTerms`.
    Raises: InputError: increments of fewer than two samples, whose interval is unknown, or temperature-dependent terms
    without temperature.
    """
    accel_terms = errors.accel_terms or ErrorTerms()
    size_effects = bool(np.any(accel_terms.positions))
    dt = sample_intervals(imu)[:, None] if size_effects or imu.sampling == "increment" else None
    gyro, accel = spill.empty(imu.gyro.shape), spill.empty(imu.accel.shape)
    # size effect: all samples in one block, as angular accelerations need neighbouring samples
    for part in spill.blocks(len(imu.time), size=len(imu.time) if size_effects else 0):
        gyro[part], accel[part] = _straight(imu.rows(part), None if dt is None else dt[part], errors)
    return replace(imu, gyro=gyro, accel=accel)


def _bent(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Add all errors with `ErrorTerms`: first to the force at each accelerometer, then to its output, then to gyros."""
    gyro_terms, accel_terms = errors.gyro_terms or ErrorTerms(), errors.accel_terms or ErrorTerms()
    dt, warmer = sample_intervals(imu), _warmer(imu, errors, gyro_terms.by_temperature or accel_terms.by_temperature)
    span = dt[:, None] if imu.sampling == "increment" else 1.0
    rate, force = np.asarray(imu.gyro / span), np.asarray(imu.accel / span)
    sensed_force = force + size_effect(rate, dt, accel_terms.positions) if np.any(accel_terms.positions) else force
    accel = accel_terms.shown(sensed_force @ errors.accel_matrix.T, warmer) + errors.accel_bias
    uncompensated = rate if errors.gyro_map is None else errors.gyro_map.inverse(rate)
    gyro = gyro_terms.shown(uncompensated @ errors.gyro_matrix.T, warmer) + errors.gyro_bias
    gyro = gyro + sensed_force @ gyro_terms.g_sensitivity.T
    return replace(imu, gyro=np.ascontiguousarray(gyro * span), accel=np.ascontiguousarray(accel * span))


def _straight(imu: ImuData, dt: FloatArray | None, errors: ImuErrors) -> tuple[FloatArray, FloatArray]:
    """Remove all errors: invert `_bent` in reverse order. `dt` (n, 1): sampling intervals [s], if needed."""
    gyro_terms, accel_terms = errors.gyro_terms or ErrorTerms(), errors.accel_terms or ErrorTerms()
    warmer = _warmer(imu, errors, gyro_terms.by_temperature or accel_terms.by_temperature)
    span = dt if dt is not None and imu.sampling == "increment" else 1.0
    sensed_force = accel_terms.meant(np.asarray(imu.accel / span - errors.accel_bias), warmer)
    sensed_force = np.asarray(np.linalg.solve(errors.accel_matrix, sensed_force.T).T, dtype=np.float64)
    output = np.asarray(imu.gyro / span - errors.gyro_bias - sensed_force @ gyro_terms.g_sensitivity.T)
    rate = np.ascontiguousarray(np.linalg.solve(errors.gyro_matrix, gyro_terms.meant(output, warmer).T).T)
    rate = rate if errors.gyro_map is None else errors.gyro_map.apply(rate)
    if dt is not None and np.any(accel_terms.positions):
        sensed_force = sensed_force - size_effect(rate, dt[:, 0], accel_terms.positions)
    return rate * span, sensed_force * span


def _warmer(imu: ImuData, errors: ImuErrors, matters: bool) -> FloatArray | None:
    if not matters:
        return None
    if imu.temperature is None:
        raise InputError("imu.no_temperature", where="temperature")
    reference = REFERENCE_TEMPERATURE if errors.temperature is None else errors.temperature
    return np.asarray(imu.temperature - reference)


def sample_errors(spec: ImuSpec, rng: np.random.Generator) -> ImuErrors:
    """Sample the constant errors of one sensor realisation: turn-on bias, scale factor and misalignment.

    `spec`: standard deviations, all errors independent and Gaussian. `rng`: random generator. The count of random
    numbers is always the same, so a standard deviation of zero does not change the other errors of a seed.
    """

    def sampled(sensor: SensorSpec) -> tuple[FloatArray, FloatArray]:
        bias = rng.standard_normal(3) * sensor.bias
        matrix = rng.standard_normal((3, 3)) * sensor.misalignment[:, None]
        np.fill_diagonal(matrix, 1.0 + rng.standard_normal(3) * sensor.scale_factor)
        return bias, matrix

    gyro_bias, gyro_matrix = sampled(spec.gyro)
    accel_bias, accel_matrix = sampled(spec.accel)
    terms = []
    for sensor, positions in ((spec.gyro, zero_matrix()), (spec.accel, np.asarray(spec.positions))):
        values = {"positions": positions}
        for key in _SAMPLED_TERMS:
            sd = getattr(sensor, key)
            values[key] = rng.standard_normal(SHAPES[key]) * (sd if SHAPES[key] == (3,) else sd[:, None])
        terms.append(ErrorTerms(**values) if any(value.any() for value in values.values()) else None)
    return ImuErrors(
        gyro_bias, gyro_matrix, accel_bias, accel_matrix, name=spec.name, gyro_terms=terms[0], accel_terms=terms[1]
    )
