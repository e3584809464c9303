"""Findings of insnav, as data: a code and numbers, never a sentence.

`insnav.messages` turns a finding into words. Nothing else in the package may depend on those words.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import EnumType, IntEnum, StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias


@cache
def catalogue(lang: str) -> Mapping[str, Any]:
    """Read a message catalogue: the file ``messages/<lang>.toml``."""
    return tomllib.loads((Path(__file__).parent / "messages" / f"{lang}.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True, slots=True)
class ErrorFacts:
    """Error as a value of a finding or of another error: see `insnav.exceptions.InsnavError`."""

    code: str
    where: str
    values: tuple[tuple[str, Any], ...]

    def as_dict(self) -> dict[str, Any]:
        """Convert the error for JSON; a number that is not finite is None."""
        values = {name: _json_ready(value) for name, value in self.values}
        return {"code": self.code, "where": self.where, "values": values}

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any]) -> Self:
        """Restore an error from JSON."""
        return cls(facts["code"], facts["where"], tuple((name, _plain(item)) for name, item in facts["values"].items()))


# Number or numbers in SI units and radians, a count, a language-independent name (column, option, unit), or the error
# that is the cause
Value: TypeAlias = float | int | str | tuple[float, ...] | tuple[str, ...] | ErrorFacts


class Severity(IntEnum):
    """Severity of a finding, in rising order."""

    NOTE = 0  # insnav detected and handled the fact
    ASSUMPTION = 1  # insnav assumed the fact: neither the user nor the data specify it
    WARNING = 2  # the result may be worse than stated
    UNUSABLE = 3  # the result must not be used


class _AnyName(EnumType):
    """Enum type that lets a type checker accept any member name; a test finds unknown names."""

    if TYPE_CHECKING:

        def __getattr__(cls, name: str) -> Code: ...


class _Coded(StrEnum, metaclass=_AnyName):
    """Code of a finding: a text such as ``gps.frozen``, with the default severity of the finding."""

    severity: Severity

    def __new__(cls, code: str, severity: str = "note") -> Self:
        """Make a member from its name in files and its default severity."""
        member = str.__new__(cls, code)
        member._value_ = code
        member.severity = Severity[severity.upper()]
        return member


if TYPE_CHECKING:

    class Code(_Coded):
        """Codes of everything that insnav can detect: one member per entry of ``insnav/messages/en.toml``."""

else:
    # ``gps.frozen`` is `Code.GPS_FROZEN`; the part before the first dot is the origin
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
    """Collect the codes of families; the family is the part of a code before the first dot."""
    return frozenset(code for code in Code if code.partition(".")[0] in families)


# Changes of the IMU or of the GPS delay within a drive; wrong IMU axes can cause them, too.
OF_THE_IMU = of_families("change")
# Fixes, IMU and given inputs contradict each other.
CONTRADICTIONS = of_families("change", "given", "noise", "record")
# Fixes that a receiver or logger repeats or extrapolates.
NOT_MEASURED = frozenset({Code.GPS_FROZEN, Code.GPS_FROZEN_VELOCITY, Code.GPS_EXTRAPOLATED})
# Time-correlated errors of positions, of any origin.
CORRELATED_POSITIONS = frozenset(
    {
        Code.GPS_CORRELATED_REPORTED,
        Code.GPS_CORRELATED_VELOCITY,
        Code.ESTIMATE_CORRELATED,
        Code.ESTIMATE_CORRELATED_PLAUSIBLE,
        Code.ESTIMATE_CORRELATED_USUAL,
    }
)
# Position standard deviations that insnav assumed, since the fixes have none.
ASSUMED_POSITION_SD = frozenset(
    {Code.GPS_POSITION_SD_SCATTER, Code.GPS_POSITION_SD_FIX_TYPE, Code.GPS_POSITION_SD_STAND_ALONE}
)
# Corrections of clocks and velocities; the short form of a run lists these.
CORRECTIONS = frozenset({Code.GPS_VELOCITY_LAG, Code.IMU_CLOCK_RATE})
# Choices of an IMU error specification.
MODEL_CHOICES = of_families("imu_model") - {Code.IMU_MODEL_KEPT}
# Findings on the files or on a whole run, which are no events.
OF_RESULTS = of_families("files", "imu_model", "run")
# Findings on single rows and fixes: ``events.csv`` lists them, pages show only their consequences.
SINGLE = of_families("deweighted", "gate", "rows") | {Code.IMU_SPIKE, Code.GPS_OUTSIDE, Code.FILTER_REPAIR}
# Codes of which one warning summarises all findings of a run.
_LOST = frozenset({Code.IMU_SATURATED, Code.IMU_LIMITED, Code.IMU_STUCK, Code.IMU_FROZEN, Code.ROWS_GAP})
SUMMED = _LOST | {Code.FILTER_RESET, Code.FILTER_DIVERGED}


@dataclass(frozen=True, slots=True)
class Finding:
    """Fact that insnav detected.

    Attributes
    ----------
    code : Code
        Code of the finding.
    severity : Severity
        Severity; by default the default of its code.
    begin, end : float
        Begin and end in the time of the data [s]; ``NaN`` without time. Equal for an instant.
    values : tuple of (str, Value)
        Named numbers, most important first: SI units and radians, the unit at the end of the name (``delay_s``). A
        decisive number is followed by its limit, named ``limit`` with the same unit (``limit_s``).
    subject : str
        Subject by a language-independent name: ``imu``, ``gps``, ``gyro x``, a column, a file.
    """

    code: Code
    severity: Severity = Severity.NOTE
    begin: float = math.nan
    end: float = math.nan
    values: tuple[tuple[str, Value], ...] = ()
    subject: str = ""

    def __post_init__(self) -> None:
        for name in ("begin", "end"):
            if math.isnan(getattr(self, name)):  # a single NaN object, so that findings without a time compare equal
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
        """Make a finding: an instant without `end`, with the default severity of its code unless specified."""
        return cls(
            code,
            code.severity if severity is None else severity,
            float(begin),
            float(begin if end is None else end),
            tuple((name, _plain(value)) for name, value in values.items()),
            subject,
        )

    def as_dict(self) -> dict[str, Any]:
        """Convert the finding for JSON; a number that is not finite is None."""
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
        """Restore a finding from JSON; an unknown code, or a text of version 0.2, becomes ``Code.STORED_TEXT``."""
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
        """Return a value by name."""
        for key, value in self.values:
            if key == name:
                return value
        raise KeyError(f"{self.code} has no {name}")

    def get(self, name: str, otherwise: Any = None) -> Any:
        """Return a value by name, or `otherwise` if absent."""
        return next((value for key, value in self.values if key == name), otherwise)

    @property
    def value(self) -> float:
        """Decisive number: the first number among the values; ``NaN`` without numbers."""
        return self.measured[1]

    @property
    def measured(self) -> tuple[str, float]:
        """Name of the decisive number, with its unit, and the number; ``""`` and ``NaN`` without numbers."""
        return next(((name, float(value)) for name, value in self._numbers() if name[:5] != "limit"), ("", math.nan))

    @property
    def limit(self) -> float:
        """Limit of the decisive number; ``NaN`` without a limit."""
        return next((float(value) for name, value in self._numbers() if name.startswith("limit")), math.nan)

    def _numbers(self) -> Iterator[tuple[str, float]]:
        return ((name, value) for name, value in self.values if isinstance(value, int | float))

    def later(self, offset: float) -> Finding:
        """Return the finding with its times increased by `offset` [s]."""
        return replace(self, begin=self.begin + offset, end=self.end + offset) if self.timed else self

    @property
    def timed(self) -> bool:
        """True if the finding has a time."""
        return not math.isnan(self.begin)


def added(before: Iterable[Finding], after: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings in `after` that are not in `before`."""
    known = {*before}
    return tuple(finding for finding in after if finding not in known)


