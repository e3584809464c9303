"""Overlapping Allan deviations of a static record with uncertainty, and noise coefficients from them and from spectra.

``sigma^2(tau) = < (x[k + 2m] - 2 x[k + m] + x[k])^2 > / (2 tau^2)`` with x the integral of the signal and tau = m tau0
(W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2.4).

Second differences of a Gaussian signal are Gaussian. The covariance of two Allan variances is therefore twice the mean
of the squared covariances of their second differences, which follow from the noise model (C. A. Greenhall and W. J.
Riley, Uncertainty of stability variances based on finite differences, Proc. 35th PTTI Meeting (2003)). The covariance
depends on the length of the record, but not on its samples.

``sigma^2 = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + R^2 tau^2 / 2`` (IEEE Std 952-1997, annex C).
A first-order Gauss-Markov process may replace the bias instability B. Most bias models of filters and simulations are
such processes. Their Allan variance has a peak, whereas the Allan variance of B is flat. Sinusoidal noise is first
removed from the samples.

The variances at different times come from the same samples and are strongly correlated. Generalised least squares fits
the squares of the coefficients, none negative. Its covariance follows from the fitted model, so the fit is iterated.

Sinusoidal noise (vibration, mains, a control loop) of amplitude W0 adds ``sigma^2(tau) = W0^2 (sin^2(pi f0 tau) / (pi
f0 tau))^2``. With samples every dt, ``pi f0 tau`` in the denominator becomes ``m sin(pi f0 dt)``, tau = m dt. Far below
the sampling rate both are equal; the second is exact also near half of the sampling rate.

A few points of an Allan deviation hardly determine a frequency, so the lines come from the spectrum (Hann window). A
line is a bin whose power noise alone would reach in a share `FALSE_ALARM` of records. It is a steady sinusoid only
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
TAUS = 90  # number of averaging times on the logarithmic axis
LONGEST_PART = 3  # the longest averaging time is a third of the record: longer ones have almost no degrees of freedom
FEWEST = 100  # least number of samples
GAP = 1.5  # samples are missing in a step longer than this many intervals
FILLED = 10  # gaps of up to this number of samples are filled ...
FILLED_PART = 1e-3  # ... if they are not more than this part of all
JITTER = 0.1  # larger timestamp jitter is reported [intervals]
MOST = 8  # largest number of lines of one signal
FALSE_ALARM = 1e-4  # share of records of pure noise in which a line is found
FEWEST_CYCLES = 50  # least number of cycles of a line in the record: drift dominates below
FEWEST_SAMPLES = 1000  # least number of samples for a search of lines
LONGEST = 1 << 24  # largest number of samples searched: a steady line is in every part of a longer record
NEAR, BAND_STEP = 1.25, 1.05  # noise power: median within the first factor in frequency, at steps by the second
MOST_OF_BAND = 2000  # largest number of bins of such a median
MAIN_LOBE = 3  # bins on each side of a line that reveal its shape
REST = 0.1  # largest share of a line's power that remains after subtraction of the window's shape
WIDE = 4096  # number of bins on each side from which a line is subtracted
FAINT = 1e-6  # lines of less power, relative to the strongest line, may be its rounding errors
SEEN = 0.05  # a line with a smaller share in all Allan variances changes no coefficient
NAMES = ("Q", "N", "B", "K", "GM", "R")  # Gauss-Markov (GM) before R, so that the first five are random
B_FACTOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # floor of the Allan deviation by B: 0.664
FITTED_PART = 6  # the fit ends at a sixth of the record: later variances have too few squares to be nearly Gaussian
PER_DECADE = 4  # averaging times of the fit per decade: more add nothing, as neighbours share samples
SIGNIFICANT = 6.63  # chi-square of one coefficient at 1 %
ROUNDS, FEW_ROUNDS = 4, 2  # repetitions of a fit with new weights: normally, and to test a term
FEWEST_FREEDOM = 0.5  # fewer degrees of freedom give no information
LARGEST_MISFIT = 1.0  # upper limit of the relative misfit
NEGLIGIBLE = 1e-4  # relative error of a variance that is negligible
SINGULAR = 1e-4  # smaller eigenvalues of a correlation matrix are rounding errors
SHORTEST = 10.0  # least correlation time of a bias [samples]
TIMES_PER_DECADE = 5  # correlation times tried per decade


@dataclass(frozen=True, slots=True)
class EvenRecord:
    """Evenly sampled rates and specific forces, with findings on their preparation."""

    values: FloatArray  # (n, 6) gyro x, y, z [rad/s], accelerometer x, y, z [m/s^2]
    interval: float  # sampling interval [s]
    start: float  # time of the first sample [s]
    notes: tuple[Finding, ...]  # findings on removed, filled or approximated parts

    @property
    def length(self) -> float:
        """Length of the record [s]."""
        return self.interval * len(self.values)


@dataclass(frozen=True, slots=True)
class AllanDeviation:
    """Overlapping Allan deviation."""

    tau: FloatArray  # (k,) averaging times [s]
    factors: IntArray  # (k,) averaging times in samples
    deviation: FloatArray  # (k, c) one column for each signal, in its unit
    n: int  # number of samples
    interval: float  # sampling interval [s]

    @property
    def length(self) -> float:
        """Length of the record [s]."""
        return self.interval * self.n


def between(imu: ImuData, start: float, end: float) -> ImuData:
    """Cut a part out of a record. `start`, `end`: both included [s]. Raises: InputError: fewer than two samples."""
    inside = (imu.time >= start) & (imu.time <= end)
    if np.count_nonzero(inside) < 2:
        raise InputError("lab.empty_part", begin=start, end=end, first_s=imu.time[0], last_s=imu.time[-1])
    return imu.rows(inside)


def even_record(imu: ImuData) -> EvenRecord:
    """Convert a record to even sampling, as the Allan deviation needs it.

    Linear interpolation fills short gaps if few samples are missing; else the longest part without a gap is used. Its
    samples are assumed even, at the mean step, because late timestamps are more frequent than late samples.

    Raises: InputError: fewer than 100 samples, or no part of 100 samples without a gap.
    """
    _refuse_short("lab.allan_short", imu.time.size)
    step = np.diff(imu.time, prepend=2.0 * imu.time[0] - imu.time[1])
    values = np.hstack([imu.gyro, imu.accel])
    if imu.sampling == "increment":
        values /= sample_intervals(imu)[:, None]
    time = imu.time
    notes: list[Finding] = []
    median = float(np.median(step))
    gap_rows = np.flatnonzero(step > GAP * median)
    if gap_rows.size:
        missing = np.rint(step[gap_rows] / median).astype(np.int64) - 1
        if missing.max() <= FILLED and missing.sum() <= FILLED_PART * time.size:
            values, time = _filled(values, time, gap_rows, missing)
            notes.append(Finding.of(Code.ALLAN_FILLED, count=missing.sum(), gaps=gap_rows.size))
        else:
            borders = np.concatenate([[0], gap_rows, [time.size]])
            longest = int(np.argmax(np.diff(borders)))
            span = slice(int(borders[longest]), int(borders[longest + 1]))
            share = np.diff(borders).max() / time.size
            values, time = values[span], time[span]
            notes.append(Finding.of(Code.ALLAN_LONGEST_STRETCH, time[0], time[-1], gaps=gap_rows.size, share=share))
            _refuse_short("lab.allan_short_stretch", time.size)
    interval = float((time[-1] - time[0]) / (time.size - 1))
    jitter = float(np.std(np.diff(time)) / interval)
    if jitter > JITTER:
        notes.append(Finding.of(Code.ALLAN_JITTER, share_sd=jitter, limit_share=JITTER))
    return EvenRecord(np.ascontiguousarray(values), interval, float(time[0]), tuple(notes))


def _refuse_short(code: str, count: int) -> None:
    if count < FEWEST:
        raise InputError(code, count=count, limit=FEWEST)


def _filled(values: FloatArray, time: FloatArray, after: IntArray, lost: IntArray) -> tuple[FloatArray, FloatArray]:
    """Interpolate samples and times linearly over gaps: before rows `after`, `lost` samples are missing."""
    index = np.arange(time.size, dtype=np.float64)
    index += np.cumsum(np.bincount(after, lost, time.size))
    grid = np.arange(index[-1] + 1.0)
    return np.column_stack([np.interp(grid, index, column) for column in values.T]), np.interp(grid, index, time)


def averaging_factors(n: int, interval: float, taus: Sequence[float] | Literal["log", "octave"] = "log") -> IntArray:
    """Compute averaging times in samples, (k,), increasing.

    `n`: number of samples. `interval`: between samples [s]. `taus`: averaging times [s], rounded to samples. "log":
    about 90 times, evenly on the logarithmic axis. "octave": powers of two. Both end at a third of the record. Raises:
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

    `values` (n, c): rates or specific forces at even steps; a constant offset does not matter. `interval`: step [s].
    `factors` (k,): averaging times in samples, at most n / 2. `workers`: number of threads, at most one per
    column; by default the number of processors.
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
    """Find the resolution of each column: the smallest difference of its values, or zero. `values` (n, c)."""
    steps = np.zeros(values.shape[1])
    for column in range(values.shape[1]):
        distinct = np.unique(values[: 1 << 17, column])
        if 1 < distinct.size < 0.5 * min(len(values), 1 << 17):  # otherwise all samples differ: no steps
            gaps = np.diff(distinct)
            steps[column] = float(np.min(gaps[gaps > 1e-6 * gaps.max()]))
    return steps


