"""PX4 ULog files: ``sensor_combined``, and ``vehicle_gps_position`` or ``sensor_gps``.

References
----------
PX4 User Guide, "ULog file format"; msg/SensorCombined.msg, msg/SensorGps.msg.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import ACCEL, FIX_TYPES, GYRO, by_accuracy, fix_table
from insnav.input.formats.messages import as_records, gathered
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray

name = "PX4 ULog"
suffixes = (".ulg",)

_GPS = ("vehicle_gps_position", "sensor_gps")
# column -> names of the field with unit factors, newer names first
_PLACE = {
    "lat_deg": (("latitude_deg", 1.0), ("lat", 1e-7)),
    "lon_deg": (("longitude_deg", 1.0), ("lon", 1e-7)),
    "height_m": (("altitude_ellipsoid_m", 1.0), ("alt_ellipsoid", 1e-3)),
    "height_msl_m": (("altitude_msl_m", 1.0), ("alt", 1e-3)),
}
_SAMPLES = {
    "time_s": "timestamp",
    **{key: f"gyro_rad[{i}]" for i, key in enumerate(GYRO)},
    **{key: f"accelerometer_m_s2[{i}]" for i, key in enumerate(ACCEL)},
}
_NEEDED = ("timestamp", "fix_type", "eph", "epv", "s_variance_m_s", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
_DATA, _FORMAT, _SUBSCRIBE, _DROPOUT = b"DFAO"
_KINDS = frozenset(b"BFIMPQACLRDSO")
_SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"  # message from which reading continues after damage
_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "bool": "u1", "char": "S1", "int16_t": "<i2", "uint16_t": "<u2",
    "int32_t": "<i4", "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8",
}  # fmt: skip


def recognise(source: Source) -> bool:
    return source.head.startswith(b"ULog\x01\x12\x35")


def read(source: Source) -> Mapping[str, Table]:
    log = _Log()
    notes = [Finding.of(Code.READ_TIME_SINCE_START), *log.walk(source.data)]
    fields = {key: data for key, layout in log.topics() if (data := log.columns(source.data, key, layout))}
    tables: dict[str, Table] = {}
    data = next((data for (topic, _), data in sorted(fields.items()) if topic == "sensor_combined"), {})
    if all(key in data for key in _SAMPLES.values()):
        columns = {key: data[field] * (1e-6 if key == "time_s" else 1.0) for key, field in _SAMPLES.items()}
        tables["imu"] = column_table(source, columns, notes, row="sensor_combined", axes="FRD")
    receivers = [(topic, number) for topic in _GPS for name, number in sorted(fields) if name == topic]
    receivers = [entry for entry in receivers if all(key in fields[entry] for key in _NEEDED)]
    if receivers:
        if receivers[1:]:
            topic, number = receivers[0]
            notes.append(Finding.of(Code.READ_SOURCE, subject=f"{topic}[{number}]", count=len(receivers)))
        tables["gps"] = _fixes(source, fields[receivers[0]], notes)
    if not tables:
        topics = tuple(map(plain_text, sorted(set(log.names()))[:12]))
        raise InputError("format.ulog_no_data", where=source.name, found=topics)
    return tables


@dataclass(slots=True)
class _Log:
    """Index of the messages of each topic."""

    formats: dict[str, str] = field(default_factory=dict)  # layout text of the fields, by message name
    subscribed: dict[int, tuple[str, int]] = field(default_factory=dict)  # name and instance, by subscription number
    at: dict[int, list[int]] = field(default_factory=dict)  # positions of the messages, by subscription number

    def walk(self, data: bytes | mmap.mmap) -> list[Finding]:
        """Index all messages of a file; return findings on damage and gaps."""
        start, end, lost = 16, len(data), 0
        dropouts: list[int] = []
        while start + 3 <= end:
            size, kind = data[start] + 256 * data[start + 1], data[start + 2]
            next_start = start + 3 + size
            if kind not in _KINDS or next_start > end:
                sync = data.find(_SYNC, start + 1)
                lost += (sync if sync >= 0 else end) - start
                if sync < 0:
                    break
                start = sync
                continue
            if kind == _DATA:
                self.at.setdefault(data[start + 3] + 256 * data[start + 4], []).append(start + 5)
            elif kind == _FORMAT:
                name, _, fields = data[start + 3 : next_start].decode("latin-1").partition(":")
                self.formats[name] = fields
            elif kind == _SUBSCRIBE and size > 3:
                number = data[start + 4] + 256 * data[start + 5]
                self.subscribed[number] = (data[start + 6 : next_start].decode("latin-1"), data[start + 3])
            elif kind == _DROPOUT and size >= 2:
                dropouts.append(data[start + 3] + 256 * data[start + 4])
            start = next_start
        notes = [Finding.of(Code.READ_BYTES_DAMAGED, count=lost)] if lost else []
        if dropouts:
            notes.append(Finding.of(Code.READ_LOGGER_GAPS, count=len(dropouts), gap_s=1e-3 * sum(dropouts)))
        return notes

    def names(self) -> list[str]:
        return [name for name, _ in self.subscribed.values()]

    def topics(self) -> list[tuple[tuple[str, int], np.dtype[Any]]]:
        """Return the supported topics with their layouts."""
        wanted = [topic for topic in self.subscribed.values() if topic[0] in ("sensor_combined", *_GPS)]
        layouts = [(topic, _layout(self.formats.get(topic[0], ""))) for topic in wanted]
        return [(topic, layout) for topic, layout in layouts if layout is not None]

    def columns(self, data: bytes | mmap.mmap, topic: tuple[str, int], layout: np.dtype[Any]) -> dict[str, FloatArray]:
        """Read the numeric fields of a topic by name, (n,)."""
        numbers = [number for number, each in self.subscribed.items() if each == topic]
        at = np.array([place for number in numbers for place in self.at.get(number, [])], dtype=np.int64)
        rows = as_records(gathered(data, at, layout.itemsize), layout)
        names = layout.names or ()
        with np.errstate(invalid="ignore"):  # damaged messages may contain invalid numbers
            kept = [key for key in names if len(rows) and rows[key].dtype.kind != "S"]
            return {key: rows[key].astype(np.float64) for key in kept}


def _layout(fields: str) -> np.dtype[Any] | None:
    """Build the layout of a message, without trailing padding; None if nested or damaged."""
    parts: list[tuple[str, str]] = []
    for part in filter(None, fields.split(";")):
        kind, _, name = part.partition(" ")
        match = re.fullmatch(r"(\w+?)(?:\[(\d{1,4})\])?", kind)
        if match is None or match[1] not in _TYPES:
            return None
        if name.startswith("_padding"):
            continue
        count = match[2]
        names = [name] if count is None else [f"{name}[{i}]" for i in range(int(count))]
        parts += [(name, _TYPES[match[1]]) for name in names]
    unique = len({name for name, _ in parts}) == len(parts)
    return np.dtype(parts) if parts and unique and all(name for name, _ in parts) else None


def _fixes(source: Source, data: Mapping[str, FloatArray], notes: list[Finding]) -> Table:
    columns = {"time_s": 1e-6 * data.get("timestamp_sample", data["timestamp"])}
    if not (columns["time_s"] > 0.0).all():  # early drivers leave the field timestamp_sample zero
        columns["time_s"] = 1e-6 * data["timestamp"]
    for key, names in _PLACE.items():
        values = next((factor * data[name] for name, factor in names if name in data), None)
        if values is not None:
            columns[key] = values
    if "height_m" in columns and not columns["height_m"].any():  # some drivers leave the ellipsoidal height zero
        del columns["height_m"]
    elif "height_m" in columns:
        columns.pop("height_msl_m", None)
    columns |= {f"v{axis}_m_s": data[f"vel_{axis}_m_s"] for axis in "ned"}
    columns |= by_accuracy(data["eph"], data["epv"], data["s_variance_m_s"])
    kind = np.where(data.get("vel_ned_valid", 1.0) > 0.0, data["fix_type"], np.nan)
    return fix_table(source, columns, kind, FIX_TYPES, notes, row="messages")
