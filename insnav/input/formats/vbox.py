"""Racelogic VBOX files (``.vbo``): sections of text, then rows of numbers; fixes, and samples of an IMU04 or CAN bus.

Time of day is UTC as ``hhmmss.ss``. Latitudes are minutes, positive north; longitudes minutes, positive west; heights
are above sea level. ``[header]`` and ``[channel units]`` state the units.

References
----------
Racelogic, "VBO file format" (support centre) and "VBO file structure" (developer portal).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats import conventions
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import DAY, GpsTime, gps_days, seconds_of_week
from insnav.input.interpret.columns import find_unit, is_header
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA, compact
from insnav.plain_text import plain_text

name = "VBOX file"
suffixes = (".vbo",)

_SECTION = re.compile(rb"^\[([^\]\r\n]+)\][ \t]*\r?$", re.M)
_DATA = re.compile(rb"^\[data\][ \t]*\r?\n\s*", re.M | re.I)
_CREATED = re.compile(rb"created on (\d\d)/(\d\d)/(\d{4})")
_BRAKE, _DGPS = 64, 128  # flags that are added to the number of satellites
_VELOCITIES = (rb"(?mi)^velocity", rb"(?mi)^vertical velocity")  # header lines that state the units of velocities
_TYPES = {0: 5.0, 1: 4.0}  # differential flag -> fix type


def recognise(source: Source) -> bool:
    return b"column names" in map(bytes.lower, _SECTION.findall(bytes(decoded(source.head))))


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    data = _DATA.search(text)
    parts = _SECTION.split(bytes(text[: data.start()]) if data else b"")
    sections = {key.strip().lower(): value for key, value in zip(parts[1::2], parts[2::2], strict=True)}
    names = tuple(plain_text(word.decode("latin-1")) for word in sections.get(b"column names", b"").split())
    words = [compact(name).replace("itude", "") for name in names]
    if data is None or len({*words}) < len(words) or not {"sats", "time", "lat", "long"} <= {*words}:
        raise InputError("format.vbox_columns", where=source.name, columns=names)
    dialect = Dialect(" ", ".", names, None, data.end(), bytes(text[: data.end()]).count(b"\n") + 1)
    cells = TextCells(source.name, text, dialect, zeros)
    numbers = cells.read(range(len(names)))
    column_of = dict(zip(words, numbers.columns.values(), strict=True))
    sats, clock = column_of["sats"], column_of["time"]
    second = np.unwrap(clock // 10_000 * 3600.0 + clock // 100 % 100 * 60.0 + clock % 100, period=DAY)
    time = GpsTime(second, None, None)
    if (created := _CREATED.search(parts[0])) is not None:
        day = gps_days(*(np.array([float(part)]) for part in reversed(created.groups())))
        time = seconds_of_week(np.full(len(second), day[0]), second, "UTC")
    unknown = np.full(len(second), np.nan)
    place = np.column_stack([column_of["lat"] / 60.0, -column_of["long"] / 60.0, column_of.get("height", unknown)])
    columns = {"time_s": time.time, **conventions.triad(conventions.MSL_PLACE, place)}
    if {"velocity", "heading"} <= column_of.keys():
        stated = (re.search(name + rb"[ \t]+(\S+)", sections.get(b"header", b"")) for name in _VELOCITIES)
        units = (find_unit(unit[1].decode("latin-1"), "velocity") if unit else None for unit in stated)
        speed, climb = (ALL_UNITS[unit or "km/h"][1] for unit in units)
        climb_rate = column_of.get("vertvel", column_of.get("verticalvelocity", unknown))
        columns |= conventions.of_course(column_of["velocity"] * speed, column_of["heading"], -climb * climb_rate)
    kind = np.where(sats % _BRAKE > 0.0, sats >= _DGPS, np.nan)
    time_notes = () if time.note is None else (time.note,)
    fixes = conventions.fix_table(source, columns, kind, _TYPES, time_notes, row="row", cut=numbers.cut, week=time.week)
    tables = {"gps": fixes}
    channels = sections.get(b"channel units", b"").strip(b"\r\n").decode("latin-1").split("\n")
    units_of = [*[""] * (len(names) - len(channels)), *map(str.strip, channels)][-len(names) :]
    headers = ("time_s", *(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units_of, strict=True)))
    if is_header(",".join(headers), IMU_SCHEMA):
        values = ArrayCells((time.time, *numbers.columns.values()), cells.line, numbers.cut)
        tables["imu"] = Table(source.name, source.sha256, headers, values, notes=time_notes, week=time.week)
    return tables
