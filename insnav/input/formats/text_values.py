"""Text cells that represent numbers: dates, times of day, angles with a hemisphere.

Dates with times become seconds of a GPS week, as in `time_scales`; times of day become seconds since midnight.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from insnav.deferred import library
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.time_scales import GpsTime, gps_days, seconds_of_week, unix_days
from insnav.plain_text import plain_text
from insnav.types import FloatArray

pa = library("pyarrow")
pc = library("pyarrow.compute")

_TIME = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2}(?:[.,]\d*)?))?[ ]?(?P<half>[AaPp][Mm])?"
    r"[ ]?(?P<zone>Z|UTC|GMT|GPST?|[-+]\d{2}(?::?\d{2})?)?"
)
_DATES = (
    r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})",
    r"(?P<day>\d{1,2})[-. ](?P<month>\d{1,2}|[A-Za-z]{3})[-. ](?P<year>\d{4})",
    r"(?P<first>\d{1,2})/(?P<then>\d{1,2})/(?P<year>\d{4})",
)
_BETWEEN = r"(?:[ ]+|[ ]?[Tt_,][ ]?)"
_FORMS = (*(f"^{date}{_BETWEEN}{_TIME}$" for date in _DATES), f"^{_TIME}$", *(f"^{date}$" for date in _DATES))
_PATTERNS = tuple(re.compile(form) for form in _FORMS)
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_ANGLE = re.compile(
    r"^(?P<before>[NSEW])?\s*(?P<sign>[-+])?(?P<deg>\d+(?:\.\d*)?)\s*(?:°|deg|d|º)?\s*"
    r"(?:(?P<min>\d+(?:\.\d*)?)\s*['′’m]?\s*(?:(?P<sec>\d+(?:\.\d*)?)\s*(?:\"|″|''|s)?)?)?\s*(?P<after>[NSEW])?$",
    re.IGNORECASE,
)
_ANGLE_MARK = re.compile(r"[°º'′’\"NSEWnsew]")
_HEMISPHERES = {"N": 1.0, "E": 1.0, "S": -1.0, "W": -1.0}


class TextValues(NamedTuple):
    """Text column converted to numbers."""

    values: FloatArray  # (n,) seconds, days, degrees or signs; NaN for an empty cell
    form: str  # ``date and time``, ``time of day``, ``date``, ``angle`` or ``hemisphere``
    note: Finding | None = None  # finding on the time scale or time zone
    week: float | None = None  # GPS week of the time origin


def form_of(cell: str) -> str:
    """Classify a cell by the forms of `TextValues`; empty if it represents no number."""
    if any(pattern.match(cell) for pattern in _PATTERNS):
        has_time, has_date = ":" in cell, not re.match(r"^\d{1,2}:", cell)
        return {(True, True): "date and time", (True, False): "time of day", (False, True): "date"}[has_time, has_date]
    if cell.upper() in _HEMISPHERES:
        return "hemisphere"
    return "angle" if _ANGLE_MARK.search(cell) and _ANGLE.match(cell) else ""


def values_of(texts: Any, where: str) -> TextValues:
    """Convert an Arrow array of texts to numbers; the first nonempty cell determines the form of all cells.

    Raises: InputError: a cell has another form, or a date is ambiguous; `where` is the column, for the error.
    """
    texts = pc.utf8_trim_whitespace(texts)
    first = next((cell for cell in texts.to_pylist() if cell), "")
    form = form_of(first)
    if not form:
        return TextValues(np.full(len(texts), np.nan), "")
    if form in ("angle", "hemisphere"):
        convert = _HEMISPHERES.get if form == "hemisphere" else _degrees
        cells = [np.nan if not cell else convert(cell.upper()) for cell in texts.to_pylist()]
        _refuse_others([cell is None for cell in cells], texts, first, where)
        return TextValues(np.array(cells, dtype=np.float64), form)
    pattern = _FORMS[next(i for i, compiled in enumerate(_PATTERNS) if compiled.match(first))]
    groups = pc.extract_regex(texts, pattern)
    empty = np.asarray(pc.equal(pc.fill_null(texts, ""), "").to_numpy(zero_copy_only=False), dtype=np.bool_)
    valid = np.asarray(groups.is_valid().to_numpy(zero_copy_only=False), dtype=np.bool_)
    _refuse_others(~valid & ~empty, texts, first, where)
    names = re.findall(r"\?P<(\w+)>", pattern)
    parts = {name: pc.struct_field(groups, name) for name in names}
    second = _seconds(parts) if "hour" in parts else np.zeros(len(empty))
    if form == "time of day":
        note = None if _has_zone(parts) else Finding.of(Code.READ_TIME_OF_DAY, example=first)
        return TextValues(np.where(valid, second, np.nan), form, note)
    day = _days(parts, valid, where)
    if form == "date":
        return TextValues(np.where(valid, day, np.nan), form)
    rows = np.flatnonzero(valid)
    in_gps_time = _flags(parts["zone"], "GPS", "GPST").any()
    time, note, week = seconds_of_week(day[rows], second[rows], "GPST" if in_gps_time else "UTC")
    values = np.full(len(empty), np.nan)
    values[rows] = time
    return TextValues(values, form, note if _has_zone(parts) else _utc_assumed(note), week)


def seconds_of_stamps(stamps: Any) -> TextValues:
    """Convert an Arrow array of UTC timestamps to seconds of the GPS week."""
    known = np.asarray(stamps.is_valid().to_numpy(), dtype=np.bool_)
    whole = stamps.cast(pa.timestamp("ns", stamps.type.tz)).cast(pa.int64()).fill_null(0).to_numpy()
    time = np.full(len(known), np.nan)
    time[known], note, week = seconds_of_week(*unix_days(whole[known]), "UTC")
    return TextValues(time, "date and time", note if stamps.type.tz else _utc_assumed(note), week)


def with_date(day: FloatArray, second: FloatArray) -> GpsTime:
    """Convert separate columns of UTC dates and times of day ``(n,)`` to seconds of the GPS week."""
    rows = np.isfinite(day) & np.isfinite(second)
    time = np.full(len(day), np.nan)
    time[rows], note, week = seconds_of_week(day[rows], second[rows], "UTC")
    return GpsTime(time, note, week)


def _refuse_others(other: Sequence[bool] | Any, texts: Any, first: str, where: str) -> None:
    rows = np.flatnonzero(np.asarray(other, dtype=np.bool_))
    if len(rows):
        text, like = (plain_text(cell)[:40] for cell in (texts[int(rows[0])].as_py(), first))
        row, count = int(rows[0]) + 1, len(rows)
        raise InputError("format.mixed_texts", where=where, text=text, like=like, row=row, count=count)


def _numbers(part: Any, missing: str = "0") -> FloatArray:
    plain = pc.replace_substring(pc.fill_null(part, missing), ",", ".")
    plain = pc.if_else(pc.equal(plain, ""), missing, plain)
    return np.asarray(pc.cast(plain, pa.float64()).to_numpy(zero_copy_only=False))


def _flags(part: Any, *words: str) -> Any:
    mask = pc.is_in(pc.utf8_upper(pc.fill_null(part, "")), value_set=pa.array(words))
    return np.asarray(mask.to_numpy(zero_copy_only=False), dtype=np.bool_)


def _seconds(parts: dict[str, Any]) -> FloatArray:
    """Compute seconds since midnight ``(n,)``: UTC if the texts state a time zone, otherwise in their own clock."""
    hour = _numbers(parts["hour"])
    hour = np.where(_flags(parts["half"], "AM", "PM"), hour % 12.0, hour) + 12.0 * _flags(parts["half"], "PM")
    second = 3600.0 * hour + 60.0 * _numbers(parts["minute"]) + _numbers(parts["second"])
    zone = pc.fill_null(parts["zone"], "")
    offset = pc.if_else(pc.match_substring_regex(zone, r"^[-+]"), pc.replace_substring(zone, ":", ""), "+0000")
    hours, minutes = _numbers(pc.utf8_slice_codeunits(offset, 1, 3)), _numbers(pc.utf8_slice_codeunits(offset, 3, 5))
    sign = 1.0 - 2.0 * np.asarray(pc.starts_with(offset, "-").to_numpy(zero_copy_only=False), dtype=np.float64)
    return np.asarray(second - sign * (3600.0 * hours + 60.0 * minutes))


def _days(parts: dict[str, Any], valid: Any, where: str) -> FloatArray:
    """Compute days since 6 January 1980 ``(n,)``; refuse dates that are ambiguous or impossible."""
    if "first" in parts:
        one, two = _numbers(parts["first"], "1"), _numbers(parts["then"], "1")
        if one.max() <= 12.0 and two.max() <= 12.0:
            raise InputError("format.ambiguous_dates", where=where, one=int(one[valid][0]), two=int(two[valid][0]))
        day, month = (one, two) if one.max() > 12.0 else (two, one)
    else:
        names = pc.utf8_lower(pc.fill_null(parts["month"], "1"))
        place = pc.index_in(names, value_set=pa.array(_MONTHS))
        month = _numbers(pc.if_else(pc.is_valid(place), pc.cast(pc.add(pc.fill_null(place, 0), 1), pa.string()), names))
        day = _numbers(parts["day"], "1")
    year = _numbers(parts["year"], "1980")
    days = gps_days(year, month, day)
    wrong = valid & np.isnan(days)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputError(
            "format.impossible_date", where=where, row=row + 1, day=float(day[row]), month=float(month[row])
        )
    return days


def _has_zone(parts: dict[str, Any]) -> bool:
    """Return True if a text states a time zone."""
    return bool(pc.any(pc.not_equal(pc.fill_null(parts["zone"], ""), "")).as_py())


def _utc_assumed(note: Finding | None) -> Finding | None:
    """Change the finding on UTC times: without a stated time zone, UTC is assumed."""
    return None if note is None else replace(note, code=Code.READ_TIME_UTC_ASSUMED)


def _degrees(text: str) -> float | None:
    """Parse an angle such as ``48°07'02.3"N`` or ``4807.038N`` in degrees; None if invalid."""
    match = _ANGLE.match(text)
    if match is None:
        return None
    degrees = float(match["deg"]) + float(match["min"] or 0.0) / 60.0 + float(match["sec"] or 0.0) / 3600.0
    sign = _HEMISPHERES.get((match["before"] or match["after"] or "N").upper(), 1.0)
    return -sign * degrees if match["sign"] == "-" else sign * degrees
