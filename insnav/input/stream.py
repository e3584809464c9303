"""Parser of a mixed log that is read while another program writes it.

The log contains lines of samples and of fixes with one clock, NMEA sentences, and u-blox NAV-PVT and NAV-PVAT messages.
A header line names the columns of the data lines with as many words. If its first word is no column name, such as
``IMU``, its data lines begin with the same word.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats import nmea, ubx
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import Found, is_header, understand
from insnav.input.interpret.composed import derive
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA
from insnav.types import FloatArray, GpsData

NAME = "standard input"
LONGEST = 1 << 17  # data of this length without line end count as a line [bytes]; a u-blox message has at most 65543
_SYNC, _FIXES = b"\xb5b", (b"\x01\x07", b"\x01\x17")  # u-blox: sync bytes; class and number of NAV-PVT, NAV-PVAT
_SAMPLE = ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


@dataclass(slots=True)
class Stream:
    """Parser of a mixed log that arrives in pieces of any size; `skipped` counts damaged lines and messages."""

    skipped: int = 0
    _rest: bytes = b""
    _columns: dict[tuple[str, int], tuple[bool, dict[str, Found]]] = field(default_factory=dict)
    _samples: list[list[float]] = field(default_factory=list)
    _epoch: list[bytes] = field(default_factory=list)  # NMEA sentences of the current epoch
    _better: bool = False  # u-blox fixes arrive; NMEA sentences with the same fixes are ignored
    _time: bytes = b""
    _last_kind: bytes = b""

    def take(self, data: bytes) -> Iterator[FloatArray | GpsData]:
        """Yield IMU samples and fixes from the next piece of the log, in the order of the log.

        Samples ``(n, 7)``: time [s], rates [rad/s], forces [m/s^2]. Raises: InputError: a header is missing or invalid.
        """
        log, start = self._rest + data, 0
        while start < len(log):
            sync, end = log.find(_SYNC, start), log.find(b"\n", start)
            if sync == start:  # a u-blox message begins here
                size = 8 + int.from_bytes(log[start + 4 : start + 6], "little")
                if len(log) < start + max(size, 8):
                    break
                next_start = start + size
                fix = self._read(ubx.read, log[start:next_start]) if log[start + 2 : start + 4] in _FIXES else None
                self._better |= fix is not None
            elif sync >= 0 and not 0 <= end < sync:  # text without line end before a u-blox message
                fix, next_start = self._line(log[start:sync]), sync
            elif end < 0 and len(log) - start < LONGEST:  # the rest of the line is still to come
                break
            else:
                next_start = len(log) if end < 0 else end + 1
                fix = self._line(log[start:next_start])
            start = next_start
            if fix is not None and np.isfinite(fix.lla[0, :2]).all():
                yield from self._flush()
                yield fix
        self._rest = log[start:]
        yield from self._flush()

    def _flush(self) -> Iterator[FloatArray]:
        if self._samples:
            yield np.array(self._samples)
            self._samples.clear()

    def _read(self, reader: Callable[[Source], Mapping[str, Table]], data: bytes) -> GpsData | None:
        """Read one fix with a format reader; None without a position, or if the data are damaged."""
        try:
            table = reader(Source(NAME, "", data))["gps"]
        except InputError:
            self.skipped += 1
            return None
        columns = table.cells.read(range(len(table.headers))).columns
        return _fix(understand(table.headers, None, GPS_SCHEMA)[0], columns)

    def _line(self, line: bytes) -> GpsData | None:
        line = line.strip()
        if line.startswith(b"$"):
            return self._sentence(line)
        text = line.decode("latin-1")
        words = [word.strip() for word in re.split("[,;\t]", text)]
        numbers = [_number(word) for word in words]
        tag = words[0] if np.isnan(numbers[0]) else ""
        layout = self._columns.get((tag, len(words)))
        if layout is None:
            for schema in (IMU_SCHEMA, GPS_SCHEMA):
                if is_header(text, schema):
                    self._header(words, schema is IMU_SCHEMA, understand(words, None, schema, where=NAME)[0])
                    return None
            if not self._columns and len(words) > len(_SAMPLE) - 1 and np.isfinite(numbers).all():
                raise InputError("online.no_header", where=NAME, line=text[:80])
        values = {} if layout is None else {key: numbers[column.index] for key, column in layout[1].items()}
        if layout is None or not np.isfinite([values[key] for key in (_SAMPLE if layout[0] else _SAMPLE[:1])]).all():
            self.skipped += bool(words[0]) and layout is not None
            return None
        if layout[0]:
            self._samples.append([values[key] * layout[1][key].factor for key in _SAMPLE])
            return None
        return _fix(layout[1], [np.array([number]) for number in numbers])

    def _header(self, words: Sequence[str], samples: bool, found: Mapping[str, Found]) -> None:
        """Remember the columns of the data lines that follow a header."""
        tag = "" if 0 in {column.index for column in found.values()} else words[0]
        needed = _SAMPLE if samples else ("time", "lat", "lon")
        if missing := [key for key in needed if key not in found]:
            raise InputError("online.columns_missing", where=NAME, missing=tuple(missing))
        bare = [found[key].header for key in needed if found[key].unit is None]
        if bare:
            raise InputError("online.units_missing", where=NAME, columns=tuple(bare))
        if self._columns.get((tag, len(words)), (samples,))[0] is not samples:
            raise InputError("online.columns_alike", where=NAME, count=len(words))
        self._columns[tag, len(words)] = samples, dict(found)

    def _sentence(self, line: bytes) -> GpsData | None:
        """Collect NMEA sentences; return the fix when an epoch ends: at its usual last sentence, or at a new time."""
        kind, _, fields = line.partition(b",")
        timed, time = kind[3:] in (b"GGA", b"GNS", b"RMC", b"GST"), fields.partition(b",")[0]
        if timed and self._epoch and time != self._time:
            self._last_kind = self._epoch[-1].partition(b",")[0]
            complete, self._epoch = self._epoch, [line]
        elif kind == self._last_kind and self._epoch:
            complete, self._epoch = [*self._epoch, line], []
        else:
            complete, self._epoch = [], [*self._epoch, line] if timed or self._epoch else []
        self._time = time if timed else self._time
        return self._read(nmea.read, b"\n".join([*complete, b""])) if complete and not self._better else None


def _fix(found: Mapping[str, Found], columns: Sequence[FloatArray] | Mapping[int, FloatArray]) -> GpsData:
    """Convert one row of a table, as columns ``(1,)`` by index, to a fix."""
    raw = {key: columns[column.index] * column.factor for key, column in found.items()}
    raw["height"] = raw.pop("height", raw.pop("height_msl", np.zeros(1)))
    derive(raw, found)
    unknown = np.full(1, np.nan)
    raw["vd"] = raw["vd"] if "vd" in found else -raw.get("vu", unknown)
    lla, v_n, position_sd, velocity_sd = (
        np.column_stack([raw.get(key, unknown) for key in keys.split()])
        for keys in ("lat lon height", "vn ve vd", "sd_n sd_e sd_d", "sd_vn sd_ve sd_vd")
    )
    fix = raw["fix"].astype(np.int64) if np.isfinite(raw.get("fix", unknown)).all() else None
    return GpsData(raw["time"], lla, v_n, position_sd, velocity_sd, fix)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan
