"""Interface of all aiding measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

from insnav.filter.measurements.first_pass import FirstPass
from insnav.findings import Finding
from insnav.types import FloatArray

NOTHING = slice(0, 0)  # rows of a measurement without data now


@dataclass(frozen=True, slots=True)
class FilterView:
    """State of the filter as visible to a measurement."""

    begin: float  # start of the interval since the last measurements, which ends now [s]
    time: float
    # (10,) state, see `insnav.kernels.mechanization`, after the earlier measurements of this time
    x: FloatArray
    correction: FloatArray  # (12,) estimated sensor errors
    rate: FloatArray  # (3,) body rate, corrected [rad/s]
    mean_gyro: FloatArray  # (3,) mean raw gyro output over the interval [rad/s]
    speed: float  # horizontal speed before the first measurement of this time [m/s]


class Measurement(Protocol):
    """Kind of aiding measurement; each has its own file in this folder."""

    order: ClassVar[int]  # position among the measurements of one time, lowest first
    name: ClassVar[str]  # also the subject of its gate's rejections, and of its row in the result
    unit: ClassVar[str]
    excluded_by: ClassVar[frozenset[str]]  # kinds at the same time that make it redundant

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each component as white noise, (m,)."""

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Write predicted minus measured into `z`, (6,), and its derivative by the error states into `h`, (6, n).

        Returns: the filled rows; the first of them corresponds to the first of `sd`.
        """

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Calibrate the measurement, and its standard deviation, from a first pass over the drive.

        Returns: the measurement, or None without sensor or if the drive does not support it; and a finding.
        """
