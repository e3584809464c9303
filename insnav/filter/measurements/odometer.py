"""Odometer: speed along the vehicle's forward axis, with scale factor and lag calibrated from the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.first_pass import FAST, FirstPass
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.residual_noise import time_correlated_sd
from insnav.findings import Code, Finding
from insnav.kernels.aiding_measurements import vehicle_velocity
from insnav.types import BoolArray, FloatArray

LEAST_SD = 0.05  # lower limit by wheel slip and tyre pressure [m/s]
LARGEST_RMS = 0.5  # of a useful speed: the free-inertial error after tens of seconds [m/s]
LAGS = np.arange(-0.2, 2.0, 0.02)  # odometer lag; buses and filters delay it by up to a second [s]
SCALES = (0.5, 2.0)  # plausible scale factors in the unit of the header
FEWEST = 100  # values for the calibration
LONGEST_GAP = 1.0  # speeds farther apart are not interpolated [s]


@dataclass(frozen=True, slots=True)
class Odometer:
    """Forward speed of the point on the axle, over time."""

    time: FloatArray  # (n,) times [s] and speed corrected by the scale factor [m/s]
    speed: FloatArray
    to_vehicle: FloatArray  # (3, 3) as in `insnav.filter.measurements.non_holonomic`
    lever_b: FloatArray
    sd: FloatArray  # (1,) standard deviation [m/s]

    order: ClassVar[int] = 30
    name: ClassVar[str] = "odometer"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(np.clip(np.searchsorted(self.time, at.time), 1, self.time.shape[0] - 1))
        near = self.time[row] - self.time[row - 1] <= LONGEST_GAP and abs(self.time[row] - at.time) <= LONGEST_GAP
        if at.speed < FAST or not near:
            return NOTHING
        speed = float(np.interp(at.time, self.time, self.speed))
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, speed, z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        if first.imu.odometer is None or first.mounting is None or not first.mounting.holds:
            return None, None
        known = np.isfinite(first.imu.odometer)
        return cls.fitted(first, first.fast, first.imu.time[known], first.imu.odometer[known], LAGS)

    @classmethod
    def fitted(
        cls, first: FirstPass, rows: BoolArray, time: FloatArray, speed: FloatArray, lags: FloatArray
    ) -> tuple[Self | None, Finding]:
        """Fit scale factor and lag of a speed at `rows` of the solution: the best of all `lags` [s]."""
        if time.shape[0] < FEWEST:
            return None, Finding.of(Code.ODOMETER_FEW, subject=cls.name, count=time.shape[0], limit_count=FEWEST)
        assert first.mounting is not None
        at, forward = first.solution.time[rows], first.forward[rows]
        fits = []
        for lag in lags:
            shown = np.interp(at + lag, time, speed)
            scale = float(shown @ forward / max(float(shown @ shown), 1e-9))
            fits.append((float(np.sqrt(np.mean((forward - scale * shown) ** 2))), scale))
        best = int(np.argmin([rms for rms, _ in fits]))
        (rms, scale), lag = fits[best], float(lags[best])
        code = Code.ODOMETER_USED if SCALES[0] < scale < SCALES[1] else Code.ODOMETER_SCALE
        code = Code.ODOMETER_POOR if rms > LARGEST_RMS else code
        found = Finding.of(code, subject=cls.name, rms_m_s=rms, limit_m_s=LARGEST_RMS, lag_s=lag, scale=scale)
        if code is not Code.ODOMETER_USED:
            return None, found
        residual = forward - scale * np.interp(at + lag, time, speed)
        sd = np.array([max(LEAST_SD, time_correlated_sd(residual, first.step))])
        return cls(time - lag, scale * speed, first.mounting.to_vehicle, first.mounting.lever_b, sd), found
