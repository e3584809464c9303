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

from insnav.attitude import dcm_from_quat
from insnav.earth_fixed import lla_from_earth, quat_earth_from_level
from insnav.exceptions import InputError
from insnav.input.formats.conventions import ACCEL, GYRO, deviations, level_covariance, triad, up_or_down
from insnav.input.formats.messages import Bytes, as_records, at_times, joined, sound_messages, starts
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK, WEEK_DAYS, seconds_of_week
from insnav.types import FloatArray
from insnav.units import DEG

name = "Septentrio SBF log"
suffixes = (".sbf",)
extra = ""

_SYNC = b"$@"
_UNKNOWN = -1e10  # a value that is not known is -2e10
_HEADER = [("sync", "S2"), ("crc", "<u2"), ("id", "<u2"), ("length", "<u2"), ("tow", "<u4"), ("week", "<u2")]
_PVT = [*_HEADER, ("mode", "u1"), ("error", "u1")]


def _layout(head: list[tuple[str, str]], kind: str, names: str) -> np.dtype[Any]:
    return np.dtype([*head, *((each, kind) for each in names.split())])


_BLOCKS: dict[str, tuple[int, np.dtype[Any]]] = {
    "geodetic": (
        4007,
        np.dtype([*_layout(_PVT, "<f8", "lat lon height").descr, *_layout([], "<f4", "undulation vn ve vu").descr]),
    ),
    "cartesian": (
        4006,
        np.dtype([*_layout(_PVT, "<f8", "x y z").descr, *_layout([], "<f4", "undulation vx vy vz").descr]),
    ),
    "geodetic position": (5906, _layout(_PVT, "<f4", "nn ee uu bb ne nu nb eu")),
    "geodetic velocity": (5908, _layout(_PVT, "<f4", "nn ee uu tt ne nu nt eu")),
    "cartesian position": (5905, _layout(_PVT, "<f4", "xx yy zz bb xy xz xb yz")),
    "cartesian velocity": (5907, _layout(_PVT, "<f4", "xx yy zz tt xy xz xt yz")),
}
_SENSORS = 4050
_SENSOR = np.dtype([("source", "u1"), ("model", "u1"), ("type", "u1"), ("info", "u1"), ("value", "<f8", (3,))])
# mode of PVT -> fix type; a place that is entered (3) is none
_MODES = {1: 5.0, 2: 4.0, 4: 1.0, 5: 2.0, 6: 4.0, 7: 1.0, 8: 2.0, 10: 4.0}
_Rows = NDArray[Any]


def recognise(source: Source) -> bool:
    """See `insnav.input.formats.registry.Format`."""
    head = source.head
    sizes = ((at, int.from_bytes(head[at + 6 : at + 8], "little")) for at in starts(head, _SYNC)[:64].tolist())
    return any(
        size % 4 == 0 and 12 <= size <= len(head) - at and bool(_sound(_row(head[at : at + size]))[0])
        for at, size in sizes
    )


def read(source: Source) -> Mapping[str, Table]:
    """See `insnav.input.formats.registry.Format`."""
    blocks, damaged = _read_blocks(source)
    notes = [f"{damaged} blocks with a wrong checksum left out"] if damaged else []
    tables: dict[str, Table] = {}
    if len(blocks["geodetic"]):
        tables["gps"] = _geodetic(source, blocks, notes)
    elif len(blocks["cartesian"]):
        tables["gps"] = _cartesian(source, blocks, notes)
    week = float(blocks["geodetic"]["week"][0]) if len(blocks["geodetic"]) else None
    samples = _samples(source, week, notes)
    if samples is not None:
        tables["imu"] = samples
    if not tables:
        raise InputError(
            "the SBF log holds neither positions nor samples",
            where=source.name,
            why=f"there is no sound PVTGeodetic, PVTCartesian or ExtSensorMeas block; {damaged} damaged ones",
            fix="log PVTGeodetic, PosCovGeodetic, VelCovGeodetic; raw measurements must be solved first, as by RTKLIB",
        )
    return tables


