"""Every error insnav raises on purpose: what, where, why, and how to mend it.

The command line prints one block per error and ends with `exit_code`; nothing else in the package calls `sys.exit`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

KEYWORDS = {"--out": "folder"}  # options whose keyword in Python has another name; `insnav.steps.inputs` adds its own
_OPTION = re.compile(r"--([a-z](?:[a-z-]*[a-z])?)\b")


def as_keywords(text: str) -> str:
    """Text for who calls from Python, and has keywords, not options; a line to copy into a shell stays as it is."""

    def keyword(found: re.Match[str]) -> str:
        return KEYWORDS.get(found[0], found[1].replace("-", "_"))

    return "\n".join(line if "insnav " in line else _OPTION.sub(keyword, line) for line in text.splitlines())


class InsnavError(Exception):
    """Base of all errors insnav raises on purpose.

    Parameters
    ----------
    what : str
        One sentence: what went wrong.
    where : str
        Place: ``file:row:column``, a configuration key, a time.
    why : str
        The evidence, with numbers.
    fix : str
        What the user can do about it.
    gives : mapping, optional
        Inputs by name, as of `insnav.load`, that the evidence says to give.
    """

    exit_code = 70

    def __init__(
        self, what: str, *, where: str = "", why: str = "", fix: str = "", gives: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.why = why
        self.fix = fix
        self.gives = dict(gives or {})

    def __str__(self) -> str:
        parts = [self.what]
        parts += [f"{name}: {text}" for name, text in self.details() if text]
        return as_keywords("\n".join(parts))  # the command line prints the details

    def details(self) -> tuple[tuple[str, str], ...]:
        """Label and text of every part after the first sentence."""
        return (("where", self.where), ("why", self.why), ("fix", self.fix))


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
    """The filter lost consistency and cannot go on."""

    exit_code = 1


class CheckError(InsnavError):
    """A result that is complete, but not to be used, or not as good as asked for."""

    exit_code = 1


class OutputError(InsnavError):
    """A result that cannot be written."""

    exit_code = 4


@contextmanager
def writing(what: str, where: object, fix: str = "") -> Iterator[None]:
    """Raise what the operating system refuses inside as an `OutputError`; `where`: file or folder."""
    try:
        yield
    except OSError as error:
        raise OutputError(what, where=str(where), why=error.strerror or str(error), fix=fix) from error
