"""Overlapping Allan deviations of a static record with uncertainty, and noise coefficients from them and from spectra.

``sigma^2(tau) = < (x[k + 2m] - 2 x[k + m] + x[k])^2 > / (2 tau^2)`` with x the integral of the signal and tau = m tau0
(W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2.4).

Second differences of a Gaussian signal are Gaussian. The covariance of two Allan variances is therefore twice the mean
of the squared covariances of their second differences, which follow from the noise model (C. A. Greenhall and W. J.
Riley, Uncertainty of stability variances based on finite differences, Proc. 35th PTTI Meeting (2003)). Of the record,
only its length is needed.

``sigma^2 = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + R^2 tau^2 / 2`` (IEEE Std 952-1997, annex C).
A first-order Gauss-Markov process may replace the bias instability B. Most bias models of filters and simulations are
such processes, whose Allan variance has a peak where B is flat. Sinusoidal noise is first removed from the samples.

The variances at different times come from the same samples and are strongly correlated. Generalised least squares fits
the squares of the coefficients, with the covariance of the model itself, repeated until both agree. No square is
negative.

Sinusoidal noise (vibration, mains, a control loop) of amplitude W0 adds ``sigma^2(tau) = W0^2 (sin^2(pi f0 tau) / (pi
f0 tau))^2``. With samples every dt, ``pi f0 tau`` in the denominator becomes ``m sin(pi f0 dt)``, tau = m dt. This is
equal far below the sampling rate, and exact near half of it.

A few points of an Allan deviation hardly determine a frequency, so the lines come from the spectrum (Hann window). A
line is a bin that the surrounding noise would exceed in a share `FALSE_ALARM` of records. It is a steady sinusoid only
if neighbouring bins have the shape of the window. Otherwise it is vibration of changing frequency, without coefficient.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.fft import prev_fast_len, rfft
from scipy.optimize import brentq, minimize_scalar, nnls
from scipy.signal import detrend
from scipy.signal.windows import hann

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.model import sample_intervals
from insnav.kernels.allan import mean_square_second_difference, running_sum, variance_covariance
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.types import BoolArray, FloatArray, ImuData, IntArray

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
TAUS = 90
LONGEST_PART = 3  # the longest averaging time is a third of the record: longer ones have almost no freedom
FEWEST = 100  # least number of samples
GAP = 1.5  # a step longer than this many intervals lacks samples
FILLED = 10  # gaps of up to so many samples are filled ...
FILLED_PART = 1e-3  # ... if they are not more than this part of all
JITTER = 0.1  # reported timestamp jitter [intervals]
MOST = 8  # lines of one signal
FALSE_ALARM = 1e-4  # share of pure noise records with a line
FEWEST_CYCLES = 50  # in the record: drift dominates below
FEWEST_SAMPLES = 1000
LONGEST = 1 << 24  # samples: every part of a longer record contains a steady line
NEAR, BAND_STEP = 1.25, 1.05  # median power up to this factor in frequency, at such steps
MOST_OF_BAND = 2000  # bins of such a median
MAIN_LOBE = 3  # bins on each side of a line that reveal its shape
REST = 0.1  # largest remaining share of a line's power after the shape
WIDE = 4096  # bins on each side corrected for a line
FAINT = 1e-6  # relative power that may be rounding of the strongest line
SEEN = 0.05  # least share of a line in some Allan variance: smaller lines change no coefficient
NAMES = ("Q", "N", "B", "K", "GM", "R")  # Gauss-Markov before R: the first five are random
B_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # floor of the Allan deviation by B: 0.664
FITTED_PART = 6  # the fit ends at this part of the record: later variances have too few squares to be nearly Gaussian
PER_DECADE = 4  # points of the fit: more add nothing, as neighbours share samples
SIGNIFICANT = 6.63  # chi-square of one coefficient at 1 %
ROUNDS, FEW_ROUNDS = 4, 2
FEWEST_FREEDOM = 0.5  # fewer give no information
LARGEST_MISFIT = 1.0
NEGLIGIBLE = 1e-4  # negligible relative error of a variance
SINGULAR = 1e-4  # smallest eigenvalue of a correlation matrix beyond rounding
SHORTEST = 10.0  # least correlation time of a bias [samples]
TIMES_PER_DECADE = 5  # correlation times tried


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
    """Cut a part out of a record. `start`, `end`: both included [s]. Raises: InputError: hardly a sample in it."""
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
    return np.column_stack([np.interp(every, place, column) for column in values.T]), np.interp(every, place, time)


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
    """Find the resolution of each column: the smallest difference between its values, or zero. values (n, c)."""
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


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """One line."""

    frequency: float  # f0 [Hz]
    frequency_sd: float  # its standard deviation [Hz]
    amplitude: float  # W0 [unit of the signal]
    amplitude_sd: float  # its standard deviation [unit of the signal]
    phase: float  # at the first sample, of a cosine [rad]

    def at(self, time: FloatArray) -> FloatArray:
        """Evaluate the line; time (n,): since the first sample [s]. Returns (n,)."""
        return np.asarray(self.amplitude * np.cos(2.0 * np.pi * self.frequency * time + self.phase))

    def variance(self, tau: FloatArray, interval: float) -> FloatArray:
        """Compute the Allan variance of the line, (k,), at averaging times tau (k,) [s] and sampling interval [s]."""
        slow = tau / interval * math.sin(math.pi * self.frequency * interval)
        return np.asarray((self.amplitude * np.sin(np.pi * self.frequency * tau) ** 2 / slow) ** 2)


def find_sinusoids(values: FloatArray, interval: float) -> tuple[Sinusoid, ...]:
    """Find steady lines, strongest first. `values` (n,): signal at even steps, not constant. `interval`: step [s]."""
    n = prev_fast_len(min(values.size, LONGEST), real=True)
    if n < FEWEST_SAMPLES:
        return ()
    straight, window = detrend(values[:n]), hann(n, sym=False)
    spectrum = rfft(straight * window)
    around = _around(np.abs(spectrum) ** 2)
    bins = np.arange(spectrum.size)
    free = (bins >= FEWEST_CYCLES) & (bins < spectrum.size - 1 - MAIN_LOBE) & (around > 0.0)
    limit = -math.log(FALSE_ALARM / max(int(np.count_nonzero(free)), 1))
    found: list[Sinusoid] = []
    strongest = 0.0
    for _ in range(4 * MOST):
        power = np.where(free, np.abs(spectrum) ** 2, 0.0)
        ratio = power / np.where(free, around, 1.0)
        peak = int(np.argmax(ratio))
        if ratio[peak] < limit or power[peak] < FAINT * strongest or len(found) == MOST:
            break
        strongest = max(strongest, float(power[peak]))
        offset, sd = _offset(np.abs(spectrum[peak - 1 : peak + 2]), float(around[peak]))
        first, last = max(0, peak - WIDE), min(spectrum.size, peak + WIDE + 1)
        away = offset + peak - bins[first:last]
        line = np.sinc(away) + 0.5 * (np.sinc(away - 1.0) + np.sinc(away + 1.0))  # of the Hann window, 1 in the middle
        shape = line * (-1.0) ** (bins[first:last] - peak)
        spectrum[first:last] -= spectrum[peak] / shape[peak - first] * shape
        lobe = slice(peak - MAIN_LOBE, peak + MAIN_LOBE + 1)
        rest = float(np.sum(np.abs(spectrum[lobe]) ** 2)) - (2 * MAIN_LOBE + 1) * float(around[peak])
        free[lobe] = False
        if rest < REST * power[peak] + limit * around[peak]:
            found.append(_line(straight * window, (peak + offset) / n, sd / n, float(around[peak]), interval))
    return tuple(sorted(found, key=lambda line: -line.amplitude))


def _around(power: FloatArray) -> FloatArray:
    """Estimate the noise power around each bin by medians, robust against lines."""
    centres = np.geomspace(0.8 * FEWEST_CYCLES, power.size - 1.0, 2 + int(math.log(power.size, BAND_STEP)))
    level = []
    for centre in centres:
        first, last = max(1, int(min(centre / NEAR, centre - 20))), int(max(centre * NEAR, centre + 20))
        band = power[first : last + 1]
        level.append(np.median(band[:: 1 + band.size // MOST_OF_BAND]) / math.log(2.0))
    tiny = np.finfo(np.float64).tiny
    logs = np.interp(np.log(np.arange(1.0, power.size)), np.log(centres), np.log(np.maximum(level, tiny)))
    return np.concatenate([[0.0], np.exp(logs)])


def _offset(size: FloatArray, noise: float) -> tuple[float, float]:
    """Estimate the distance of a line from the highest bin by its larger neighbour, with sd [bins].

    `size` (3,): of the spectrum about it. `noise`: mean power of the noise. The ratio r of two bins of a Hann window is
    (1 + d) / (2 - d); noise of neighbours has the correlation 2/3.
    """
    right = size[2] > size[0]
    r = float(size[2] if right else size[0]) / float(size[1])
    d = (2.0 * r - 1.0) / (r + 1.0)
    sd = 3.0 / (r + 1.0) ** 2 * math.sqrt(0.5 * noise * (1.0 + r * r - 4.0 / 3.0 * r)) / float(size[1])
    return (d if right else -d), sd


def _line(windowed: FloatArray, cycles: float, cycles_sd: float, noise: float, interval: float) -> Sinusoid:
    """Fit a line of known frequency [cycles per sample] in a windowed signal."""
    n = windowed.size
    turned = windowed @ np.exp(-2j * np.pi * cycles * np.arange(n)) * 4.0 / n  # the window has the mean 1/2
    sd = 4.0 / n * math.sqrt(0.5 * noise)
    return Sinusoid(cycles / interval, cycles_sd / interval, float(abs(turned)), sd, float(np.angle(turned)))


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One noise coefficient in SI units, or the standard deviation of a Gauss-Markov process."""

    value: float  # estimate
    sd: float  # its standard deviation
    low: float  # 95 % interval, by chi-square with the degrees of freedom of the standard deviation
    high: float


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise of one axis."""

    coefficients: dict[str, Coefficient]  # of Q, N, B, K, GM, R: significant ones
    correlation_time: float  # of the Gauss-Markov process [s]; infinite without one
    correlation_time_sd: float  # its standard deviation [s]
    # relative standard deviation of the model error beyond the uncertainty of the Allan variances; zero without
    misfit: float
    variance: FloatArray  # (k,) Allan variance of the model at the times of the record
    freedom: FloatArray  # (k,) equivalent degrees of freedom of each estimate
    low: FloatArray  # (k,) 95 % intervals of the measured Allan deviations
    high: FloatArray
    sinusoids: tuple[Sinusoid, ...] = ()  # steady lines, strongest first; included in `variance`


@dataclass(frozen=True, slots=True)
class _Fit:
    """Model with its quality of fit."""

    squares: FloatArray  # (6,)
    time: float
    likelihood: float  # -2 ln, with the penalty of Akaike's criterion
    spread: FloatArray  # covariance of the squares that are not zero, then of ln(time)
    misfit: float


def basis(tau: FloatArray, correlation_time: float) -> FloatArray:
    """Compute the Allan variance of each noise of unit size.

    `tau` (k,): [s]. `correlation_time`: [s]. Returns (k, 6): for Q^2, N^2, B^2, K^2, the variance of the Gauss-Markov
    process, and R^2.
    """
    u = tau / correlation_time
    # (2 T / tau) (1 - T / (2 tau) (3 - 4 exp(-tau / T) + exp(-2 tau / T))), IEEE Std 952-1997, annex C; leading terms
    # where it cancels
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = (2.0 * u - 3.0 + 4.0 * np.exp(-u) - np.exp(-2.0 * u)) / u**2
    markov = np.where(u < 1e-3, 2.0 / 3.0 * u * (1.0 - 0.75 * u), exact)
    return np.column_stack([3.0 / tau**2, 1.0 / tau, np.full(tau.size, B_FACTOR**2), tau / 3.0, markov, 0.5 * tau**2])


def fit_noise(allan: AllanDeviation, column: int = 0) -> NoiseModel:
    """Fit the noise coefficients of one axis.

    `allan`: from `insnav.lab.noise.allan.allan_deviation`; the column must not be all zero. Akaike's criterion chooses
    between a floor B and a Gauss-Markov process. Then every term is dropped that lowers chi-square by less than 6.63
    (significant at 1 %).
    """
    rows = _chosen(allan)
    floor, markov = (_Fitter(allan, column, rows).fit(np.array([n != out for n in NAMES])) for out in ("GM", "B"))
    # a Gauss-Markov process has two parameters more, so it must fit significantly better than a floor or a walk
    best = markov if markov.likelihood + SIGNIFICANT < floor.likelihood else floor
    time = best.time
    sd = math.sqrt(best.spread[-1, -1]) * time if math.isfinite(time) else 0.0
    nothing = np.empty(0)
    model = NoiseModel(_coefficients(best), time, sd, best.misfit, nothing, nothing, nothing, nothing)
    return evaluated(model, allan, column)


def evaluated(model: NoiseModel, allan: AllanDeviation, column: int) -> NoiseModel:
    """Evaluate a model at the averaging times of a record, with the intervals of the deviations there.

    `allan`: of the record the model is of, at any times. `column`: which axis.
    """
    squares = np.array([model.coefficients[n].value ** 2 if n in model.coefficients else 0.0 for n in NAMES])
    time = model.correlation_time
    variance = basis(allan.tau, time if math.isfinite(time) else 1.0) @ squares
    spread = np.diag(covariance(allan.factors, allan.n, allan.interval, squares[:5], time, diagonal=True)).copy()
    for line in model.sinusoids:  # each is as uncertain as its amplitude
        lines = line.variance(allan.tau, allan.interval)
        variance = variance + lines
        spread += (2.0 * line.amplitude_sd / line.amplitude * lines) ** 2
    degrees = np.maximum(freedom(variance, spread), FEWEST_FREEDOM)
    low, high = chi_square_interval(allan.deviation[:, column], degrees, CONFIDENCE)
    return replace(model, variance=variance, freedom=degrees, low=low, high=high)


def _coefficients(fit: _Fit) -> dict[str, Coefficient]:
    found = {}
    for place, index in enumerate(np.flatnonzero(fit.squares)):
        value, variance = float(fit.squares[index]), float(fit.spread[place, place])
        root = math.sqrt(value)
        low, high = chi_square_interval(root, 2.0 * value**2 / variance, CONFIDENCE)
        found[NAMES[index]] = Coefficient(root, 0.5 * math.sqrt(variance) / root, float(low), float(high))
    return found


def _chosen(allan: AllanDeviation) -> IntArray:
    """Rows for the fit: about `PER_DECADE` evenly on the logarithmic axis, both ends included."""
    tau = allan.tau[allan.factors * FITTED_PART <= allan.n]
    wanted = np.geomspace(tau[0], tau[-1], max(4, 1 + round(PER_DECADE * math.log10(tau[-1] / tau[0]))))
    return np.unique([int(np.argmin(np.abs(np.log(tau / each)))) for each in wanted])


@dataclass(frozen=True, slots=True)
class Weights:
    """Inverse of a root of a covariance, and the logarithm of its determinant."""

    inverse: FloatArray
    logarithm: float

    @classmethod
    def of(cls, own: FloatArray, misfit: FloatArray) -> Weights:
        """Compute weights from a covariance and the standard deviations of a misfit."""
        size = np.sqrt(np.diag(own) + misfit**2)
        value, vector = np.linalg.eigh((own + np.diag(misfit**2)) / np.outer(size, size))
        value = np.maximum(value, SINGULAR)  # remainder of rounding and quadrature
        # any root is valid: here from the eigenvectors
        return cls((vector / np.sqrt(value)).T / size, float(np.log(value).sum() + 2.0 * np.log(size).sum()))

    def chi(self, left: FloatArray) -> float:
        """Compute chi-square of residuals."""
        return float(np.sum((self.inverse @ left) ** 2))

    def likelihood(self, seen: FloatArray, model: FloatArray) -> float:
        """Compute minus twice the log-likelihood, up to a constant."""
        return self.chi(seen - model) + self.logarithm


class _Fitter:
    """Generalised least squares on the chosen times of one axis."""

    def __init__(self, allan: AllanDeviation, column: int, rows: IntArray) -> None:
        self.allan = allan
        self.tau, self.factors = allan.tau[rows], allan.factors[rows]
        self.size = float(np.max(allan.deviation[rows, column])) ** 2  # everything is fitted in this unit
        self.seen = allan.deviation[rows, column] ** 2 / self.size
        times = max(2, math.ceil(TIMES_PER_DECADE * math.log10(self.tau[-1] / self.tau[0])))
        # A bump is seen only if its top, at 1.89 T, and more than it lie within the record. A short one is the
        # sensor's own filter, no bias.
        self.times = np.geomspace(
            SHORTEST * allan.interval, max(self.tau[-1] / 3.0, 2.0 * SHORTEST * allan.interval), times
        )
        self.misfit = 0.0

    def fit(self, allowed: BoolArray) -> _Fit:
        """Fit, estimate the misfit, drop insignificant terms."""
        squares, time = self._again(allowed, *self._start(allowed), ROUNDS)
        for _ in range(ROUNDS):  # the weights depend on the misfit, and the fit on the weights
            if not self._find_misfit(squares, time):
                break
            squares, time = self._again(allowed, squares, time, 1)
        while True:
            kept = squares > 0.0
            full = self._weights(squares, time).likelihood(self.seen, self._basis(time) @ squares)
            fewer = []
            for index in np.flatnonzero(kept):
                without = kept.copy()
                without[index] = False
                if without.any():
                    found = self._again(without, *self._solve(without, self._weights(squares, time), time), FEW_ROUNDS)
                    gain = self._weights(*found).likelihood(self.seen, self._basis(found[1]) @ found[0]) - full
                    fewer.append((gain, found))
            gain, found = min(fewer, key=lambda each: each[0], default=(math.inf, (squares, time)))
            if not gain < SIGNIFICANT:
                break
            squares, time = self._again(found[0] > 0.0, *found, ROUNDS)
        return self._result(squares, time if squares[4] > 0.0 else math.inf)

    def _again(self, allowed: BoolArray, squares: FloatArray, time: float, rounds: int) -> tuple[FloatArray, float]:
        """Repeat the fit with the weights of the previous fit."""
        for _ in range(rounds):
            squares, time = self._solve(allowed, self._weights(squares, time), time)
        return squares, time

    def _find_misfit(self, squares: FloatArray, time: float) -> bool:
        """Set the misfit that gives the expected chi-square; return whether it is positive."""
        spare = self.tau.size - np.count_nonzero(squares) - (squares[4] > 0.0)
        own, model = self._own(squares, time), self._basis(time) @ squares

        def excess(misfit: float) -> float:
            return Weights.of(own, misfit * model).chi(self.seen - model) - float(spare)

        if spare <= 0 or (self.misfit == 0.0 and excess(0.0) + spare < chi_square(spare, 0.99)):
            return False
        if excess(LARGEST_MISFIT) > 0.0:
            self.misfit = LARGEST_MISFIT
        else:
            self.misfit = 0.0 if excess(0.0) <= 0.0 else float(brentq(excess, 0.0, LARGEST_MISFIT, xtol=1e-3))
        return True

    def _result(self, squares: FloatArray, time: float) -> _Fit:
        weights = self._weights(squares, time)
        columns = self._basis(time)[:, squares > 0.0]
        if squares[4] > 0.0:  # and the derivative of the curve by the logarithm of the correlation time
            step = 1e-3
            slope = (self._basis(time * (1 + step)) - self._basis(time * (1 - step)))[:, 4] / (2.0 * step) * squares[4]
            columns = np.column_stack([columns, slope])
        white = weights.inverse @ columns
        scale = np.linalg.norm(white, axis=0)
        spread = np.linalg.pinv((white / scale).T @ (white / scale)) / np.outer(scale, scale)
        units = np.full(columns.shape[1], self.size)
        if squares[4] > 0.0:
            units[-1] = 1.0
        count = columns.shape[1]
        likelihood = weights.likelihood(self.seen, self._basis(time) @ squares) + 2.0 * count
        return _Fit(squares * self.size, time, likelihood, spread * np.outer(units, units), self.misfit)

    def _basis(self, time: float) -> FloatArray:
        return basis(self.tau, time if math.isfinite(time) else 1.0)

    def _start(self, allowed: BoolArray) -> tuple[FloatArray, float]:
        """Fit with errors as large as the values, so that every part of the curve has weight."""
        return self._solve(allowed, Weights(np.diag(1.0 / self.seen), 0.0), float(self.times[self.times.size // 2]))

    def _own(self, squares: FloatArray, time: float) -> FloatArray:
        """Compute the covariance of the measured variances under the model."""
        own = covariance(self.factors, self.allan.n, self.allan.interval, squares[:5], time)
        model = (self._basis(time) * squares).sum(axis=1)
        # Noise resembles a ramp by the difference between the means of both halves of the record: a common error at all
        # times.
        half = 0.5 * self.allan.n * self.allan.interval
        random = float((basis(np.array([half]), time if math.isfinite(time) else 1.0)[0] * squares)[:5].sum())
        slope = math.sqrt(2.0 * squares[5] * random) / half * self.tau**2
        own += np.outer(slope, slope)
        return np.asarray(own + np.diag((NEGLIGIBLE * model) ** 2))

    def _weights(self, squares: FloatArray, time: float) -> Weights:
        return Weights.of(self._own(squares, time), self.misfit * (self._basis(time) @ squares))

    def _solve(self, allowed: BoolArray, weights: Weights, time: float) -> tuple[FloatArray, float]:
        """Squares, none negative, and correlation time of least chi-square."""
        seen = weights.inverse @ self.seen

        def at(time: float) -> tuple[float, FloatArray]:
            white = weights.inverse @ self._basis(time)[:, allowed]
            scale = np.linalg.norm(white, axis=0)
            part, left = nnls(white / scale, seen)
            squares = np.zeros(6)
            squares[allowed] = part / scale
            return left, squares

        if not allowed[4]:
            return at(1.0)[1], math.inf
        best = int(np.argmin([at(each)[0] for each in self.times]))
        ends = self.times[max(0, best - 1)], self.times[min(best + 1, self.times.size - 1)]
        bounds = tuple(math.log(each) for each in ends)
        least = minimize_scalar(
            lambda logarithm: at(math.exp(logarithm))[0], bounds=bounds, method="bounded", options={"xatol": 1e-4}
        )
        time = math.exp(float(least.x))
        return at(time)[1], time
