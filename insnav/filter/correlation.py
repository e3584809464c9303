"""Errors of GPS positions that last: their share and their correlation time, from positions and velocities.

Multipath and atmosphere change over tens of seconds. A filter that takes such errors for white believes the mean of
many fixes far too much. Here they are found where velocities are given, and become states of the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from insnav.earth import ned_offset
from insnav.types import FloatArray, GpsData

LONGEST = 400.0  # longest time over which errors are compared [s]
TIMES = np.geomspace(3.0, 300.0, 25)  # correlation times tried [s]
WORTH = 0.1  # a smaller share of the variance is not modelled [-]
FEWEST = 100  # fixes needed
ROUGH = 0.05  # largest error of the integrated velocity between fixes, by the sd of a fix [-]
TOO_MUCH = 3.0  # a larger variance, by the claimed one, is something else than the error of the fixes [-]


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """Gauss-Markov part of the position error.

    Attributes
    ----------
    share : float
        Of the variance of a fix [-].
    time : float
        Correlation time [s].
    sd : (3,) array
        Standard deviation of that part, North, East, Down [m].
    """

    share: float
    time: float
    sd: FloatArray


def correlated_noise(gps: GpsData, lag: float) -> CorrelatedNoise | None:
    """Find the part of the position error that lasts.

    Position change minus integrated velocity over m fixes is the difference of two position errors plus the sum of m
    velocity errors. Half its variance grows from the white part, for small m, to the whole variance, for large m, with
    the velocity noise as a straight line on top; a non-negative fit separates the three.

    Parameters
    ----------
    gps : GpsData
        Fixes with standard deviations.
    lag : float
        How much older than positions velocities are [s].

    Returns
    -------
    CorrelatedNoise or None
        None where there are no velocities, too few fixes, or nothing that lasts.
    """
    good = np.isfinite(gps.v_n).all(axis=1) & np.isfinite(gps.position_sd).all(axis=1)
    if good.sum() < FEWEST:
        return None
    t, sd = gps.time[good], gps.position_sd[good]
    step = np.diff(t)
    usual = float(np.median(step))
    gap = step > 1.5 * usual
    lla, v = gps.lla[good], gps.v_n[good][:, :2]
    gone = ned_offset(lla[1:], lla[:-1])[:, :2]
    felt = np.diff(CubicSpline(t, v).antiderivative()(t + lag), axis=0)
    # what half as many velocities would change, by the fourth order of the spline 16 times the error of all
    half = np.diff(CubicSpline(t[::2], v[::2]).antiderivative()(t + lag), axis=0)
    even = ~np.logical_or(gap[0:-1:2], gap[1::2])
    missing = (half - felt)[: 2 * even.shape[0]].reshape(-1, 2, 2).sum(axis=1)[even] / 16.0
    if missing.size == 0 or np.sqrt(np.mean(missing**2)) > ROUGH * float(np.median(sd[:, :2])):
        return None  # velocities too far apart in time to be integrated as well as positions are measured
    error = np.vstack([np.zeros(2), np.cumsum(gone - felt, axis=0)])  # position error minus the sum of velocity errors
    stretch = np.concatenate([[0], np.cumsum(gap)])
    most = min(LONGEST / usual, t.shape[0] / 4)
    lags = np.unique(np.geomspace(1, max(most, 2), 30).astype(int))
    level, weight = [], []
    for m in lags:
        whole = stretch[m:] == stretch[:-m]
        if whole.sum() < 20:
            continue
        d = (error[m:] - error[:-m])[whole] / sd[:, :2][m:][whole]
        # half the squared difference; the median is not moved by single outliers (chi-square with one degree)
        level.append(0.5 * float(np.median(d * d)) / 0.4549)
        weight.append(np.sqrt(whole.sum() / m))
    if len(level) < 8:
        return None
    x, y = lags[: len(level)] * usual, np.array(level)
    scale = np.array(weight) / (y + 0.05)
    ones = np.ones_like(x)
    white_only = nnls(np.column_stack([ones, x]) * scale[:, None], y * scale)[1]
    best: tuple[float, float, FloatArray] | None = None
    for time in TIMES:
        terms = np.column_stack([ones, 1.0 - np.exp(-x / time), x])
        parts, rest = nnls(terms * scale[:, None], y * scale)
        if best is None or rest < best[0]:
            best = float(rest), float(time), parts
    assert best is not None
    rest, time, (white, lasting, _) = best
    if time == TIMES[0] or 5.0 * time > x[-1] or white + lasting > TOO_MUCH:
        return None
    share = float(lasting / (white + lasting)) if white + lasting > 0 else 0.0
    # the third term must earn its place, and be a visible part of what the fixes claim

    if share < WORTH or rest > 0.8 * white_only or lasting < 0.05:
        return None
    share = min(share, 0.95)
    return CorrelatedNoise(share, time, np.sqrt(share) * np.median(sd, axis=0))
