"""Noise estimate from the innovations of a drive; alignment and initial state for this noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.alignment.static import LONG_REST
from insnav.filter.error_model import ErrorModel, InitialState, initial_state
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.sensor_axes import Misalignment
from insnav.imu.specification import ImuSpec
from insnav.types import Alignment, FloatArray


@dataclass(frozen=True, slots=True)
class NoiseFigure:
    """Estimated noise parameter."""

    key: str  # its dotted name, such as ``gyro.random_walk`` or ``gps.share``
    unit: str  # display unit
    # prior (nearest grade), estimate, and its 95 % interval; RMS of the axes; factors of reported sd [SI]
    prior: float
    value: float
    low: float
    high: float
    observable: bool  # the drive determines it; otherwise the prior does


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """Noise estimate from the innovations of a drive."""

    spec: ImuSpec  # the IMU
    filter_spec: ImuSpec  # IMU with the misalignment noise of the innovations
    careful_accel_bias: FloatArray  # (3,) upper plausible value where the drive determines it poorly [m/s^2]
    axes: Misalignment  # misalignments of the IMU
    position_factor: FloatArray  # (3,) on position standard deviations, North, East, Down [-]
    velocity_factor: FloatArray  # (3,) on velocity standard deviations [-]
    correlated: CorrelatedNoise  # time-correlated part of the position error
    figures: tuple[NoiseFigure, ...]  # estimates with intervals
    gain: float  # gain of log-likelihood over the prior
    # mean square of the normalised innovations before and with the estimate [-]
    mean_before: float
    mean_after: float
    far_off: bool  # the attitude error of the run was too large for linear innovations

    @property
    def white(self) -> FloatArray:
        """White part of the position errors, horizontal and vertical, relative to the reported sd, (2,)."""
        return np.asarray(self.position_factor[1:] * np.sqrt(1.0 - self.correlated.share))


def after_rest(alignment: Alignment, assumed: ImuSpec, estimated: ImuSpec) -> Alignment:
    """Sharpen the gyro bias of an alignment at rest if the in-run instability is smaller than assumed.

    `assumed`: the IMU of the alignment. A larger instability comes from the drive: vibration, absent at rest. In a long
    stationary period a bias changes more than in a drive, which may be short.
    """
    if alignment.static is None or alignment.static[1] - alignment.static[0] >= LONG_REST:
        return alignment
    was, now = assumed.gyro.bias_instability, estimated.gyro.bias_instability
    less = was**2 - np.minimum(was, now) ** 2
    return replace(alignment, gyro_bias_sd=np.sqrt(np.maximum(alignment.gyro_bias_sd**2 - less, 0.0)))


def start_by(initial: InitialState, alignment: Alignment, model: ErrorModel, factor: FloatArray) -> InitialState:
    """Adapt the initial state to another error model: the share of sensor errors in the attitude changes."""
    sd = np.sqrt(np.diag(initial.covariance)[:6])
    place = initial.lla, initial.v_n, sd[:3] * factor if initial.from_fix else sd[:3], sd[3:]
    return initial_state(alignment, model, *place, own=initial.own, from_fix=initial.from_fix)
