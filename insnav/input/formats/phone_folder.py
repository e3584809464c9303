"""Phones: folders or archives with one text file a sensor, as phyphox and Sensor Logger export them.

Axes of a phone are Right, Forward, Up when it lies on its back with its top to the front.

References
----------
phyphox.org, "Exporting data"; Sensor Logger (github.com/tszheichoi/awesome-sensor-logger), "Cross-platform data
recording format".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.conventions import (
    ACCEL,
    GYRO,
    TextColumns,
    text_columns,
    up_or_down,
    with_force,
)
from insnav.input.formats.messages import at_times
from insnav.input.formats.source import Source, digest_of
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray

name = "phone recording"

_AXES = ("x", "y", "z")
# files by what they hold, the most useful first; in small letters without blanks
_WITH_GRAVITY = ("totalacceleration", "accelerometeruncalibrated", "accelerometer", "acceleration")
_WITHOUT_GRAVITY = ("linearaccelerometer", "linearacceleration")
_GYROS = ("gyroscope", "gyroscopeuncalibrated", "gyro")
_LOCATIONS = ("location", "locationgps", "gps")
_TIMES = ("time", "Time (s)", "seconds_elapsed")
# new name -> headers of Sensor Logger, of phyphox
_LOCATION = {
    "lat_deg": ("latitude", "Latitude (°)"),
    "lon_deg": ("longitude", "Longitude (°)"),
    "height_m": ("altitude", "Height (m)", "Altitude (m)"),
    "speed_m_s": ("speed", "Velocity (m/s)", "Speed (m/s)"),
    "course_deg": ("bearing", "Direction (°)"),
    "accuracy_m": ("horizontalAccuracy", "Horizontal Accuracy (m)"),
    "accuracy_d_m": ("verticalAccuracy", "Vertical Accuracy (m)", "Vertical Accuracy (°)"),  # in metres, too
    "accuracy_speed_m_s": ("speedAccuracy",),
    "accuracy_course_deg": ("bearingAccuracy",),
}
_VECTORS = ("{}", "{} (m/s^2)", "{} (rad/s)", "Acceleration {} (m/s^2)", "Gyroscope {} (rad/s)")
_HEADERS = (*_TIMES, *(each for headers in _LOCATION.values() for each in headers))
_HEADERS += tuple(template.format(axis) for template in _VECTORS for axis in _AXES)
_NANOSECONDS = 1e15  # times beyond are Unix time in nanoseconds


@dataclass(frozen=True, slots=True)
class _File:
    """A file of the folder."""

    source: Source
    text: TextColumns
    time: FloatArray  # (n,) [s]

    @property
    def native(self) -> bool:
        """Whether it is of Sensor Logger."""
        return "seconds_elapsed" in self.text.headers


def recognise(source: Source) -> bool:
    sensors = [_path(source, names) is not None for names in (_GYROS, (*_WITH_GRAVITY, *_WITHOUT_GRAVITY))]
    return all(sensors) or _path(source, _LOCATIONS[:2]) is not None  # a file gps.csv may be of any folder


def read(source: Source) -> Mapping[str, Table]:
    files = {
        key: _open(source, path)
        for key, names in (("gyro", _GYROS), ("location", _LOCATIONS), ("linear", _WITHOUT_GRAVITY))
        if (path := _path(source, names)) is not None
    }
    force, gravity = _force(source, files.get("linear"))
    tables = {}
    if force is not None and "gyro" in files:
        tables["imu"] = _samples(source, files["gyro"], force, gravity)
    if "location" in files:
        tables["gps"] = _fixes(source, files["location"])
    if not tables:
        names = plain_text(", ".join(sorted(source.members)))[:200]
        raise InputError("format.phone_incomplete", where=source.name, files=names)
    return tables


def _path(source: Source, names: tuple[str, ...]) -> str | None:
    there = {path.rsplit("/", 1)[-1].lower().replace(" ", "").replace("_", ""): path for path in source.members}
    return next((there[f"{each}.csv"] for each in names if f"{each}.csv" in there), None)


def _open(source: Source, path: str) -> _File:
    file = source.members[path]()
    text = text_columns(delimited_text.read(file)[""], _HEADERS)
    time = next((text.columns[each.lower()] for each in _TIMES if each.lower() in text.columns), None)
    if time is None or not len(time):
        raise InputError("format.phone_no_time", where=file.name, columns=text.headers)
    large = float(np.nanmax(time, initial=0.0)) > _NANOSECONDS
    return _File(file, text, time * (1e-9 if large else 1.0))


def _vector(file: _File) -> FloatArray:
    """Values along x, y, z, (n, 3)."""
    for template in _VECTORS:
        found = file.text.named({axis: template.format(axis) for axis in _AXES})
        if len(found) == 3:
            return np.column_stack([found[axis] for axis in _AXES])
    raise InputError("format.phone_no_axes", where=file.source.name, columns=file.text.headers)


def _force(source: Source, linear: _File | None) -> tuple[_File | None, str]:
    """File with the accelerometer, gravity included, or that of the motion beside which gravity has its own."""
    for each in _WITH_GRAVITY:
        path = _path(source, (each,))
        if path is None:
            continue
        file = _open(source, path)
        if each == "accelerometer" and file.native:  # that of Sensor Logger has none
            linear = file
            continue
        return file, ""
    if linear is None:
        return None, ""
    gravity = _path(source, ("gravity",))
    if gravity is not None:
        return linear, gravity
    raise InputError("format.phone_no_gravity", where=linear.source.name)


def _samples(source: Source, gyro: _File, force: _File, gravity_path: str) -> Table:
    """Samples at the times of the gyros."""
    notes = [Finding.of(Code.READ_IMU_INTERPOLATED)]
    values, used = _vector(force), [gyro.source, force.source]
    if gravity_path:
        gravity = _open(source, gravity_path)
        used.append(gravity.source)
        notes.append(Finding.of(Code.READ_IMU_GRAVITY_ADDED))
        part = _vector(gravity)
        values = values + np.column_stack([at_times(force.time, gravity.time, part[:, i]) for i in range(3)])
    rates = _vector(gyro)
    columns = {"time_s": gyro.time, **dict(zip(GYRO, rates.T, strict=True))}
    columns = with_force(columns, force.time, values)
    whole = Source(source.name, digest_of(used))
    axes = up_or_down(columns[ACCEL[2]], "RFU", "RBD")
    return column_table(whole, columns, notes, cut=gyro.text.cut or force.text.cut, axes=axes)


def _fixes(source: Source, file: _File) -> Table:
    found: dict[str, FloatArray] = {}
    for key, headers in _LOCATION.items():
        for header in headers:
            if column := file.text.named({key: header}):
                found |= column
                break
    return column_table(Source(source.name, file.source.sha256), {"time_s": file.time, **found}, cut=file.text.cut)
