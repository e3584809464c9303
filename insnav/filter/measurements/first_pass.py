"""The drive after a first pass of the filter: what aiding measurements are calibrated from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from insnav.alignment.in_motion import Velocity, gives_velocities, velocity
from insnav.attitude import dcm_from_rph
from insnav.filter.measurements.mounting import Mounting, mounting
from insnav.filter.measurements.residual_noise import INTERVAL
from insnav.imu.specification import ImuSpec
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, SensorLog, Trajectory

FAST = 2.0  # below this speed the direction of the velocity is mostly its error [m/s]
ENOUGH = 60.0  # time at such speeds from which mounting angles are good to a tenth of a degree [s]


@dataclass(frozen=True)
class FirstPass:
    """A drive and its smoothed solution, all in the time of the IMU samples."""

    solution: Trajectory  # smoothed, at several rows a second
    imu: ImuData  # samples
    gps: GpsData  # fixes
    spec: ImuSpec  # IMU error specification
    logs: Mapping[str, SensorLog] = field(default_factory=dict)  # logs of further sensors, by name

    @cached_property
    def step(self) -> float:
        """Time between rows of the solution [s]."""
        return float(np.median(np.diff(self.solution.time))) if self.solution.time.shape[0] > 1 else INTERVAL

    @cached_property
    def v_b(self) -> FloatArray:
        """Velocity in the axes of the IMU, (n, 3) [m/s]."""
        return np.asarray(np.einsum("nji,nj->ni", dcm_from_rph(self.solution.rph), self.solution.v_n))

    @cached_property
    def speed(self) -> Velocity:
        """Velocity by the receiver, or where it gives none by the solution: of that by positions most is noise."""
        at = self.solution
        if at.sd is None or gives_velocities(self.gps):
            return velocity(self.gps)
        return Velocity(at.time, at.v_n, at.sd[:, 3:5].max(axis=1))

    @cached_property
    def fast(self) -> BoolArray:
        """Rows at which the vehicle is faster than `FAST`, (n,)."""
        return np.asarray(np.linalg.norm(self.solution.v_n, axis=1) > FAST)

    @cached_property
    def fast_time(self) -> float:
        """Time spent at such speeds [s]."""
        return float(self.fast.sum() * self.step)

    @cached_property
    def mounting(self) -> Mounting | None:
        """How the IMU sits in its vehicle, as far as attitude is ever known; None if the drive is too short to tell."""
        if self.fast_time < ENOUGH:
            return None
        found = mounting(self.v_b[self.fast], self._rate()[self.fast], self.step)
        sd = self.solution.sd
        return found if sd is None else replace(found, sd=np.hypot(found.sd, sd[self.fast, 7:].min(axis=0)))

    @cached_property
    def forward(self) -> FloatArray:
        """Speed along the forward axis of the vehicle, (n,) [m/s]; needs the `mounting`."""
        assert self.mounting is not None
        return np.asarray(self.v_b @ self.mounting.to_vehicle[0])

    def _rate(self) -> FloatArray:
        """Angular rate at the rows of the solution, mean over a tenth of a second [rad/s]."""
        time, imu = self.solution.time, self.imu
        step = np.gradient(imu.time)[:, None]
        angle = np.cumsum(imu.gyro if imu.sampling == "increment" else imu.gyro * step, axis=0)
        half = 0.05
        at = [np.column_stack([np.interp(time + s * half, imu.time, angle[:, i]) for i in range(3)]) for s in (-1, 1)]
        return np.asarray((at[1] - at[0]) / (2.0 * half))
