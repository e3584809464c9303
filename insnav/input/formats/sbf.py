"""Septentrio SBF logs: PVTGeodetic or PVTCartesian with their covariances, and samples in ExtSensorMeas.

References
----------
Septentrio mosaic-X5 Reference Guide, firmware 4.10: 4.1 (SBF outline), 4.2 (blocks by their numbers).
"""

from __future__ import annotations

import binascii
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.earth import level_from_earth, lla_from_earth
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import (
    ACCEL,
    GYRO,
    PLACE,
    VELOCITY,
    deviations,
    fix_table,
    level_covariance,
    triad,
    up_or_down,
    with_force,
)
from insnav.input.formats.messages import Bytes, Framing, as_records, joined, layout
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK, WEEK_DAYS, seconds_of_week
from insnav.types import FloatArray
from insnav.units import DEG

name = "Septentrio SBF log"
suffixes = (".sbf",)

_UNKNOWN = -1e10  # SBF marks unknown values by -2e10, which is below this limit
_HEADER = "sync:u2 crc:u2 id:u2 length:u2 tow:u4 week:u2"
_PVT = f"{_HEADER} mode:u1 error:u1"
_BLOCKS: dict[str, tuple[int, np.dtype[Any]]] = {
    "geodetic": (4007, layout(f"{_PVT} lat:f8 lon:f8 height:f8 undulation vn ve vu", "f4")),
    "cartesian": (4006, layout(f"{_PVT} x:f8 y:f8 z:f8 undulation vx vy vz", "f4")),
    "geodetic position": (5906, layout(f"{_PVT} nn ee uu bb ne nu nb eu", "f4")),
    "geodetic velocity": (5908, layout(f"{_PVT} nn ee uu tt ne nu nt eu", "f4")),
    "cartesian position": (5905, layout(f"{_PVT} xx yy zz bb xy xz xb yz", "f4")),
    "cartesian velocity": (5907, layout(f"{_PVT} xx yy zz tt xy xz xt yz", "f4")),
}
_SENSORS = 4050
_SENSOR = np.dtype([("source", "u1"), ("model", "u1"), ("type", "u1"), ("info", "u1"), ("value", "<f8", (3,))])
# mode of PVT -> fix type; mode 3, an entered position, is invalid
_MODES = {1: 5.0, 2: 4.0, 4: 1.0, 5: 2.0, 6: 4.0, 7: 1.0, 8: 2.0, 10: 4.0}
_Rows = NDArray[Any]
_Notes = list[Finding]


def recognise(source: Source) -> bool:
    return _FRAMING.recognise(source.head)


def read(source: Source) -> Mapping[str, Table]:
    messages = _FRAMING.find(source.data, [*(number for number, _ in _BLOCKS.values()), _SENSORS])
    blocks = {key: messages[number].records(each)[0] for key, (number, each) in _BLOCKS.items()}
    damaged = sum(kind.damaged for kind in messages.values())
    notes = [Finding.of(Code.READ_ROWS_DAMAGED, subject="SBF", count=damaged)] if damaged else []
    tables: dict[str, Table] = {}
    if len(blocks["geodetic"]):
        tables["gps"] = _geodetic(source, blocks, notes)
    elif len(blocks["cartesian"]):
        tables["gps"] = _cartesian(source, blocks, notes)
    samples = _samples(source, messages[_SENSORS].rows, tables["gps"].week if tables else None, notes)
    if samples is not None:
        tables["imu"] = samples
    if not tables:
        raise InputError("format.sbf_no_data", where=source.name, damaged_count=damaged)
    return tables


def _sound(rows: Bytes) -> NDArray[np.bool_]:
    """Test the CRC (CCITT) of whole blocks (n, size)."""
    stated = rows[:, 2] + 256 * rows[:, 3].astype(np.int64)
    found = [binascii.crc_hqx(row[4:].tobytes(), 0) for row in rows]
    return np.asarray(stated == np.array(found, dtype=np.int64))


_FRAMING = Framing(b"$@", number=(4, 0x1FFF), size=(6, 0xFFFF), around=0, least=14, sound=_sound)


def _key(rows: _Rows) -> FloatArray:
    """Return the GPS time [ms], the key to join blocks of one epoch."""
    return np.asarray(rows["week"] * (1e3 * WEEK) + rows["tow"], dtype=np.float64)


def _good(rows: _Rows, fields: tuple[str, ...]) -> NDArray[np.bool_]:
    good = (rows["error"] == 0) & (rows["week"] < 65_535)
    for field in fields:
        good &= rows[field] > _UNKNOWN
    return np.asarray(good)


def _table(source: Source, rows: _Rows, columns: dict[str, FloatArray], good: Any, notes: _Notes, row: str) -> Table:
    dated = rows[good] if good.any() else rows
    week = float(dated["week"][0]) if len(dated) else None
    time, note, week = seconds_of_week(
        WEEK_DAYS * rows["week"].astype(np.float64), 1e-3 * rows["tow"].astype(np.float64), week=week
    )
    found = {"time_s": time, **columns}
    kind = np.where(good, rows["mode"] & 15, np.nan)
    return fix_table(source, found, kind, _MODES, [note, *notes], row=row, week=week)


