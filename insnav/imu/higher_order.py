"""Sensor errors beyond bias and matrix: asymmetry, curvature, temperature, gravity, size effect.

If a sensor with bias and matrix alone outputs z (without bias), the output with these terms is

    y = (1 + s dT) z + a |z| + q z^2 + b dT [+ G f for gyros],    dT = T - T_ref

with all terms per axis except the g-sensitivity ``G`` of gyros to the specific force ``f``. The accelerometers sense
``f`` at their own positions: ``f + dw/dt x r + w x (w x r)`` (the size effect). IEEE Std 952-1997 section 1.3 and IEEE
Std 1293-2018 annex A list these terms; Groves (2013), sections 4.4.3 to 4.4.6.

Dynamic compensation corrects the remaining non-linearity of gyros by a continuous, piecewise linear map. In each range
of the measured rate m the error is ``k m + b``, and the rate ``m - (k m + b)``. The lines meet at the borders, and
every ``k`` is below 1, so the map has exactly one inverse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import partial

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.types import FloatArray

REFERENCE_TEMPERATURE = 25.0  # default of a calibration [deg C]
# defaults of fields: no error of three axes, or of three rows of three
zeros, zero_matrix = partial(np.zeros, 3), partial(np.zeros, (3, 3))


@dataclass(frozen=True, slots=True)
class ErrorTerms:
    """Further errors of a sensor triad, zero by default.

    Raises ConfigError: a value that is not finite, or terms too large for an inverse.
    """

    # (3,) half of the difference: scale factor of positive minus scale factor of negative values [-]
    asymmetry: FloatArray = field(default_factory=zeros)
    quadratic: FloatArray = field(default_factory=zeros)  # (3,) second-order non-linearity [1/(rad/s)] or [1/(m/s^2)]
    bias_slope: FloatArray = field(default_factory=zeros)  # (3,) bias by temperature [rad/s/K] or [m/s^2/K]
    scale_slope: FloatArray = field(default_factory=zeros)  # (3,) scale factor by temperature [1/K]
    # (3, 3) of gyros: rate by specific force [rad/s/(m/s^2)]
    g_sensitivity: FloatArray = field(default_factory=zero_matrix)
    # (3, 3) of accelerometers: row i is the position of accelerometer i from the navigated point, body axes [m]
    positions: FloatArray = field(default_factory=zero_matrix)

    def __post_init__(self) -> None:
        for name, shape in SHAPES.items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                shown = str(value.tolist())[:100]
                raise ConfigError("imu.terms_shape", where=name, name=name, shape=shape, value=shown)
        if np.abs(self.asymmetry).max() > 0.5:
            raise ConfigError("imu.asymmetry", where="asymmetry")

    @property
    def by_temperature(self) -> bool:
        """True if an error depends on temperature."""
        return bool(np.any(self.bias_slope) or np.any(self.scale_slope))

    def shown(self, z: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """Compute the sensor output.

        `z` (n, 3): after the matrix, without bias [rad/s] or [m/s^2]. `warmer` (n,): temperature above the reference
        [K]. Returns (n, 3): without bias and g-sensitivity.
        """
        y = z * self._gain(warmer) + self.asymmetry * np.abs(z) + self.quadratic * z * z
        return np.asarray(y if warmer is None else y + warmer[:, None] * self.bias_slope)

    def meant(self, y: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """Invert `shown`: the root of the quadratic with the right sign, in a form without cancellation.

        `y` (n, 3): output without bias and g-sensitivity [rad/s] or [m/s^2]. `warmer` (n,): temperature above the
        reference [K]. Raises InputError: a value that the curvature never reaches.
        """
        if warmer is not None:
            y = y - warmer[:, None] * self.bias_slope
        side = np.where(y < 0.0, -1.0, 1.0)
        slope = self._gain(warmer) + side * self.asymmetry
        discriminant = slope * slope + 4.0 * self.quadratic * y
        if np.any(discriminant < 0.0):
            raise InputError("imu.beyond_vertex", where="quadratic", count=int(np.sum(discriminant < 0.0)))
        return np.asarray(2.0 * y / (slope + np.sqrt(discriminant)))

    def _gain(self, warmer: FloatArray | None) -> FloatArray:
        return np.ones(3) if warmer is None else 1.0 + warmer[:, None] * self.scale_slope


SHAPES = {each.name: (3, 3) if each.default_factory is zero_matrix else (3,) for each in fields(ErrorTerms)}


def size_effect(rate: FloatArray, dt: FloatArray, positions: FloatArray) -> FloatArray:
    """Compute the specific force differences of accelerometers at different positions (Groves 2013, eq. 4.15).

    `rate` (n, 3): angular rate [rad/s]. `dt` (n,): sampling intervals [s]. `positions` (3, 3): row i is the position of
    accelerometer i [m]. Returns (n, 3): [m/s^2]. Angular acceleration comes from rate differences, valid for motion
    slow against the sampling.
    """
    time = np.cumsum(dt)
    change = np.gradient(rate, time, axis=0)
    felt = np.empty_like(rate)
    for axis in range(3):
        r = positions[axis]
        felt[:, axis] = (np.cross(change, r) + np.cross(rate, np.cross(rate, r)))[:, axis]
    return felt


SMALLEST_SLOPE = 0.1  # of the compensated over the measured rate; a smaller slope means a broken gyro


@dataclass(frozen=True, slots=True)
class AxisMap:
    """Error of one gyro over its measured rate, linear between knots and beyond the outer ones.

    Raises ConfigError: invalid arrays, or a map without inverse.
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
        """Subtract the error from measured rates [rad/s]."""
        return _line(self.rate, self.rate - self.error, measured)

    def rate_error(self, measured: FloatArray) -> FloatArray:
        """Compute the error that `apply` subtracts from measured rates [rad/s]."""
        return _line(self.rate, self.error, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Invert `apply`."""
        return _line(self.rate - self.error, self.rate, compensated)


@dataclass(frozen=True, slots=True)
class DynamicMap:
    """Maps of three gyros."""

    axes: tuple[AxisMap | None, ...]  # of x, y, z; None: no correction

    def apply(self, measured: FloatArray) -> FloatArray:
        """Subtract the errors from measured rates, (n, 3) [rad/s]."""
        return self._by_axis(AxisMap.apply, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Invert `apply`."""
        return self._by_axis(AxisMap.inverse, compensated)

    def _by_axis(self, change: Callable[[AxisMap, FloatArray], FloatArray], rate: FloatArray) -> FloatArray:
        columns = [c if a is None else change(a, c) for a, c in zip(self.axes, rate.T, strict=True)]
        return np.ascontiguousarray(np.column_stack(columns))


def _line(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate linearly through the points, with linear extrapolation."""
    at = np.asarray(at, dtype=np.float64)
    piece = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    slope = np.diff(y) / np.diff(x)
    return np.asarray(y[piece] + slope[piece] * (at - x[piece]))
