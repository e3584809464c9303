"""Settings of the filter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insnav.filter.gates import Gates
from insnav.filter.gps_noise import CorrelatedNoise, Rough
from insnav.filter.measurements.measurement import INTERVAL, Measurement
from insnav.types import BoolArray, FloatArray, RoundingChange, SensorLog, StateChange


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the filter, specified by the user and completed from a recording.

    A `lever` or `delay` standard deviation above zero makes it a state; the specified value is the first guess.
    """

    lever_b: FloatArray = field(default_factory=lambda: np.zeros(3))  # antenna seen from the IMU, body axes, (3,) [m]
    lever_sd: float = 0.0  # of each component of the lever arm [m]
    shaken: float = 0.0  # sd of the additional arm by which vibration moves the antenna, for the receiver [m]
    delay: float = 0.0  # how much older the fixes are than their timestamps [s]
    delay_sd: float = 0.0  # sd of the delay [s]; if estimated, the solution is in the time of the fixes
    # lower limit of the standard deviation of the delay, and the delay by the search in addition to the specified
    # delay [s]; see `Estimate.least_delay_sd`
    least_delay_sd: float = 0.0
    shown: float = 0.0
    velocity_lag: float = 0.0  # of the velocity of a fix behind its position [s]; see `gps_delay.delay_of`
    lag_sd: float = 0.0  # sd of this lag [s]
    moments: tuple[float, ...] = (1.0,)  # sampling instants averaged into a velocity, in lags before the fix [-]
    # of sample timestamps relative to fixes [s]; times speed and acceleration it adds to the noise of every fix
    jitter: float = 0.0
    settled: bool = True  # the delay of the fixes is known; see `insnav.kernels.measurements.correct_with_arm`
    correlated: CorrelatedNoise | None = None  # time-correlated part of the position error; three more states
    mounting_yaw: float = 0.0  # of the IMU in the vehicle, to the right [rad]; see `insnav.alignment.mounting`
    output_interval: float = 0.1  # of the solution [s]; 0 for every sample
    epochs: FloatArray = field(default_factory=lambda: np.empty(0))  # further epochs of the solution, increasing [s]
    point_b: FloatArray | None = None  # point of the poses seen from the IMU, body axes, (3,) [m]
    gates: Gates = field(default_factory=Gates)
    heading_sd: float = 0.0  # of the heading with the fixes, for example of two antennas [rad]; zero: unused
    fixed_height_sd: float = 0.0  # height constraint about the first fix [m]; zero: none
    logs: tuple[SensorLog, ...] = ()  # of further sensors; the first pass over a drive converts them to measurements
    aiding: tuple[Measurement, ...] | None = None  # besides fixes, in the order of use; None: undetermined
    aided_every: float = INTERVAL  # interval of aiding whose noise is white every `INTERVAL` [s]
    smooth: bool = True  # backward over the recording at its end; see `insnav.filter.smoother`
    rounding: tuple[RoundingChange, ...] = ()  # of coarse gyros, in order of time
    changes: tuple[StateChange, ...] = ()  # in order of time; see `insnav.explain.explanation`
    false: BoolArray | None = None  # (2, n) positions and velocities to exclude, by the same module
    rough: tuple[Rough, ...] = ()  # intervals with larger time-correlated position errors, by the same module

    @property
    def with_poses(self) -> bool:
        """Return whether poses are wanted: the solution at `epochs`, of `point_b`."""
        return self.epochs.size > 0 or self.point_b is not None
