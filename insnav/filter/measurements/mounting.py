"""How the IMU sits in its vehicle, from the velocity in the axes of the IMU.

A vehicle on wheels moves along one of its own axes: the direction of that axis in the IMU, and how well the velocity
across it is zero, follow by least squares from a smoothed solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.filter.measurements.residual_noise import robust_fit
from insnav.types import FloatArray
from insnav.units import DEG

# A car on a road stays within centimetres per second; tracked, floating or flying vehicles do not.
LARGEST_RMS = 0.3  # of the velocity across the direction of travel, for a non-holonomic constraint [m/s]
WIDEST = 45.0 * DEG  # an IMU turned farther in its vehicle was not meant to point ahead


@dataclass(frozen=True, slots=True)
class Mounting:
    """Axes of the vehicle seen from the IMU."""

    # (2,) pitch and yaw of the direction of travel in the axes of the IMU, and their standard deviations [rad]
    angles: FloatArray
    sd: FloatArray
    to_vehicle: FloatArray  # (3, 3) from the axes of the IMU to those of the vehicle (forward, right, down)
    lever_b: FloatArray  # (3,) A point on the axle that does not steer, seen from the IMU, body axes [m]
    right: FloatArray  # (m,) velocity across the direction of travel at the fast rows [m/s]
    down: FloatArray

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the velocity to the right and down [m/s]."""
        return float(np.sqrt(np.mean(self.right**2))), float(np.sqrt(np.mean(self.down**2)))

    @property
    def holds(self) -> bool:
        """Whether the vehicle moves along one axis, and that near the forward axis of the IMU."""
        return max(self.rms) <= LARGEST_RMS and float(np.abs(self.angles).max()) <= WIDEST


def mounting(v_b: FloatArray, rate: FloatArray, step: float) -> Mounting:
    """Find the axes of a vehicle from velocity in IMU axes [m/s] and body rate [rad/s], (m, 3), every `step` [s].

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
