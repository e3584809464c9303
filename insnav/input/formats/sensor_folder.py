"""Folders and archives with one text file per sensor, joined by time: phones, cameras and simulators.

Supported: phyphox, Sensor Logger, GoPro telemetry as CSV, and gnss-ins-sim with separate time files. The axes of a
phone are Right, Forward, Up if the phone lies on its back with its top forward.

References
----------
phyphox.org, "Exporting data"; Sensor Logger (github.com/tszheichoi/awesome-sensor-logger), "Cross-platform data
recording format"; github.com/JuanIrache/gopro-telemetry; github.com/Aceinna/gnss-ins-sim, "Simulation results".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.conventions import ACCEL, GYRO, up_or_down
from insnav.input.formats.messages import at_times
from insnav.input.formats.source import Source, digest_of
from insnav.input.formats.table import ArrayCells, Numbers, Table
from insnav.input.interpret.columns import Found, understand
from insnav.input.interpret.schema import IMU_SCHEMA
from insnav.plain_text import plain_text
from insnav.types import FloatArray

name = "folder of sensors"

# kind of data -> patterns of lower-case letters in the file name, the best first
_KINDS = {
    "gyro": ("gyroscope", "gyroscopeuncalibrated", "(?!ref).*gyr.*"),
    "accel": (
        "totalacceleration",
        "accelerometeruncalibrated",
        "accelerometer",
        "acceleration",
        "(?!ref|.*lin).*acc.*",
    ),
    "linear": ("linearaccelerometer", "linearacceleration"),
    "gravity": ("gravity",),
    "gps": ("location", "locationgps", "locations", "gpslocation.*", ".*gps"),
    "reference": ("refpos",),
    "time": ("time", "gpstime"),
}
_PLAIN = {"gyro": GYRO, "accel": ACCEL, "linear": ACCEL, "gravity": ACCEL}  # canonical names of columns x, y, z
_NATIVE = "seconds_elapsed"  # time of Sensor Logger, whose accelerometer file excludes gravity
_AXIS = re.compile(r"([xyz])( *[\[(].*)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _File:
    """File of the folder."""

    source: Source
    table: Table
    found: Mapping[str, Found]  # its columns by key, such as ``gyro_x``
    numbers: Numbers  # values of these columns

    def column(self, key: str) -> FloatArray:
        """Return values ``(n,)`` of a column, as in the file."""
        return self.numbers.columns[self.found[key].index]


def recognise(source: Source) -> bool:
    kinds = _paths(source)
    whole = "gyro" in kinds and bool({"accel", "linear"} & kinds.keys())
    return whole or _stem(kinds.get("gps", "")) in _KINDS["gps"][:2]  # not gps.csv: any folder may have it


def read(source: Source) -> Mapping[str, Table]:
    paths = _paths(source)
    times = [_open(source, path, "time") for path in paths.values() if _stem(path) in _KINDS["time"]]
    times += [_open(source, path, "time") for path in source.members if _stem(path) == "gpstime"]
    files = {kind: _open(source, path, kind) for kind, path in paths.items() if kind != "time"}
    tables: dict[str, Table] = {
        part: _with_times(files[part], times).table for part in ("gps", "reference") if part in files
    }
    if "accel" in files and _stem(paths["accel"]) == "accelerometer" and _NATIVE in files["accel"].table.headers:
        files["linear"] = files.pop("accel")
    if "linear" in files and "accel" not in files and "gravity" not in files:
        raise InputError("format.phone_no_gravity", where=files["linear"].source.name)
    force = files.get("accel", files.get("linear"))
    if force is not None and "gyro" in files:
        gravity = files["gravity"] if "accel" not in files else None
        used = [_with_times(file, times) for file in (files["gyro"], force, gravity) if file is not None]
        tables["imu"] = _samples(source, *used)
    if not tables:
        names = plain_text(", ".join(sorted(source.members)))[:200]
        raise InputError("format.phone_incomplete", where=source.name, files=names)
    return tables


def _stem(path: str) -> str:
    """Return the lower-case letters of a file name, without endings and run number."""
    return re.sub("[^a-z]", "", PurePosixPath(path).name.lower().split(".")[0])


def _paths(source: Source) -> dict[str, str]:
    """Find the best file of each kind of data by its name."""
    candidates = sorted(path for path in source.members if path.lower().endswith((".csv", ".txt", ".mat")))
    best: dict[str, str] = {}
    for kind, patterns in _KINDS.items():
        ranked = [path for pattern in patterns for path in candidates if re.fullmatch(pattern, _stem(path))]
        best |= {kind: ranked[0]} if ranked else {}
    return best


def _open(source: Source, path: str, kind: str) -> _File:
    """Open a file; its name determines the sensor of columns x, y, z."""
    from insnav.input.interpret.composed import composed  # imported here, as it imports formats itself

    file = source.members[path]()
    table = composed(delimited_text.read(file)[""])
    known = _NATIVE in table.headers  # units are known, since Sensor Logger defines them
    headers = ("time", *"xyz") if table.headers == ("1", "2", "3", "4") else table.headers  # imu_tk: no header
    headers = tuple(_named(header, kind, known) for header in headers) if kind in _PLAIN else table.headers
    table = replace(table, headers=headers, format=name)
    found, _ = understand(headers, table.units, IMU_SCHEMA, where=file.name)
    wanted = ("time", *(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"))
    present = {key: found[key] for key in wanted if key in found}
    if kind in _PLAIN and len(present) < 3 + ("time" in present):
        raise InputError("format.phone_no_axes", where=file.name, columns=table.headers)
    return _File(file, table, present, table.cells.read([column.index for column in present.values()]))


def _named(header: str, kind: str, known: bool) -> str:
    """Return the canonical header of a sensor axis, with the unit if it is known; other headers are unchanged."""
    if (axis := _AXIS.fullmatch(header)) is None:
        return header
    plain = _PLAIN[kind]["xyz".index(axis[1].lower())]
    return plain if known and not axis[2] else f"{plain[: plain.index('_') + 2]}{axis[2] or ''}"


def _with_times(file: _File, times: Sequence[_File]) -> _File:
    """Add a time column from a separate file of equal length to a file without times."""
    if "time" in file.found or not times:
        return file
    table, stem = file.table, _stem(file.source.name)
    numbers = table.cells.read(range(len(table.headers)))
    equal_length = [file for file in times if file.numbers.n_rows == numbers.n_rows]
    if not equal_length:
        raise InputError("format.phone_no_time", where=file.source.name, columns=table.headers)
    clock = max(equal_length, key=lambda each: stem.startswith("gps") == _stem(each.source.name).startswith("gps"))
    columns = (*(numbers.columns[i] for i in range(len(table.headers))), clock.column("time"))
    time = Found(clock.found["time"].quantity, len(table.headers), clock.found["time"].header, clock.found["time"].unit)
    table = replace(table, headers=(*table.headers, time.header), cells=ArrayCells(columns, table.cells.line))
    found = {**file.found, "time": time}
    return _File(file.source, table, found, table.cells.read([column.index for column in found.values()]))


def _samples(source: Source, gyro: _File, force: _File, *gravity: _File) -> Table:
    """Interpolate accelerations at the times of the gyros; a separate file of gravity is added to the accelerations."""
    time, files = gyro.column("time"), (gyro, force, *gravity)
    keys = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    forces = np.sum(
        [[at_times(time, file.column("time"), file.column(k)) for k in keys[3:]] for file in files[1:]], axis=0
    )
    inside = np.isfinite(np.sum(forces, axis=0))
    columns = [values[inside] for values in (time, *map(gyro.column, keys[:3]), *forces)]
    headers = (gyro.found["time"].header, *(gyro.found[key].header for key in keys[:3]))
    headers += tuple(force.found[key].header for key in keys[3:])
    notes = [*gyro.table.notes, Finding.of(Code.READ_IMU_INTERPOLATED)]
    notes += [Finding.of(Code.READ_IMU_GRAVITY_ADDED)] * len(gravity)
    phone = _stem(gyro.source.name) in _KINDS["gyro"][:2] and all(gyro.found[key].unit for key in keys[:3])
    cells = ArrayCells(tuple(columns), lambda row: f"row {row + 1}", gyro.numbers.cut or force.numbers.cut)
    return Table(
        source.name,
        digest_of([file.source for file in files]),
        headers,
        cells,
        notes=tuple(notes),
        axes=up_or_down(columns[-1], "RFU", "RBD") if phone else "",
    )
