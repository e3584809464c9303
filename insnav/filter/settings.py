"""Settings of the filter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insnav.filter.gates import Gates, Trust
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.measurements.measurement import Measurement
from insnav.types import FloatArray, SensorLog


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the filter, as a user gives them and a recording completes them.

    Attributes
    ----------
    lever_b : (3,) array
        Antenna seen from the IMU, body axes [m]; the first guess if `lever_sd` is positive.
    lever_sd : float
        Standard deviation of each component of that [m]; positive: estimated as three more states.
    delay : float
        How much older the fixes are than their timestamps [s]; the first guess if `delay_sd` is positive.
    delay_sd : float
        Standard deviation of that [s]; positive: estimated as a 22nd state, and the solution is put into the time of
        the fixes, since GPS time is the better clock.
    velocity_lag : float
        By which the velocity of a fix lags its position [s]; see `insnav.filter.gps_noise.velocity_lag`.
    jitter : float
        Standard deviation of the timestamps of samples against fixes [s]; times speed and acceleration it is added to
        the noise of every fix.
    correlated : CorrelatedNoise or None
        Time-correlated part of the position error; three more states.
    mounting_yaw : float
        By which the IMU is turned in the vehicle, to the right [rad]; see `insnav.alignment.mounting`.
    output_interval : float
        Time between rows of the solution [s]; 0 for every sample.
    gates : Gates
        Limits of the gates.
    heading_sd : float
        Standard deviation of the heading that fixes may come with, of two antennas for one [rad]; zero: not used.
    fixed_height_sd : float
        The vehicle stays within so much of the height of its first fix [m]; zero: not assumed.
    logs : tuple of SensorLog
        Logs of further sensors; the first pass over a drive makes measurements of them.
    aiding : tuple of Measurement or None
        Aiding besides fixes, in the order of use; None: not looked for.
    smooth : bool
        Run the backward pass over the recording at its end; see `insnav.filter.smoother`.
    trust : Trust or None
        Fixes to leave out, found by `insnav.filter.whole_record`.
    """

    lever_b: FloatArray = field(default_factory=lambda: np.zeros(3))
    lever_sd: float = 0.0
    delay: float = 0.0
    delay_sd: float = 0.0
    velocity_lag: float = 0.0
    jitter: float = 0.0
    correlated: CorrelatedNoise | None = None
    mounting_yaw: float = 0.0
    output_interval: float = 0.1
    gates: Gates = field(default_factory=Gates)
    heading_sd: float = 0.0
    fixed_height_sd: float = 0.0
    logs: tuple[SensorLog, ...] = ()
    aiding: tuple[Measurement, ...] | None = None
    smooth: bool = True
    trust: Trust | None = None