def _matrices(rows: _Rows, axes: str) -> FloatArray:
    """Build covariances ``(n, 3, 3)`` from the elements of covariance blocks."""
    found = np.empty((len(rows), 3, 3))
    for i, first in enumerate(axes):
        for j, second in enumerate(axes):
            pair = first + second
            found[:, i, j] = rows[pair if pair in (rows.dtype.names or ()) else pair[::-1]]
    return found


def _geodetic(source: Source, blocks: Mapping[str, _Rows], notes: _Notes) -> Table:
    rows = blocks["geodetic"]
    columns = triad(PLACE, np.column_stack([rows["lat"] / DEG, rows["lon"] / DEG, rows["height"]]))
    v = np.column_stack([rows["vn"], rows["ve"], -rows["vu"]]).astype(np.float64)
    columns |= triad(VELOCITY, np.where(np.abs(v) < -_UNKNOWN, v, np.nan))
    for kind, names in (("position", "sd_{}_m"), ("velocity", "sd_v{}_m_s")):
        block = blocks[f"geodetic {kind}"]
        if len(block):
            variance = np.column_stack([block[axes] for axes in ("nn", "ee", "uu")]).astype(np.float64)
            columns |= deviations(joined(_key(rows), _key(block), np.sqrt(np.maximum(variance, 0.0))), names)
    return _table(source, rows, columns, _good(rows, ("lat", "lon", "height")), notes, "PVTGeodetic")


def _cartesian(source: Source, blocks: Mapping[str, _Rows], notes: _Notes) -> Table:
    rows = blocks["cartesian"]
    r = np.column_stack([rows["x"], rows["y"], rows["z"]])
    distance = np.linalg.norm(np.where(np.abs(r) < -_UNKNOWN, r, 0.0), axis=1)
    near = _good(rows, ("x", "y", "z")) & (distance > 6.3e6) & (distance < 6.5e6)
    lla = lla_from_earth(np.where(near[:, None], r, [6.4e6, 0.0, 0.0]))
    columns = triad(PLACE, lla / [DEG, DEG, 1.0])
    v = np.column_stack([rows["vx"], rows["vy"], rows["vz"]]).astype(np.float64)
    v = np.where(np.abs(v) < -_UNKNOWN, v, np.nan)
    columns |= triad(VELOCITY, np.einsum("nij,nj->ni", level_from_earth(lla), v))
    for kind, names in (("position", "sd_{}_m"), ("velocity", "sd_v{}_m_s")):
        block = blocks[f"cartesian {kind}"]
        if len(block):
            covariance = joined(_key(rows), _key(block), _matrices(block, "xyz"))
            columns |= deviations(level_covariance(covariance, lla), names)
    return _table(source, rows, columns, near, notes, "PVTCartesian")


def _samples(source: Source, blocks: list[Bytes], week: float | None, notes: _Notes) -> Table | None:
    """Read accelerations (type 0) and angular rates (type 1) of ExtSensorMeas, at the times of the rates."""
    parts: dict[int, list[tuple[FloatArray, FloatArray]]] = {0: [], 1: []}
    head = layout(f"{_HEADER} n:u1 size:u1")
    for rows in blocks:
        if rows.shape[1] < head.itemsize:
            continue
        # each block holds `n` sensors of `size` bytes after its head
        heads = as_records(rows, head)
        for size in np.unique(heads["size"]).tolist():
            for offset in (
                range(head.itemsize, rows.shape[1] - size + 1, max(size, 1)) if size >= _SENSOR.itemsize else ()
            ):
                present = (heads["size"] == size) & (heads["n"] > (offset - head.itemsize) // size)
                sensors = as_records(rows[present][:, offset:], _SENSOR)
                for kind, pairs in parts.items():
                    of_kind = (sensors["type"] == kind) & (sensors["value"] > _UNKNOWN).all(axis=1)
                    pairs.append((_key(heads[present][of_kind]), sensors["value"][of_kind]))
    sorted_parts = {}
    for kind, pairs in parts.items():
        time = np.concatenate([np.empty(0), *(pair[0] for pair in pairs)])
        order = np.argsort(time, kind="stable")
        sorted_parts[kind] = (time[order], np.concatenate([np.empty((0, 3)), *(pair[1] for pair in pairs)])[order])
    (force_time, force), (time, rate) = sorted_parts[0], sorted_parts[1]
    if not len(force) or not len(rate):
        return None
    first = week if week is not None else float(time[0] // (1e3 * WEEK))
    columns = {"time_s": 1e-3 * (time - first * (1e3 * WEEK)), **triad(GYRO, rate * DEG)}
    columns = with_force(columns, 1e-3 * (force_time - first * (1e3 * WEEK)), force)
    notes = [Finding.of(Code.READ_TIME_GPS_WEEK, week=first), *notes]
    return column_table(source, columns, notes, row="sample", axes=up_or_down(columns[ACCEL[2]], "FLU"), week=first)
