"""What was read and how it was understood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

from insnav.types import Event, IntArray, Sampling, Stamp

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReadingFacts:
    """Facts about a file that was read.

    Attributes
    ----------
    kind : str
        ``IMU``, ``GPS`` or ``reference``.
    path : str
        The file as given.
    sha256 : str
        Digest of the file.
    n_rows, n_used : int
        Rows in the file, and rows in the data.
    start_s, end_s : float
        First and last time [s].
    rate_hz : float
        Inverse of the median interval [Hz].
    n_gaps : int
        Number of gaps that have an event.
    longest_gap_s : float
        Longest interval between two rows if there is a gap, else zero [s].
    columns : mapping of str to str
        Canonical name to header and unit.
    evidence : tuple of str
        How units, axes and signs were found, and what was assumed.
    axes : str
        Directions of the sensor's x, y, z, such as ``FRD`` (IMU only).
    sampling, stamp : str or None
        As in `insnav.types.ImuData` (IMU only).
    height : str
        ``ellipsoidal`` or ``msl`` (GPS and reference).
    """

    kind: str
    path: str
    sha256: str
    n_rows: int
    n_used: int
    start_s: float
    end_s: float
    rate_hz: float
    n_gaps: int
    longest_gap_s: float
    columns: Mapping[str, str]
    evidence: tuple[str, ...] = ()
    axes: str = ""
    sampling: Sampling | None = None
    stamp: Stamp | None = None
    height: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Give the facts in a form ready for JSON."""
        facts = {each.name: getattr(self, each.name) for each in fields(self)}
        facts |= {"columns": dict(self.columns), "evidence": list(self.evidence)}
        optional = ("axes", "sampling", "stamp", "height")
        return {name: value for name, value in facts.items() if value or name not in optional}

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any]) -> ReadingFacts:
        """Take the facts back from JSON."""
        known = {each.name for each in fields(cls)}
        return cls(
            **{name: value for name, value in facts.items() if name in known} | {"evidence": tuple(facts["evidence"])}
        )

    def lines(self) -> list[str]:
        """Give the facts in words, one a line."""
        dropped = self.n_rows - self.n_used
        rows = f"{self.n_used} rows" if not dropped else f"{self.n_used} of {self.n_rows} rows"
        gaps = (
            "no gaps"
            if not self.n_gaps
            else f"{self.n_gaps} gap{'s' * (self.n_gaps > 1)}, the longest {self.longest_gap_s:.3g} s"
        )
        span = f"{self.end_s - self.start_s:.1f} s from {self.start_s:.3f} to {self.end_s:.3f}"
        columns = ", ".join(
            name if text.startswith(f"{name} [") else f"{name} = {text}" for name, text in self.columns.items()
        )
        head = f"{self.kind}: {self.path}: {rows}, {span}, {self.rate_hz:.4g} Hz, {gaps}"
        return [head, f"columns: {columns}", *self.evidence]


@dataclass(frozen=True, slots=True)
class Reading(Generic[T]):
    """Data from a file, with everything that happened on the way.

    Attributes
    ----------
    data : ImuData, GpsData or Trajectory
        The data.
    events : tuple of Event
        Rows dropped, sorted or missing, in order of time.
    facts : ReadingFacts
        What was understood.
    fix : (n,) array or None
        Fix type of each row of a reference, if the file has it; -1 where the cell is empty.
    """

    data: T
    events: tuple[Event, ...]
    facts: ReadingFacts
    fix: IntArray | None = field(default=None)
