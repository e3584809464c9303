"""Noise of IMU and fixes by maximum likelihood, from the drive itself.

The filter runs once with a preset. Its innovations have a likelihood for every other set of noise figures, found by
covariance algebra at the fixes alone (`insnav.kernels.noise_likelihood`). The figures with the largest likelihood,
given what IMUs of this grade are like, are found by Fisher scoring; curvature gives their intervals. Noise from
innovations: R. K. Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Trans. Autom. Control
15 (1970) 175-184; by what is measured rather than by truth: P. Abbeel, A. Coates, M. Montemerlo, A. Y. Ng, S. Thrun,
"Discriminative training of Kalman filters", Robotics: Science and Systems (2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numba.core.config import NUMBA_NUM_THREADS  # type: ignore[attr-defined]

from insnav.exceptions import DivergenceError
from insnav.filter.error_model import ErrorModel, InitialState, error_model, initial_state
from insnav.filter.gates import Gates
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.gps_noise import ALIKE, OPEN_HEIGHT, OPEN_VELOCITY
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import CORRELATED, Prepared
from insnav.filter.sensor_axes import Misalignment, by_turn, errors_of_axes, informed, misalignment
from insnav.filter.state_layout import first_state, layout
from insnav.imu.noise_density import SLOW, white_noise
from insnav.imu.specification import ImuSpec, SensorSpec, level_bias
from insnav.kernels import noise_likelihood as kernel
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.smoother import COAST, FIX, NOISE, RESTART, SOURCE, TIME
from insnav.plain_text import without_exponents
from insnav.sample_statistics import chi2_limit
from insnav.types import Alignment, Event, EventKind, FloatArray, GpsData
from insnav.units import G0, UNITS

LONGEST = 1800.0  # of the record that is looked at [s]
SHORT = 600.0  # of it for the first steps, from which the rest is not far [s]
SPACING = 0.9  # time between the fixes that are looked at, on average at least [s]
FEWEST = 30  # fixes needed: what fewer show is less than what the prior knows
NOT_LOST = 0.95  # part of the fixes used with resets that a run uses without them, or it is lost
MOST_REJECTED = 0.3  # part of them that must have been used, else the gates are wrong
HUBER = 3.0  # innovations beyond so many standard deviations count less, so that false fixes do not decide
# what the variance of clean innovations loses by that: 1 - 2 Q(3), the expectation of psi(u) u for standard normal u
CLEAN = 0.9973
ROUNDS = 12  # of Fisher scoring at most
STEP = 0.01  # of numerical derivatives, in logarithms
DIGITS = 6  # of these logarithms that count: what is found does not hang on how sums are rounded, which is far less
FAR_OFF, FAR_OFF_SHARE = np.deg2rad(5.0), 0.1  # attitude error whose square counts [rad], in this part of a drive [-]
REJECTED = 3.5  # times the usual interval between fixes that are used, beyond which others are missing
SETTLING, SETTLED = 4, 60.0  # the attitude of a filter settles in this part of a drive, one in so many, or so soon [s]
TOO_SMALL = 1.5  # mean square of innovations by their variance with noise that is given: true ones have up to 1.1 [-]
ENOUGH_FOR_AXES = 900.0  # of the record, where nothing else is looked for [s]
WORTH_TURNING = 0.5  # of what is not known of attitude: if misalignments that are known do more, samples are corrected
# Largest figures, where the preset has no larger ones. Consumer sensors are sold with scale factors of 0.03, biases of
# 3 deg/s and 0.5 m/s^2 at most; what is larger explains noise, or faults, by itself.
LARGEST = {
    "scale_factor": {"gyro": 0.05, "accel": 0.05},
    "misalignment": {"gyro": 0.1, "accel": 0.1},
    "bias": {"gyro": 0.1, "accel": 1.0},
    "bias_instability": {"gyro": 0.02, "accel": 0.3},
}
LARGEST_STEP = 1.5  # of a round, in logarithms
ENOUGH = 0.6  # smaller gains of the log-likelihood end the search: an interval of 95 % is two wide
NEAR = 3.0  # smaller ones end the first steps
FAR = 5.0  # after a larger one the derivatives serve another step
OBSERVABLE = 0.8  # a figure is observable if the drive narrows its interval to this part of the prior's
INTERVAL = np.array([-1.96, 1.96])  # ends of 95 % of a normal distribution, in its sd
# Where the white part alone of the errors of fixes is so many times what came with these, the lasting part, of which a
# drive shows little, is larger than that says, too: the whole is then taken for as many times more, up to `ALIKE`, as
# the white part exceeds it. From further factors it is looked for, as most fixes may have been rejected.
DOUBTED = 1.15
UNDERSTATED, UNDERSTATED_STARTS = 2.0, (1.0, 5.0, 50.0)
NO_NOISE = 10.0  # times from which it may be more than a remark on the receiver [-]
# a drive is by another IMU if by chance its innovations are so unlikely, and figures so many times and standard
# deviations off those of all
CHANCE, UNLIKE, UNLIKE_SD = 1e-4, 2.0, 3.0
# the figures of a drive are those of another kind of IMU where these make them so much likelier [-]; tried so often
OTHER_KIND, KINDS_TRIED = 2.0, 2
FACTOR_WORTH = 0.1  # a smaller change of a standard deviation is not told

# how far figures of an IMU may be from those of the nearest grade, one sd of their logarithm: datasheets of parts of
# one grade differ by factors of two to three in noise, by ten in what is called in-run bias
IMU_PRIOR = {"random_walk": 0.8} | dict.fromkeys(("bias_instability", "bias", "scale_factor", "misalignment"), 1.5)
# Of misalignments as the constants they are: datasheets of one kind differ by a factor of two. With a wider prior the
# two or three that a drive tells, small by chance, made all others small.
SIZE_PRIOR = 0.7
# The same of white noise of gyros where a rest of at least so long [s] has shown it at the frequencies that count
# between fixes: motion adds to it. What a rest shows at higher ones, which chose the preset, may be an idle engine.
REST, REST_PRIOR = 60.0, (0.5, 0.3)
UNITS_SHOWN = {
    "random_walk": ("deg/sqrt(h)", "m/s/sqrt(h)"),
    "scale_factor": ("ppm", "ppm"),
    "misalignment": ("mrad", "mrad"),
}
# The same of the standard deviation of a position, upwards and downwards. Innovations cannot show that it is smaller:
# errors that hardly change from fix to fix leave no trace in them. Smaller innovations are time correlation.
POSITION_PRIOR = (0.6, 0.03)
LEVELS = "gps.horizontal", "gps.vertical"
VELOCITY_PRIOR = 0.6
KINK = 3.0  # sd of the steeper side of a prior from its middle: the other side is what is plausible there
# By so many times their variance, figures are larger in the mean than where they are likeliest: a correlation time as a
# log-normal one is; a size by twice that: the mean variance that n errors tell, n = 1 / (2 sd^2), is n / (n - 2) of it
# (inverse gamma).
AVERAGED = {"gps.horizontal": 2.0, "gps.vertical": 2.0, "gps.correlation_time": 0.5}
# Log odds of the time-correlated share of the variance of a position, and their sd: it is never none. In seven minutes
# 9 % are not told from none; taken for none they make smoothed errors twice what is stated (error2/variance 3 to 4).
SHARE = (0.0, 1.5)
CORRELATION_TIME = (float(np.log(45.0)), 1.0)  # logarithm of its correlation time [s], and its sd
# Largest share, and that of fixes more than so long apart [s]: their white rest is also what the IMU model lacks in a
# turn, whose way grows with the square of the time in between.
ALL, LARGEST_SHARE, FAR_APART = 1.0 - 1e-6, 0.95, 0.5
# Velocities, too, may have a time-correlated error, as their integral shows against positions: logarithms of its sd by
# that of a velocity and of its correlation time [s], and their sd. What is alike for seconds only is a receiver's
# smoothing. From these starts on it is looked for, and taken where innovations become likelier by so much: half the
# logarithm of their number for each of the two, 10, and as much again, as a minute of positions that drift gains 15.
VELOCITY_CORRELATED = {
    "velocity_correlated": (float(np.log(0.3)), 1.0),
    "velocity_correlation_time": (float(np.log(100.0)), 0.3),
}
VELOCITY_STARTS = np.log([(share, time) for time in (30.0, 150.0) for share in (0.1, 0.3)])
VELOCITY_WORTH = 20.0
LATER, MOVED = 3, 4  # first of the causes that innovations are looked at for, beside three gyros
SENSELESS = 1e6  # no misalignment moves fixes so far [m], [m/s]
SHOWN = 2.0  # so long after it is lost a run shows by what [s]
LOST, AFTER = 9.0, 5.0  # mean square of normalised innovations of so long [s] beyond which a run is no start
STARTS = [np.log([share / (1.0 - share), time]) for time in (8.0, 40.0, 150.0) for share in (0.1, 0.5, 0.85)]


@dataclass(frozen=True, slots=True)
class NoiseFigure:
    """One figure of the noise, as found."""

    key: str  # its dotted name, such as ``gyro.random_walk`` or ``gps.share``
    unit: str  # unit to show it in
    # of the nearest grade, as found, and its interval of 95 %; RMS of the axes; factors of reported sd [SI]
    prior: float
    value: float
    low: float
    high: float
    observable: bool  # the drive tells it; otherwise it is the prior's


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """What the innovations of a drive say about noise."""

    spec: ImuSpec  # the IMU
    filter_spec: ImuSpec  # the same with the misalignment whose noise is that of the innovations
    axes: Misalignment  # its misalignments
    position_factor: FloatArray  # (3,) of the standard deviations of positions, North, East, Down [-]
    velocity_factor: FloatArray  # (3,) of those of velocities [-]
    correlated: CorrelatedNoise  # time-correlated part of the position error
    figures: tuple[NoiseFigure, ...]  # what was found, with intervals
    gain: float  # log-likelihood gained over the prior's figures
    # mean square of the normalised innovations with the figures before and with those found [-]
    mean_before: float
    mean_after: float
    far_off: bool  # the attitude of the run was so far off that the innovations are no linear function of it
    seen: tuple[InnovationLikelihood, FloatArray] | None = None  # what it was found in, and the logarithms of figures


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A figure, as a logarithm: the middle of its prior, and its standard deviation above and below that.

    A share, as log odds, is one of `most`.
    """

    key: str
    middle: float
    sd: float
    sd_below: float
    most: float = 1.0


