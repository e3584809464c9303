"""Columns composed of others before the interpretation: time from parts, Earth-fixed positions.

References
----------
Xsens MT Low-Level Communication Protocol: ``SampleTimeFine`` counts 0.1 ms; ``UTC_Nano``: nanoseconds of the second.
Movella DOT: ``SampleTimeFine`` counts microseconds. ROS `std_msgs/Header`: ``stamp.secs`` and ``stamp.nsecs``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insnav.earth import level_from_earth, lla_from_earth
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import PLACE, VELOCITY, Scale, gps_days, seconds_of_week
from insnav.input.formats.table import Cells, Numbers, Table
from insnav.input.interpret.columns import key_of
from insnav.input.interpret.schema import IMU_SCHEMA, compact
from insnav.types import BoolArray, FloatArray, IntArray
from insnav.units import DEG

_DATE, _CLOCK, _NANO = ("year", "month", "day"), ("hour", "minute", "second"), "nano"
_TICKS, _TICK, _SHORT_TICK = "sampletimefine", 1e-4, 1e-6  # [s]
_LONGEST_STEP = 5000.0  # ticks of 0.1 ms: no IMU is slower than 2 Hz; 120 Hz, the fastest DOT, has 8333 us
_SECONDS = "(s|secs?|seconds?)"
_FRACTION = re.compile(f"(?P<stem>.*?)(?P<size>n|nano|u|micro){_SECONDS}")
_SIZES = {"n": 1e-9, "u": 1e-6, "m": 1e-6}  # by the first letter [s]
_INSTANCES = {"i", "instance", "imu", "imuid", "sensor", "sensorid", "device", "deviceid", "id"}
_MOST_INSTANCES, _TURNS = 8, 0.5  # sensors in one table, and share of rows from another sensor than the previous row
_OF_TIME = re.compile(r"(utc|gps|time)*(year|month|day|hour|minute|min|second|sec|nano)s?(ns)?")
_OF_PLACE = re.compile(
    r"(?:ecef|wls|pos|position|field)*(v|vel|velocity)?(?:ecef)?([xyz])(?:ecef)?(?:[kcm]?m|[kcm]?ms|meters)?"
)
_VECTOR = re.compile(r"(?P<name>[A-Za-z ]+?) *(?:\((?P<axes>[xyz](?:,[xyz]){0,2})\))? *(?P<unit>\[[^\]]*\])")
_EARTH = 6.33e6, 6.48e6  # distances from the Earth's centre, up to 100 km height [m]
_SHARE = 0.9  # share of the rows with such positions
_HIGH = 2e4  # larger than map heights [m]; a northing may equal the Earth's radius, at 57.5 deg
_TIME = tuple(each for each in IMU_SCHEMA if each.key == "time")


@dataclass(frozen=True, slots=True)
class _Composed:
    """Rows of a table with further columns composed of its own; see `Cells`."""

    cells: Cells
    width: int  # number of its own columns
    parts: tuple[int, ...]  # source columns
    make: Callable[..., FloatArray]  # function of these, (n, number of new columns)

    def read(self, indices: Sequence[int]) -> Numbers:
        """See `Cells`."""
        own, others = ([i for i in indices if (i >= self.width) == other] for other in (False, True))
        numbers = self.cells.read(sorted({*own, *(self.parts if others else ())}))
        columns = {i: numbers.columns[i] for i in own}
        if others:
            made = self.make(*(numbers.columns[part] for part in self.parts))
            columns |= {i: np.ascontiguousarray(made[:, i - self.width]) for i in others}
        return replace(numbers, columns=columns, texts={i: text for i, text in numbers.texts.items() if i in columns})

    def line(self, row: int) -> str:
        """See `Cells`."""
        return self.cells.line(row)


def composed(table: Table) -> Table:
    """Add composed columns: time, and latitude, longitude and height from other coordinates."""
    table = _vectors(table)
    words = [compact(header) for header in table.headers]
    table = _timed(_first_instance(table, words), words)
    return table if any(word.startswith("lat") for word in words) else _placed(table, words)


def _vectors(table: Table) -> Table:
    """Name every axis of a sensor whose first axis alone has a name: ``Gyroscope (z,x,y) [rad/s],1,2``."""
    headers = list(table.headers)
    for i, first in enumerate(map(_VECTOR.fullmatch, table.headers)):
        others = [header.strip("()") for header in table.headers[i + 1 : i + 3]]
        axes = ((first and first["axes"]) or "x,y,z").split(",")
        axes = [*axes, *others] if len(axes) == 1 else axes
        if first is not None and {*axes} == {*"xyz"} and (others == ["1", "2"] or others == axes[1:]):
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
    own = {table.headers[i]: i for i in parts}
    units = None if table.units is None else (*table.units, *[""] * len(names))
    cells = _Composed(table.cells, len(headers), tuple(parts), make)
    headers, known = (*headers, *names), (*table.notes, *filter(None, notes))
    given: dict[str, Any] = {"week": week or table.week, "parts": {**table.parts, **own}}
    return replace(table, headers=headers, cells=cells, units=units, notes=known, **given)


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
    """Select the first sensor of a table with alternating sensors."""
    for i in (i for i, word in enumerate(words) if word in _INSTANCES):
        (number,) = _first(table, [i]) or [np.zeros(1)]
        numbers = np.unique(number)
        if 2 <= len(numbers) <= _MOST_INSTANCES and np.mean(np.diff(number) != 0.0) > _TURNS:
            values: dict[str, Any] = {"column": table.headers[i], "count": len(numbers), "number": numbers[0]}
            cells = _Instance(table.cells, np.flatnonzero(number == numbers[0]))
            return replace(table, cells=cells, notes=(*table.notes, Finding.of(Code.READ_ROWS_INSTANCE, **values)))
    return table


def _first(table: Table, parts: Sequence[int]) -> list[FloatArray] | None:
    """Read the first rows of columns; None if they are not numeric."""
    try:
        numbers = table.cells.read(parts)
    except InputError:
        return None
    return None if numbers.texts or not numbers.n_rows else [numbers.columns[i] for i in parts]


def _timed(table: Table, words: Sequence[str]) -> Table:
    """Add seconds from date and clock parts, or from the sample counter."""
    found: dict[str, int] = {}
    for i, word in enumerate(words):
        if (named := _OF_TIME.fullmatch(word)) is not None:
            found.setdefault({"min": "minute", "sec": "second"}.get(named[2], named[2]), i)
    others = [i for i, word in enumerate(words) if not _OF_TIME.fullmatch(word) and _is_time(table.headers[i])]
    if not others and found.keys() >= {*_DATE, *_CLOCK}:
        names = [*_DATE, *_CLOCK, *[_NANO] * (_NANO in found)]
        parts = [found[name] for name in names]
        values = _first(table, parts)
        scale: Scale = "GPST" if words[found["year"]].startswith("gps") else "UTC"
        day, second = _moments(*values) if values is not None else (np.full(1, np.nan), np.zeros(1))
        if np.isfinite(day).all():
            first = seconds_of_week(day[:1], second[:1], scale)

            def seconds(*by: FloatArray) -> FloatArray:
                return seconds_of_week(*_moments(*by), scale, week=first.week).time[:, None]

            columns = table.headers[parts[0]], table.headers[parts[-1]]
            note = Finding.of(Code.TIME_FROM_PARTS, first=columns[0], last=columns[1])
            return _added(table, parts, ["time_s"], seconds, note, first.note, week=first.week)
    if not found.keys() >= {"minute", "second"} and (pair := _seconds_and_fraction(table, words)) is not None:
        seconds_at, fraction, size = pair
        note = Finding.of(Code.TIME_TWO_COLUMNS, columns=(table.headers[seconds_at], table.headers[fraction]))
        return _added(table, [seconds_at, fraction], ["time_s"], lambda s, n: (s + size * n)[:, None], note)
    if not others and _TICKS in words and (values := _first(table, [words.index(_TICKS)])):
        tick = _TICK if float(np.median(np.abs(np.diff(values[0])))) < _LONGEST_STEP else _SHORT_TICK
        note = Finding.of(Code.TIME_FROM_TICKS, column=table.headers[words.index(_TICKS)], tick_s=tick)
        counted = [words.index(_TICKS)]
        return _added(table, counted, ["time_s"], lambda n: np.unwrap(n, period=2.0**32)[:, None] * tick, note)
    return table


def _seconds_and_fraction(table: Table, words: Sequence[str]) -> tuple[int, int, float] | None:
    """Find columns of whole seconds and fraction, with the unit of the fraction [s]; None without.

    Their names differ in the unit only, such as ``stamp.secs`` and ``stamp.nsecs``. A fraction without its own name,
    such as ``Microseconds``, belongs to any time in whole seconds.
    """
    for i, part in enumerate(map(_FRACTION.fullmatch, words)):
        if part is None:
            continue
        named = re.compile(re.escape(part["stem"]) + _SECONDS)
        own = [k for k, word in enumerate(words) if named.fullmatch(word)]
        others = [k for k, header in enumerate(table.headers) if not part["stem"] and k != i and _is_time(header)]
        size = _SIZES[part["size"][0]]
        for k in dict.fromkeys((*own, *others)):
            whole, rest = _first(table, [k, i]) or [np.zeros(1), np.zeros(1)]
            known = np.isfinite(whole) & np.isfinite(rest)
            whole, rest = whole[known], size * rest[known]
            if len(whole) > 1 and (whole == np.floor(whole)).all() and rest.min() >= 0.0 and rest.max() < 1.0:
                steps = np.diff(whole + rest)
                if steps.any() and np.mean(steps >= 0.0) > 1.0 - _TURNS:
                    return k, i, size
    return None


def _is_time(header: str) -> bool:
    return key_of(header, _TIME) == "time"


def _moments(*by: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute days since 6 January 1980 and seconds, from year, month, day, hour, minute, second and nanoseconds."""
    year = np.where(by[0] < 100.0, by[0] + 2000.0, by[0])
    nano = by[6] * 1e-9 if len(by) > 6 else 0.0
    return gps_days(year, by[1], by[2]), 3600.0 * by[3] + 60.0 * by[4] + by[5] + nano


