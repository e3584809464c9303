"""Likelihood of the innovations of one drive as a function of the noise of IMU and fixes.

The filter runs once with preset noise. Covariance algebra at the fixes alone then gives the likelihood under any other
noise parameters (`insnav.kernels.noise_likelihood`). Priors describe the noise of IMUs of one grade, and of receivers.
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

LONGEST = 1800.0  # length of the part of the record that is used [s]
SPACING = 0.9  # least mean time between used fixes [s]
HUBER = 3.0  # innovations beyond this many sd are de-weighted, to limit the effect of false fixes
# variance that clean innovations keep with Huber's weights: E[psi(u) u] = 1 - 2 Q(3) for standard normal u
CLEAN = 0.9973
FAR_OFF, FAR_OFF_SHARE = np.deg2rad(5.0), 0.1  # attitude error with a relevant square [rad]; share of a drive with it
SETTLING = 4  # attitude settles in the first of this many equal parts of a drive after its initial stop
SENSELESS = 1e6  # implausibly large innovation by a misalignment: the computation has failed [m], [m/s]
# Upper limits of sensor errors, unless the preset is larger. Consumer sensors have scale factor errors up to 0.03, and
# biases up to 3 deg/s and 0.5 m/s^2. Larger values would absorb noise or faults.
LARGEST = {
    "scale_factor": {"gyro": 0.05, "accel": 0.05},
    "misalignment": {"gyro": 0.1, "accel": 0.1},
    "bias": {"gyro": 0.1, "accel": 1.0},
    "bias_instability": {"gyro": 0.02, "accel": 0.3},
}

# Prior sd of the logarithm of IMU parameters relative to the nearest grade. Datasheets of one grade differ by factors
# of two to three in noise, and of ten in in-run bias
IMU_PRIOR = {"random_walk": 0.8} | dict.fromkeys(("bias_instability", "bias", "scale_factor", "misalignment"), 1.5)
# Least length of a stationary period that measures gyro white noise below the fix rate [s]. Prior sd of its logarithm
# upwards (motion adds noise) and downwards. An idling engine may dominate the frequencies that selected the preset.
REST, REST_PRIOR = 60.0, (0.5, 0.3)
# Prior sd of the position sd's logarithm, upwards and downwards. Innovations do not show whether fixes are better than
# reported: errors that hardly change between fixes leave no trace. Small innovations mean time-correlated errors.
POSITION_PRIOR = (0.6, 0.03)
LEVELS = "gps.horizontal", "gps.vertical"
VELOCITY_PRIOR = 0.6
# Log odds of the time-correlated share of position variance, and their sd by Jeffreys' prior of a proportion, which is
# the beta distribution (1/2, 1/2). H. Jeffreys, Proc. R. Soc. Lond. A 186 (1946) 453-461. The share is never zero: a
# share of 9 %, not observable in seven minutes, doubles the smoothed errors if it is neglected.
SHARE = (0.0, np.pi)
CORRELATION_TIME = (float(np.log(45.0)), 1.0)  # logarithm of the correlation time [s] of these errors, and its sd
# Largest time-correlated share, and interval of fixes beyond which it is `LARGEST_SHARE` [s]. At longer intervals, the
# white part must also cover IMU model errors in turns, which grow with the squared interval.
ALL, FAR_APART = 1.0 - 1e-6, 0.5
# Velocities may also have a time-correlated error, observable by their integral against positions. Prior: logarithms of
# its sd relative to the velocity sd and of its correlation time [s], with sds. A few seconds are receiver smoothing.
VELOCITY_CORRELATED = {
    "velocity_correlated": (float(np.log(0.3)), 1.0),
    "velocity_correlation_time": (float(np.log(100.0)), 0.3),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """Logarithm of a noise parameter (log odds for a share), with its prior."""

    key: str  # dotted name, such as ``gyro.random_walk``
    middle: float  # centre of the prior
    sd: float  # prior sd above the centre, and below it
    sd_below: float
    most: float = 1.0  # largest value of a share, for which the odds are infinite [-]


class InnovationLikelihood:
    """Innovations of one drive as a function of the noise. `about`: noise of the nominal run, by default the preset."""

    def __init__(self, ready: FilterInput, spec: ImuSpec, about: NoiseEstimate | None = None) -> None:
        ready = ready.longest_part()
        run = ready if about is None else ready.apply_noise(about)
        gps = thinned(ready.gps)
        self.median_sd: FloatArray = np.median(gps.position_sd, axis=0)
        correlated = run.receiver.correlated
        if correlated is None:  # the nominal run needs the states, of any size
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
        index = layout(self._receiver)
        self._lasting = index.correlated
        self._tape = kernel.tape(rows, index.states, run.model.noise, bridged(imu.time, time), run.rounding)
        self._offered = rows[:, SOURCE] == FIX
        self.reset = bool((self._tape[1] == RESTART).any())  # the run was reset to fixes
        h, jitter = self._tape[7], ready.receiver.jitter
        # noise of aiding; for fixes, noise by jitter times speed and acceleration (the negative delay column of `h`)
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
        """Repeat the nominal run with the estimated noise."""
        return InnovationLikelihood(self._ready, self.prior, noise)

    def doubted(self, noise: NoiseEstimate) -> InnovationLikelihood:
        """Copy for over-confident fixes: centre the prior of position sds on their estimate times its white excess."""
        copied, excess = copy(self), np.clip(noise.white, 1.0, ALIKE)
        middle = dict(zip(LEVELS, np.log(noise.position_factor[1:] * excess), strict=True))
        copied.parameters = tuple(replace(p, middle=float(middle.get(p.key, p.middle))) for p in self.parameters)
        return copied

    def of(self, kind: ImuSpec) -> InnovationLikelihood:
        """Copy with the IMU specification `kind` as prior."""
        copied, imu_count = copy(self), sum(not p.key.startswith("gps.") for p in self.parameters)
        copied.prior = kind
        copied.parameters = (*copied._choose()[:imu_count], *self.parameters[imu_count:])
        return copied

    def beginning(self, length: float) -> InnovationLikelihood:
        """Copy with the innovations of the first `length` seconds only."""
        copied = copy(self)
        last = int(np.searchsorted(np.cumsum(self._tape[0]), length))
        copied._tape = tuple(each[:last] for each in self._tape)
        copied._other, copied._offered, copied._sd, copied._c = (
            each[:last] for each in (self._other, self._offered, self._sd, self._c)
        )
        return copied

    def of_fixes(self, *, positions: bool, velocities: bool) -> InnovationLikelihood:
        """Copy with parameters of the fixes only: time-correlated share and time, and the chosen sds."""
        copied, keys = copy(self), LEVELS * positions + ("gps.velocity", "gps.vertical_velocity") * velocities
        copied.parameters = (*(p for p in self.parameters if p.key in keys), *self.parameters[-2:])
        return copied

    def with_correlated_velocities(self) -> InnovationLikelihood:
        """Copy with time-correlated velocity errors: three additional states, which are zero in the nominal run."""
        wider, index, tape = copy(self), self._lasting + 3, list(self._tape)
        tape[7], tape[8] = (np.insert(each, [index] * 3, 0.0, axis=-1) for each in self._tape[7:9])
        tape[7][:, range(3, 6), range(index, index + 3)] = self._offered[:, None]
        wider._tape = tuple(tape)
        added = (Parameter(f"gps.{key}", middle, sd, sd) for key, (middle, sd) in VELOCITY_CORRELATED.items())
        wider.parameters = (*self.parameters[:-2], *added, *self.parameters[-2:])
        return wider

    def _choose(self) -> tuple[Parameter, ...]:
        static, at_rest, prior_noise = self._ready.alignment.static, {}, self.prior.gyro.random_walk
        if static is not None and static[1] - static[0] >= REST and prior_noise.any():
            measured = white_noise(self._ready.imu, *static, SLOW)[0]
            middle = 0.5 * float(np.log(np.mean(measured**2) / np.mean(prior_noise**2)))
            at_rest["gyro.random_walk"] = Parameter("gyro.random_walk", middle, *REST_PRIOR)
        parameters = [
            at_rest.get(f"{name}.{key}", Parameter(f"{name}.{key}", 0.0, sd, sd))
            for name, sensor in (("gyro", self.prior.gyro), ("accel", self.prior.accel))
            for key, sd in IMU_PRIOR.items()
            if np.any(getattr(sensor, key) > 0.0) and not (self._states == 15 and key == "scale_factor")
        ]
        parameters += [Parameter(name, 0.0, *POSITION_PRIOR) for name in LEVELS]
        for axis, name in ((0, "velocity"), (2, "vertical_velocity")):
            if self.velocity_sd[axis] < OPEN_SD:
                parameters.append(Parameter(f"gps.{name}", 0.0, VELOCITY_PRIOR, VELOCITY_PRIOR))
        shortest = float(np.quantile(np.diff(self._given), 0.25))  # interval within the pairs of fixes
        largest = LARGEST_SHARE if shortest > FAR_APART else ALL
        parameters.append(Parameter("gps.share", *SHARE, SHARE[1], largest))
        return (*parameters, Parameter("gps.correlation_time", *CORRELATION_TIME, CORRELATION_TIME[1]))

    def spec(self, at: FloatArray) -> ImuSpec:
        """Return the IMU specification for parameters `at`, in the order of `parameters`."""
        factor = {p.key: float(np.exp(x)) for p, x in zip(self.parameters, at, strict=True)}

        def scaled(sensor: SensorSpec, name: str) -> SensorSpec:
            values = {key: getattr(sensor, key) * factor.get(f"{name}.{key}", 1.0) for key in IMU_PRIOR}
            limits = {key: np.maximum(getattr(sensor, key), largest[name]) for key, largest in LARGEST.items()}
            return replace(sensor, **values | {key: np.minimum(values[key], each) for key, each in limits.items()})

        return replace(self.prior, gyro=scaled(self.prior.gyro, "gyro"), accel=scaled(self.prior.accel, "accel"))

    def fixes_of(self, at: FloatArray) -> tuple[FloatArray, FloatArray, CorrelatedNoise]:
        """Return factors on position sd (3,) and velocity sd (3,), and time-correlated errors, for parameters `at`."""
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
        """Compute innovations, variances, and derivatives by `push` (`kernel.innovations`), for parameters `at`."""
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
        factor = np.where(self._sd < OPEN_SD, factor, 1.0)  # unmeasured components are not scaled
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

        The effect is the error of roll, pitch and heading per misalignment, (12, k, 3) [-]. The last value is true if
        attitude errors of the nominal run are too large for linear innovations. Only epochs after the filter has
        settled are used: products of tilts and a heading error of degrees are as large as misalignments. Epochs of a
        long stationary start are not used, as misalignments have no effect there.
        """
        push = np.insert(self._axes, 0, 0.0, axis=0)
        first_moving = np.flatnonzero(kernel.held(self._tape[2]) & (self._tape[0] > 0.0)).max(initial=-1) + 1
        settled = slice(int(first_moving + (self._offered.size - first_moving) // SETTLING), None)
        e, s, *effects = self.normalised(at, push)
        turned = rph_by_turn(self._c[settled], -push[1:, settled, 6:])
        kind = self._tape[1][: settled.start]
        late = slice(int(np.bitwise_count(kind[kind > COAST]).sum()), None)
        nonlinear = float(np.mean(np.abs(push[0, :, 6:]).max(axis=1) > FAR_OFF)) > FAR_OFF_SHARE
        by_late = np.array(effects)[:, late]
        if not float(np.abs(by_late).max(initial=0.0)) * self.misalignment_sd.max() < SENSELESS:
            raise DivergenceError("filter.misalignment_unbounded")
        curvature_and_slope = informed(e[late], by_late, weights_of(e[late], s[late]), self.misalignment_sd)
        return *curvature_and_slope, turned, nonlinear

    @property
    def misalignment_sd(self) -> FloatArray:
        """Prior standard deviations of the twelve misalignments [rad]."""
        return np.concatenate([np.repeat(sensor.misalignment, 2) for sensor in (self.prior.gyro, self.prior.accel)])

    def bias_seen(self, at: FloatArray) -> float:
        """Compute the negative log-likelihood of the gyro bias from the alignment, for parameters `at`."""
        sd = self._ready.alignment.gyro_bias_sd
        measured = np.isfinite(sd)
        gyro = self.spec(at).gyro
        variance = (gyro.bias**2 + gyro.bias_instability**2 + sd**2)[measured]
        return 0.5 * float(np.sum(np.log(variance) + self._ready.alignment.gyro_bias[measured] ** 2 / variance))


def cost_of(innovation: FloatArray, variance: FloatArray) -> float:
    """Compute the robust negative log-likelihood of innovations: beyond `HUBER` sd, it grows linearly.

    `innovation`, `variance` (k,): innovations and their variances.
    """
    if not (variance > 0.0).all():  # rounding, if model errors are far too large
        return np.inf
    return float(np.sum(costs_of(innovation, variance)))


def costs_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """Compute the robust negative log-likelihood of each innovation, (k,); see `cost_of`."""
    u = np.abs(innovation) / np.sqrt(variance)
    square = np.where(u <= HUBER, 0.5 * u * u, HUBER * u - 0.5 * HUBER**2)
    return np.asarray(square + 0.5 * CLEAN * np.log(variance))


def weights_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """Compute the curvature of `costs_of` by each innovation (k,), for iteratively reweighted least squares."""
    variance = np.where(variance > 0.0, variance, np.inf)  # no weight for variances lost to rounding
    return np.asarray(1.0 / (variance * np.maximum(np.abs(innovation) / np.sqrt(variance) / HUBER, 1.0)))


def bridged(samples: FloatArray, epochs: FloatArray) -> FloatArray:
    """Test which epochs (m,) [s] follow a data gap in the `samples` (n,) [s], (m,)."""
    step = np.diff(samples)
    gap = samples[1:][step > 2.5 * np.median(step)]
    count = np.searchsorted(gap, epochs + 0.5)
    return np.asarray(np.diff(count, prepend=0) > 0)


def thinned(gps: GpsData) -> GpsData:
    """Thin fixes to pairs of successive fixes, with twice `SPACING` from pair to pair.

    Short and long intervals are needed to separate the white noise of the fixes from IMU noise.
    """
    keep, begin, single = [], -np.inf, False
    for row, time in enumerate(gps.time.tolist()):
        if (single or time - begin >= 2.0 * SPACING - 1e-6) and (gps.fix is None or gps.fix[row] != 0):
            begin, single = (begin, False) if single else (time, True)
            keep.append(row)
    return gps.rows(np.array(keep, dtype=int))
