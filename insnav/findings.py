"""What insnav detects, as data: a code and numbers, never a sentence.

`insnav.messages` turns a finding into words. Nothing else in the package may depend on those words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import EnumType, IntEnum, StrEnum
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from insnav.catalogues import catalogue


@dataclass(frozen=True, slots=True)
class ErrorFacts:
    """An error as a value of a finding or of another error: see `insnav.exceptions.InsnavError`."""

    code: str
    where: str
    values: tuple[tuple[str, Any], ...]

    def as_dict(self) -> dict[str, Any]:
        """Give the error in a form ready for JSON; a number that is not finite is None."""
        values = {name: _json_ready(each) for name, each in self.values}
        return {"code": self.code, "where": self.where, "values": values}

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any]) -> Self:
        """Take an error back from JSON."""
        return cls(facts["code"], facts["where"], tuple((name, _plain(each)) for name, each in facts["values"].items()))


# A number or numbers in SI units and radians, a count, a name that stands in no language: of a column, option, unit; or
# the error that is the cause
Value: TypeAlias = float | int | str | tuple[float, ...] | tuple[str, ...] | ErrorFacts


class Severity(IntEnum):
    """How much a finding matters, in rising order."""

    NOTE = 0  # detected, and dealt with
    ASSUMPTION = 1  # taken for granted: neither the user nor the data said so
    WARNING = 2  # makes the result worse than it states, or may
    UNUSABLE = 3  # the result must not be used


class _AnyName(EnumType):
    """Lets a type checker take any name for a member; a test looks for those that are none."""

    if TYPE_CHECKING:

        def __getattr__(cls, name: str) -> Code: ...


class _Coded(StrEnum, metaclass=_AnyName):
    """Code of a finding with its usual severity."""

    severity: Severity

    def __new__(cls, code: str, severity: str = "note") -> Self:
        """Make a member of its name in files and its usual severity."""
        member = str.__new__(cls, code)
        member._value_ = code
        member.severity = Severity[severity.upper()]
        return member


if TYPE_CHECKING:

    class Code(_Coded):
        """Everything that insnav can detect: one member for each entry of ``insnav/messages/en.toml``."""

else:
    # ``gps.frozen`` is `Code.GPS_FROZEN`; the part before the first dot says where it is detected
    Code = _Coded(
        "Code",
        {
            code.upper().replace(".", "_"): (code, entry.get("severity", "note"))
            for code, entry in catalogue("en").items()
            if "title" in entry
        },
        module=__name__,
    )


def of_families(*families: str) -> frozenset[Code]:
    """Collect the codes of some families: the part before the first dot."""
    return frozenset(code for code in Code if code.partition(".")[0] in families)


# Changes of the IMU, and of the delay: an IMU in other axes looks like one.
OF_THE_IMU = of_families("change")
# Fixes and IMU disagree, whichever is wrong.
CONTRADICTIONS = of_families("change", "given", "noise", "record")
# Fixes that a receiver or logger repeats or makes up.
NOT_MEASURED = frozenset({Code.GPS_FROZEN, Code.GPS_FROZEN_VELOCITY, Code.GPS_EXTRAPOLATED})
# Time-correlated errors of positions, from whatever source.
CORRELATED_POSITIONS = frozenset(
    {
        Code.GPS_CORRELATED_REPORTED,
        Code.GPS_CORRELATED_VELOCITY,
        Code.ESTIMATE_CORRELATED,
        Code.ESTIMATE_CORRELATED_PLAUSIBLE,
        Code.ESTIMATE_CORRELATED_USUAL,
    }
)
# Fixes came without a standard deviation of their position.
ASSUMED_POSITION_SD = frozenset(
    {Code.GPS_POSITION_SD_SCATTER, Code.GPS_POSITION_SD_FIX_TYPE, Code.GPS_POSITION_SD_STAND_ALONE}
)
# What insnav corrected in clocks and velocities; the short form of a run names these.
CORRECTIONS = frozenset({Code.GPS_VELOCITY_LAG, Code.IMU_CLOCK_RATE})
# How an IMU error specification was chosen.
MODEL_CHOICES = of_families("imu_model") - {Code.IMU_MODEL_KEPT}
# What a result says of its data and of a whole run: no event in it.
OF_RESULTS = of_families("files", "imu_model", "run")
# Single rows and fixes: ``events.csv`` lists them, and pages have what follows from them.
SINGLE = of_families("deweighted", "gate", "rows") | {Code.IMU_SPIKE, Code.GPS_OUTSIDE, Code.FILTER_REPAIR}
# One warning of a run sums up all of a code.
_LOST = frozenset({Code.IMU_SATURATED, Code.IMU_LIMITED, Code.IMU_STUCK, Code.IMU_FROZEN, Code.ROWS_GAP})
SUMMED = _LOST | {Code.FILTER_RESET, Code.FILTER_DIVERGED}


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that insnav detected.

    Attributes
    ----------
    code : Code
        What it is.
    severity : Severity
        How much it matters; by default as usual for its code.
    begin, end : float
        When it begins and ends, in the time of the data [s]; ``NaN`` if it has no time. A moment has the same twice.
    values : tuple of (str, Value)
        Named numbers, most important first: SI units and radians, the unit at the end of the name (``delay_s``). A
        number that decided has its limit beside it, named ``limit`` with the same unit (``limit_s``).
    subject : str
        What it is about, by a name that stands in no language: ``imu``, ``gps``, ``gyro x``, a column, a file.
    """

    code: Code
    severity: Severity = Severity.NOTE
    begin: float = math.nan
    end: float = math.nan
    values: tuple[tuple[str, Value], ...] = ()
    subject: str = ""

    def __post_init__(self) -> None:
        for name in ("begin", "end"):
            if math.isnan(getattr(self, name)):  # one object, so that findings without a time compare equal
                object.__setattr__(self, name, math.nan)

    @classmethod
    def of(
        cls,
        code: Code,
        begin: float = math.nan,
        end: float | None = None,
        *,
        subject: str = "",
        severity: Severity | None = None,
        **values: Value,
    ) -> Self:
        """Make a finding: one moment if `end` is not given, the usual severity of its code unless that is given."""
        return cls(
            code,
            code.severity if severity is None else severity,
            float(begin),
            float(begin if end is None else end),
            tuple((name, _plain(value)) for name, value in values.items()),
            subject,
        )

    def as_dict(self) -> dict[str, Any]:
        """Give the finding in a form ready for JSON; a number that is not finite is None."""
        values = {name: _json_ready(value) for name, value in self.values}
        times = {"from_s": self.begin, "to_s": self.end} if self.timed else {}
        return {
            "code": self.code.value,
            "severity": self.severity.name.lower(),
            **({"subject": self.subject} if self.subject else {}),
            **{name: round(time, 6) for name, time in times.items()},
            **({"values": values} if values else {}),
        }

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any] | str) -> Self:
        """Take a finding back from JSON; a code that this version does not know, or a text of 0.2, is a stored text."""
        if isinstance(facts, str):
            return cls.of(Code.STORED_TEXT, text=facts)
        code, severity = str(facts["code"]), str(facts.get("severity", "warning")).upper()
        known = code in set(Code)
        values = {str(name): math.nan if value is None else value for name, value in facts.get("values", {}).items()}
        begin, end = (math.nan if facts.get(name) is None else float(facts[name]) for name in ("from_s", "to_s"))
        return cls.of(
            Code(code) if known else Code.STORED_TEXT,
            begin,
            begin if math.isnan(end) else end,
            subject=str(facts.get("subject") or ""),
            severity=Severity[severity] if severity in Severity.__members__ else Severity.WARNING,
            **(values if known else {"text": code} | values),
        )

    def __getitem__(self, name: str) -> Any:
        """Give one of its values by its name."""
        for key, value in self.values:
            if key == name:
                return value
        raise KeyError(f"{self.code} has no {name}")

    def get(self, name: str, otherwise: Any = None) -> Any:
        """Give one of its values, or `otherwise` if it has none of this name."""
        return next((value for key, value in self.values if key == name), otherwise)

    @property
    def value(self) -> float:
        """The number that decided: the first of its values; ``NaN`` if there is none."""
        return self.measured[1]

    @property
    def measured(self) -> tuple[str, float]:
        """The name of that number, with its unit, and the number; ``""`` and ``NaN`` if there is none."""
        return next(((name, float(value)) for name, value in self._numbers() if name[:5] != "limit"), ("", math.nan))

    @property
    def limit(self) -> float:
        """What that number was compared with; ``NaN`` if there is none."""
        return next((float(value) for name, value in self._numbers() if name.startswith("limit")), math.nan)

    def _numbers(self) -> Iterator[tuple[str, float]]:
        return ((name, value) for name, value in self.values if isinstance(value, int | float))

    def later(self, offset: float) -> Finding:
        """Give the same finding on a clock that is ahead by `offset` [s]."""
        return replace(self, begin=self.begin + offset, end=self.end + offset) if self.timed else self

    @property
    def timed(self) -> bool:
        """Whether it happened at a time of the data."""
        return not math.isnan(self.begin)


