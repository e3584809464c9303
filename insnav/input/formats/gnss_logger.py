"""Android GnssLogger files: ``Fix`` lines, and ``UncalAccel``, ``UncalGyro`` (``Accel``, ``Gyro``) if present.

Also ``device_imu.csv`` of the Google Smartphone Decimeter Challenge: its first line names the columns of all messages.

References
----------
google/gps-measurement-tools, GnssLogger: header lines ``# Fix,…`` name the columns of each version.
Kaggle, "Google Smartphone Decimeter Challenge 2022", data description.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import ACCEL, GYRO, number_in, up_or_down, with_force
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray

name = "Android GnssLogger file"

_HEADER = re.compile(rb"^#[ \t]*(Fix|UncalAccel|UncalGyro|Accel|Gyro),(.*?)[ \t]*\r?$", re.M)
_MESSAGES = re.compile(rb"\A(?:\xef\xbb\xbf)?MessageType,(utcTimeMillis,[^\r\n]*MeasurementX,.*?)[ \t]*\r?$", re.M)
_LINE = re.compile(rb"^(Fix|UncalAccel|UncalGyro|Accel|Gyro),(.*?)\r?$", re.M)
# column -> its names in all versions of the file
_FIX = {
    "lat_deg": ("LatitudeDegrees", "Latitude"),
    "lon_deg": ("LongitudeDegrees", "Longitude"),
    "height_m": ("AltitudeMeters", "Altitude"),
    "speed_m_s": ("SpeedMps", "Speed"),
    "course_deg": ("BearingDegrees", "Bearing"),
    "accuracy_m": ("AccuracyMeters", "Accuracy"),
    "time_ms": ("UnixTimeMillis", "(UTC)TimeInMs"),
    "accuracy_speed_m_s": ("SpeedAccuracyMps",),
    "accuracy_course_deg": ("BearingAccuracyDegrees",),
    "accuracy_d_m": ("VerticalAccuracyMeters",),
}
_SENSORS = {
    "accel": (("UncalAccel", "UncalAccel{}Mps2"), ("Accel", "Accel{}Mps2"), ("UncalAccel", "Measurement{}")),
    "gyro": (("UncalGyro", "UncalGyro{}RadPerSec"), ("Gyro", "Gyro{}RadPerSec"), ("UncalGyro", "Measurement{}")),
}
_TIMES = ("utcTimeMillis", "UtcTimeMillis", "UnixTimeMillis")


def recognise(source: Source) -> bool:
    return bool(re.search(rb"^#[ \t]*Fix,Provider,", source.head, re.M) or _MESSAGES.match(source.head))


def read(source: Source) -> Mapping[str, Table]:
    columns = {
        kind.decode(): [name.strip() for name in names.decode("latin-1").split(",")]
        for kind, names in _HEADER.findall(source.head)
        or [(kind, names) for names in _MESSAGES.findall(source.head) for kind in (b"UncalAccel", b"UncalGyro")]
    }
    lines: dict[str, list[list[str]]] = {}
    for kind, words in _LINE.findall(source.data):
        lines.setdefault(kind.decode(), []).append(words.decode("latin-1").split(","))
    tables = {}
    samples = {key: _sensor(columns, lines, of_kind) for key, of_kind in _SENSORS.items()}
    gyro, accel = samples["gyro"], samples["accel"]
    if gyro is not None and accel is not None:
        found = {"time_s": gyro[:, 0], **{key: gyro[:, i + 1] for i, key in enumerate(GYRO)}}
        found = with_force(found, accel[:, 0], accel[:, 1:])
        notes = [Finding.of(Code.READ_TIME_UNIX), Finding.of(Code.READ_IMU_INTERPOLATED)]
        axes = up_or_down(found[ACCEL[2]], "RFU", "RBD")
        tables["imu"] = column_table(source, found, notes, row="UncalGyro", axes=axes)
    if lines.get("Fix"):
        tables["gps"] = _fixes(source, columns.get("Fix", []), lines["Fix"])
    if not tables:
        raise InputError("format.gnss_logger_no_fixes", where=source.name, found=tuple(lines))
    return tables


def _numbers(rows: list[list[str]], index: int) -> FloatArray:
    return np.array([number_in(row[index]) if index < len(row) else np.nan for row in rows])


def _sensor(
    columns: Mapping[str, list[str]], lines: Mapping[str, list[list[str]]], kinds: tuple[tuple[str, str], ...]
) -> FloatArray | None:
    """Read time [s] and values along x, y, z of a sensor ``(n, 4)``; None if the file lacks the sensor."""
    for kind, template in kinds:
        names = columns.get(kind, [])
        wanted = [template.format(axis) for axis in "XYZ"]
        time = next((name for name in _TIMES if name in names), "")
        if time and all(name in names for name in wanted) and kind in lines:
            found = np.column_stack([_numbers(lines[kind], names.index(name)) for name in (time, *wanted)])
            found = found[np.isfinite(found).all(axis=1)]
            if len(found):
                return found * [1e-3, 1.0, 1.0, 1.0]
    return None


def _fixes(source: Source, names: list[str], rows: list[list[str]]) -> Table:
    found = {
        key: _numbers(rows, names.index(name)) for key, spellings in _FIX.items() for name in spellings if name in names
    }
    if "time_ms" not in found:
        raise InputError("format.gnss_logger_no_time", where=source.name, columns=tuple(names))
    providers = [row[0].strip().lower() for row in rows]
    best = next((provider for provider in ("gps", "flp", "fused") if provider in providers), providers[0])
    of_best = np.array([provider == best for provider in providers]) & np.isfinite(found["time_ms"])
    found = {key: column[of_best] for key, column in found.items()}
    columns = {"time_s": 1e-3 * found.pop("time_ms"), **found}
    chosen = Finding.of(Code.READ_SOURCE, subject=plain_text(best), count=len(set(providers)))
    return column_table(source, columns, [Finding.of(Code.READ_TIME_UNIX), chosen], row="Fix")
