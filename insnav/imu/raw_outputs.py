"""Raw outputs of sensors, volts or counts, and their conversion to rates and specific forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError
from insnav.types import FloatArray
from insnav.units import UNITS, units_of


@dataclass(frozen=True, slots=True)
class RawScale:
    """Line of each sensor of a triad: ``value = (output - zero) / scale``.

    It converts file columns to rates [rad/s] or specific forces [m/s^2] on reading, before axes are exchanged and known
    errors corrected.

    Raises ConfigError: another unit, another shape, a value that is not finite, or a scale of zero.
    """

    unit: str  # of the output: ``V``, ``mV``, ``uV`` or ``LSB``
    zero: FloatArray  # (3,) output without input, x, y, z [unit]
    # (3,) output per input [unit/(rad/s)] or [unit/(m/s^2)]; negative for a sensor mounted upside down
    scale: FloatArray

    def __post_init__(self) -> None:
        if self.unit not in units_of("signal"):
            raise ConfigError("imu.raw_unit", where="raw.unit", unit=self.unit, units=tuple(units_of("signal")))
        if np.shape(self.zero) != (3,) or np.shape(self.scale) != (3,):
            raise ConfigError("imu.raw_shape", where="raw.zero, raw.scale")
        if not (np.isfinite(self.zero).all() and np.isfinite(self.scale).all() and (self.scale != 0.0).all()):
            raise ConfigError(
                "imu.raw_unusable",
                where="raw.zero, raw.scale",
                zero=str(np.asarray(self.zero).tolist()),
                scale=str(np.asarray(self.scale).tolist()),
            )

    def value(self, output: FloatArray, axis: int, unit: str | None = None) -> FloatArray:
        """Convert outputs of one sensor to rate [rad/s] or specific force [m/s^2].

        `output` (n,): of the sensor. `axis`: 0, 1, 2 for x, y, z. `unit`: of `output` if it differs from the own unit,
        such as mV for V. Raises ConfigError: counts instead of volts, or volts instead of counts.
        """
        factor = 1.0
        if unit is not None and unit != self.unit:
            if "LSB" in (unit, self.unit):
                raise ConfigError("imu.raw_other_unit", where="raw.unit", unit=self.unit, other=unit)
            factor = UNITS[unit][1] / UNITS[self.unit][1]
        return np.asarray((output * factor - self.zero[axis]) / self.scale[axis])
