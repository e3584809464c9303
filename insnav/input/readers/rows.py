"""Common part of all readers: time in seconds, cleaned rows and their interpretation; also sensor logs and epochs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from insnav import spill
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.registry import open_table
from insnav.input.formats.source import open_source
from insnav.input.formats.table import Table
from insnav.input.formats.text_dialect import is_comment
from insnav.input.formats.text_values import TextValues, with_date
from insnav.input.interpret.clean import Cleaned, Kinds, clean
from insnav.input.interpret.columns import Found, require, understand
from insnav.input.interpret.physics import clock_digits, find_time_unit
from insnav.input.interpret.schema import ALL_UNITS, LOG_SCHEMAS
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.types import BoolArray, FloatArray, SensorLog

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Rows:
    """Columns read from a file, during conversion."""

    table: Table  # table of the file
    kinds: Kinds  # kind of its rows, such as samples or fixes
    columns: dict[str, FloatArray]  # (n,) by key, in the units of the file; time in seconds
    n_rows: int  # number of rows
    cut: Finding | None  # reason for dropping the last row, if dropped
    # unit of the time in the file, and the evidence for this unit
    time_unit: str
    time_evidence: Finding | None
    week: float | None = None  # GPS week of the time origin

    def clean(self, bad: BoolArray | None = None, lacking: Code = Code.ROWS_NAN) -> Cleaned:
        """Sort the rows by time and drop the bad rows ``(n,)``, by default rows with a value that is not finite."""
        if bad is None:
            bad = np.asarray(~np.isfinite(np.column_stack(list(self.columns.values()))).all(axis=1), dtype=np.bool_)
        return clean(self.columns, bad, self.kinds, self.table, lacking)

    def reading(
        self,
        kind: str,
        data: T,
        cleaned: Cleaned,
        columns: Mapping[str, str],
        evidence: Iterable[Finding],
        **known: Any,
    ) -> Reading[T]:
        """Combine data, events and interpretation to a `Reading`; `known`: further fields of `ReadingFacts`."""
        time = cleaned.columns["time"]
        events = cleaned.events
        if self.cut:
            end = float(time[-1])
            events = (*events, replace(self.cut, begin=end, end=end, subject=self.kinds.source))
        notes = (self.time_evidence, *self.table.notes, *evidence, *cleaned.notes)
        facts = ReadingFacts(
            kind=kind,
            path=self.table.name,
            sha256=self.table.sha256,
            n_rows=self.n_rows + bool(self.cut),
            n_used=len(time),
            start_s=float(time[0]),
            end_s=float(time[-1]),
            rate_hz=1.0 / cleaned.interval,
            n_gaps=cleaned.n_gaps,
            longest_gap_s=cleaned.longest_gap,
            columns=columns,
            # a finding without a subject concerns the whole file: its subject is the input name
            evidence=tuple(replace(note, subject=note.subject or self.kinds.source) for note in notes if note),
            **known,
            gps_week=None if self.week is None else int(self.week),
        )
        return Reading(data, events, facts)


def read_rows(
    table: Table,
    found: Mapping[str, Found],
    keys: Sequence[str],
    kinds: Kinds,
    *,
    slowest: float,
    time_unit: str | None = None,
) -> Rows:
    """Read columns by key, with time in seconds.

    `slowest`: longest plausible time step [s]. `time_unit`: the user's unit of the time; default: from the header, else
    from the time steps.
    Raises: InputError: a cell is not a number, or the unit of the time is ambiguous.
    """
    if "time" in found and found["time"].header != "time_s":  # findings on a composed time do not apply
        table = replace(table, notes=tuple(note for note in table.notes if note.code not in _MADE_TIMES))
    keys = [*dict.fromkeys((*keys, *(["date"] if "date" in found and "time" in keys else [])))]
    numbers = table.cells.read([found[key].index for key in keys])
    columns = {key: numbers.columns[found[key].index] for key in keys}
    forms = {key: numbers.texts[found[key].index] for key in columns if found[key].index in numbers.texts}
    if "date" in forms and forms["date"].form != "date":  # not a plain date: only the time column is used
        del columns["date"], forms["date"]
    _refuse_texts(forms, found, table)
    _refuse_marks(columns, found, table)
    day = columns.pop("date", None)
    evidence: Finding | None = None
    unit, week = "s", table.week
    # time in text, in digits of a clock (hhmmss), or in numbers with a unit
    if "time" in forms:
        evidence, week = forms["time"].note, forms["time"].week
        if forms["time"].form == "time of day" and day is not None and "date" in forms:
            columns["time"], evidence, week = with_date(day, columns["time"])
    elif "time" in columns and numbers.n_rows > 1:
        stated = time_unit or found["time"].unit
        clock = clock_digits(columns["time"]) if stated is None else None
        if clock is not None:
            columns["time"], evidence = clock, Finding.of(Code.TIME_OF_CLOCK)
        else:
            unit, evidence = find_time_unit(columns["time"], stated, slowest=slowest, where=table.name)
        if ALL_UNITS[unit][1] != 1.0:
            columns["time"] = spill.by_blocks(lambda time: time * ALL_UNITS[unit][1], columns["time"])
    return Rows(table, kinds, columns, numbers.n_rows, numbers.cut, unit, evidence, week)


def _refuse_marks(columns: Mapping[str, FloatArray], found: Mapping[str, Found], table: Table) -> None:
    """Refuse placeholders for unknown values, such as -999: repeated numbers far larger than all other values."""
    for key, values in columns.items():
        extremes = [(np.fmin.reduce(values[rows]), np.fmax.reduce(values[rows])) for rows in spill.blocks(len(values))]
        for mark in _MARKS.intersection(np.ravel(extremes).tolist()):
            rows = np.flatnonzero(values == mark)
            largest_other = float(np.fmax.reduce(np.abs(values[values != mark]), initial=0.0))
            large = key != "time" and abs(mark) > _LEAST_ALONE
            if len(rows) > (0 if large else 1) and 0.0 < largest_other < _FAR * abs(mark):
                where, column = table.place(int(rows[0]), found[key].index), found[key].header
                raise InputError(
                    "input.placeholder", where=where, mark=mark, column=column, count=len(rows), largest=largest_other
                )


_MADE_TIMES = {Code.TIME_TWO_COLUMNS, Code.TIME_FROM_PARTS, Code.TIME_FROM_TICKS}
# -999, 999, -9999, 9999, ... and -99; but not 99, which may be a standard deviation
_MARKS = {sign * 10.0**digits - sign for sign in (-1.0, 1.0) for digits in (3, 4, 5, 6)} | {-99.0}
_FAR = 0.2  # largest other value, as a fraction of the placeholder
_LEAST_ALONE = 100.0  # a placeholder beyond this is recognised in a single row, except in times
_FORMS = {  # text that a column may contain instead of numbers
    "time": ("date and time", "time of day"),
    "date": ("date",),
    **dict.fromkeys(("lat", "lon"), ("angle",)),
    **dict.fromkeys(("lat_sign", "lon_sign"), ("hemisphere",)),
}


def _refuse_texts(forms: Mapping[str, TextValues], found: Mapping[str, Found], table: Table) -> None:
    """Refuse text of a wrong form, such as a date in a column of rates."""
    for key, (_, form, *_) in forms.items():
        if form not in _FORMS.get(key, ()):
            values: dict[str, Any] = {"column": found[key].header, "form": form, "quantity": key, "option": "--columns"}
            raise InputError("input.text_column", where=table.place(0, found[key].index), **values)


SLOWEST = 45.0  # longer time steps [s] show that the unit is not seconds


def read_sensor_log(path: str | Path | Table, name: str) -> Reading[SensorLog]:
    """Read the log of a further sensor, such as a speedometer.

    `path`: a data file of any supported format, such as the IMU file with further columns. `name`: the sensor, one of
    `LOG_SCHEMAS`, such as ``speedometer`` with columns ``time_s, speed_m_s`` and optionally ``sd_m_s``.
    Raises: InputError: the file cannot be used.
    """
    schema, alternatives = LOG_SCHEMAS[name]
    table = open_table(path, name)
    found, notes = understand(table.headers, table.units, schema, where=table.name)
    wanted = next((needed for needed in alternatives if set(needed) <= set(found)), alternatives[-1])
    require(found, ("time", *wanted), table, schema)
    kinds = Kinds("rows", name, 0, 3, gaps=False)
    keys = ("time", *wanted, *(["sd"] if "sd" in found else []))
    rows = read_rows(table, found, keys, kinds, slowest=SLOWEST)
    cleaned = rows.clean(~np.isfinite(rows.columns["time"]), Code.ROWS_NO_TIME)
    values = {key: cleaned.columns[key] * found[key].factor for key in keys[1:]}
    read = {found[key].quantity.name: found[key].describe(rows.time_unit if key == "time" else None) for key in keys}
    return rows.reading(name, SensorLog(name, cleaned.columns["time"], values), cleaned, read, notes)


_CLOSEST = 4e-6  # epochs closer than this [s] would select the same row of a solution


def read_epochs(path: str | Path) -> FloatArray:
    """Read increasing epochs [s] from the first column of a text file.

    Header lines before the first number, empty lines and comments are skipped.
    Raises: InputError: no epochs, a cell that is not a number, or epochs that do not increase.
    """
    source = open_source(path)
    epochs: list[float] = []
    for number, line in enumerate(bytes(source.data).decode("utf-8", "replace").lstrip("\ufeff").splitlines(), 1):
        cell = re.split(r"[,;\s]", line.strip(), maxsplit=1)[0].strip('"')
        if not cell or is_comment(line):
            continue
        try:
            epochs.append(float(cell))
        except ValueError:
            if epochs:
                raise InputError("input.no_epoch", where=f"{source.name}:{number}", text=cell[:40]) from None
    return as_epochs(epochs, source.name)


def as_epochs(times: object, where: str) -> FloatArray:
    """Check that epochs [s] are finite and increasing, and at least one. Raises: InputError: they are not."""
    epochs = np.asarray(times, dtype=np.float64)
    if epochs.ndim != 1 or not epochs.size:
        raise InputError("input.no_epochs", where=where)
    wrong = ~np.isfinite(epochs)
    wrong[1:] |= ~(np.diff(epochs) > _CLOSEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError("input.epochs_backward", where=where, row=row + 1, time_s=float(epochs[row]))
    return epochs