def _row(block: bytes) -> Bytes:
    return np.frombuffer(block, dtype=np.uint8)[None]


def _sound(rows: Bytes) -> NDArray[np.bool_]:
    """Whether the CRC (CCITT) of whole blocks (n, size) is right."""
    stated = rows[:, 2] + 256 * rows[:, 3].astype(np.int64)
    found = [binascii.crc_hqx(row[4:].tobytes(), 0) for row in rows]
    return np.asarray(stated == np.array(found, dtype=np.int64))


def _find(source: Source, number: int) -> tuple[list[Bytes], int]:
    """Sound blocks of a number, by their size, and how many are damaged."""
    at = starts(source.data, _SYNC)
    stream = np.frombuffer(source.data, dtype=np.uint8)
    at = at[at <= len(stream) - 12]
    kind = (stream[at + 4] + 256 * stream[at + 5].astype(np.int64)) & 0x1FFF
    size = stream[at + 6] + 256 * stream[at + 7].astype(np.int64)
    found, damaged = [], 0
    for length in np.unique(size[kind == number]).tolist():
        mine = at[(kind == number) & (size == length)]
        good = [rows for _, rows in sound_messages(source.data, mine, length, _sound)] if length >= 14 else []
        damaged += len(mine) - sum(map(len, good))
        found += good
    return found, damaged


def _read_blocks(source: Source) -> tuple[dict[str, _Rows], int]:
    found, total = {}, 0
    for key, (number, layout) in _BLOCKS.items():
        rows, damaged = _find(source, number)
        long = [as_records(each, layout) for each in rows if each.shape[1] >= layout.itemsize]
        found[key] = np.concatenate([np.empty(0, dtype=layout), *long])
        total += damaged
    return found, total


def _key(rows: _Rows) -> FloatArray:
    """Time since 1980, to join blocks by [ms]."""
    return np.asarray(rows["week"] * (1e3 * WEEK) + rows["tow"], dtype=np.float64)


def _good(rows: _Rows, fields: tuple[str, ...], notes: list[str]) -> NDArray[np.bool_]:
    good = np.isin(rows["mode"] & 15, list(_MODES)) & (rows["error"] == 0) & (rows["week"] < 65_535)
    for each in fields:
        good &= rows[each] > _UNKNOWN
    if not good.all():
        notes.append(f"{int((~good).sum())} of {len(good)} epochs have no fix: left out")
    return np.asarray(good)


def _clock(rows: _Rows) -> tuple[FloatArray, str]:
    return seconds_of_week(WEEK_DAYS * rows["week"].astype(np.float64), 1e-3 * rows["tow"].astype(np.float64))


def _fix(rows: _Rows) -> FloatArray:
    return np.array([_MODES[int(each)] for each in rows["mode"] & 15])


def _matrices(rows: _Rows, axes: str) -> FloatArray:
    """Covariances (n, 3, 3)."""
    found = np.empty((len(rows), 3, 3))
    for i, first in enumerate(axes):
        for j, second in enumerate(axes):
            pair = first + second
            found[:, i, j] = rows[pair if pair in (rows.dtype.names or ()) else pair[::-1]]
    return found


def _geodetic(source: Source, blocks: Mapping[str, _Rows], notes: list[str]) -> Table:
    rows = blocks["geodetic"]
    rows = rows[_good(rows, ("lat", "lon", "height"), notes)]
    time, note = _clock(rows)
    columns = {"time_s": time, "lat_deg": rows["lat"] / DEG, "lon_deg": rows["lon"] / DEG, "height_m": rows["height"]}
    v = np.column_stack([rows["vn"], rows["ve"], -rows["vu"]]).astype(np.float64)
    columns |= triad(("vn_m_s", "ve_m_s", "vd_m_s"), np.where(np.abs(v) < -_UNKNOWN, v, np.nan))
    for kind, names in (("position", "sd_{}_m"), ("velocity", "sd_v{}_m_s")):
        other = blocks[f"geodetic {kind}"]
        if len(other):
            variance = np.column_stack([other[each] for each in ("nn", "ee", "uu")]).astype(np.float64)
            columns |= deviations(joined(_key(rows), _key(other), np.sqrt(np.maximum(variance, 0.0))), names)
    columns["fix"] = _fix(rows)
    return column_table(source, columns, [note, *notes], row="PVTGeodetic")


