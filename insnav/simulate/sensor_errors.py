"""Errors of sensors: an inertial unit sampled from its specification, and a satellite receiver.

Inertial sensors have drift, noise, resolution, range and clock errors. Receivers have white and time-correlated noise,
multipath, outages, latency and float solutions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insnav.earth import lla_offset
from insnav.exceptions import ConfigError
from insnav.imu import ClockSpec, ImuErrors, ImuSpec, SensorSpec, corrupt, sample_errors, sample_intervals
from insnav.imu.model import SAMPLED
from insnav.imu.specification import SENSORS, Sensor, noise_of, terms_of
from insnav.kernels.error_propagation import first_order
from insnav.sample_statistics import moving_variance
from insnav.simulate.truth import Truth, gps_from_truth
from insnav.types import BoolArray, FloatArray, GpsData, ImuData

_FLICKER_RATIO = 3.0  # ratio of successive correlation times of the flicker processes
_VIBRATION_WINDOW = 0.5  # window for the variance of the specific force [s]

Seed = int | tuple[int, ...]
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RandomSpells:
    """Random periods, such as outages: exponentially distributed intervals and lengths."""

    every: float  # mean time from the end of a period to the next [s]; 0: no periods
    length: float  # mean length of a period [s]

    def between(self, start: float, end: float, rng: np.random.Generator) -> list[tuple[float, float]]:
        """Sample begin and end of each period that begins between two times [s]."""
        spells: list[tuple[float, float]] = []
        while self.every > 0.0:
            begin = (spells[-1][1] if spells else start) + self.every * float(rng.exponential())
            spells.append((begin, begin + self.length * float(rng.exponential())))
            if begin >= end:
                return spells[:-1]
        return spells


def within(time: FloatArray, spells: Iterable[tuple[float, float]]) -> BoolArray:
    """Return whether each of the times ``(n,)`` [s] is within a period, given as begin and end [s]."""
    inside = np.zeros(len(time), dtype=np.bool_)
    for begin, end in spells:
        inside |= (time >= begin) & (time < end)
    return inside


@dataclass(frozen=True, slots=True)
class ImuSimulation:
    """Samples of a simulated IMU, with their errors."""

    imu: ImuData  # simulated samples, with errors
    errors: ImuErrors  # constant errors of the IMU: turn-on bias, scale factor, misalignment
    # (n, 3) total bias over time, turn-on and in-run [rad/s], [m/s^2]
    gyro_bias: FloatArray
    accel_bias: FloatArray


def corrupt_imu(imu: ImuData, spec: ImuSpec, seed: Seed, *, temperature: FloatArray | None = None) -> ImuSimulation:
    """Sample an IMU from a specification and simulate its measurements.

    Constant errors come first (`insnav.imu.corrupt`), then in-run bias, white noise, quantisation, range, rounding,
    timestamps. Every source has its own random stream: enabling one does not change the others.

    `temperature` (n,): of the IMU at each sample [deg C].
    Raises: InputError: fewer than two samples, or temperature-dependent terms without temperature.
    """
    constant, *noises, clock = np.random.SeedSequence(seed).spawn(6)
    constants = np.random.default_rng(constant)
    errors = sample_errors(spec, constants)
    if temperature is not None:
        imu = replace(imu, temperature=np.asarray(temperature, dtype=np.float64))
    corrupted = corrupt(imu, errors)
    dt = sample_intervals(imu)[:, None]
    # An instantaneous sample has the noise of a mean, since the sensor's bandwidth is about its sampling rate.
    span = dt if imu.sampling == "increment" else 1.0
    elapsed = (imu.time - imu.time[0])[:, None]
    rate, force = np.asarray(imu.gyro / span), np.asarray(imu.accel / span)
    measured, drifts = [], []
    for name, noise_seed, flicker_seed in zip(SENSORS, noises[:2], noises[2:], strict=True):
        sensor: SensorSpec = getattr(spec, name)
        drift, noise = drift_and_noise(imu.time, dt, sensor, np.random.default_rng(noise_seed))
        flickering = flicker(flicker_seed, imu.time, noise_of(sensor, "flicker"))
        drift += further_errors(name, sensor, rate, force, elapsed, constants) + flickering
        if np.any(sensor.vibration_rectification):
            width = max(3, round(_VIBRATION_WINDOW / float(np.median(dt))))
            drift += sensor.vibration_rectification * moving_variance(force, width)
        measured.append(quantised(getattr(corrupted, name) + (drift + noise) * span, sensor, dt, span))
        drifts.append(drift)
    corrupted = replace(corrupted, gyro=measured[0], accel=measured[1])
    gyro_bias, accel_bias = errors.gyro_bias + drifts[0], errors.accel_bias + drifts[1]
    if spec.clock == ClockSpec():
        return ImuSimulation(corrupted, errors, gyro_bias, accel_bias)
    imu, kept_rows = timestamped(corrupted, spec.clock, np.random.default_rng(clock))
    return ImuSimulation(imu, errors, gyro_bias[kept_rows], accel_bias[kept_rows])


def further_errors(
    sensor: Sensor, size: SensorSpec, rate: FloatArray, force: FloatArray, since: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Compute constant or linearly growing errors of the budget that `sample_errors` omits, ``(n, 3)``.

    rate, force (n, 3): sensed [rad/s], [m/s^2]. since (n, 1): time since the start [s].
    """
    total = np.zeros(rate.shape)
    for term in terms_of(sensor):
        sizes = getattr(size, term.key)
        # a ramp of size zero also uses its random numbers, so that the other errors keep theirs
        needed = term.process == "ramp" or (term.process == "constant" and np.any(sizes))
        if term.drive is None or term.key in SAMPLED or not needed:
            continue
        signal = term.drive(rate, force, since)
        for (axis, driving), number in zip(term.elements, rng.standard_normal(len(term.elements)), strict=True):
            total[:, axis] += signal[:, driving] * (number * sizes[axis])
    return total


