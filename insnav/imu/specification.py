"""How large the errors of an IMU are: standard deviations and noise densities of its sensors, its start, its clock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from insnav.imu.higher_order import zero_matrix, zeros
from insnav.types import FloatArray
from insnav.units import G0


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """Sizes of the errors of a sensor triad, one standard deviation per axis; see `insnav.imu.error_terms.TERMS`."""

    bias: FloatArray = field(default_factory=zeros)  # (3,) turn-on bias, constant over one run [rad/s] or [m/s^2]
    # (3,) standard deviation of the in-run bias, a first-order Gauss-Markov process [rad/s] or [m/s^2]
    bias_instability: FloatArray = field(default_factory=zeros)
    correlation_time: float = math.inf  # correlation time of that process [s]; infinite where there is no such process
    # (3,) root power spectral density of the white noise [rad/sqrt(s)] or [m/s/sqrt(s)]
    random_walk: FloatArray = field(default_factory=zeros)
    scale_factor: FloatArray = field(default_factory=zeros)  # (3,) scale factor error [-]
    # (3,) misalignment of each sensitive axis: each of the two off-diagonal terms, so that non-orthogonality of the
    # triad is in it [rad]
    misalignment: FloatArray = field(default_factory=zeros)
    # (3,) root power spectral density of the noise that drives a random walk of the bias [rad/s/sqrt(s)] or
    # [m/s^2/sqrt(s)]
    rate_random_walk: FloatArray = field(default_factory=zeros)
    # from here on: only for simulation and budget, filters ignore them
    # (3,) coefficient B of flicker noise, whose Allan deviation is flat at 0.664 B [rad/s] or [m/s^2]
    flicker: FloatArray = field(default_factory=zeros)
    rate_ramp: FloatArray = field(default_factory=zeros)  # (3,) steady drift of the bias [rad/s^2] or [m/s^3]
    # (3,) coefficient Q of quantisation noise, a step of the integrated output over sqrt(12) [rad] or [m/s]
    quantisation: FloatArray = field(default_factory=zeros)
    resolution: FloatArray = field(default_factory=zeros)  # (3,) step of each sample [rad/s] or [m/s^2]
    # (3,) largest value that is shown [rad/s] or [m/s^2]; zero for no end
    range: FloatArray = field(default_factory=zeros)
    # (3,) bias by the variance of the specific force along the axis [rad/s/(m/s^2)^2] or [1/(m/s^2)]
    vibration_rectification: FloatArray = field(default_factory=zeros)
    # (3,) standard deviations of what `ErrorTerms` has; g-sensitivity of every element of the matrix
    asymmetry: FloatArray = field(default_factory=zeros)
    quadratic: FloatArray = field(default_factory=zeros)
    bias_slope: FloatArray = field(default_factory=zeros)
    scale_slope: FloatArray = field(default_factory=zeros)
    g_sensitivity: FloatArray = field(default_factory=zeros)


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
    """Standard deviations of the initial state, for error budgets and simulation."""

    position: float = 0.0  # each component of position [m]
    velocity: float = 0.0  # each component of velocity [m/s]
    tilt: float = 0.0  # roll and pitch [rad]
    heading: float = 0.0  # heading [rad]


@dataclass(frozen=True, slots=True)
class ClockSpec:
    """What is wrong with the timestamps of an IMU, for simulation."""

    offset: float = 0.0  # timestamps are late by this [s]
    drift: float = 0.0  # and by this part of the time since the start [-]
    jitter: float = 0.0  # standard deviation of each timestamp [s]
    # mean time between drop-outs, exponentially distributed, and their mean length [s]; zero for none
    lost_every: float = 0.0
    lost_length: float = 0.0


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """How good an IMU is."""

    name: str  # name of the preset, or the name in the file
    # sizes of the errors of the gyros and of the accelerometers
    gyro: SensorSpec
    accel: SensorSpec
    initial: InitialSpec | None = None  # initial errors, if the file gives them
    source: str = ""  # where the figures come from
    absent: tuple[str, ...] = ()  # dotted names of everything that was not given and therefore counts as zero
    clock: ClockSpec = field(default_factory=ClockSpec)  # its timestamps
    # (3, 3) row i is the place of accelerometer i from the point that is navigated, body axes [m]
    positions: FloatArray = field(default_factory=zero_matrix)
