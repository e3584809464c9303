"""What every aiding measurement has in common, whatever sensor or assumption it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

from insnav.filter.measurements.first_pass import FirstPass
from insnav.findings import Finding
from insnav.types import FloatArray

NOTHING = slice(0, 0)  # rows of a measurement that has nothing to say now


@dataclass(frozen=True, slots=True)
class FilterView:
    """What a measurement may know of the filter."""

    begin: float  # the interval since the last measurements, which ends now [s]
    time: float
    # (10,) state; see `insnav.kernels.mechanization`. It follows the measurements used before at the same time.
    x: FloatArray
    correction: FloatArray  # (12,) estimated sensor errors
    rate: FloatArray  # (3,) body rate, corrected [rad/s]
    mean_gyro: FloatArray  # (3,) mean gyro output over the interval, as sensed [rad/s]
    speed: float  # horizontal speed before the first measurement of this time [m/s]


class Measurement(Protocol):
    """One kind of aiding measurement; each is a file of its own in this folder."""

    order: ClassVar[int]  # place among the measurements of one time: the lower come first
    name: ClassVar[str]  # also the subject of what its gate rejects, and of its row in the result
    unit: ClassVar[str]
    excluded_by: ClassVar[frozenset[str]]  # kinds beside which, at the same time, it has nothing to add

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each of its numbers, as noise that is new every time, (m,)."""

    def observe(self, at: FilterView, z: FloatArray, h: FloatArray) -> slice:
        """Write predicted minus measured into `z`, (6,), and its derivative by the error states into `h`, (6, n).

        Returns: the rows that hold it; the first of them goes with the first of `sd`.
        """

    @classmethod
    def from_drive(cls, first: FirstPass) -> tuple[Self | None, Finding | None]:
        """Find from a first pass over the drive what is unknown, and how good the measurement is.

        Returns: `measurement`: none if there is no such sensor, or the drive does not support it; how it went.
        """
