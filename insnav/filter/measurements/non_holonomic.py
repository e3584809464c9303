"""Non-holonomic constraint (NHC): a vehicle on wheels has no velocity across and perpendicular to its track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.first_pass import FAST, FirstPass
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.residual_noise import time_correlated_sd
from insnav.kernels.aiding_measurements import vehicle_velocity
from insnav.types import FloatArray
from insnav.units import DEG

LEAST_SD = 0.05  # suspension and tyre slip leave no vehicle straighter than this [m/s]


@dataclass(frozen=True, slots=True)
class NonHolonomic:
    """Velocity of a point on the axle that does not steer, across the direction of travel: zero."""

    to_vehicle: FloatArray  # (3, 3) from the axes of the IMU to those of the vehicle
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
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, str]:
        """See `Measurement`."""
        found = first.mounting
        if found is None:
            return None, f"NHC: not used, only {first.fast_time:.0f} s are faster than {FAST:g} m/s"
        # of the IMU in the vehicle, as everywhere that mounting is told: the other way round than `angles`
        (right, down), (pitch, yaw), (pitch_sd, yaw_sd) = found.rms, -found.angles / DEG, found.sd / DEG
        across = f"lateral {right:.2f}, vertical {down:.2f} m/s RMS"
        if not found.holds:
            return None, f"NHC: not used, {across}"
        sd = np.maximum(LEAST_SD, [time_correlated_sd(each, first.step) for each in (found.right, found.down)])
        note = (
            f"NHC: {across}; "
            f"IMU in the vehicle: pitch {pitch:z.2f} ± {pitch_sd:.2f}, yaw {yaw:z.2f} ± {yaw_sd:.2f} deg, "
            f"axle {abs(found.lever_b[0]):.1f} m {'ahead of' if found.lever_b[0] > 0.0 else 'behind'} the IMU"
        )
        return cls(found.to_vehicle, found.lever_b, sd), note
