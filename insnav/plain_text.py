"""Sanitising of text from files and names before it is printed or written."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from typing import Any

NOT_UTF8 = "backslashreplace"  # error handler: file names that are not UTF-8 get escapes, which JSON restores
_ESCAPE = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]"  # CSI: colours, cursor
    r"|\x1b[\]PX^_].*?(?:\x07|\x1b\\|$)"  # OSC and other strings: titles, links
    r"|\x1b[ -/]*[0-~]"  # two-character sequences
)
_LARGE = re.compile(r"\b\d(?:\.\d+)?e\+\d\d\b")  # number with a positive exponent
_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # first characters of a formula in spreadsheets


class Name(str):
    """Name that the user chose: it is never translated."""

    __slots__ = ()


def plain_text(text: object) -> str:
    """Reduce a text to one line without terminal escape codes, control or direction-override characters."""
    without_escapes = _ESCAPE.sub("", str(text).encode("utf-8", NOT_UTF8).decode())
    one_line = "".join(" " if c in "\t\n\r\v\f\x85\u2028\u2029" else c for c in without_escapes)
    return "".join(c for c in one_line if unicodedata.category(c) not in ("Cc", "Cf"))


def cell_text(text: object) -> str:
    """Write a text for a table cell; an apostrophe in front keeps spreadsheets from reading it as a formula."""
    plain = plain_text(text)
    dangerous = str(text).startswith(_FORMULA) or plain.lstrip().startswith(_FORMULA)
    return "'" + plain if dangerous else plain


def text_of_cell(cell: str) -> str:
    """Restore the text of a table cell from `cell_text`."""
    return cell[1:] if cell.startswith("'") and cell[1:].lstrip().startswith(_FORMULA) else cell


def without_exponents(text: str) -> str:
    """Write large numbers in full: 1.9e+02 is 190."""
    return _LARGE.sub(lambda found: f"{float(found[0]):.0f}", text)


def moment(start: float, stop: float | None = None, until: str = "to") -> str:
    """Write a time or an interval of the record [s]: ``t = 12.0 s``."""
    return f"t = {start:.1f} s" if stop in (None, start) else f"t = {start:.1f} {until} {stop:.1f} s"


def wrapped(text: str, width: int, **how: Any) -> list[str]:
    """Wrap a text to a terminal width, where a Chinese character takes two columns; see `textwrap`."""
    padded = in_columns(text)
    if padded != text:  # a line may end between any two Chinese characters
        how, width = how | {"break_long_words": True}, width - 1
    return [row.replace("\0", "") for row in textwrap.wrap(padded, width, **how)]


def in_columns(text: str) -> str:
    """Append a null character to each character that takes two columns of a terminal, so that the length is right."""
    return "".join(c + "\0" * (unicodedata.east_asian_width(c) in ("W", "F")) for c in text)
