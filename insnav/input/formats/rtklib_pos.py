"""RTKLIB solutions (``.pos``): fixes with quality, standard deviations and velocity.

The header line determines the layout. Time: calendar, or week and seconds, in GPST, UTC or JST. Position: latitude,
longitude in degrees or degrees, minutes, seconds, and height; Earth-fixed; or a baseline from a reference.

References
----------
Takasu, "RTKLIB ver. 2.4.2 Manual", 2013, appendix B.1; cross terms are signed roots of the covariances.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from insnav.earth import earth_from_lla, level_from_earth, lla_from_earth
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import GpsTime, gps_days, seconds_of_week
from insnav.plain_text import plain_text
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG

name = "RTKLIB solution"
suffixes = (".pos",)

_HEADER = re.compile(rb"""^%[ \t]*(\w+)[ \t,;]+((?:latitude|x-ecef|e-baseline)\(.*?)[ \t]*\r?$""", re.M)
_HEADERLESS = re.compile(rb"\A\s*\d{4}/\d\d/\d\d[ \t,;]+\d\d:\d\d:\d\d(\.\d+)?([ \t,;]+[-+.\d]+){13,}[ \t]*\r?$", re.M)
_ROW = re.compile(rb"^[ \t]*[^%\s].*$", re.M)
_REFERENCE = re.compile(rb"^% *ref pos *:(.*)$", re.M)
_BLANKS = bytes.maketrans(b"/:,;\t", b"     ")  # byte for byte: positions of bytes and lines stay

# position columns -> axes of the standard deviations and velocities in the same header
_LAYOUTS = {
    ("latitude(deg)", "longitude(deg)", "height(m)"): "neu",
    ("latitude(d'\")", "longitude(d'\")", "height(m)"): "neu",
    ("x-ecef(m)", "y-ecef(m)", "z-ecef(m)"): "xyz",
    ("e-baseline(m)", "n-baseline(m)", "u-baseline(m)"): "enu",
}
_CALENDAR = ("year", "month", "day", "hour", "minute", "second")
_RANGES = {
    "year": (1980, 2200), "month": (1, 12), "day": (1, 31), "hour": (0, 23), "minute": (0, 59), "second": (0, 60),
    "week": (0, 10_000), "tow": (0, 604_800),
}  # fmt: skip
_ZONES = {"GPST": 0.0, "UTC": 0.0, "JST": 32_400.0}  # time ahead of UTC [s]; zero for GPS time
_EARTH_RADII = (6.33e6, 6.5e6)  # distances from the Earth's centre near the ground [m]
_LONGEST_BASELINE = 2e6  # largest plausible component of a baseline [m]


def recognise(source: Source) -> bool:
    text = decoded(source.head)
    return bool(_HEADER.search(text) or _HEADERLESS.match(text))


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    scale, columns, rows = _rows(text, zeros, source.name)
    numbers = rows.read(range(len(rows.dialect.headers)))
    data = dict(zip(rows.dialect.headers, numbers.columns.values(), strict=True))
    time, note, week = _time(data, scale, rows)
    fixes = {"time_s": time}
    axes = _LAYOUTS[columns[0], columns[1], columns[2]]
    turn: FloatArray | None = None
    if axes == "neu":
        height = "height_msl_m" if b"/geodetic" in text[: rows.dialect.offset] else "height_m"
        lat, lon = (_degrees(data, columns[i]) for i in (0, 1))
        fixes |= {"lat_deg": lat, "lon_deg": lon, height: data["height(m)"]}
    else:
        r_e, to_earth = _earth_fixed(data, columns, text, rows)
        lla = lla_from_earth(r_e)
        fixes |= {"lat_deg": lla[:, 0] / DEG, "lon_deg": lla[:, 1] / DEG, "height_m": lla[:, 2]}
        turn = level_from_earth(lla) @ to_earth
    fixes |= {key: data[name] for key, name in (("fix", "Q"), ("satellites", "ns")) if name in data}
    with np.errstate(over="ignore", invalid="ignore"):  # values out of range are refused later
        fixes |= _velocity(data, axes, turn)
        deviations = _deviations(data, axes, turn, "sd{}(m)", "sd_{}_m") | _deviations(
            data, axes, turn, "sdv{}", "sd_v{}_m_s"
        )
    unknown = sum(int(np.count_nonzero(sd == 0.0)) for sd in deviations.values())
    fixes |= {key: np.where(sd == 0.0, np.nan, sd) for key, sd in deviations.items()}
    notes = [note, Finding.of(Code.READ_SD_UNKNOWN, count=unknown) if unknown else None]
    cells, kept = ArrayCells(tuple(fixes.values()), rows.line, numbers.cut), tuple(filter(None, notes))
    return {"gps": Table(source.name, source.sha256, tuple(fixes), cells, notes=kept, week=week)}


def _rows(text: bytes | mmap.mmap, zeros: int, where: str) -> tuple[str, tuple[str, ...], TextCells]:
    """Return time scale, column names after the time, and rows in which blanks separate the numbers."""
    headers = {
        tuple(re.split(r"[\s,;]+", b" ".join(found.groups()).decode("latin-1"))) for found in _HEADER.finditer(text)
    }
    if len(headers) != 1:
        raise InputError("format.rtklib_headers" if headers else "format.rtklib_no_header", where=where)
    (scale, *columns) = headers.pop()
    known = tuple(columns[:3]) in _LAYOUTS and "Q" in columns and len(set(columns)) == len(columns)
    if not known or scale not in _ZONES:
        shown = plain_text(" ".join([scale, *columns[:5]]))
        raise InputError("format.rtklib_other_header", where=where, text=shown)
    header = _HEADER.search(text)
    assert header is not None
    if b"=Tokyo" in text[: header.start()]:
        raise InputError("format.rtklib_tokyo", where=where)
    first = _ROW.search(text, header.end())
    offset = first.start() if first else len(text)
    calendar = first is not None and b"/" in first.group()
    names = [*(_CALENDAR if calendar else ("week", "tow"))]
    for column in columns:
        names += [column, f"{column} minute", f"{column} second"] if column.endswith("(d'\")") else [column]
    dialect = Dialect(" ", ".", tuple(names), None, offset, text[:offset].count(b"\n") + 1)
    return scale, tuple(columns), TextCells(where, text[:].translate(_BLANKS), dialect, zeros)


def _time(data: Mapping[str, FloatArray], scale: str, rows: TextCells) -> GpsTime:
    """Convert times to seconds of the first row's GPS week."""
    keys = _CALENDAR if "year" in data else ("week", "tow")
    for key in keys:
        low, high = _RANGES[key]
        wrong = ~((data[key] >= low) & (data[key] <= high))
        _refuse("format.rtklib_range", wrong, data[key], key, rows, low=low, high=high)
    if "year" in data:
        day = gps_days(data["year"], data["month"], data["day"])
        _refuse("format.rtklib_no_day", np.isnan(day), data["day"], "day", rows)
        second = 3600.0 * data["hour"] + 60.0 * data["minute"] + data["second"]
    else:
        day, second = 7.0 * data["week"], data["tow"]
    time, note, week = seconds_of_week(day, second - _ZONES[scale], "GPST" if scale == "GPST" else "UTC")
    if note and week is not None and _ZONES[scale]:
        note = Finding.of(note.code, week=week, leap_s=note["leap_s"], scale=scale, ahead_s=_ZONES[scale])
    return GpsTime(time, note, week)


def _degrees(data: Mapping[str, FloatArray], column: str) -> FloatArray:
    value = data[column]
    if f"{column} minute" not in data:
        return value
    part = data[f"{column} minute"] / 60.0 + data[f"{column} second"] / 3600.0
    return value + np.copysign(part, value)  # copysign: -0 degrees are negative, too


def _earth_fixed(
    data: Mapping[str, FloatArray], columns: tuple[str, ...], text: bytes | mmap.mmap, rows: TextCells
) -> tuple[FloatArray, FloatArray]:
    """Return Earth-fixed positions ``(n, 3)`` [m], and the rotation from the axes of the file to Earth-fixed axes."""
    position = np.column_stack([data[column] for column in columns[:3]])
    size = np.abs(position).max(axis=1)
    if columns[0] == "x-ecef(m)":
        distance = np.linalg.norm(np.where(size[:, None] < 1e9, position, 0.0), axis=1)
        wrong = ~((distance > _EARTH_RADII[0]) & (distance < _EARTH_RADII[1]))
        _refuse("format.rtklib_off_earth", wrong, distance, columns[0], rows)
        return position, np.eye(3)
    _refuse("format.rtklib_long_baseline", ~(size < _LONGEST_BASELINE), size, columns[0], rows)
    reference = _REFERENCE.search(text)
    numbers = [float(word) for word in re.findall(rb"[-+]?\d+\.?\d*", reference.group(1))] if reference else []
    if len(numbers) != 3 or b"Moving" in text[: rows.dialect.offset]:
        raise InputError("format.rtklib_no_reference", where=rows.name)
    lla = np.array([[numbers[0] * DEG, numbers[1] * DEG, numbers[2]]])
    to_earth = level_from_earth(lla)[0].T @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return earth_from_lla(lla) + position @ to_earth.T, to_earth


def _deviations(
    data: Mapping[str, FloatArray], axes: str, turn: FloatArray | None, column: str, header: str
) -> dict[str, FloatArray]:
    """Return standard deviations North, East, Down; zeros of the file stay. Empty if the columns are missing."""
    if not all(column.format(axis) in data for axis in axes):
        return {}
    sd = np.column_stack([data[column.format(axis)] for axis in axes])
    if turn is not None:
        covariance = sd[:, :, None] ** 2 * np.eye(3)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            cross = data.get(column.format(axes[i] + axes[j]))
            if cross is None:  # without covariances, the standard deviations cannot be rotated
                return {}
            covariance[:, i, j] = covariance[:, j, i] = np.sign(cross) * cross**2
        variance: FloatArray = np.einsum("nij,njk,nik->ni", turn, covariance, turn)
        sd = np.where(np.all(sd != 0.0, axis=1)[:, None], np.sqrt(np.maximum(variance, 0.0)), 0.0)
    return {header.format(axis): sd[:, i] for i, axis in enumerate("ned")}


def _velocity(data: Mapping[str, FloatArray], axes: str, turn: FloatArray | None) -> dict[str, FloatArray]:
    """Return velocity North, East, Down [m/s]; empty if the columns are missing."""
    if not all(f"v{axis}(m/s)" in data for axis in axes):
        return {}
    v = np.column_stack([data[f"v{axis}(m/s)"] for axis in axes])
    v = v * [1.0, 1.0, -1.0] if turn is None else np.einsum("nij,nj->ni", turn, v)
    return {f"v{axis}_m_s": v[:, i] for i, axis in enumerate("ned")}


def _refuse(code: str, wrong: BoolArray, values: FloatArray, column: str, rows: TextCells, **more: Any) -> None:
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        where, count = f"{rows.name}:{rows.line(row)}:{column}", int(np.count_nonzero(wrong))
        raise InputError(code, where=where, value=float(values[row]), header=column, count=count, **more)
