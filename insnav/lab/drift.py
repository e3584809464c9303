"""Gyro drift due to rate, temperature and specific force, its correction, and a smoother of the remaining noise.

N = A + B W + c_T (T - 25 C) + c_g a for each axis: N is the output minus the true rate W, a the specific force along
the axis. The terms are bias, remaining scale factor error, and the sensitivities to temperature and to g.

A scalar Kalman filter smooths the rate, a random walk measured with white noise: x[k] = x[k-1] + w, z[k] = x[k] + v.
The variances are Q of w and R of v. Q and R maximise the likelihood of the record (local level model; A. C. Harvey,
Forecasting, Structural Time Series Models and the Kalman Filter (1989), random walk plus noise). Differences of z have
the tridiagonal covariance Q + 2 R, -R, whose eigenvectors are sines. The likelihood is therefore exact, at the cost of
one sine transform. Allan deviations and coefficients show the noise before and after correction and smoothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.fft import dst
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.model import REFERENCE_TEMPERATURE, ErrorTerms, ImuErrors, correct
from insnav.lab.bench_data import BenchFile, DriftRecord
from insnav.lab.calibration import Fit, coverage_factor, linear_fit
from insnav.lab.noise import allan as deviations
from insnav.lab.noise.allan import GAP, AllanDeviation, Weights
from insnav.types import FloatArray, ImuData, IntArray
from insnav.units import DEG, G0

# a term is fitted if the part of its cause that is independent of earlier causes has at least this sd
SHOWS = {"B": 1.0 * DEG, "c_T": 0.5, "c_g": 0.05 * G0}
_CAUSES = {"B": "rate", "c_T": "temperature", "c_g": "specific_force"}
_UNITS = {"B": "rad_s", "c_T": "k", "c_g": "m_s2"}
FEWEST = 100  # least number of samples
PARTS = (12, 24, 48, 96, 192)  # numbers of equal parts of a record; the means of the parts reveal correlated residuals
LARGEST_B = 0.5  # largest scale factor error; a larger one means a wrong unit in the header
P0 = DEG**2  # variance of the initial state: 1 (deg/s)^2
SLOWEST_PART = 10  # least length of the record that determines Q and R, in time constants of the filter
SETTLED = 1e-13  # relative change of the gain that counts as zero
# least slope of a ramp relative to the largest, largest relative change of its slope, least duration [s]
STILL, UNSTEADY, SHORTEST_RAMP = 0.05, 0.2, 5.0
RAMP_RATE, RAMP_TIME = 60.0 * DEG, 100.0  # computed ramp: to 10 r/min in 100 s
TAUS = (0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0, 50.0)  # averaging times [s]
POWERS = ("Q", "N", "B", "K", "R")  # coefficients of tau to the power -2, -1, 0, 1, 2
NORMAL = 1.959964  # half width of a 95 % interval in standard deviations
SAME = 0.9  # smoothing helps as long as it lowers the deviation below this share


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Fitted drift of one gyro."""

    axis: str  # x, y or z
    # fitted terms: A [rad/s], B [-], c_T [rad/s/K], c_g [rad/s/(m/s^2)], and their standard deviations, which include
    # the correlation of the residuals (`variance_inflation`)
    value: Mapping[str, float]
    sd: Mapping[str, float]
    left_out: Mapping[str, Finding]  # by term that the record does not determine: the reason
    fit: Fit
    freedom: float  # degrees of freedom of these standard deviations

    def half_width(self, term: str) -> float:
        """Compute the half width of the 95 % interval of a term."""
        return self.sd[term] * coverage_factor(self.freedom)


