"""Noise that the innovations of a drive show, and alignment and initial state adapted to it."""

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
    """One figure of the noise, as found."""

    key: str  # its dotted name, such as ``gyro.random_walk`` or ``gps.share``
    unit: str  # unit to show it in
    # of the nearest grade, as found, and its interval of 95 %; RMS of the axes; factors of reported sd [SI]
    prior: float
    value: float
    low: float
    high: float
    observable: bool  # the drive tells it; otherwise it is the prior's


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """What the innovations of a drive say about noise."""

    spec: ImuSpec  # the IMU
    filter_spec: ImuSpec  # the same with the misalignment whose noise is that of the innovations
    careful_accel_bias: FloatArray  # (3,) as large as it may be, where the drive tells little of it [m/s^2]
    axes: Misalignment  # its misalignments
    position_factor: FloatArray  # (3,) of the standard deviations of positions, North, East, Down [-]
    velocity_factor: FloatArray  # (3,) of those of velocities [-]
    correlated: CorrelatedNoise  # time-correlated part of the position error
    figures: tuple[NoiseFigure, ...]  # what was found, with intervals
    gain: float  # log-likelihood gained over the prior's figures
    # mean square of the normalised innovations with the figures before and with those found [-]
    mean_before: float
    mean_after: float
    far_off: bool  # the attitude of the run was so far off that the innovations are no linear function of it

    @property
    def white(self) -> FloatArray:
        """White part of the errors of positions, horizontal and vertical, by what came with them, (2,)."""
        return np.asarray(self.position_factor[1:] * np.sqrt(1.0 - self.correlated.share))


def after_rest(alignment: Alignment, assumed: ImuSpec, found: ImuSpec) -> Alignment:
    """An alignment at rest with the gyro bias as sure as a smaller in-run instability leaves it until the drive.

    `assumed`: the IMU of the alignment. A larger instability is of the drive: vibration, which was not there at rest.
    In a long rest a bias changes more than in a drive that may be short.
    """
    if alignment.static is None or alignment.static[1] - alignment.static[0] >= LONG_REST:
        return alignment
    was, now = assumed.gyro.bias_instability, found.gyro.bias_instability
    less = was**2 - np.minimum(was, now) ** 2
    return replace(alignment, gyro_bias_sd=np.sqrt(np.maximum(alignment.gyro_bias_sd**2 - less, 0.0)))


def start_by(initial: InitialState, alignment: Alignment, model: ErrorModel, factor: FloatArray) -> InitialState:
    """Initial state for another error model: alignment errors by the sensor errors change with these, others stay."""
    sd = np.sqrt(np.diag(initial.covariance)[:6])
    place = initial.lla, initial.v_n, sd[:3] * factor if initial.from_fix else sd[:3], sd[3:]
    return initial_state(alignment, model, *place, own=initial.own, from_fix=initial.from_fix)