class InnovationLikelihood:
    """Innovations of one drive as a function of the noise; `about`: noise of the run they are a linear function of."""

    def __init__(self, ready: Prepared, spec: ImuSpec, about: NoiseEstimate | None = None) -> None:
        ready = ready.longest_part()
        run = ready if about is None else _refined(ready, about)
        gps = _thinned(ready.gps)
        self.median_sd: FloatArray = np.median(gps.position_sd, axis=0)
        correlated = run.settings.correlated
        if correlated is None:  # the nominal run needs the states, whatever their size
            correlated = CorrelatedNoise(0.1, 40.0, np.sqrt(0.1) * self.median_sd)
        correlated = replace(correlated, velocity_sd=None)
        self._settings = replace(ready.settings, correlated=correlated, aiding=None, smooth=True, output_interval=10.0)
        self._ready, self._run, self.prior = ready, run, spec
        self._states = STATES if ready.model.sd[6:].any() else STATES - 6
        navigator = Navigator(run.initial, run.model, _thinned(run.gps), ready.alignment, ready.nominal, self._settings)
        imu = ready.first(LONGEST)
        navigator.feed(imu)
        rows = navigator.history().rows()
        time = rows[:, TIME]
        at = layout(self._settings)
        self._lasting = at.correlated
        self._tape = kernel.tape(rows, at.states, run.model.noise, bridged(imu.time, time))
        self._offered = rows[:, SOURCE] == FIX
        self._known = np.zeros((1, self._offered.size, NAV))  # errors that each span adds
        h, jitter = self._tape[7], ready.settings.jitter
        # of fixes: what the scatter of the timestamps makes of speed and acceleration, the negatives of the column of
        # the delay; of other aiding: its noise
        measured = rows[:, SOURCE, None] != 0.0
        self._other = np.where(measured, rows[:, NOISE : NOISE + 36 : 7], 0.0)
        self._other[self._offered] = (jitter * h[self._offered][:, :, STATES]) ** 2
        self._given = gps.time - ready.settings.delay
        fix = np.searchsorted(self._given, time - 1e-4)
        fix = np.minimum(fix, gps.time.shape[0] - 1)
        self._sd = np.nan_to_num(np.hstack([gps.position_sd[fix], gps.velocity_sd[fix]]), nan=1.0)
        self._axes, self._c = errors_of_axes(rows, self._tape[2], imu, ready.nominal)
        moving = np.isfinite(gps.v_n).all(axis=1)
        unknown = np.full(3, OPEN_VELOCITY)
        self.velocity_sd: FloatArray = np.median(gps.velocity_sd[moving], axis=0) if moving.any() else unknown
        self.fixes = int(np.count_nonzero(self._offered & (self._tape[1] > 0)))
        self.offered = int(np.count_nonzero((gps.time > imu.time[0]) & (gps.time < imu.time[-1])))
        self.parameters = self._choose()

    def again(self, found: NoiseEstimate) -> InnovationLikelihood:
        """The same about another run, with the noise that was found."""
        return InnovationLikelihood(self._ready, self.prior, found)

    def doubted(self, found: NoiseEstimate) -> InnovationLikelihood:
        """The same if what came with the positions says nothing of their size, where it is far smaller than `found`."""
        part, larger = copy(self), np.clip(_white(found), 1.0, ALIKE)
        middle = dict(zip(LEVELS, np.log(found.position_factor[1:] * larger), strict=True))
        part.parameters = tuple(replace(p, middle=float(middle.get(p.key, p.middle))) for p in self.parameters)
        return part

    def of(self, kind: ImuSpec) -> InnovationLikelihood:
        """The same by another kind of IMU, with its figures for the prior."""
        other, of_imu = copy(self), sum(not p.key.startswith("gps.") for p in self.parameters)
        other.prior = kind
        other.parameters = (*other._choose()[:of_imu], *self.parameters[of_imu:])
        return other

    def beginning(self, length: float) -> InnovationLikelihood:
        """The same of the innovations of so long from the start only [s]."""
        part = copy(self)
        last = int(np.searchsorted(np.cumsum(self._tape[0]), length))
        part._tape = tuple(each[:last] for each in self._tape)
        part._other, part._offered, part._sd, part._c = (
            each[:last] for each in (self._other, self._offered, self._sd, self._c)
        )
        part._known = self._known[:, :last]
        return part

    def linear(self, at: FloatArray) -> InnovationLikelihood:
        """The same until the run is lost, soon after which innovations are no linear function of what is wrong."""
        e, s = self.normalised(at)[:2]
        many = np.concatenate([[0], np.cumsum(np.bitwise_count(np.maximum(self._tape[1], COAST)).astype(int))])
        square = np.concatenate([[0.0], np.cumsum(e**2 / s)])[many]
        first = np.searchsorted(self.times, self.times - AFTER)
        mean = (square[1:] - square[first]) / np.maximum(many[1:] - many[first], 1)
        settled = min(mean.size // SETTLING, int(np.searchsorted(self.times, self.times[0] + SETTLED)))
        row = settled + int(np.argmax(mean[settled:] > LOST))
        if row == settled:  # never, or before it has settled: what is wrong is all over
            return self
        return self.beginning(float(self.times[row] + SHOWN - self._run.initial.time))

    def of_positions(self, *, sizes: bool) -> InnovationLikelihood:
        """The same with no figures but what part of the errors of positions lasts, how long, and their `sizes`."""
        same = copy(self)
        same.parameters = (*(p for p in self.parameters if sizes and p.key in LEVELS), *self.parameters[-2:])
        return same

    def with_correlated_velocities(self) -> InnovationLikelihood:
        """The same if velocities have a time-correlated error: three more states, which the run took for zero."""
        wider, at, tape = copy(self), self._lasting + 3, list(self._tape)
        tape[7], tape[8] = (np.insert(each, [at] * 3, 0.0, axis=-1) for each in self._tape[7:9])
        tape[7][:, range(3, 6), range(at, at + 3)] = self._offered[:, None]
        wider._tape = tuple(tape)
        more = (_Parameter(f"gps.{key}", middle, sd, sd) for key, (middle, sd) in VELOCITY_CORRELATED.items())
        wider.parameters = (*self.parameters[:-2], *more, *self.parameters[-2:])
        return wider

    def _choose(self) -> tuple[_Parameter, ...]:
        static, at_rest, of_prior = self._ready.alignment.static, {}, self.prior.gyro.random_walk
        if static is not None and static[1] - static[0] >= REST and of_prior.any():
            seen = white_noise(self._ready.imu, *static, SLOW)[0]
            middle = 0.5 * float(np.log(np.mean(seen**2) / np.mean(of_prior**2)))
            at_rest["gyro.random_walk"] = _Parameter("gyro.random_walk", middle, *REST_PRIOR)
        found = [
            at_rest.get(f"{name}.{key}", _Parameter(f"{name}.{key}", 0.0, sd, sd))
            for name, sensor in (("gyro", self.prior.gyro), ("accel", self.prior.accel))
            for key, sd in IMU_PRIOR.items()
            if np.any(getattr(sensor, key) > 0.0) and not (self._states == 15 and key == "scale_factor")
        ]
        found += [_Parameter(name, 0.0, *POSITION_PRIOR) for name in LEVELS]
        for axis, name in ((0, "velocity"), (2, "vertical_velocity")):
            if self.velocity_sd[axis] < OPEN_VELOCITY:
                found.append(_Parameter(f"gps.{name}", 0.0, VELOCITY_PRIOR, VELOCITY_PRIOR))
        near = float(np.quantile(np.diff(self._given), 0.25))  # fixes are looked at in pairs
        most = LARGEST_SHARE if near > FAR_APART else ALL
        found.append(_Parameter("gps.share", *SHARE, SHARE[1], most))
        return (*found, _Parameter("gps.correlation_time", *CORRELATION_TIME, CORRELATION_TIME[1]))

    def spec(self, at: FloatArray) -> ImuSpec:
        """IMU of a set of figures."""
        factor = {p.key: float(np.exp(x)) for p, x in zip(self.parameters, at, strict=True)}

        def scaled(sensor: SensorSpec, name: str) -> SensorSpec:
            found = {key: getattr(sensor, key) * factor.get(f"{name}.{key}", 1.0) for key in IMU_PRIOR}
            most = {key: np.maximum(getattr(sensor, key), largest[name]) for key, largest in LARGEST.items()}
            return replace(sensor, **found | {key: np.minimum(found[key], each) for key, each in most.items()})

        return replace(self.prior, gyro=scaled(self.prior.gyro, "gyro"), accel=scaled(self.prior.accel, "accel"))

    def fixes_of(self, at: FloatArray) -> tuple[FloatArray, FloatArray, CorrelatedNoise]:
        """Factors of the sd of position and velocity; the time-correlated part of the errors."""
        value = {p.key: float(x) for p, x in zip(self.parameters, at, strict=True)}
        level, down = (np.exp(value.get(key, 0.0)) for key in LEVELS)
        share = self.parameters[-2].most / (1.0 + np.exp(-value["gps.share"]))
        velocity = np.exp([value.get(f"gps.{name}", 0.0) for name in ("velocity", "velocity", "vertical_velocity")])
        position, time = np.array([level, level, down]), float(np.exp(value["gps.correlation_time"]))
        correlated = CorrelatedNoise(float(share), time, np.sqrt(share) * position * self.median_sd)
        if "gps.velocity_correlated" in value:
            size, time = (float(np.exp(value[f"gps.{key}"])) for key in VELOCITY_CORRELATED)
            measured = np.where(self.velocity_sd < OPEN_VELOCITY, self.velocity_sd, 0.0)
            correlated = replace(correlated, velocity_sd=size * measured, velocity_time=time)
        return position, velocity, correlated

    def normalised(self, at: FloatArray, push: FloatArray | None = None) -> FloatArray:
        """Innovations and variances with a set of figures, and derivatives by `push`, as of `kernel.innovations`."""
        push = self._known.copy() if push is None else push
        out = np.empty((1 + push.shape[0], 6 * self._offered.size))
        model = error_model(self.spec(at), self._states)
        position, velocity, correlated = self.fixes_of(at)
        start = first_state(
            _start(self._ready.initial, self._ready.alignment, model, position),
            replace(self._settings, correlated=correlated),
        )
        mean = np.zeros(start.covariance.shape[0])
        mean[NAV : NAV + 3] = self._run.initial.gyro_bias - start.correction[:3]
        factor = np.concatenate([np.sqrt(1.0 - correlated.share) * position, velocity])
        factor = np.where(self._sd < OPEN_VELOCITY, factor, 1.0)  # what was not measured says nothing of it
        variance = self._other + self._offered[:, None] * (factor * self._sd) ** 2
        count = kernel.innovations(
            self._tape,
            self._run.model.decay,
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
        """Curvature (12, 12) and slope (12,) of the log-likelihood by the misalignments [rad], and what these do.

        That is the error of roll, pitch and heading by each (12, k, 3) [-]. Last, whether the attitude of the run was
        so far off so long that the innovations are no linear function of it. All is of the settled filter: while the
        heading is off by degrees, its products with tilts count as much as misalignments. A long rest, where these do
        nothing to the filter, would make what they do seem less.
        """
        push = np.insert(self._axes, 0, 0.0, axis=0)
        rest = np.flatnonzero(kernel.held(self._tape[2]) & (self._tape[0] > 0.0)).max(initial=-1) + 1
        settled = slice(int(rest + (self._offered.size - rest) // SETTLING), None)
        e, s, *by = self.normalised(at, push)
        tilt = -push[1:, settled, 6:]
        turned = np.concatenate([np.einsum("kji,akj->aki", self._c[settled], tilt)[..., :2], tilt[..., 2:]], axis=-1)
        kind = self._tape[1][: settled.start]
        late = slice(int(np.bitwise_count(kind[kind > COAST]).sum()), None)
        far_off = float(np.mean(np.abs(push[0, :, 6:]).max(axis=1) > FAR_OFF)) > FAR_OFF_SHARE
        of_terms = np.array(by)[:, late]
        if not float(np.abs(of_terms).max(initial=0.0)) * self.misalignment_sd.max() < SENSELESS:
            raise DivergenceError(
                "what misalignments do to the innovations has no end",
                why="this noise leaves so little of the covariance that rounding decides",
            )
        found = informed(e[late], of_terms, weights_of(e[late], s[late]), self.misalignment_sd)
        return *found, turned, far_off

    @property
    def reset(self) -> bool:
        """Whether the run was reset to fixes."""
        return bool((self._tape[1] == RESTART).any())

    @property
    def misalignment_sd(self) -> FloatArray:
        """Standard deviations of the twelve misalignments by the prior [rad]."""
        return np.concatenate([np.repeat(sensor.misalignment, 2) for sensor in (self.prior.gyro, self.prior.accel)])

    def rejected(self) -> bool:
        """Whether several fixes in a row were rejected in the run, positions or velocities."""
        kind = self._tape[1]
        used = np.append(self.times[kind == kind.max()], self.times[-1])
        step, offered = np.diff(used), np.diff(np.searchsorted(self._given, used + 1e-4))
        return bool(((step > REJECTED * np.median(step)) & (offered > REJECTED)).any())

    @property
    def times(self) -> FloatArray:
        """Of the epochs, (m,) [s]."""
        return np.asarray(self._run.initial.time + np.cumsum(self._tape[0]))

    def by_spans(self, at: FloatArray, edges: FloatArray, cause: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Innovations (n,), their weights (n,), and what one unit of a cause between `edges` (k + 1,) [s] adds, (k, n).

        `cause`: a gyro shows more, 0 to 2 [rad/s]; fixes are later, `LATER` [s], or off to North, East, Down, `MOVED`
        and the two after it [m].
        """
        e, s, *by = self.normalised(at, self._pushes(edges, cause))
        return e, weights_of(e, s), np.array(by)

    def without(self, begin: float, end: float, cause: int, size: float) -> InnovationLikelihood:
        """The same without a cause of a known size between two times [s]; see `by_spans`."""
        other = copy(self)
        other._known = size * self._pushes(np.array([begin, end]), cause)[1:]
        return other

    def _pushes(self, edges: FloatArray, cause: int) -> FloatArray:
        """Errors that one unit of a cause adds between `edges` in each span, (k + 1, m, 9), the first of nothing."""
        end, push = self.times, [np.zeros((self._offered.size, NAV))]
        off = np.zeros(push[0].shape)
        if cause == LATER:
            off[:, :6] = -self._tape[7][:, :, STATES]  # by the speed
        else:
            off[:, cause - MOVED] = -1.0
        for first, last in pairwise(edges):
            if cause >= LATER:  # errors that are there only as long as the fixes are off
                now = off * ((end > first) & (end <= last))[:, None]
                before = np.vstack([push[0][:1], now[:-1]])
                push.append(now - np.einsum("kij,kj->ki", self._tape[2][:, :, :NAV], before))
            else:
                inside = np.maximum(np.minimum(end, last) - np.maximum(end - self._tape[0], first), 0.0)
                push.append(by_turn(-self._c[:, :, cause] * inside[:, None], self._tape[2]))
        return np.array(push)

    def bias_seen(self, at: FloatArray) -> float:
        """Negative log-likelihood of the gyro bias that a static alignment saw."""
        known = self._ready.alignment.gyro_bias_sd
        if not np.isfinite(known).all():
            return 0.0
        gyro = self.spec(at).gyro
        variance = gyro.bias**2 + gyro.bias_instability**2 + known**2
        return 0.5 * float(np.sum(np.log(variance) + self._ready.alignment.gyro_bias**2 / variance))


def cost_of(innovation: FloatArray, variance: FloatArray) -> float:
    """Negative log-likelihood of innovations, robust: beyond three sd it grows with their size, not with its square.

    `innovation`, `variance` (k,): innovations and their variances.
    """
    if not (variance > 0.0).all():  # rounding, where errors of the model are far too large
        return np.inf
    return float(np.sum(costs_of(innovation, variance)))


def costs_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """The same of each innovation (k,)."""
    u = np.abs(innovation) / np.sqrt(variance)
    square = np.where(u <= HUBER, 0.5 * u * u, HUBER * u - 0.5 * HUBER**2)
    return np.asarray(square + 0.5 * CLEAN * np.log(variance))


def weights_of(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """Curvature of `costs_of` by each innovation (k,), in iteratively reweighted least squares."""
    return np.asarray(1.0 / (variance * np.maximum(np.abs(innovation) / np.sqrt(variance) / HUBER, 1.0)))


def _start(initial: InitialState, alignment: Alignment, model: ErrorModel, factor: FloatArray) -> InitialState:
    """Initial state for another error model: alignment errors by the sensor errors change with these, others stay."""
    sd = np.sqrt(np.diag(initial.covariance)[:6])
    place = initial.lla, initial.v_n, sd[:3] * factor if initial.from_fix else sd[:3], sd[3:]
    return initial_state(alignment, model, *place, own=initial.own, from_fix=initial.from_fix)


def bridged(samples: FloatArray, epochs: FloatArray) -> FloatArray:
    """Whether a gap of the samples lies before each epoch."""
    step = np.diff(samples)
    gap = samples[1:][step > 2.5 * np.median(step)]
    count = np.searchsorted(gap, epochs + 0.5)
    return np.asarray(np.diff(count, prepend=0) > 0)


def _thinned(gps: GpsData) -> GpsData:
    """Fixes in pairs of neighbours, two `SPACING` from pair to pair.

    Noise that is new in each fix is told from what the IMU adds in between only if the times in between differ.
    """
    keep, begin, single = [], -np.inf, False
    for row, time in enumerate(gps.time.tolist()):
        if (single or time - begin >= 2.0 * SPACING - 1e-6) and (gps.fix is None or gps.fix[row] != 0):
            begin, single = (begin, False) if single else (time, True)
            keep.append(row)
    return gps.rows(np.array(keep, dtype=int))


_Seen = tuple[FloatArray, FloatArray, float]  # innovations, their variances, and the cost of a set of figures


class _Posterior:
    """Innovation likelihood of drives that share one IMU, with the prior."""

    def __init__(self, drives: Sequence[InnovationLikelihood]) -> None:
        self.drives, self.parameters = drives, drives[0].parameters
        self.middle = np.array([p.middle for p in self.parameters])
        self._sd = np.array([[p.sd, p.sd_below] for p in self.parameters]).T

    @property
    def can_be_wider(self) -> bool:
        """Whether velocities may have a time-correlated error, too."""
        keys = {p.key for p in self.parameters}
        return "gps.velocity" in keys and "gps.velocity_correlated" not in keys

    def wider(self) -> _Posterior:
        """The same with a time-correlated error of the velocities."""
        return _Posterior([drive.with_correlated_velocities() for drive in self.drives])

    def weight(self, at: FloatArray) -> FloatArray:
        """Curvature of the prior."""
        curvature: FloatArray = np.where(at >= self.middle, self._sd[0], self._sd[1]) ** -2.0
        return curvature

    def plausible(self, top: FloatArray, covariance: FloatArray) -> FloatArray:
        """Mean variances and mean correlation time over what is plausible, and the ends of the interval: (3, k).

        Of time-correlated errors as long as the drive they are known to a factor, and the likeliest ones are too small.
        """
        wide = top + np.diag(covariance) * [AVERAGED.get(p.key, 0.0) for p in self.parameters]
        return np.array([wide, *(top + end * np.sqrt(np.diag(covariance)) for end in INTERVAL)])

    def figures(self, plausible: FloatArray, spec: ImuSpec) -> list[NoiseFigure]:
        """Figures of what is `plausible`."""
        return [_figure(p, x, spec) for p, x in zip(self.parameters, plausible.T, strict=True)]

    def innovations(self, at: FloatArray) -> _Seen:
        """Innovations, their variances, and the cost of a set of figures."""
        parts = [drive.normalised(at) for drive in self.drives]
        e, s = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        return e, s, cost_of(e, s) + self._before(at)

    def _side_by_side(self, cases: FloatArray) -> list[_Seen]:
        """The same of several sets, in as many threads as numba may have: its kernel waits for none."""
        with ThreadPoolExecutor(min(len(cases), NUMBA_NUM_THREADS)) as pool:
            return list(pool.map(self.innovations, cases))

    def _before(self, at: FloatArray) -> float:
        """What the cost of a set of figures is without any innovation."""
        off = np.where(np.isfinite(at), at - self.middle, 0.0)
        return 0.5 * float(np.sum(self.weight(at) * off**2)) + sum(drive.bias_seen(at) for drive in self.drives)

    def climb(self, at: FloatArray, settled: float = ENOUGH) -> tuple[FloatArray, FloatArray, _Seen]:
        """Where the posterior density is largest, covariance and innovations there: Fisher scoring, damped (Levenberg).

        Along the last step the curvature is what the slope shows: on a ridge, as of time-correlated errors, scoring
        alone goes from side to side and ends up to 80 nats too low.
        In a round the derivatives of the innovations are those of its start, as long as steps with them gain enough.
        """
        e, s, cost = self.innovations(at)
        damping, steps, last, moved = 1e-3, STEP * np.eye(at.size), np.zeros(at.size), np.zeros(at.size)
        for _ in range(ROUNDS):
            by_e, by_s, slope = np.empty((at.size, e.size)), np.empty((at.size, e.size)), np.empty(at.size)
            for i, (e1, s1, cost1) in enumerate(self._side_by_side(at + steps)):
                by_e[i], by_s[i], slope[i] = (e1 - e) / STEP, (s1 - s) / STEP / s, (cost1 - cost) / STEP
            clean = by_e / np.sqrt(s * np.maximum(np.abs(e) / np.sqrt(s) / HUBER, 1.0))
            weight = self.weight(at)
            fisher = clean @ clean.T + 0.5 * by_s @ by_s.T + np.diag(weight)
            curvature, last, moved = _bent(fisher, moved, slope - last), slope, np.zeros(at.size)
            start, gained = cost, np.inf
            while gained > FAR and damping < 1e4:
                if start != cost:
                    u, before = e / np.sqrt(s), self._before(at)
                    pull = np.clip(u, -HUBER, HUBER)
                    slope = by_e @ (pull / np.sqrt(s)) + 0.5 * by_s @ (CLEAN - pull * u)
                    slope += np.array([self._before(at + step) - before for step in steps]) / STEP
                move = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope)
                move *= min(1.0, LARGEST_STEP / float(np.max(np.abs(move))))
                there = np.asarray(np.round(at + move, DIGITS), dtype=np.float64)
                e1, s1, cost1 = self.innovations(there)
                if cost1 < cost:
                    gained = cost - cost1
                    at, e, s, cost, moved = there, e1, s1, cost1, moved + move
                    damping = max(1e-6, 0.1 * damping)
                elif start == cost:
                    damping = 10.0 * max(damping, 1e-3)
                else:
                    break
            if start - cost < settled:
                break
        fisher += np.diag(self.weight(at + KINK * self._sd[1]) - weight)
        return at, np.linalg.inv(fisher).astype(np.float64), (e, s, cost)


def _bent(curvature: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """Curvature by which a step changes the slope as it did, as of BFGS.

    J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., Springer 2006, eq. (6.19).
    """
    if step @ change <= 0.0:
        return curvature
    along = curvature @ step
    return curvature + np.outer(change, change) / (step @ change) - np.outer(along, along) / (step @ along)


def _begun(posterior: _Posterior) -> FloatArray:
    """Figures from which the largest density is near: of several starts the likeliest, by the first of the record."""
    level = np.array([p.key in LEVELS for p in posterior.parameters[:-2]])
    starts = [
        np.concatenate([posterior.middle[:-2] + np.log(factor) * level, each])
        for factor in UNDERSTATED_STARTS
        for each in STARTS
    ]
    short = _Posterior([drive.beginning(SHORT) for drive in posterior.drives])
    return short.climb(min(starts, key=lambda at: short.innovations(at)[2]), NEAR)[0]


def maximise(drives: Sequence[InnovationLikelihood], near: NoiseEstimate | None = None) -> NoiseEstimate:
    """Figures with the largest posterior density, or with the largest `near` others; several drives share one set."""
    posterior = _Posterior(drives)
    white = posterior.middle.copy()
    white[-2] = -np.inf
    before = posterior.innovations(white)
    first = _begun(posterior) if near is None or near.seen is None else near.seen[1]
    if first.size > posterior.middle.size:
        posterior = posterior.wider()
    top, covariance, (e, s, cost) = posterior.climb(first)
    if posterior.can_be_wider:
        wider = posterior.wider()
        starts = [np.concatenate([top[:-2], each, top[-2:]]) for each in VELOCITY_STARTS]
        costs = [wider.innovations(at)[2] for at in starts]
        if min(costs) < cost:
            at, of_at, found = wider.climb(starts[int(np.argmin(costs))])
            if found[2] < cost - VELOCITY_WORTH:
                posterior, top, covariance, (e, s, cost) = wider, at, of_at, found
    drive = posterior.drives[0]
    plausible = posterior.plausible(top, covariance)
    position, velocity, correlated = drive.fixes_of(plausible[0])
    filter_spec = drive.spec(top)
    axes, far_off = _misalignment(posterior.drives, top, SIZE_PRIOR)
    return NoiseEstimate(
        _turned(drive.prior, filter_spec, axes.size[0]),
        filter_spec,
        axes,
        position,
        velocity,
        correlated,
        tuple(
            _figure(p, np.log(axes.size) if p.key.endswith("misalignment") else x, drive.prior)
            for p, x in zip(posterior.parameters, plausible.T, strict=True)
        ),
        before[2] - cost,
        float(np.mean(before[0] ** 2 / before[1])),
        float(np.mean(e**2 / s)),
        far_off,
        (drive, top),
    )


def climbed(drive: InnovationLikelihood, at: FloatArray) -> tuple[FloatArray, float]:
    """Figures of the noise that are likeliest near others, and what the drive then costs: -log posterior density."""
    top, _, found = _Posterior([drive]).climb(at, NEAR)
    return top, found[2]


def cost_at(drive: InnovationLikelihood, at: FloatArray) -> float:
    """What a drive costs with figures of the noise: -log posterior density."""
    return _Posterior([drive]).innovations(at)[2]


def _misalignment(drives: Sequence[InnovationLikelihood], at: FloatArray, prior_sd: float) -> tuple[Misalignment, bool]:
    """Misalignments of the IMU of all drives, attitude is that of the first; and whether a run was far off."""
    fisher, slope, turned, far_off = zip(*(drive.by_axes(at) for drive in drives), strict=True)
    fisher, slope = np.sum(fisher, axis=0), np.sum(slope, axis=0)
    return misalignment(fisher, slope, turned[0], drives[0].misalignment_sd, prior_sd), any(far_off)


def _turned(prior: ImuSpec, found: ImuSpec, size: float) -> ImuSpec:
    """IMU as found, with misalignments of a size by those of the prior; what gravity makes of them stays, as a bias."""
    gyro, accel = (size * sensor.misalignment for sensor in (prior.gyro, prior.accel))
    bias = np.sqrt(np.maximum(level_bias(found.accel) ** 2 - (G0 * accel) ** 2, (0.1 * found.accel.bias) ** 2))
    return replace(
        found,
        name=f"{prior.name}, as found",
        source=f"By maximum likelihood from the innovations of a drive (insnav), prior: {prior.name}. {prior.source}",
        gyro=replace(found.gyro, misalignment=gyro),
        accel=replace(found.accel, misalignment=accel, bias=bias),
    )


def _figure(parameter: _Parameter, x: FloatArray, spec: ImuSpec) -> NoiseFigure:
    """Figure of a parameter and of the ends of its interval of 95 %, `x` (3,)."""
    sensor, key = parameter.key.split(".")
    values = np.concatenate([[parameter.middle], x])
    unit = ""
    if key == "share":
        values = parameter.most / (1.0 + np.exp(-values))
    elif sensor == "gps":
        values = np.exp(values)
        unit = "s" if key.endswith("_time") else ""
    else:
        of_axes = getattr(spec.gyro if sensor == "gyro" else spec.accel, key)
        values = np.exp(values) * float(np.sqrt(np.mean(of_axes**2)))
        unit = UNITS_SHOWN.get(key, ("deg/h", "ug"))[sensor == "accel"]
    told = bool(np.isfinite(x[0]) and np.ptp(x[1:]) < OBSERVABLE * parameter.sd * np.ptp(INTERVAL))
    prior, value, low, high = values.tolist()
    return NoiseFigure(parameter.key, unit, prior, value, low, high, told)


def _likelihood(ready: Prepared, spec: ImuSpec) -> InnovationLikelihood | None:
    """Innovations of a drive; none where it is too short to tell, or the filter diverges."""
    if _thinned(ready.gps).time.shape[0] < FEWEST:
        return None
    # where gates reject most fixes by what came with these, all are looked at
    for gates in (ready.settings.gates, ready.settings.gates.believing()):
        with suppress(DivergenceError):
            drive = _with_gates(ready, spec, gates)
            if drive.fixes >= max(FEWEST, MOST_REJECTED * drive.offered):
                return drive
    return None


def _with_gates(ready: Prepared, spec: ImuSpec, gates: Gates) -> InnovationLikelihood:
    """Innovations of a run with some gates, without resets if it is not lost so: they forget what sensor errors did."""
    drive = InnovationLikelihood(replace(ready, settings=replace(ready.settings, gates=gates)), spec)
    if drive.reset:
        with suppress(DivergenceError):
            without = _with_gates(ready, spec, replace(gates, reset_after=np.inf))
            if without.fixes > NOT_LOST * drive.fixes:
                return without
    return drive


def _white(found: NoiseEstimate) -> FloatArray:
    """White part of the errors of positions, horizontal and vertical, by what came with them, (2,)."""
    return np.asarray(found.position_factor[1:] * np.sqrt(1.0 - found.correlated.share))


def kind_of(found: NoiseEstimate, kinds: Sequence[ImuSpec]) -> ImuSpec:
    """The kind of IMU, of some or that of the prior, by which the figures found are likeliest: their evidence.

    Innovations tell the logarithm of a figure with an error, a normal one each, which is what the posterior density has
    beside the prior; for IMUs of one kind it is normally distributed about that of the kind.
    """
    assert found.seen is not None
    drive, kinds = found.seen[0], [found.seen[0].prior, *kinds]
    worth = np.zeros(len(kinds))
    for figure, p in zip(found.figures, drive.parameters, strict=True):
        sensor, key = figure.key.split(".")
        if not figure.observable or sensor == "gps" or key == "misalignment":
            continue
        error = 1.0 / ((np.ptp(INTERVAL) / np.log(figure.high / figure.low)) ** 2 - p.sd**-2.0)
        told = np.log(figure.value) + np.log(figure.value / figure.prior) * error / p.sd**2
        usual = [0.5 * np.log(np.mean(getattr(getattr(kind, sensor), key) ** 2)) for kind in kinds]
        worth -= 0.5 * (told - usual) ** 2 / (IMU_PRIOR[key] ** 2 + error)
    best = int(np.argmax(worth))
    return kinds[best if worth[best] > worth[0] + OTHER_KIND else 0]


def identify(
    drives: Sequence[InnovationLikelihood], kinds: Sequence[ImuSpec] = (), near: NoiseEstimate | None = None
) -> NoiseEstimate:
    """Noise in drives of one IMU, about second runs with it if the first are far off or reject fixes.

    `kinds`: what IMU it may also be, if its figures tell so; `near`: as was found with samples that hardly differ.
    """
    if near is not None and near.seen is not None:
        drives = [drive.of(near.seen[0].prior) for drive in drives]

    def likeliest(drives: Sequence[InnovationLikelihood], last: NoiseEstimate) -> NoiseEstimate:
        return maximise(drives, None if near is None else last)

    found = maximise(drives, near)
    doubtful = bool(np.min(_white(found)) > DOUBTED)
    if found.far_off or doubtful:
        with suppress(DivergenceError):
            again = [drive.again(found) for drive in drives]
            if min(drive.fixes for drive in again) >= FEWEST:  # gates may reject all that this noise is none of
                drives, found = again, likeliest(again, found)
    if doubtful:
        drives = [drive.doubted(found) for drive in drives]
        found = likeliest(drives, found)
    for _ in range(KINDS_TRIED):
        kind = kind_of(found, kinds)
        if found.seen is None or kind is found.seen[0].prior:
            break
        try:
            found = likeliest([drive.of(kind) for drive in drives], found)
        except DivergenceError:
            break
    return found


def unlike(drives: Sequence[InnovationLikelihood], found: NoiseEstimate) -> list[list[NoiseFigure]]:
    """Figures of the IMU that one of several drives has of its own, each in every drive; see `identify`.

    `found`: in all of them together. Drives by one IMU share its figures, not those of their fixes: it is another one
    where its own figures make the innovations so much likelier that chance does not, and are far from those of all.
    """
    assert found.seen is not None
    shared, figures, far = found.seen[1], [], np.zeros(found.seen[1].size, dtype=np.bool_)
    for drive in drives:
        one = drive if len(drive.parameters) == shared.size else drive.with_correlated_velocities()
        of_imu = np.array([not p.key.startswith("gps.") and not p.key.endswith("misalignment") for p in one.parameters])
        at, covariance, _ = _Posterior([one]).climb(shared)
        gain, sd = _cost(one, np.where(of_imu, shared, at)) - _cost(one, at), np.sqrt(np.diag(covariance))
        off = of_imu & (np.abs(at - shared) > np.maximum(np.log(UNLIKE), UNLIKE_SD * sd))
        far |= off & (2.0 * gain > chi2_limit(int(of_imu.sum()), CHANCE))
        values = at[:, None] + np.outer(sd, [0.0, *INTERVAL])
        figures.append([_figure(p, x, drive.prior) for p, x in zip(one.parameters, values, strict=True)])
    return [[each[i] for each in figures] for i in np.flatnonzero(far)]


def _cost(drive: InnovationLikelihood, at: FloatArray) -> float:
    return cost_of(*drive.normalised(at)) + drive.bias_seen(at)


def identify_noise(ready: Prepared, spec: ImuSpec, near: NoiseEstimate | None = None) -> NoiseEstimate | None:
    """Noise of IMU and fixes from the innovations of one drive; none where it tells none.

    `spec`: IMU error specification it was prepared with: the prior; `near`: see `identify`.
    """
    drive = _likelihood(ready, spec)
    with suppress(DivergenceError):
        return None if drive is None else identify([drive], ready.kinds, near)
    return None


def with_usual_noise(ready: Prepared) -> Prepared:
    """The recording prepared with time-correlated errors of positions as receivers have them: it tells none itself."""
    if ready.settings.correlated is not None:
        return ready
    (middle, sd), share = CORRELATION_TIME, 1.0 / (1.0 + np.exp(-SHARE[0]))
    time = float(np.exp(middle + AVERAGED["gps.correlation_time"] * sd**2))
    usual = CorrelatedNoise(share, time, np.sqrt(share) * np.median(ready.gps.position_sd, axis=0))
    note = f"{CORRELATED}: {100 * share:.0f} % of the variance, for about {time:.0f} s, assumed as usual of receivers"
    return replace(ready, settings=replace(ready.settings, correlated=usual), notes=(*ready.notes, note))


def with_known_noise(ready: Prepared, spec: ImuSpec, *, lasting: bool, sizes: bool) -> Prepared:
    """The recording prepared with the misalignments that it tells, all noise as it is specified.

    `lasting`: but for the time-correlated errors of positions, which the drive is asked for, and for the `sizes` of all
    errors of them, where these are assumed.
    """
    lasting &= sizes or ready.settings.correlated is None
    needed = lasting or ready.model.axes_sd.any()
    known = known_likelihood(ready.beginning(ENOUGH_FOR_AXES), spec) if needed else None
    if known is None:
        return ready
    drive, at = known
    if ready.model.axes_sd.any():
        with suppress(DivergenceError):
            ready = _with_axes(ready, _misalignment([drive], at, 0.0)[0])
    if not lasting:
        return replace(ready, faults=(*ready.faults, *_too_small(ready, *drive.normalised(at)[:2])))
    posterior = _Posterior([drive.of_positions(sizes=sizes)])
    starts = [np.concatenate([posterior.middle[:-2], each]) for each in STARTS]
    top, covariance, (e, s, _) = posterior.climb(min(starts, key=lambda each: posterior.innovations(each)[2]), NEAR)
    faults = _too_small(ready, e, s)
    if faults:  # time-correlated errors would stand for other noise
        return replace(ready, faults=(*ready.faults, *faults))
    plausible = posterior.plausible(top, covariance)
    position, _, correlated = posterior.drives[0].fixes_of(plausible[0])
    if sizes:
        ready = _with_fixes(ready, ready.model, position, np.ones(3))
    said = *_factor_words("position", position), _lasting_words(correlated, posterior.figures(plausible, spec))
    return replace(
        ready, settings=replace(ready.settings, correlated=correlated), notes=(*_without_correlated(ready.notes), *said)
    )


def _too_small(ready: Prepared, innovation: FloatArray, variance: FloatArray) -> tuple[Event, ...]:
    """An event if innovations are larger than the noise given allows; false fixes count little."""
    size = float(np.mean(np.minimum(innovation**2 / variance, HUBER**2)))
    text = (
        "innovations are larger than the IMU model given and the standard deviations of the fixes allow: one of "
        "them is too small; --noise estimate finds the noise of both"
    )
    event = Event(ready.initial.time, EventKind.CONTRADICTION, size, TOO_SMALL, "", text)
    return (event,) * bool(size > TOO_SMALL)


def known_likelihood(ready: Prepared, spec: ImuSpec) -> tuple[InnovationLikelihood, FloatArray] | None:
    """Innovations of a drive and the figures of its noise as it is specified; none as of `_likelihood`."""
    drive = _likelihood(ready, spec)
    if drive is None:
        return None
    at, correlated = np.array([p.middle for p in drive.parameters]), ready.settings.correlated
    at[-2] = -np.inf
    if correlated is not None:
        part = min(correlated.share / drive.parameters[-2].most, ALL)
        at[-2:] = np.log([part / (1.0 - part), correlated.time])
    return drive, at


def _with_axes(ready: Prepared, found: Misalignment) -> Prepared:
    """Samples corrected by the misalignments found, and attitude as uncertain as these leave it.

    Only where there are likelier some than none. Roll and pitch are told apart from biases by the prior of these, too:
    a correction is doubted by its own size.
    """
    imu, notes = ready.imu, ready.notes
    if found.evidence > 0.0 and (np.abs(found.attitude) > WORTH_TURNING * found.attitude_sd).any():
        imu = found.corrected(imu)
        largest = 1e3 * float(np.abs(found.terms).max())
        notes = (*notes, f"samples corrected by the misalignments found, up to {largest:.2g} mrad")
    model = replace(ready.model, axes_sd=np.hypot(found.attitude_sd, found.attitude))
    return replace(ready, imu=imu, model=model, notes=notes)


def with_noise(ready: Prepared, found: NoiseEstimate) -> Prepared:
    """The recording prepared with the noise that was found."""
    return _with_axes(_refined(ready, found), found.axes)


def _refined(ready: Prepared, found: NoiseEstimate) -> Prepared:
    model = error_model(found.filter_spec, STATES if ready.model.sd[6:].any() else STATES - 6)
    return replace(
        _with_fixes(ready, model, found.position_factor, found.velocity_factor),
        model=model,
        settings=replace(ready.settings, correlated=found.correlated),
        notes=(*_without_correlated(ready.notes), *_words(found)),
        noise=found,
    )


def _without_correlated(notes: tuple[str, ...]) -> list[str]:
    return [each for each in notes if not each.startswith(CORRELATED)]


def _with_fixes(ready: Prepared, model: ErrorModel, position: FloatArray, velocity: FloatArray) -> Prepared:
    """Fixes, and starts by them with an IMU, whose standard deviations are so many times as large, (3,) each [-]."""
    gps = replace(
        ready.gps,
        position_sd=ready.gps.position_sd * np.where(ready.gps.position_sd < OPEN_HEIGHT, position, 1.0),
        velocity_sd=ready.gps.velocity_sd * velocity,
    )
    return replace(
        ready,
        gps=gps,
        initial=_start(ready.initial, ready.alignment, model, position),
        parts=tuple(
            replace(part, initial=_start(part.initial, part.alignment, model, position)) for part in ready.parts
        ),
    )


def understated(ready: Prepared, read: GpsData) -> tuple[Event, ...]:
    """An event if innovations are far larger than the standard deviations that came with the fixes `read`."""
    found = ready.noise
    if found is None or not np.isfinite(read.position_sd).all():
        return ()
    known = bool(np.isfinite(read.velocity_sd).all())
    level, height = float(found.position_factor[:2].max()), float(found.position_factor[2])
    factors = {"positions": level, "heights": height, "velocities": float(found.velocity_factor.max()) * known}
    large = {name: factor for name, factor in factors.items() if factor >= UNDERSTATED}
    if not large:
        return ()
    most = max(large.values())
    size = " and ".join(f"{each:.2g} times as large for {name}" for name, each in large.items())
    told = f"the standard deviations of the fixes are too small: taken {size}, by the innovations"
    told += "; or a scale, clock or axis is wrong, or it is another drive" * (most > NO_NOISE)
    told += "; errors that change slowly hardly show there"
    return (Event(ready.initial.time, EventKind.CONTRADICTION, most, UNDERSTATED, "", told),)


def figure_words(figure: NoiseFigure) -> str:
    """Name, value and unit of a figure."""
    name, value = figure.key.replace(".", " ").replace("_", " "), figure.value / UNITS[figure.unit][1]
    return without_exponents(f"{name} {value:.2g} {figure.unit}")


def _words(found: NoiseEstimate) -> list[str]:
    told = [figure_words(each) for each in found.figures if each.observable and not each.key.startswith("gps.")]
    notes = [f"noise from the innovations: {', '.join(told) or 'IMU as in the preset'}"]
    for name, factor in (("position", found.position_factor), ("velocity", found.velocity_factor)):
        notes += _factor_words(name, factor)
    if found.correlated.velocity_sd is not None:
        size, time = float(np.max(found.correlated.velocity_sd)), found.correlated.velocity_time
        notes.append(
            f"time-correlated GPS velocity errors: {size:.2g} m/s, for about {time:.0f} s; estimated as states"
        )
    return [*notes, _lasting_words(found.correlated, found.figures)]


def _factor_words(name: str, factor: FloatArray) -> list[str]:
    level, _, down = factor
    told = f"GPS {name} sd times {level:.2f} horizontally, {down:.2f} vertically, from the innovations"
    return [told] if max(abs(level - 1.0), abs(down - 1.0)) > FACTOR_WORTH else []


def _lasting_words(found: CorrelatedNoise, figures: Sequence[NoiseFigure]) -> str:
    lasting = (
        f"correlation time about {found.time:.0f} s" if found.time < LONGEST else "lasting longer than the drive tells"
    )
    hardly = {"gps.share", "gps.correlation_time"} & {figure.key for figure in figures if not figure.observable}
    how = "mean of what is plausible, as the drive hardly tells" if hardly else "from the innovations"
    return f"{CORRELATED}: {100 * found.share:.0f} % of the variance, {lasting}, {how}; estimated as states"
