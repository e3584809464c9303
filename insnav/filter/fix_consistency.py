"""What receivers and converters confuse, found from positions and velocities of the same fixes."""

from __future__ import annotations

import numpy as np

from insnav.earth import ned_offset
from insnav.types import FloatArray, GpsData

BASE = 4.0  # displacements are taken over so long: longer than the noise of positions, shorter than a bend [s]
FEWEST = 20  # displacements that can tell
FASTER = 2.0  # slower ones are noise [m/s]
CONTRADICTED = 0.35  # part of the displacements that velocities leave unexplained, from which they are wrong
EXPLAINED = 0.2  # ... and at most, from which another reading is right
VERTICAL = 6.0  # standard deviations of the slope of climb by vertical velocity, for its sign

# what velocities (N, E, D) would be if columns or signs were confused: matrix, and what it means
_MATRICES = (
    (np.diag([-1.0, -1.0, 1.0]), "the velocities have the opposite sign"),
    (np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), "the velocities are East, North, Up"),
    (np.diag([-1.0, 1.0, 1.0]), "the North velocity has the opposite sign"),
    (np.diag([1.0, -1.0, 1.0]), "the East velocity has the opposite sign"),
    (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "the velocities are turned by 90 deg"),
)
_UNITS = (
    (1.0 / 3.6, "the velocities are in km/h"),
    (0.514444, "the velocities are in knots"),
    (0.44704, "the velocities are in miles per hour"),
    (0.01, "the velocities are in cm/s"),
    (0.001, "the velocities are in mm/s"),
)


def confusion(gps: GpsData) -> tuple[str, str]:
    """What contradicts what in fixes, and the evidence; empty texts if nothing does, or nothing tells.

    `gps`: fixes with velocities.
    """
    ahead = np.searchsorted(gps.time, gps.time + BASE - 1e-3)
    first = np.flatnonzero(ahead < gps.time.shape[0])
    last = ahead[first]
    span = gps.time[last] - gps.time[first]
    known = np.isfinite(gps.v_n).all(axis=1)
    lost = np.concatenate([[0], np.cumsum(~known)])
    near = (span < 1.5 * BASE) & (lost[last + 1] == lost[first]) & (last > first)
    first, last, span = first[near], last[near], span[near]
    if first.size < FEWEST:
        return "", ""
    step = np.diff(gps.time)[:, None] * 0.5 * (gps.v_n[1:] + gps.v_n[:-1])
    way = np.vstack([np.zeros(3), np.cumsum(np.where(np.isfinite(step), step, 0.0), axis=0)])
    v = (way[last] - way[first]) / span[:, None]
    moved = ned_offset(gps.lla[last], gps.lla[first]) / span[:, None]
    fast = np.maximum(np.hypot(v[:, 0], v[:, 1]), np.hypot(moved[:, 0], moved[:, 1])) > FASTER
    if fast.sum() < FEWEST:
        return "", ""
    v, moved, ends = v[fast], moved[fast], (gps.lla[first[fast]], gps.lla[last[fast]])
    given = _left(moved, v)
    if given > CONTRADICTED:
        readings = [(_left(moved, v @ matrix.T), text) for matrix, text in _MATRICES]
        readings += [(_left(moved, scale * v), text) for scale, text in _UNITS]
        scale = np.array([180.0 / np.pi, 180.0 / np.pi, 1.0])
        for text, (start, end) in (
            ("latitude and longitude are exchanged", tuple(each[:, [1, 0, 2]] for each in ends)),
            ("the positions are in radians, read as degrees", tuple(each * scale for each in ends)),
        ):
            if np.abs(start[:, 0]).max() < np.pi / 2 and np.abs(end[:, 0]).max() < np.pi / 2:
                readings.append((_left(ned_offset(end, start) / span[fast][:, None], v), text))
        left, text = min(readings)
        if left < EXPLAINED and left < CONTRADICTED * given:
            return text, (
                f"as read, half of the displacements between fixes differ from their velocities by more than "
                f"{100.0 * given:.0f} % of their length; so by less than {100.0 * left:.0f} %"
            )
        return "", ""
    power = float(np.sum(v[:, 2] ** 2))
    slope = float(np.sum(moved[:, 2] * v[:, 2])) / max(power, 1e-12)
    scatter = float(np.std(moved[:, 2] - slope * v[:, 2])) * np.sqrt(BASE / float(np.median(np.diff(gps.time))))
    if slope < -0.5 and slope < -VERTICAL * scatter / np.sqrt(max(power, 1e-12)):
        return "the vertical velocity is up, read as down", f"heights change by {slope:.2f} times its integral"
    return "", ""


def _left(moved: FloatArray, v: FloatArray) -> float:
    """Median horizontal difference, in parts of the length of the larger."""
    size = np.maximum(np.hypot(moved[:, 0], moved[:, 1]), np.hypot(v[:, 0], v[:, 1]))
    return float(np.median(np.hypot(*(moved - v)[:, :2].T) / np.maximum(size, 1e-9)))
