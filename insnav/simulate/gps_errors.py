"""Errors of satellite receivers: white and time-correlated noise, multipath, outages, latency, float solutions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.earth import lla_offset
from insnav.exceptions import ConfigError
from insnav.simulate.ideal_sensors import gps_from_truth
from insnav.simulate.imu_errors import RandomSpells, Seed, gauss_markov, within
from insnav.simulate.truth import Truth
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
        """Standard deviation of the whole position error North, East, Down ``(3,)`` [m]."""
        return np.hypot(self.position_noise, self.position_drift)


@dataclass(frozen=True, slots=True)
class GpsSpec:
    """How good a receiver is and where its antenna sits."""

    name: str
    errors: GpsErrors  # errors of its fixes
    rate: float = 1.0  # [Hz]
    lever_b: Triple = (0.0, 0.0, 0.0)  # antenna seen from the IMU, body axes [m]
    velocities: bool = True  # whether it gives velocities
    # how much later than valid the timestamp of a fix is: on average, and its standard deviation [s]
    latency: float = 0.0
    jitter: float = 0.0
    fix: int = 5  # fix type it reports (1 fixed, 2 float, 4 DGPS, 5 single)
    # jumps of the position, and their standard deviation on each axis [m], which is not reported
    multipath: RandomSpells | None = None
    multipath_size: float = 0.0
    # times of a worse kind of fix (an RTK float solution), type 2, and their white error on each axis [m], reported
    degraded: RandomSpells | None = None
    degraded_noise: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()  # begin, since the start of the motion, and length of outages [s]
    # period of regular outages, and the length of each, at the end of the period [s]
    outage_period: tuple[float, float] | None = None
    outage: RandomSpells | None = None  # random outages
    stated: float = 1.0  # reported standard deviations over the true ones
    source: str = ""  # where the figures come from


def measure_gps(truth: Truth, spec: GpsSpec, seed: Seed) -> GpsData:
    """Fixes of a receiver that measures a motion, with what it reports of them.

    The same seed gives the same fixes; every kind of error has a stream of its own, so that none changes when another
    one is switched on.

    Raises: ConfigError: a motion that is over before the first fix.
    """
    kept, jumps, floats, times, white = np.random.SeedSequence(seed).spawn(5)
    count = int(np.floor(truth.duration * spec.rate * (1.0 + 1e-12)))
    # a timestamp is never earlier than the first instant that can be measured
    time: FloatArray = truth.start + np.arange(1.0, count + 1.0) / spec.rate
    late = spec.latency + spec.jitter * np.random.default_rng(times).standard_normal(count)
    valid = np.sort(time - late)  # jitter may be longer than the time between fixes
    span = truth.start, truth.start + truth.duration
    inside = (valid >= span[0]) & (valid <= span[1])
    inside &= ~_outages(spec, time, truth, np.random.default_rng(kept))
    if not inside.any():
        raise ConfigError("sim.no_fix", where="gps", duration_s=truth.duration, rate_hz=spec.rate)
    # errors go on while there are no fixes
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
    """Which fixes fall into an outage."""
    since = time - truth.start
    dark = within(since, [(begin, begin + length) for begin, length in spec.outages])
    if spec.outage_period is not None:
        period, length = spec.outage_period
        dark |= since % period >= period - length
    if spec.outage is not None:
        dark |= within(time, spec.outage.between(truth.start, truth.start + truth.duration, rng))
    return dark


def corrupt_gps(gps: GpsData, errors: GpsErrors, seed: Seed) -> GpsData:
    """Add errors, drawn with a seed, to error-free fixes, and standard deviations that are their true size.

    Raises: ConfigError: a standard deviation that is not above zero: no receiver is perfect, and no filter takes a
    zero.
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
    """Take out the fixes of an outage, at ``begin < time <= end`` [s]."""
    return gps.rows(~((gps.time > begin) & (gps.time <= end)))
