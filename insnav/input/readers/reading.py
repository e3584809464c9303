"""Data read from a file, with the interpretation of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

from insnav.findings import Code, Finding
from insnav.messages import phrase, sentence
from insnav.types import IntArray, Sampling, Stamp

T = TypeVar("T")
LOST, LOST_SHARE = 10.0, 0.1  # an uncovered part is reported beyond both: time [s], share of the file
# finding codes for a file that begins after, or ends before, the other file
_SHORT_IMU = Code.FILES_IMU_BEGINS_LATE, Code.FILES_IMU_ENDS_EARLY
_SHORT_GPS = Code.FILES_GPS_BEGINS_LATE, Code.FILES_GPS_ENDS_EARLY


@dataclass(frozen=True, slots=True)
class ReadingFacts:
    """Facts about a file that was read."""

    kind: str  # kind of the data, such as ``IMU``, ``GPS`` or ``reference``
    path: str  # path of the file, as given by the user
    sha256: str  # digest of the file
    # number of rows in the file, and of rows kept in the data
    n_rows: int
    n_used: int
    # first and last time in the data [s]
    start_s: float
    end_s: float
    rate_hz: float  # inverse of the median interval [Hz]
    n_gaps: int  # number of reported gaps
    longest_gap_s: float  # longest interval with a gap [s]; zero without gaps
    columns: Mapping[str, str]  # header and unit by canonical name
    evidence: tuple[Finding, ...] = ()  # evidence for units, axes and signs, and assumptions
    axes: str = ""  # directions of the sensor's x, y, z, such as ``FRD`` (IMU only)
    # type and timestamp of the samples, as in `insnav.types.ImuData` (IMU only)
    sampling: Sampling | None = None
    stamp: Stamp | None = None
    height: str = ""  # ``ellipsoidal`` or ``msl`` (GPS and reference)
    gps_week: int | None = None  # week of the time origin, if known

    def as_dict(self) -> dict[str, Any]:
        """Convert the facts to values for JSON, without empty optional facts."""
        facts = {item.name: getattr(self, item.name) for item in fields(self)}
        facts |= {"columns": dict(self.columns), "evidence": [each.as_dict() for each in self.evidence]}
        optional = ("axes", "sampling", "stamp", "height", "gps_week")
        return {name: value for name, value in facts.items() if value not in ("", None) or name not in optional}

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any]) -> ReadingFacts:
        """Restore the facts from JSON."""
        known = {item.name for item in fields(cls)}
        evidence = tuple(map(Finding.from_dict, facts["evidence"]))
        return cls(**{name: value for name, value in facts.items() if name in known} | {"evidence": evidence})

    def lines(self) -> list[str]:
        """Return the facts as sentences, one per line."""
        values: dict[str, Any] = {"length_s": self.end_s - self.start_s} | {
            item.name: getattr(self, item.name) for item in fields(self)
        }
        values["n_rows"] = self.n_rows if self.n_used < self.n_rows else None
        columns = ", ".join(
            name if text.startswith(f"{name} [") else f"{name} = {text}" for name, text in self.columns.items()
        )
        head = phrase("reading.file", **values) + phrase("reading.gaps" if self.n_gaps else "reading.no_gaps", **values)
        return [head, phrase("reading.columns", columns=columns), *map(sentence, self.evidence)]


def not_covered(imu: ReadingFacts, gps: ReadingFacts) -> list[Finding]:
    """Report a long part of either file, at its beginning or end, that the other file does not cover."""
    findings = []
    for subject, whole, part, codes in (("imu", gps, imu, _SHORT_IMU), ("gps", imu, gps, _SHORT_GPS)):
        length = whole.end_s - whole.start_s
        for code, lost in zip(codes, (part.start_s - whole.start_s, whole.end_s - part.end_s), strict=True):
            limit = max(LOST, LOST_SHARE * length)
            if limit < lost < length:  # without any common time, the clocks are reported instead
                values: dict[str, Any] = {"lost_s": lost, "limit_s": limit, "share": lost / length}
                values |= {"file": Path(part.path).name, "other": Path(whole.path).name}
                empty = part.n_rows - part.n_used
                values |= {"empty": empty} if empty / part.rate_hz > 0.5 * lost else {}
                findings.append(Finding.of(code, subject=subject, **values))
    return findings


@dataclass(frozen=True, slots=True)
class Reading(Generic[T]):
    """Data from a file, with events and interpretation."""

    data: T  # data of the kind that was read
    events: tuple[Finding, ...]  # dropped, sorted or missing rows, in order of time
    facts: ReadingFacts  # interpretation of the file
    # (n,) fix type of each row, if the file has any; -1 for an empty cell
    fix: IntArray | None = field(default=None)
