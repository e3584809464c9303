"""Time-correlated errors of GPS positions: their share and correlation time, from positions and velocities.

Multipath and atmosphere change over tens of seconds. A filter that assumes white errors is over-confident: it averages
many fixes. With velocities, this module estimates the errors, which become states of the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.earth import ned_offset
from insnav.spline import Spline, positive_parts
from insnav.types import FloatArray, GpsData

LONGEST = 400.0  # longest time over which errors are compared [s]
TIMES = np.geomspace(3.0, 300.0, 25)  # correlation times tried [s]
WORTH = 0.1  # a smaller share of the variance has no effect on the filter [-]
FEWEST = 100  # fixes; fewer determine no correlation time
ROUGH = 0.05  # largest error of the integrated velocity between fixes, by the sd of a fix [-]
WHOLE = 0.7  # a smaller share of the reported variance is seen only in part [-]
WORTH_REPORTED = 0.3  # least share of the reported variance, missing in the data, to assume as time-correlated [-]
MISFIT = 1.3  # largest misfit, relative to white errors alone, to accept the reported variance [-]
SHORTEST_REPORTED = 10.0  # shorter correlation times would be visible [s]
TOO_MUCH = 3.0  # an apparent variance beyond this multiple of the reported one has other causes [-]
MOST = 0.95  # largest share: part of the error is always white [-]
BETTER = 0.8  # largest misfit with a correlated part, relative to white errors alone, to accept that part [-]
CHI2_MEDIAN = 0.4549  # median of chi-square with one degree of freedom


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """Gauss-Markov part of the errors of position and, where it was found, of velocity."""

    share: float  # of the variance of a fix [-]
    time: float  # correlation time [s]
    sd: FloatArray  # (3,) standard deviation of that part, North, East, Down [m]
    by_reported: bool = False  # inferred only from the reported variance that is missing between successive fixes
    velocity_sd: FloatArray | None = None  # (3,) sd of the time-correlated velocity error [m/s]; None without
    velocity_time: float = np.inf  # its correlation time [s]

    @property
    def sds(self) -> FloatArray:
        """Standard deviations of the states, (3,) or (6,) [m, m/s]."""
        return self.sd if self.velocity_sd is None else np.concatenate([self.sd, self.velocity_sd])

    @property
    def times(self) -> FloatArray:
        """Correlation times of the states, (3,) or (6,) [s]."""
        return np.repeat([self.time, self.velocity_time], 3)[: self.sds.size]


@dataclass(frozen=True, slots=True)
class Rough:
    """Interval with more driving noise of the time-correlated position error: multipath."""

    begin: float  # [s]
    end: float
    driven: float  # root of the spectral density of that noise, each axis [m/sqrt(s)]
    time: float  # correlation time of the error [s]

    @property
    def sd(self) -> float:
        """Stationary standard deviation from this noise [m]."""
        return float(self.driven * np.sqrt(0.5 * self.time))

    def drive(self, now: float, times: FloatArray, sds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return correlation times [s] and standard deviations of the states at time `now`, positions first."""
        if not self.begin <= now < self.end + 3.0 * self.time:  # then the remaining error has decayed
            return times, sds
        times, sds = times.copy(), sds.copy()
        times[:3] = self.time
        if now < self.end:
            sds[:3] = np.hypot(sds[:3], self.sd)
        return times, sds