def quantised(values: FloatArray, sensor: SensorSpec, dt: FloatArray, span: FloatArray | float) -> FloatArray:
    """Apply quantisation of the integral, range and resolution to samples ``(n, 3)``.

    `dt` ``(n, 1)``: intervals [s]. `span`: factor from a rate to a sample: the intervals for increments, else 1.
    """
    step = math.sqrt(12.0) * noise_of(sensor, "quantisation")
    if np.any(step):
        # round the integral to whole counts: the remainder of a sample carries over to the next sample
        per_sample = dt / span
        total = np.cumsum(values * per_sample, axis=0)
        counted = np.where(step > 0.0, np.round(total / np.where(step > 0.0, step, 1.0)) * step, total)
        values = np.asarray(np.diff(counted, axis=0, prepend=np.zeros((1, 3))) / per_sample)
    if np.any(sensor.range):
        limit = np.where(sensor.range > 0.0, sensor.range, np.inf)
        values = np.asarray(np.clip(values / span, -limit, limit) * span)
    if np.any(sensor.resolution):
        fine = np.where(sensor.resolution > 0.0, sensor.resolution, 1.0)
        values = np.where(sensor.resolution > 0.0, np.round(values / span / fine) * fine * span, values)
    return values


def flicker(seed: np.random.SeedSequence, time: FloatArray, size: FloatArray) -> FloatArray:
    """Simulate flicker noise ``(n, 3)`` as a sum of Gauss-Markov processes with graded correlation times.

    `time` (n,): times [s], taken as evenly spaced. `size` (3,): coefficient B of IEEE Std 952-1997, annex C:
    two-sided density ``B^2 / (2 pi f)``.

    Notes
    -----
    Processes of variance v with correlation times in a ratio r have together a two-sided density ``v / (2 f ln r)``
    between the inverse longest and shortest times (the integral of Lorentzians over the logarithm of the time; van der
    Ziel, Physica 16 (1950) 359-372). Therefore ``v = B^2 ln(r) / pi``.
    """
    if not np.any(size):
        return np.zeros((len(time), 3))
    rng = np.random.default_rng(seed)
    share, correlation_times = flicker_processes((time[-1] - time[0]) / (len(time) - 1), time[-1] - time[0])
    total = np.zeros((len(time), 3))
    for correlation_time in correlation_times:
        total += gauss_markov(rng, time, size * share, correlation_time)
    return total


def flicker_processes(spacing: float, length: float) -> tuple[float, list[float]]:
    """Return the sd of each process of `flicker`, relative to the coefficient B, and the correlation times [s].

    `spacing`: sampling interval [s]. `length`: time from the first to the last sample [s].
    """
    correlation_times = []
    correlation_time = 0.3 * spacing  # shortest; the longest is about ten record lengths
    while correlation_time < 10.0 * length:
        correlation_times.append(correlation_time)
        correlation_time *= _FLICKER_RATIO
    return math.sqrt(math.log(_FLICKER_RATIO) / math.pi), correlation_times


