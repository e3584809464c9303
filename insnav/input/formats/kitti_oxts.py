"""KITTI ``oxts`` folders and archives: one text file per epoch, and ``timestamps.txt``.

References
----------
Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 32(11), 2013; dataformat.txt of the raw data.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError, reason_of
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import ACCEL, ATTITUDE, GYRO, MSL_PLACE, VELOCITY, deviations, triad
from insnav.input.formats.source import Source, digest_of
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray
from insnav.units import DEG

name = "KITTI oxts folder"

_EPOCH = re.compile(r"^(?P<folder>(?:.*/)?)data/\d{10}\.txt$")
_TIME = re.compile(rb"^(\d{4}-\d\d-\d\d) (\d\d:\d\d:\d\d(?:\.\d{1,9})?)\s*$", re.M)
_NUMBERS = 30
_VERTICAL = np.array([1.0, 1.0, 2.0])  # sd North, East, Down, relative to the accuracy in the file


def recognise(source: Source) -> bool:
    return _folder(source) is not None


def read(source: Source) -> Mapping[str, Table]:
    folder = _folder(source)
    assert folder is not None
    stamps = source.members[f"{folder}timestamps.txt"]()
    names = sorted(path for path in source.members if path.startswith(f"{folder}data/") and _EPOCH.match(path))
    epochs = [source.members[path]() for path in names]
    rows = np.array([_numbers(epoch) for epoch in epochs])
    time = _times(stamps)
    if len(time) != len(rows):
        raise InputError("format.kitti_count", where=stamps.name, times=len(time), epochs=len(rows))
    whole = Source(source.name, digest_of([stamps, *epochs]))
    fixes = {"time_s": time, **triad(MSL_PLACE, rows[:, :3])}
    fixes |= triad(VELOCITY, rows[:, [6, 7, 10]] * [1.0, 1.0, -1.0])
    fixes |= deviations(rows[:, [23, 23, 23]] * _VERTICAL, "sd_{}_m") | deviations(rows[:, [24, 24, 24]], "sd_v{}_m_s")
    roll, pitch, yaw = rows[:, 3:6].T / DEG  # attitude of Forward-Left-Up axes in East-North-Up axes [deg]
    attitude = triad(ATTITUDE, np.column_stack([roll, -pitch, (90.0 - yaw) % 360.0]))
    samples = {"time_s": time, **triad(GYRO, rows[:, 17:20]), **triad(ACCEL, rows[:, 11:14])}
    clock, fused = Finding.of(Code.READ_TIME_LOCAL), Finding.of(Code.READ_FUSED)
    return {
        "imu": column_table(whole, samples, [clock], row="epoch", axes="FLU"),
        "gps": column_table(whole, fixes, [clock, fused], row="epoch"),
        "reference": column_table(whole, fixes | attitude, [clock, fused], row="epoch"),
    }


def _folder(source: Source) -> str | None:
    """Find the folder of epochs; folders of other sensors of the data set may be next to it."""
    folders = {match["folder"] for path in source.members if (match := _EPOCH.match(path))}
    with_times = [path for path in folders if f"{path}timestamps.txt" in source.members and "velodyne" not in path]
    return min(with_times, key=len) if with_times else None


def _numbers(epoch: Source) -> list[float]:
    try:
        numbers = [float(word) for word in epoch.data[:2000].split()]
    except ValueError:
        numbers = []
    if len(numbers) != _NUMBERS or not np.isfinite(numbers).all():
        text = plain_text(epoch.head[:60])
        raise InputError("format.kitti_epoch", where=epoch.name, count=_NUMBERS, text=text)
    return numbers


def _times(stamps: Source) -> FloatArray:
    """Read the times of the epochs ``(n,)`` in seconds since 1970, in the time zone of the file."""
    matches = [match.groups() for match in _TIME.finditer(stamps.data)]
    try:
        instants = np.array([f"{day.decode()}T{clock.decode()}" for day, clock in matches], dtype="datetime64[ns]")
    except ValueError as error:
        raise InputError("format.kitti_time", where=stamps.name, reason=plain_text(reason_of(error))) from error
    return np.asarray(instants.astype(np.int64) * 1e-9, dtype=np.float64)
