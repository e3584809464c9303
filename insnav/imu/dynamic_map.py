"""Dynamic compensation of gyros: what a matrix leaves of non-linearity, as a continuous piecewise-linear map.

In each interval of the measured rate m the error is ``k m + b``, and the rate ``m - (k m + b)``. The lines meet at the
borders, and every ``k`` is below 1, so the map is continuous and has exactly one inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError
from insnav.types import FloatArray

SMALLEST_SLOPE = 0.1  # of the compensated over the measured rate; a gyro that needs more is broken, not non-linear


@dataclass(frozen=True, slots=True)
class AxisMap:
    """Error of one gyro over its measured rate, straight between knots and beyond the outer ones.

    Raises ConfigError: not such arrays, or a map that cannot be inverted.
    """

    rate: FloatArray  # (k,) measured rates at the knots [rad/s], increasing, at least two
    error: FloatArray  # (k,) error there, measured minus true [rad/s]

    def __post_init__(self) -> None:
        rate, error = np.asarray(self.rate), np.asarray(self.error)
        if rate.ndim != 1 or rate.size < 2 or rate.shape != error.shape:
            raise ConfigError("imu.map_shape", where="gyro.map", rates=str(rate.shape), errors=str(error.shape))
        if not (np.isfinite(rate).all() and np.isfinite(error).all() and (np.diff(rate) > 0.0).all()):
            raise ConfigError("imu.map_not_increasing", where="gyro.map")
        steepest = float((np.diff(error) / np.diff(rate)).max())
        if steepest > 1.0 - SMALLEST_SLOPE:
            raise ConfigError("imu.map_not_invertible", where="gyro.map", slope=steepest, limit=1.0 - SMALLEST_SLOPE)

    def apply(self, measured: FloatArray) -> FloatArray:
        """Rate without the error.

        measured: [rad/s].
        """
        return _line(self.rate, self.rate - self.error, measured)

    def rate_error(self, measured: FloatArray) -> FloatArray:
        """Error that `apply` takes off.

        measured: [rad/s].
        """
        return _line(self.rate, self.error, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Undo `apply`.

        compensated: [rad/s].
        """
        return _line(self.rate - self.error, self.rate, compensated)


@dataclass(frozen=True, slots=True)
class DynamicMap:
    """One map a gyro; None leaves an axis as it is."""

    x: AxisMap | None = None
    y: AxisMap | None = None
    z: AxisMap | None = None

    @property
    def axes(self) -> tuple[AxisMap | None, AxisMap | None, AxisMap | None]:
        """The three maps."""
        return self.x, self.y, self.z

    def apply(self, measured: FloatArray) -> FloatArray:
        """Rates without the errors.

        measured (n, 3): [rad/s].
        """
        columns = [c if a is None else a.apply(c) for a, c in zip(self.axes, measured.T, strict=True)]
        return np.ascontiguousarray(np.column_stack(columns))

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Undo `apply`.

        compensated (n, 3): [rad/s].
        """
        columns = [c if a is None else a.inverse(c) for a, c in zip(self.axes, compensated.T, strict=True)]
        return np.ascontiguousarray(np.column_stack(columns))


def _line(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Straight lines through the points, the outer ones continued."""
    at = np.asarray(at, dtype=np.float64)
    piece = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    slope = np.diff(y) / np.diff(x)
    return np.asarray(y[piece] + slope[piece] * (at - x[piece]))