def drift_model(record: DriftRecord, axis: str) -> DriftModel:
    """Fit the drift of one gyro. `axis`: x, y or z. Raises: InputError: fewer than 100 samples."""
    if record.time.size < FEWEST:
        raise InputError("lab.drift_short", where=record.name, count=record.time.size, limit=FEWEST)
    columns = [np.ones(record.time.size)]
    causes = {
        "B": record.rate.get(axis),
        "c_T": None if record.temperature is None else record.temperature - REFERENCE_TEMPERATURE,
        "c_g": record.force.get(axis),
    }
    names = ["A"]
    left_out: dict[str, Finding] = {}
    for term, cause in causes.items():
        reason = _left_out(term, cause, columns, f"gyro {axis}")
        if reason is not None:
            left_out[term] = reason
        elif cause is not None:
            names.append(term)
            columns.append(cause)
    drift = record.gyro[axis] - record.true_rate(axis)
    fit = linear_fit(np.column_stack(columns), drift, names, where=f"{record.name}, gyro {axis}")
    value = dict(zip(names, fit.value.tolist(), strict=True))
    if abs(value.get("B", 0.0)) > LARGEST_B:
        raise InputError("lab.rate_scale", where=record.name, sensor=f"gyro {axis}", ratio=1.0 + value["B"])
    inflation, freedom = variance_inflation(fit.residual, len(names))
    sd = fit.sd * np.sqrt(inflation)
    return DriftModel(axis, value, dict(zip(names, sd.tolist(), strict=True)), left_out, fit, freedom)


def _left_out(term: str, cause: FloatArray | None, columns: list[FloatArray], subject: str) -> Finding | None:
    """Find the reason why a term cannot be separated from the terms of `columns`; None if it can."""
    if cause is None:
        return Finding.of(Code.DRIFT_NO_COLUMN, subject=subject, term=term, cause=_CAUSES[term])
    earlier = np.column_stack(columns)
    independent = np.std(cause - earlier @ np.linalg.lstsq(earlier, cause, rcond=None)[0])
    for code, spread in ((Code.DRIFT_CONSTANT, np.std(cause)), (Code.DRIFT_CONFOUNDED, independent)):
        if spread < SHOWS[term]:
            spreads: dict[str, Any] = {f"spread_{_UNITS[term]}": spread, f"limit_{_UNITS[term]}": SHOWS[term]}
            return Finding.of(code, subject=subject, **spreads, term=term, cause=_CAUSES[term])
    return None


def variance_inflation(residual: FloatArray, fitted: int) -> tuple[float, float]:
    """Compute the factor by which correlated residuals increase the variance of their mean.

    For independent samples, the variance of the means of equal parts, times their length, equals the sample variance.
    The factor is the largest ratio of both over several lengths, up to a twelfth of the record. Correlation over more
    than a part is not detected (method of batch means; J. M. Flegal and G. L. Jones, Annals of Statistics 38 (2010)
    1034).

    `residual` (n,): of a fit. `fitted`: number of its parameters, which reduce the degrees of freedom of the means.
    Returns inflation of the variance of a mean, at least 1, and its degrees of freedom.
    """
    n = residual.size
    variance = float(residual @ residual) / max(1, n - fitted)
    largest = (1.0, float(max(1, n - fitted)))
    for parts in PARTS:
        length = n // parts
        if length < 2 or not variance > 0.0:
            continue
        means = residual[: parts * length].reshape(parts, length).mean(axis=1)
        inflation = length * float(means @ means) / (parts - fitted) / variance
        if inflation > largest[0]:
            largest = inflation, float(parts - fitted)
    return largest


def drift_errors(models: Mapping[str, DriftModel], name: str = "") -> ImuErrors:
    """Build errors for `insnav.imu.correct`: bias at 25 deg C, scale factor, sensitivities.

    `models`: by letter of the axis; other axes get no errors. `name`: name of the sensor.
    """

    def three(term: str) -> FloatArray:
        return np.array([models[axis].value.get(term, 0.0) if axis in models else 0.0 for axis in "xyz"])

    terms = ErrorTerms(bias_slope=three("c_T"), g_sensitivity=np.diag(three("c_g")))
    return ImuErrors(gyro_bias=three("A"), gyro_matrix=np.diag(1.0 + three("B")), gyro_terms=terms, name=name)


