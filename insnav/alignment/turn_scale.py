"""Scale of the gyros by the course over ground: degrees taken for radians show at once."""

from __future__ import annotations

import numpy as np

from insnav.alignment.in_motion import velocity
from insnav.strapdown import Intervals
from insnav.types import FloatArray, GpsData

SPAN = 2.0  # over which turns are compared [s]
FEWEST = 20  # spans that can tell
TURNS = 0.04  # RMS turn of the spans that can tell [rad]
SHARP = 2.5  # larger turns may go the other way round [rad]


def turn_scale(parts: Intervals, gps: GpsData) -> tuple[float, float]:
    """Turn of the course for a turn by the gyros, and the correlation of the two; zeros if nothing turns.

    Turns are those about the mean specific force, which is near the vertical of all vehicles on the ground.
    """
    speed = velocity(gps)
    rows = np.flatnonzero(speed.fast)
    if rows.size < FEWEST:
        return 0.0, 0.0
    scale = parts.dt[:, None] if parts.instant else 1.0
    up = np.sum(parts.accel * scale, axis=0)
    turn: FloatArray = np.cumsum((parts.gyro * scale) @ (-up / max(float(np.linalg.norm(up)), 1e-9)))
    step = max(1, round(SPAN / max(float(np.median(np.diff(speed.time))), 1e-3)))
    first, last = rows[:-step], rows[step:]
    whole = (last - first == step) & (speed.time[first] > parts.end[0]) & (speed.time[last] < parts.end[-1])
    first, last = first[whole], last[whole]
    course = np.unwrap(np.arctan2(speed.v_n[:, 1], speed.v_n[:, 0]))
    seen = course[last] - course[first]
    felt = np.interp(speed.time[last], parts.end, turn) - np.interp(speed.time[first], parts.end, turn)
    small = np.abs(seen) < SHARP
    if np.count_nonzero(small) < FEWEST:
        return 0.0, 0.0
    seen, felt = seen[small] - seen[small].mean(), felt[small] - felt[small].mean()
    power = float(np.sum(felt**2))
    if float(np.std(seen)) < TURNS or power == 0.0:
        return 0.0, 0.0
    both = float(np.sum(seen * felt))
    return both / power, both / float(np.sqrt(power * np.sum(seen**2)))
