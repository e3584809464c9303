"""Likelihood of the innovations of one drive as a function of the noise of IMU and fixes.

The filter runs once with a preset. Covariance algebra at the fixes alone then gives the likelihood under any other
noise parameters (`insnav.kernels.noise_likelihood`). Priors describe IMUs of this grade and receivers.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from insnav.attitude import rph_by_turn
from insnav.exceptions import DivergenceError
from insnav.filter.error_model import error_model, first_state, layout
from insnav.filter.filter_input import FilterInput
from insnav.filter.gps_noise import ALIKE, LARGEST_SHARE, OPEN_SD, CorrelatedNoise
from insnav.filter.navigator import Navigator
from insnav.filter.noise_estimate import NoiseEstimate, errors_of_axes, informed, start_by
from insnav.imu.noise_density import SLOW, white_noise
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.kernels import noise_likelihood as kernel
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.smoother import COAST, FIX, NOISE, RESTART, SOURCE, TIME
from insnav.types import FloatArray, GpsData

LONGEST = 1800.0  # part of the record that is used [s]
SPACING = 0.9  # least mean time between the fixes that are used [s]
HUBER = 3.0  # innovations beyond so many standard deviations are de-weighted, to limit false fixes
# remaining variance of clean innovations: 1 - 2 Q(3), the expectation of psi(u) u for standard normal u
CLEAN = 0.9973
FAR_OFF, FAR_OFF_SHARE = np.deg2rad(5.0), 0.1  # attitude error whose square matters [rad], in this share of a drive [-]
SETTLING = 4  # attitude settles in the first of so many equal parts of a drive, after a long initial stop [-]
SENSELESS = 1e6  # implausibly large innovation by misalignment [m], [m/s]
# Upper limits, unless the preset is larger. Consumer sensors have scale factors up to 0.03, biases up to 3 deg/s and
# 0.5 m/s^2. Larger values would explain noise or faults by themselves.
LARGEST = {
    "scale_factor": {"gyro": 0.05, "accel": 0.05},
    "misalignment": {"gyro": 0.1, "accel": 0.1},
    "bias": {"gyro": 0.1, "accel": 1.0},
    "bias_instability": {"gyro": 0.02, "accel": 0.3},
}

# sd of the logarithm of IMU parameters about the nearest grade. Datasheets of one grade differ by factors of two to
# three in noise, and of ten in in-run bias
IMU_PRIOR = {"random_walk": 0.8} | dict.fromkeys(("bias_instability", "bias", "scale_factor", "misalignment"), 1.5)
# sd for gyro white noise if a stationary period of this length [s] measured it below the fix rate; motion adds to it.
# At higher frequencies, which selected the preset, an idling engine may dominate.
REST, REST_PRIOR = 60.0, (0.5, 0.3)
# sd of the position sd's logarithm, upwards and downwards. Innovations give no lower value: errors that hardly change
# between fixes leave no trace. Small innovations mean time correlation.
POSITION_PRIOR = (0.6, 0.03)
LEVELS = "gps.horizontal", "gps.vertical"
VELOCITY_PRIOR = 0.6
# Log odds of the time-correlated share of position variance, and their sd by Jeffreys' prior of a proportion, which is
# the beta distribution (1/2, 1/2). H. Jeffreys, Proc. R. Soc. Lond. A 186 (1946) 453-461. The share is never zero:
# neglected, the 9 % that seven minutes do not show double the smoothed errors.
SHARE = (0.0, np.pi)
CORRELATION_TIME = (float(np.log(45.0)), 1.0)  # logarithm of its correlation time [s], and its sd
# Largest share of close fixes, and interval beyond which it is `LARGEST_SHARE` [s]. The white part of such fixes also
# contains IMU model errors in turns, which grow with the squared interval.
ALL, FAR_APART = 1.0 - 1e-6, 0.5
# Velocities may also have a time-correlated error, observable by their integral against positions. Logarithms of its sd
# relative to the velocity sd, of its correlation time [s], and their sd. Correlation over seconds is receiver
# smoothing.
VELOCITY_CORRELATED = {
    "velocity_correlated": (float(np.log(0.3)), 1.0),
    "velocity_correlation_time": (float(np.log(100.0)), 0.3),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter, as a logarithm: the middle of its prior, and the sd above and below it.

    A share, as log odds, is a share of `most`.
    """

    key: str
    middle: float
    sd: float
    sd_below: float
    most: float = 1.0


