"""What happens without GPS: fixes are withheld in windows all over a drive and compared with what was navigated.

Every window goes on from the state the filter had at its first epoch, with all fixes before it and none within. The
fixes after it are given back for a while, so that the smoother has both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from insnav.attitude import rph_from_quat, wrap_pi
from insnav.errors.outage.windows import good, part_of, shown_only
from insnav.exceptions import ConfigError, InputError
from insnav.filter.error_model import FilterState
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import Prepared
from insnav.types import FloatArray, GpsData

RECOVERY = 60.0  # time after the window whose fixes the smoother gets [s]
SETTLED = 60.0  # no window begins earlier after the start, if the drive is long enough [s]
LENGTHS = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0)  # [s]
_COURSE = 0.1  # interval of the smoothed heading [s]
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
    heading : (k,) array
        Heading of the filter minus that of the drive smoothed with all fixes [rad].
    heading_sd : (k,) array
        Standard deviation of the filter's heading [rad].
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
    heading: FloatArray
    heading_sd: FloatArray
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
    whole = replace(ready, settings=replace(ready.settings, smooth=True, output_interval=_COURSE))
    navigator = whole.navigator(marks=set(rows.tolist()))
    share = 0.3  # of the work is the drive itself
    feed(navigator, ready.imu, None if progress is None else lambda done: progress(share * done))
    run = navigator.finish()
    smoothed = run.smoothed
    assert smoothed is not None
    # back from GPS time to that of the samples
    clock = run.gps_delay - ready.settings.delay
    course = np.column_stack([smoothed.solution.time - clock, np.unwrap(smoothed.solution.rph[:, 2])])
    tasks = [
        (row, state, length)
        for length in lengths
        for row, state in sorted(navigator.kept.items())
        if state.time + length <= end + 1e-6
    ]
    if workers == 1:
        found = []
        for number, task in enumerate(tasks, start=1):
            found.append(_window(ready, truth, course, *task))
            if progress is not None:
                progress(share + (1.0 - share) * number / len(tasks))
    else:
        from joblib import Parallel, delayed

        results = Parallel(n_jobs=workers, return_as="generator")(
            delayed(_window)(part_of(ready, task[1], task[2] + RECOVERY), truth, course, *task) for task in tasks
        )
        found = []
        for number, each in enumerate(results, start=1):
            found.append(each)
            if progress is not None:
                progress(share + (1.0 - share) * number / len(tasks))
    return [each for each in found if each is not None and each.elapsed.size]


@dataclass(frozen=True, slots=True)
class Growth:
    """How errors have grown at the end of windows of one length.

    Attributes
    ----------
    length : float
        [s]
    count : int
        Number of windows.
    quantities : dict
        For ``horizontal``, ``vertical``, ``velocity``, ``heading`` by the filter, and for ``smoothed horizontal`` and
        ``smoothed vertical`` (the largest in the window): RMS without the part that is the judge's own uncertainty,
        95 % quantile, largest, and RMS of the predicted standard deviation. SI units.
    inside : float
        Share of the north, east and down errors at the end that are inside 3 sd [-].
    """

    length: float
    count: int
    quantities: dict[str, tuple[float, float, float, float]]
    inside: float


def growth(windows: Sequence[Outage]) -> list[Growth]:
    """Sum up windows by their length.

    Parameters
    ----------
    windows : sequence of Outage
        From `outages`.
    """
    found = []
    for length in sorted({window.length for window in windows}):
        chosen = [window for window in windows if window.length == length]
        error, sd, judge = (np.array([getattr(w, name)[-1] for w in chosen]) for name in ("error", "sd", "judge_sd"))
        smoothed = np.array([_largest(w) for w in chosen])
        quantities = {
            "horizontal": _figures(error[:, :2], sd[:, :2], judge[:, :2]),
            "vertical": _figures(error[:, 2:3], sd[:, 2:3], judge[:, 2:3]),
            "velocity": _figures(error[:, 3:], sd[:, 3:], judge[:, 3:]),
            "heading": _figures(
                np.array([w.heading[-1:] for w in chosen]),
                np.array([w.heading_sd[-1:] for w in chosen]),
                np.zeros((len(chosen), 1)),
            ),
            "smoothed horizontal": _figures(smoothed[:, :2], smoothed[:, 3:5], smoothed[:, 6:8]),
            "smoothed vertical": _figures(smoothed[:, 2:3], smoothed[:, 5:6], smoothed[:, 8:]),
        }
        inside = np.abs(error[:, :3]) <= 3.0 * np.hypot(sd[:, :3], judge[:, :3])
        found.append(Growth(length, len(chosen), quantities, float(np.mean(inside))))
    return found


def _largest(window: Outage) -> FloatArray:
    """Smoothed error, sd and the judge's sd of N, E, D where the horizontal error is largest, (9,)."""
    at = int(np.nanargmax(np.hypot(window.smoothed[:, 0], window.smoothed[:, 1])))
    return np.concatenate([window.smoothed[at, :3], window.smoothed_sd[at, :3], window.judge_sd[at, :3]])


