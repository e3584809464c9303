"""Gyros on a rate table whose matrix, bias and non-linearity are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RATES = np.arange(-300.0, 301.0, 10.0)  # [deg/s]
Shape = Callable[[np.ndarray], np.ndarray]


def straight(rate: np.ndarray) -> np.ndarray:
    return 0.0 * rate


def cubic(rate: np.ndarray) -> np.ndarray:
    """0.2 % of the range, as of a resonator driven too far [deg/s]."""
    return 0.6 * ((rate / 300.0) ** 3 - 0.6 * rate / 300.0)


def asymmetric(rate: np.ndarray) -> np.ndarray:
    return 0.001 * np.abs(rate)


def broken(rate: np.ndarray) -> np.ndarray:
    """Straight pieces, borders at -150 and 100 deg/s."""
    return np.interp(rate, [-300.0, -150.0, 100.0, 300.0], [-0.6, 0.2, -0.1, 0.5])


@dataclass(frozen=True)
class Gyros:
    """Output = matrix @ (rate + shape of each axis) + bias + noise [deg/s]."""

    matrix: np.ndarray
    bias: np.ndarray
    shapes: tuple[Shape, Shape, Shape]

    def show(self, rate: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
        bent = rate + np.column_stack([shape(column) for shape, column in zip(self.shapes, rate.T, strict=True)])
        return bent @ self.matrix.T + self.bias + noise * rng.normal(size=rate.shape)


def gyros(rng: np.random.Generator, shapes: tuple[Shape, Shape, Shape] = (straight,) * 3) -> Gyros:
    return Gyros(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.3 * rng.normal(size=3), shapes)


def table(rates: np.ndarray = RATES) -> np.ndarray:
    """Sweeps about x, y, z one after another, (3 n, 3) [deg/s]."""
    return np.vstack([np.outer(rates, axis) for axis in np.eye(3)])


def write(folder: Path, sensor: Gyros, noise: float, rng: np.random.Generator, samples: int = 1) -> list[Path]:
    """Three files in deg/s, a sweep each."""
    paths = []
    for i, axis in enumerate(np.eye(3)):
        rate = np.repeat(np.outer(RATES, axis), samples, axis=0)
        paths.append(folder / f"about_{'xyz'[i]}.csv")
        header = "rate_deg_s,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s"
        rows = np.column_stack((rate[:, i], sensor.show(rate, noise, rng)))
        np.savetxt(paths[-1], rows, "%.9g", ",", header=header, comments="")
    return paths
