"""u-blox UBX logs, alone or mixed with NMEA: fixes (NAV-…) and samples of the receiver's own IMU (ESF-…).

References
----------
u-blox F9 HPG 1.32 Interface Description, UBX-22008968; ZED-F9R Integration Manual, UBX-20039643 (ESF-MEAS data types).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import conventions, nmea
from insnav.input.formats.messages import Framing, Messages, at_times, joined, layout
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK, WEEK_DAYS, GpsTime, gps_days, leap_seconds, seconds_of_week
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG

name = "u-blox log"
suffixes = (".ubx",)

_DATE = "year:u2 month:u1 day:u1 hour:u1 min:u1 sec:u1"
_PLACE = "lon:i4 lat:i4 height:i4 hMSL:i4 hAcc:u4 vAcc:u4"
_SPEED = "velN:i4 velE:i4 velD:i4 gSpeed:i4"
_STATE = "tAcc:u4 nano:i4 fixType:u1 flags:u1 flags2:u1 numSV:u1"
_COVARIANCES = " ".join(f"{kind}{pair}:f4" for kind in ("pos", "vel") for pair in ("NN", "NE", "ND", "EE", "ED", "DD"))
# message -> class and number as one number, and the fields that are read
_LAYOUTS: dict[str, tuple[int, np.dtype[Any]]] = {
    "PVT": (0x0701, layout(f"iTOW:u4 {_DATE} valid:u1 {_STATE} {_PLACE} {_SPEED} headMot:i4 sAcc:u4 r1:u4 pDOP:u2")),
    "PVAT": (
        0x1701,
        layout(
            f"iTOW:u4 version:u1 valid:u1 {_DATE} r0:u1 r1:u2 {_STATE} {_PLACE} {_SPEED} sAcc:u4 roll:i4 pitch:i4 "
            "heading:i4"
        ),
    ),
    "POSLLH": (0x0201, layout(f"iTOW:u4 {_PLACE}")),
    "HPPOSLLH": (
        0x1401,
        layout(
            "version:u1 r0:u1 r1:u1 flags:u1 iTOW:u4 lon:i4 lat:i4 height:i4 hMSL:i4 lonHp:i1 latHp:i1 heightHp:i1 "
            "hMSLHp:i1 hAcc:u4 vAcc:u4"
        ),
    ),
    "VELNED": (0x1201, layout("iTOW:u4 velN:i4 velE:i4 velD:i4 speed:u4 gSpeed:u4 heading:i4 sAcc:u4")),
    "COV": (0x3601, layout(f"iTOW:u4 version:u1 posValid:u1 velValid:u1 r0:u1 r1:u4 r2:u4 {_COVARIANCES}")),
    "SOL": (0x0601, layout("iTOW:u4 fTOW:i4 week:i2 fixType:u1 flags:u1")),
    "TIMEGPS": (0x2001, layout("iTOW:u4 fTOW:i4 week:i2 leapS:i1 valid:u1")),
}
_RECEPTION = ("satellites", "numSV", 1.0), ("dop", "pDOP", 0.01)
_MEAS, _RAW = 0x0210, 0x0310
_GYRO_TYPES, _ACCEL_TYPES, _TEMPERATURE = (14, 13, 5), (16, 17, 18), 12  # sensor types along x, y, z; temperature
_SCALES = {**dict.fromkeys(_GYRO_TYPES, DEG / 4096.0), **dict.fromkeys(_ACCEL_TYPES, 1.0 / 1024.0), _TEMPERATURE: 0.01}
_NO_FIX = (0, 1, 5)  # fixType: invalid, dead reckoning only, time only
_RAW_TICK = 39.0625e-6  # nominal unit of time tags in ESF-RAW [s]; fixes can correct it
_FEW = 10  # least number of epochs that relate the sensor clock to GPS time
_ORDER_JITTER = 0.1  # uncertainty of times from the message order [s]


@dataclass(slots=True)
class _Found:
    """Messages of one kind in a log."""

    rows: NDArray[Any]  # (n,) records
    at: NDArray[np.int64]  # (n,) positions in the stream

    @property
    def key(self) -> FloatArray:
        """GPS time of the week (n,) [ms]."""
        return self.rows["iTOW"].astype(np.float64)


def recognise(source: Source) -> bool:
    head = source.head
    return _FRAMING.recognise(head) or (
        # the first message is longer than the examined bytes
        len(head) > 8 and head.startswith(b"\xb5b") and 8 + int.from_bytes(head[4:6], "little") > len(head)
    )


def read(source: Source) -> Mapping[str, Table]:
    messages = _FRAMING.find(source.data, [*(number for number, _ in _LAYOUTS.values()), _MEAS, _RAW])
    found = {key: _Found(*messages[number].records(fields, _HEAD)) for key, (number, fields) in _LAYOUTS.items()}
    notes = [
        Finding.of(Code.READ_ROWS_DAMAGED, subject=f"NAV-{key}", count=damaged)
        for key, (number, _) in _LAYOUTS.items()
        if (damaged := messages[number].damaged)
    ]
    tables: dict[str, Table] = {}
    clock = _Clock()
    base = next((key for key in ("PVT", "PVAT", "HPPOSLLH", "POSLLH") if len(found[key].rows)), None)
    if base is not None:
        tables["gps"], clock = _fixes(source, found, base, notes)
    elif nmea.recognise(source):
        tables |= nmea.read(source)
    samples = _samples(source, messages, clock)
    if samples is not None:
        tables["imu"] = samples
    if not tables:
        raise InputError("format.ubx_no_data", where=source.name)
    return tables


@dataclass(frozen=True, slots=True)
class _Clock:
    """Time [s] and stream position of each epoch ``(n,)``, and the GPS week."""

    time: FloatArray = field(default_factory=lambda: np.empty(0))
    at: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    week: float | None = None


def _sound(rows: NDArray[np.uint8]) -> BoolArray:
    """Test the Fletcher checksum of whole messages (n, size)."""
    body = rows[:, 2:-2].astype(np.uint32)
    first = body.sum(axis=1) & 255
    second = (body * np.arange(body.shape[1], 0, -1, dtype=np.uint32)).sum(axis=1) & 255
    return np.asarray((first == rows[:, -2]) & (second == rows[:, -1]))


_HEAD = 6
_FRAMING = Framing(b"\xb5b", number=(2, 0xFFFF), size=(4, 0xFFFF), around=_HEAD + 2, least=_HEAD + 2, sound=_sound)


def _fixes(source: Source, found: Mapping[str, _Found], base: str, notes: list[Finding]) -> tuple[Table, _Clock]:
    main = found[base]
    rows, key = main.rows, main.key
    names = rows.dtype.names or ()
    week = _week(rows) if "year" in names else _joined_week(key, found)
    time, note, first = GpsTime(1e-3 * key, Finding.of(Code.READ_TIME_UNKNOWN_WEEK), None)
    if np.isfinite(week).all():
        time, note, first = seconds_of_week(WEEK_DAYS * week, 1e-3 * key)
    fused = Finding.of(Code.READ_FUSED, fix_type=4) if "heading" in names else None
    columns = {"time_s": time, **_position(rows)}
    hp = found["HPPOSLLH"]
    if base != "HPPOSLLH" and len(hp.rows):
        for column, values in _position(hp.rows).items():
            better = joined(key, hp.key, values)
            columns[column] = np.where(np.isfinite(better), better, columns[column])
    speed = _speed(rows, 1e-3) if "velN" in names else _joined_columns(key, found["VELNED"], _speed, 1e-2)
    columns |= speed
    columns |= {key: by * rows[name] for key, name, by in _RECEPTION if name in names}
    if len(found["COV"].rows):
        for column, values in _joined_columns(key, found["COV"], _covariances).items():
            columns[column] = np.where(np.isfinite(values), values, columns.get(column, np.nan))
    kind, flags = _quality(rows, key, found)
    usable = (flags & 1 == 1) & ~np.isin(kind, _NO_FIX)
    carrier = (flags.astype(np.int64) >> 6) & 3 if base in ("PVT", "PVAT") else np.zeros(len(key), dtype=np.int64)
    kinds = np.select([~usable, carrier == 2, carrier == 1, flags & 2 == 2], [0, 1, 2, 4], 5)
    types, row = {fix: float(fix) for fix in (1, 2, 4, 5)}, f"NAV-{base}"
    table = conventions.fix_table(source, columns, kinds, types, [note, *notes, fused], row=row, week=first)
    return table, _Clock(time, main.at, first)


def _week(rows: NDArray[Any]) -> FloatArray:
    """Compute the GPS week of each epoch from its date; neighbours determine weeks of epochs without a valid date."""
    valid = (rows["valid"] & 1 == 1) & (rows["year"] > 1979) & (rows["month"] >= 1) & (rows["month"] <= 12)
    week = np.full(len(rows), np.nan)
    part = rows[valid]
    day = gps_days(*(part[key].astype(np.float64) for key in ("year", "month", "day")))
    second = 3600.0 * part["hour"] + 60.0 * part["min"] + part["sec"]
    # the time of the week is exact; the date, which is rounded near midnight, identifies only the week
    since = day * 86_400.0 + second + leap_seconds(day, second)
    week[valid] = np.round((since - 1e-3 * part["iTOW"]) / WEEK)
    return _filled(week, rows["iTOW"].astype(np.float64))


def _joined_week(key: FloatArray, found: Mapping[str, _Found]) -> FloatArray:
    week = np.full(len(key), np.nan)
    for kind in ("TIMEGPS", "SOL"):
        rows = found[kind].rows
        week = np.where(np.isfinite(week), week, joined(key, found[kind].key, rows["week"].astype(np.float64)))
    return _filled(np.where(week > 0, week, np.nan), key)


def _filled(week: FloatArray, key: FloatArray) -> FloatArray:
    """Extend known weeks to all epochs ``(n,)``, also across the end of a week."""
    known = np.isfinite(week)
    if not known.any():
        return week
    rollovers = np.concatenate(([0.0], np.cumsum(np.diff(key) < -302_400_000.0)))
    return np.where(known, week, np.median((week - rollovers)[known]) + rollovers)


def _position(rows: NDArray[Any]) -> dict[str, FloatArray]:
    fine = "lonHp" in (rows.dtype.names or ())
    part = {key: 0.01 * rows[f"{key}Hp"] if fine else 0.0 for key in ("lat", "lon")}
    unit = 1e-4 if fine else 1e-3
    columns = {
        "lat_deg": 1e-7 * (rows["lat"] + part["lat"]),
        "lon_deg": 1e-7 * (rows["lon"] + part["lon"]),
        "height_m": 1e-3 * rows["height"] + (1e-4 * rows["heightHp"] if fine else 0.0),
        **conventions.by_accuracy(rows["hAcc"] * unit, rows["vAcc"] * unit),
    }
    if not fine:
        return columns
    valid = rows["flags"] & 1 == 0
    return {key: np.where(valid, values, np.nan) for key, values in columns.items()}


def _speed(rows: NDArray[Any], unit: float) -> dict[str, FloatArray]:
    columns = {f"v{axis}_m_s": unit * rows[f"vel{axis.upper()}"] for axis in "ned"}
    side = unit * rows["sAcc"] / np.sqrt(2.0)  # sAcc: accuracy of the ground speed
    return columns | conventions.deviations(np.column_stack([side] * 3), "sd_v{}_m_s")


def _covariances(rows: NDArray[Any]) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    for kind, names in (("pos", "sd_{}_m"), ("vel", "sd_v{}_m_s")):
        variance = np.column_stack([rows[f"{kind}{axis}"].astype(np.float64) for axis in ("NN", "EE", "DD")])
        found |= conventions.deviations(np.sqrt(np.where(rows[f"{kind}Valid"][:, None] == 1, variance, np.nan)), names)
    return found


def _joined_columns(key: FloatArray, found: _Found, make: Any, *args: float) -> dict[str, FloatArray]:
    if not len(found.rows):
        return {}
    return {column: joined(key, found.key, values) for column, values in make(found.rows, *args).items()}


def _quality(rows: NDArray[Any], key: FloatArray, found: Mapping[str, _Found]) -> tuple[FloatArray, NDArray[Any]]:
    """Return the type and the flags of each fix, from the fix or from the SOL message of its epoch."""
    if "fixType" in (rows.dtype.names or ()):
        return rows["fixType"], rows["flags"]
    kind = joined(key, found["SOL"].key, found["SOL"].rows["fixType"].astype(np.float64))
    flags = joined(key, found["SOL"].key, found["SOL"].rows["flags"].astype(np.float64))
    usable = np.isfinite(kind)
    # a position without quality information counts as valid
    return np.where(usable, kind, 3.0), np.where(usable, flags, 1.0).astype(np.int64)


def _samples(source: Source, messages: Mapping[int, Messages], clock: _Clock) -> Table | None:
    """Read IMU samples of ESF-MEAS, or else of ESF-RAW, with times of the fixes' clock."""
    for number, label in ((_MEAS, "ESF-MEAS"), (_RAW, "ESF-RAW")):
        tag, value, sensor, at = _measurements(messages[number], raw=label == "ESF-RAW")
        columns, tags, places = _sensors(tag, value, sensor, at)
        if columns:
            time, note = _sensor_time(tags, places, clock, raw=label == "ESF-RAW")
            axes = conventions.up_or_down(columns[conventions.ACCEL[2]], "FLU")
            return column_table(source, {"time_s": time, **columns}, (note,), row=label, axes=axes, week=clock.week)
    return None