def _figures(error: FloatArray, sd: FloatArray, judge: FloatArray) -> tuple[float, float, float, float]:
    """RMS less the judge's part, 95 % quantile, largest, predicted; of vectors in rows, NaN where not known."""
    known = np.isfinite(error).all(axis=1)
    if not known.any():
        return (float("nan"),) * 4
    size = np.linalg.norm(error[known], axis=1)
    own = float(np.mean(np.nansum(judge[known] ** 2, axis=1)))
    return (
        float(np.sqrt(max(np.mean(size**2) - own, 0.0))),
        float(np.quantile(size, 0.95)),
        float(size.max()),
        float(np.sqrt(np.mean(np.sum(sd[known] ** 2, axis=1)))),
    )


def _window(
    ready: Prepared, truth: GpsData | None, course: FloatArray, row: int, state: FilterState, length: float
) -> Outage | None:
    """Navigate one window and what follows it."""
    delay = ready.settings.delay
    start, stop = state.time + delay, state.time + delay + length
    gps = _judged(ready.gps, truth, start, stop, stop + RECOVERY)
    inside = (gps.time > start + 1e-6) & (gps.time <= stop + 1e-6)
    if not inside.any():
        return None
    # no longer output than needed: only the epochs count
    settings = replace(ready.settings, output_interval=1.0, smooth=True)
    part = part_of(ready, state, length + RECOVERY)
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
        wrap_pi(rph_from_quat(offered.state[at, 6:])[:, 2] - np.interp(offered.time[at], *course.T)),
        np.sqrt(values[:, 24]),
        float(np.mean(speed)),
    )


def _judged(gps: GpsData, truth: GpsData | None, start: float, stop: float, end: float) -> GpsData:
    """Fixes from `start` to `end`, those until `stop` marked as none; they, or the truth instead, are only compared."""
    later = (gps.time > start + 1e-6) & (gps.time <= end)
    inside = later & (gps.time <= stop + 1e-6)
    if truth is None:
        withheld = gps.rows(inside & good(gps))
    else:
        time = truth.time
        chosen = (time > start + 1e-6) & (time <= stop + 1e-6)
        step = float(np.median(np.diff(time))) if time.shape[0] > 1 else _JUDGED
        stride = max(1, round(_JUDGED / step))
        chosen &= (np.arange(time.shape[0]) - int(np.searchsorted(time, stop + 1e-6)) + 1) % stride == 0
        withheld = truth.rows(chosen)
    after = gps.rows(later & ~inside)
    if after.fix is None:
        after = replace(after, fix=np.ones(after.time.shape[0], dtype=np.int64))
    # the headings of the receiver are lost with its fixes, and back with them
    unknown = None if gps.heading is None else np.full(withheld.time.shape[0], np.nan)
    return replace(shown_only(withheld), heading=unknown).joined(after)
