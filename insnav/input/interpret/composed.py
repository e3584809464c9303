"""Columns composed from other columns, such as time from its parts; conversion of positions and velocities of fixes.

References
----------
Xsens MT Low-Level Communication Protocol: ``SampleTimeFine`` counts 0.1 ms; ``UTC_Nano``: nanoseconds of the second.
Movella DOT: ``SampleTimeFine`` counts microseconds. ROS `std_msgs/Header`: ``stamp.secs`` and ``stamp.nsecs``.
Android `Location.getAccuracy`: radius of 68 % confidence, like the horizontal accuracy of Core Location. For two equal
normal components, this radius is ``sqrt(-2 ln 0.32)`` standard deviations of a component. NMEA 0183: ``ddmm.mmmm``.
ROS `sensor_msgs/NavSatFix`: covariance in m^2, east, north, up, row by row; status below 0 is no fix. PROJ: vgridshift.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insnav.earth import level_from_earth, lla_from_earth
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import PLACE, VELOCITY
from insnav.input.formats.table import Cells, Numbers, Table
from insnav.input.formats.time_scales import Scale, gps_days, seconds_of_week
from insnav.input.interpret.columns import Found, is_headerless, key_of, unused_columns
from insnav.input.interpret.schema import IMU_SCHEMA, compact
from insnav.types import BoolArray, FloatArray, IntArray
from insnav.units import DEG

_DATE, _CLOCK, _NANO = ("year", "month", "day"), ("hour", "minute", "second"), "nano"
_TICKS, _TICK, _SHORT_TICK = "sampletimefine", 1e-4, 1e-6  # column of a counter, and its possible units [s]
_LONGEST_STEP = 5000.0  # longest sample interval in counts of 0.1 ms (2 Hz); the fastest DOT (120 Hz) counts 8333 us
_SECONDS = "(s|secs?|seconds?)"
_FRACTION = re.compile(f"(?P<stem>.*?)(?P<size>n|nano|u|micro){_SECONDS}")
_SIZES = {"n": 1e-9, "u": 1e-6, "m": 1e-6}  # unit of a fraction by its first letter [s]
_INSTANCES = {"i", "instance", "imu", "imuid", "sensor", "sensorid", "device", "deviceid", "id"}
_MOST_INSTANCES, _TURNS = 8, 0.5  # most sensors in a table; least share of rows whose sensor changes
_OF_TIME = re.compile(r"(utc|gps|time)*(year|month|day|hour|minute|min|second|sec|nano)s?(ns)?")
_OF_PLACE = re.compile(
    r"(?:ecef|wls|pos|position|field)*(v|vel|velocity)?(?:ecef)?([xyz])(?:ecef)?(?:[kcm]?m|[kcm]?ms|meters)?"
)
_VECTOR = re.compile(r"(?P<name>[A-Za-z ]+?) *(?:\((?P<axes>[xyz](?:,[xyz]){0,2})\))? *(?P<unit>\[[^\]]*\])")
_STAMP = {0: "stamp.secs", 1: "stamp.nsecs"}
# number of fields in sensor_msgs/Imu and sensor_msgs/NavSatFix -> index and name of the fields that are read
_ECHOED = {
    40: _STAMP | {at + i: f"{key}_{'xyz'[i]}" for at, key in ((16, "gyro"), (28, "accel")) for i in range(3)},
    18: _STAMP
    | {3: "status.status", 5: "lat", 6: "lon", 7: "height", **{8 + i: f"covariance[{i}]" for i in (0, 4, 8)}},
}
_EARTH = 6.33e6, 6.48e6  # distances from the Earth's centre, up to 100 km height [m]
_SHARE = 0.9  # least share of rows at these distances, for Earth-fixed positions
_HIGH = 2e4  # least Earth-fixed z [m]: map heights are smaller, even where a northing is the Earth's radius (57.5 deg)
_TIME = tuple(quantity for quantity in IMU_SCHEMA if quantity.key == "time")


@dataclass(frozen=True, slots=True)
class _Composed:
    """Rows of a table with its own columns, and columns composed from them; see `Cells`."""

    cells: Cells
    width: int  # number of the table's own columns
    parts: tuple[int, ...]  # indices of the source columns
    make: Callable[..., FloatArray]  # computes new columns (n, count) from the source columns

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `Cells`."""
        own_indices, new_indices = ([i for i in indices if (i >= self.width) == other] for other in (False, True))
        numbers = self.cells.read(sorted({*own_indices, *(self.parts if new_indices else ())}))
        columns = {i: numbers.columns[i] for i in own_indices}
        if new_indices:
            made = self.make(*(numbers.columns[part] for part in self.parts))
            columns |= {i: np.ascontiguousarray(made[:, i - self.width]) for i in new_indices}
        return replace(numbers, columns=columns, texts={i: text for i, text in numbers.texts.items() if i in columns})

    def line(self, row: int) -> str:
        """See `Cells`."""
        return self.cells.line(row)


