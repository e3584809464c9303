"""Text exports of Inertial Explorer and GrafNav: a reference if they contain attitude, otherwise fixes.

The export profile determines the columns. Two lines below a free-text header give names and units.

References
----------
NovAtel Waypoint Software User Manual, OM-20000166, appendix B (output variables; body axes Right, Forward, Up).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import ATTITUDE, VELOCITY, deviations
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.source import Source, text_of
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import WEEK_DAYS, GpsTime, Scale, seconds_of_week
from insnav.plain_text import plain_text
from insnav.types import FloatArray

name = "Inertial Explorer export"

_PROGRAM = re.compile(rb"^Program:[ \t]*(?:Inertial Explorer|GrafNav|GrafNet)", re.M)
_HEADER = re.compile(rb"^([^\n]*\b(?:GPS|Corr|UTC)Time?\b[^\n]*)\n([^\n]*\([^\n]*)\n", re.M)
_FIRST, _BEHIND = re.compile(rb"^[ \t]*[-+\d]", re.M), re.compile(rb"^[ \t]*(?:[^-+\d\s]|\r?$)", re.M)
# key -> column names in the export, in lower case without symbols
_NAMES: dict[str, tuple[str, ...]] = {
    "week": ("week",), "tow": ("gpstime", "gpstim", "corrtime", "corrtim"), "utc": ("utctime", "utctim"),
    "lat_deg": ("latitude",), "lon_deg": ("longitude",), "height_m": ("hell",), "height_msl_m": ("hmsl", "hort"),
    "vn_m_s": ("vnorth",), "ve_m_s": ("veast",), "vu": ("vup",),
    "roll_deg": ("roll",), "pitch_deg": ("pitch",), "heading_deg": ("heading",),
    "sd_n": ("sdnorth",), "sd_e": ("sdeast",), "sd_d": ("sdheight", "sdup"),
    "sd_vn": ("sdvn", "sdvnorth"), "sd_ve": ("sdve", "sdveast"), "sd_vd": ("sdvh", "sdvup", "sdvu"),
}  # fmt: skip


def recognise(source: Source) -> bool:
    return _PROGRAM.search(source.head) is not None


def read(source: Source) -> Mapping[str, Table]:
    data, cut = _columns(source)
    height = next((key for key in ("height_m", "height_msl_m") if key in data), "")
    if not height or not {"lat_deg", "lon_deg"} <= data.keys() or not data.keys() & {"tow", "utc"}:
        raise InputError("format.explorer_no_positions", where=source.name, found=tuple(data))
    time, note, week = _time(data)
    columns = {"time_s": time, **{key: data[key] for key in ("lat_deg", "lon_deg", height)}}
    if {"vn_m_s", "ve_m_s", "vu"} <= data.keys():
        columns |= {"vn_m_s": data["vn_m_s"], "ve_m_s": data["ve_m_s"], VELOCITY[2]: -data["vu"]}
    for keys, header in ((("sd_n", "sd_e", "sd_d"), "sd_{}_m"), (("sd_vn", "sd_ve", "sd_vd"), "sd_v{}_m_s")):
        if set(keys) <= data.keys():
            columns |= deviations(np.column_stack([data[key] for key in keys]), header)
    part = "gps"
    if set(ATTITUDE) <= data.keys():
        part = "reference"
        columns |= {key: data[key] for key in ATTITUDE} | {ATTITUDE[2]: data[ATTITUDE[2]] % 360.0}
    return {part: column_table(source, columns, [note], row="epoch", cut=cut, week=week)}


def _columns(source: Source) -> tuple[dict[str, FloatArray], Finding | None]:
    """Read the columns of the export by key of `_NAMES`; report a truncated last row."""
    text, zeros = text_of(source)
    header = _HEADER.search(text)
    first = None if header is None else _FIRST.search(text, header.end())
    if header is None or first is None:
        raise InputError("format.explorer_no_table", where=source.name)
    delimiter = "," if b"," in header[1] else " "
    words = plain_text(header[1].decode("latin-1"))
    names = [re.sub(r"\W", "", word).lower() for word in words.split("," if delimiter == "," else None)]
    if b"D M S" in header[2]:
        if delimiter == ",":
            raise InputError("format.explorer_sexagesimal", where=source.name)
        thirds = {"latitude": ["latitude", "lat1", "lat2"], "longitude": ["longitude", "lon1", "lon2"]}
        names = [name for word in names for name in thirds.get(word, [word])]
    after_table = _BEHIND.search(text, first.start())
    offset, end = first.start(), len(text) if after_table is None else after_table.start()
    dialect = Dialect(delimiter, ".", tuple(names), None, offset, text[:offset].count(b"\n") + 1)
    places = {key: names.index(name) for key, known in _NAMES.items() for name in known if name in names}
    minutes: dict[str, int] = {name: names.index(name) for name in ("lat1", "lat2", "lon1", "lon2") if name in names}
    indices = sorted({*places.values(), *minutes.values()})
    numbers = TextCells(source.name, text[:end], dialect, zeros).read(indices)
    data = {key: numbers.columns[index] for key, index in places.items()}
    for key, part in (("lat_deg", "lat"), ("lon_deg", "lon")):
        if key in data and f"{part}1" in minutes:
            minute, second = (numbers.columns[minutes[f"{part}{i}"]] for i in (1, 2))
            data[key] = data[key] + np.copysign(minute / 60.0 + second / 3600.0, data[key])
    return data, numbers.cut


def _time(data: Mapping[str, FloatArray]) -> GpsTime:
    scale: Scale = "GPST" if "tow" in data else "UTC"
    second = data["tow" if "tow" in data else "utc"]
    if "week" in data and np.isfinite(data["week"]).all() and (np.abs(data["week"]) < 1e4).all():
        return seconds_of_week(WEEK_DAYS * data["week"], second, scale)
    return GpsTime(second, Finding.of(Code.READ_TIME_UNKNOWN_WEEK, scale=scale), None)
