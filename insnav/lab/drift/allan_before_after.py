"""Effect of correction and smoothing on gyro noise: Allan deviations and coefficients before and after."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.model import ImuErrors
from insnav.lab.bench_data.bench_tables import BenchFile
from insnav.lab.drift.drift_model import FEWEST, DriftModel, DriftRecord, corrected_rates, drift_errors, drift_model
from insnav.lab.drift.rate_smoothing import RampAnswer, Smoother, choose_smoother, computed_ramp, recorded_ramp, smooth
from insnav.lab.noise.allan import GAP, AllanDeviation, allan_deviation, chi_square_interval, covariance, freedom
from insnav.lab.noise.noise_model import FEWEST_FREEDOM, NAMES, Weights, basis
from insnav.types import FloatArray, IntArray

TAUS = (0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0, 50.0)  # averaging times [s]
POWERS = ("Q", "N", "B", "K", "R")  # of tau: -2, -1, 0, 1, 2
NORMAL = 1.959964  # half width of a 95 % interval in standard deviations
SAME = 0.9  # a deviation of more than this part of the one before is no longer lower


@dataclass(frozen=True, slots=True)
class PowerCoefficient:
    """Coefficient of ``sigma^2(tau) = sum A_m tau^m`` and its noise parameter."""

    power: float  # A_m [unit^2 s^-m]
    value: float  # Q, N, B, K or R; zero if A_m is negative
    low: float  # its 95 % interval, from the interval of A_m; zero if A_m may be negative
    high: float


@dataclass(frozen=True, slots=True)
class Curve:
    """Allan deviation of one signal at the times of the table."""

    allan: AllanDeviation  # one column
    low: FloatArray  # (k,) 95 % intervals [rad/s]
    high: FloatArray
    freedom: FloatArray  # (k,) equivalent degrees of freedom
    coefficients: Mapping[str, PowerCoefficient]  # by Q, N, B, K, R; empty with fewer than five times

    @property
    def deviation(self) -> FloatArray:
        """Allan deviation, (k,) [rad/s]."""
        return self.allan.deviation[:, 0]


@dataclass(frozen=True, slots=True)
class GyroDrift:
    """One gyro before and after."""

    model: DriftModel
    smoother: Smoother
    rest: slice  # samples at rest before any rotation
    measured_rate: FloatArray  # (n,) rate as it came, without the modelled drift, and of the filter [rad/s]
    corrected_rate: FloatArray
    smoothed_rate: FloatArray
    measured: Curve  # of the drift as measured, after the model, and after smoothing, at rest
    corrected: Curve
    smoothed: Curve
    computed: RampAnswer  # the filter on a ramp without noise
    recorded: RampAnswer | None  # the same on the ramp of the record, if it has one

    @property
    def helped_until(self) -> float:
        """Longest averaging time at which smoothing lowers the deviation, zero if none [s]."""
        lower = np.flatnonzero(self.smoothed.deviation < SAME * self.corrected.deviation)
        return float(self.corrected.allan.tau[lower[-1]]) if lower.size else 0.0


@dataclass(frozen=True, slots=True)
class DriftStudy:
    """All gyros of a record."""

    record: DriftRecord
    gyros: tuple[GyroDrift, ...]
    errors: ImuErrors  # the drift, to correct other records
    warnings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    file: BenchFile | None = None  # source file of the record


def drift_study(record: DriftRecord) -> DriftStudy:
    """Fit, correct and smooth every gyro of a record, and compare its noise before and after.

    Raises: InputError: gaps, or fewer than 100 samples at rest at the beginning.
    """
    _refuse_gaps(record)
    rest = slice(0, int(np.count_nonzero(record.at_rest())))
    if rest.stop < FEWEST:
        raise InputError("lab.no_rest_first", where=record.name, count=rest.stop, limit=FEWEST)
    models = {axis: drift_model(record, axis) for axis in record.axes}
    errors = drift_errors(models, f"drift of {record.name}")
    corrected = corrected_rates(record, errors)
    factors, notes = _factors(rest.stop, record.interval)
    gyros = tuple(_one(record, rest, models[axis], corrected[axis], factors) for axis in record.axes)
    return DriftStudy(record, gyros, errors, _warnings(gyros), notes)


def _refuse_gaps(record: DriftRecord) -> None:
    step = np.diff(record.time)
    if not np.all(step > 0.0):
        raise InputError("lab.times_not_increasing", where=record.name)
    wide = np.flatnonzero(step > GAP * np.median(step))
    if wide.size:
        raise InputError("lab.gaps", where=record.name, after_s=record.time[wide[0]], count=wide.size, limit=GAP)


def _factors(n: int, interval: float) -> tuple[IntArray, tuple[Finding, ...]]:
    """Averaging times of the table that the part at rest holds, in samples."""
    wanted = np.array(TAUS) / interval
    held = (np.rint(wanted) >= 1) & (np.abs(wanted - np.rint(wanted)) < 0.02 * wanted) & (2 * np.rint(wanted) <= n)
    if not held.any():
        raise InputError("lab.rest_without_times", length_s=n * interval, interval_s=interval)
    lost = tuple(tau for tau, good in zip(TAUS, held, strict=True) if not good)
    notes = (Finding.of(Code.DRIFT_TIMES, tau_s=lost, length_s=n * interval, interval_s=interval),) * bool(lost)
    return np.unique(np.rint(wanted[held]).astype(np.int64)), notes


def _one(record: DriftRecord, rest: slice, model: DriftModel, rate: FloatArray, factors: IntArray) -> GyroDrift:
    measured, interval = record.gyro[model.axis], record.interval
    random = rate[rest] - rate[rest].mean()
    smoother = choose_smoother(random, interval)
    smoothed = smooth(rate, smoother)
    white, walk = smoother.r * interval, smoother.q / interval
    noise = np.array([0.0, white, 0.0, walk, 0.0])
    # smoothed white noise is a Gauss-Markov process; a walk stays one
    left = smoother.r * smoother.gain / (2.0 - smoother.gain)
    smooth_noise = np.array([0.0, 0.0, 0.0, walk, left])
    curves = (
        _curve(measured[rest], interval, factors, noise, math.inf),
        _curve(random, interval, factors, noise, math.inf),
        _curve(smooth(random, smoother), interval, factors, smooth_noise, smoother.time_constant),
    )
    ramps = computed_ramp(smoother), recorded_ramp(record.time, record.true_rate(model.axis), smoothed)
    return GyroDrift(model, smoother, rest, measured, rate, smoothed, *curves, *ramps)


def _curve(values: FloatArray, interval: float, factors: IntArray, squares: FloatArray, time: float) -> Curve:
    """Deviations with the intervals that noise of these squares (Q, N, B, K, Gauss-Markov) has."""
    allan = allan_deviation(values[:, None], interval, factors)
    expected = basis(allan.tau, time if math.isfinite(time) else 1.0)[:, :5] @ squares
    own = covariance(factors, allan.n, interval, squares, time)
    degrees = np.maximum(freedom(expected, np.diag(own)), FEWEST_FREEDOM)
    low, high = chi_square_interval(allan.deviation[:, 0], degrees, 0.95)
    return Curve(allan, low, high, degrees, power_fit(allan, own))


def power_fit(allan: AllanDeviation, own: FloatArray) -> dict[str, PowerCoefficient]:
    """Coefficients of ``sigma^2(tau) = sum A_m tau^m``, m = -2 .. 2, by generalised least squares.

    `allan`: one column. `own` (k, k): covariance of its variances. Returns by Q, N, B, K, R (IEEE Std 952-1997, annex
    C); empty with fewer than five times.
    """
    if allan.tau.size < len(POWERS):
        return {}
    unit = basis(allan.tau, 1.0)[:, [NAMES.index(name) for name in POWERS]]
    seen = allan.deviation[:, 0] ** 2
    inverse = Weights.of(own, np.zeros(seen.size)).inverse
    white = inverse @ unit
    scale = np.linalg.norm(white, axis=0)
    pseudo = np.linalg.pinv(white / scale)
    squares = (pseudo @ (inverse @ seen)) / scale
    left = inverse @ (seen - unit @ squares)
    spare = seen.size - len(POWERS)
    # if no sum of powers fits the curve, the intervals include the misfit
    misfit = max(1.0, math.sqrt(float(left @ left) / spare)) if spare else 1.0
    sd = misfit * np.linalg.norm(pseudo, axis=1) / scale
    # A_m: factor of tau^m, from tau = 1
    factors = basis(np.ones(1), 1.0)[0, [NAMES.index(name) for name in POWERS]]
    found = {}
    for name, square, spread, factor in zip(POWERS, squares, sd, factors, strict=True):
        low, value, high = (math.sqrt(max(0.0, square + shift * spread)) for shift in (-NORMAL, 0.0, NORMAL))
        found[name] = PowerCoefficient(float(square * factor), value, low, high)
    return found


def _warnings(gyros: Sequence[GyroDrift]) -> tuple[Finding, ...]:
    warnings: list[Finding] = []
    for each in gyros:
        warnings += each.model.left_out.values()
        if each.smoother.bounded:
            time = each.smoother.time_constant
            warnings.append(Finding.of(Code.DRIFT_NO_WALK, subject=f"gyro {each.model.axis}", time_constant_s=time))
    return tuple(warnings)
