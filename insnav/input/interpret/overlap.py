"""Check of two recordings for common time, and diagnosis of their clocks if they have none."""

from __future__ import annotations

from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.time_scales import DAY, UNIX_DAYS, WEEK
from insnav.types import GpsData, ImuData

GPS_EPOCH = UNIX_DAYS * DAY  # Unix time of 6 January 1980, the epoch of GPS time [s]
HOUR, ZONE = 3600.0, 1800.0  # time zones differ by multiples of half an hour [s]
LEAP = 18.0  # GPS minus UTC since 2017 [s]
_MAX_OFFSET = 4e9  # largest offset between clocks that count seconds [s]
_MIN_SHARE = 0.5  # share of the shorter recording that must overlap with a likely offset


def check_overlap(imu: ImuData, gps: GpsData) -> None:
    """Refuse files without common time, with a likely clock offset. Raises: InputError: no fix within the samples."""
    first, last = float(imu.time[0]), float(imu.time[-1])
    if np.any((gps.time >= first) & (gps.time <= last)):
        return
    start, end = _spans(imu, gps)[1]
    offset, reason = likely_offset((first, last), (start, end))
    spans: dict[str, Any] = {"imu_begin_s": first, "imu_end_s": last, "gps_begin_s": start, "gps_end_s": end}
    if reason and offset is None:
        raise InputError("columns.clock_unit", **spans, **reason)
    interval = float(np.median(np.diff(gps.time))) if len(gps.time) > 1 else 0.0
    if last - first < interval:  # the IMU record is shorter than the interval of fixes
        raise InputError("columns.short_record", length_s=last - first, interval_s=interval)
    if offset is not None:
        raise InputError("columns.clock_offset", gives={"time_offset": offset}, offset_s=offset, **spans, **reason)
    if min(abs(first), abs(start)) < DAY and abs(first - start) > 1.0:
        raise InputError("columns.clock_restarted", offset_s=start - first, **spans)
    raise InputError("columns.no_overlap", **spans)


def overlap(imu: ImuData, gps: GpsData) -> float:
    """Compute the common time of two recordings [s], zero if they do not overlap."""
    (first, last), (start, end) = _spans(imu, gps)
    return max(0.0, min(last, end) - max(first, start))


def epoch_offset(imu: ImuData, gps: GpsData) -> float | None:
    """Return the clock offset [s] if one file has Unix time, the other GPS time, and they then overlap; else None.

    An offset of days or weeks is not returned: the files may belong to different recordings.
    """
    offset, _ = likely_offset(*_spans(imu, gps))
    return None if offset is None or abs(offset) < 0.9 * GPS_EPOCH else offset


def named_offset(offset: float, sd: float) -> tuple[float, dict[str, Any]]:
    """Decompose a clock offset [s] into leap seconds, time zone and days, if it agrees within its sd.

    Time zones differ from UTC by half hours, with three small exceptions.
    Returns: the offset; its parts as values of an error: ``days_s`` or ``zone_s``, and ``leap_s``.
    """
    for leap in (0.0, LEAP, -LEAP):
        zone = ZONE * round((offset - leap) / ZONE)
        whole = zone % DAY == 0.0  # also for 86399.998 s, which rounds to a day
        agrees = abs(offset - leap - zone) < np.clip(3.0 * sd, 0.1, 1.0)
        if agrees and (zone or leap) and (whole or abs(zone) <= 14 * HOUR):
            return zone + leap, {"days_s" if whole else "zone_s": zone or None, "leap_s": leap or None}
    return round(offset, 3), {}


def _spans(imu: ImuData, gps: GpsData) -> tuple[tuple[float, float], tuple[float, float]]:
    return (float(imu.time[0]), float(imu.time[-1])), (float(gps.time[0]), float(gps.time[-1]))


def likely_offset(imu: tuple[float, float], gps: tuple[float, float]) -> tuple[float | None, dict[str, Any]]:
    """Find a known clock offset, such as leap seconds, with which two time spans (first, last) [s] overlap.

    Returns: offset to add to IMU times, or None; values of the error, such as a time unit that explains the spans.
    """
    difference = 0.5 * (sum(gps) - sum(imu))
    for leap in (LEAP, -LEAP):
        if _share(imu, gps, leap):
            return leap, {"leap_s": leap}
    for factor, unit in ((1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")):
        if _same_span((imu[0] * factor, imu[1] * factor), gps):
            return None, {"clock": "imu", "unit": unit}
        if _same_span(imu, (gps[0] * factor, gps[1] * factor)):
            return None, {"clock": "gps", "unit": unit}
    if abs(difference) > _MAX_OFFSET:
        return None, {}
    for base, unix in ((GPS_EPOCH - LEAP, "gps"), (LEAP - GPS_EPOCH, "imu")):
        # One clock is Unix time; the other is GPS time since 1980, or seconds of a GPS week, whose number is `weeks`.
        if abs(difference) > 0.9 * GPS_EPOCH and np.sign(difference) == np.sign(base):
            weeks = round((difference - base) / WEEK)
            offset = base + weeks * WEEK
            if _share(imu, gps, offset):
                return offset, {"unix": unix, "weeks": weeks or None, "leap_s": np.sign(-base) * LEAP}
    for period, name in ((WEEK, "weeks"), (DAY, "days")):
        count = round(difference / period)
        for leap in (0.0, LEAP, -LEAP):
            offset = count * period + leap
            if count and _share(imu, gps, offset):
                return offset, {name: count, "leap_s": leap or None}
    return None, {}


def _share(imu: tuple[float, float], gps: tuple[float, float], offset: float) -> bool:
    """Return True if enough of the shorter span overlaps after the offset [s] is added to IMU times."""
    common = min(imu[1] + offset, gps[1]) - max(imu[0] + offset, gps[0])
    return common > 0.0 and common >= _MIN_SHARE * min(imu[1] - imu[0], gps[1] - gps[0])


def _same_span(imu: tuple[float, float], gps: tuple[float, float]) -> bool:
    """Return True if two time spans overlap, and one is at most ten times longer."""
    lengths = sorted((imu[1] - imu[0], gps[1] - gps[0]))
    return _share(imu, gps, 0.0) and lengths[0] > 0.1 * lengths[1]