def timestamped(imu: ImuData, clock: ClockSpec, rng: np.random.Generator) -> tuple[ImuData, BoolArray]:
    """Apply clock errors to the sample times, and drop lost samples; also return which rows are kept, ``(n,)``.

    Jitter is limited to 0.4 of an interval, to keep the samples in order.
    """
    spacing = float(np.median(np.diff(imu.time)))
    jitter = np.clip(clock.jitter * rng.standard_normal(len(imu.time)), -0.4 * spacing, 0.4 * spacing)
    time = imu.time + clock.offset + clock.drift * (imu.time - imu.time[0]) + jitter
    lost_periods = RandomSpells(clock.lost_every, clock.lost_length).between(imu.time[0], imu.time[-1], rng)
    kept_rows = ~within(imu.time, lost_periods)
    return replace(imu, time=time).rows(kept_rows), kept_rows


def drift_and_noise(
    time: FloatArray, dt: FloatArray, sensor: SensorSpec, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Simulate in-run bias, and white noise averaged over each interval `dt` [s]: both ``(n, 3)``, in the bias unit.

    The number of random values does not depend on the sizes of the errors.
    """
    noise = rng.standard_normal((len(time), 3)) * (noise_of(sensor, "white") / np.sqrt(dt))
    drift = gauss_markov(rng, time, noise_of(sensor, "Gauss-Markov"), sensor.correlation_time)
    steps = noise_of(sensor, "random walk") * np.sqrt(dt)
    drift += np.cumsum(rng.standard_normal((len(time), 3)) * steps, axis=0)
    return drift, noise


def gauss_markov(rng: np.random.Generator, time: FloatArray, sd: FloatArray, correlation_time: float) -> FloatArray:
    """Simulate a stationary first-order Gauss-Markov process on three axes, ``(n, 3)``.

    ``x_k = a x_(k-1) + sd sqrt(1 - a^2) w_k`` with ``a = exp(-dt / T)`` (Maybeck, Stochastic Models, Estimation, and
    Control, vol. 1, 1979, section 4.11). Times ``(n,)`` count as evenly spaced at their mean interval. `sd` ``(3,)``
    applies at every instant. An infinite correlation time [s] gives a constant.
    """
    ratio = (time[-1] - time[0]) / max(1, len(time) - 1) / correlation_time
    decay = math.exp(-ratio)
    drive = rng.standard_normal((len(time), 3)) * sd
    drive[1:] *= math.sqrt(-math.expm1(-2.0 * ratio))  # the first value keeps the stationary sd
    process: FloatArray = first_order(drive, decay)
    return process


@dataclass(frozen=True, slots=True)
class GpsErrors:
    """Sizes of the errors of fixes."""

    position_noise: Triple  # standard deviation of the white error North, East, Down [m]
    # standard deviation of the time-correlated (first-order Gauss-Markov) error North, East, Down [m]
    position_drift: Triple = (0.0, 0.0, 0.0)
    correlation_time: float = 60.0  # correlation time of this error [s]
    velocity_noise: Triple = (0.1, 0.1, 0.1)  # standard deviation of the white velocity error [m/s]

    @property
    def position_sd(self) -> FloatArray:
        """Standard deviation of the total position error North, East, Down ``(3,)`` [m]."""
        return np.hypot(self.position_noise, self.position_drift)


@dataclass(frozen=True, slots=True)
class GpsSpec:
    """Receiver specification with its antenna position."""

    name: str
    errors: GpsErrors  # errors of the fixes
    rate: float = 1.0  # fixes per second [Hz]
    lever_b: Triple = (0.0, 0.0, 0.0)  # antenna position relative to the IMU, body axes [m]
    velocities: bool = True  # whether the receiver reports velocities
    # delay of the timestamp of a fix: mean, and its standard deviation [s]
    latency: float = 0.0
    jitter: float = 0.0
    fix: int = 5  # reported fix type (1 fixed, 2 float, 4 DGPS, 5 single)
    # position jumps, and their unreported standard deviation on each axis [m]
    multipath: RandomSpells | None = None
    multipath_size: float = 0.0
    # periods of a worse fix type (an RTK float solution), type 2, and their reported white error on each axis [m]
    degraded: RandomSpells | None = None
    degraded_noise: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()  # start after the start of the motion, and length of outages [s]
    # period of regular outages, and length of the outage at the end of each period [s]
    outage_period: tuple[float, float] | None = None
    outage: RandomSpells | None = None  # outages at random times
    stated: float = 1.0  # ratio of reported to true standard deviations
    source: str = ""  # source of the figures


def measure_gps(truth: Truth, spec: GpsSpec, seed: Seed) -> GpsData:
    """Simulate the fixes of a receiver for a motion, with their reported values.

    The same seed gives the same fixes. Every error type has its own random stream: enabling one does not change the
    others.

    Raises: ConfigError: the motion ends before the first fix.
    """
    outage_seed, multipath_seed, degraded_seed, delay_seed, noise_seed = np.random.SeedSequence(seed).spawn(5)
    count = int(np.floor(truth.duration * spec.rate * (1.0 + 1e-12)))
    # timestamps begin one interval after the start: none precedes the first measured instant
    time: FloatArray = truth.start + np.arange(1.0, count + 1.0) / spec.rate
    late = spec.latency + spec.jitter * np.random.default_rng(delay_seed).standard_normal(count)
    valid = np.sort(time - late)  # sorted, as jitter may exceed the interval between fixes
    span = truth.start, truth.start + truth.duration
    inside = (valid >= span[0]) & (valid <= span[1])
    inside &= ~_outages(spec, time, truth, np.random.default_rng(outage_seed))
    if not inside.any():
        raise ConfigError("sim.no_fix", where="gps", duration_s=truth.duration, rate_hz=spec.rate)
    # simulate fixes during outages, too, so that time-correlated errors continue; drop them at the end
    gps = gps_from_truth(truth, np.clip(valid, *span), np.asarray(spec.lever_b))
    gps = corrupt_gps(replace(gps, time=time), spec.errors, noise_seed.generate_state(4).tolist())
    position_sd = gps.position_sd.copy()
    error = np.zeros_like(gps.lla)
    fix = np.full(len(time), spec.fix, dtype=np.int64)
    if spec.multipath is not None:
        rng = np.random.default_rng(multipath_seed)
        for begin, end in spec.multipath.between(*span, rng):
            error[(time >= begin) & (time < end)] += spec.multipath_size * rng.standard_normal(3)
    if spec.degraded is not None:
        rng = np.random.default_rng(degraded_seed)
        worse = within(time, spec.degraded.between(*span, rng))
        error[worse] += spec.degraded_noise * rng.standard_normal((int(worse.sum()), 3))
        position_sd[worse] = np.hypot(position_sd[worse], spec.degraded_noise)
        fix[worse] = 2
    unknown = np.full_like(gps.v_n, np.nan)
    measured = replace(
        gps,
        lla=lla_offset(gps.lla, error),
        v_n=gps.v_n if spec.velocities else unknown,
        position_sd=spec.stated * position_sd,
        velocity_sd=spec.stated * gps.velocity_sd if spec.velocities else unknown.copy(),
        fix=fix,
    )
    return measured.rows(inside)


def _outages(spec: GpsSpec, time: FloatArray, truth: Truth, rng: np.random.Generator) -> BoolArray:
    """Return which fixes are within an outage, ``(n,)``."""
    elapsed = time - truth.start
    in_outage = within(elapsed, [(begin, begin + length) for begin, length in spec.outages])
    if spec.outage_period is not None:
        period, length = spec.outage_period
        in_outage |= elapsed % period >= period - length
    if spec.outage is not None:
        in_outage |= within(time, spec.outage.between(truth.start, truth.start + truth.duration, rng))
    return in_outage


def corrupt_gps(gps: GpsData, errors: GpsErrors, seed: Seed) -> GpsData:
    """Add random errors to error-free fixes, and set the true standard deviations of these errors.

    Raises: ConfigError: a standard deviation not above zero, which no receiver has and no filter accepts.
    """
    velocity_sd = np.asarray(errors.velocity_noise, dtype=np.float64)
    sizes = np.concatenate([errors.position_sd, velocity_sd, [errors.correlation_time]])
    if not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
        values: dict[str, Any] = {"position_sd_m": tuple(errors.position_sd.tolist())}
        values |= {"velocity_sd_m_s": tuple(velocity_sd.tolist()), "correlation_time_s": errors.correlation_time}
        raise ConfigError("sim.receiver_sizes", where="gps", **values)
    rng = np.random.default_rng(seed)
    shape = gps.lla.shape
    error_n = rng.standard_normal(shape) * errors.position_noise
    error_n += gauss_markov(rng, gps.time, np.array(errors.position_drift), errors.correlation_time)
    return replace(
        gps,
        lla=lla_offset(gps.lla, error_n),
        v_n=gps.v_n + rng.standard_normal(shape) * velocity_sd,
        position_sd=np.tile(errors.position_sd, (shape[0], 1)),
        velocity_sd=np.tile(velocity_sd, (shape[0], 1)),
    )


def without_fixes(gps: GpsData, begin: float, end: float) -> GpsData:
    """Remove the fixes of an outage, at ``begin < time <= end`` [s]."""
    return gps.rows(~((gps.time > begin) & (gps.time <= end)))
