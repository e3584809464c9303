"""Motion that positions show while the IMU is at rest: one parked between houses has multipath of tens of metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import static
from insnav.earth import ned_offset
from insnav.strapdown import Intervals
from insnav.types import FloatArray, GpsData

LONGER = 10.0  # a rest that is longer than fixes have it by less says nothing of them [s]
# From where the vehicle rests, beyond which it has left its place if more than this part of the fixes are there [m],
# [sd], [-]; and way from the first quarter of the rest to the last that a current makes [m].
AWAY, AWAY_SD, MOST, DRIFT = 50.0, 6.0, 0.1, 10.0


def without_false_motion(parts: Intervals, gps: GpsData, rest: tuple[float, float] | None) -> GpsData:
    """Fixes as an alignment is to see them: while the IMU goes on resting they are where most of them are.

    What is to move must be pushed: where neither mean nor scatter of gyros and accelerometers changes from those of the
    rest before, positions that leave for some tens of metres, and come back, are false. Receivers that give velocities
    know that themselves.

    `rest`: first stationary interval by IMU and fixes [s], or None.
    """
    if rest is None or np.isfinite(gps.v_n).all(axis=1).mean() > 0.5:
        return gps
    end = static.departure(parts, rest)
    rows = np.flatnonzero((gps.time >= rest[0]) & (gps.time < end))
    if end < rest[1] + LONGER or rows.size < 4:
        return gps
    place: FloatArray = np.median(gps.lla[rows], axis=0)
    off = ned_offset(gps.lla[rows], place)[:, :2]
    far = np.linalg.norm(off, axis=1) > AWAY + AWAY_SD * np.linalg.norm(gps.position_sd[rows, :2], axis=1)
    quarter = rows.size // 4
    drift = np.median(off[-quarter:], axis=0) - np.median(off[:quarter], axis=0)
    if far.mean() > MOST or np.hypot(*drift) > DRIFT:
        return gps
    lla = gps.lla.copy()
    lla[rows] = place
    return replace(gps, lla=lla)