def correlated_noise(gps: GpsData, lag: float, *, reported: bool = True) -> CorrelatedNoise | None:
    """Estimate the time-correlated part of the position error.

    Position change minus integrated velocity over m fixes is the difference of two position errors plus the sum of m
    velocity errors. Half its variance grows from the white part at small m to the whole variance at large m. Velocity
    noise adds a straight line. A non-negative fit separates the three.

    `lag`: lag of velocities behind positions [s]. `reported`: use the receiver's own standard deviations where a drive
    is too short to show the whole error.
    Returns: None without velocities, with too few fixes, or with white errors only.
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
    integrated = np.diff(Spline(t, v).integral(t + lag), axis=0)
    # effect of halving the velocities: by the spline's fourth order, 16 times the error of all
    half = np.diff(Spline(t[::2], v[::2]).integral(t + lag), axis=0)
    even = ~np.logical_or(gap[0:-1:2], gap[1::2])
    missing = (half - integrated)[: 2 * even.shape[0]].reshape(-1, 2, 2).sum(axis=1)[even] / 16.0
    if missing.size == 0 or np.sqrt(np.mean(missing**2)) > ROUGH * float(np.median(sd[:, :2])):
        return None  # velocities too sparse for an integral as accurate as the positions
    error = np.vstack(
        [np.zeros(2), np.cumsum(gone - integrated, axis=0)]
    )  # of position, minus the sum of velocity errors
    stretch = np.concatenate([[0], np.cumsum(gap)])
    most = min(LONGEST / usual, t.shape[0] / 4)
    lags = np.unique(np.geomspace(1, max(most, 2), 30).astype(int))
    level, weight = [], []
    for m in lags:
        whole = stretch[m:] == stretch[:-m]
        if whole.sum() < 20:
            continue
        d = (error[m:] - error[:-m])[whole] / sd[:, :2][m:][whole]
        # half the squared difference; the median is robust against outliers (chi-square with one degree)
        level.append(0.5 * float(np.median(d * d)) / CHI2_MEDIAN)
        weight.append(np.sqrt(whole.sum() / m))
    if len(level) < 8:
        return None
    x, y = lags[: len(level)] * usual, np.array(level)
    scale = np.array(weight) / (y + 0.05)
    ones = np.ones_like(x)
    white_only = positive_parts(np.column_stack([ones, x]) * scale[:, None], y * scale)[1]
    misfit, time, (white, correlated, _) = min(
        (_fit(x, y, scale, float(each)) for each in TIMES), key=lambda found: found[0]
    )
    total = white + correlated
    # accept the correlated term if it improves the fit, is a visible part of the reported variance, and is seen over
    # five correlation times
    seen = TIMES[0] < time <= x[-1] / 5.0 and WHOLE < total <= TOO_MUCH
    by_reported = not (seen and misfit <= BETTER * white_only and correlated >= max(0.05, WORTH * total))
    if by_reported:
        share, time = _by_reported(x, y, scale, white_only) if reported else (0.0, 0.0)
        if share < WORTH_REPORTED:
            return None
    else:
        share = correlated / total
    share = min(float(share), MOST)
    return CorrelatedNoise(share, time, np.sqrt(share) * np.median(sd, axis=0), by_reported)


def _fit(x: FloatArray, y: FloatArray, scale: FloatArray, time: float) -> tuple[float, float, FloatArray]:
    """Fit white, time-correlated and linear (velocity noise) parts; return misfit, correlation time and parts."""
    terms = np.column_stack([np.ones_like(x), 1.0 - np.exp(-x / time), x])
    parts, misfit = positive_parts(terms * scale[:, None], y * scale)
    return misfit, time, parts


def _by_reported(x: FloatArray, y: FloatArray, scale: FloatArray, white_only: float) -> tuple[float, float]:
    """Estimate share and correlation time if the reported variance is right.

    A drive shorter than the correlation time shows the white part only. If successive fixes scatter less than reported,
    either they share an error or they are better than reported. The first is assumed, unless white errors of another
    size fit much better: a long record shows no further growth.
    """
    best = np.inf, 0.0, 0.0
    for time in TIMES[TIMES >= SHORTEST_REPORTED]:
        fading = np.exp(-x / time)  # white + (1 - white) (1 - fading) + slope x
        (white, _), rest = positive_parts(np.column_stack([fading, x]) * scale[:, None], (y - 1.0 + fading) * scale)
        best = min(best, (rest, 1.0 - float(white), float(time)))
    return (best[1], best[2]) if best[0] <= MISFIT * white_only else (0.0, 0.0)
