"""Racelogic VBOX files (``.vbo``): sections of text, then rows of numbers; fixes, and samples of an IMU04 or CAN bus.

Time of day is UTC as ``hhmmss.ss``. Latitudes are minutes, positive north; longitudes minutes, positive west; heights
are above sea level. The header states the units of both velocities, and ``[channel units]`` those of further channels.

References
----------
Racelogic, "VBO file format" (support centre) and "VBO file structure" (developer portal).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.input.formats.conventions import MSL_PLACE, fix_table, of_course, triad
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import DAY, gps_days, seconds_of_week
from insnav.input.interpret.columns import find_unit, understand
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA, compact
from insnav.plain_text import plain_text

name = "VBOX file"
suffixes = (".vbo",)

_SECTION = re.compile(rb"^\[([^\]\r\n]+)\][ \t]*\r?$", re.M)
_DATA = re.compile(rb"^\[data\][ \t]*\r?\n\s*", re.M | re.I)
_CREATED = re.compile(rb"created on (\d\d)/(\d\d)/(\d{4})")
_BRAKE, _DGPS = 64, 128  # added to the number of satellites
_TYPES = {0: 5.0, 1: 4.0}  # fix types: alone, with corrections


def recognise(source: Source) -> bool:
    sections = {section.lower() for section in _SECTION.findall(bytes(decoded(source.head)))}
    return {b"header", b"column names"} <= sections or {b"column names", b"data"} <= sections


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    data = _DATA.search(text)
    head = bytes(text[: data.start()]) if data else b""
    parts = _SECTION.split(head)
    sections = {key.strip().lower(): value for key, value in zip(parts[1::2], parts[2::2], strict=True)}
    names = tuple(plain_text(word.decode("latin-1")) for word in sections.get(b"column names", b"").split())
    words = [compact(each).replace("longitude", "long").replace("latitude", "lat") for each in names]
    if data is None or len({*words}) < len(words) or not {"sats", "time", "lat", "long"} <= {*words}:
        raise InputError("format.vbox_columns", where=source.name, columns=names)
    dialect = Dialect(" ", ".", names, None, data.end(), bytes(text[: data.end()]).count(b"\n") + 1)
    cells = TextCells(source.name, text, dialect, zeros)
    numbers = cells.read(range(len(names)))
    own = {word: numbers.columns[i] for i, word in enumerate(words)}
    clock = own["time"]
    second = np.unwrap(clock // 10_000 * 3600.0 + clock // 100 % 100 * 60.0 + clock % 100, period=DAY)
    notes: list[Finding | None] = []
    week = None
    if (created := _CREATED.search(head)) is not None:
        first = gps_days(*(np.array([float(each)]) for each in reversed(created.groups())))
        second, note, week = seconds_of_week(np.full(len(second), first[0]), second, "UTC")
        notes.append(note)
    unit = {line.split()[0]: line for line in sections.get(b"header", b"").lower().splitlines() if line.strip()}
    speed, climb = (_unit_of(unit.get(key, b"")) for key in (b"velocity", b"vertical"))
    unknown = np.full(len(second), np.nan)
    place = np.column_stack([own["lat"] / 60.0, -own["long"] / 60.0, own.get("height", unknown)])
    columns = {"time_s": second, **triad(MSL_PLACE, place)}
    up = next((own[word] for word in ("vertvel", "verticalvelocity", "vertvelkmh") if word in own), unknown)
    if {"velocity", "heading"} <= own.keys():
        columns |= of_course(own["velocity"] * speed, own["heading"], -climb * up)
    sats = own["sats"]
    kind = (sats >= _DGPS).astype(np.int64)
    known = np.isfinite(sats) & (sats % _BRAKE > 0.0)
    tables = {"gps": fix_table(source, columns, kind, _TYPES, notes, good=known, row="row", cut=numbers.cut, week=week)}
    units = [line.strip().decode("latin-1") for line in sections.get(b"channel units", b"").strip(b"\r\n").split(b"\n")]
    stated = [""] * (len(names) - len(units)) + units[-len(names) :]
    found, _ = understand(names, stated, IMU_SCHEMA)
    samples = [
        found[f"{sensor}_{axis}"] for sensor in ("gyro", "accel") for axis in "xyz" if f"{sensor}_{axis}" in found
    ]
    if len(samples) == 6:
        headers = ("time_s", *(each.describe() if each.unit else each.header for each in samples))
        values = ArrayCells((second, *(numbers.columns[each.index] for each in samples)), cells.line, numbers.cut)
        given = tuple(note for note in notes if note)
        tables["imu"] = Table(source.name, source.sha256, headers, values, notes=given, week=week)
    return tables


def _unit_of(line: bytes) -> float:
    """Return the factor to m/s of a velocity in the header, km/h without a unit."""
    word = line.decode("latin-1").split()[-1] if line.strip() else ""
    return ALL_UNITS[find_unit(word, "velocity") or "km/h"][1]