def of_code(findings: Iterable[Finding], *codes: Code) -> Iterator[Finding]:
    """Yield the findings that have one of `codes`."""
    return (finding for finding in findings if finding.code in codes)


def is_shown(finding: Finding) -> bool:
    """Return whether a page shows a finding; ``events.csv`` lists the others."""
    # every event of version 0.2 has a stored text
    single = finding.code in SINGLE or finding.get("text") is not None
    return finding.code not in SUMMED and not (finding.timed and single and finding.severity is Severity.NOTE)


def by_time(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by time; findings without time come first, in their order."""
    return tuple(sorted(findings, key=lambda each: each.begin if each.timed else -math.inf))


def _json_ready(value: Any) -> Any:
    if isinstance(value, Finding | ErrorFacts):
        return value.as_dict()
    if isinstance(value, tuple):
        return [_json_ready(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain(value: Any) -> Any:
    """Convert numpy numbers and arrays to Python types, which are hashable, and errors to facts."""
    if isinstance(value, str | bool | ErrorFacts):
        return value
    if isinstance(value, Mapping) and "code" in value:
        return (Finding if "severity" in value else ErrorFacts).from_dict(value)
    if hasattr(value, "facts"):  # `value` is an `InsnavError`
        return value.facts
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(map(_plain, value))
    if isinstance(value, float) and math.isnan(value):
        return math.nan
    return value
