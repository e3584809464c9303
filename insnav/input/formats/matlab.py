"""MATLAB ``.mat`` files, version 5 and 7.3: NaveGo structures and PSINS arrays.

NaveGo: ``imu.t, imu.wb [rad/s], imu.fb [m/s^2]``; ``gnss.t, lat, lon [rad], h, vel, stdm, stdv``; ``ref`` with roll,
pitch, yaw [rad]. PSINS: ``imu`` (n, 7): increments of angle [rad] and velocity [m/s], time; axes Right, Forward, Up.
``gps`` (n, 4): latitude, longitude [rad], height, time. ``gps`` (n, 7): velocity East, North, Up, then these four.
``avp`` (n, 10): attitude, velocity, position, time.

References
----------
Gonzalez, R., NaveGo 1.4, navego_*.m; Yan, G., PSINS toolbox, imuplot.m, gpsplot.m, avpset.m.
"""

from __future__ import annotations

import io
import math
import re
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import (
    ACCEL,
    ATTITUDE,
    DTHETA,
    DVEL,
    GYRO,
    PLACE,
    VELOCITY,
    damaged,
    deviations,
    triad,
)
from insnav.input.formats.source import Source, refuse_bomb
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray
from insnav.units import DEG

name = "MATLAB file"
suffixes = (".mat",)
extra = "mat"

_INT32, _MATRIX, _COMPRESSED = 5, 14, 15  # type numbers of data elements (MAT-File Format, table 1-1)
_PIECE = 1 << 22
_OBJECT = 1 << 10  # overhead per array or structure [bytes]; a small file may refer to one array many times
_HDF5 = b"\x89HDF\r\n\x1a\n"
_Tree = dict[str, Any]  # content of a file: arrays of numbers and nested structures, by name


def recognise(source: Source) -> bool:
    head = source.head
    return head.startswith(b"MATLAB 5.0") or head.startswith(b"MATLAB 7.3") or head.startswith(_HDF5)


def read(source: Source) -> Mapping[str, Table]:
    old = source.head.startswith(b"MATLAB 5.0")
    with damaged("format.matlab_damaged", source, version="" if old else "7.3 / HDF5"):
        tree = _version_5(source) if old else _version_7(source)
    tables: dict[str, Table] = {}
    with damaged("format.matlab_fields", source), np.errstate(all="ignore"):  # values out of range are refused later
        # each variable by its name; the arrays at the top level together may also be one structure
        whole = {key: value for key, value in tree.items() if not isinstance(value, dict)}
        for key, value in [*tree.items(), ("", whole)]:
            part, table = _table(source, key, value)
            if table is not None:
                tables.setdefault(part, table)
    if not tables:
        raise InputError("format.matlab_no_data", where=source.name, variables=plain_text(", ".join(tree)[:200]))
    return tables


def _version_5(source: Source) -> _Tree:
    from scipy.io import loadmat

    content = _inflated(source)
    refuse_bomb(source.name, "MATLAB", len(source.data), _size(content, 128, len(content), source.name))
    found = loadmat(io.BytesIO(content), squeeze_me=True, struct_as_record=False)
    return {key: _plain(value) for key, value in found.items() if not key.startswith("__")}


