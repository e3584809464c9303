"""Overlapping Allan deviation of a static record, all axes at once, with its uncertainty.

``sigma^2(tau) = < (x[k + 2m] - 2 x[k + m] + x[k])^2 > / (2 tau^2)`` with x the integral of the signal and tau = m tau0
(W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2.4).

Second differences of a Gaussian signal are Gaussian. The covariance of two Allan variances is therefore twice the mean
of the squared covariances of their second differences, which follow from the noise model (C. A. Greenhall and W. J.
Riley, Uncertainty of stability variances based on finite differences, Proc. 35th PTTI Meeting (2003)). Of the record,
only its length is needed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.model import sample_intervals
from insnav.kernels.allan import mean_square_second_difference, running_sum, variance_covariance
from insnav.sample_statistics import chi_square
from insnav.types import FloatArray, ImuData, IntArray

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
TAUS = 90
LONGEST_PART = 3  # longest averaging time, relative to the record: beyond it almost no degree of freedom remains
FEWEST = 100  # least number of samples
GAP = 1.5  # a step longer than this many intervals lacks samples
FILLED = 10  # gaps of up to so many samples are filled ...
FILLED_PART = 1e-3  # ... if they are not more than this part of all
JITTER = 0.1  # reported timestamp jitter [intervals]


@dataclass(frozen=True, slots=True)
class EvenRecord:
    """Rates and specific forces at even steps, with findings on their preparation."""

    values: FloatArray  # (n, 6) gyro x, y, z [rad/s], accelerometer x, y, z [m/s^2]
    interval: float  # step [s]
    start: float  # time of the first sample [s]
    notes: tuple[Finding, ...]  # removed, filled or approximated parts

    @property
    def length(self) -> float:
        """Length of the record [s]."""
        return self.interval * len(self.values)


@dataclass(frozen=True, slots=True)
class AllanDeviation:
    """Overlapping Allan deviation."""

    tau: FloatArray  # (k,) averaging times [s]
    factors: IntArray  # (k,) the same in samples
    deviation: FloatArray  # (k, c) one column for each signal, in its unit
    n: int  # number of samples
    interval: float  # sampling interval [s]

    @property
    def length(self) -> float:
        """Length of the record [s]."""
        return self.interval * self.n


def between(imu: ImuData, start: float, end: float) -> ImuData:
    """Cut a part out of a record.

    `start`, `end`: both included [s]. Raises: InputError: hardly a sample in it.
    """
    kept = (imu.time >= start) & (imu.time <= end)
    if np.count_nonzero(kept) < 2:
        raise InputError("lab.empty_part", begin=start, end=end, first_s=imu.time[0], last_s=imu.time[-1])
    return imu.rows(kept)


def even_record(imu: ImuData) -> EvenRecord:
    """Bring a record to even steps, as the Allan deviation needs it.

    Short gaps are filled by straight lines if there are few of them, else the longest stretch without one is taken.
    Within it the samples are taken as even, at the mean step: late timestamps are more frequent than late samples.

    Raises: InputError: fewer than 100 samples, or no stretch of them.
    """
    _refuse_short("lab.allan_short", imu.time.size)
    step = np.diff(imu.time, prepend=2.0 * imu.time[0] - imu.time[1])
    values = np.hstack([imu.gyro, imu.accel])
    if imu.sampling == "increment":
        values /= sample_intervals(imu)[:, None]
    time = imu.time
    notes: list[Finding] = []
    usual = float(np.median(step))
    after = np.flatnonzero(step > GAP * usual)
    if after.size:
        lost = np.rint(step[after] / usual).astype(np.int64) - 1
        if lost.max() <= FILLED and lost.sum() <= FILLED_PART * time.size:
            values, time = _filled(values, time, after, lost)
            notes.append(Finding.of(Code.ALLAN_FILLED, count=lost.sum(), gaps=after.size))
        else:
            edges = np.concatenate([[0], after, [time.size]])
            longest = int(np.argmax(np.diff(edges)))
            part = slice(int(edges[longest]), int(edges[longest + 1]))
            share = np.diff(edges).max() / time.size
            values, time = values[part], time[part]
            notes.append(Finding.of(Code.ALLAN_LONGEST_STRETCH, time[0], time[-1], gaps=after.size, share=share))
            _refuse_short("lab.allan_short_stretch", time.size)
    interval = float((time[-1] - time[0]) / (time.size - 1))
    uneven = float(np.std(np.diff(time)) / interval)
    if uneven > JITTER:
        notes.append(Finding.of(Code.ALLAN_JITTER, share_sd=uneven, limit_share=JITTER))
    return EvenRecord(np.ascontiguousarray(values), interval, float(time[0]), tuple(notes))


def _refuse_short(code: str, count: int) -> None:
    if count < FEWEST:
        raise InputError(code, count=count, limit=FEWEST)


def _filled(values: FloatArray, time: FloatArray, after: IntArray, lost: IntArray) -> tuple[FloatArray, FloatArray]:
    """Samples and times with straight lines over the gaps before rows `after`."""
    place = np.arange(time.size, dtype=np.float64)
    place += np.cumsum(np.bincount(after, lost, time.size))
    every = np.arange(place[-1] + 1.0)
    columns = [np.interp(every, place, column) for column in values.T]
    return np.column_stack(columns), np.interp(every, place, time)


def averaging_factors(n: int, interval: float, taus: Sequence[float] | Literal["log", "octave"] = "log") -> IntArray:
    """Averaging times in samples.

    `n`: number of samples. `interval`: between them [s]. `taus`: averaging times [s], rounded to samples. "log": about
    90 evenly on the logarithmic axis. "octave": powers of two. These two end at a third of the record. Raises:
    ConfigError: a time that is not positive, shorter than the interval, or longer than half of the record.
    """
    if isinstance(taus, str):
        largest = max(1, n // LONGEST_PART)
        if taus == "octave":
            return 2 ** np.arange(int(np.log2(largest)) + 1, dtype=np.int64)
        return np.unique(np.rint(np.geomspace(1.0, largest, TAUS)).astype(np.int64))
    times = np.asarray(taus, dtype=np.float64)
    factors = np.rint(times / interval)
    wrong = times[~((factors >= 1) & (2 * factors <= n))]
    if wrong.size or not times.size:
        raise ConfigError(
            "lab.taus", where="taus", taus_s=tuple(wrong.tolist()), length_s=n * interval, interval_s=interval
        )
    return np.unique(factors.astype(np.int64))


def allan_deviation(
    values: FloatArray, interval: float, factors: IntArray, workers: int | None = None
) -> AllanDeviation:
    """Compute the overlapping Allan deviation of each column.

    `values` (n, c): rates or specific forces at even steps; constant parts do not matter. `interval`: step [s].
    `factors` (k,): averaging times in samples, at most n / 2. `workers`: threads; one for each column at most, by
    default as many as there are processors.
    """
    n, count = values.shape
    deviation = np.empty((factors.size, count))

    def one(column: int) -> None:
        signal = np.ascontiguousarray(values[:, column])
        total, square = np.empty(n + 1), np.empty(factors.size)
        running_sum(signal, float(signal.mean()), total)
        mean_square_second_difference(total, factors, square)
        deviation[:, column] = np.sqrt(0.5 * square) / factors

    with ThreadPoolExecutor(min(count, workers or os.cpu_count() or 1)) as pool:
        list(pool.map(one, range(count)))
    return AllanDeviation(np.asarray(factors * interval, dtype=np.float64), factors, deviation, n, interval)


def smallest_step(values: FloatArray) -> FloatArray:
    """Find the resolution of each column: the smallest difference between its values, or zero.

    values (n, c).
    """
    steps = np.zeros(values.shape[1])
    for column in range(values.shape[1]):
        different = np.unique(values[: 1 << 17, column])
        if 1 < different.size < 0.5 * min(len(values), 1 << 17):  # otherwise all samples differ: no steps
            gaps = np.diff(different)
            steps[column] = float(np.min(gaps[gaps > 1e-6 * gaps.max()]))
    return steps


def covariance(
    factors: IntArray, n: int, interval: float, squares: FloatArray, correlation_time: float, *, diagonal: bool = False
) -> FloatArray:
    """Covariance of the Allan variances of one record.

    `factors` (k,): averaging times [samples]. `n`: number of samples. `interval`: sampling interval [s]. `squares`
    (5,): q^2 [unit^2 s^2], N^2 [unit^2 s], B^2 [unit^2], K^2 [unit^2/s] and variance of a Gauss-Markov process
    [unit^2]. `correlation_time`: of that process [s]. `diagonal`: only the variances are filled. Returns (k, k):
    [unit^4].
    """
    out = np.zeros((factors.size, factors.size))
    scaled = squares * interval ** np.array([-2.0, -1.0, 0.0, 1.0, 0.0])
    size = float(scaled.max()) or 1.0
    time = correlation_time / interval if np.isfinite(correlation_time) else 1.0
    variance_covariance(factors, n + 1, scaled / size, time, diagonal, out)
    return out * size**2


def freedom(variance: FloatArray, estimate_variance: FloatArray) -> FloatArray:
    """Equivalent degrees of freedom ``2 E^2 / var`` (NIST SP 1065, section 5.4.1).

    `variance` (k,): Allan variances of the model. `estimate_variance` (k,): variances of their estimates.
    """
    return np.asarray(2.0 * variance**2 / estimate_variance)


def chi_square_interval(
    value: FloatArray | float, degrees: FloatArray | float, confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Confidence interval of a standard deviation from an estimate with chi-square distributed square.

    `value` (k,): estimated standard deviations. `degrees` (k,): their degrees of freedom. `confidence`: such as 0.95,
    the same part left out on both sides. Returns low, high (k,): ``value sqrt(degrees / chi^2)`` (NIST SP 1065, section
    5.3).
    """
    tail = 0.5 * (1.0 - confidence)
    low = value * np.sqrt(degrees / chi_square(degrees, 1.0 - tail))
    high = value * np.sqrt(degrees / np.maximum(chi_square(degrees, tail), np.finfo(float).tiny))
    return low, high
