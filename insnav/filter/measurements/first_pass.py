"""Drive after a first pass of the filter, from which aiding measurements are calibrated.

It includes the mounting of the IMU. A wheeled vehicle moves along one of its own axes. Least squares from a smoothed
solution gives the direction of that axis in the IMU, and the scatter of the velocity across it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from insnav.alignment.in_motion import Velocity, gives_velocities, velocity
from insnav.attitude import dcm_from_rph
from insnav.filter.measurements.residual_noise import INTERVAL, robust_fit
from insnav.imu.specification import ImuSpec
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, SensorLog, Trajectory
from insnav.units import DEG

FAST = 2.0  # below this speed the velocity error dominates its direction [m/s]
ENOUGH = 60.0  # time at such speeds that determines mounting angles to a tenth of a degree [s]
# A car on a road stays within centimetres per second; tracked, floating or flying vehicles do not.
LARGEST_RMS = 0.3  # of the velocity across the direction of travel, for a non-holonomic constraint [m/s]
WIDEST = 45.0 * DEG  # an IMU turned farther in its vehicle was not meant to point ahead


@dataclass(frozen=True, slots=True)
class Mounting:
    """Vehicle axes seen from the IMU."""

    # (2,) pitch and yaw of the direction of travel in the axes of the IMU, and their standard deviations [rad]
    angles: FloatArray
    sd: FloatArray
    to_vehicle: FloatArray  # (3, 3) rotation from IMU axes to vehicle axes (forward, right, down)
    lever_b: FloatArray  # (3,) point on the unsteered axle, seen from the IMU, body axes [m]
    right: FloatArray  # (m,) cross-track velocity at the fast rows [m/s]
    down: FloatArray

    @property
    def rms(self) -> tuple[float, float]:
        """Compute the RMS velocity to the right and down [m/s]."""
        return float(np.sqrt(np.mean(self.right**2))), float(np.sqrt(np.mean(self.down**2)))

    @property
    def holds(self) -> bool:
        """Return whether the vehicle moves along one axis near the forward axis of the IMU."""
        return max(self.rms) <= LARGEST_RMS and float(np.abs(self.angles).max()) <= WIDEST


def mounting(v_b: FloatArray, rate: FloatArray, step: float) -> Mounting:
    """Estimate vehicle axes from velocity in IMU axes [m/s] and body rate [rad/s], (m, 3), every `step` [s].

    A point on the axle, x ahead of the IMU, has the lateral velocity ``v_y + x w_z = 0``: the same fit finds x.
    """
    ahead = v_b[:, 0]
    right, right_rest, right_sd = robust_fit(np.column_stack([ahead, -rate[:, 2], rate[:, 0]]), v_b[:, 1], step)
    down, down_rest, down_sd = robust_fit(np.column_stack([ahead, rate[:, 1], -rate[:, 0]]), v_b[:, 2], step)
    forward = np.array([1.0, right[0], down[0]])
    forward /= np.linalg.norm(forward)
    side = np.cross([0.0, 0.0, 1.0], forward)
    side /= np.linalg.norm(side)
    return Mounting(
        np.array([-np.arctan(down[0]), np.arctan(right[0])]),
        np.array([down_sd, right_sd]),
        np.array([forward, side, np.cross(forward, side)]),
        np.array([right[1], 0.0, 0.0]),
        right_rest,
        down_rest,
    )


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
        """Velocity in IMU axes, (n, 3) [m/s]."""
        return np.asarray(np.einsum("nji,nj->ni", dcm_from_rph(self.solution.rph), self.solution.v_n))

    @cached_property
    def speed(self) -> Velocity:
        """Velocity by the receiver, else by the solution: position changes are mostly noise."""
        at = self.solution
        if at.sd is None or gives_velocities(self.gps):
            return velocity(self.gps)
        return Velocity(at.time, at.v_n, at.sd[:, 3:5].max(axis=1))

    @cached_property
    def fast(self) -> BoolArray:
        """Rows with a speed above `FAST`, (n,)."""
        return np.asarray(np.linalg.norm(self.solution.v_n, axis=1) > FAST)

    @cached_property
    def fast_time(self) -> float:
        """Time spent at such speeds [s]."""
        return float(self.fast.sum() * self.step)

    @cached_property
    def mounting(self) -> Mounting | None:
        """Mounting of the IMU in its vehicle, to the attitude accuracy; None if the drive is too short."""
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
        """Angular rate at the rows of the solution, averaged over a tenth of a second [rad/s]."""
        time, imu = self.solution.time, self.imu
        step = np.gradient(imu.time)[:, None]
        angle = np.cumsum(imu.gyro if imu.sampling == "increment" else imu.gyro * step, axis=0)
        half = 0.05
        at = [np.column_stack([np.interp(time + s * half, imu.time, angle[:, i]) for i in range(3)]) for s in (-1, 1)]
        return np.asarray((at[1] - at[0]) / (2.0 * half))
