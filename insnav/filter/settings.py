"""Settings of the filter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insnav.filter.gates import Gates
from insnav.filter.gps_correlation import CorrelatedNoise, Rough
from insnav.filter.measurements.measurement import Measurement
from insnav.filter.measurements.residual_noise import INTERVAL
from insnav.types import BoolArray, FloatArray, SensorLog, StateChange


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the filter, as a user gives them and a recording completes them.

    A standard deviation of `lever` or `delay` above zero makes it a state, and what is given its first guess.
    """

    lever_b: FloatArray = field(default_factory=lambda: np.zeros(3))  # antenna seen from the IMU, body axes, (3,) [m]
    lever_sd: float = 0.0  # of each component of that [m]
    shaken: float = 0.0  # of the arm by which vibration moves the antenna, for the receiver, less that one [m]
    delay: float = 0.0  # how much older the fixes are than their timestamps [s]
    delay_sd: float = 0.0  # of that [s]; estimated, it puts the solution into the time of the fixes
    # least standard deviation of the delay that is stated, and the delay that the search for one has shown, beyond the
    # one given [s]; see `Estimate.surest`
    surest: float = 0.0
    shown: float = 0.0
    velocity_lag: float = 0.0  # of the velocity of a fix behind its position [s]; see `gps_delay.delay_of`
    lag_sd: float = 0.0  # of that [s]
    moments: tuple[float, ...] = (1.0,)  # whose mean velocities are, in lags before the fix [-]
    # of the timestamps of samples against fixes [s]; times speed and acceleration it adds to the noise of every fix
    jitter: float = 0.0
    settled: bool = True  # how late fixes are is known; see `insnav.kernels.gps_measurement.correct_with_arm`
    correlated: CorrelatedNoise | None = None  # time-correlated part of the position error; three more states
    mounting_yaw: float = 0.0  # of the IMU in the vehicle, to the right [rad]; see `insnav.alignment.mounting`
    output_interval: float = 0.1  # of the solution [s]; 0 for every sample
    gates: Gates = field(default_factory=Gates)
    heading_sd: float = 0.0  # of the heading that fixes may come with, of two antennas for one [rad]; zero: not used
    fixed_height_sd: float = 0.0  # the vehicle stays so near to the height of its first fix [m]; zero: not assumed
    logs: tuple[SensorLog, ...] = ()  # of further sensors; the first pass over a drive makes measurements of them
    aiding: tuple[Measurement, ...] | None = None  # besides fixes, in the order of use; None: not looked for
    aided_every: float = INTERVAL  # so often, of what has its noise anew every `INTERVAL` [s]
    smooth: bool = True  # backward over the recording at its end; see `insnav.filter.smoother`
    changes: tuple[StateChange, ...] = ()  # in order of time; see `insnav.explain.explanation`
    false: BoolArray | None = None  # (2, n) positions and velocities to leave out, by the same
    rough: tuple[Rough, ...] = ()  # intervals in which the time-correlated errors of positions are larger, by the same
