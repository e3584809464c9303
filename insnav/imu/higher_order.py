"""What bias and matrix leave out of the errors of a sensor: asymmetry, curvature, temperature, gravity, size.

Of a value z that bias-free, matrix-bent sensors would show, the sensor shows

    y = (1 + s dT) z + a |z| + q z^2 + b dT [+ G f for gyros],    dT = T - T_ref

with everything by axis but the gravity-sensitivity ``G`` of gyros to the specific force ``f``. The accelerometers feel
``f`` at the places where they sit: ``f + dw/dt x r + w x (w x r)`` (the size effect). IEEE Std 952-1997 section 1.3 and
IEEE Std 1293-2018 annex A list these terms; Groves (2013), sections 4.4.3 to 4.4.6.

Dynamic compensation corrects the remaining non-linearity of gyros by a continuous map, linear in pieces: in each range
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

REFERENCE_TEMPERATURE = 25.0  # unless a calibration has another one [deg C]
# defaults of fields: no error of three axes, or of three rows of three
zeros, zero_matrix = partial(np.zeros, 3), partial(np.zeros, (3, 3))


@dataclass(frozen=True, slots=True)
class ErrorTerms:
    """Further errors of a sensor triad, none of them by default.

    Raises ConfigError: A value that is not finite, or terms so large that the sensor cannot be inverted.
    """

    # (3,) half of what the scale factor of positive values exceeds that of negative ones by [-]
    asymmetry: FloatArray = field(default_factory=zeros)
    quadratic: FloatArray = field(default_factory=zeros)  # (3,) second-order non-linearity [1/(rad/s)] or [1/(m/s^2)]
    bias_slope: FloatArray = field(default_factory=zeros)  # (3,) bias by temperature [rad/s/K] or [m/s^2/K]
    scale_slope: FloatArray = field(default_factory=zeros)  # (3,) scale factor by temperature [1/K]
    # (3, 3) of gyros: rate by specific force [rad/s/(m/s^2)]
    g_sensitivity: FloatArray = field(default_factory=zero_matrix)
    # (3, 3) of accelerometers: row i is the place of accelerometer i from the point that is navigated, body axes [m]
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
        """Whether the temperature matters."""
        return bool(np.any(self.bias_slope) or np.any(self.scale_slope))

    def shown(self, z: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """What the sensor shows.

        z (n, 3): bent by the matrix, without bias [rad/s] or [m/s^2]; warmer (n,): temperature above the reference [K].
        Returns (n, 3): without bias and g-sensitivity.
        """
        y = z * self._gain(warmer) + self.asymmetry * np.abs(z) + self.quadratic * z * z
        return np.asarray(y if warmer is None else y + warmer[:, None] * self.bias_slope)

    def meant(self, y: FloatArray, warmer: FloatArray | None) -> FloatArray:
        """Undo `shown`: the root of the quadratic on the side of the sign, in the form that keeps digits.

        y (n, 3): shown, bias and g-sensitivity subtracted [rad/s] or [m/s^2]; warmer (n,): temperature above the
        reference [K]. Raises InputError: A value that the curvature never reaches.
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
    """What accelerometers feel because they do not sit in one point (Groves 2013, eq. 4.15 for each of them).

    rate (n, 3): angular rate [rad/s]; dt (n,): sampling intervals [s]; positions (3, 3): row i is the place of
    accelerometer i [m]. Returns (n, 3): [m/s^2]. Angular acceleration by differences of the rates: good for motion
    slow against the sampling.
    """
    time = np.cumsum(dt)
    change = np.gradient(rate, time, axis=0)
    felt = np.empty_like(rate)
    for axis in range(3):
        r = positions[axis]
        felt[:, axis] = (np.cross(change, r) + np.cross(rate, np.cross(rate, r)))[:, axis]
    return felt


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
        """Take the error off measured rates [rad/s]."""
        return _line(self.rate, self.rate - self.error, measured)

    def rate_error(self, measured: FloatArray) -> FloatArray:
        """Error that `apply` takes off measured rates [rad/s]."""
        return _line(self.rate, self.error, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Undo `apply`."""
        return _line(self.rate - self.error, self.rate, compensated)


@dataclass(frozen=True, slots=True)
class DynamicMap:
    """One map a gyro."""

    axes: tuple[AxisMap | None, ...]  # of x, y, z; None leaves an axis as it is

    def apply(self, measured: FloatArray) -> FloatArray:
        """Take the errors off measured rates, (n, 3) [rad/s]."""
        return self._by_axis(AxisMap.apply, measured)

    def inverse(self, compensated: FloatArray) -> FloatArray:
        """Undo `apply`."""
        return self._by_axis(AxisMap.inverse, compensated)

    def _by_axis(self, change: Callable[[AxisMap, FloatArray], FloatArray], rate: FloatArray) -> FloatArray:
        columns = [c if a is None else change(a, c) for a, c in zip(self.axes, rate.T, strict=True)]
        return np.ascontiguousarray(np.column_stack(columns))


def _line(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Straight lines through the points, the outer ones continued."""
    at = np.asarray(at, dtype=np.float64)
    piece = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    slope = np.diff(y) / np.diff(x)
    return np.asarray(y[piece] + slope[piece] * (at - x[piece]))
