"""Text from files and names, made harmless before it is printed or written."""

from __future__ import annotations

import re
import unicodedata

_ESCAPE = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]"  # CSI: colours, cursor
    r"|\x1b[\]PX^_].*?(?:\x07|\x1b\\|$)"  # OSC and other strings: titles, links
    r"|\x1b[ -/]*[0-~]"  # two-character sequences
)
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def plain_text(text: object) -> str:
    """Text on one line without terminal escape codes, control or direction-override characters."""
    kept = _ESCAPE.sub("", str(text))
    spaced = "".join(" " if c in "\t\n\r\v\f\x85\u2028\u2029" else c for c in kept)
    return "".join(c for c in spaced if unicodedata.category(c) not in ("Cc", "Cf", "Cs"))


def cell_text(text: object) -> str:
    """Text of a table cell that no spreadsheet takes for a formula: such a start gets an apostrophe."""
    plain = plain_text(text)
    dangerous = str(text).startswith(_FORMULA) or plain.lstrip().startswith(_FORMULA)
    return "'" + plain if dangerous else plain
