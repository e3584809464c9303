"""NovAtel OEM logs, binary and ASCII: BESTPOS and BESTVEL (GNSS-only logs first), RAWIMUX, INSPVA as reference.

References
----------
NovAtel OEM7 Commands and Logs Reference Manual, OM-20000169: 1.1 (headers), 1.3 (CRC), each log by its number.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import (
    ATTITUDE,
    DTHETA,
    DVEL,
    PLACE,
    VELOCITY,
    deviations,
    fix_table,
    of_course,
    triad,
)
from insnav.input.formats.messages import Bytes, Framing, joined, layout
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK, WEEK_DAYS, seconds_of_week
from insnav.input.interpret.physics import MAX_TURN_RATIO, turn_ratio
from insnav.types import FloatArray
from insnav.units import DEG

name = "NovAtel log"
suffixes = (".gps", ".gpb")

_LONG, _SHORT = b"\xaa\x44\x12\x1c", b"\xaa\x44\x13"
_ASCII = re.compile(rb"[#%]([A-Z0-9]{4,16}A),([^;*\r\n]{1,200});([^*\r\n]{1,600})\*([0-9a-fA-F]{8})")


_BESTPOS = layout("status:u4 kind:u4 lat:f8 lon:f8 height:f8 undulation:f4 datum:u4 sd_n:f4 sd_e:f4 sd_d:f4")
_BESTVEL = layout("status:u4 kind:u4 latency:f4 age:f4 speed:f8 course:f8 up:f8")
_PVA = "vn:f8 ve:f8 vu:f8 roll:f8 pitch:f8 heading:f8"
_INSPVA = layout(f"week:u4 second:f8 lat:f8 lon:f8 height:f8 {_PVA} status:u4")
_INSPVAX = layout(f"status:u4 kind:u4 lat:f8 lon:f8 height:f8 undulation:f4 {_PVA} sd_n:f4 sd_e:f4 sd_d:f4")
_COUNTS = "flags:u4 az:i4 ay:i4 ax:i4 gz:i4 gy:i4 gx:i4"
_RAWIMU = layout(f"week:u4 second:f8 {_COUNTS}")
_RAWIMUX = layout(f"info:u1 type:u1 week:u2 second:f8 {_COUNTS}")
# log number -> name, and fields that are read
_LOGS: dict[int, tuple[str, np.dtype[Any]]] = {
    1429: ("BESTGNSSPOS", _BESTPOS),
    42: ("BESTPOS", _BESTPOS),
    1430: ("BESTGNSSVEL", _BESTVEL),
    99: ("BESTVEL", _BESTVEL),
    507: ("INSPVA", _INSPVA),
    508: ("INSPVAS", _INSPVA),
    1465: ("INSPVAX", _INSPVAX),
    268: ("RAWIMU", _RAWIMU),
    325: ("RAWIMUS", _RAWIMU),
    1461: ("RAWIMUX", _RAWIMUX),
    1462: ("RAWIMUSX", _RAWIMUX),
}
_ASCII_LOGS = {f"{name}A": number for number, (name, _) in _LOGS.items() if name != "INSPVAX"}
# logs of corrected samples, which insnav does not use
_CORRECTED = {812: "CORRIMUDATA", 813: "CORRIMUDATAS", 1362: "IMURATECORRIMUS", 2264: "CORRIMUS"}
_FT = 0.3048
# type of IMU -> name, scale of increments of angle [rad] and of velocity [m/s]; table "Raw IMU Scale Factors"
_SCALES = {
    number: (model, angle, speed)
    for angle, speed, models in (
        (2.0**-19, 2.0**-14, {8: "LN200"}),
        (2.0**-33, 2.0**-27 * _FT, {1: "HG1700 AG11", 5: "HG1900 CA29", 11: "HG1700 AG58", 27: "HG1900 CA50"}),
        (2.0**-33, 2.0**-27 * _FT, {20: "HG1930 AA99", 28: "HG1930 CA50"}),
        (2.0**-33, 2.0**-26 * _FT, {4: "HG1700 AG17", 12: "HG1700 AG62"}),
        (0.1 * 2.0**-8 / 3600.0 * DEG, 0.05 * 2.0**-15, {13: "iIMU-FSAS"}),
        (0.1 * 2.0**-8 / 3600.0, 0.05 * 2.0**-15, {16: "IMU-CPT", 33: "KVH1750"}),
        (1e-9, 2e-8, {26: "ISA-100C", 52: "uIMU-IC"}),
        (720.0 * 2.0**-31 * DEG, 200.0 * 2.0**-31, {31: "ADIS16488"}),
        (2.0**-21 * DEG, 2.0**-22, {32: "STIM300", 56: "STIM300D"}),
        (2.0**-33, 2.0**-29, {58: "HG4930 AN01", 68: "HG4930 AN04", 69: "HG4930 AN04 400 Hz"}),
    )
    for number, model in models.items()
}
# position type -> fix type; types with INS in their name are fused with IMU data
_KINDS = {
    16: 5.0, 17: 4.0, 18: 4.0, 32: 2.0, 33: 2.0, 34: 2.0, 48: 1.0, 49: 1.0, 50: 1.0, 52: 4.0, 53: 5.0, 54: 4.0,
    55: 2.0, 56: 1.0, 68: 4.0, 69: 4.0, 73: 4.0, 74: 4.0, 77: 4.0, 78: 4.0, 79: 4.0, 80: 4.0,
}  # fmt: skip
_KIND_WORDS = {
    "SINGLE": 16, "PSRDIFF": 17, "WAAS": 18, "L1_FLOAT": 32, "IONOFREE_FLOAT": 33, "NARROW_FLOAT": 34, "L1_INT": 48,
    "WIDE_INT": 49, "NARROW_INT": 50, "INS_SBAS": 52, "INS_PSRSP": 53, "INS_PSRDIFF": 54, "INS_RTKFLOAT": 55,
    "INS_RTKFIXED": 56, "PPP_CONVERGING": 68, "PPP": 69, "INS_PPP_CONVERGING": 73, "INS_PPP": 74,
    "PPP_BASIC_CONVERGING": 77, "PPP_BASIC": 78, "INS_PPP_BASIC_CONVERGING": 79, "INS_PPP_BASIC": 80,
}  # fmt: skip
_STATUS_WORDS = {"SOL_COMPUTED": 0, "INS_SOLUTION_GOOD": 3, "INS_ALIGNMENT_COMPLETE": 7, "INS_SOLUTION_FREE": 6}
_INS_GOOD = (3, 6, 7)
_BAD = 255.0


_GRAVITY, _TOLERANCE = 9.8, 0.05  # sum of velocity increments per second [m/s^2], and tolerance


def recognise(source: Source) -> bool:
    head = source.head
    return _LONG in head or _FRAMINGS[1][0].recognise(head) or bool(_ASCII.search(head))


def read(source: Source) -> Mapping[str, Table]:
    logs, week, damaged, corrected = _messages(source)
    notes = [Finding.of(Code.READ_ROWS_DAMAGED, subject="NovAtel", count=damaged)] if damaged else []
    notes += [Finding.of(Code.READ_TIME_GPS_WEEK, week=week)] if logs else []
    tables: dict[str, Table] = {}
    for position, velocity in (("BESTGNSSPOS", "BESTGNSSVEL"), ("BESTPOS", "BESTVEL")):
        if position in logs and "gps" not in tables:
            no_velocity = (np.empty(0), np.empty(0, dtype=_BESTVEL))
            tables["gps"] = _fixes(source, logs[position], logs.get(velocity, no_velocity), notes)
    for name in ("INSPVAX", "INSPVA", "INSPVAS"):
        if name in logs and "reference" not in tables:
            tables["reference"] = _reference(source, logs[name], notes)
    for name in ("RAWIMU", "RAWIMUS", "RAWIMUX", "RAWIMUSX"):
        if name in logs:
            tables |= _samples(source, logs[name], name, notes)
    if corrected and not any(key.startswith("imu") for key in tables):
        note = Finding.of(Code.READ_IMU_CORRECTED, messages=tuple(corrected))
        unusable = tuple(corrected)
        tables = {key: replace(table, notes=(*table.notes, note), unusable=unusable) for key, table in tables.items()}
    if not tables:
        raise InputError("format.novatel_no_data", where=source.name, unusable=tuple(corrected), damaged_count=damaged)
    return {key: replace(table, week=week) for key, table in tables.items()}


def _crc32(body: bytes) -> int:
    return zlib.crc32(body, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _sound(rows: Bytes) -> NDArray[np.bool_]:
    """Test the CRC in the last four bytes of whole messages (n, size)."""
    messages = (row.tobytes() for row in rows)
    return np.array([_crc32(each[:-4]) == int.from_bytes(each[-4:], "little") for each in messages], dtype=np.bool_)


# framing of messages with long and short header, header size, and position of the time
_FRAMINGS = (
    (Framing(_LONG, number=(4, 0xFFFF), size=(8, 0xFFFF), around=32, least=32, sound=_sound), 28, 14),
    (Framing(_SHORT, number=(4, 0xFFFF), size=(3, 0xFF), around=16, least=16, sound=_sound), 12, 6),
)
_WHEN = layout("week:u2 ms:u4")


def _messages(source: Source) -> tuple[dict[str, Any], float, int, list[str]]:
    """Return times and contents of each log, the first GPS week, count of damaged messages, unused sample logs."""
    parts: dict[str, list[tuple[Any, Any, Any]]] = {}
    damaged, corrected = 0, set[str]()
    for framing, header, when_at in _FRAMINGS:
        for number, messages in framing.find(source.data, [*_LOGS, *_CORRECTED]).items():
            damaged += messages.damaged
            if number in _CORRECTED:
                corrected |= {_CORRECTED[number]} if messages.rows else set()
                continue
            name, kind = _LOGS[number]
            when, at = messages.records(_WHEN, when_at)
            rows, with_content = messages.records(kind, header)
            when = when[np.isin(at, with_content)]
            if len(rows):
                parts.setdefault(name, []).append((when["week"].astype(float), 1e-3 * when["ms"], rows))
    for number, (week, second), row in _ascii(source):
        parts.setdefault(_LOGS[number][0], []).append(([week], [second], row))
    first = min((float(part[0][0]) for each in parts.values() for part in each), default=0.0)
    logs = {}
    for name, each in parts.items():
        weeks, seconds, rows = (np.concatenate(column) for column in zip(*each, strict=True))
        time = seconds_of_week(WEEK_DAYS * weeks, seconds, week=first).time
        order = np.argsort(time, kind="stable")
        logs[name] = (time[order], rows[order])
    return logs, first, damaged, sorted(corrected)


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
            words = [*words[:6], "0", *words[7:]]  # the datum is a text, and is not used
        try:
            row = tuple(_word(key, word) for key, word in zip(names, words, strict=False))
            if len(row) == len(names):
                yield number, (float(week), float(second)), np.array([row], dtype=layout)
        except (ValueError, OverflowError):
            continue


def _word(key: str, word: str) -> float:
    if key == "status":
        return _STATUS_WORDS.get(word, _BAD)
    if key in ("flags", "info"):
        return 0
    return _KIND_WORDS.get(word, 0) if key == "kind" else float(word)


def _own_time(time: FloatArray, rows: NDArray[Any]) -> FloatArray:
    """Return the times in the message bodies [s], which are finer than the times in the headers."""
    return np.asarray(rows["second"] + np.round((time - rows["second"]) / WEEK) * WEEK, dtype=np.float64)


def _fixes(source: Source, position: Any, velocity: Any, notes: list[Finding]) -> Table:
    time, rows = position
    height = rows["height"] + rows["undulation"].astype(np.float64)
    columns = {"time_s": time, **triad(PLACE, np.column_stack([rows["lat"], rows["lon"], height]))}
    columns |= deviations(np.column_stack([rows["sd_n"], rows["sd_e"], rows["sd_d"]]).astype(np.float64), "sd_{}_m")
    v_time, v_rows = velocity
    valid = v_rows["status"] == 0
    v_time, v_rows = v_time[valid], v_rows[valid]
    if len(v_time):
        velocities = of_course(v_rows["speed"], v_rows["course"], -v_rows["up"])
        # times rounded to milliseconds, to join the velocity and the position of an epoch
        columns |= {key: joined(np.round(time, 3), np.round(v_time, 3), values) for key, values in velocities.items()}
        latency = float(np.median(v_rows["latency"]))
        if latency > 0.0:
            notes = [*notes, Finding.of(Code.READ_VELOCITY_LATENCY, latency_s=latency)]
    if np.isin(rows["kind"], [kind for word, kind in _KIND_WORDS.items() if "INS" in word]).any():
        notes = [*notes, Finding.of(Code.READ_FUSED)]
    kind = np.where(rows["status"] == 0, rows["kind"], np.nan)
    return fix_table(source, columns, kind, _KINDS, notes, row="position")


def _reference(source: Source, log: Any, notes: list[Finding]) -> Table:
    time, rows = log
    good = np.isin(rows["status"], _INS_GOOD)
    names = rows.dtype.names or ()
    # the height is ellipsoidal in INSPVA, above the geoid in INSPVAX
    height = rows["height"] + (rows["undulation"].astype(np.float64) if "undulation" in names else 0.0)
    columns = {"time_s": _own_time(time, rows) if "second" in names else time}
    columns |= triad(PLACE, np.column_stack([rows["lat"], rows["lon"], height]))
    columns |= triad(VELOCITY, np.column_stack([rows["vn"], rows["ve"], -rows["vu"]]))
    columns |= triad(ATTITUDE, np.column_stack([rows["roll"], rows["pitch"], rows["heading"] % 360.0]))
    kept = {key: np.asarray(column[good], dtype=np.float64) for key, column in columns.items()}
    return column_table(source, kept, [Finding.of(Code.READ_FUSED), *notes], row="solution")


def _samples(source: Source, log: Any, name: str, notes: list[Finding]) -> dict[str, Table]:
    """Return the samples in one table, or in one table for each fitting IMU model if the log states no model."""
    time, rows = log
    time = _own_time(time, rows)
    counts = np.column_stack([rows[key].astype(np.float64) for key in ("gx", "gy", "gz", "ax", "ay", "az")])
    counts *= [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]  # NovAtel logs the y axis with opposite sign
    stated = "type" in (rows.dtype.names or ())
    if stated:
        types, per_second = np.unique(rows["type"]).tolist(), np.nan
        scales = [_SCALES[kind] for kind in types if kind in _SCALES]
    else:  # gravity determines the scale of velocity increments, its rotation the scale of angle increments
        types, span = [], float(np.ptp(time)) if len(time) > 1 else 0.0
        per_second = np.linalg.norm(counts[1:, 3:], axis=1).sum() / span if span > 0.0 else np.nan
        scales = [scale for scale in _SCALES.values() if abs(per_second * scale[2] / _GRAVITY - 1.0) < _TOLERANCE]
        step = float(np.median(np.diff(time))) if scales else 0.0
        turn = turn_ratio(time, counts[:, :3], counts[:, 3:])[0] * step if scales else 0.0
        scales = [scale for scale in scales if not turn or 1.0 < MAX_TURN_RATIO * turn / scale[1] < MAX_TURN_RATIO**2]
    if not scales or len(types) > 1:
        rate, known = float(per_second), tuple(f"{key} {scale[0]}" for key, scale in _SCALES.items())
        raise InputError(
            "format.novatel_scale", where=source.name, message=name, types=tuple(types), counts_per_s=rate, known=known
        )
    tables = {}
    for angle, speed in dict.fromkeys(scale[1:] for scale in scales):
        models = ", ".join(scale[0] for scale in scales if scale[1:] == (angle, speed))
        columns = {"time_s": time, **triad(DTHETA, counts[:, :3] * angle), **triad(DVEL, counts[:, 3:] * speed)}
        note = Finding.of(Code.READ_IMU_MODEL, subject=name, model=models)
        if not stated:
            others = {scale / angle: model for model, scale, _ in reversed(_SCALES.values()) if scale != angle}
            noise = angle * float(np.median(np.diff(counts[:, :3], axis=0).std(axis=0)) / np.sqrt(2.0 * step))
            values: dict[str, Any] = {"model": models, "others": tuple(others.values()), "ratios": tuple(others)}
            note = Finding.of(Code.READ_IMU_MODEL_BY_GRAVITY, subject=name, noise_rad_sqrt_s=noise, **values)
        tables[models] = column_table(source, columns, [note, *notes], row=name, axes="RFU")
    return {"imu" if len(tables) == 1 else f"imu:{key.partition(', ')[0]}": table for key, table in tables.items()}