def composed(table: Table) -> Table:
    """Add composed columns to a table: time from parts; latitude, longitude and height from other coordinates."""
    table = _vectors(_echoed(table))
    words = [compact(header) for header in table.headers]
    table = _timed(_first_instance(table, words), words)
    return table if any(word.startswith("lat") for word in words) else _placed(table, words)


def _echoed(table: Table) -> Table:
    """Name the columns of ``ros2 topic echo --csv``, which writes all fields of a message and no header."""
    names = _ECHOED.get(len(table.headers), {}) if is_headerless(table.headers) else {}
    stamp = _first(table, [0, 1]) if names else None
    if stamp is None or _first(table, [2]) is not None or any((column != np.floor(column)).any() for column in stamp):
        return table  # no such message: its third field is text (the frame)
    return replace(table, headers=tuple(names.get(i, "") for i in range(len(table.headers))))


def _vectors(table: Table) -> Table:
    """Name all three axes if only the first header names the sensor: ``Gyroscope (z,x,y) [rad/s],1,2``."""
    headers = list(table.headers)
    for i, first in enumerate(map(_VECTOR.fullmatch, table.headers)):
        next_headers = [header.strip("()") for header in table.headers[i + 1 : i + 3]]
        axes = ((first and first["axes"]) or "x,y,z").split(",")
        axes = [*axes, *next_headers] if len(axes) == 1 else axes
        if first is not None and {*axes} == {*"xyz"} and (next_headers == ["1", "2"] or next_headers == axes[1:]):
            headers[i : i + 3] = [f"{first['name']} {axis} {first['unit']}" for axis in axes]
    dates = [i for i, header in enumerate(headers) if compact(header) == "date"]
    if dates and not any(map(_is_time, headers)):
        text = table.cells.read(dates[:1]).texts.get(dates[0])
        headers[dates[0]] = "datetime" if text is not None and text.form == "date and time" else headers[dates[0]]
    return replace(table, headers=tuple(headers))


def _added(
    table: Table,
    parts: Sequence[int],
    names: Sequence[str],
    make: Callable[..., FloatArray],
    *notes: Finding | None,
    week: float | None = None,
) -> Table:
    """Add composed columns to a table, and remove the headers of their sources."""
    headers = tuple("" if i in parts else header for i, header in enumerate(table.headers))
    part_indices = {table.headers[i]: i for i in parts}
    units = None if table.units is None else (*table.units, *[""] * len(names))
    cells = _Composed(table.cells, len(headers), tuple(parts), make)
    headers, all_notes = (*headers, *names), (*table.notes, *filter(None, notes))
    further: dict[str, Any] = {"week": week or table.week, "parts": {**table.parts, **part_indices}}
    return replace(table, headers=headers, cells=cells, units=units, notes=all_notes, **further)