def corrected_rates(record: DriftRecord, errors: ImuErrors) -> dict[str, FloatArray]:
    """Return the rates without the modelled drift, by letter of the axis, (n,) each [rad/s].

    `errors`: from `drift_errors`.
    """
    no_signal = np.zeros(record.time.size)
    gyro = np.column_stack([record.gyro.get(axis, no_signal) for axis in "xyz"])
    force = np.column_stack([record.force.get(axis, no_signal) for axis in "xyz"])
    corrected = correct(ImuData(record.time, gyro, force, temperature=record.temperature), errors).gyro
    return {axis: corrected[:, "xyz".index(axis)] for axis in record.axes}


@dataclass(frozen=True, slots=True)
class Smoother:
    """Scalar Kalman filter in its steady state."""

    q: float  # variance of the random-walk step between samples [(rad/s)^2]
    r: float  # variance of the white noise of a sample [(rad/s)^2]
    interval: float  # sampling interval [s]
    bounded: bool  # Q is at its lower limit: the record has no random walk

    @property
    def gain(self) -> float:
        """Steady-state gain: P (P + R)^-1 with P = Q / 2 + sqrt(Q^2 / 4 + Q R) before the update."""
        p = 0.5 * self.q + math.sqrt(0.25 * self.q**2 + self.q * self.r)
        return p / (p + self.r)

    @property
    def time_constant(self) -> float:
        """Time after a step of the rate until the error has fallen to 1/e of the step [s]."""
        return -self.interval / math.log1p(-self.gain)

    @property
    def lag(self) -> float:
        """Delay of the output on a ramp, (1 - gain) / gain intervals [s]."""
        return self.interval * (1.0 - self.gain) / self.gain


