"""Intentional errors of insnav, as data: a code, a place and values, never a sentence.

`insnav.messages` converts them to the fact, the evidence and advice when they are displayed. The command line prints
one block per error and exits with `exit_code`; nothing else in the package calls `sys.exit`.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from insnav.findings import ErrorFacts

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # disk full, quota exceeded, or file too large
KEYWORDS = {"--out": "folder"}  # options whose Python keyword has another name; `insnav.steps.inputs` adds more
_COMMAND = re.compile(r"insnav (run|batch|check|align|compare|export|outage|budget|require|simulate|allan|tune) ")
_OPTION = re.compile(r"--([a-z](?:[a-z-]*[a-z])?)\b")


def as_keywords(text: str) -> str:
    """Replace command-line options by Python keywords in a text; lines with a shell command stay unchanged."""

    def keyword(found: re.Match[str]) -> str:
        return KEYWORDS.get(found[0], found[1].replace("-", "_"))

    return "\n".join(line if _COMMAND.search(line) else _OPTION.sub(keyword, line) for line in text.splitlines())


class InsnavError(Exception):
    """Base of all intentional errors of insnav: a code and values, which `insnav.messages` puts into words.

    Parameters
    ----------
    code : str
        Code of the error catalogue, such as ``"unit.unknown"``.
    where : str
        Place: ``file:row:column``, a configuration key, a time.
    gives : mapping, optional
        Arguments of `insnav.load` that the evidence suggests, by name.
    **values
        Values in the message: numbers in SI units and radians, names, tuples of these, and the cause: errors or
        findings.
    """

    exit_code = 70

    def __init__(self, code: str, *, where: str = "", gives: Mapping[str, Any] | None = None, **values: Any) -> None:
        super().__init__(code)
        self.code = code
        self.where = where
        self.gives = dict(gives or {})
        self.values = values

    def withdraw_columns(self) -> None:
        """Remove suggested columns, which proved to be wrong, from the advice."""
        names = tuple(self.gives.pop("columns"))
        self.values |= dict.fromkeys({"meant", "guess"} & self.values.keys(), "")
        numbers = ",".join(f"{name}=NUMBER" for name in names)
        self.values |= {"example": names[0]} if "example" in self.values else {"numbers": numbers}

    @property
    def what(self) -> str:
        """Statement of the error, understandable alone."""
        return self._part("what")

    @property
    def why(self) -> str:
        """Evidence for the error, with numbers."""
        return self._part("why")

    @property
    def fix(self) -> str:
        """Advice on how to correct the error."""
        return self._part("fix")

    def _part(self, name: str) -> str:
        from insnav.messages import render_error

        return render_error(self.code, name, dict(self.facts.values))

    @property
    def reason(self) -> str:
        """Statement and evidence in one line."""
        from insnav.messages import form

        return form("joint").join(part for part in (self.what, self.why) if part)

    def __str__(self) -> str:
        parts = [self.what]
        parts += [f"{label.rstrip()} {text}" for label, text in self.details() if text]
        return as_keywords("\n".join(parts))  # with Python keywords; the command line uses `details`

    def details(self) -> tuple[tuple[str, str], ...]:
        """Return label and text of location, evidence, advice and code."""
        from insnav.messages import form

        parts = {"where": self.where, "why": self.why, "fix": self.fix, "code": self.code}
        return tuple((form(name), text) for name, text in parts.items())

    @property
    def facts(self) -> ErrorFacts:
        """Code, location and values of the error, for use as a value in a finding or another error."""
        from insnav.findings import ErrorFacts

        return ErrorFacts.from_dict({"code": self.code, "where": self.where, "values": self.values})

    def as_dict(self) -> dict[str, Any]:
        """Convert the error for JSON."""
        return {"kind": type(self).__name__} | self.facts.as_dict()

    @staticmethod
    def from_dict(facts: Mapping[str, Any]) -> InsnavError:
        """Restore an error from JSON."""
        from insnav.findings import ErrorFacts

        kinds: tuple[type[InsnavError], ...] = (InsnavError, *InsnavError.__subclasses__())
        kind = {error_type.__name__: error_type for error_type in kinds}[facts["kind"]]
        return kind(facts["code"], where=facts["where"], **dict(ErrorFacts.from_dict(facts).values))


class ConfigError(InsnavError):
    """Invalid option or configuration file."""

    exit_code = 2


class InputError(InsnavError):
    """Unusable data file."""

    exit_code = 3


class AlignmentError(InsnavError):
    """Initial attitude that the data do not determine."""

    exit_code = 3


class DivergenceError(InsnavError):
    """Filter that cannot continue, since the data made it inconsistent."""

    exit_code = 3


class CheckError(InsnavError):
    """Complete but unusable result, or a result below requirements."""

    exit_code = 1


class OutputError(InsnavError):
    """Result that cannot be written."""

    exit_code = 4


@contextmanager
def writing(code: str, where: object, **values: Any) -> Iterator[None]:
    """Convert operating-system errors in the ``with`` block to an `OutputError`. `where`: file or folder."""
    try:
        yield
    except OSError as error:
        raise OutputError(code, where=str(where), reason=reason_of(error), **values) from error


def reason_of(error: BaseException) -> str:
    """Return the report of the operating system or a library, for the value ``reason`` of an error."""
    return (getattr(error, "strerror", None) or str(error)).rstrip(".")
