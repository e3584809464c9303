"""GPX tracks: points with times.

References
----------
GPX 1.1 Schema Documentation, topografix.com/GPX/1/1. It defines no height datum; receivers write mean sea level.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import number_in
from insnav.input.formats.source import Source, decoded
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import seconds_of_week, unix_days

name = "GPX track"
suffixes = (".gpx",)

_POINT = re.compile(
    rb"<(?:\w+:)?trkpt\b([^>]*?)(?:/>|>(.*?)</(?:\w+:)?trkpt>)", re.S
)  # a regular expression: xml.etree would need twice the memory
_NUMBER = rb"""\s*=\s*["']\s*([-+0-9.eE]+)\s*["']"""
_LAT, _LON = re.compile(rb"\blat" + _NUMBER), re.compile(rb"\blon" + _NUMBER)
_ELEVATION = re.compile(rb"<(?:\w+:)?ele>\s*([-+0-9.eE]+)\s*<")
_TIME = re.compile(rb"<(?:\w+:)?time>\s*(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?)\s*(Z|[-+]\d\d:?\d\d)?\s*<")


def recognise(source: Source) -> bool:
    return re.search(rb"<(?:\w+:)?gpx[\s>]", bytes(decoded(source.head))[:4096]) is not None


def read(source: Source) -> Mapping[str, Table]:
    rows: list[tuple[int, float, float, float]] = []
    total = 0
    for point in _POINT.finditer(bytes(decoded(source.data)[:])):
        total += 1
        instant = _instant(point[2] or b"")
        if instant is not None:
            rows.append((instant, _number(_LAT, point[1]), _number(_LON, point[1]), _number(_ELEVATION, point[2])))
    if not rows:
        raise InputError("format.gpx_no_times", where=source.name, count=total)
    nanoseconds = np.array([row[0] for row in rows], dtype=np.int64)
    time, note, week = seconds_of_week(*unix_days(nanoseconds), "UTC")
    lat, lon, height = (np.array(column) for column in list(zip(*rows, strict=True))[1:])
    notes = [note]
    if len(rows) < total:
        notes.append(Finding.of(Code.READ_ROWS_NO_TIME, count=total - len(rows), rows=total))
    columns = {"time_s": time, "lat_deg": lat, "lon_deg": lon, "height_msl_m": height}
    return {"gps": column_table(source, columns, notes, row="point", week=week)}


def _number(pattern: re.Pattern[bytes], text: bytes) -> float:
    match = pattern.search(text)
    return number_in(match[1]) if match else float("nan")


def _instant(text: bytes) -> int | None:
    """Parse a time of a point as Unix time [ns]; None if it is missing or invalid."""
    match = _TIME.search(text)
    if match is None:
        return None
    try:
        instant = int(np.datetime64(match[1].decode(), "ns").astype(np.int64))
    except ValueError:
        return None
    zone = (match[2] or b"Z").replace(b":", b"")
    if zone == b"Z":
        return instant
    minutes = 60 * int(zone[1:3]) + int(zone[3:5])
    return instant - (1 if zone[:1] == b"+" else -1) * minutes * 60_000_000_000
