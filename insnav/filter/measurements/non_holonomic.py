"""Non-holonomic constraint (NHC): a vehicle on wheels has no velocity across and perpendicular to its track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.first_pass import ENOUGH, FAST, LARGEST_RMS, WIDEST, FirstPass
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.residual_noise import time_correlated_sd
from insnav.findings import Code, Finding
from insnav.kernels.aiding_measurements import vehicle_velocity
from insnav.types import FloatArray

LEAST_SD = 0.05  # suspension and tyre slip keep every vehicle above this [m/s]


@dataclass(frozen=True, slots=True)
class NonHolonomic:
    """Zero velocity across the direction of travel, at a point on the unsteered axle."""

    to_vehicle: FloatArray  # (3, 3) rotation from IMU axes to vehicle axes
    lever_b: FloatArray  # (3,) the point seen from the IMU, body axes [m]
    sd: FloatArray  # (2,) standard deviation of the velocity to the right and down [m/s]

    order: ClassVar[int] = 90
    name: ClassVar[str] = "nhc"
    unit: ClassVar[str] = "m/s"
    excluded_by: ClassVar[frozenset[str]] = frozenset({"zupt"})

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`; rows 1 and 2, since row 0 would be the forward speed."""
        if at.speed < FAST:
            return NOTHING
        vehicle_velocity(at.x, at.rate, self.to_vehicle, self.lever_b, np.nan, z, h)
        return slice(1, 3)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """See `Measurement`."""
        found = first.mounting
        if found is None:
            return None, Finding.of(Code.NHC_SLOW, duration_s=first.fast_time, limit_s=ENOUGH, speed_m_s=FAST)
        # angles of the IMU in the vehicle, as everywhere: opposite in sign to `angles`
        (right, down), (pitch, yaw), (pitch_sd, yaw_sd) = found.rms, -found.angles, found.sd
        if max(found.rms) > LARGEST_RMS:
            return None, Finding.of(Code.NHC_LATERAL, lateral_m_s=right, vertical_m_s=down, limit_m_s=LARGEST_RMS)
        if not found.holds:
            return None, Finding.of(Code.NHC_TURNED, yaw_rad=yaw, pitch_rad=pitch, limit_rad=WIDEST)
        sd = np.maximum(LEAST_SD, [time_correlated_sd(each, first.step) for each in (found.right, found.down)])
        note = Finding.of(
            Code.NHC_USED,
            lateral_m_s=right,
            vertical_m_s=down,
            pitch_rad=pitch,
            pitch_sd_rad=pitch_sd,
            yaw_rad=yaw,
            yaw_sd_rad=yaw_sd,
            axle_m=found.lever_b[0],
        )
        return cls(found.to_vehicle, found.lever_b, sd), note
