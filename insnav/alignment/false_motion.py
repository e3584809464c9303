"""Motion that positions show while the IMU is at rest: a receiver parked between houses wanders by tens of metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import static
from insnav.earth import ned_offset
from insnav.strapdown import Intervals
from insnav.types import FloatArray, GpsData

LONGER = 10.0  # a rest that is longer than fixes have it by less says nothing of them [s]
AWAY, AWAY_SD = 50.0, 6.0  # from where the vehicle rests, beyond which it has left its place [m], [sd]


def without_false_motion(parts: Intervals, gps: GpsData, rest: tuple[float, float] | None) -> GpsData:
    """Fixes as an alignment is to see them: while the IMU goes on resting they are where most of them are.

    What is to move must be pushed: where neither mean nor scatter of gyros and accelerometers changes from those of the
    rest before, positions that leave for some tens of metres are false.

    `rest`: first stationary interval by IMU and fixes [s], or None.
    """
    if rest is None:
        return gps
    end = static.departure(parts, rest)
    rows = np.flatnonzero((gps.time >= rest[0]) & (gps.time < end))
    if end < rest[1] + LONGER or rows.size == 0:
        return gps
    lla, v_n = gps.lla.copy(), gps.v_n.copy()
    place: FloatArray = np.median(lla[rows], axis=0)
    way = np.linalg.norm(ned_offset(lla[rows], place)[:, :2], axis=1)
    if (way > AWAY + AWAY_SD * np.linalg.norm(gps.position_sd[rows, :2], axis=1)).any():
        return gps
    lla[rows] = place
    v_n[rows] *= 0.0
    return replace(gps, lla=lla, v_n=v_n)
