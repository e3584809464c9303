"""The IMU error model: one deterministic object used in both directions, and the sizes of the random errors.

measured = matrix @ true + bias, with matrix = I + S + M: scale factor errors S on the diagonal,
misalignment M off it; P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
Systems, 2nd ed. (2013), eqs. 4.17 and 4.18, without their g-dependent and noise terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.imu.dynamic_map import DynamicMap
from insnav.imu.raw import RawScale
from insnav.types import FloatArray, ImuData
from insnav.units import G0

MAX_CONDITION = 1e6  # beyond it the inverse of the matrix would lose what sensors can resolve


def _zeros() -> FloatArray:
    return np.zeros(3)


def _eye() -> FloatArray:
    return np.eye(3)


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """How large the errors of a sensor triad are, one standard deviation per axis.

    Attributes
    ----------
    bias : (3,) array
        Turn-on bias, constant over one run [rad/s] or [m/s^2].
    bias_instability : (3,) array
        Standard deviation of the in-run bias, a first-order Gauss-Markov process [rad/s] or [m/s^2].
    correlation_time : float
        Correlation time of that process [s]; infinite where there is no such process.
    random_walk : (3,) array
        Root power spectral density of the white noise [rad/sqrt(s)] or [m/s/sqrt(s)].
    scale_factor : (3,) array
        Scale factor error [-].
    misalignment : (3,) array
        Misalignment of each sensitive axis [rad].
    rate_random_walk : (3,) array
        Root power spectral density of the noise that drives a random walk of the bias [rad/s/sqrt(s)] or
        [m/s^2/sqrt(s)].
    """

    bias: FloatArray = field(default_factory=_zeros)
    bias_instability: FloatArray = field(default_factory=_zeros)
    correlation_time: float = math.inf
    random_walk: FloatArray = field(default_factory=_zeros)
    scale_factor: FloatArray = field(default_factory=_zeros)
    misalignment: FloatArray = field(default_factory=_zeros)
    rate_random_walk: FloatArray = field(default_factory=_zeros)


def gyro_bias_sd(gyro: SensorSpec) -> FloatArray:
    """Standard deviation of the whole bias of gyros, turn-on and in-run, (3,) [rad/s]."""
    return np.hypot(gyro.bias, gyro.bias_instability)


def level_bias_sd(accel: SensorSpec) -> FloatArray:
    """Standard deviation of the whole bias of accelerometers that are about level, (3,) [m/s^2]."""
    return np.hypot(level_bias(accel), accel.bias_instability)


def level_bias(accel: SensorSpec) -> FloatArray:
    """Turn-on bias of accelerometers that are about level: misaligned, they sense a part of gravity, (3,) [m/s^2]."""
    return np.hypot(accel.bias, G0 * accel.misalignment)


@dataclass(frozen=True, slots=True)
class InitialSpec:
    """Standard deviations of the initial state, for error budgets and simulation.

    Attributes
    ----------
    position : float
        Each component of position [m].
    velocity : float
        Each component of velocity [m/s].
    tilt : float
        Roll and pitch [rad].
    heading : float
        Heading [rad].
    """

    position: float = 0.0
    velocity: float = 0.0
    tilt: float = 0.0
    heading: float = 0.0


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """How good an IMU is.

    Attributes
    ----------
    name : str
        Name of the preset, or the name in the file.
    gyro, accel : SensorSpec
        Sizes of the errors of the gyros and of the accelerometers.
    initial : InitialSpec or None
        Initial errors, if the file gives them.
    source : str
        Where the figures come from.
    absent : tuple of str
        Dotted names of everything that was not given and therefore counts as zero.
    """

    name: str
    gyro: SensorSpec
    accel: SensorSpec
    initial: InitialSpec | None = None
    source: str = ""
    absent: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Known errors of one IMU: measured = matrix @ true + bias, for the gyros and for the accelerometers.

    Attributes
    ----------
    gyro_bias : (3,) array
        Gyro bias [rad/s].
    gyro_matrix : (3, 3) array
        Gyro sensitivity, identity plus scale factor errors (diagonal) plus misalignment (off-diagonal) [-].
    accel_bias : (3,) array
        Accelerometer bias [m/s^2].
    accel_matrix : (3, 3) array
        Accelerometer sensitivity [-].
    name : str
        What was calibrated.
    date : str
        When.
    temperature : float or None
        At which temperature [deg C].
    gyro_map : DynamicMap or None
        Error that non-linear gyros have left after all else is taken off.
    gyro_raw, accel_raw : RawScale or None
        How the volts or counts of a file become rates and specific forces, if they do; for the reader, not for
        `correct`, which takes what the reader makes of them.

    Raises
    ------
    ConfigError
        An array of another shape, a value that is not finite, or a matrix that cannot be inverted.
    """

    gyro_bias: FloatArray = field(default_factory=_zeros)
    gyro_matrix: FloatArray = field(default_factory=_eye)
    accel_bias: FloatArray = field(default_factory=_zeros)
    accel_matrix: FloatArray = field(default_factory=_eye)
    name: str = ""
    date: str = ""
    temperature: float | None = None
    gyro_map: DynamicMap | None = None
    gyro_raw: RawScale | None = None
    accel_raw: RawScale | None = None

    def __post_init__(self) -> None:
        for sensor, bias, matrix in (
            ("gyro", self.gyro_bias, self.gyro_matrix),
            ("accel", self.accel_bias, self.accel_matrix),
        ):
            if np.shape(bias) != (3,) or np.shape(matrix) != (3, 3):
                raise ConfigError(
                    f"the {sensor} calibration needs a bias of 3 values and a matrix of 3 x 3",
                    where=f"{sensor}.bias, {sensor}.matrix",
                    why=f"their shapes are {np.shape(bias)} and {np.shape(matrix)}",
                )
            if not (np.isfinite(bias).all() and np.isfinite(matrix).all()):
                raise ConfigError(f"the {sensor} calibration has a value that is not finite", where=sensor)
            condition = float(np.linalg.cond(matrix))
            if not condition < MAX_CONDITION:
                raise ConfigError(
                    f"the {sensor} matrix cannot be inverted",
                    where=f"{sensor}.matrix",
                    why=f"its condition number is {condition:.3g}; a sensor triad has one near 1",
                    fix="write it by rows: measured = matrix @ true + bias; the identity is a perfect triad",
                )


