"""NovAtel OEM logs, binary and ASCII: BESTPOS and BESTVEL (those of GNSS alone first), RAWIMUX, INSPVA as reference.

References
----------
NovAtel OEM7 Commands and Logs Reference Manual, OM-20000169: 1.1 (headers), 1.3 (CRC), each log by its number.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import InputError
from insnav.input.formats.conventions import deviations
from insnav.input.formats.messages import Bytes, as_records, joined, sound_messages, starts
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK, WEEK_DAYS, seconds_of_week
from insnav.types import FloatArray
from insnav.units import DEG

name = "NovAtel log"
suffixes = (".gps", ".gpb")
extra = ""

_LONG, _SHORT = b"\xaa\x44\x12", b"\xaa\x44\x13"
_ASCII = re.compile(rb"[#%]([A-Z0-9]{4,16}A),([^;*\r\n]{1,200});([^*\r\n]{1,600})\*([0-9a-fA-F]{8})")


def _layout(text: str) -> np.dtype[Any]:
    return np.dtype([(part.split(":")[0], f"<{part.split(':')[1]}") for part in text.split()])


_BESTPOS = "status:u4 kind:u4 lat:f8 lon:f8 height:f8 undulation:f4 datum:u4 sd_n:f4 sd_e:f4 sd_d:f4"
_BESTVEL = "status:u4 kind:u4 latency:f4 age:f4 speed:f8 course:f8 up:f8"
_PVA = "vn:f8 ve:f8 vu:f8 roll:f8 pitch:f8 heading:f8"
_INSPVA = f"week:u4 second:f8 lat:f8 lon:f8 height:f8 {_PVA} status:u4"
_INSPVAX = f"status:u4 kind:u4 lat:f8 lon:f8 height:f8 undulation:f4 {_PVA} sd_n:f4 sd_e:f4 sd_d:f4"
_RAWIMUX = "info:u1 type:u1 week:u2 second:f8 status:u4 az:i4 ay:i4 ax:i4 gz:i4 gy:i4 gx:i4"
# number -> name, what is read of it
_LOGS: dict[int, tuple[str, np.dtype[Any]]] = {
    1429: ("BESTGNSSPOS", _layout(_BESTPOS)),
    42: ("BESTPOS", _layout(_BESTPOS)),
    1430: ("BESTGNSSVEL", _layout(_BESTVEL)),
    99: ("BESTVEL", _layout(_BESTVEL)),
    507: ("INSPVA", _layout(_INSPVA)),
    508: ("INSPVAS", _layout(_INSPVA)),
    1465: ("INSPVAX", _layout(_INSPVAX)),
    1461: ("RAWIMUX", _layout(_RAWIMUX)),
    1462: ("RAWIMUSX", _layout(_RAWIMUX)),
}
_ASCII_LOGS = {f"{name}A": number for number, (name, _) in _LOGS.items() if number in (42, 1429, 99, 1430, 507, 508)}
# logs of samples that cannot be used, and why
_USELESS = {
    268: "RAWIMU does not say which IMU it is of",
    325: "RAWIMUS does not say which IMU it is of",
    812: "CORRIMUDATA has gravity and Earth rate taken off",
    813: "CORRIMUDATAS has gravity and Earth rate taken off",
    1362: "IMURATECORRIMUS has gravity and Earth rate taken off",
    2264: "CORRIMUS has gravity and Earth rate taken off",
}
_FT = 0.3048
# type of IMU -> name, scale of increments of angle [rad] and of velocity [m/s]; table "Raw IMU Scale Factors"
_SCALES = {
    8: ("LN200", 2.0**-19, 2.0**-14),
    11: ("HG1700 AG58", 2.0**-33, 2.0**-27 * _FT),
    12: ("HG1700 AG62", 2.0**-33, 2.0**-26 * _FT),
    13: ("iIMU-FSAS", 0.1 * 2.0**-8 / 3600.0 * DEG, 0.05 * 2.0**-15),
    31: ("ADIS16488", 720.0 / 2.0**31 * DEG, 200.0 / 2.0**31),
    32: ("STIM300", 2.0**-21 * DEG, 2.0**-22),
    58: ("HG4930 AN01", 2.0**-33, 2.0**-29),
}
# position type -> fix type; those with INS in their name are fused with an IMU
_KINDS = {
    16: 5.0, 17: 4.0, 18: 4.0, 32: 2.0, 33: 2.0, 34: 2.0, 48: 1.0, 49: 1.0, 50: 1.0, 52: 4.0, 53: 5.0, 54: 4.0,
    55: 2.0, 56: 1.0, 68: 4.0, 69: 4.0, 73: 4.0, 74: 4.0, 77: 4.0, 78: 4.0,
}  # fmt: skip
_KIND_WORDS = {
    "SINGLE": 16, "PSRDIFF": 17, "WAAS": 18, "L1_FLOAT": 32, "NARROW_FLOAT": 34, "L1_INT": 48, "WIDE_INT": 49,
    "NARROW_INT": 50, "INS_SBAS": 52, "INS_PSRSP": 53, "INS_PSRDIFF": 54, "INS_RTKFLOAT": 55, "INS_RTKFIXED": 56,
    "PPP_CONVERGING": 68, "PPP": 69, "INS_PPP_CONVERGING": 73, "INS_PPP": 74, "PPP_BASIC_CONVERGING": 77,
    "PPP_BASIC": 78,
}  # fmt: skip
_STATUS_WORDS = {"SOL_COMPUTED": 0, "INS_SOLUTION_GOOD": 3, "INS_ALIGNMENT_COMPLETE": 7, "INS_SOLUTION_FREE": 6}
_INS_GOOD = (3, 6, 7)
_BAD = 255.0


@dataclass(slots=True)
class _Log:
    """Messages of one kind: time by their headers, and what they hold."""

    week: list[FloatArray] = field(default_factory=list)
    second: list[FloatArray] = field(default_factory=list)
    rows: list[NDArray[Any]] = field(default_factory=list)

    def add(self, week: Any, second: Any, rows: NDArray[Any]) -> None:
        self.week.append(np.asarray(week, dtype=np.float64))
        self.second.append(np.asarray(second, dtype=np.float64))
        self.rows.append(rows)


def recognise(source: Source) -> bool:
    """See `insnav.input.formats.registry.Format`."""
    head = source.head
    long = any(head[at + 3 : at + 4] == b"\x1c" for at in starts(head, _LONG)[:64].tolist())
    short = [head[at : at + 16 + head[at + 3]] for at in starts(head, _SHORT)[:64].tolist() if at + 3 < len(head)]
    return long or any(map(_crc, short)) or bool(_ASCII.search(head))


def read(source: Source) -> Mapping[str, Table]:
    """See `insnav.input.formats.registry.Format`."""
    logs, damaged, useless = _messages(source)
    notes = [f"{damaged} messages with a wrong checksum left out"] if damaged else []
    tables: dict[str, Table] = {}
    for position, velocity in (("BESTGNSSPOS", "BESTGNSSVEL"), ("BESTPOS", "BESTVEL")):
        if position in logs and "gps" not in tables:
            tables["gps"] = _fixes(source, logs[position], logs.get(velocity, _none("BESTVEL")), notes)
    for name in ("INSPVAX", "INSPVA", "INSPVAS"):
        if name in logs and "reference" not in tables:
            tables["reference"] = _reference(source, logs[name], notes)
    for name in ("RAWIMUX", "RAWIMUSX"):
        if name in logs:
            tables["imu"] = _samples(source, logs[name], notes)
    if "imu" not in tables and useless:
        why = "; ".join(sorted(useless))
        tables = {key: _with_note(table, f"no samples: {why}; log RAWIMUSXB") for key, table in tables.items()}
    if not tables:
        raise InputError(
            "the NovAtel log holds neither positions nor samples that can be used",
            where=source.name,
            why="; ".join(sorted(useless)) or f"no message of a kind that is read; {damaged} have a wrong checksum",
            fix="log BESTGNSSPOSB, BESTGNSSVELB ontime and RAWIMUSXB onnew",
        )
    return tables


def _crc(message: bytes) -> bool:
    """Whether the last four bytes are the CRC of those before."""
    return len(message) > 4 and _crc32(message[:-4]) == int.from_bytes(message[-4:], "little")


def _crc32(body: bytes) -> int:
    return zlib.crc32(body, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _sound(rows: Bytes) -> NDArray[np.bool_]:
    return np.array([_crc(row.tobytes()) for row in rows], dtype=np.bool_)


def _messages(source: Source) -> tuple[dict[str, tuple[FloatArray, NDArray[Any]]], int, set[str]]:
    """Times [s of the week of the first] and contents of each log; how many are damaged; samples without use."""
    found: dict[str, _Log] = {}
    damaged, useless = 0, set[str]()
    for number, week, second, body, bad in _binary(source):
        damaged += bad
        if number in _USELESS:
            useless.add(_USELESS[number])
        elif number in _LOGS and body.shape[1] >= _LOGS[number][1].itemsize and len(body):
            name, layout = _LOGS[number]
            found.setdefault(name, _Log()).add(week, second, as_records(body, layout))
    for number, when, row in _ascii(source):
        found.setdefault(_LOGS[number][0], _Log()).add([when[0]], [when[1]], row)
    logs = {}
    first = min((float(log.week[0][0]) for log in found.values()), default=0.0)
    for name, log in found.items():
        time, _ = seconds_of_week(WEEK_DAYS * np.concatenate(log.week), np.concatenate(log.second), week=first)
        order = np.argsort(time, kind="stable")
        logs[name] = (time[order], np.concatenate(log.rows)[order])
    return logs, damaged, useless


def _binary(source: Source) -> Iterator[tuple[int, FloatArray, FloatArray, Bytes, int]]:
    """Number, week, second and contents of messages of one kind and size, and how many of them are damaged."""
    data = source.data
    stream = np.frombuffer(data, dtype=np.uint8)
    for sync, header, place in ((_LONG, 28, (4, 8, 14)), (_SHORT, 12, (4, 3, 6))):
        at = starts(data, sync)
        at = at[at <= len(stream) - header - 4]
        if header == 28:
            at = at[stream[at + 3] == header]
        kind = stream[at + place[0]] + 256 * stream[at + place[0] + 1].astype(np.int64)
        size = stream[at + place[1]].astype(np.int64)
        if header == 28:
            size += 256 * stream[at + place[1] + 1].astype(np.int64)
        for number in set(kind.tolist()) & {*_LOGS, *_USELESS}:
            for length in np.unique(size[kind == number]).tolist():
                mine = at[(kind == number) & (size == length)]
                good = 0
                for _, rows in sound_messages(data, mine, header + length + 4, _sound):
                    good += len(rows)
                    times = np.ascontiguousarray(rows[:, place[2] : place[2] + 6])
                    week = times[:, :2].copy().view("<u2")[:, 0].astype(np.float64)
                    second = 1e-3 * times[:, 2:].copy().view("<u4")[:, 0]
                    yield number, week, second, rows[:, header:-4], 0
                if good < len(mine):
                    yield number, np.empty(0), np.empty(0), np.empty((0, 0), np.uint8), len(mine) - good


def _ascii(source: Source) -> Iterator[tuple[int, tuple[float, float], NDArray[Any]]]:
    for match in _ASCII.finditer(source.data):
        number = _ASCII_LOGS.get(match[1].decode())
        body = match[0][1:-9]
        if number is None or _crc32(body) != int(match[4], 16):
            continue
        head, words = match[2].decode("latin-1").split(","), match[3].decode("latin-1").split(",")
        layout = _LOGS[number][1]
        week, second = head[:2] if match[0].startswith(b"%") else head[4:6]
        names = layout.names or ()
        if number in (42, 1429):
            words = [*words[:6], "0", *words[7:]]  # the datum is a word
        try:
            row = tuple(_word(key, word) for key, word in zip(names, words, strict=False))
            if len(row) == len(names):
                yield number, (float(week), float(second)), np.array([row], dtype=layout)
        except (ValueError, OverflowError):
            continue


def _word(key: str, word: str) -> float:
    if key == "status":
        return _STATUS_WORDS.get(word, _BAD)
    return _KIND_WORDS.get(word, 0) if key == "kind" else float(word)


def _own_time(time: FloatArray, rows: NDArray[Any]) -> FloatArray:
    """Time in the messages themselves, which is finer than that of their headers."""
    return np.asarray(rows["second"] + np.round((time - rows["second"]) / WEEK) * WEEK, dtype=np.float64)


def _none(name: str) -> tuple[FloatArray, NDArray[Any]]:
    layout = next(each for key, each in _LOGS.values() if key == name)
    return np.empty(0), np.empty(0, dtype=layout)


def _with_note(table: Table, note: str) -> Table:
    return replace(table, notes=(*table.notes, note))


def _fixes(source: Source, position: Any, velocity: Any, notes: list[str]) -> Table:
    time, rows = position
    good = (rows["status"] == 0) & np.isin(rows["kind"], list(_KINDS))
    columns = {
        "time_s": time,
        "lat_deg": rows["lat"],
        "lon_deg": rows["lon"],
        "height_m": rows["height"] + rows["undulation"].astype(np.float64),
        **deviations(np.column_stack([rows["sd_n"], rows["sd_e"], rows["sd_d"]]).astype(np.float64), "sd_{}_m"),
    }
    v_time, v_rows = velocity
    sure = v_rows["status"] == 0
    v_time, v_rows = v_time[sure], v_rows[sure]
    if len(v_time):
        course = v_rows["course"] * DEG
        v = np.column_stack([v_rows["speed"] * np.cos(course), v_rows["speed"] * np.sin(course), -v_rows["up"]])
        # of the same epoch, which is written a little before the log of the other
        v = joined(np.round(time, 3), np.round(v_time, 3), v)
        columns |= {f"v{axis}_m_s": v[:, i] for i, axis in enumerate("ned")}
        latency = float(np.median(v_rows["latency"]))
        if latency > 0.0:
            notes = [*notes, f"velocities are {latency:.3g} s older than the positions, as the log says"]
    columns["fix"] = np.array([_KINDS.get(int(each), 0.0) for each in rows["kind"]])
    if np.isin(rows["kind"], [kind for word, kind in _KIND_WORDS.items() if "INS" in word]).any():
        notes = [*notes, "positions are fused with the receiver's own IMU: their errors are correlated in time"]
    if not good.all():
        notes = [*notes, f"{int((~good).sum())} of {len(good)} positions are none: left out"]
    kept = {key: np.asarray(column[good], dtype=np.float64) for key, column in columns.items()}
    return column_table(source, kept, ["times are seconds of the GPS week", *notes], row="position")


def _reference(source: Source, log: Any, notes: list[str]) -> Table:
    time, rows = log
    good = np.isin(rows["status"], _INS_GOOD)
    names = rows.dtype.names or ()
    geoid = rows["undulation"].astype(np.float64) if "undulation" in names else 0.0
    columns = {
        "time_s": _own_time(time, rows) if "second" in names else time,
        "lat_deg": rows["lat"],
        "lon_deg": rows["lon"],
        "height_m": rows["height"] + geoid,  # that of INSPVA is ellipsoidal, that of INSPVAX above the geoid
        "vn_m_s": rows["vn"],
        "ve_m_s": rows["ve"],
        "vd_m_s": -rows["vu"],
        "roll_deg": rows["roll"],
        "pitch_deg": rows["pitch"],
        "heading_deg": rows["heading"] % 360.0,
    }
    kept = {key: np.asarray(column[good], dtype=np.float64) for key, column in columns.items()}
    return column_table(source, kept, ["the receiver's own fusion with its IMU", *notes], row="solution")


def _samples(source: Source, log: Any, notes: list[str]) -> Table:
    time, rows = log
    kinds = np.unique(rows["type"]).tolist()
    if len(kinds) != 1 or kinds[0] not in _SCALES:
        known = ", ".join(f"{key} {each[0]}" for key, each in _SCALES.items())
        raise InputError(
            "the scale of the samples is not known",
            where=source.name,
            why=f"IMU of type {', '.join(map(str, kinds))}; known are {known}",
            fix="export the samples as CSV with their units",
        )
    kind, angle, speed = _SCALES[kinds[0]]
    names = ("dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad", "dvel_x_m_s", "dvel_y_m_s", "dvel_z_m_s")
    values = [rows[key].astype(np.float64) for key in ("gx", "gy", "gz", "ax", "ay", "az")]
    signs = (angle, -angle, angle, speed, -speed, speed)  # y is written with the other sign
    columns = {
        "time_s": _own_time(time, rows),
        **{key: unit * value for key, unit, value in zip(names, signs, values, strict=True)},
    }
    return column_table(source, columns, [f"increments of a {kind}", *notes], row="RAWIMUX", axes="RFU")
