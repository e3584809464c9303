"""False fixes: at the start of a record by consensus; of a stationary vehicle: multipath is tens of metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import static
from insnav.earth import ned_offset
from insnav.strapdown import GAP, Intervals
from insnav.types import BoolArray, FloatArray, GpsData

LONGER = 10.0  # a rest that is longer than fixes have it by less says nothing of them [s]
AWAY, AWAY_SD = 50.0, 6.0  # from where it was, beyond which a vehicle has left its place [m], [sd]
MOST = 0.1  # part of the fixes that may be there while it rests
DRIFT = 10.0  # way from the first quarter of a rest to the last that a current makes [m]
CONSENSUS = 9  # fixes that decide together
# Limit of the distance from the median in robust standard deviations: Student's t, 3 degrees of freedom, two-sided
# 0.001. The median absolute deviation of nine numbers has that many (efficiency 0.37: Huber and Ronchetti, "Robust
# Statistics", 2nd ed., 2009, section 5.1). A good fix that is left out costs a start one fix later.
LIMIT = 12.9


def away(gps: GpsData, place: FloatArray) -> BoolArray:
    """Fixes that are too far from a place, (3,) as `gps.lla`, for a vehicle that stays there, (n,)."""
    way = np.linalg.norm(ned_offset(gps.lla, place)[:, :2], axis=1)
    return np.asarray(way > AWAY + AWAY_SD * np.linalg.norm(gps.position_sd[:, :2], axis=1))


def without_false_motion(parts: Intervals, gps: GpsData, rest: tuple[float, float] | None) -> GpsData:
    """Fixes as an alignment is to see them: while the IMU goes on resting they are where most of them are.

    What is to move must be pushed: where neither mean nor scatter of gyros and accelerometers changes from those of the
    rest before, positions that leave for some tens of metres, and come back, are false.

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
