"""False fixes: at the start of a record, by consensus; of a stationary vehicle, by multipath of tens of metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import static
from insnav.earth import ned_offset
from insnav.strapdown import GAP, Intervals
from insnav.types import BoolArray, FloatArray, GpsData

LONGER = 10.0  # a stop must exceed the fixes' own stop by this, to contradict fixes [s]
AWAY, AWAY_SD = 50.0, 6.0  # distance from its place beyond which a vehicle has left it [m], [sd]
MOST = 0.1  # largest share of fixes there while it is stationary
DRIFT = 10.0  # displacement by a current between first and last quarter of a stop [m]
CONSENSUS = 9  # number of fixes for a consensus
# Limit of the distance from the median in robust standard deviations: Student's t, 3 degrees of freedom, two-sided
# 0.001. The median absolute deviation of nine numbers has that many (efficiency 0.37: Huber and Ronchetti, "Robust
# Statistics", 2nd ed., 2009, section 5.1). Dropping a good fix delays the start by one fix.
LIMIT = 12.9


def away(gps: GpsData, place: FloatArray) -> BoolArray:
    """Find fixes that are too far from a place, (3,) as `gps.lla`, for a vehicle that stays there, (n,)."""
    way = np.linalg.norm(ned_offset(gps.lla, place)[:, :2], axis=1)
    return np.asarray(way > AWAY + AWAY_SD * np.linalg.norm(gps.position_sd[:, :2], axis=1))


def without_false_motion(parts: Intervals, gps: GpsData, rest: tuple[float, float] | None) -> GpsData:
    """Remove apparent motion of the fixes while the IMU remains stationary, for an alignment.

    A vehicle that leaves accelerates. If neither mean nor scatter of gyros and accelerometers change after the stop,
    positions that leave by some tens of metres and return are false.

    `rest`: first stationary interval by IMU and fixes [s], or None.
    """
    if rest is None:
        return gps
    end = static.departure(parts, rest)
    rows = np.flatnonzero((gps.time >= rest[0]) & (gps.time < end))
    if end < rest[1] + LONGER or rows.size < 4:
        return gps
    place: FloatArray = np.median(gps.lla[rows], axis=0)
    first, last = (np.median(gps.lla[part], axis=0) for part in (rows[: rows.size // 4], rows[-(rows.size // 4) :]))
    drift = np.linalg.norm(ned_offset(last, first)[:2])
    if away(gps.rows(rows), place).mean() > MOST or drift > DRIFT:
        return gps
    lla = gps.lla.copy()
    lla[rows] = place
    return replace(gps, lla=lla)


def count_false_start(gps: GpsData) -> int:
    """Count the fixes at the start that contradict the median of the first ones.

    Positions are compared minus the path, by velocities or by the median rate (Theil and Sen: P. K. Sen, J. Am. Stat.
    Assoc. 63 (1968) 1379-1389).
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
