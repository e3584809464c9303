"""Scalar Kalman filter that smooths a rate: a random walk observed in white noise.

x[k] = x[k-1] + w, z[k] = x[k] + v with variances Q and R. Q and R maximise the likelihood of the record (local level
model; A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), random walk plus noise).
Differences of z have the tridiagonal covariance Q + 2 R, -R, whose eigenvectors are sines. The likelihood is therefore
exact, at the cost of one sine transform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.fft import dst
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from insnav.exceptions import InputError
from insnav.types import FloatArray
from insnav.units import DEG

P0 = DEG**2  # variance of the initial state: 1 (deg/s)^2
SLOWEST_PART = 10  # largest time constant of the filter, relative to the record that determines Q and R
SETTLED = 1e-13  # relative change of the gain that counts as zero
STILL, UNSTEADY, SHORTEST_RAMP = 0.05, 0.2, 5.0  # of a ramp: part of the largest slope, of its own; and [s]
RAMP_RATE, RAMP_TIME = 60.0 * DEG, 100.0  # 10 r/min, reached in 100 s


@dataclass(frozen=True, slots=True)
class Smoother:
    """Scalar Kalman filter in its steady state."""

    q: float  # variance of the step and of the noise of a sample [(rad/s)^2]
    r: float
    interval: float  # sampling interval [s]
    bounded: bool  # Q is at its lower limit: the record has no random walk

    @property
    def gain(self) -> float:
        """Steady-state gain: P (P + R)^-1 with P = Q / 2 + sqrt(Q^2 / 4 + Q R) before the update."""
        p = 0.5 * self.q + math.sqrt(0.25 * self.q**2 + self.q * self.r)
        return p / (p + self.r)

    @property
    def time_constant(self) -> float:
        """Time after a step at which the remainder is 1/e [s]."""
        return -self.interval / math.log1p(-self.gain)

    @property
    def lag(self) -> float:
        """Delay on a ramp, (1 - gain) / gain intervals [s]."""
        return self.interval * (1.0 - self.gain) / self.gain


def choose_smoother(values: FloatArray, interval: float) -> Smoother:
    """Find Q and R of maximum likelihood.

    `values` (n,): random part of a rate at rest [rad/s]. `interval`: sampling interval [s]. Q is at least so large that
    the time constant is a tenth of the record: slower walks are not observable. Raises: InputError: values that do not
    change.
    """
    step = np.diff(values)
    if not np.any(step):
        raise InputError("lab.constant_rate")
    n = values.size
    power = dst(step, type=1, norm="ortho") ** 2
    shape = 2.0 - 2.0 * np.cos(math.pi * np.arange(1, n) / n)

    def unlikely(logarithm: float) -> float:
        eigen = math.exp(logarithm) + shape
        return float(np.sum(np.log(eigen)) + (n - 1) * math.log(float(np.mean(power / eigen))))

    smallest = 2.0 * math.log(SLOWEST_PART / n)
    found = minimize_scalar(unlikely, bounds=(smallest, 0.0), method="bounded", options={"xatol": 1e-6})
    # the end of an interval is only approached: take it if equal
    bounded = unlikely(smallest) <= float(found.fun) + 1e-3
    ratio = math.exp(smallest if bounded else float(found.x))
    r = float(np.mean(power / (ratio + shape)))
    return Smoother(ratio * r, r, interval, bounded)


def smooth(values: FloatArray, smoother: Smoother) -> FloatArray:
    """Run the filter over a rate, from zero with an initial variance of 1 (deg/s)^2.

    The steps are filterpy's until the gain has settled; from there on they are a recursion of constant gain.

    `values` (n,): [rad/s], finite. Returns (n,): [rad/s]. Raises: InputError: A value that is not finite: one would
    stay in the filter for ever.
    """
    if not np.isfinite(values).all():
        raise InputError("lab.not_finite", row=int(np.argmin(np.isfinite(values))) + 1)
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.F, kalman.H = np.eye(1), np.eye(1)
    kalman.P, kalman.Q, kalman.R = np.array([[P0]]), np.array([[smoother.q]]), np.array([[smoother.r]])
    out = np.empty(values.size)
    before = math.inf
    for k, value in enumerate(values):
        kalman.predict()
        kalman.update(np.array([[value]]))
        out[k] = kalman.x[0, 0]
        gain = float(kalman.K[0, 0])
        if abs(gain - before) <= SETTLED * gain:
            keep = 1.0 - gain
            out[k + 1 :] = lfilter([gain], [1.0, -keep], values[k + 1 :], zi=[keep * out[k]])[0]
            break
        before = gain
    return out


@dataclass(frozen=True, slots=True)
class RampAnswer:
    """Response of a smoother to a rate ramp."""

    time: FloatArray  # (n,) time [s], true rate and filtered rate [rad/s]
    rate: FloatArray
    smoothed: FloatArray
    slope: float  # of the ramp [rad/s^2]
    lag: float  # delay of the filter in the second half of the ramp, and its standard deviation [s]
    lag_sd: float
    worst: float  # largest error from the second half of the ramp on [rad/s]
    measured: bool  # the rates are recorded, not computed without noise


def computed_ramp(smoother: Smoother) -> RampAnswer:
    """Compute the response to 0 to 10 r/min in 100 s and 100 s of constant rate, without noise."""
    time = smoother.interval * np.arange(round(2.0 * RAMP_TIME / smoother.interval) + 1, dtype=np.float64)
    rate = np.asarray(RAMP_RATE * np.minimum(time / RAMP_TIME, 1.0), dtype=np.float64)
    keep = 1.0 - smoother.gain
    settled = np.asarray(lfilter([smoother.gain], [1.0, -keep], rate))  # zero for a long time before
    return _answer(np.asarray(time), rate, settled, slice(0, round(RAMP_TIME / smoother.interval) + 1), measured=False)


def recorded_ramp(time: FloatArray, rate: FloatArray, smoothed: FloatArray) -> RampAnswer | None:
    """Measure the lag in the longest steady ramp of a record; None without a ramp of 5 s.

    `time` (n,): [s]. `rate`, `smoothed` (n,): true rate, and the smoothed one [rad/s].
    """
    over = max(1, round(1.0 / float(np.median(np.diff(time)))))  # about a second: steps of the table are irrelevant
    change = (rate[over:] - rate[:-over]) / (time[over:] - time[:-over])
    best = slice(0, 1)
    for sign in (1.0, -1.0):
        turning = sign * change > STILL * float(np.max(np.abs(change), initial=0.0))
        if not turning.any():
            continue
        usual = float(np.median(change[turning]))
        steady = np.concatenate([[0], np.abs(change - usual) < UNSTEADY * abs(usual), [0]])
        edges = np.flatnonzero(np.diff(steady))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if end + over - begin > best.stop - best.start:
                best = slice(begin, end + over)
    if time[best.stop - 1] - time[best.start] < SHORTEST_RAMP:
        return None
    return _answer(time, rate, smoothed, best, measured=True)


def _answer(time: FloatArray, rate: FloatArray, smoothed: FloatArray, ramp: slice, *, measured: bool) -> RampAnswer:
    slope = float((rate[ramp.stop - 1] - rate[ramp.start]) / (time[ramp.stop - 1] - time[ramp.start]))
    half = slice((ramp.start + ramp.stop) // 2, ramp.stop)
    late = (rate[half] - smoothed[half]) / slope
    # errors of the filter are correlated: ten parts give the scatter of the mean
    parts = np.array([part.mean() for part in np.array_split(late, 10)]) if late.size >= 20 else late
    sd = float(np.std(parts, ddof=1) / math.sqrt(parts.size))
    worst = float(np.max(np.abs(rate[half.start :] - smoothed[half.start :])))
    return RampAnswer(time, rate, smoothed, slope, float(late.mean()), sd, worst, measured)