def _cartesian(source: Source, blocks: Mapping[str, _Rows], notes: list[str]) -> Table:
    rows = blocks["cartesian"]
    rows = rows[_good(rows, ("x", "y", "z"), notes)]
    r = np.column_stack([rows["x"], rows["y"], rows["z"]])
    near = (np.linalg.norm(r, axis=1) > 6.3e6) & (np.linalg.norm(r, axis=1) < 6.5e6)
    rows, r = rows[near], r[near]
    time, note = _clock(rows)
    lla = lla_from_earth(r) if len(r) else np.empty((0, 3))
    columns = {"time_s": time, "lat_deg": lla[:, 0] / DEG, "lon_deg": lla[:, 1] / DEG, "height_m": lla[:, 2]}
    v = np.column_stack([rows["vx"], rows["vy"], rows["vz"]]).astype(np.float64)
    v = np.where(np.abs(v) < -_UNKNOWN, v, np.nan)
    turn = np.swapaxes(dcm_from_quat(quat_earth_from_level(lla)), 1, 2) if len(r) else np.empty((0, 3, 3))
    columns |= triad(("vn_m_s", "ve_m_s", "vd_m_s"), np.einsum("nij,nj->ni", turn, v))
    for kind, names in (("position", "sd_{}_m"), ("velocity", "sd_v{}_m_s")):
        other = blocks[f"cartesian {kind}"]
        if len(other) and len(r):
            covariance = joined(_key(rows), _key(other), _matrices(other, "xyz"))
            columns |= deviations(level_covariance(covariance, lla), names)
    columns["fix"] = _fix(rows)
    return column_table(source, columns, [note, *notes], row="PVTCartesian")


def _samples(source: Source, week: float | None, notes: list[str]) -> Table | None:
    """Accelerations (type 0) and angular rates (type 1) of ExtSensorMeas, at the times of the rates."""
    parts: dict[int, list[tuple[FloatArray, FloatArray]]] = {0: [], 1: []}
    head = np.dtype([*_HEADER, ("n", "u1"), ("size", "u1")])
    for rows in _find(source, _SENSORS)[0]:
        heads = as_records(rows, head)
        for size in np.unique(heads["size"]).tolist():
            for place in (
                range(head.itemsize, rows.shape[1] - size + 1, max(size, 1)) if size >= _SENSOR.itemsize else ()
            ):
                there = (heads["size"] == size) & (heads["n"] > (place - head.itemsize) // size)
                sensors = as_records(rows[there][:, place:], _SENSOR)
                for kind, found in parts.items():
                    mine = (sensors["type"] == kind) & (sensors["value"] > _UNKNOWN).all(axis=1)
                    found.append((_key(heads[there][mine]), sensors["value"][mine]))
    sorted_parts = {}
    for kind, found in parts.items():
        time = np.concatenate([np.empty(0), *(each[0] for each in found)])
        order = np.argsort(time, kind="stable")
        sorted_parts[kind] = (time[order], np.concatenate([np.empty((0, 3)), *(each[1] for each in found)])[order])
    (force_time, force), (time, rate) = sorted_parts[0], sorted_parts[1]
    if not len(force) or not len(rate):
        return None
    first = week if week is not None else float(time[0] // (1e3 * WEEK))
    columns = {"time_s": 1e-3 * (time - first * (1e3 * WEEK)), **triad(GYRO, rate * DEG)}
    columns |= {key: at_times(time, force_time, force[:, i]) for i, key in enumerate(ACCEL)}
    axes = up_or_down(columns[ACCEL[2]], "FLU")
    return column_table(
        source, columns, [f"times are seconds of GPS week {first:.0f}", *notes], row="sample", axes=axes
    )
