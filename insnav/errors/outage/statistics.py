"""What windows amount to: RMS, 95 % and largest error at chosen times, their intervals, and what was predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.errors.outage.free_inertial import MOTIONS, Windows
from insnav.sample_statistics import effective_count, interval, means
from insnav.types import FloatArray, IntArray

COMPONENTS = ("north", "east", "down", "along", "cross", "horizontal")
_STEP = 10.0  # of the times of the tables, for windows up to a minute [s]
_ROWS = 6  # times of a table of longer ones


@dataclass(frozen=True, slots=True)
class Growth:
    """Errors of windows at some times since their start.

    Attributes
    ----------
    times : (k,) array
        [s]
    count : int
        Number of windows.
    judged : (k,) array
        Number of them whose error is known at each time.
    effective : float
        How many that do not overlap they amount to.
    rms : (k, 6) array
        Root mean square error, less what is the uncertainty of the judge: `COMPONENTS` [m]; ``NaN`` where not known.
    judged_rms : (k, 6) array
        The same with that uncertainty in it [m].
    judge : (k, 6) array
        RMS of that uncertainty [m].
    low, high : (k, 6) array
        Interval of `rms` that holds with 95 % [m]; ``NaN`` if too few windows are independent.
    p95, largest : (k, 6) array
        95 % quantile and largest of the size of the errors, the judge's own in them [m].
    predicted : (k, 6) array
        RMS of the predicted standard deviation [m].
    inside : (k, 6) array
        Share of the errors inside 3 sd of prediction and judge together; of the horizontal error, of both its axes [-].
    """

    times: FloatArray
    count: int
    judged: IntArray
    effective: float
    rms: FloatArray
    judged_rms: FloatArray
    judge: FloatArray
    low: FloatArray
    high: FloatArray
    p95: FloatArray
    largest: FloatArray
    predicted: FloatArray
    inside: FloatArray


def table_times(windows: Windows) -> FloatArray:
    """Times for the tables: 10, 20, …, 60 s, or six of longer windows."""
    step = _STEP if windows.length <= _ROWS * _STEP else _STEP * np.ceil(windows.length / (_ROWS * _STEP))
    times: FloatArray = np.arange(step, windows.length + 1e-6, step)
    return times if len(times) else windows.grid[-1:]


def columns_at(windows: Windows, times: FloatArray) -> IntArray:
    """Columns of the grid nearest to some times."""
    return np.array([int(np.argmin(np.abs(windows.grid - time))) for time in times], dtype=np.int64)


def components(windows: Windows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors, predicted variances and the judge's variances on every axis, and along and across the track.

    Parameters
    ----------
    windows : Windows

    Returns
    -------
    error, variance, judge : (n, k, 6) array
        `COMPONENTS`; of the horizontal error its size, and the sum of the variances on both axes.
    """
    c, s = np.cos(windows.course), np.sin(windows.course)
    north, east, down = np.moveaxis(windows.error[:, :, :3], -1, 0)
    error = np.stack([north, east, down, c * north + s * east, c * east - s * north, np.hypot(north, east)], axis=-1)
    parts = []
    for p in (windows.covariance[:, :, :3, :3], windows.judge_sd[:, :, :3, None] ** 2 * np.eye(3)):
        nn, ee, dd, ne = p[..., 0, 0], p[..., 1, 1], p[..., 2, 2], p[..., 0, 1]
        along, cross = c * c * nn + 2 * c * s * ne + s * s * ee, s * s * nn - 2 * c * s * ne + c * c * ee
        parts.append(np.stack([nn, ee, dd, along, cross, nn + ee], axis=-1))
    return error, parts[0], parts[1]


def growth(windows: Windows, times: FloatArray | None = None) -> Growth:
    """Sum up windows at some times.

    Parameters
    ----------
    windows : Windows
    times : (k,) array, optional
        [s]; those of `table_times` by default.
    """
    times = table_times(windows) if times is None else times
    at = columns_at(windows, times)
    error, variance, judge = (values[:, at] for values in components(windows))
    size = np.abs(error)

    def rms(weights: FloatArray) -> FloatArray:
        return np.sqrt(np.maximum(means(error**2 - judge, weights), 0.0))

    low, high = interval(windows.start, windows.length, rms)
    inside = size <= 3.0 * np.sqrt(variance + judge)
    inside[..., 5] = inside[..., :2].mean(axis=-1)
    known, once = np.isfinite(error), np.ones((1, windows.count))
    return Growth(
        windows.grid[at],
        windows.count,
        known[..., 5].sum(axis=0),
        effective_count(windows.start, windows.length),
        rms(once)[0],
        np.sqrt(means(error**2, once)[0]),
        np.sqrt(means(np.where(known, judge, np.nan), once)[0]),
        low,
        high,
        _quantile(size, 0.95),
        _quantile(size, 1.0),
        np.sqrt(means(np.where(known, variance, np.nan), once)[0]),
        means(np.where(known, inside, np.nan), once)[0],
    )


def by_motion(windows: Windows, times: FloatArray | None = None) -> dict[str, Growth | None]:
    """`growth` of windows at rest, straight and with turns apart; None where there are none."""
    found: dict[str, Growth | None] = {}
    for motion in MOTIONS:
        chosen = windows.motion == motion
        found[motion] = growth(windows.only(chosen), times) if chosen.any() else None
    return found


def _quantile(values: FloatArray, share: float) -> FloatArray:
    """Quantile over the windows of what is known; ``NaN`` where nothing is."""
    none = ~np.isfinite(values).any(axis=0)
    found = np.nanquantile(np.where(none, 0.0, values), share, axis=0)
    return np.asarray(np.where(none, np.nan, found))
