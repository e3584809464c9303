"""ROS 1 bags, ROS 2 bags (sqlite3, MCAP) and MCAP files: Imu, NavSatFix, and velocity topics.

References
----------
ROS sensor_msgs and geometry_msgs, noetic and humble; REP-103 (axes); OMG CDR as in DDS-XTypes 1.3, 7.4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.attitude import dcm_from_quat, quat_from_dcm, rph_from_quat
from insnav.earth import earth_from_lla, level_from_earth, lla_from_earth
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import conventions
from insnav.input.formats.messages import joined
from insnav.input.formats.source import Source, digest_of, on_disk
from insnav.input.formats.table import Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray
from insnav.units import DEG

name = "ROS bag"
suffixes = (".bag", ".db3", ".mcap")
extra = "ros"

_MAGIC = {b"#ROSBAG V2.0": ".bag", b"SQLite format 3": ".db3", b"\x89MCAP0\r\n": ".mcap"}
_BLOCK = 20_000  # number of messages that are decoded together
_FLU = np.array([1.0, -1.0, -1.0])
_FEW, _APART = 10, 1.0  # least number of fixes that locate odometry on Earth; largest RMS distance [m]
_STATUS = {0: 5.0, 1: 4.0, 2: 4.0}  # NavSatStatus -> fix type; covariances give the accuracy of differential fixes


@dataclass(frozen=True, slots=True)
class _Kind:
    """Layout of a message after its header: count of doubles, and the text or status that precedes them."""

    numbers: int
    status: bool = False
    name: bool = False


_KINDS = {
    "sensor_msgs/msg/Imu": _Kind(37),
    "sensor_msgs/msg/NavSatFix": _Kind(12, status=True),
    "geometry_msgs/msg/TwistStamped": _Kind(6),
    "geometry_msgs/msg/TwistWithCovarianceStamped": _Kind(42),
    "nav_msgs/msg/Odometry": _Kind(85, name=True),
}


@dataclass(slots=True)
class _Topic:
    """Decoded messages of a topic, in blocks."""

    kind: str
    ros2: bool
    pending: list[tuple[int, bytes]] = field(default_factory=list)
    blocks: list[FloatArray] = field(default_factory=list)  # header time, bag time, status, covariance type, numbers
    listed: int = 0  # number of messages in the bag's index

    def add(self, time: int, raw: bytes) -> None:
        self.pending.append((time, raw))
        if len(self.pending) >= _BLOCK:
            self.decode()

    def decode(self) -> None:
        by_size: dict[int, list[int]] = {}
        for row, (_, raw) in enumerate(self.pending):
            by_size.setdefault(len(raw), []).append(row)
        decoded = np.full((len(self.pending), 4 + _KINDS[self.kind].numbers), np.nan)
        for size, rows in by_size.items():
            data = np.frombuffer(b"".join(self.pending[row][1] for row in rows), dtype=np.uint8).reshape(-1, size)
            decoded[rows] = _decoded(data, _KINDS[self.kind], self.ros2)
        decoded[:, 1] = [time * 1e-9 for time, _ in self.pending]
        self.blocks.append(decoded[np.isfinite(decoded[:, 0])])
        self.pending.clear()

    def table(self) -> FloatArray:
        """Return all messages as rows: header time [s], bag time [s], status, covariance type, numbers."""
        self.decode()
        return np.concatenate(self.blocks)


def recognise(source: Source) -> bool:
    return bool(_suffix(source)) or bool(_bags(source))


def read(source: Source) -> Mapping[str, Table]:
    topics: dict[str, _Topic] = {}
    others: set[str] = set()
    with conventions.damaged("format.bag_damaged", source):
        for reader, ros2 in _readers(source):
            wanted = [each for each in reader.connections if each.msgtype in _KINDS]
            others |= {f"{each.topic} ({each.msgtype})" for each in reader.connections if each.msgtype not in _KINDS}
            for connection in wanted:
                topics.setdefault(connection.topic, _Topic(connection.msgtype, ros2)).listed += connection.msgcount
            for connection, time, raw in reader.messages(connections=wanted) if wanted else ():
                topics[connection.topic].add(time, bytes(raw))
    if source.members:
        whole = [source.members[path]() for path in _bags(source)]
        source = Source(source.name, digest_of(whole))
    topics = {key: topic for key, topic in topics.items() if topic.blocks or topic.pending}
    tables: dict[str, Table] = {}
    velocities = {key: topic.table() for key, topic in topics.items() if "Twist" in topic.kind}
    for key, topic in topics.items():
        name = plain_text(key)
        notes, rows = [Finding.of(Code.READ_SOURCE, subject=name)], topic.table()
        if (lost := topic.listed - len(rows)) > 0:
            notes.append(Finding.of(Code.READ_ROWS_UNREADABLE, subject=name, count=lost, of=topic.listed))
        if topic.kind.endswith("Imu"):
            tables[f"imu:{name}"] = _samples(source, rows, notes)
        elif topic.kind.endswith("NavSatFix"):
            tables[f"gps:{name}"] = _fixes(source, rows, velocities, notes)
    fixes = next((table for part, table in tables.items() if part.startswith("gps:")), None)
    for key, topic in topics.items() if fixes is not None else ():
        if topic.kind.endswith("Odometry") and fixes is not None:
            reference, note = _laid_on(source, topic.table(), fixes, plain_text(key))
            if reference is not None:
                tables[f"reference:{plain_text(key)}"] = reference
            tables = {part: replace(table, notes=(*table.notes, note)) for part, table in tables.items()}
    if not tables:
        found = tuple(map(plain_text, sorted(others)[:12]))
        raise InputError("format.bag_no_data", where=source.name, found=found)
    return tables


def _suffix(source: Source) -> str:
    head = source.head
    return next((suffix for magic, suffix in _MAGIC.items() if head.startswith(magic)), "")


def _bags(source: Source) -> list[str]:
    """List the bags in a folder and its direct subfolders."""
    return [path for path in source.members if PurePosixPath(path).suffix in suffixes and path.count("/") < 2]


def _readers(source: Source) -> Iterator[tuple[Any, bool]]:
    """Yield open readers of all bags, and whether each is a ROS 2 bag."""
    from rosbags import rosbag1, rosbag2

    with ExitStack() as stack:
        place = stack.enter_context(on_disk(source, _suffix(source)))
        paths: list[Path] = [place]
        if source.members:
            described = [place / member for member in source.members if PurePosixPath(member).name == "metadata.yaml"]
            paths = [each.parent for each in described] or [place / each for each in _bags(source)]
        for path in paths:
            ros2 = path.is_dir() or path.suffix != ".bag"
            with rosbag2.Reader(path) if ros2 else rosbag1.Reader(path) as reader:
                yield reader, ros2


def _decoded(data: NDArray[np.uint8], kind: _Kind, ros2: bool) -> FloatArray:
    """Decode messages ``(n, size)`` of one size to rows; a message of another layout has the time ``NaN``."""
    decoded = np.full((len(data), 4 + kind.numbers), np.nan)
    # the first four bytes are the encoding in CDR, the sequence number in ROS 1
    if data.shape[1] < 24 or (ros2 and (data[:, :2] != [0, 1]).any()):
        return decoded
    words = np.ascontiguousarray(data[:, 4:16]).view("<u4").astype(np.int64)
    groups = _behind_text(data, [(np.arange(len(data)), 12)], ros2)
    for rows, status_at in _behind_text(data, groups, ros2) if kind.name else groups:
        # NavSatStatus: one byte of status, two bytes of constellations
        numbers_at = status_at + (3 if kind.status else 0)
        if ros2:  # CDR aligns each number to its size, counted from byte four
            offset = status_at - 4
            offset = (offset + 2) // 2 * 2 + 2 if kind.status else offset
            numbers_at = 4 + (offset + 7) // 8 * 8
        end = numbers_at + 8 * kind.numbers
        if end + kind.status > data.shape[1]:
            continue
        decoded[rows, 0] = words[rows, 0] + 1e-9 * words[rows, 1]
        decoded[rows, 4:] = np.ascontiguousarray(data[rows, numbers_at:end]).view("<f8")
        if kind.status:
            decoded[rows, 2] = data[rows, status_at].view(np.int8)
            decoded[rows, 3] = data[rows, end]
    return decoded


def _behind_text(
    data: NDArray[np.uint8], groups: list[tuple[NDArray[np.int64], int]], ros2: bool
) -> list[tuple[NDArray[np.int64], int]]:
    """Group messages by the length of the text at a position; return their rows and the position after the text."""
    result = []
    for rows, at in groups:
        at = 4 + (at - 1) // 4 * 4 if ros2 else at
        if at + 4 > data.shape[1]:
            continue
        lengths = np.ascontiguousarray(data[rows, at : at + 4]).view("<u4")[:, 0].astype(np.int64)
        result += [(rows[lengths == length], at + 4 + length) for length in np.unique(lengths).tolist()]
    return result


def _times(table: FloatArray, notes: list[Finding]) -> FloatArray:
    if (table[:, 0] > 0.0).all():
        return table[:, 0]
    notes.append(Finding.of(Code.READ_TIME_OF_RECORDER))
    return table[:, 1]


def _samples(source: Source, table: FloatArray, notes: list[Finding]) -> Table:
    columns = {"time_s": _times(table, notes)}
    # four columns of times and status, quaternion (4), covariance (9), rates (3), covariance (9), forces (3)
    rates, forces = table[:, 8 + 9 : 8 + 9 + 3], table[:, 8 + 9 + 3 + 9 : 8 + 9 + 3 + 9 + 3]
    columns |= conventions.triad(conventions.GYRO, rates) | conventions.triad(conventions.ACCEL, forces)
    axes = conventions.up_or_down(forces[:, 2], "FLU")
    if axes != "FLU":
        notes.append(Finding.of(Code.READ_IMU_Z_DOWN, axes=axes))
    return column_table(source, columns, notes, row="message", axes=axes)


def _fixes(source: Source, table: FloatArray, velocities: Mapping[str, FloatArray], notes: list[Finding]) -> Table:
    columns = {"time_s": _times(table, notes), **conventions.triad(conventions.PLACE, table[:, 4:7])}
    known = table[:, 3] > 0.0
    if known.any():
        with np.errstate(invalid="ignore"):  # columns 7, 11, 15: variances East, North, Up
            sd = np.where(known[:, None], np.sqrt(table[:, [11, 7, 15]]), np.nan)
        columns |= conventions.deviations(sd, "sd_{}_m")
        if (table[known, 3] == 1.0).any():
            notes.append(Finding.of(Code.READ_SD_APPROXIMATE))
    for key, speeds in velocities.items():
        v = joined(table[:, 0], speeds[:, 0], speeds[:, 4:7])
        if np.isfinite(v[:, 0]).sum() > 0.9 * len(v):
            columns |= conventions.triad(conventions.VELOCITY, v[:, [1, 0, 2]] * [1.0, 1.0, -1.0])
            notes.append(Finding.of(Code.READ_VELOCITY_TOPIC, subject=plain_text(key)))
            break
    return conventions.fix_table(source, columns, table[:, 2], _STATUS, notes, row="messages")


def _laid_on(source: Source, table: FloatArray, fixes: Table, topic: str) -> tuple[Table | None, Finding]:
    """Rotate and shift odometry to fit the fixes; return it as a reference, with a finding.

    The reference is None if the odometry drifts away from the fixes, like wheel odometry.
    """
    time, lat, lon, height = fixes.cells.read(range(4)).columns.values()
    origin = np.array([[lat[0] * DEG, lon[0] * DEG, height[0]]])
    to_earth = level_from_earth(origin)[0].T
    fix_ned = (earth_from_lla(np.column_stack([lat * DEG, lon * DEG, height])) - earth_from_lla(origin)) @ to_earth
    order = np.argsort(table[:, 0], kind="stable")
    stamp, numbers = table[order, 0], table[order, 4:]
    inside = (time >= stamp[0]) & (time <= stamp[-1])
    common = int(np.count_nonzero(inside))
    if common < _FEW or not np.isfinite(numbers).all():
        return None, Finding.of(Code.READ_ODOMETRY_SHORT, subject=topic, count=common, limit_count=_FEW)
    odometry = np.column_stack([np.interp(time[inside], stamp, numbers[:, i]) for i in range(3)])
    # complex numbers east + i north, which a factor rotates
    fix_plane, odometry_plane = fix_ned[inside, 1] + 1j * fix_ned[inside, 0], odometry[:, 0] + 1j * odometry[:, 1]
    turn = np.angle(np.sum(np.conj(odometry_plane - odometry_plane.mean()) * (fix_plane - fix_plane.mean())))
    shift = fix_plane.mean() - np.exp(1j * turn) * odometry_plane.mean()
    distance = float(np.sqrt(np.mean(np.abs(np.exp(1j * turn) * odometry_plane + shift - fix_plane) ** 2)))
    if distance > _APART:
        return None, Finding.of(Code.READ_ODOMETRY_APART, subject=topic, distance_m=distance, limit_m=_APART)
    place = np.exp(1j * turn) * (numbers[:, 0] + 1j * numbers[:, 1]) + shift
    down = fix_ned[inside, 2].mean() + odometry[:, 2].mean() - numbers[:, 2]
    lla = lla_from_earth(earth_from_lla(origin) + np.column_stack([place.imag, place.real, down]) @ to_earth.T)
    columns = {"time_s": stamp, **conventions.triad(conventions.PLACE, lla / [DEG, DEG, 1.0])}
    if (np.abs(np.linalg.norm(numbers[:, 3:7], axis=1) - 1.0) < 0.1).all():
        c, s = np.cos(turn), np.sin(turn)
        to_ned = np.array([[s, c, 0.0], [c, -s, 0.0], [0.0, 0.0, -1.0]])  # from odometry axes to North, East, Down
        level = level_from_earth(lla) @ to_earth
        c_nb = level @ to_ned @ dcm_from_quat(numbers[:, [6, 3, 4, 5]]) @ np.diag(_FLU)
        rph = rph_from_quat(quat_from_dcm(c_nb)) / DEG
        columns |= conventions.triad(conventions.VELOCITY, np.einsum("nij,nj->ni", c_nb, numbers[:, 43:46] * _FLU))
        columns |= conventions.triad(conventions.ATTITUDE, np.column_stack([rph[:, :2], rph[:, 2] % 360.0]))
    note = Finding.of(Code.READ_ODOMETRY_PLACED, subject=topic, distance_m=distance, limit_m=_APART, angle_rad=-turn)
    return column_table(source, columns, [note], row="message"), note
