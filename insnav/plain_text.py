"""Text from files and names, made harmless before it is printed or written."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from typing import Any

NOT_UTF8 = "backslashreplace"  # what becomes of bytes of a file name that are no UTF-8: JSON reads them as they were
_ESCAPE = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]"  # CSI: colours, cursor
    r"|\x1b[\]PX^_].*?(?:\x07|\x1b\\|$)"  # OSC and other strings: titles, links
    r"|\x1b[ -/]*[0-~]"  # two-character sequences
)
_LARGE = re.compile(r"\b\d(?:\.\d+)?e\+\d\d\b")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def plain_text(text: object) -> str:
    """Text on one line without terminal escape codes, control or direction-override characters, fit for UTF-8."""
    kept = _ESCAPE.sub("", str(text).encode("utf-8", NOT_UTF8).decode())
    spaced = "".join(" " if c in "\t\n\r\v\f\x85\u2028\u2029" else c for c in kept)
    return "".join(c for c in spaced if unicodedata.category(c) not in ("Cc", "Cf"))


def cell_text(text: object) -> str:
    """Text of a table cell that no spreadsheet takes for a formula: such a start gets an apostrophe."""
    plain = plain_text(text)
    dangerous = str(text).startswith(_FORMULA) or plain.lstrip().startswith(_FORMULA)
    return "'" + plain if dangerous else plain


def text_of_cell(cell: str) -> str:
    """Text of a table cell as it was before `cell_text` made it harmless."""
    return cell[1:] if cell.startswith("'") and cell[1:].lstrip().startswith(_FORMULA) else cell


def without_exponents(text: str) -> str:
    """Text with large numbers written out, as people do: 1.9e+02 is 190."""
    return _LARGE.sub(lambda found: f"{float(found[0]):.0f}", text)


def moment(start: float, stop: float | None = None, until: str = "to") -> str:
    """A time, or stretch, of the record [s] in a text: ``t = 12.0 s``."""
    return f"t = {start:.1f} s" if stop in (None, start) else f"t = {start:.1f} {until} {stop:.1f} s"


def wrapped(text: str, width: int, **how: Any) -> list[str]:
    """Split a text into rows of so many columns of a terminal, where a Chinese character takes two; see `textwrap`."""
    doubled = "".join(c + "\0" * (unicodedata.east_asian_width(c) in ("W", "F")) for c in text)
    if doubled != text:  # a row may end between any two of them, or in the middle of one
        how, width = how | {"break_long_words": True}, width - 1
    return [row.replace("\0", "") for row in textwrap.wrap(doubled, width, **how)]