def covariance(
    factors: IntArray, n: int, interval: float, squares: FloatArray, correlation_time: float, *, diagonal: bool = False
) -> FloatArray:
    """Compute the covariance of the Allan variances of one record.

    `factors` (k,): averaging times [samples]. `n`: number of samples. `interval`: sampling interval [s]. `squares`
    (5,): q^2 [unit^2 s^2], N^2 [unit^2 s], B^2 [unit^2], K^2 [unit^2/s] and variance of a Gauss-Markov process
    [unit^2]. `correlation_time`: of that process [s]. `diagonal`: fill only the diagonal. Returns (k, k) [unit^4].
    """
    out = np.zeros((factors.size, factors.size))
    scaled = squares * interval ** np.array([-2.0, -1.0, 0.0, 1.0, 0.0])
    largest = float(scaled.max()) or 1.0
    time = correlation_time / interval if np.isfinite(correlation_time) else 1.0
    variance_covariance(factors, n + 1, scaled / largest, time, diagonal, out)
    return out * largest**2


def freedom(variance: FloatArray, estimate_variance: FloatArray) -> FloatArray:
    """Compute the equivalent degrees of freedom ``2 E^2 / var`` (NIST SP 1065, section 5.4.1).

    `variance` (k,): Allan variances of the model. `estimate_variance` (k,): variances of their estimates.
    """
    return np.asarray(2.0 * variance**2 / estimate_variance)


