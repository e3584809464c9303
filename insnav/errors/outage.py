"""What happens without GPS: fixes are withheld in windows all over a drive and compared with what was navigated.

Every window goes on from the state the filter had at its first epoch, with all fixes before it and none within. The
fixes after it are given back for a while, so that the smoother has both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.filter.model import FilterState
from insnav.filter.navigator import Navigator
from insnav.filter.recording import Prepared, feed
from insnav.types import FloatArray, GpsData, ImuData

RECOVERY = 60.0  # time after the window whose fixes the smoother gets [s]
SETTLED = 60.0  # no window begins earlier after the start, if the drive is long enough [s]
LENGTHS = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0)  # [s]
_LEAD = 2.0  # samples before the window, for the polynomials at its first interval [s]
_JUDGED = 0.25  # a truth that comes more often is thinned to this interval [s]


@dataclass(frozen=True, slots=True)
class Outage:
    """One window without fixes, seen at the withheld fixes (or the epochs of a reference) in it.

    Attributes
    ----------
    start, length : float
        Time of the last fix before it, and length [s].
    elapsed : (k,) array
        Time since `start` [s].
    error, smoothed : (k, 6) array
        Navigated minus withheld position North, East, Down [m] and velocity [m/s], by filter and smoother; ``NaN``
        where the fix has no such value.
    sd, smoothed_sd : (k, 6) array
        Standard deviation of what was navigated.
    judge_sd : (k, 6) array
        Standard deviation of what it is judged by.
    speed : float
        Mean speed in the window [m/s].
    """

    start: float
    length: float
    elapsed: FloatArray
    error: FloatArray
    sd: FloatArray
    smoothed: FloatArray
    smoothed_sd: FloatArray
    judge_sd: FloatArray
    speed: float


def outages(
    ready: Prepared,
    *,
    lengths: Sequence[float] = LENGTHS,
    first: float | None = None,
    spacing: float | None = None,
    truth: GpsData | None = None,
    workers: int = 1,
    progress: Callable[[float], None] | None = None,
) -> list[Outage]:
    """Withhold fixes in windows all over a drive.

    Parameters
    ----------
    ready : Prepared
        The drive.
    lengths : sequence of float
        Lengths of the windows [s].
    first : float, optional
        Where the first window begins, after the start of navigation [s]; a minute, or less if the drive is short.
    spacing : float, optional
        From the begin of one window to that of the next of the same length [s]; by default so that about sixty fit.
        Windows overlap if it is less than their length: each goes on from the filter that had all fixes before it.
    truth : GpsData, optional
        What to judge by instead of the withheld fixes: a better position of the antenna.
    workers : int
        Processes.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    list of Outage
        In order of length, then of time.

    Raises
    ------
    ConfigError
        Lengths or spacing that are not above zero.
    InputError
        The drive is too short for any window.
    """
    lengths = sorted(set(lengths))
    wrong = [value for value in (*lengths, *([] if spacing is None else [spacing])) if not 0.0 < value < np.inf]
    if wrong or not lengths:
        raise ConfigError("windows need a length and a spacing above zero", why=f"given were {wrong or 'none'}")
    gps = ready.gps
    begin, end = ready.initial.time, float(min(ready.imu.time[-1], gps.time[-1] - ready.settings.delay))
    first = min(SETTLED, 0.25 * (end - begin)) if first is None else first
    spacing = max(2.0, (end - begin - first) / 60.0) if spacing is None else spacing
    starts = np.arange(begin + first, end - lengths[0] + 1e-6, spacing)
    rows = np.unique(np.searchsorted(gps.time - ready.settings.delay, starts - 1e-6))
    if not starts.size:
        raise InputError(
            "the drive is too short for an outage",
            why=f"{end - begin:.0f} s, of which the first {first:.0f} s are for the filter to settle; the shortest "
            f"window is {lengths[0]:g} s",
            fix="give shorter windows with --lengths or an earlier --first",
        )
    navigator = ready.navigator(marks=set(rows.tolist()))
    share = 0.3  # of the work is the drive itself
    feed(navigator, ready.imu, None if progress is None else lambda done: progress(share * done))
    navigator.finish()
    tasks = [
        (row, state, length)
        for length in lengths
        for row, state in sorted(navigator.kept.items())
        if state.time + length <= end + 1e-6
    ]
    if workers == 1:
        found = []
        for number, task in enumerate(tasks, start=1):
            found.append(_window(ready, truth, *task))
            if progress is not None:
                progress(share + (1.0 - share) * number / len(tasks))
    else:
        from joblib import Parallel, delayed

        results = Parallel(n_jobs=workers, return_as="generator")(
            delayed(_window)(_part(ready, *task[1:]), truth, *task) for task in tasks
        )
        found = []
        for number, each in enumerate(results, start=1):
            found.append(each)
            if progress is not None:
                progress(share + (1.0 - share) * number / len(tasks))
    return [each for each in found if each is not None and each.elapsed.size]


def _part(ready: Prepared, state: FilterState, length: float) -> Prepared:
    """Only the samples that a window needs, to be sent to another process."""
    time = ready.imu.time
    first, last = np.searchsorted(time, [state.time - _LEAD, state.time + length + RECOVERY + _LEAD])
    imu = ready.imu
    part = ImuData(time[first:last], imu.gyro[first:last], imu.accel[first:last], imu.sampling, imu.stamp)
    return replace(ready, imu=part)


def _window(ready: Prepared, truth: GpsData | None, row: int, state: FilterState, length: float) -> Outage | None:
    """Navigate one window and what follows it."""
    delay = ready.settings.delay
    start, stop = state.time + delay, state.time + delay + length
    gps = _judged(ready.gps, truth, start, stop, stop + RECOVERY)
    inside = (gps.time > start + 1e-6) & (gps.time <= stop + 1e-6)
    if not inside.any():
        return None
    # no longer output than needed: only the epochs count
    settings = replace(ready.settings, output_interval=1.0, smooth=True)
    part = _part(ready, state, length)
    navigator = Navigator(state, ready.model, gps, ready.alignment, ready.nominal, settings)
    feed(navigator, part.imu)
    offered = navigator.offered()
    at = np.searchsorted(offered.time, gps.time[inside] - delay - 1e-6)
    at = at[at < offered.time.shape[0]]
    values = offered.offered[at]
    judge = np.column_stack([gps.position_sd[inside], gps.velocity_sd[inside]])[: at.shape[0]]
    speed = np.linalg.norm(offered.state[at, 3:6], axis=1)
    return Outage(
        start,
        length,
        offered.time[at] - state.time,
        values[:, :6],
        np.sqrt(np.maximum(values[:, 6:12], 0.0)),
        values[:, 12:18],
        np.sqrt(np.maximum(values[:, 18:24], 0.0)),
        judge,
        float(np.mean(speed)),
    )


def _judged(gps: GpsData, truth: GpsData | None, start: float, stop: float, end: float) -> GpsData:
    """Fixes from `start` to `end`, those until `stop` marked as none; they, or the truth instead, are only compared."""
    later = (gps.time > start + 1e-6) & (gps.time <= end)
    inside = later & (gps.time <= stop + 1e-6)
    good = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix
    if truth is None:
        withheld = _rows(gps, inside & (good != 0))
    else:
        time = truth.time
        chosen = (time > start + 1e-6) & (time <= stop + 1e-6)
        step = float(np.median(np.diff(time))) if time.shape[0] > 1 else _JUDGED
        stride = max(1, round(_JUDGED / step))
        chosen &= (np.arange(time.shape[0]) - int(np.searchsorted(time, stop + 1e-6)) + 1) % stride == 0
        withheld = _rows(truth, chosen)
    after = _rows(gps, later & ~inside)
    fixes = np.concatenate([np.zeros(withheld.time.shape[0], dtype=np.int64), good[later & ~inside]])
    return GpsData(
        np.concatenate([withheld.time, after.time]),
        np.concatenate([withheld.lla, after.lla]),
        np.concatenate([withheld.v_n, after.v_n]),
        np.concatenate([withheld.position_sd, after.position_sd]),
        np.concatenate([withheld.velocity_sd, after.velocity_sd]),
        fixes,
    )


def _rows(gps: GpsData, chosen: FloatArray | np.ndarray) -> GpsData:
    return GpsData(gps.time[chosen], gps.lla[chosen], gps.v_n[chosen], gps.position_sd[chosen], gps.velocity_sd[chosen])
