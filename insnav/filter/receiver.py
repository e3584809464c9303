"""Relation of the fixes of a receiver to the state: lever arm, delay, lag of velocities, other errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from insnav.filter.gps_noise import CorrelatedNoise
from insnav.types import FloatArray, Source

LEVER_SD = 1.0  # prior sd of each component of an unspecified lever arm: antenna and IMU are on one vehicle [m]
DELAY_SD = 0.05  # prior sd of an unspecified delay: agreement of receiver and logger clocks [s]


@dataclass(frozen=True, slots=True)
class LeverArm:
    """Antenna seen from the IMU, body axes; a state of the filter if its standard deviation is above zero."""

    value: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) lever arm [m]
    sd: float = 0.0  # initial standard deviation of each component [m]
    source: Source = "given"
    shaken: float = 0.0  # sd of the vibration arm minus the lever arm [m]; see `error_model.blocks_of`


@dataclass(frozen=True, slots=True)
class Delay:
    """Age of the fixes at their timestamps. If `sd` is above zero, it is a state, and the solution is in fix time."""

    value: float = 0.0  # specified or assumed delay [s]
    sd: float = 0.0  # initial standard deviation of the delay state [s]
    source: Source = "given"
    # lower limit of the reported sd, and delay by the search beyond `value` [s]; see `Estimate.least_delay_sd`
    least_sd: float = 0.0
    shown: float = 0.0
    settled: bool = True  # false: still searched; see `insnav.kernels.measurements.correct_with_arm`


@dataclass(frozen=True, slots=True)
class Lag:
    """Lag of the velocity of a fix behind its position; see `insnav.filter.delay_and_lever.delay_of`."""

    value: float = 0.0  # lag of the velocity [s]
    sd: float = 0.0  # initial standard deviation of the lag state; zero: no state [s]
    moments: tuple[float, ...] = (1.0,)  # instants averaged to a velocity: times before the fix, in lags [-]


@dataclass(frozen=True, slots=True)
class Receiver:
    """Parameters that relate the fixes of a receiver to the filter state."""

    lever_arm: LeverArm = field(default_factory=LeverArm)
    delay: Delay = field(default=Delay())
    lag: Lag = field(default=Lag())
    # sd of sample timestamps relative to fixes [s]: adds speed and acceleration times this to the noise of a fix
    jitter: float = 0.0
    correlated: CorrelatedNoise | None = None  # time-correlated part of the position error; three more states
    heading_sd: float = 0.0  # sd of a heading in the fixes, as from two antennas [rad]; zero: unused

    def forget_lever_arm(self) -> Receiver:
        """Copy with an unspecified lever arm, for the filter to estimate."""
        return replace(self, lever_arm=LeverArm(sd=LEVER_SD, source="prior"))
