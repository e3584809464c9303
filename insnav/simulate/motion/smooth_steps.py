"""Smooth changes: a step, and a rise at a limited rate that is itself reached and left smoothly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from insnav.types import FloatArray

# x^5 … x^9 of the polynomial that rises from 0 to 1 on [0, 1] with four derivatives zero at both ends: the
# integral of x^4 (1 - x)^4, made 1 at x = 1.
STEP = (126.0, -420.0, 540.0, -315.0, 70.0)
STEEPEST = 315.0 / 128.0  # slope in its middle
BUMP_AREA = 128.0 / 315.0  # integral of `bump`


def step(x: FloatArray) -> FloatArray:
    """Rise from 0 to 1 on [0, 1], four derivatives zero at both ends; constant outside."""
    x = np.clip(x, 0.0, 1.0)
    value: FloatArray = x**5 * np.polyval(STEP[::-1], x)
    return value


def step_area(x: FloatArray) -> FloatArray:
    """Integral of `step` from 0."""
    inside = np.clip(x, 0.0, 1.0)
    area: FloatArray = inside**6 * np.polyval(
        [c / k for k, c in zip(range(10, 5, -1), STEP[::-1], strict=True)], inside
    )
    return area + np.maximum(x - 1.0, 0.0)


def bump(x: FloatArray) -> FloatArray:
    """Rise from 0 to 1 and back on [0, 1], three derivatives zero at both ends: the slope of `step`, scaled."""
    x = np.clip(x, 0.0, 1.0)
    value: FloatArray = (4.0 * x * (1.0 - x)) ** 4
    return value


@dataclass(frozen=True)
class Rise:
    """Change by `total` whose rate rises smoothly to `rate`, stays, and falls: the area under a rounded trapezoid.

    Where `total` is too small for that the rate stays lower, and rises and falls with the same slope.
    """

    total: float  # change, of either sign
    limit: float  # largest rate, above 0 [1/s]
    ramp_limit: float  # time in which the rate goes from 0 to `limit` [s]

    @cached_property
    def rate(self) -> float:
        """Largest rate that is reached, with the sign of `total`."""
        share = min(1.0, math.sqrt(abs(self.total) / (self.limit * self.ramp_limit))) if self.ramp_limit else 1.0
        return math.copysign(self.limit * share, self.total)

    @cached_property
    def ramp(self) -> float:
        """Time in which it is reached [s]."""
        return self.ramp_limit * abs(self.rate) / self.limit

    @cached_property
    def duration(self) -> float:
        """Time of the whole change [s]."""
        return self.total / self.rate + self.ramp if self.total else 0.0

    @property
    def frequency(self) -> float:
        """Of an oscillation as sharp as the ramps, each three quarters of its period; 0 if there are none [Hz]."""
        return 0.75 / self.ramp if self.total and self.ramp else 0.0

    def slope(self, t: FloatArray) -> FloatArray:
        """Rate of change at times ``(n,)`` since the beginning [s]."""
        if not self.total:
            return np.zeros_like(t)
        return np.asarray(self.rate * (step(t / self.ramp) - step((t - self.duration + self.ramp) / self.ramp)))

    def __call__(self, t: FloatArray) -> FloatArray:
        """Change since the beginning at times ``(n,)`` since then [s]."""
        if not self.total:
            return np.zeros_like(t)
        begin, end = step_area(t / self.ramp), step_area((t - self.duration + self.ramp) / self.ramp)
        return self.rate * self.ramp * (begin - end)