class InnovationLikelihood:
    """Innovations of one drive as a function of the noise. `about`: noise of the run about which they are linear."""

    def __init__(self, ready: FilterInput, spec: ImuSpec, about: NoiseEstimate | None = None) -> None:
        ready = ready.longest_part()
        run = ready if about is None else ready.apply_noise(about)
        gps = thinned(ready.gps)
        self.median_sd: FloatArray = np.median(gps.position_sd, axis=0)
        correlated = run.receiver.correlated
        if correlated is None:  # the nominal run needs the states at any size
            correlated = CorrelatedNoise.of_fixes(0.1, 40.0, gps.position_sd)
        correlated = replace(correlated, velocity_sd=None)
        self._ready, self._run, self.prior = ready, run, spec
        self._receiver = replace(ready.receiver, correlated=correlated)
        self._states = ready.model.states
        navigator = Navigator(replace(run.keep_history(), gps=thinned(run.gps), receiver=self._receiver))
        imu = ready.first(LONGEST)
        navigator.feed(imu)
        rows = navigator.history().rows()
        time = rows[:, TIME]
        at = layout(self._receiver)
        self._lasting = at.correlated
        self._tape = kernel.tape(rows, at.states, run.model.noise, bridged(imu.time, time), run.rounding)
        self._offered = rows[:, SOURCE] == FIX
        self.reset = bool((self._tape[1] == RESTART).any())  # to fixes
        h, jitter = self._tape[7], ready.receiver.jitter
        # fixes: timestamp jitter times speed and acceleration, the negative of the delay column; other aiding: its
        # noise
        measured = rows[:, SOURCE, None] != 0.0
        self._other = np.where(measured, rows[:, NOISE : NOISE + 36 : 7], 0.0)
        self._other[self._offered] = (jitter * h[self._offered][:, :, STATES]) ** 2
        self._given = gps.time - ready.receiver.delay.value
        fix = np.searchsorted(self._given, time - 1e-4)
        fix = np.minimum(fix, gps.time.shape[0] - 1)
        self._sd = np.nan_to_num(np.hstack([gps.position_sd[fix], gps.velocity_sd[fix]]), nan=1.0)
        self._axes, self._c = errors_of_axes(rows, self._tape[2], imu, ready.nominal)
        moving = np.isfinite(gps.v_n).all(axis=1)
        unknown = np.full(3, OPEN_SD)
        self.velocity_sd: FloatArray = np.median(gps.velocity_sd[moving], axis=0) if moving.any() else unknown
        self.fixes = int(np.count_nonzero(self._offered & (self._tape[1] > 0)))
        self.offered = int(np.count_nonzero((gps.time > imu.time[0]) & (gps.time < imu.time[-1])))
        self.parameters = self._choose()

    def again(self, noise: NoiseEstimate) -> InnovationLikelihood:
        """Repeat about another run, with the estimated noise."""
        return InnovationLikelihood(self._ready, self.prior, noise)

    def doubted(self, noise: NoiseEstimate) -> InnovationLikelihood:
        """Copy for over-confident fixes, with the prior of position sds centred on `noise` times its white excess."""
        part, larger = copy(self), np.clip(noise.white, 1.0, ALIKE)
        middle = dict(zip(LEVELS, np.log(noise.position_factor[1:] * larger), strict=True))
        part.parameters = tuple(replace(p, middle=float(middle.get(p.key, p.middle))) for p in self.parameters)
        return part

    def of(self, kind: ImuSpec) -> InnovationLikelihood:
        """Copy with another IMU prior."""
        other, of_imu = copy(self), sum(not p.key.startswith("gps.") for p in self.parameters)
        other.prior = kind
        other.parameters = (*other._choose()[:of_imu], *self.parameters[of_imu:])
        return other

    def beginning(self, length: float) -> InnovationLikelihood:
        """Copy with the innovations of the first `length` seconds only."""
        part = copy(self)
        last = int(np.searchsorted(np.cumsum(self._tape[0]), length))
        part._tape = tuple(each[:last] for each in self._tape)
        part._other, part._offered, part._sd, part._c = (
            each[:last] for each in (self._other, self._offered, self._sd, self._c)
        )
        return part

    def of_fixes(self, *, positions: bool, velocities: bool) -> InnovationLikelihood:
        """Copy with the time-correlated share of position errors and its time, and the sds that are chosen."""
        same, some = copy(self), LEVELS * positions + ("gps.velocity", "gps.vertical_velocity") * velocities
        same.parameters = (*(p for p in self.parameters if p.key in some), *self.parameters[-2:])
        return same

    def with_correlated_velocities(self) -> InnovationLikelihood:
        """Copy with time-correlated velocity errors: three more states, zero in the nominal run."""
        wider, at, tape = copy(self), self._lasting + 3, list(self._tape)
        tape[7], tape[8] = (np.insert(each, [at] * 3, 0.0, axis=-1) for each in self._tape[7:9])
        tape[7][:, range(3, 6), range(at, at + 3)] = self._offered[:, None]
        wider._tape = tuple(tape)
        more = (Parameter(f"gps.{key}", middle, sd, sd) for key, (middle, sd) in VELOCITY_CORRELATED.items())
        wider.parameters = (*self.parameters[:-2], *more, *self.parameters[-2:])
        return wider

    def _choose(self) -> tuple[Parameter, ...]:
        static, at_rest, of_prior = self._ready.alignment.static, {}, self.prior.gyro.random_walk
        if static is not None and static[1] - static[0] >= REST and of_prior.any():
            seen = white_noise(self._ready.imu, *static, SLOW)[0]
            middle = 0.5 * float(np.log(np.mean(seen**2) / np.mean(of_prior**2)))
            at_rest["gyro.random_walk"] = Parameter("gyro.random_walk", middle, *REST_PRIOR)
        found = [
            at_rest.get(f"{name}.{key}", Parameter(f"{name}.{key}", 0.0, sd, sd))
            for name, sensor in (("gyro", self.prior.gyro), ("accel", self.prior.accel))
            for key, sd in IMU_PRIOR.items()
            if np.any(getattr(sensor, key) > 0.0) and not (self._states == 15 and key == "scale_factor")
        ]
        found += [Parameter(name, 0.0, *POSITION_PRIOR) for name in LEVELS]
        for axis, name in ((0, "velocity"), (2, "vertical_velocity")):
            if self.velocity_sd[axis] < OPEN_SD:
                found.append(Parameter(f"gps.{name}", 0.0, VELOCITY_PRIOR, VELOCITY_PRIOR))
        near = float(np.quantile(np.diff(self._given), 0.25))  # fixes are used in pairs
        most = LARGEST_SHARE if near > FAR_APART else ALL
        found.append(Parameter("gps.share", *SHARE, SHARE[1], most))
        return (*found, Parameter("gps.correlation_time", *CORRELATION_TIME, CORRELATION_TIME[1]))

    def spec(self, at: FloatArray) -> ImuSpec:
        """Return the IMU specification of a parameter set."""
        factor = {p.key: float(np.exp(x)) for p, x in zip(self.parameters, at, strict=True)}

        def scaled(sensor: SensorSpec, name: str) -> SensorSpec:
            found = {key: getattr(sensor, key) * factor.get(f"{name}.{key}", 1.0) for key in IMU_PRIOR}
            most = {key: np.maximum(getattr(sensor, key), largest[name]) for key, largest in LARGEST.items()}
            return replace(sensor, **found | {key: np.minimum(found[key], each) for key, each in most.items()})

        return replace(self.prior, gyro=scaled(self.prior.gyro, "gyro"), accel=scaled(self.prior.accel, "accel"))

    def fixes_of(self, at: FloatArray) -> tuple[FloatArray, FloatArray, CorrelatedNoise]:
        """Return factors on position and velocity sd, and time-correlated errors, by values `at` of `parameters`."""
        value = {p.key: float(x) for p, x in zip(self.parameters, at, strict=True)}
        level, down = (np.exp(value.get(key, 0.0)) for key in LEVELS)
        share = self.parameters[-2].most / (1.0 + np.exp(-value["gps.share"]))
        velocity = np.exp([value.get(f"gps.{name}", 0.0) for name in ("velocity", "velocity", "vertical_velocity")])
        position, time = np.array([level, level, down]), float(np.exp(value["gps.correlation_time"]))
        correlated = CorrelatedNoise(float(share), time, np.sqrt(share) * position * self.median_sd)
        if "gps.velocity_correlated" in value:
            size, time = (float(np.exp(value[f"gps.{key}"])) for key in VELOCITY_CORRELATED)
            measured = np.where(self.velocity_sd < OPEN_SD, self.velocity_sd, 0.0)
            correlated = replace(correlated, velocity_sd=size * measured, velocity_time=time)
        return position, velocity, correlated

    def normalised(self, at: FloatArray, push: FloatArray | None = None) -> FloatArray:
        """Compute innovations and variances with some parameters, and derivatives by `push` (`kernel.innovations`)."""
        push = np.zeros((1, self._offered.size, NAV)) if push is None else push
        out = np.empty((1 + push.shape[0], 6 * self._offered.size))
        model = error_model(self.spec(at), self._states)
        position, velocity, correlated = self.fixes_of(at)
        start = first_state(
            start_by(self._ready.initial, self._ready.alignment, model, position),
            replace(self._receiver, correlated=correlated),
        )
        mean = np.zeros(start.covariance.shape[0])
        mean[NAV : NAV + 3] = self._run.initial.gyro_bias - start.correction[:3]
        factor = np.concatenate([np.sqrt(1.0 - correlated.share) * position, velocity])
        factor = np.where(self._sd < OPEN_SD, factor, 1.0)  # unmeasured values carry no information on it
        variance = self._other + self._offered[:, None] * (factor * self._sd) ** 2
        count = kernel.innovations(
            self._tape,
            np.array([np.mean(model.noise[:3]), np.mean(model.noise[3:6]), *model.noise[18:]]),
            model.noise[6:18],
            model.decay,
            self._lasting,
            correlated.sds,
            correlated.times,
            variance,
            (mean, start.covariance),
            push,
            HUBER,
            out,
        )
        return out[:, :count]

    def by_axes(self, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
        """Compute curvature (12, 12) and slope (12,) of the log-likelihood by misalignments [rad], and their effect.

        The effect is the error of roll, pitch and heading by each (12, k, 3) [-]. The last value is whether large
        attitude errors of the run make the innovations nonlinear in them. Only the settled filter counts: with a
        heading error of degrees, its products with tilts are as large as misalignments. A long stationary period does
        not count, either: misalignments have no effect there.
        """
        push = np.insert(self._axes, 0, 0.0, axis=0)
        rest = np.flatnonzero(kernel.held(self._tape[2]) & (self._tape[0] > 0.0)).max(initial=-1) + 1
        settled = slice(int(rest + (self._offered.size - rest) // SETTLING), None)
        e, s, *by = self.normalised(at, push)
        turned = rph_by_turn(self._c[settled], -push[1:, settled, 6:])
        kind = self._tape[1][: settled.start]
        late = slice(int(np.bitwise_count(kind[kind > COAST]).sum()), None)
        far_off = float(np.mean(np.abs(push[0, :, 6:]).max(axis=1) > FAR_OFF)) > FAR_OFF_SHARE
        of_terms = np.array(by)[:, late]
        if not float(np.abs(of_terms).max(initial=0.0)) * self.misalignment_sd.max() < SENSELESS:
            raise DivergenceError("filter.misalignment_unbounded")
        found = informed(e[late], of_terms, weights_of(e[late], s[late]), self.misalignment_sd)
        return *found, turned, far_off

    @property
    def misalignment_sd(self) -> FloatArray:
        """Prior standard deviations of the twelve misalignments [rad]."""
        return np.concatenate([np.repeat(sensor.misalignment, 2) for sensor in (self.prior.gyro, self.prior.accel)])

    def bias_seen(self, at: FloatArray) -> float:
        """Compute the negative log-likelihood of the gyro bias that the alignment measured."""
        known = self._ready.alignment.gyro_bias_sd
        seen = np.isfinite(known)
        gyro = self.spec(at).gyro
        variance = (gyro.bias**2 + gyro.bias_instability**2 + known**2)[seen]
        return 0.5 * float(np.sum(np.log(variance) + self._ready.alignment.gyro_bias[seen] ** 2 / variance))


def cost_of(innovation: FloatArray, variance: FloatArray) -> float:
    """Compute a robust negative log-likelihood of innovations: beyond three sd it grows linearly.

    `innovation`, `variance` (k,): innovations and their variances.
    """
    if not (variance > 0.0).all():  # rounding with far too large model errors
        return np.inf
    return float(np.sum(costs_of(innovation, variance)))


def costs_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """Compute the cost of each innovation (k,); see `cost_of`."""
    u = np.abs(innovation) / np.sqrt(variance)
    square = np.where(u <= HUBER, 0.5 * u * u, HUBER * u - 0.5 * HUBER**2)
    return np.asarray(square + 0.5 * CLEAN * np.log(variance))


def weights_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """Compute the curvature of `costs_of` by each innovation (k,), for iteratively reweighted least squares."""
    variance = np.where(variance > 0.0, variance, np.inf)  # see `cost_of`
    return np.asarray(1.0 / (variance * np.maximum(np.abs(innovation) / np.sqrt(variance) / HUBER, 1.0)))


def bridged(samples: FloatArray, epochs: FloatArray) -> FloatArray:
    """Find the epochs that follow a data gap of the samples."""
    step = np.diff(samples)
    gap = samples[1:][step > 2.5 * np.median(step)]
    count = np.searchsorted(gap, epochs + 0.5)
    return np.asarray(np.diff(count, prepend=0) > 0)


def thinned(gps: GpsData) -> GpsData:
    """Thin fixes to pairs of neighbours, with twice `SPACING` between pairs.

    Different intervals are needed to separate the white noise of the fixes from IMU noise.
    """
    keep, begin, single = [], -np.inf, False
    for row, time in enumerate(gps.time.tolist()):
        if (single or time - begin >= 2.0 * SPACING - 1e-6) and (gps.fix is None or gps.fix[row] != 0):
            begin, single = (begin, False) if single else (time, True)
            keep.append(row)
    return gps.rows(np.array(keep, dtype=int))
