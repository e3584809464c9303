"""Heading of the body, for example of two antennas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from insnav.filter.measurements.first_pass import FirstPass
from insnav.filter.measurements.measurement import NOTHING, FilterView
from insnav.filter.measurements.residual_noise import INTERVAL
from insnav.findings import Finding
from insnav.kernels.aiding_measurements import body_heading
from insnav.strapdown import nearest_rows
from insnav.types import FloatArray


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading measured with the fixes."""

    time: FloatArray  # (n,) times [s] and heading [rad]; ``NaN`` where unknown
    heading: FloatArray
    sd: FloatArray  # (1,) standard deviation [rad]

    order: ClassVar[int] = 0
    name: ClassVar[str] = "heading"
    unit: ClassVar[str] = "rad"
    excluded_by: ClassVar[frozenset[str]] = frozenset()

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """See `Measurement`."""
        row = int(nearest_rows(self.time, at.time))
        if not abs(self.time[row] - at.time) < 0.5 * INTERVAL or not np.isfinite(self.heading[row]):
            return NOTHING
        body_heading(at.x, float(self.heading[row]), z, h)
        return slice(0, 1)

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate nothing: the user specifies the accuracy, and the first pass already uses the heading."""
        return None, None