def _inflated(source: Source) -> bytes:
    """Return the file with decompressed arrays."""
    data, start, pieces = source.data, 128, [source.data[:128]]
    size = len(data)
    while start + 8 <= len(data):
        kind, length = struct.unpack("<II", data[start : start + 8])
        end = start + 8 + (length if kind == _COMPRESSED else (length + 7) // 8 * 8)
        if kind != _COMPRESSED:
            pieces.append(data[start:end])
        else:
            decompressor, compressed = zlib.decompressobj(), data[start + 8 : end]
            while compressed and not decompressor.eof:
                pieces.append(decompressor.decompress(compressed, _PIECE))
                compressed = decompressor.unconsumed_tail
                size += len(pieces[-1])
                refuse_bomb(source.name, "MATLAB", len(data), size)
        start = end
    return b"".join(pieces)


def _size(data: bytes, start: int, end: int, name: str) -> int:
    """Compute the memory size of the arrays in a part of a file.

    Raises: InputError: an array exceeds its part of the file; scipy hangs on some such arrays.
    """
    size = 0
    while start + 8 <= end:
        kind, length = struct.unpack("<II", data[start : start + 8])
        if kind >> 16:  # a small element, with its content in the tag
            start += 8
            continue
        first, last = start + 8, start + 8 + length
        fits = last <= end
        if fits and kind == _MATRIX and length:
            dims_kind, dims_size = struct.unpack("<II", (data[first + 16 : first + 24] + bytes(8))[:8])
            dims = data[first + 24 : first + 24 + dims_size]
            fits = dims_kind == _INT32 and dims_size <= 32 and len(dims) % 4 == 0
            count = math.prod(struct.unpack(f"<{len(dims) // 4}I", dims)) if fits else 0
            fits &= count <= length
            size += 8 * count + _size(data, first, last, name)
        if not fits:
            raise InputError("format.matlab_cut", where=name)
        start = first + (length + 7) // 8 * 8
    return size


def _plain(value: Any) -> Any:
    names = getattr(value, "_fieldnames", None)
    return value if names is None else {key: _plain(getattr(value, key)) for key in names}


def _version_7(source: Source) -> _Tree:
    import h5py

    size = 0

    def of(group: Any) -> _Tree:
        nonlocal size
        tree = {}
        for key, item in group.items():
            if not key.startswith("#"):
                size += _OBJECT + (0 if isinstance(item, h5py.Group) else item.size * item.dtype.itemsize)
                refuse_bomb(source.name, "MATLAB", len(source.data), size)
                tree[key] = of(item) if isinstance(item, h5py.Group) else np.squeeze(np.asarray(item).T)
        return tree

    with h5py.File(io.BytesIO(source.data[:]), "r") as file:
        return of(file)


def _table(source: Source, key: str, value: Any) -> tuple[str, Table | None]:
    if isinstance(value, dict):
        numbers = {name: np.asarray(v, dtype=np.float64) for name, v in value.items() if _is_numbers(v)}
        return _navego(source, key, numbers) if "t" in numbers else ("", None)
    if _is_numbers(value) and np.ndim(value) == 2:
        return _psins(source, key, np.asarray(value, dtype=np.float64))
    return "", None


def _is_numbers(value: Any) -> bool:
    return getattr(value, "dtype", np.dtype("O")).kind in "fiu"


def _navego(source: Source, key: str, data: Mapping[str, FloatArray]) -> tuple[str, Table | None]:
    time = np.atleast_1d(data["t"])
    n = len(time)
    note = [Finding.of(Code.READ_CONVENTION, subject=plain_text(key), convention="NaveGo", unit="rad")]
    if {"wb", "fb"} <= set(data) and data["wb"].shape == data["fb"].shape == (n, 3):
        columns = {"time_s": time, **triad(GYRO, data["wb"]), **triad(ACCEL, data["fb"])}
        return "imu", column_table(source, columns, note, axes="FRD")
    if not {"lat", "lon", "h"} <= set(data) or any(data[name].shape != (n,) for name in ("lat", "lon", "h")):
        return "", None
    place = np.column_stack([data[name] for name in ("lat", "lon", "h")]) / [DEG, DEG, 1.0]
    columns = {"time_s": time, **triad(PLACE, place)}
    if data.get("vel", np.empty(0)).shape == (n, 3):
        columns |= triad(VELOCITY, data["vel"])
    for name, header in (("stdm", "sd_{}_m"), ("stdv", "sd_v{}_m_s")):
        if data.get(name, np.empty(0)).shape == (3,):
            columns |= deviations(np.tile(np.abs(data[name]), (n, 1)), header)
    attitude = [data.get(name, np.empty(0)) for name in ("roll", "pitch", "yaw")]
    if all(column.shape == (n,) for column in attitude):
        columns |= triad(ATTITUDE, np.column_stack(attitude) / DEG)
        return "reference", column_table(source, columns, note)
    return "gps", column_table(source, columns, note)


def _psins(source: Source, key: str, rows: FloatArray) -> tuple[str, Table | None]:
    """Convert a PSINS array, by its name and number of columns; the time is in the last column."""
    width, time = rows.shape[1], rows[:, -1]
    note = [Finding.of(Code.READ_CONVENTION, subject=plain_text(key), convention="PSINS", unit="rad", axes="RFU")]
    if re.match(r"imu", key, re.I) and width == 7:
        columns = {"time_s": time, **triad(DTHETA, rows[:, :3]), **triad(DVEL, rows[:, 3:6])}
        return "imu", column_table(source, columns, note, axes="RFU")
    if re.match(r"gps|gnss", key, re.I) and width in (4, 7):
        place = rows[:, width - 4 : width - 1] / [DEG, DEG, 1.0]
        columns = {"time_s": time, **triad(PLACE, place)}
        if width == 7:
            columns |= triad(VELOCITY, rows[:, [1, 0, 2]] * [1.0, 1.0, -1.0])
        return "gps", column_table(source, columns, note)
    if re.match(r"avp", key, re.I) and width == 10:
        columns = {"time_s": time, **triad(PLACE, rows[:, 6:9] / [DEG, DEG, 1.0])}
        columns |= triad(VELOCITY, rows[:, [4, 3, 5]] * [1.0, 1.0, -1.0])
        pitch, roll, yaw = rows[:, :3].T / DEG  # PSINS yaw is positive from North to West
        columns |= triad(ATTITUDE, np.column_stack([roll, pitch, -yaw % 360.0]))
        return "reference", column_table(source, columns, note)
    return "", None