def _measurements(messages: Messages, *, raw: bool) -> tuple[Any, Any, Any, Any]:
    """Return time tag, value, sensor and position of every measurement, (n,)."""
    parts: list[tuple[Any, ...]] = []
    for positions, block in zip(messages.at, messages.rows, strict=True):
        body = block[:, _HEAD:-2]
        if body.shape[1] < 12:
            continue
        words = np.ascontiguousarray(body[:, : body.shape[1] // 4 * 4]).view("<u4").astype(np.int64)
        if raw:
            values, tags = words[:, 1:-1:2], words[:, 2::2]
            present = np.ones(values.shape, dtype=bool)
        else:
            count = words[:, 1] >> 11 & 31
            values = words[:, 2:]
            present = np.arange(values.shape[1]) < count[:, None]
            tags = np.broadcast_to(words[:, :1], values.shape)
        # a word holds the signed value in 24 bits, and the type of the sensor above
        unsigned = values & 0xFFFFFF
        signed = unsigned - ((unsigned >> 23) << 24)
        places = np.broadcast_to(positions[:, None], values.shape)
        parts.append((tags[present], signed[present], (values >> 24 & (255 if raw else 63))[present], places[present]))
    if not parts:
        return (np.empty(0), np.empty(0), np.empty(0), np.empty(0, dtype=np.int64))
    tag, value, sensor, at = (np.concatenate(values) for values in zip(*parts, strict=True))
    order = np.argsort(at, kind="stable")
    return tag[order], value[order], sensor[order], at[order]


def _sensors(tag: Any, value: Any, sensor: Any, at: Any) -> tuple[dict[str, FloatArray], FloatArray, Any]:
    """Arrange the six sensors at the time tags of the first gyro; empty if one is missing."""
    names = dict(zip((*_GYRO_TYPES, *_ACCEL_TYPES), conventions.GYRO + conventions.ACCEL, strict=True))
    if not all((sensor == sensor_type).any() for sensor_type in names):
        return {}, np.empty(0), np.empty(0, dtype=np.int64)
    first = sensor == _GYRO_TYPES[0]
    overflows = np.concatenate(([0], np.cumsum(np.diff(tag) < -(1 << 31))))  # time tags overflow at 32 bits
    tags = np.asarray(tag + overflows * float(1 << 32), dtype=np.float64)
    wanted = tags[first]
    columns = {}
    for sensor_type, column in names.items():
        of_sensor = sensor == sensor_type
        columns[column] = at_times(wanted, tags[of_sensor], value[of_sensor] * _SCALES[sensor_type])
    of_temperature = sensor == _TEMPERATURE
    if of_temperature.any():
        columns["temperature_c"] = at_times(wanted, tags[of_temperature], value[of_temperature] * _SCALES[_TEMPERATURE])
    return columns, wanted, at[first]


def _sensor_time(tags: FloatArray, places: Any, clock: _Clock, *, raw: bool) -> tuple[FloatArray, Finding]:
    """Convert time tags of samples ``(n,)`` to the clock of the fixes [s].

    A line relates the time tags of the last samples before each epoch to the times of the epochs. Epochs are logged
    slightly late, so the line is shifted to the least delay.
    """
    before = np.searchsorted(places, clock.at) - 1
    known = before >= 0
    x, y = tags[before[known]], clock.time[known]
    if len(x) < _FEW or np.ptp(x) == 0.0:
        if raw:
            raise InputError("format.ubx_raw_without_time")
        code = Code.READ_TIME_OF_SENSOR if len(x) < _FEW else Code.READ_TIME_CONSTANT
        return 1e-3 * tags, Finding.of(code, count=len(x), limit_count=_FEW)
    rate = float(np.polyfit(x - x[0], y - y[0], 1)[0])
    nominal = _RAW_TICK if raw else 1e-3
    if abs(rate / nominal - 1.0) * np.ptp(y) < _ORDER_JITTER:  # the message order is not more accurate
        rate = nominal
    offset = (y - y[0]) - rate * (x - x[0])
    time = rate * (tags - x[0]) + float(np.quantile(offset, 0.98)) + y[0]
    return time, Finding.of(Code.READ_TIME_BY_MESSAGES, tick_s=rate)
