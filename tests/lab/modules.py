"""Dual-axis modules turned by small angles, as the nine-position method finds them on its table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

G = 9.81
NINE = np.radians(
    [(0, 0), (50, 0), (-50, 0), (0, 50), (0, -50), (35, 40), (35, -40), (-35, 40), (-35, -40)],
)
UPRIGHT = np.radians([(180, 0), (90, 0), (-90, 0), (0, 90), (0, -90)])


@dataclass(frozen=True)
class Modules:
    """Six accelerometers (rows in the order of the method) and three gyros (rows x, y, z)."""

    accel: np.ndarray
    bias: np.ndarray
    gyro: np.ndarray

    def measure(self, positions: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
        roll, pitch = positions.T
        # a plumb line seen from the body: gravity turned by the inverse attitude, and specific force against it
        force = -Rotation.from_euler("ZYX", np.column_stack((0.0 * roll, pitch, roll))).inv().apply([0.0, 0.0, G])
        return force @ self.accel.T + self.bias + noise * rng.normal(size=(len(roll), 6))


def make(rng: np.random.Generator, misalignment: float, scale: float, bias: float = 0.2) -> Modules:
    turned = [Rotation.from_rotvec(misalignment * rng.normal(size=3)).as_matrix().T for _ in range(3)]
    x, y, z = turned  # rows are the axes of a module in body axes
    rows = np.array([x[1], x[2], y[2], y[0], z[0], z[1]]) * (1.0 + scale * rng.normal(size=(6, 1)))
    return Modules(rows, bias * rng.normal(size=6), np.array([x[0], y[1], z[2]]))