def _placed(table: Table, words: Sequence[str]) -> Table:
    """Add latitude, longitude, height, and velocity North, East, Down, from Earth-fixed x, y, z."""
    found: dict[str, int] = {}
    for i, word in enumerate(words):
        if part := _OF_PLACE.fullmatch(word):
            found.setdefault(("v" if part[1] else "") + part[2], i)
    places, speeds = [found.get(axis, -1) for axis in "xyz"], [found.get(f"v{axis}", -1) for axis in "xyz"]
    values = _first(table, places) if min(places) >= 0 else None
    if values is None:
        return table
    size = np.linalg.norm(np.column_stack(values), axis=1)
    labelled = all("ecef" in words[i] or "km" in words[i] for i in places)
    units = (1.0, 1e-2, 1e-3, 1e3) if labelled else (1.0,)  # unstated, a local plane may fit other units
    fitting = [unit for unit in units if _inside(unit * size).mean() > _SHARE]
    if not fitting or not (labelled or float(np.nanmedian(np.abs(values[2]))) * fitting[0] > _HIGH):
        return table
    unit = fitting[0]

    def level(*by: FloatArray) -> FloatArray:
        r_e = unit * np.column_stack(by[:3])
        known = _inside(np.linalg.norm(r_e, axis=1))[:, None]
        lla = lla_from_earth(np.where(known, r_e, [_EARTH[0], 0.0, 0.0]))
        found = [lla / [DEG, DEG, 1.0]]
        if len(by) > 3:
            found.append(np.einsum("nij,nj->ni", level_from_earth(lla), unit * np.column_stack(by[3:])))
        return np.where(known, np.hstack(found), np.nan)

    moves = min(speeds) >= 0 and _first(table, speeds) is not None
    parts = [*places, *(speeds if moves else ())]
    note = Finding.of(Code.POSITIONS_EARTH_FIXED, columns=tuple(table.headers[i] for i in parts))
    return _added(table, parts, [*PLACE, *(VELOCITY if moves else ())], level, note)


def _inside(size: FloatArray) -> BoolArray:
    return np.asarray((size > _EARTH[0]) & (size < _EARTH[1]))
