"""Motion of positions while the IMU is stationary: a receiver parked between houses has multipath of tens of metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import static
from insnav.earth import ned_offset
from insnav.strapdown import Intervals
from insnav.types import BoolArray, FloatArray, GpsData

LONGER = 10.0  # a rest that is longer than fixes have it by less says nothing of them [s]
AWAY, AWAY_SD = 50.0, 6.0  # from where it was, beyond which a vehicle has left its place [m], [sd]
MOST = 0.1  # part of the fixes that may be there while it rests
DRIFT = 10.0  # way from the first quarter of a rest to the last that a current makes [m]


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
