"""Errors of satellite receivers: white and time-correlated noise, multipath, outages, latency, float solutions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.earth import lla_offset
from insnav.exceptions import ConfigError
from insnav.simulate.imu_errors import RandomSpells, Seed, gauss_markov, within
from insnav.simulate.truth import Truth, gps_from_truth
from insnav.types import BoolArray, FloatArray, GpsData

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GpsErrors:
    """Sizes of the errors of fixes."""

    position_noise: Triple  # standard deviation of the white error North, East, Down [m]
    # standard deviation of the time-correlated (first-order Gauss-Markov) error North, East, Down [m]
    position_drift: Triple = (0.0, 0.0, 0.0)
    correlation_time: float = 60.0  # its correlation time [s]
    velocity_noise: Triple = (0.1, 0.1, 0.1)  # standard deviation of the white velocity error [m/s]

    @property
    def position_sd(self) -> FloatArray:
        """Standard deviation of the total position error North, East, Down ``(3,)`` [m]."""
        return np.hypot(self.position_noise, self.position_drift)


@dataclass(frozen=True, slots=True)
class GpsSpec:
    """Receiver specification with its antenna position."""

    name: str
    errors: GpsErrors  # errors of its fixes
    rate: float = 1.0  # [Hz]
    lever_b: Triple = (0.0, 0.0, 0.0)  # antenna seen from the IMU, body axes [m]
    velocities: bool = True  # the receiver gives velocities
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
    # period of regular outages, and the length of each, at the end of the period [s]
    outage_period: tuple[float, float] | None = None
    outage: RandomSpells | None = None  # random outages
    stated: float = 1.0  # ratio of reported to true standard deviations
    source: str = ""  # source of the figures


def measure_gps(truth: Truth, spec: GpsSpec, seed: Seed) -> GpsData:
    """Simulate the fixes of a receiver for a motion, with their reported values.

    The same seed gives the same fixes. Every error type has its own random stream: enabling one does not change the
    others.

    Raises: ConfigError: the motion ends before the first fix.
    """
    kept, jumps, floats, times, white = np.random.SeedSequence(seed).spawn(5)
    count = int(np.floor(truth.duration * spec.rate * (1.0 + 1e-12)))
    # no timestamp precedes the first measurable instant
    time: FloatArray = truth.start + np.arange(1.0, count + 1.0) / spec.rate
    late = spec.latency + spec.jitter * np.random.default_rng(times).standard_normal(count)
    valid = np.sort(time - late)  # jitter may exceed the interval between fixes
    span = truth.start, truth.start + truth.duration
    inside = (valid >= span[0]) & (valid <= span[1])
    inside &= ~_outages(spec, time, truth, np.random.default_rng(kept))
    if not inside.any():
        raise ConfigError("sim.no_fix", where="gps", duration_s=truth.duration, rate_hz=spec.rate)
    # errors continue without fixes
    gps = gps_from_truth(truth, np.clip(valid, *span), np.asarray(spec.lever_b))
    gps = corrupt_gps(replace(gps, time=time), spec.errors, white.generate_state(4).tolist())
    position_sd = gps.position_sd.copy()
    error = np.zeros_like(gps.lla)
    fix = np.full(len(time), spec.fix, dtype=np.int64)
    if spec.multipath is not None:
        rng = np.random.default_rng(jumps)
        for begin, end in spec.multipath.between(*span, rng):
            error[(time >= begin) & (time < end)] += spec.multipath_size * rng.standard_normal(3)
    if spec.degraded is not None:
        rng = np.random.default_rng(floats)
        worse = within(time, spec.degraded.between(*span, rng))
        error[worse] += spec.degraded_noise * rng.standard_normal((int(worse.sum()), 3))
        position_sd[worse] = np.hypot(position_sd[worse], spec.degraded_noise)
        fix[worse] = 2
    unknown = np.full_like(gps.v_n, np.nan)
    whole = replace(
        gps,
        lla=lla_offset(gps.lla, error),
        v_n=gps.v_n if spec.velocities else unknown,
        position_sd=spec.stated * position_sd,
        velocity_sd=spec.stated * gps.velocity_sd if spec.velocities else unknown.copy(),
        fix=fix,
    )
    return whole.rows(inside)


def _outages(spec: GpsSpec, time: FloatArray, truth: Truth, rng: np.random.Generator) -> BoolArray:
    """Find the fixes within an outage."""
    since = time - truth.start
    dark = within(since, [(begin, begin + length) for begin, length in spec.outages])
    if spec.outage_period is not None:
        period, length = spec.outage_period
        dark |= since % period >= period - length
    if spec.outage is not None:
        dark |= within(time, spec.outage.between(truth.start, truth.start + truth.duration, rng))
    return dark


def corrupt_gps(gps: GpsData, errors: GpsErrors, seed: Seed) -> GpsData:
    """Add random errors to error-free fixes, and their true standard deviations.

    Raises: ConfigError: a standard deviation not above zero, which no receiver has and no filter accepts.
    """
    velocity_sd = np.asarray(errors.velocity_noise, dtype=np.float64)
    sizes = np.concatenate([errors.position_sd, velocity_sd, [errors.correlation_time]])
    if not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
        raise ConfigError(
            "sim.receiver_sizes",
            where="gps",
            position_sd_m=tuple(errors.position_sd.tolist()),
            velocity_sd_m_s=tuple(velocity_sd.tolist()),
            correlation_time_s=errors.correlation_time,
        )
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