def added(before: Iterable[Finding], after: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return what was detected since."""
    known = {*before}
    return tuple(finding for finding in after if finding not in known)


def of_code(findings: Iterable[Finding], *codes: Code) -> Iterator[Finding]:
    """Choose the findings that have one of some codes."""
    return (each for each in findings if each.code in codes)


def is_shown(finding: Finding) -> bool:
    """Whether a page shows a finding; ``events.csv`` has the others, one a row."""
    # version 0.2 wrote a text beside each event
    single = finding.code in SINGLE or finding.get("text") is not None
    return finding.code not in SUMMED and not (finding.timed and single and finding.severity is Severity.NOTE)


def by_time(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by time; those without any come first, in their order."""
    return tuple(sorted(findings, key=lambda each: each.begin if each.timed else -math.inf))


def _json_ready(value: Any) -> Any:
    if isinstance(value, Finding | ErrorFacts):
        return value.as_dict()
    if isinstance(value, tuple):
        return [_json_ready(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain(value: Any) -> Any:
    """Turn numbers and arrays of numpy into those of Python, which can be hashed, and errors into facts."""
    if isinstance(value, str | bool | ErrorFacts):
        return value
    if isinstance(value, Mapping) and "code" in value:
        return (Finding if "severity" in value else ErrorFacts).from_dict(value)
    if hasattr(value, "facts"):  # an error
        return value.facts
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(map(_plain, value))
    if isinstance(value, float) and math.isnan(value):
        return math.nan
    return value