def choose_smoother(values: FloatArray, interval: float) -> Smoother:
    """Choose Q and R by maximum likelihood.

    `values` (n,): random part of a rate at rest [rad/s]. `interval`: sampling interval [s]. Q has a lower limit, at
    which the time constant is a tenth of the record: slower walks are not observable. Raises: InputError: constant
    values.
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
    minimum = minimize_scalar(unlikely, bounds=(smallest, 0.0), method="bounded", options={"xatol": 1e-6})
    # the bounded search never evaluates the bound itself: take it if its likelihood is practically equal
    bounded = unlikely(smallest) <= float(minimum.fun) + 1e-3
    ratio = math.exp(smallest if bounded else float(minimum.x))
    r = float(np.mean(power / (ratio + shape)))
    return Smoother(ratio * r, r, interval, bounded)


def smooth(values: FloatArray, smoother: Smoother) -> FloatArray:
    """Run the Kalman filter over a rate, from the state zero with a variance of 1 (deg/s)^2.

    filterpy computes the steps until the gain has settled. A recursion of constant gain computes all later steps.

    `values` (n,): [rad/s], finite. Returns (n,): [rad/s]. Raises: InputError: a value that is not finite, because it
    would remain in the filter.
    """
    if not np.isfinite(values).all():
        raise InputError("lab.not_finite", row=int(np.argmin(np.isfinite(values))) + 1)
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.F, kalman.H = np.eye(1), np.eye(1)
    kalman.P, kalman.Q, kalman.R = np.array([[P0]]), np.array([[smoother.q]]), np.array([[smoother.r]])
    out = np.empty(values.size)
    previous_gain = math.inf
    for k, value in enumerate(values):
        kalman.predict()
        kalman.update(np.array([[value]]))
        out[k] = kalman.x[0, 0]
        gain = float(kalman.K[0, 0])
        if abs(gain - previous_gain) <= SETTLED * gain:
            keep = 1.0 - gain
            out[k + 1 :] = lfilter([gain], [1.0, -keep], values[k + 1 :], zi=[keep * out[k]])[0]
            break
        previous_gain = gain
    return out


@dataclass(frozen=True, slots=True)
class RampAnswer:
    """Response of a smoother to a rate ramp."""

    time: FloatArray  # (n,) time [s]
    rate: FloatArray  # (n,) true rate [rad/s]
    smoothed: FloatArray  # (n,) filtered rate [rad/s]
    slope: float  # slope of the ramp [rad/s^2]
    lag: float  # delay of the filter in the second half of the ramp, and its standard deviation [s]
    lag_sd: float
    worst: float  # largest error from the second half of the ramp on [rad/s]
    measured: bool  # True: the rates are recorded; False: they are computed without noise


def computed_ramp(smoother: Smoother) -> RampAnswer:
    """Compute the noise-free response to a ramp to 10 r/min in 100 s, followed by 100 s of constant rate."""
    time = smoother.interval * np.arange(round(2.0 * RAMP_TIME / smoother.interval) + 1, dtype=np.float64)
    rate = np.asarray(RAMP_RATE * np.minimum(time / RAMP_TIME, 1.0), dtype=np.float64)
    keep = 1.0 - smoother.gain
    response = np.asarray(lfilter([smoother.gain], [1.0, -keep], rate))  # with zero rate for a long time before
    return _answer(np.asarray(time), rate, response, slice(0, round(RAMP_TIME / smoother.interval) + 1), measured=False)


def recorded_ramp(time: FloatArray, rate: FloatArray, smoothed: FloatArray) -> RampAnswer | None:
    """Measure the lag in the longest steady ramp of a record; None without a ramp of 5 s.

    `time` (n,): [s]. `rate`, `smoothed` (n,): true and smoothed rate [rad/s].
    """
    span = max(1, round(1.0 / float(np.median(np.diff(time)))))  # slopes over a second, to ignore steps of the table
    slope = (rate[span:] - rate[:-span]) / (time[span:] - time[:-span])
    longest = slice(0, 1)
    for sign in (1.0, -1.0):
        turning = sign * slope > STILL * float(np.max(np.abs(slope), initial=0.0))
        if not turning.any():
            continue
        median_slope = float(np.median(slope[turning]))
        steady = np.concatenate([[0], np.abs(slope - median_slope) < UNSTEADY * abs(median_slope), [0]])
        borders = np.flatnonzero(np.diff(steady))
        for begin, end in zip(borders[::2].tolist(), borders[1::2].tolist(), strict=True):
            if end + span - begin > longest.stop - longest.start:
                longest = slice(begin, end + span)
    if time[longest.stop - 1] - time[longest.start] < SHORTEST_RAMP:
        return None
    return _answer(time, rate, smoothed, longest, measured=True)


def _answer(time: FloatArray, rate: FloatArray, smoothed: FloatArray, ramp: slice, *, measured: bool) -> RampAnswer:
    slope = float((rate[ramp.stop - 1] - rate[ramp.start]) / (time[ramp.stop - 1] - time[ramp.start]))
    half = slice((ramp.start + ramp.stop) // 2, ramp.stop)
    lags = (rate[half] - smoothed[half]) / slope
    # the filter's errors are correlated, so the scatter of the mean is from the means of ten parts
    parts = np.array([part.mean() for part in np.array_split(lags, 10)]) if lags.size >= 20 else lags
    sd = float(np.std(parts, ddof=1) / math.sqrt(parts.size))
    worst = float(np.max(np.abs(rate[half.start :] - smoothed[half.start :])))
    return RampAnswer(time, rate, smoothed, slope, float(lags.mean()), sd, worst, measured)


@dataclass(frozen=True, slots=True)
class PowerCoefficient:
    """Coefficient of ``sigma^2(tau) = sum A_m tau^m``, and the noise parameter that it determines."""

    power: float  # A_m [unit^2 s^-m]
    value: float  # Q, N, B, K or R; zero if A_m is negative
    low: float  # its 95 % interval, from the interval of A_m; zero if A_m may be negative
    high: float


@dataclass(frozen=True, slots=True)
class Curve:
    """Allan deviation of one signal at the times of the table."""

    allan: AllanDeviation  # Allan deviation with one column
    low: FloatArray  # (k,) ends of the 95 % intervals of the deviation [rad/s]
    high: FloatArray
    freedom: FloatArray  # (k,) equivalent degrees of freedom
    coefficients: Mapping[str, PowerCoefficient]  # by Q, N, B, K, R; empty with fewer than five times

    @property
    def deviation(self) -> FloatArray:
        """Allan deviation, (k,) [rad/s]."""
        return self.allan.deviation[:, 0]


@dataclass(frozen=True, slots=True)
class GyroDrift:
    """Rates and noise of one gyro, before and after correction and smoothing."""

    model: DriftModel
    smoother: Smoother
    rest: slice  # samples at rest before any rotation
    measured_rate: FloatArray  # (n,) rate as recorded [rad/s]
    corrected_rate: FloatArray  # (n,) rate without the modelled drift [rad/s]
    smoothed_rate: FloatArray  # (n,) corrected rate after smoothing [rad/s]
    measured: Curve  # noise at rest: of the rate as recorded, corrected, and smoothed
    corrected: Curve
    smoothed: Curve
    computed: RampAnswer  # response of the filter to a ramp without noise
    recorded: RampAnswer | None  # response to the ramp of the record, if it has one

    @property
    def helped_until(self) -> float:
        """Longest averaging time at which smoothing lowers the deviation, zero if none [s]."""
        lower = np.flatnonzero(self.smoothed.deviation < SAME * self.corrected.deviation)
        return float(self.corrected.allan.tau[lower[-1]]) if lower.size else 0.0


@dataclass(frozen=True, slots=True)
class DriftStudy:
    """Drift of all gyros of a record, its correction and smoothing."""

    record: DriftRecord
    gyros: tuple[GyroDrift, ...]
    errors: ImuErrors  # fitted drift, to correct other records
    warnings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    file: BenchFile | None = None  # source file of the record


def drift_study(record: DriftRecord) -> DriftStudy:
    """Fit, correct and smooth every gyro of a record, and compare its noise before and after.

    Raises: InputError: gaps, or fewer than 100 samples at rest at the beginning.
    """
    _refuse_gaps(record)
    stationary = slice(0, int(np.count_nonzero(record.at_rest())))
    if stationary.stop < FEWEST:
        raise InputError("lab.no_rest_first", where=record.name, count=stationary.stop, limit=FEWEST)
    models = {axis: drift_model(record, axis) for axis in record.axes}
    errors = drift_errors(models, f"drift of {record.name}")
    corrected = corrected_rates(record, errors)
    factors, notes = _factors(stationary.stop, record.interval)
    gyros = tuple(_one(record, stationary, models[axis], corrected[axis], factors) for axis in record.axes)
    return DriftStudy(record, gyros, errors, _warnings(gyros), notes)


def _refuse_gaps(record: DriftRecord) -> None:
    step = np.diff(record.time)
    if not np.all(step > 0.0):
        raise InputError("lab.times_not_increasing", where=record.name)
    wide = np.flatnonzero(step > GAP * np.median(step))
    if wide.size:
        raise InputError("lab.gaps", where=record.name, after_s=record.time[wide[0]], count=wide.size, limit=GAP)


def _factors(n: int, interval: float) -> tuple[IntArray, tuple[Finding, ...]]:
    """Select the averaging times of `TAUS` that the stationary part permits, in samples."""
    wanted = np.array(TAUS) / interval
    usable = (np.rint(wanted) >= 1) & (np.abs(wanted - np.rint(wanted)) < 0.02 * wanted) & (2 * np.rint(wanted) <= n)
    if not usable.any():
        raise InputError("lab.rest_without_times", length_s=n * interval, interval_s=interval)
    omitted = tuple(tau for tau, is_usable in zip(TAUS, usable, strict=True) if not is_usable)
    notes = (Finding.of(Code.DRIFT_TIMES, tau_s=omitted, length_s=n * interval, interval_s=interval),) * bool(omitted)
    return np.unique(np.rint(wanted[usable]).astype(np.int64)), notes


def _one(record: DriftRecord, rest: slice, model: DriftModel, rate: FloatArray, factors: IntArray) -> GyroDrift:
    measured, interval = record.gyro[model.axis], record.interval
    random = rate[rest] - rate[rest].mean()
    smoother = choose_smoother(random, interval)
    smoothed = smooth(rate, smoother)
    white, walk = smoother.r * interval, smoother.q / interval
    noise = np.array([0.0, white, 0.0, walk, 0.0])
    # smoothed white noise is a Gauss-Markov process; a random walk stays a random walk
    smooth_noise = np.array([0.0, 0.0, 0.0, walk, smoother.r * smoother.gain / (2.0 - smoother.gain)])
    curves = (
        _curve(measured[rest], interval, factors, noise, math.inf),
        _curve(random, interval, factors, noise, math.inf),
        _curve(smooth(random, smoother), interval, factors, smooth_noise, smoother.time_constant),
    )
    ramps = computed_ramp(smoother), recorded_ramp(record.time, record.true_rate(model.axis), smoothed)
    return GyroDrift(model, smoother, rest, measured, rate, smoothed, *curves, *ramps)


def _curve(values: FloatArray, interval: float, factors: IntArray, squares: FloatArray, time: float) -> Curve:
    """Compute deviations, with intervals for noise of these squared coefficients (Q, N, B, K, Gauss-Markov)."""
    allan = deviations.allan_deviation(values[:, None], interval, factors)
    expected = deviations.basis(allan.tau, time if math.isfinite(time) else 1.0)[:, :5] @ squares
    own = deviations.covariance(factors, allan.n, interval, squares, time)
    degrees = np.maximum(deviations.freedom(expected, np.diag(own)), deviations.FEWEST_FREEDOM)
    low, high = deviations.chi_square_interval(allan.deviation[:, 0], degrees, 0.95)
    return Curve(allan, low, high, degrees, power_fit(allan, own))


def power_fit(allan: AllanDeviation, own: FloatArray) -> dict[str, PowerCoefficient]:
    """Fit the coefficients of ``sigma^2(tau) = sum A_m tau^m``, m = -2 .. 2, by generalised least squares.

    `allan`: one column. `own` (k, k): covariance of the Allan variances. Returns by Q, N, B, K, R (IEEE Std 952-1997,
    annex C); empty with fewer than five times.
    """
    if allan.tau.size < len(POWERS):
        return {}
    unit = deviations.basis(allan.tau, 1.0)[:, [deviations.NAMES.index(name) for name in POWERS]]
    variance = allan.deviation[:, 0] ** 2
    inverse = Weights.of(own, np.zeros(variance.size)).inverse
    white = inverse @ unit
    scale = np.linalg.norm(white, axis=0)
    pseudo = np.linalg.pinv(white / scale)
    squares = (pseudo @ (inverse @ variance)) / scale
    residual = inverse @ (variance - unit @ squares)
    dof = variance.size - len(POWERS)
    # if the sum of powers fits poorly, the misfit widens the intervals
    misfit = max(1.0, math.sqrt(float(residual @ residual) / dof)) if dof else 1.0
    sd = misfit * np.linalg.norm(pseudo, axis=1) / scale
    # A_m is the square times the variance of unit noise at tau = 1
    factors = deviations.basis(np.ones(1), 1.0)[0, [deviations.NAMES.index(name) for name in POWERS]]
    coefficients = {}
    for name, square, spread, factor in zip(POWERS, squares, sd, factors, strict=True):
        low, value, high = (math.sqrt(max(0.0, square + shift * spread)) for shift in (-NORMAL, 0.0, NORMAL))
        coefficients[name] = PowerCoefficient(float(square * factor), value, low, high)
    return coefficients


def _warnings(gyros: Sequence[GyroDrift]) -> tuple[Finding, ...]:
    warnings: list[Finding] = []
    for gyro in gyros:
        warnings += gyro.model.left_out.values()
        if gyro.smoother.bounded:
            time = gyro.smoother.time_constant
            warnings.append(Finding.of(Code.DRIFT_NO_WALK, subject=f"gyro {gyro.model.axis}", time_constant_s=time))
    return tuple(warnings)
