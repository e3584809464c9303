"""First position by consensus: count the false fixes at the start of a record."""

from __future__ import annotations

import numpy as np

from insnav.earth import ned_offset
from insnav.strapdown import GAP
from insnav.types import FloatArray, GpsData

CONSENSUS = 9  # fixes that decide together
# Limit of the distance from the median in robust standard deviations: Student's t, 3 degrees of freedom, two-sided
# 0.001. The median absolute deviation of nine numbers has that many (efficiency 0.37: Huber and Ronchetti, "Robust
# Statistics", 2nd ed., 2009, section 5.1). A good fix that is left out costs a start one fix later.
LIMIT = 12.9


def count_false_start(gps: GpsData) -> int:
    """Count the fixes at the start that contradict the median of the first ones.

    Positions are compared less the path travelled: by the velocities, else at the median rate (Theil and Sen: P. K.
    Sen, J. Am. Stat. Assoc. 63 (1968) 1379-1389).
    """
    interval = np.diff(gps.time[: CONSENSUS + 1])
    least = CONSENSUS // 2 + 1
    if interval.size < least:
        return 0
    long = np.flatnonzero(interval > GAP * np.median(interval))
    count = min(CONSENSUS, gps.time.size, int(long[0]) + 1 if long.size else CONSENSUS)
    if count < least:
        return 0
    early = gps.rows(slice(count))
    way = ned_offset(early.lla, np.median(early.lla, axis=0)) - _path(early)
    off = np.abs(way - np.median(way, axis=0))
    scatter = 1.4826 * np.median(off, axis=0)
    stated = np.where(np.isfinite(early.position_sd), early.position_sd, 0.0)
    false = (off > LIMIT * np.maximum(scatter, np.median(stated, axis=0))).any(axis=1)
    return 0 if false.sum() > count - least else int(np.argmin(false))


def _path(gps: GpsData) -> FloatArray:
    """Return the path since the first fix, North, East, Down (n, 3) [m]."""
    time = gps.time - gps.time[0]
    if np.isfinite(gps.v_n).all():
        steps = 0.5 * (gps.v_n[1:] + gps.v_n[:-1]) * np.diff(time)[:, None]
        return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    way = ned_offset(gps.lla, gps.lla[0])
    first, second = np.triu_indices(time.size, 1)
    rate = np.median((way[second] - way[first]) / (time[second] - time[first])[:, None], axis=0)
    return np.asarray(np.outer(time, rate))
