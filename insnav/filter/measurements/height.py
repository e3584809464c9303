"""Height: of a barometer with a zero estimated from the drive, or assumed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.first_pass import FirstPass
from insnav.filter.measurements.measurement import FilterView
from insnav.filter.measurements.residual_noise import time_correlated_sd
from insnav.findings import Code, Finding
from insnav.types import FloatArray

LARGEST_RMS = 20.0  # a larger error means no barometer, or another unit [m]
LEAST_SD = 0.3  # wind and doors change the pressure by this much [m]


@dataclass(frozen=True, slots=True)
class HeightAiding:
    """Height over time, constant before the first and after the last value."""

    time: FloatArray  # (n,) times [s] and height above the ellipsoid [m]
    height: FloatArray
    sd: FloatArray  # (1,) standard deviation [m]

    order: ClassVar[int] = 10
    name: ClassVar[str] = "height"
    unit: ClassVar[str] = "m"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        h[0] = 0.0
        h[0, 2] = -1.0  # the position error is North, East, Down
        z[0] = at.x[2] - float(np.interp(at.time, self.time, self.height))
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        imu, solution = first.imu, first.solution
        if imu.baro is None or not np.isfinite(imu.baro).any():
            return None, None
        known = np.isfinite(imu.baro)
        offset = solution.lla[:, 2] - np.interp(solution.time, imu.time[known], imu.baro[known])
        zero = float(np.median(offset))
        residual = offset - zero
        rms = float(np.sqrt(np.mean(residual**2)))
        if rms > LARGEST_RMS:
            return None, Finding.of(Code.BAROMETER_POOR, rms_m=rms, limit_m=LARGEST_RMS, zero_m=zero)
        sd = np.array([max(LEAST_SD, time_correlated_sd(residual, first.step))])
        return cls(imu.time[known], imu.baro[known] + zero, sd), Finding.of(Code.BAROMETER_USED, rms_m=rms, zero_m=zero)
