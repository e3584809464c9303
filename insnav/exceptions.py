"""Every error insnav raises on purpose, as data: a code, a place and values, never a sentence.

`insnav.messages` turns them into what went wrong, why, and what the user can do, once somebody reads them. The command
line prints one block per error and ends with `exit_code`; nothing else in the package calls `sys.exit`.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from insnav.findings import ErrorFacts

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # a disk, a quota or a file is full
KEYWORDS = {"--out": "folder"}  # options whose keyword in Python has another name; `insnav.steps.inputs` adds its own
_COMMAND = re.compile(r"insnav (run|batch|check|align|compare|export|outage|budget|require|simulate|allan|tune) ")
_OPTION = re.compile(r"--([a-z](?:[a-z-]*[a-z])?)\b")


def as_keywords(text: str) -> str:
    """Text for who calls from Python, and has keywords, not options; a line to copy into a shell stays as it is."""

    def keyword(found: re.Match[str]) -> str:
        return KEYWORDS.get(found[0], found[1].replace("-", "_"))

    return "\n".join(line if _COMMAND.search(line) else _OPTION.sub(keyword, line) for line in text.splitlines())


class InsnavError(Exception):
    """Base of all errors insnav raises on purpose: a code and values, which `insnav.messages` puts into words.

    Parameters
    ----------
    code : str
        What went wrong: a code of the catalogue of errors, such as ``"unit.unknown"``.
    where : str
        Place: ``file:row:column``, a configuration key, a time.
    gives : mapping, optional
        Inputs by name, as of `insnav.load`, that the evidence says to give.
    **values
        What the words hold: numbers in SI units and radians, names, tuples of these, and the cause: errors or findings.
    """

    exit_code = 70

    def __init__(self, code: str, *, where: str = "", gives: Mapping[str, Any] | None = None, **values: Any) -> None:
        super().__init__(code)
        self.code = code
        self.where = where
        self.gives = dict(gives or {})
        self.values = values

    @property
    def what(self) -> str:
        """What went wrong, understood without the rest."""
        return self._part("what")

    @property
    def why(self) -> str:
        """The evidence, with numbers."""
        return self._part("why")

    @property
    def fix(self) -> str:
        """What the user can do about it."""
        return self._part("fix")

    def _part(self, name: str) -> str:
        from insnav.messages import render_error

        return render_error(self.code, name, dict(self.facts.values))

    @property
    def reason(self) -> str:
        """What went wrong and the evidence, in one line."""
        from insnav.messages import form

        return form("joint").join(part for part in (self.what, self.why) if part)

    def __str__(self) -> str:
        parts = [self.what]
        parts += [f"{label.rstrip()} {text}" for label, text in self.details() if text]
        return as_keywords("\n".join(parts))  # the command line prints the details

    def details(self) -> tuple[tuple[str, str], ...]:
        """Label and text of every part after the first sentence."""
        from insnav.messages import form

        parts = {"where": self.where, "why": self.why, "fix": self.fix, "code": self.code}
        return tuple((form(name), text) for name, text in parts.items())

    @property
    def facts(self) -> ErrorFacts:
        """The error as a value of a finding or of another error."""
        from insnav.findings import ErrorFacts

        return ErrorFacts.from_dict({"code": self.code, "where": self.where, "values": self.values})

    def as_dict(self) -> dict[str, Any]:
        """Give the error in a form ready for JSON."""
        return {"kind": type(self).__name__} | self.facts.as_dict()

    @staticmethod
    def from_dict(facts: Mapping[str, Any]) -> InsnavError:
        """Take an error back from JSON."""
        from insnav.findings import ErrorFacts

        kinds: tuple[type[InsnavError], ...] = (InsnavError, *InsnavError.__subclasses__())
        kind = {each.__name__: each for each in kinds}[facts["kind"]]
        return kind(facts["code"], where=facts["where"], **dict(ErrorFacts.from_dict(facts).values))


class ConfigError(InsnavError):
    """An option or a configuration file that cannot be meant as written."""

    exit_code = 2


class InputError(InsnavError):
    """A data file that cannot be used."""

    exit_code = 3


class AlignmentError(InsnavError):
    """The data do not determine an initial attitude."""

    exit_code = 3


class DivergenceError(InsnavError):
    """The data make the filter lose consistency, so that it cannot go on."""

    exit_code = 3


class CheckError(InsnavError):
    """A result that is complete, but not to be used, or not as good as asked for."""

    exit_code = 1


class OutputError(InsnavError):
    """A result that cannot be written."""

    exit_code = 4


@contextmanager
def writing(code: str, where: object, **values: Any) -> Iterator[None]:
    """Raise what the operating system refuses inside as an `OutputError`. `where`: file or folder."""
    try:
        yield
    except OSError as error:
        raise OutputError(code, where=str(where), reason=reason_of(error), **values) from error


def reason_of(error: BaseException) -> str:
    """Say what the operating system or a library reports, for the value ``reason`` of an error."""
    return (getattr(error, "strerror", None) or str(error)).rstrip(".")
