"""NMEA 0183 logs: fixes from GGA, GNS, RMC, VTG, GST, HDT, and the date from RMC or ZDA.

Other content between the sentences, such as binary messages, is skipped. Sentences with a wrong checksum are dropped
and counted.

References
----------
NMEA 0183 Standard for Interfacing Marine Electronic Devices, version 4.11, 2018.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.conventions import number_in, without_fix
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import GpsTime, gps_days, seconds_of_week
from insnav.input.interpret.columns import is_header
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA
from insnav.types import FloatArray

name = "NMEA log"
suffixes = (".nmea",)

_SENTENCE = re.compile(rb"\$([A-Z]{2}(?:GGA|GNS|RMC|VTG|GST|ZDA|HDT),[^$*\r\n]{0,120})\*([0-9A-Fa-f]{2})")
_ANY = re.compile(rb"\$([A-Z]{2,4}[A-Z]{3}|P[A-Z]{3}\w*),[^$*\r\n]{0,120}\*[0-9A-Fa-f]{2}")
_KNOT = 1852.0 / 3600.0
_HALF_DAY = 43_200.0
# GGA quality -> fix type (1 fixed, 2 float, 4 DGPS, 5 single, 0 none); 6 (dead reckoning), 7, 8 (no receiver): none
_QUALITY = {1: 5.0, 2: 4.0, 3: 5.0, 4: 1.0, 5: 2.0, 9: 4.0}
_MODES = {"A": 5.0, "D": 4.0, "P": 5.0, "R": 1.0, "F": 2.0}  # mode in GNS and RMC -> fix type
_COLUMNS = ("lat_deg", "lon_deg", "alt", "separation", "fix", "speed_m_s", "course_deg")
_SEEN = ("satellites", 7), ("dop", 8), ("alt", 9)  # key -> index of its word in GGA and GNS
_OTHERS = ("sd_n_m", "sd_e_m", "sd_d_m", "heading_deg", "satellites", "dop")


def recognise(source: Source) -> bool:
    first = source.head.split(b"\n", 1)[0].decode("latin-1")
    in_table = any(is_header(first, schema) for schema in (IMU_SCHEMA, GPS_SCHEMA))  # a table may contain NMEA text
    return _ANY.search(source.head) is not None and not in_table


def read(source: Source) -> Mapping[str, Table]:
    log = _Log()
    for words in _sentences(source, log):
        log.take(words)
    values = np.array([[epoch.get(key, np.nan) for key in (*_COLUMNS, *_OTHERS)] for epoch in log.epochs])
    placed = np.isfinite(values[:, :2]).all(axis=1) & ~(values[:, 4] == 0.0) if len(values) else np.empty(0, bool)
    if not placed.any():
        raise InputError("format.nmea_no_position", where=source.name, count=log.sound, damaged_count=log.damaged)
    time, note, week = log.times()
    data = dict(zip((*_COLUMNS, *_OTHERS), values[placed].T, strict=True))
    damaged = Finding.of(Code.READ_ROWS_DAMAGED, subject="NMEA", count=log.damaged) if log.damaged else None
    untimed = Finding.of(Code.READ_VELOCITY_UNTIMED, subject="VTG") if log.from_vtg else None
    notes = [note, damaged, without_fix(placed), untimed]
    height, height_note = _height(data.pop("alt"), data.pop("separation"))
    columns = {"time_s": time[placed], "lat_deg": data.pop("lat_deg"), "lon_deg": data.pop("lon_deg"), **height}
    columns |= {key: column for key, column in data.items() if np.isfinite(column).any()}
    return {"gps": column_table(source, columns, [*notes, height_note], row="epoch", week=week)}


def _sentences(source: Source, log: _Log) -> Iterator[list[str]]:
    for match in _SENTENCE.finditer(source.data):
        body = match[1]
        if int(np.bitwise_xor.reduce(np.frombuffer(body, dtype=np.uint8))) != int(match[2], 16):
            log.damaged += 1
            continue
        log.sound += 1
        yield body.decode("ascii", errors="replace").split(",")


@dataclass(slots=True)
class _Log:
    """Collector of sentences into epochs; sentences with the same time of day belong to one epoch."""

    epochs: list[dict[str, float]] = field(default_factory=list)
    sound: int = 0  # number of sentences with the right checksum
    damaged: int = 0  # number of sentences with a wrong checksum
    from_vtg: bool = False  # velocities come from VTG, which has no time

    def take(self, words: list[str]) -> None:
        """Add one sentence; an invalid field counts as empty."""
        kind = words[0][2:]
        if len(words) < _LENGTHS[kind]:
            return
        if kind in ("GGA", "GNS", "RMC", "GST"):
            time = _time_of_day(words[1])
            if not np.isfinite(time):
                return
            epoch = next((epoch for epoch in self.epochs[-3:] if epoch["time"] == time), None)
            if epoch is None:
                epoch = {"time": time}
                self.epochs.append(epoch)
            getattr(self, f"_{kind.lower()}")(epoch, words)
        elif self.epochs:
            getattr(self, f"_{kind.lower()}")(self.epochs[-1], words)

    def _gga(self, epoch: dict[str, float], words: list[str]) -> None:
        if not _number(words[8]) > _LARGEST_DOP:
            epoch |= _place(words[2:6])
        epoch |= {key: _number(words[at]) for key, at in (*_SEEN, ("separation", 11))}
        epoch["fix"] = _QUALITY.get(int(_number(words[6], 0.0)), 0.0)

    def _gns(self, epoch: dict[str, float], words: list[str]) -> None:
        if "fix" not in epoch:  # a GGA of the same epoch has more detail
            epoch |= _place(words[2:6])
            epoch |= {key: _number(words[at]) for key, at in (*_SEEN, ("separation", 10))}
            epoch["fix"] = max((_MODES.get(mode, 0.0) for mode in words[6]), default=0.0)

    def _rmc(self, epoch: dict[str, float], words: list[str]) -> None:
        date = words[9]
        if len(date) == 6 and date.isdigit():
            year = int(date[4:])
            epoch["date"] = _day(year + (1900 if year >= 80 else 2000), int(date[2:4]), int(date[:2]))
        mode = words[12] if len(words) > 12 else "A"
        if words[2] == "A" and mode not in ("E", "M", "S", "N"):
            epoch |= _velocity(_number(words[7]), _number(words[8]))
            if "lat_deg" not in epoch:
                epoch |= _place(words[3:7])

    def _vtg(self, epoch: dict[str, float], words: list[str]) -> None:
        if "speed_m_s" not in epoch and (len(words) < 10 or words[9] not in ("E", "M", "S", "N")):
            epoch |= _velocity(_number(words[5]), _number(words[1]))
            self.from_vtg |= "speed_m_s" in epoch

    def _gst(self, epoch: dict[str, float], words: list[str]) -> None:
        sd = (_number(word) for word in words[6:9])
        epoch |= {key: value if value > 0.0 else np.nan for key, value in zip(_OTHERS, sd, strict=False)}

    def _zda(self, epoch: dict[str, float], words: list[str]) -> None:
        day, month, year = (int(_number(word, 0.0)) for word in words[2:5])
        late = _time_of_day(words[1]) - epoch["time"]  # negative if midnight is between the fix and its ZDA sentence
        epoch["date"] = _day(year, month, day) - (late < -_HALF_DAY)

    def _hdt(self, epoch: dict[str, float], words: list[str]) -> None:
        epoch["heading_deg"] = _number(words[1])

    def times(self) -> GpsTime:
        """Convert the times of the epochs ``(n,)`` to seconds of a GPS week; without any date, to seconds of a day."""
        clock = np.array([epoch["time"] for epoch in self.epochs])
        date = np.array([epoch.get("date", np.nan) for epoch in self.epochs])
        midnights = np.concatenate(([0.0], np.cumsum(np.diff(clock) < -_HALF_DAY)))
        known = np.isfinite(date)
        if not known.any():
            return GpsTime(clock + 86_400.0 * midnights, Finding.of(Code.READ_TIME_OF_DAY, scale="UTC"), None)
        # an epoch without date counts midnights from the last dated epoch, or back from the first dated epoch
        dated = np.maximum.accumulate(np.where(known, np.arange(len(clock)), -1))
        dated[dated < 0] = int(np.flatnonzero(known)[0])
        return seconds_of_week(date[dated] + midnights - midnights[dated], clock, "UTC")


_LARGEST_DOP = 100.0  # receivers limit the DOP to 99.99 (u-blox M8 protocol, UBX-13003221, GGA); more is no DOP
# least number of words of each sentence type
_LENGTHS = {"GGA": 12, "GNS": 11, "RMC": 10, "VTG": 6, "GST": 9, "ZDA": 5, "HDT": 2}


def _number(word: str, default: float = np.nan) -> float:
    value = number_in(word)
    return value if abs(value) < 1e9 and "_" not in word else default


def _time_of_day(word: str) -> float:
    """Parse hhmmss.ss to seconds of the day; NaN if invalid."""
    if len(word) < 6 or not word[:6].isdigit():
        return float("nan")
    hour, minute, second = int(word[:2]), int(word[2:4]), _number(word[4:])
    return 3600.0 * hour + 60.0 * minute + second if hour < 24 and minute < 60 and second < 61.0 else float("nan")


def _day(year: int, month: int, day: int) -> float:
    if not 1980 <= year < 2200:
        return float("nan")
    return float(gps_days(np.array([year]), np.array([month]), np.array([float(day)]))[0])


def _place(words: list[str]) -> dict[str, float]:
    """Convert latitude (ddmm.mmm, N or S) and longitude (dddmm.mmm, E or W) to degrees; NaN if invalid."""
    place = {}
    for key, word, side, signs in (
        ("lat_deg", words[0], words[1], {"N": 1.0, "S": -1.0}),
        ("lon_deg", words[2], words[3], {"E": 1.0, "W": -1.0}),
    ):
        degrees, minutes = divmod(_number(word), 100.0)
        limit = 90.0 if key == "lat_deg" else 180.0
        angle = degrees + minutes / 60.0
        place[key] = signs.get(side, np.nan) * angle if 0.0 <= angle <= limit and minutes < 60.0 else np.nan
    return place


def _velocity(knots: float, course: float) -> dict[str, float]:
    """Return speed [m/s] and course [deg] if the speed is known; receivers at rest may not state the course."""
    return {"speed_m_s": knots * _KNOT, "course_deg": course} if np.isfinite(knots) else {}


def _height(altitude: FloatArray, separation: FloatArray) -> tuple[dict[str, FloatArray], Finding | None]:
    """Build the height column, ellipsoidal if the geoid separation is known."""
    known = np.isfinite(separation)
    if not np.isfinite(altitude).any():  # a log of only RMC sentences, which have no altitude
        return {}, None
    if known.any() and (separation[known] != 0.0).any():
        filled = np.where(known, separation, np.median(separation[known]))
        return {"height_m": altitude + filled}, Finding.of(Code.READ_HEIGHT_BY_GEOID)
    return {"height_msl_m": altitude}, None
