"""Cleaning of rows: rows are sorted by time, unusable rows are dropped, and findings count them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav import spill
from insnav.exceptions import InputError
from insnav.findings import Code, Finding, by_time
from insnav.input.formats.table import Table
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, IntArray

MAX_UNSORTED = 0.01  # largest share of rows out of order
_BACKWARDS = 0.75  # a larger share of backward time steps shows reverse order; a shuffled file has 0.5
_RESET_ROWS = 5  # at least this number of last rows out of order shows that the clock was set back
_MAX_SHARED = 0.1  # largest share of rows that have the time of another row, but other values
_DAY, _FEW_STRAY = 86_400.0, 3  # length of a day [s]; largest number of rows with damaged times
_MIN_INTERVAL = 1e-9  # shorter intervals count as zero [s]
# A log repeats its fixes if it has at least this number of different positions, and at most this share of positions
# without repetition. A log that writes each fix twice, and lost a fifth of its rows, has a smaller share.
_FEW_RUNS, _MAX_SINGLE = 10, 0.4


@dataclass(frozen=True, slots=True)
class Kinds:
    """Kind of rows in a file: plural word such as ``samples``, and input name such as ``imu``.

    More than `gap_rows` consecutive missing rows are a gap. A file with fewer than `min_rows` rows is refused.
    """

    rows: str
    source: str
    gap_rows: int
    min_rows: int
    gaps: bool = True  # True if gaps are reported
    held: tuple[str, ...] = ()  # columns that are equal in repeated rows

    def finding(self, code: Code, time: float, **values: Any) -> Finding:
        """Build a finding on rows of this kind at a time [s]."""
        return Finding.of(code, time, subject=self.source, **values)


IMU_KINDS = Kinds("samples", "imu", 5, 3)
_POSITION = ("lat", "lon", "height")
GPS_KINDS = Kinds("fixes", "gps", 2, 3, held=_POSITION)
REFERENCE_KINDS = Kinds("rows", "ref", 0, 2, gaps=False, held=_POSITION)


@dataclass(frozen=True, slots=True)
class Cleaned:
    """Rows in time order."""

    columns: dict[str, FloatArray]  # (n,) the columns, with ``time`` strictly increasing
    events: tuple[Finding, ...]  # dropped, sorted or missing rows, in order of time
    n_gaps: int  # number of gaps
    longest_gap: float  # longest gap [s]
    interval: float  # median interval [s]
    notes: tuple[Finding, ...]  # findings about the file as a whole


def clean(columns: Mapping[str, FloatArray], bad: BoolArray, kinds: Kinds, table: Table, lacking: Code) -> Cleaned:
    """Sort rows by time; drop bad rows, and rows with damaged, equal or repeated values.

    `columns` (n,): with ``time`` [s], as read. `bad` (n,): rows to drop. `lacking`: finding code for bad rows.
    Raises: InputError: too few rows, too many out of order, or a clock that was set back.
    """
    n = len(columns["time"])
    if n < kinds.min_rows:
        raise _too_few(n, n, kinds, table.name)
    events: list[Finding] = []
    notes: list[Finding] = []
    kept = dict(columns)
    stray = _stray(kept["time"]) & ~bad
    for mask, code in ((bad, lacking), (stray, Code.ROWS_STRAY)):
        events += _run_events(kept["time"], mask, kinds, code) if mask.any() else []
    bad = bad | stray
    if bad.any():
        good = ~bad
        kept = {key: spill.chosen(column, good) for key, column in kept.items()}
        if len(kept["time"]) < kinds.min_rows:
            raise _too_few(len(kept["time"]), n, kinds, table.name, lacking.value)
    dt = spill.steps(kept["time"])
    if dt.min() <= _MIN_INTERVAL:
        rows = np.flatnonzero(~bad)
        kept["time"], wrap_notes = _unwrapped(kept["time"])
        notes += wrap_notes
        kept, order_events = _ordered(kept, rows, kinds, table.place)
        events += order_events
        if len(kept["time"]) < kinds.min_rows:
            raise _too_few(len(kept["time"]), n, kinds, table.name)
        dt = spill.steps(kept["time"])
    if kinds.held and (again := _repeats(kept, kinds.held)).any():
        at = kept["time"][int(np.argmax(again))]
        events.append(kinds.finding(Code.ROWS_REPEATED, at, count=int(np.count_nonzero(again)), rows=len(again)))
        kept = {key: spill.chosen(column, ~again) for key, column in kept.items()}
        dt = spill.steps(kept["time"])
    time = kept["time"]
    interval = float(np.median(dt))
    gaps = find_gaps(dt, interval, kinds)
    if kinds.gaps:
        limit = _longest_step(interval, kinds)
        for i in gaps:
            missing = round(dt[i] / interval) - 1
            events.append(kinds.finding(Code.ROWS_GAP, time[i], gap_s=dt[i], limit_s=limit, missing=missing))
        n_short = int(np.count_nonzero(dt > 1.5 * interval)) - len(gaps)
        if n_short:
            notes.append(Finding.of(Code.ROWS_SHORT_GAPS, count=n_short, limit=kinds.gap_rows))
    longest_gap = float(dt[gaps].max()) if len(gaps) else 0.0
    return Cleaned(kept, by_time(events), len(gaps), longest_gap, interval, tuple(notes))


def _repeats(columns: Mapping[str, FloatArray], keys: tuple[str, ...]) -> BoolArray:
    """Find rows ``(n,)`` that repeat the previous position, in a log that writes most positions more than once.

    A standing vehicle, or few digits, also repeat positions; then the positions in motion occur once.
    """
    again = np.zeros(len(columns["time"]), np.bool_)
    if columns.keys() >= set(keys):
        again[1:] = np.logical_and.reduce([columns[key][1:] == columns[key][:-1] for key in keys])
    starts = np.flatnonzero(~again)
    single = np.diff(np.append(starts, len(again))) == 1
    return again if len(starts) >= _FEW_RUNS and single.mean() <= _MAX_SINGLE else np.zeros_like(again)


def find_gaps(step: FloatArray, interval: float, kinds: Kinds) -> IntArray:
    """Find the rows before gaps, from the time steps ``(n,)`` and the median time step [s]; empty without gaps."""
    return np.flatnonzero(step > _longest_step(interval, kinds)) if kinds.gaps else np.empty(0, np.int64)


def _longest_step(interval: float, kinds: Kinds) -> float:
    """Return the longest time step that is no gap [s], from the median time step [s]."""
    return (kinds.gap_rows + 1.5) * interval


def _stray(time: FloatArray) -> BoolArray:
    """Find a few damaged times ``(n,)``: far from all other times, between sound rows; or on another day.

    The sound times must span less than a day. Times after a weekly clock rollover are sound.
    """
    known = np.isfinite(time)
    in_order = time[0] >= 0.0 and time[-1] <= 7.0 * _DAY and bool((spill.steps(time) >= 0.0).all())
    if in_order or not known.any():
        return np.zeros_like(known)
    distance = np.abs(time - np.median(time[known]))
    far = known & (distance > 4.0 * np.median(distance[known]))  # for even spacing, the median is a quarter of the span
    near = np.flatnonzero(known & ~far)
    far[: near[0]] = far[near[-1] :] = False
    if not far.any() and (time[known].min() < 0.0 or time[known].max() > 7.0 * _DAY):
        far = known & (distance > _DAY)
    few = 0 < np.count_nonzero(far) <= min(_FEW_STRAY, 0.1 * len(time))
    return far if few and float(np.ptp(time[known & ~far])) < _DAY else np.zeros_like(known)


def _too_few(used: int, read: int, kinds: Kinds, name: str, lacking: str = "") -> InputError:
    values: dict[str, Any] = {"kind": kinds.rows, "read": read, "least": kinds.min_rows}
    if used == read:
        return InputError("columns.too_few_rows", where=name, **values)
    return InputError("columns.too_few_usable", where=name, used=used, lacking=lacking, **values)


def _run_events(time: FloatArray, bad: BoolArray, kinds: Kinds, code: Code) -> list[Finding]:
    """Report each run of bad rows at its first finite time."""
    known = np.flatnonzero(np.isfinite(time))
    if not len(known):
        return []
    events = []
    for first, end in runs_of(bad).tolist():
        row = known[min(int(np.searchsorted(known, first)), len(known) - 1)]
        events.append(kinds.finding(code, time[row], count=end - first))
    return events


def _unwrapped(time: FloatArray) -> tuple[FloatArray, list[Finding]]:
    """Make times continuous across clock rollovers at the end of a week or a day; report the rollovers."""
    for period in (7.0 * _DAY, _DAY):
        if time.min() < 0.0 or time.max() > period:
            continue
        dt = np.diff(time)
        rollovers = np.flatnonzero(np.abs(dt + period) < 60.0)
        if len(rollovers) and not (np.delete(dt, rollovers) < -60.0).any():
            offset = np.zeros(len(time))
            offset[rollovers + 1] = period
            return time + np.cumsum(offset), [Finding.of(Code.TIME_RESTARTS, count=len(rollovers), period_s=period)]
    return time, []


def _ordered(
    columns: dict[str, FloatArray], rows: IntArray, kinds: Kinds, place: Callable[[int], str]
) -> tuple[dict[str, FloatArray], list[Finding]]:
    """Sort rows by time, and drop rows with the same time as an earlier row; report both."""
    time = columns["time"]
    events: list[Finding] = []
    latest = np.maximum.accumulate(time)
    late = time < latest
    n_late = int(np.count_nonzero(late))
    if n_late:
        _refuse_disorder(columns, late, rows, place)
        at = int(np.flatnonzero(late)[0])
        worst = float((latest - time).max())
        limit = _tolerated(len(time))
        events.append(kinds.finding(Code.ROWS_UNSORTED, time[at], count=n_late, limit=limit, late_s=worst))
        order = np.argsort(time, kind="stable")
        columns = {key: spill.chosen(column, order) for key, column in columns.items()}
        time = columns["time"]
    again = np.concatenate(([False], np.diff(time) <= _MIN_INTERVAL))
    if again.any():
        identical = again.copy()
        for column in (column for key, column in columns.items() if key != "time"):
            equal = (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
            identical[1:] &= equal
        differing = int(np.count_nonzero(again & ~identical))
        if differing > _MAX_SHARED * len(time):
            where = place(int(rows[np.flatnonzero(again & ~identical)[0]]))
            values: dict[str, Any] = {"count": differing, "rows": len(time), "kind": kinds.rows}
            raise InputError("columns.coarse_time", where=where, **values, option="--columns")
        for mask, code in ((identical, Code.ROWS_DUPLICATE), (again & ~identical, Code.ROWS_SAME_TIME)):
            if mask.any():
                first = time[int(np.argmax(mask))]
                events.append(kinds.finding(code, first, count=int(np.count_nonzero(mask))))
        columns = {key: spill.chosen(column, ~again) for key, column in columns.items()}
    return columns, events


def _tolerated(n: int) -> float:
    """Return the tolerated number of rows out of order."""
    return max(1.0, MAX_UNSORTED * n)


def _refuse_disorder(
    columns: Mapping[str, FloatArray], late: BoolArray, rows: IntArray, place: Callable[[int], str]
) -> None:
    """Refuse a file whose clock was set back, or with too many rows out of order."""
    time, n_late = columns["time"], int(np.count_nonzero(late))
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    if len(back) > _BACKWARDS * len(time):
        raise InputError("columns.backwards", where=place(int(rows[back[0]])), count=len(back), rows=len(time))
    # run of late rows after the largest backward time step, and whether the file ends with it
    worst = int(back[np.argmin(time[back] - time[back - 1])])
    length = len(time) - worst if late[worst:].all() else int(np.argmin(late[worst:]))
    tail = worst + length == len(time)
    # after a clock is set back, rows have earlier times again, but other values; late or repeated rows do not
    again = time[:worst] >= time[worst]
    again[again] = time[:worst][again] <= time[worst + length - 1]
    twice = length > 1 and 2 * np.count_nonzero(again) >= length and bool((np.diff(time[worst:][:length]) > 0.0).all())
    twice = twice and not all(
        np.isin(column[worst:][:length], column[:worst][again]).mean() > 0.5 or key == "time"
        for key, column in columns.items()
    )
    tolerated = _tolerated(len(time))
    if twice or (tail and length >= _RESET_ROWS) or (n_late > tolerated >= len(back)):
        before_s, after_s = float(time[worst - 1]), float(time[worst])
        raise InputError("columns.jump_back", where=place(int(rows[worst])), before_s=before_s, after_s=after_s)
    if n_late > tolerated:
        where = place(int(rows[back[0]]))
        raise InputError("columns.disorder", where=where, count=n_late, rows=len(time), limit=MAX_UNSORTED)
