"""Difference of the short-duration and the full mechanization, in windows of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from insnav import strapdown
from insnav.earth import earth_rate_n, ned_offset, transport_rate_n
from insnav.exceptions import InputError
from insnav.strapdown import navigate_short
from insnav.types import FloatArray, ImuData, Increments, SensorErrors, Trajectory

LENGTH = 60.0  # of a window [s]
KEEP = 0.5  # interval of the compared states [s]


@dataclass(frozen=True, slots=True)
class ShortWindow:
    """Short form minus full form over one window, from the same state."""

    start: float  # time of the start [s]
    speed: float  # mean horizontal speed [m/s]
    elapsed: FloatArray  # (n,) time since the start [s]
    # (n, 3) difference North, East, Down [m], [m/s]; the attitude of both comes from the full form
    position: FloatArray
    velocity: FloatArray
    dropped: FloatArray  # (n, 3) position error of the omitted terms, integrated along the full form [m]
    # (n, 3) position error if the attitude also omits Earth and transport rate [m]
    untilted: FloatArray

    @property
    def rest(self) -> FloatArray:
        """Position difference that the omitted terms do not explain: Euler's rule [m], ``(n, 3)``."""
        return self.position - self.dropped


def short_windows(imu: ImuData, solution: Trajectory, sensor_errors: SensorErrors | None = None) -> list[ShortWindow]:
    """Run both mechanizations free-inertial through successive windows of a drive.

    `sensor_errors`: biases and scale factors known at the start of a window, corrected in its samples.
    Returns: successive windows of a minute without a data gap. Raises: InputError: the drive is too short, or every
    window has a gap.
    """
    parts = strapdown.intervals(imu)
    inc = strapdown.increments(parts)
    every = max(1, round(KEEP / strapdown.nominal_interval(imu.time)))
    windows = []
    tolerance = strapdown.TIME_TOLERANCE
    starts = inc.time - inc.dt
    for begin in np.arange(float(solution.time[0]), float(solution.time[-1]) - LENGTH + tolerance, LENGTH):
        # an index error of one sample is irrelevant: both forms start from the same state
        state = int(np.searchsorted(solution.time, begin))
        first = int(np.searchsorted(starts, solution.time[state] - tolerance))
        last = int(np.searchsorted(inc.time, starts[min(first, len(starts) - 1)] + LENGTH + tolerance))
        if last <= first or inc.time[last - 1] - starts[first] < LENGTH - KEEP or parts.gap[first:last].any():
            continue
        if not np.isfinite(solution.rph[state]).all():  # near a pole
            continue
        piece = inc.rows(slice(first, last))
        windows.append(_compared(_corrected(piece, sensor_errors, begin), solution, state, every))
    if not windows:
        raise InputError("diagnosis.no_short_window", length_s=LENGTH, duration_s=solution.time[-1] - solution.time[0])
    return windows


def size_at(windows: Sequence[ShortWindow], name: str, elapsed: float) -> FloatArray:
    """Compute the horizontal size of a difference in each window at a time since its start.

    `name` {"position", "velocity", "dropped", "rest", "untilted"}. `elapsed` [s].
    Returns: (n,): per window [m] or [m/s].
    """
    rows = [int(np.argmin(np.abs(window.elapsed - elapsed))) for window in windows]
    return np.array([np.hypot(*getattr(window, name)[row, :2]) for window, row in zip(windows, rows, strict=True)])


def _compared(piece: Increments, solution: Trajectory, state: int, every: int) -> ShortWindow:
    start = solution.lla[state], solution.v_n[state], solution.rph[state]
    full = strapdown.navigate(piece, *start, every=every)
    short = navigate_short(piece, *start, every=every)
    untilted = navigate_short(piece, *start, every=every, turning=False)
    begin = float(piece.time[0] - piece.dt[0])
    elapsed = full.time - begin
    rate = 2.0 * earth_rate_n(full.lla[:, 0]) + transport_rate_n(full.lla[:, 0], full.lla[:, 2], full.v_n)
    speed = _integral(elapsed, np.cross(rate, full.v_n))
    return ShortWindow(
        begin,
        float(np.mean(np.hypot(full.v_n[:, 0], full.v_n[:, 1]))),
        elapsed,
        ned_offset(short.lla, full.lla),
        short.v_n - full.v_n,
        _integral(elapsed, speed),
        ned_offset(untilted.lla, full.lla),
    )


def _integral(elapsed: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate by the trapezoid rule from zero, with the first value as value before it."""
    step = np.diff(elapsed, prepend=0.0)[:, None]
    before = np.concatenate([values[:1], values[:-1]])
    return np.asarray(np.cumsum(0.5 * step * (before + values), axis=0))


def _corrected(piece: Increments, errors: SensorErrors | None, begin: float) -> Increments:
    """Correct biases and scale factor errors known at the start of the window."""
    if errors is None or len(errors.time) == 0:
        return piece
    row = max(0, int(np.searchsorted(errors.time, begin, side="right")) - 1)
    known = np.nan_to_num(errors.value[row])
    gyro, accel = 1.0 + known[6:9], 1.0 + known[9:12]
    dt = piece.dt[:, None]
    return replace(piece, dtheta=(piece.dtheta - dt * known[0:3]) / gyro, dvel=(piece.dvel - dt * known[3:6]) / accel)
