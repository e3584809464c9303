"""Conversion of receiver times (GPS weeks, UTC with leap seconds, Unix time) to seconds of one GPS week."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from insnav.findings import Code, Finding
from insnav.types import FloatArray

Scale = Literal["GPST", "UTC"]

WEEK_DAYS = 7.0
DAY = 86_400.0
WEEK = WEEK_DAYS * DAY
EPOCH = np.datetime64("1980-01-06", "D")  # epoch of GPS time
UNIX_DAYS = float((EPOCH - np.datetime64("1970-01-01", "D")).astype(np.int64))  # days from 1970 to the GPS epoch
# months from whose beginning GPS minus UTC is one second more (IERS Bulletin C)
_LEAPS = """
1981-07 1982-07 1983-07 1985-07 1988-01 1990-01 1991-01 1992-07 1993-07
1994-07 1996-01 1997-07 1999-01 2006-01 2009-01 2012-07 2015-07 2017-01
"""
_LEAP_DAYS = (np.array(_LEAPS.split(), dtype="datetime64[D]") - EPOCH).astype(np.float64)


def gps_days(year: FloatArray, month: FloatArray, day: FloatArray) -> FloatArray:
    """Convert calendar dates to days since 6 January 1980, ``(n,)``; NaN for invalid dates, such as 31 February."""
    months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
    first, next_first = (dates.astype("datetime64[D]") for dates in (months, months + 1))
    valid = (month >= 1) & (month <= 12) & (day >= 1) & (day <= (next_first - first).astype(np.float64))
    return np.where(valid, (first - EPOCH).astype(np.float64) + day - 1.0, np.nan)


def unix_days(nanoseconds: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Convert Unix time ``(n,)`` [ns] to days since 6 January 1980 and seconds of the day."""
    day, of_day = np.divmod(nanoseconds, 86_400_000_000_000)
    return day - UNIX_DAYS, of_day * 1e-9


def leap_seconds(day: FloatArray, second: FloatArray) -> FloatArray:
    """Return GPS minus UTC at days since 6 January 1980 and seconds of UTC, ``(n,)`` [s]."""
    return np.searchsorted(_LEAP_DAYS, day + np.floor(second / DAY), side="right").astype(np.float64)


class GpsTime(NamedTuple):
    """Converted receiver times."""

    time: FloatArray  # (n,) since the start of a GPS week [s]
    note: Finding | None  # finding on the conversion
    week: float | None  # number of this week, if known


def seconds_of_week(
    day: FloatArray, second: FloatArray, scale: Scale = "GPST", *, week: float | None = None
) -> GpsTime:
    """Convert times to seconds since the start of a GPS week: the week of the first row, or a given `week`.

    `day`, `second` (n,): days since 6 January 1980 (first day of a GPS week), and seconds since the start of this day.
    """
    if not len(day):
        return GpsTime(day, None, week)
    leap = leap_seconds(day, second) if scale == "UTC" else np.zeros(len(day))
    if week is None:
        week = float(np.floor((day[0] + (second + leap)[0] / DAY) / WEEK_DAYS))
    note = Finding.of(Code.READ_TIME_GPS_WEEK, week=week, leap_s=leap[0] if scale == "UTC" else np.nan, scale=scale)
    return GpsTime((day - WEEK_DAYS * week) * DAY + second + leap, note, week)
