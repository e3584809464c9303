"""Where the windows of a drive lie, and what the filter gets in one: its samples, and fixes that it may not use."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from insnav.exceptions import InputError
from insnav.filter.error_model import FilterState
from insnav.filter.prepare import Prepared
from insnav.types import BoolArray, FloatArray, GpsData, IntArray

SETTLED = 60.0  # no window begins earlier after the start of navigation, if the drive is long enough [s]
COUNT = 60  # windows that fit with the default spacing
CLOSEST = 2.0  # the default spacing is not less [s]
FirstWindow = Literal["quarter of drive", "half of slack"]
_LEAD = 2.0  # samples before the window, for the polynomials at its first interval [s]
_SAME = 1e-6  # times that differ by less are the same [s]


def window_starts(
    fixes: FloatArray,
    begin: float,
    end: float,
    length: float,
    *,
    first: float | None,
    spacing: float | None,
    rule: FirstWindow,
) -> IntArray:
    """Fixes at which windows begin, evenly along a drive.

    `fixes` (n,): times of the fixes, on the clock of the IMU [s]; `begin`, `end`: of navigation [s]; `length`: of the
    windows, of the shortest if there are several lengths [s]; `first`: where the first begins, after `begin` [s]; by
    default a minute, or less by `rule` on a short drive; `spacing`: from the start of one window to the next [s]; by
    default so that about sixty fit; `rule` {"quarter of drive", "half of slack"}: how much of a short drive the filter
    gets to settle. A quarter of the drive, whatever the length: windows of several lengths then begin at the same
    fixes. Half of what one window leaves: a single long one still fits.
    Returns: (m,): rows of the fixes, increasing.
    Raises: InputError: the drive is too short.
    """
    drive = end - begin
    shared = rule == "quarter of drive"
    if first is None:
        first = min(SETTLED, 0.25 * drive if shared else max(0.0, 0.5 * (drive - length)))
    room = drive - first - length
    if room < -_SAME:
        raise InputError(
            f"the drive is too short for windows of {length:g} s",
            why=f"{drive:.0f} s are navigated, the first {first:.0f} s of them for the filter to settle",
            fix="give shorter windows, or begin the first one earlier",
        )
    if spacing is None:
        spacing = max(CLOSEST, (drive - first if shared else room) / COUNT)
    wanted = begin + first + np.arange(int((room + _SAME) / spacing) + 1) * spacing
    rows = np.unique(np.searchsorted(fixes, wanted - _SAME))
    rows = rows[rows < len(fixes)]
    return np.asarray(rows[fixes[rows] <= end - length + _SAME])


def part_of(ready: Prepared, state: FilterState, length: float) -> Prepared:
    """Only the samples that a filter needs to go on for so long.

    `length` [s].
    """
    end = min(state.time + length + _LEAD, ready.unbroken_until(state.time) + _SAME)
    first, last = np.searchsorted(ready.imu.time, [state.time - _LEAD, end])
    return replace(ready, imu=ready.imu.rows(slice(first, last)))


def valid(gps: GpsData) -> BoolArray:
    """Fixes whose type says that they are one, (n,)."""
    return np.ones(gps.time.shape[0], dtype=np.bool_) if gps.fix is None else np.asarray(gps.fix != 0)


def comparison_only(gps: GpsData) -> GpsData:
    """The same fixes marked as none: a filter compares itself with them and does not use them."""
    return replace(gps, fix=np.zeros(gps.time.shape[0], dtype=np.int64), heading=None)