@dataclass(frozen=True, slots=True)
class _Instance:
    """Rows of one sensor in a table; see `Cells`."""

    cells: Cells
    rows: IntArray  # (n,) row numbers

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `Cells`."""
        numbers = self.cells.read(indices)
        columns = {i: column[self.rows] for i, column in numbers.columns.items()}
        return replace(numbers, columns=columns, n_rows=len(self.rows))

    def line(self, row: int) -> str:
        """See `Cells`."""
        return self.cells.line(int(self.rows[row]))


def _first_instance(table: Table, words: Sequence[str]) -> Table:
    """Select the rows of the first sensor in a table that alternates between several sensors."""
    for i in (i for i, word in enumerate(words) if word in _INSTANCES):
        labels = getattr(table.cells, "labels", lambda index: np.zeros(1))
        (number,) = _first(table, [i]) or [labels(i)]
        numbers = np.unique(number)
        if 2 <= len(numbers) <= _MOST_INSTANCES and np.mean(number[1:] != number[:-1]) > _TURNS:
            values: dict[str, Any] = {"column": table.headers[i], "count": len(numbers), "number": numbers[0].item()}
            cells = _Instance(table.cells, np.flatnonzero(number == numbers[0]))
            return replace(table, cells=cells, notes=(*table.notes, Finding.of(Code.READ_ROWS_INSTANCE, **values)))
    return table


def _first(table: Table, parts: Sequence[int]) -> list[FloatArray] | None:
    """Read columns ``(n,)``; None if a column is not numeric, or the table has no rows."""
    try:
        numbers = table.cells.read(parts)
    except InputError:
        return None
    return None if numbers.texts or not numbers.n_rows else [numbers.columns[i] for i in parts]


def _timed(table: Table, words: Sequence[str]) -> Table:
    """Add a time column [s] from date and clock parts, from seconds and fraction, or from a sample counter."""
    indices: dict[str, int] = {}
    for i, word in enumerate(words):
        if (named := _OF_TIME.fullmatch(word)) is not None:
            indices.setdefault({"min": "minute", "sec": "second"}.get(named[2], named[2]), i)
    time_columns = [i for i, word in enumerate(words) if not _OF_TIME.fullmatch(word) and _is_time(table.headers[i])]
    if not time_columns and indices.keys() >= {*_DATE, *_CLOCK}:  # six columns from year to second
        names = [*_DATE, *_CLOCK, *[_NANO] * (_NANO in indices)]
        parts = [indices[name] for name in names]
        values = _first(table, parts)
        scale: Scale = "GPST" if words[indices["year"]].startswith("gps") else "UTC"
        day, second = _moments(*values) if values is not None else (np.full(1, np.nan), np.zeros(1))
        if np.isfinite(day).all():
            first = seconds_of_week(day[:1], second[:1], scale)

            def seconds(*by: FloatArray) -> FloatArray:
                return seconds_of_week(*_moments(*by), scale, week=first.week).time[:, None]

            columns = table.headers[parts[0]], table.headers[parts[-1]]
            note = Finding.of(Code.TIME_FROM_PARTS, first=columns[0], last=columns[1])
            return _added(table, parts, ["time_s"], seconds, note, first.note, week=first.week)
    if not indices.keys() >= {"minute", "second"} and (pair := _seconds_and_fraction(table, words)) is not None:
        seconds_at, fraction, size = pair
        note = Finding.of(Code.TIME_TWO_COLUMNS, columns=(table.headers[seconds_at], table.headers[fraction]))
        return _added(table, [seconds_at, fraction], ["time_s"], lambda s, n: (s + size * n)[:, None], note)
    if not time_columns and _TICKS in words and (values := _first(table, [words.index(_TICKS)])):
        tick = _TICK if float(np.median(np.abs(np.diff(values[0])))) < _LONGEST_STEP else _SHORT_TICK
        note = Finding.of(Code.TIME_FROM_TICKS, column=table.headers[words.index(_TICKS)], tick_s=tick)
        counted = [words.index(_TICKS)]
        return _added(table, counted, ["time_s"], lambda n: np.unwrap(n, period=2.0**32)[:, None] * tick, note)
    return table


def _seconds_and_fraction(table: Table, words: Sequence[str]) -> tuple[int, int, float] | None:
    """Find the columns of whole seconds and of their fraction, and the unit of the fraction [s]; otherwise None.

    The names differ only in the unit, such as ``stamp.secs`` and ``stamp.nsecs``. A fraction named only by its unit,
    such as ``Microseconds``, belongs to any time column with whole seconds.
    """
    for i, part in enumerate(map(_FRACTION.fullmatch, words)):
        if part is None:
            continue
        named = re.compile(re.escape(part["stem"]) + _SECONDS)
        same_name = [k for k, word in enumerate(words) if named.fullmatch(word)]
        time_columns = [k for k, header in enumerate(table.headers) if not part["stem"] and k != i and _is_time(header)]
        size = _SIZES[part["size"][0]]
        for k in dict.fromkeys((*same_name, *time_columns)):
            whole, fraction = _first(table, [k, i]) or [np.zeros(1), np.zeros(1)]
            known = np.isfinite(whole) & np.isfinite(fraction)
            whole, fraction = whole[known], size * fraction[known]
            if len(whole) > 1 and (whole == np.floor(whole)).all() and fraction.min() >= 0.0 and fraction.max() < 1.0:
                steps = np.diff(whole + fraction)
                if steps.any() and np.mean(steps >= 0.0) > 1.0 - _TURNS:
                    return k, i, size
    return None


def _is_time(header: str) -> bool:
    return key_of(header, _TIME) == "time"


def _moments(*by: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute days since 6 January 1980 and seconds of the day, from year to second and optional nanoseconds."""
    year = np.where(by[0] < 100.0, by[0] + 2000.0, by[0])
    nano = by[6] * 1e-9 if len(by) > 6 else 0.0
    return gps_days(year, by[1], by[2]), 3600.0 * by[3] + 60.0 * by[4] + by[5] + nano


