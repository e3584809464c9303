"""ArduPilot dataflash logs, binary and as text: IMU, GPS and its accuracy (GPA).

FMT messages in the log define the layout of each message kind. Messages have no checksum: a message is valid if another
begins at its end.

References
----------
ArduPilot: libraries/AP_Logger/LogStructure.h and README.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import ACCEL, FIX_TYPES, GYRO, MSL_PLACE, by_accuracy, fix_table, of_course
from insnav.input.formats.messages import as_records, gathered, joined, starts
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.types import FloatArray

name = "ArduPilot log"
suffixes = (".bin", ".log")

_SYNC = b"\xa3\x95"
_FMT = np.dtype(
    [("head", "S3"), ("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)
# format letter of a field -> type, and unit factor
_LETTERS: dict[str, tuple[str, float]] = {
    "b": ("i1", 1.0), "B": ("u1", 1.0), "M": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0),
    "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "c": ("<i2", 0.01),
    "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "n": ("S4", 1.0),
    "N": ("S16", 1.0), "Z": ("S64", 1.0), "a": ("S64", 1.0), "g": ("<f2", 1.0),
}  # fmt: skip
_WANTED = re.compile(r"IMU\d?|GPS\d?|GPA\d?")
_GYRO, _ACCEL = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")
_Columns = dict[str, FloatArray]


def recognise(source: Source) -> bool:
    return source.head.startswith(_SYNC + b"\x80") or re.match(rb"FMT, *128, *89, *FMT,", source.head) is not None


def read(source: Source) -> Mapping[str, Table]:
    messages = _binary(source) if source.head.startswith(_SYNC) else _text(source)
    tables = {}
    imus = _instances(messages, "IMU")
    for number, data in imus.items():
        if all(key in data for key in ("time", *_GYRO, *_ACCEL)):
            columns = {"time_s": data["time"]}
            columns |= {key: data[mine] for key, mine in zip(GYRO + ACCEL, _GYRO + _ACCEL, strict=True)}
            chosen = Finding.of(Code.READ_SOURCE, subject=f"IMU {number}", count=len(imus)) if len(imus) > 1 else None
            notes = [Finding.of(Code.READ_TIME_SINCE_START), chosen]
            tables["imu"] = column_table(source, columns, notes, row="IMU", axes="FRD")
            break
    accuracies = _instances(messages, "GPA")
    for number, data in _instances(messages, "GPS").items():
        if all(key in data for key in ("time", "Lat", "Lng", "Alt")):
            tables["gps"] = _fixes(source, data, accuracies.get(number, {}))
            break
    if not tables:
        raise InputError("format.ardupilot_no_data", where=source.name, found=tuple(sorted(messages)))
    return tables


def _instances(messages: Mapping[str, _Columns], kind: str) -> dict[int, _Columns]:
    """Return the messages of each sensor of a kind, by instance column, or by the names IMU, IMU2, IMU3 of old logs."""
    by_number: dict[int, _Columns] = {}
    for name, data in messages.items():
        if name.startswith(kind):
            number = int(name[len(kind) :] or 1) - 1
            instances = data.get("I", np.full(len(data["time"]), float(number)))
            for each in np.unique(instances[np.isfinite(instances)]).tolist():
                by_number.setdefault(int(each), {key: column[instances == each] for key, column in data.items()})
    return dict(sorted(by_number.items()))


def _binary(source: Source) -> dict[str, _Columns]:
    formats = as_records(gathered(source.data, starts(source.data, _SYNC + b"\x80"), _FMT.itemsize), _FMT)
    found = {}
    for each in formats:
        name, letters = each["name"].decode("latin-1"), each["format"].decode("latin-1")
        columns = each["columns"].decode("latin-1").split(",")
        if not _WANTED.fullmatch(name) or len(columns) != len(letters) or not set(letters) <= set(_LETTERS):
            continue
        if len(set(columns)) != len(columns) or not all(columns):
            continue
        layout = np.dtype([(column, _LETTERS[letter][0]) for column, letter in zip(columns, letters, strict=True)])
        size = int(each["length"])
        if layout.itemsize + 3 != size:
            continue
        rows = as_records(_whole(source, bytes([int(each["type"])]), size)[:, 3:], layout)
        numbers = [(c, _LETTERS[k][1]) for c, k in zip(columns, letters, strict=True) if k not in "nNZa"]
        if data := _scaled({column: rows[column] * unit for column, unit in numbers}):
            found[name] = data
    return found


def _whole(source: Source, kind: bytes, size: int) -> Any:
    """Select the messages ``(n, size)`` of a kind that are followed by another message or by the end of the file."""
    data = source.data
    positions = starts(data, _SYNC + kind)
    positions = positions[positions <= len(data) - size]
    stream = np.frombuffer(data, dtype=np.uint8)
    end = positions + size
    last = len(data) - 1
    follows = (stream[np.minimum(end, last)] == _SYNC[0]) & (stream[np.minimum(end + 1, last)] == _SYNC[1])
    return gathered(data, positions[follows | (end >= last)], size)


def _text(source: Source) -> dict[str, _Columns]:
    columns: dict[str, list[str]] = {}
    rows: dict[str, list[list[float]]] = {}
    for line in source.data[:].decode("latin-1").splitlines():
        words = [word.strip() for word in line.split(",")]
        if words[0] == "FMT" and len(words) > 5:
            columns[words[3]] = words[5:]
        elif _WANTED.fullmatch(words[0]) and len(words) - 1 == len(columns.get(words[0], ())):
            try:
                numbers = [float(word) for word in words[1:]]
            except ValueError:
                continue
            kept = rows.setdefault(words[0], [])
            if not kept or len(kept[0]) == len(numbers):  # a later FMT may change the number of columns
                kept.append(numbers)
    found = {key: _scaled(dict(zip(columns[key], np.array(v).T, strict=False))) for key, v in rows.items()}
    return {key: data for key, data in found.items() if data}


def _scaled(data: Mapping[str, Any]) -> _Columns:
    """Convert columns to numbers, with the time in seconds as ``time``."""
    columns = {key: np.asarray(column, dtype=np.float64) for key, column in data.items()}
    for key, unit in (("TimeUS", 1e-6), ("TimeMS", 1e-3)):
        if key in columns:
            columns["time"] = unit * columns[key]
    return columns if "time" in columns else {}


def _fixes(source: Source, data: _Columns, accuracy: _Columns) -> Table:
    columns = {
        "time_s": data["time"],
        **dict(zip(MSL_PLACE, (data[key] for key in ("Lat", "Lng", "Alt")), strict=True)),
    }
    if all(key in data for key in ("Spd", "GCrs", "VZ")):
        columns |= of_course(data["Spd"], data["GCrs"], data["VZ"])
    if all(key in accuracy for key in ("HAcc", "VAcc", "SAcc")):
        columns |= by_accuracy(
            *(joined(data["time"], accuracy["time"], accuracy[key]) for key in ("HAcc", "VAcc", "SAcc"))
        )
    kind = data.get("Status", np.full(len(data["time"]), 3.0))
    notes = [Finding.of(Code.READ_TIME_SINCE_START)]
    return fix_table(source, columns, kind, FIX_TYPES, notes, row="GPS messages")