def chi_square_interval(
    value: FloatArray | float, degrees: FloatArray | float, confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Compute the confidence interval of a standard deviation whose squared estimate is chi-square distributed.

    `value` (k,): estimated standard deviations. `degrees` (k,): their degrees of freedom. `confidence`: such as 0.95,
    with the same probability beyond either end. Returns low, high (k,): ``value sqrt(degrees / chi^2)`` (NIST SP 1065,
    section 5.3).
    """
    tail = 0.5 * (1.0 - confidence)
    low = value * np.sqrt(degrees / chi_square(degrees, 1.0 - tail))
    high = value * np.sqrt(degrees / np.maximum(chi_square(degrees, tail), np.finfo(float).tiny))
    return low, high


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """Steady sinusoid in a signal: one line of its spectrum."""

    frequency: float  # frequency f0 [Hz]
    frequency_sd: float  # its standard deviation [Hz]
    amplitude: float  # amplitude W0 [unit of the signal]
    amplitude_sd: float  # its standard deviation [unit of the signal]
    phase: float  # phase of the cosine at the first sample [rad]

    def at(self, time: FloatArray) -> FloatArray:
        """Evaluate the sinusoid. `time` (n,): since the first sample [s]. Returns (n,)."""
        return np.asarray(self.amplitude * np.cos(2.0 * np.pi * self.frequency * time + self.phase))

    def variance(self, tau: FloatArray, interval: float) -> FloatArray:
        """Compute the Allan variance, (k,). `tau` (k,): averaging times [s]. `interval`: sampling interval [s]."""
        denominator = tau / interval * math.sin(math.pi * self.frequency * interval)
        return np.asarray((self.amplitude * np.sin(np.pi * self.frequency * tau) ** 2 / denominator) ** 2)


def find_sinusoids(values: FloatArray, interval: float) -> tuple[Sinusoid, ...]:
    """Find steady sinusoids, strongest first. `values` (n,): even samples, not constant. `interval`: step [s]."""
    n = prev_fast_len(min(values.size, LONGEST), real=True)
    if n < FEWEST_SAMPLES:
        return ()
    straight, window = detrend(values[:n]), hann(n, sym=False)
    spectrum = rfft(straight * window)
    noise_power = _around(np.abs(spectrum) ** 2)
    bins = np.arange(spectrum.size)
    allowed = (bins >= FEWEST_CYCLES) & (bins < spectrum.size - 1 - MAIN_LOBE) & (noise_power > 0.0)
    limit = -math.log(FALSE_ALARM / max(int(np.count_nonzero(allowed)), 1))
    sinusoids: list[Sinusoid] = []
    strongest = 0.0
    for _ in range(4 * MOST):
        power = np.where(allowed, np.abs(spectrum) ** 2, 0.0)
        ratio = power / np.where(allowed, noise_power, 1.0)
        peak = int(np.argmax(ratio))
        if ratio[peak] < limit or power[peak] < FAINT * strongest or len(sinusoids) == MOST:
            break
        strongest = max(strongest, float(power[peak]))
        offset, sd = _offset(np.abs(spectrum[peak - 1 : peak + 2]), float(noise_power[peak]))
        first, last = max(0, peak - WIDE), min(spectrum.size, peak + WIDE + 1)
        bins_off = offset + peak - bins[first:last]
        line = np.sinc(bins_off) + 0.5 * (np.sinc(bins_off - 1.0) + np.sinc(bins_off + 1.0))  # of a Hann window
        shape = line * (-1.0) ** (bins[first:last] - peak)
        spectrum[first:last] -= spectrum[peak] / shape[peak - first] * shape
        lobe = slice(peak - MAIN_LOBE, peak + MAIN_LOBE + 1)
        remainder = float(np.sum(np.abs(spectrum[lobe]) ** 2)) - (2 * MAIN_LOBE + 1) * float(noise_power[peak])
        allowed[lobe] = False
        if remainder < REST * power[peak] + limit * noise_power[peak]:
            sinusoids.append(_line(straight * window, (peak + offset) / n, sd / n, float(noise_power[peak]), interval))
    return tuple(sorted(sinusoids, key=lambda line: -line.amplitude))


def _around(power: FloatArray) -> FloatArray:
    """Estimate the noise power around each bin by medians over bands, robust against lines."""
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
    """Estimate the distance of a line from the highest bin by the larger neighbouring bin, with sd [bins].

    `size` (3,): magnitudes of the highest bin and its neighbours. `noise`: mean power of the noise. The ratio r of two
    bins of a Hann window is (1 + d) / (2 - d); noise of neighbours has the correlation 2/3.
    """
    right = size[2] > size[0]
    r = float(size[2] if right else size[0]) / float(size[1])
    d = (2.0 * r - 1.0) / (r + 1.0)
    sd = 3.0 / (r + 1.0) ** 2 * math.sqrt(0.5 * noise * (1.0 + r * r - 4.0 / 3.0 * r)) / float(size[1])
    return (d if right else -d), sd


def _line(windowed: FloatArray, cycles: float, cycles_sd: float, noise: float, interval: float) -> Sinusoid:
    """Fit amplitude and phase of a line in a windowed signal. `cycles`: known frequency [cycles per sample]."""
    n = windowed.size
    demodulated = windowed @ np.exp(-2j * np.pi * cycles * np.arange(n)) * 4.0 / n  # the window has the mean 1/2
    sd = 4.0 / n * math.sqrt(0.5 * noise)
    return Sinusoid(cycles / interval, cycles_sd / interval, float(abs(demodulated)), sd, float(np.angle(demodulated)))


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One noise coefficient in SI units, or the standard deviation of a Gauss-Markov process."""

    value: float  # estimated coefficient
    sd: float  # its standard deviation
    low: float  # 95 % interval, by chi-square with the degrees of freedom of the standard deviation
    high: float


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise model of one axis."""

    coefficients: dict[str, Coefficient]  # by name, Q, N, B, K, GM or R: only significant ones
    correlation_time: float  # correlation time of the Gauss-Markov process [s]; infinite without a process
    correlation_time_sd: float  # its standard deviation [s]
    # relative standard deviation of the model error beyond the uncertainty of the Allan variances; zero without
    misfit: float
    variance: FloatArray  # (k,) Allan variance of the model at the times of the record
    freedom: FloatArray  # (k,) equivalent degrees of freedom of each estimate
    low: FloatArray  # (k,) ends of the 95 % intervals of the measured Allan deviations
    high: FloatArray
    sinusoids: tuple[Sinusoid, ...] = ()  # steady lines, strongest first; included in `variance`


@dataclass(frozen=True, slots=True)
class _Fit:
    """Fitted noise model, with the quality of the fit."""

    squares: FloatArray  # (6,) squared coefficients in the order of `NAMES`
    time: float  # correlation time [s]
    likelihood: float  # minus twice the log-likelihood, plus the penalty of Akaike's criterion
    spread: FloatArray  # covariance of the squares that are not zero, then of ln(time)
    misfit: float  # as in `NoiseModel`


def basis(tau: FloatArray, correlation_time: float) -> FloatArray:
    """Compute the Allan variance of each noise term with coefficient 1.

    `tau` (k,): averaging times [s]. `correlation_time`: [s]. Returns (k, 6): for Q^2, N^2, B^2, K^2, the variance of
    the Gauss-Markov process, and R^2.
    """
    u = tau / correlation_time
    # (2 T / tau) (1 - T / (2 tau) (3 - 4 exp(-tau / T) + exp(-2 tau / T))), IEEE Std 952-1997, annex C. For small u
    # a series replaces the formula, whose terms cancel.
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = (2.0 * u - 3.0 + 4.0 * np.exp(-u) - np.exp(-2.0 * u)) / u**2
    markov = np.where(u < 1e-3, 2.0 / 3.0 * u * (1.0 - 0.75 * u), exact)
    return np.column_stack([3.0 / tau**2, 1.0 / tau, np.full(tau.size, B_FACTOR**2), tau / 3.0, markov, 0.5 * tau**2])


def fit_noise(allan: AllanDeviation, column: int = 0) -> NoiseModel:
    """Fit the noise coefficients of one axis.

    `allan`: from `insnav.lab.noise.allan.allan_deviation`; the column must not be all zero. Akaike's criterion chooses
    between a floor B and a Gauss-Markov process. Terms that lower chi-square by less than 6.63 (1 % level) are dropped.
    """
    rows = _chosen(allan)
    floor, markov = (_Fitter(allan, column, rows).fit(np.array([n != out for n in NAMES])) for out in ("GM", "B"))
    # a Gauss-Markov process has more parameters than a floor or a random walk, and must fit significantly better
    best = markov if markov.likelihood + SIGNIFICANT < floor.likelihood else floor
    time = best.time
    sd = math.sqrt(best.spread[-1, -1]) * time if math.isfinite(time) else 0.0
    empty = np.empty(0)
    model = NoiseModel(_coefficients(best), time, sd, best.misfit, empty, empty, empty, empty)
    return evaluated(model, allan, column)


def evaluated(model: NoiseModel, allan: AllanDeviation, column: int) -> NoiseModel:
    """Evaluate a model at the averaging times of `allan`, with intervals of the measured deviations.

    `allan`: Allan deviations of the same record, at any averaging times. `column`: axis.
    """
    squares = np.array([model.coefficients[n].value ** 2 if n in model.coefficients else 0.0 for n in NAMES])
    time = model.correlation_time  # the first five terms are random; the sixth, the rate ramp, adds no spread
    variance = basis(allan.tau, time if math.isfinite(time) else 1.0) @ squares
    spread = np.diag(covariance(allan.factors, allan.n, allan.interval, squares[:5], time, diagonal=True)).copy()
    for line in model.sinusoids:  # its uncertainty is from its amplitude
        line_variance = line.variance(allan.tau, allan.interval)
        variance = variance + line_variance
        spread += (2.0 * line.amplitude_sd / line.amplitude * line_variance) ** 2
    degrees = np.maximum(freedom(variance, spread), FEWEST_FREEDOM)
    low, high = chi_square_interval(allan.deviation[:, column], degrees, CONFIDENCE)
    return replace(model, variance=variance, freedom=degrees, low=low, high=high)


def _coefficients(fit: _Fit) -> dict[str, Coefficient]:
    coefficients = {}
    for row, index in enumerate(np.flatnonzero(fit.squares)):
        value, variance = float(fit.squares[index]), float(fit.spread[row, row])
        root = math.sqrt(value)
        low, high = chi_square_interval(root, 2.0 * value**2 / variance, CONFIDENCE)
        coefficients[NAMES[index]] = Coefficient(root, 0.5 * math.sqrt(variance) / root, float(low), float(high))
    return coefficients


def _chosen(allan: AllanDeviation) -> IntArray:
    """Choose rows for the fit: about `PER_DECADE` per decade of averaging time, with both ends of the range."""
    tau = allan.tau[allan.factors * FITTED_PART <= allan.n]
    targets = np.geomspace(tau[0], tau[-1], max(4, 1 + round(PER_DECADE * math.log10(tau[-1] / tau[0]))))
    return np.unique([int(np.argmin(np.abs(np.log(tau / target)))) for target in targets])


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of generalised least squares, from a covariance."""

    inverse: FloatArray  # (k, k) inverse of a square root of the covariance: it whitens residuals
    logarithm: float  # logarithm of the determinant of the covariance

    @classmethod
    def of(cls, own: FloatArray, misfit: FloatArray) -> Weights:
        """Compute weights from a covariance (k, k), plus the standard deviations (k,) of an independent misfit."""
        size = np.sqrt(np.diag(own) + misfit**2)
        value, vector = np.linalg.eigh((own + np.diag(misfit**2)) / np.outer(size, size))
        value = np.maximum(value, SINGULAR)  # smaller eigenvalues are errors of rounding and quadrature
        # any square root is valid: here the one from the eigenvectors
        return cls((vector / np.sqrt(value)).T / size, float(np.log(value).sum() + 2.0 * np.log(size).sum()))

    def chi(self, left: FloatArray) -> float:
        """Compute chi-square of residuals (k,)."""
        return float(np.sum((self.inverse @ left) ** 2))

    def likelihood(self, seen: FloatArray, model: FloatArray) -> float:
        """Compute minus twice the log-likelihood, up to a constant."""
        return self.chi(seen - model) + self.logarithm


class _Fitter:
    """Fit of noise coefficients to the Allan variances of one axis, by generalised least squares."""

    def __init__(self, allan: AllanDeviation, column: int, rows: IntArray) -> None:
        self.allan = allan
        self.tau, self.factors = allan.tau[rows], allan.factors[rows]
        self.size = float(np.max(allan.deviation[rows, column])) ** 2  # unit of all fitted variances
        self.seen = allan.deviation[rows, column] ** 2 / self.size
        times = max(2, math.ceil(TIMES_PER_DECADE * math.log10(self.tau[-1] / self.tau[0])))
        # Correlation times T to try. The peak at 1.89 T, and longer times, must lie within the record. A short
        # correlation time belongs to the sensor's own filter, not to a bias.
        self.times = np.geomspace(
            SHORTEST * allan.interval, max(self.tau[-1] / 3.0, 2.0 * SHORTEST * allan.interval), times
        )
        self.misfit = 0.0

    def fit(self, allowed: BoolArray) -> _Fit:
        """Fit the allowed terms, estimate the misfit, and drop insignificant terms."""
        squares, time = self._again(allowed, *self._start(allowed), ROUNDS)
        for _ in range(ROUNDS):  # weights depend on the misfit, and the misfit on the fit
            if not self._find_misfit(squares, time):
                break
            squares, time = self._again(allowed, squares, time, 1)
        while True:  # drop the term of least significance, until all are significant
            present = squares > 0.0
            full = self._weights(squares, time).likelihood(self.seen, self._basis(time) @ squares)
            reductions = []
            for index in np.flatnonzero(present):
                without = present.copy()
                without[index] = False
                if without.any():
                    fitted = self._again(without, *self._solve(without, self._weights(squares, time), time), FEW_ROUNDS)
                    loss = self._weights(*fitted).likelihood(self.seen, self._basis(fitted[1]) @ fitted[0]) - full
                    reductions.append((loss, fitted))
            loss, fitted = min(reductions, key=lambda each: each[0], default=(math.inf, (squares, time)))
            if not loss < SIGNIFICANT:
                break
            squares, time = self._again(fitted[0] > 0.0, *fitted, ROUNDS)
        return self._result(squares, time if squares[4] > 0.0 else math.inf)

    def _again(self, allowed: BoolArray, squares: FloatArray, time: float, rounds: int) -> tuple[FloatArray, float]:
        """Repeat the fit `rounds` times, each with the weights of the previous fit."""
        for _ in range(rounds):
            squares, time = self._solve(allowed, self._weights(squares, time), time)
        return squares, time

    def _find_misfit(self, squares: FloatArray, time: float) -> bool:
        """Set the misfit with which chi-square has its expected value; return False if the fit needs none."""
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
        if squares[4] > 0.0:  # one more column: derivative by the logarithm of the correlation time
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
        """Fit with errors as large as the values, so that all averaging times have equal weight."""
        return self._solve(allowed, Weights(np.diag(1.0 / self.seen), 0.0), float(self.times[self.times.size // 2]))

    def _own(self, squares: FloatArray, time: float) -> FloatArray:
        """Compute the covariance of the measured Allan variances that the model predicts."""
        own = covariance(self.factors, self.allan.n, self.allan.interval, squares[:5], time)
        model = (self._basis(time) * squares).sum(axis=1)
        # By chance, noise makes the means of both halves of the record differ. This changes the apparent ramp: an error
        # common to all averaging times.
        half = 0.5 * self.allan.n * self.allan.interval
        random = float((basis(np.array([half]), time if math.isfinite(time) else 1.0)[0] * squares)[:5].sum())
        slope = math.sqrt(2.0 * squares[5] * random) / half * self.tau**2
        own += np.outer(slope, slope)
        return np.asarray(own + np.diag((NEGLIGIBLE * model) ** 2))

    def _weights(self, squares: FloatArray, time: float) -> Weights:
        return Weights.of(self._own(squares, time), self.misfit * (self._basis(time) @ squares))

    def _solve(self, allowed: BoolArray, weights: Weights, time: float) -> tuple[FloatArray, float]:
        """Find the squares, none negative, and the correlation time of least chi-square."""
        measured = weights.inverse @ self.seen

        def at(time: float) -> tuple[float, FloatArray]:
            white = weights.inverse @ self._basis(time)[:, allowed]
            scale = np.linalg.norm(white, axis=0)
            part, left = nnls(white / scale, measured)
            squares = np.zeros(6)
            squares[allowed] = part / scale
            return left, squares

        if not allowed[4]:
            return at(1.0)[1], math.inf
        best = int(np.argmin([at(each)[0] for each in self.times]))
        ends = self.times[max(0, best - 1)], self.times[min(best + 1, self.times.size - 1)]
        bounds = tuple(math.log(each) for each in ends)
        minimum = minimize_scalar(
            lambda logarithm: at(math.exp(logarithm))[0], bounds=bounds, method="bounded", options={"xatol": 1e-4}
        )
        time = math.exp(float(minimum.x))
        return at(time)[1], time