def _placed(table: Table, words: Sequence[str]) -> Table:
    """Add latitude, longitude, height from Earth-fixed x, y, z, and velocity North, East, Down if present."""
    indices: dict[str, int] = {}
    for i, word in enumerate(words):
        if part := _OF_PLACE.fullmatch(word):
            indices.setdefault(("v" if part[1] else "") + part[2], i)
    places, speeds = [indices.get(axis, -1) for axis in "xyz"], [indices.get(f"v{axis}", -1) for axis in "xyz"]
    values = _first(table, places) if min(places) >= 0 else None
    if values is None:
        return table
    size = np.linalg.norm(np.column_stack(values), axis=1)
    labelled = all("ecef" in words[i] or "km" in words[i] for i in places)
    units = (1.0, 1e-2, 1e-3, 1e3) if labelled else (1.0,)  # unlabelled local coordinates could fit other units
    fitting = [unit for unit in units if _inside(unit * size).mean() > _SHARE]
    if not fitting or not (labelled or float(np.nanmedian(np.abs(values[2]))) * fitting[0] > _HIGH):
        return table
    unit = fitting[0]

    def level(*by: FloatArray) -> FloatArray:
        r_e = unit * np.column_stack(by[:3])
        known = _inside(np.linalg.norm(r_e, axis=1))[:, None]
        lla = lla_from_earth(np.where(known, r_e, [_EARTH[0], 0.0, 0.0]))
        columns = [lla / [DEG, DEG, 1.0]]
        if len(by) > 3:
            columns.append(np.einsum("nij,nj->ni", level_from_earth(lla), unit * np.column_stack(by[3:])))
        return np.where(known, np.hstack(columns), np.nan)

    moves = min(speeds) >= 0 and _first(table, speeds) is not None
    parts = [*places, *(speeds if moves else ())]
    note = Finding.of(Code.POSITIONS_EARTH_FIXED, columns=tuple(table.headers[i] for i in parts))
    return _added(table, parts, [*PLACE, *(VELOCITY if moves else ())], level, note)


def _inside(size: FloatArray) -> BoolArray:
    return np.asarray((size > _EARTH[0]) & (size < _EARTH[1]))


RADIUS = math.sqrt(-2.0 * math.log(0.32))  # of 68 % confidence, in standard deviations of a component
_MOST = 0.9  # least share of rows that exceed the range of degrees
_STILL = 0.3  # a receiver gives no course below this speed [m/s]
_CLIMB_SD = 2.0  # least sd of a vertical speed derived from heights [m/s]


