"""IMU error model: one object that corrupts and corrects samples, and sampling of sensor realisations.

measured = matrix @ true + bias, with matrix = I + S + M: scale factor errors S on the diagonal, misalignment M off it;
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013), eqs. 4.17 and
4.18. `insnav.imu.higher_order` has further terms.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from insnav import spill
from insnav.exceptions import ConfigError, InputError
from insnav.imu.higher_order import (
    REFERENCE_TEMPERATURE,
    SHAPES,
    DynamicMap,
    ErrorTerms,
    size_effect,
    zero_matrix,
    zeros,
)
from insnav.imu.raw_outputs import RawScale
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.types import FloatArray, ImuData

_SAMPLED_TERMS = tuple(key for key in SHAPES if key != "positions")
SAMPLED = frozenset({"bias", "scale_factor", "misalignment", *_SAMPLED_TERMS})  # terms of `sample_errors`
MAX_CONDITION = 1e6  # a larger condition number loses sensor resolution in the inverse
GAP = 1.75  # an interval longer than this multiple of the median has lost samples
_eye = partial(np.eye, 3)


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
    # of the calibration [deg C]; temperature terms refer to it, or to 25 deg C
    temperature: float | None = None
    gyro_map: DynamicMap | None = None  # remaining error of non-linear gyros after all other corrections
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
                raise ConfigError(
                    "imu.calibration_shape",
                    where=f"{sensor}.bias, {sensor}.matrix",
                    sensor=sensor,
                    bias=str(np.shape(bias)),
                    matrix=str(np.shape(matrix)),
                )
            if not (np.isfinite(bias).all() and np.isfinite(matrix).all()):
                raise ConfigError("imu.calibration_not_finite", where=sensor, sensor=sensor)
            near = float(np.abs(matrix - np.eye(3)).sum()) < 0.5  # to the identity: its condition number is below 3
            if not near and not (condition := float(np.linalg.cond(matrix))) < MAX_CONDITION:
                raise ConfigError(
                    "imu.matrix_not_invertible", where=f"{sensor}.matrix", sensor=sensor, condition=condition
                )


def sample_intervals(imu: ImuData) -> FloatArray:
    """Compute the length of the interval of each sample.

    It is the time since the previous sample. The first sample, and samples after a gap, get the median interval.

    Returns: (n,): interval lengths [s].
    Raises: InputError: fewer than two samples: the interval is unknown.
    """
    if imu.time.size < 2:
        raise InputError("data.few_samples", count=imu.time.size)
    spacing = spill.steps(imu.time)
    usual = float(np.median(spacing))
    spacing[spacing > GAP * usual] = usual
    return spill.joined((np.array([usual]), spacing))


def per_sample(imu: ImuData) -> FloatArray | float:
    """Return the factor from rate or specific force to the unit of the samples: for increments the interval, (n, 1)."""
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
    sized = bool(np.any(accel_terms.positions))
    dt = sample_intervals(imu)[:, None] if sized or imu.sampling == "increment" else None
    gyro, accel = spill.empty(imu.gyro.shape), spill.empty(imu.accel.shape)
    # the angular acceleration of a block needs its neighbouring samples
    for part in spill.blocks(len(imu.time), size=len(imu.time) if sized else 0):
        gyro[part], accel[part] = _straight(imu.rows(part), None if dt is None else dt[part], errors)
    return replace(imu, gyro=gyro, accel=accel)


def _bent(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Apply `corrupt` with error terms: sensed force of the accelerometers, their output, then the gyros."""
    gyro_terms, accel_terms = errors.gyro_terms or ErrorTerms(), errors.accel_terms or ErrorTerms()
    dt, warmer = sample_intervals(imu), _warmer(imu, errors, gyro_terms.by_temperature or accel_terms.by_temperature)
    span = dt[:, None] if imu.sampling == "increment" else 1.0
    rate, force = np.asarray(imu.gyro / span), np.asarray(imu.accel / span)
    felt = force + size_effect(rate, dt, accel_terms.positions) if np.any(accel_terms.positions) else force
    accel = accel_terms.shown(felt @ errors.accel_matrix.T, warmer) + errors.accel_bias
    turned = rate if errors.gyro_map is None else errors.gyro_map.inverse(rate)
    gyro = gyro_terms.shown(turned @ errors.gyro_matrix.T, warmer) + errors.gyro_bias
    gyro = gyro + felt @ gyro_terms.g_sensitivity.T
    return replace(imu, gyro=np.ascontiguousarray(gyro * span), accel=np.ascontiguousarray(accel * span))


def _straight(imu: ImuData, dt: FloatArray | None, errors: ImuErrors) -> tuple[FloatArray, FloatArray]:
    """Invert `_bent`, in the opposite order. `dt` (n, 1): lengths of the intervals [s], if needed."""
    gyro_terms, accel_terms = errors.gyro_terms or ErrorTerms(), errors.accel_terms or ErrorTerms()
    warmer = _warmer(imu, errors, gyro_terms.by_temperature or accel_terms.by_temperature)
    span = dt if dt is not None and imu.sampling == "increment" else 1.0
    felt = accel_terms.meant(np.asarray(imu.accel / span - errors.accel_bias), warmer)
    felt = np.asarray(np.linalg.solve(errors.accel_matrix, felt.T).T, dtype=np.float64)
    turning = np.asarray(imu.gyro / span - errors.gyro_bias - felt @ gyro_terms.g_sensitivity.T)
    rate = np.ascontiguousarray(np.linalg.solve(errors.gyro_matrix, gyro_terms.meant(turning, warmer).T).T)
    rate = rate if errors.gyro_map is None else errors.gyro_map.apply(rate)
    if dt is not None and np.any(accel_terms.positions):
        felt = felt - size_effect(rate, dt[:, 0], accel_terms.positions)
    return rate * span, felt * span


def _warmer(imu: ImuData, errors: ImuErrors, matters: bool) -> FloatArray | None:
    if not matters:
        return None
    if imu.temperature is None:
        raise InputError("imu.no_temperature", where="temperature")
    reference = REFERENCE_TEMPERATURE if errors.temperature is None else errors.temperature
    return np.asarray(imu.temperature - reference)


def sample_errors(spec: ImuSpec, rng: np.random.Generator) -> ImuErrors:
    """Sample the constant errors of one sensor realisation: turn-on bias, scale factor and misalignment.

    `spec`: standard deviations, all errors independent and Gaussian. `rng`: source of randomness; the count of drawn
    numbers is constant, so that a zero does not shift later values.
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
