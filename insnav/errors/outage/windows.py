"""Fixes that a filter is shown but may not use, and the samples of a window: what every study of outages shares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.filter.error_model import FilterState
from insnav.filter.prepare import Prepared
from insnav.types import BoolArray, GpsData

_LEAD = 2.0  # samples before the window, for the polynomials at its first interval [s]


def part_of(ready: Prepared, state: FilterState, length: float) -> Prepared:
    """Only the samples that a filter needs to go on for so long.

    Parameters
    ----------
    ready : Prepared
        The drive.
    state : FilterState
        Where the filter goes on from.
    length : float
        [s]
    """
    time = ready.imu.time
    first, last = np.searchsorted(time, [state.time - _LEAD, state.time + length + _LEAD])
    return replace(ready, imu=ready.imu.rows(slice(first, last)))


def good(gps: GpsData) -> BoolArray:
    """Fixes that say they are one, (n,)."""
    return np.ones(gps.time.shape[0], dtype=np.bool_) if gps.fix is None else np.asarray(gps.fix != 0)


def shown_only(gps: GpsData) -> GpsData:
    """The same fixes marked as none: a filter compares itself with them and does not use them."""
    return replace(gps, fix=np.zeros(gps.time.shape[0], dtype=np.int64), heading=None)