def derive(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert other forms of positions, velocities and accuracies in columns ``(n,)``, in place; return findings."""
    notes = _integers(raw, found)
    notes += _degrees_minutes(raw, found)
    notes += _signs(raw, found)
    notes += _velocities(raw, found)
    notes += _deviations(raw, found)
    return notes


def _integers(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert positions of u-blox and PX4 in integers: degrees times 1e7, and heights in millimetres."""
    written = {key: raw[key][np.isfinite(raw[key])] / found[key].factor for key in ("lat", "lon")}
    whole = (len(values) and (np.abs(values - np.round(values)) < 1e-3).all() for values in written.values())
    if found["lat"].unit or not all(whole):
        return []
    largest = {key: float(np.abs(values).max()) for key, values in written.items()}
    if not (max(largest.values()) > 18_000.0 * 100.0 and largest["lat"] <= 90e7 and largest["lon"] <= 180e7):
        return []
    for key in ("lat", "lon"):
        raw[key] = raw[key] * 1e-7
    height = raw["height"][np.isfinite(raw["height"])]
    column = found["height"] if "height" in found else found["height_msl"]
    if column.unit or not len(height) or (height != np.round(height)).any():
        return [Finding.of(Code.POSITIONS_INTEGER)]
    raw["height"] = raw["height"] * 1e-3
    return [Finding.of(Code.POSITIONS_INTEGER), Finding.of(Code.POSITIONS_INTEGER_HEIGHTS)]


def _degrees_minutes(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert angles as in NMEA, with degrees and minutes in one number: 4807.038 is 48 deg 7.038 min."""
    written = {key: raw[key] / found[key].factor for key in ("lat", "lon")}
    known = {key: values[np.isfinite(values)] for key, values in written.items()}
    if found["lat"].unit not in (None, "deg") or not all(len(values) for values in known.values()):
        return []
    whole = {key: np.abs(values) // 100.0 for key, values in known.items()}
    minutes = all(bool((np.abs(values) % 100.0 < 60.0).all()) for values in known.values())
    too_large = max(float(np.mean(np.abs(known["lat"]) > 90.0)), float(np.mean(np.abs(known["lon"]) > 360.0))) > _MOST
    # latitudes up to 180 and longitudes up to 90 are exchanged columns rather than degrees with minutes
    exchanged = max(np.abs(known["lat"]).max() / 180.0, np.abs(known["lon"]).max() / 90.0) <= 1.0
    if not (too_large and minutes and whole["lat"].max() < 90.0 and whole["lon"].max() <= 180.0) or exchanged:
        return []
    for key, values in written.items():
        size = np.abs(values)
        raw[key] = np.sign(values) * (size // 100.0 + (size % 100.0) / 60.0) * DEG
    return [Finding.of(Code.POSITIONS_DEGREES_MINUTES, angle_rad=raw["lat"][0], written=known["lat"][0])]


def _signs(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Apply the hemisphere columns to latitude and longitude: south and west are negative."""
    notes: list[Finding] = []
    for key in ("lat", "lon"):
        sign = raw.pop(f"{key}_sign", None)
        if sign is not None:
            raw[key] = np.where(np.isfinite(sign), sign, np.nan) * np.abs(raw[key])
            letters = found[f"{key}_sign"].header
            notes.append(Finding.of(Code.POSITIONS_SIGN, column=found[key].header, letters=letters))
    return notes


def _velocities(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert speed and course to velocity north and east; derive the vertical speed from heights if it is missing."""
    speed, course = raw.pop("speed", None), raw.pop("course", None)
    speed_sd, course_sd = raw.pop("accuracy_speed", None), raw.pop("accuracy_course", None)
    if "vn" in raw or "ve" in raw or speed is None or course is None:
        unused = [found[key].header for key, column in (("speed", speed), ("course", course)) if column is not None]
        return [unused_columns(unused)] if unused and "vn" not in raw else []
    speed = np.where(speed >= 0.0, speed, np.nan)  # a negative speed marks an unknown speed
    known = np.isfinite(speed) & (np.isfinite(course) & (course >= 0.0) | (speed < _STILL))
    course = np.where(np.isfinite(course), course, 0.0)
    raw["vn"] = np.where(known, speed * np.cos(course), np.nan)
    raw["ve"] = np.where(known, speed * np.sin(course), np.nan)
    columns = found["speed"].header, found["course"].header
    notes: list[Finding] = [Finding.of(Code.VELOCITY_FROM_COURSE, speed=columns[0], course=columns[1])]
    if speed_sd is not None and (speed_sd > 0.0).any():
        sd = np.where(speed_sd > 0.0, speed_sd, np.nan)
        if course_sd is not None:
            across = speed * np.where(course_sd > 0.0, course_sd, 0.0)
            sd = np.fmax(sd, np.where(np.isfinite(across), across, 0.0))
        raw["sd_vn"], raw["sd_ve"] = sd, sd.copy()
        notes.append(Finding.of(Code.VELOCITY_SD_COLUMN, column=found["accuracy_speed"].header))
    if "vd" not in raw and "vu" not in raw:
        climb, climb_sd = _climb(raw)
        raw["vd"] = np.where(known, -climb, np.nan)
        if "sd_vn" in raw:
            raw["sd_vd"] = np.where(np.isfinite(raw["sd_vn"]), np.maximum(raw["sd_vn"], climb_sd), np.nan)
        notes.append(Finding.of(Code.VELOCITY_FROM_HEIGHTS, sd_m_s=climb_sd))
    return notes


def _climb(raw: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
    """Compute the climb rate ``(n,)`` from the two neighbours of each fix [m/s], and its sd by its scatter."""
    time, height = raw["time"], raw["height"]
    rate = np.zeros(len(time))
    if len(time) > 2:
        step = time[2:] - time[:-2]
        inner = np.where(step > 0.0, (height[2:] - height[:-2]) / np.where(step > 0.0, step, 1.0), 0.0)
        rate[1:-1] = np.where(np.isfinite(inner), inner, 0.0)
    return rate, max(_CLIMB_SD, 1.4826 * float(np.median(np.abs(rate))))


def _deviations(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert variances and confidence radii to standard deviations, unless the file has these."""
    notes: list[Finding] = []
    radius, vertical = raw.pop("radius", None), raw.pop("accuracy_d", None)
    variances = {axis: raw.pop(f"var_{axis}", None) for axis in "ned"}
    if "sd_n" in raw:
        return notes
    if all(column is not None and (column > 0.0).any() for column in variances.values()):
        for axis, column in variances.items():
            assert column is not None
            raw[f"sd_{axis}"] = np.sqrt(np.where(column > 0.0, column, np.nan))
        columns = tuple(found[f"var_{axis}"].header for axis in "ned")
        notes.append(Finding.of(Code.SD_FROM_VARIANCES, columns=columns))
    elif radius is not None and (radius > 0.0).any():
        raw["sd_n"] = np.where(radius > 0.0, radius, np.nan) / RADIUS
        raw["sd_e"] = raw["sd_n"].copy()
        notes.append(Finding.of(Code.SD_FROM_RADIUS, column=found["radius"].header))
        if vertical is not None and (vertical > 0.0).any():
            raw["sd_d"] = np.where(vertical > 0.0, vertical, 2.0 * raw["sd_n"])
            notes.append(Finding.of(Code.SD_VERTICAL_COLUMN, column=found["accuracy_d"].header))
        else:
            raw["sd_d"] = 2.0 * raw["sd_n"]
            notes.append(Finding.of(Code.SD_VERTICAL_TWICE))
    return notes


def undulation(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, str] | None:
    """Return geoid heights ``(n,)`` [m] at `lat`, `lon` [rad], and the PROJ grid; None without pyproj or a grid."""
    with suppress(ImportError):
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        for grid in ("us_nga_egm08_25.tif", "us_nga_egm96_15.tif"):
            with suppress(ProjError):
                shift = Transformer.from_pipeline(f"+proj=vgridshift +grids={grid} +multiplier=1")
                height = np.asarray(shift.transform(lon, lat, np.zeros(len(lat)), radians=True)[2], dtype=np.float64)
                return (height, grid) if np.isfinite(height).all() else None
    return None