def sample_intervals(imu: ImuData) -> FloatArray:
    """Length of the interval each sample stands for.

    The spacing to the sample before; the first sample, which has none, gets the median spacing.

    Parameters
    ----------
    imu : ImuData
        Samples, at least two.

    Returns
    -------
    (n,) array
        Interval lengths [s].

    Raises
    ------
    InputError
        Fewer than two samples: the spacing is not known.
    """
    if imu.time.size < 2:
        raise InputError("the sampling interval needs at least two IMU samples", why=f"there are {imu.time.size}")
    spacing = np.diff(imu.time)
    return np.concatenate(([np.median(spacing)], spacing))


def _bias_scale(imu: ImuData) -> FloatArray | float:
    """Factor that brings a bias to the unit of the samples: the interval for increments."""
    return sample_intervals(imu)[:, None] if imu.sampling == "increment" else 1.0


def corrupt(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Add known errors: what an IMU with these errors shows when the truth is `imu`.

    Parameters
    ----------
    imu : ImuData
        True rates and specific forces, or their integrals.
    errors : ImuErrors
        Errors to add.

    Returns
    -------
    ImuData
        ``matrix @ true + bias``; the bias is multiplied by the sampling interval for increments.

    Raises
    ------
    InputError
        Increments of fewer than two samples, whose interval is not known.
    """
    scale = _bias_scale(imu)
    if errors.gyro_map is not None:
        imu = replace(imu, gyro=errors.gyro_map.inverse(imu.gyro / scale) * scale)
    gyro = imu.gyro @ errors.gyro_matrix.T + errors.gyro_bias * scale
    accel = imu.accel @ errors.accel_matrix.T + errors.accel_bias * scale
    return replace(imu, gyro=gyro, accel=accel)


def correct(imu: ImuData, errors: ImuErrors) -> ImuData:
    """Remove known errors from measured samples: the exact inverse of `corrupt`.

    Parameters
    ----------
    imu : ImuData
        Measured rates and specific forces, or their integrals.
    errors : ImuErrors
        Errors to remove, from a calibration.

    Returns
    -------
    ImuData
        ``inverse(matrix) @ (measured - bias)``.

    Raises
    ------
    InputError
        Increments of fewer than two samples, whose interval is not known.
    """
    scale = _bias_scale(imu)
    gyro = np.linalg.solve(errors.gyro_matrix, (imu.gyro - errors.gyro_bias * scale).T).T
    accel = np.linalg.solve(errors.accel_matrix, (imu.accel - errors.accel_bias * scale).T).T
    if errors.gyro_map is not None:
        gyro = errors.gyro_map.apply(np.asarray(gyro / scale)) * scale
    return replace(imu, gyro=np.ascontiguousarray(gyro), accel=np.ascontiguousarray(accel))


def draw_errors(spec: ImuSpec, rng: np.random.Generator) -> ImuErrors:
    """Draw the constant errors of one specimen: turn-on bias, scale factor and misalignment.

    Parameters
    ----------
    spec : ImuSpec
        Standard deviations, all errors independent and Gaussian.
    rng : numpy.random.Generator
        Source of randomness; always 30 numbers are taken, so that a zero does not shift what follows.

    Returns
    -------
    ImuErrors
        For `corrupt`.
    """

    def draw(sensor: SensorSpec) -> tuple[FloatArray, FloatArray]:
        bias = rng.standard_normal(3) * sensor.bias
        matrix = rng.standard_normal((3, 3)) * sensor.misalignment[:, None]
        np.fill_diagonal(matrix, 1.0 + rng.standard_normal(3) * sensor.scale_factor)
        return bias, matrix

    gyro_bias, gyro_matrix = draw(spec.gyro)
    accel_bias, accel_matrix = draw(spec.accel)
    return ImuErrors(gyro_bias, gyro_matrix, accel_bias, accel_matrix, name=spec.name)
