"""Noise of IMU and fixes, estimated from the innovations of drives and a prior. Its application and report.

Fisher scoring finds the maximum of the posterior density. The curvature there gives intervals. Noise from innovations:
R. K. Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Trans. Autom. Control 15 (1970)
175-184. From measurements instead of truth: P. Abbeel, A. Coates, M. Montemerlo, A. Y. Ng, S. Thrun, "Discriminative
training of Kalman filters", Robotics: Science and Systems (2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba.core.config import NUMBA_NUM_THREADS  # type: ignore[attr-defined]

from insnav.exceptions import DivergenceError
from insnav.filter import innovation_likelihood as likelihood
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import CARRIER, CorrelatedNoise
from insnav.filter.innovation_likelihood import InnovationLikelihood, Parameter
from insnav.filter.noise_estimate import Misalignment, NoiseEstimate, NoiseFigure, after_rest, misalignment
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec, level_bias
from insnav.sample_statistics import chi2_limit
from insnav.types import FloatArray, GpsData
from insnav.units import G0

FEWEST = 30  # least number of fixes: fewer add little information to the prior
SHORT = 600.0  # length of the record for the first search, which ends near the solution [s]
ROUNDS = 12  # largest number of iterations of Fisher scoring
STEP = 0.01  # step of numerical derivatives, in logarithms
DIGITS = 6  # decimals of the logarithms: far coarser than rounding errors, so that these have no effect
LARGEST_STEP = 1.5  # largest step of one iteration, in logarithms
ENOUGH = 0.02  # a smaller expected gain of the log-likelihood ends the search: 0.2 sd of a parameter
NEAR = 3.0  # a smaller expected gain ends the first search
BEYOND = 1.0  # change of one parameter in the search for a higher maximum, in logarithms: a factor of e
FAR = 5.0  # after a larger gain, the same derivatives serve another step
OBSERVABLE = 0.8  # a parameter is observable if its interval is at most this part of its prior interval [-]
INTERVAL = np.array([-1.96, 1.96])  # ends of 95 % of a normal distribution, in its sd
KINK = 3.0  # within this many lower sd below the centre of its prior, a parameter has the interval of the upper sd [-]
# Logarithm of the ratio of mean to most likely value, per variance of the parameter's logarithm. 0.5 for a correlation
# time (log-normal). 2 for a size: the mean variance from n errors, n = 1 / (2 sd^2), is n / (n - 2) times the mode
# (inverse gamma). An IMU has few biases.
AVERAGED = {"accel.bias": 2.0, "gps.horizontal": 2.0, "gps.vertical": 2.0, "gps.correlation_time": 0.5}
# Prior sd of the logarithm of the misalignment size: datasheets of one grade differ by a factor of two. With a wider
# prior, two or three misalignments that were small by chance made the estimate of all others too small.
SIZE_PRIOR = 0.7
UNITS_SHOWN = {
    "random_walk": ("deg/sqrt(h)", "m/s/sqrt(h)"),
    "scale_factor": ("ppm", "ppm"),
    "misalignment": ("mrad", "mrad"),
}
# start values: log odds of the time-correlated share of position errors, and logarithm of their correlation time [s]
STARTS = [np.log([share / (1.0 - share), time]) for time in (8.0, 40.0, 150.0) for share in (0.1, 0.5, 0.85)]
# Start values of a time-correlated velocity error: logarithms of relative sd and correlation time [s]. The error is
# accepted for this gain of the log-likelihood: 10 for both parameters (half the logarithm of the number of innovations
# each), and a margin of 10. A minute of drifting positions gains 15.
VELOCITY_STARTS = np.log([(share, time) for time in (30.0, 150.0) for share in (0.1, 0.3)])
VELOCITY_WORTH = 20.0
# Fixes are over-confident if their white errors alone exceed the reported sd by this factor. The whole sd is scaled by
# this excess, up to `ALIKE`, as the drive shows only a part of the time-correlated errors.
DOUBTED = 1.15
UNDERSTATED_STARTS = 1.0, 5.0, 50.0  # start values of the factor on all fix sds, as reported sds may be far too small
# A drive has another IMU if the common parameters make its innovations less probable than this. One parameter must also
# differ from the common one by more than this factor and this number of sd
CHANCE, UNLIKE, UNLIKE_SD = 1e-4, 2.0, 3.0
# least gain of log evidence for another grade of IMU [-]; number of grades tried
OTHER_KIND, KINDS_TRIED = 2.0, 2

_Seen = tuple[FloatArray, FloatArray, float]  # innovations, their variances, and the cost of a parameter set


@dataclass(frozen=True, slots=True)
class DriveNoise(NoiseEstimate):
    """Noise estimate of drives, with the innovations from which it was made."""

    seen: tuple[InnovationLikelihood, FloatArray]  # innovations of the first drive, and parameters
    cost: float  # negative log posterior density, plus `VELOCITY_WORTH` if velocity errors are time-correlated


class Posterior:
    """Posterior density of the noise parameters of drives that share one IMU."""

    def __init__(self, drives: Sequence[InnovationLikelihood]) -> None:
        self.drives, self.parameters = drives, drives[0].parameters
        self.middle = np.array([p.middle for p in self.parameters])
        self._sd = np.array([[p.sd, p.sd_below] for p in self.parameters]).T

    def weight(self, at: FloatArray) -> FloatArray:
        """Compute the curvature of the prior for parameters `at`."""
        curvature: FloatArray = np.where(at >= self.middle, self._sd[0], self._sd[1]) ** -2.0
        return curvature

    def plausible(self, top: FloatArray, covariance: FloatArray) -> FloatArray:
        """Compute the mean of each parameter over its plausible values, and the ends of its 95 % interval: (3, k).

        The most likely size is too small if it comes from few errors, or from time-correlated errors in a short drive.
        With a broad prior, the mean may be larger than in any IMU: the interval limits it.
        """
        variance = np.diag(covariance)
        low, high = top + np.outer(INTERVAL, np.sqrt(variance))
        wide = np.minimum(top + variance * [AVERAGED.get(p.key, 0.0) for p in self.parameters], high)
        return np.array([wide, low, high])

    def innovations(self, at: FloatArray) -> _Seen:
        """Compute innovations, their variances, and the cost (negative log posterior density) of parameters `at`."""
        parts = [drive.normalised(at) for drive in self.drives]
        e, s = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        return e, s, likelihood.cost_of(e, s) + self._before(at)

    def _side_by_side(self, cases: Sequence[FloatArray]) -> list[_Seen]:
        """Evaluate several parameter sets in as many threads as numba may use. Its kernel releases the lock."""
        with ThreadPoolExecutor(min(len(cases), NUMBA_NUM_THREADS)) as pool:
            return list(pool.map(self.innovations, cases))

    def _before(self, at: FloatArray) -> float:
        """Compute the cost of a parameter set by the prior alone."""
        deviation = np.where(np.isfinite(at), at - self.middle, 0.0)
        return 0.5 * float(np.sum(self.weight(at) * deviation**2)) + sum(drive.bias_seen(at) for drive in self.drives)

    def climb(self, at: FloatArray, settled: float = ENOUGH) -> tuple[FloatArray, FloatArray, _Seen]:
        """Find a maximum of the posterior density by damped Fisher scoring, with covariance and innovations.

        The observed change of slope replaces the curvature along the last step. On a ridge, as with time-correlated
        errors, scoring alone oscillates and ends up to 80 nats too low. An iteration keeps the derivatives of the
        innovations for further steps, while these gain enough. The search ends if a step promises less than `settled`.
        """
        seen = self.innovations(at)
        damping, steps, last, moved = 1e-3, STEP * np.eye(at.size), np.zeros(at.size), np.zeros(at.size)
        for _ in range(ROUNDS):
            (e, s, start), by_e, by_s = seen, *np.empty((2, at.size, seen[0].size))
            for i, (e1, s1, _) in enumerate(self._side_by_side(list(at + steps))):
                by_e[i], by_s[i] = (e1 - e) / STEP, (s1 - s) / STEP / s
            weighted_by_e = by_e / np.sqrt(s * np.maximum(np.abs(e) / np.sqrt(s) / likelihood.HUBER, 1.0))
            weight = self.weight(at)
            fisher = weighted_by_e @ weighted_by_e.T + 0.5 * by_s @ by_s.T + np.diag(weight)
            slope = self._slope(at, seen, by_e, by_s)
            curvature, last, moved = _bent(fisher, moved, slope - last), slope, np.zeros(at.size)
            if 0.5 * slope @ np.linalg.solve(curvature, slope) < settled:
                break
            gained = np.inf  # further steps with the same derivatives, while they gain enough
            while gained > FAR and damping < 1e4:
                move = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope)
                move *= min(1.0, LARGEST_STEP / float(np.max(np.abs(move))))
                candidate = np.asarray(np.round(at + move, DIGITS), dtype=np.float64)
                result = self.innovations(candidate)
                if result[2] < seen[2]:
                    gained, damping = seen[2] - result[2], max(1e-6, 0.1 * damping)
                    at, seen, moved = candidate, result, moved + move
                    slope = self._slope(at, seen, by_e, by_s)
                elif start == seen[2]:
                    damping = 10.0 * max(damping, 1e-3)
                else:
                    break
            if start == seen[2]:
                break
        fisher += np.diag(self.weight(at + KINK * self._sd[1]) - weight)
        return at, np.linalg.inv(fisher).astype(np.float64), seen

    def likeliest(self, cases: Sequence[FloatArray]) -> tuple[FloatArray, float]:
        """Find the parameter set of lowest cost, with its cost."""
        costs = [found[2] for found in self._side_by_side(cases)]
        return min(zip(cases, costs, strict=True), key=lambda each: each[1])

    def find_top(self, at: FloatArray) -> tuple[FloatArray, FloatArray, _Seen]:
        """Find a maximum. Repeat from a point beyond a barrier: one parameter changed by `BEYOND`, if more likely."""
        top = self.climb(at)
        while True:
            best, cost = self.likeliest(list(top[0] + BEYOND * np.vstack([np.eye(at.size), -np.eye(at.size)])))
            if not cost < top[2][2]:  # stop also if a cost is NaN
                return top
            top = self.climb(best)

    def _slope(self, at: FloatArray, seen: _Seen, by_e: FloatArray, by_s: FloatArray) -> FloatArray:
        """Compute the slope of the cost from derivatives of the innovations and of the logarithms of their variances.

        Finite differences of the cost would contain its curvature, which is large at the sharp maxima of precise fixes.
        """
        e, s, _ = seen
        u, before = e / np.sqrt(s), self._before(at)
        pull = np.clip(u, -likelihood.HUBER, likelihood.HUBER)
        prior = [self._before(at + step) - before for step in STEP * np.eye(at.size)]
        slope: FloatArray = by_e @ (pull / np.sqrt(s)) + 0.5 * by_s @ (likelihood.CLEAN - pull * u)
        return slope + np.array(prior) / STEP


def _bent(curvature: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """Update a curvature to the observed change of slope along a step, as in BFGS.

    J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., Springer 2006, eq. (6.19).
    """
    if step @ change <= 0.0:
        return curvature
    along = curvature @ step
    return curvature + np.outer(change, change) / (step @ change) - np.outer(along, along) / (step @ along)


def _begun(posterior: Posterior) -> FloatArray:
    """Find initial parameters from the first part of the record: climb from the most likely of several start values."""
    middle, gps = posterior.middle[:-2], np.array([p.key.startswith("gps.") for p in posterior.parameters[:-2]])
    starts = [np.concatenate([middle + np.log(factor) * gps, each]) for factor in UNDERSTATED_STARTS for each in STARTS]
    short = Posterior([drive.beginning(SHORT) for drive in posterior.drives])
    return short.climb(short.likeliest(starts)[0], NEAR)[0]


def maximise(drives: Sequence[InnovationLikelihood]) -> DriveNoise:
    """Find the noise parameters of largest posterior density, common to all drives, and the misalignments."""
    posterior = Posterior(drives)
    white = posterior.middle.copy()
    white[-2] = -np.inf  # no time-correlated share of position errors
    before = posterior.innovations(white)
    begun = _begun(posterior)
    top, covariance, (e, s, cost) = posterior.find_top(begun)  # e, s: innovations and their variances
    penalty = 0.0
    if any(p.key == "gps.velocity" for p in posterior.parameters):  # test a time-correlated velocity error
        wider = Posterior([drive.with_correlated_velocities() for drive in drives])
        sets, count = (top, begun, posterior.middle), len(VELOCITY_STARTS)
        starts = [np.concatenate([at[:-2], velocity, at[-2:]]) for at in sets for velocity in VELOCITY_STARTS]
        start, start_cost = wider.likeliest(starts[:-count])
        if start_cost < cost:  # start also at the prior: position and IMU errors may have absorbed velocity errors
            tops = [wider.climb(each) for each in (start, wider.likeliest(starts[-count:])[0])]
            at, at_cov, wider_result = min(tops, key=lambda climbed: climbed[2][2])
            if wider_result[2] < cost - VELOCITY_WORTH:
                posterior, top, covariance, (e, s, cost), penalty = wider, at, at_cov, wider_result, VELOCITY_WORTH
    drive = posterior.drives[0]
    plausible = posterior.plausible(top, covariance)
    position, velocity, correlated = drive.fixes_of(plausible[0])
    filter_spec = drive.spec(plausible[0])
    axes, far_off = misalignments(posterior.drives, top, SIZE_PRIOR)
    return DriveNoise(
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
        gain=before[2] - cost,
        mean_before=float(np.mean(before[0] ** 2 / before[1])),
        mean_after=float(np.mean(e**2 / s)),
        far_off=far_off,
        seen=(drive, top),
        cost=cost + penalty,
    )


def misalignments(drives: Sequence[InnovationLikelihood], at: FloatArray, prior_sd: float) -> tuple[Misalignment, bool]:
    """Estimate the common misalignments of all drives, and test whether attitude errors of a run were too large."""
    fisher, slope, turned, far_off = zip(*(drive.by_axes(at) for drive in drives), strict=True)
    fisher, slope = np.sum(fisher, axis=0), np.sum(slope, axis=0)
    return misalignment(fisher, slope, turned[0], drives[0].misalignment_sd, prior_sd), any(far_off)


def _turned(prior: ImuSpec, found: ImuSpec, size: float) -> ImuSpec:
    """Build the estimated IMU: multiply misalignments by `size`, and subtract their effect on gravity from the bias."""
    gyro, accel = (size * sensor.misalignment for sensor in (prior.gyro, prior.accel))
    bias = np.sqrt(np.maximum(level_bias(found.accel) ** 2 - (G0 * accel) ** 2, (0.1 * found.accel.bias) ** 2))
    return replace(
        found,
        name=f"{prior.name}, as found",
        source=f"By maximum likelihood from the innovations of a drive (insnav), prior: {prior.name}. {prior.source}",
        gyro=replace(found.gyro, misalignment=gyro),
        accel=replace(found.accel, misalignment=accel, bias=bias),
    )


def _figure(parameter: Parameter, x: FloatArray, spec: ImuSpec) -> NoiseFigure:
    """Convert a parameter and the ends of its 95 % interval, `x` (3,), from logarithms to SI."""
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
    observable = bool(np.isfinite(x[0]) and np.ptp(x[1:]) < OBSERVABLE * parameter.sd * np.ptp(INTERVAL))
    prior, value, low, high = values.tolist()
    return NoiseFigure(parameter.key, unit, prior, value, low, high, observable)


def kind_of(noise: DriveNoise, kinds: Sequence[ImuSpec]) -> ImuSpec:
    """Select the grade of IMU that fits the estimated parameters best, from `kinds` and the grade of the prior.

    Innovations determine the logarithm of a parameter with a normal error: the posterior density without the prior.
    Logarithms of IMUs of one grade are normally distributed about the values of the grade.
    """
    drive, kinds = noise.seen[0], [noise.seen[0].prior, *kinds]
    evidence = np.zeros(len(kinds))
    for figure, p in zip(noise.figures, drive.parameters, strict=True):
        sensor, key = figure.key.split(".")
        if not figure.observable or sensor == "gps" or key == "misalignment":
            continue
        error = 1.0 / ((np.ptp(INTERVAL) / np.log(figure.high / figure.low)) ** 2 - p.sd**-2.0)
        measured = np.log(figure.value) + np.log(figure.value / figure.prior) * error / p.sd**2
        of_kinds = [0.5 * np.log(np.mean(getattr(getattr(kind, sensor), key) ** 2)) for kind in kinds]
        evidence -= 0.5 * (measured - of_kinds) ** 2 / (likelihood.IMU_PRIOR[key] ** 2 + error)
    best = int(np.argmax(evidence))
    return kinds[best if evidence[best] > evidence[0] + OTHER_KIND else 0]


def identify(drives: Sequence[InnovationLikelihood], kinds: Sequence[ImuSpec] = ()) -> DriveNoise:
    """Estimate the noise of drives of one IMU. Repeat runs with it if the first ones are nonlinear or reject fixes.

    `kinds`: grades of IMU that may replace the prior, if the estimates fit them better.
    """
    drives = [drives[0], *(drive.of(drives[0].prior) for drive in drives[1:])]  # parameters are factors on one prior
    estimate = maximise(drives)
    doubtful = bool(np.min(estimate.white) > DOUBTED)
    with suppress(DivergenceError):
        for first in (True, False):
            if not (estimate.far_off or (first and doubtful)):
                break
            again = [drive.again(estimate) for drive in drives]
            if min(drive.fixes for drive in again) < FEWEST:  # gates may reject all fixes with this noise
                break
            drives, estimate = again, maximise(again)
    if doubtful:
        drives = [drive.doubted(estimate) for drive in drives]
        estimate = maximise(drives)
    for _ in range(KINDS_TRIED):
        kind = kind_of(estimate, kinds)
        if kind is estimate.seen[0].prior:
            break
        try:
            of_kind = maximise([drive.of(kind) for drive in drives])
        except DivergenceError:
            break
        if of_kind.cost >= estimate.cost:
            break
        estimate = of_kind
    return estimate


def unlike(drives: Sequence[InnovationLikelihood], noise: DriveNoise) -> list[list[NoiseFigure]]:
    """Find IMU parameters for which a drive differs from the others. Returns the figures of all drives for each.

    `noise`: common estimate, see `identify`. Drives of one IMU share its parameters, but not the parameters of their
    fixes. A drive has another IMU if different parameters raise its likelihood beyond chance.
    """
    shared, figures, differing = noise.seen[1], [], np.zeros(noise.seen[1].size, dtype=np.bool_)
    for drive in drives:
        one = drive if len(drive.parameters) == shared.size else drive.with_correlated_velocities()
        of_imu = np.array([not p.key.startswith("gps.") and not p.key.endswith("misalignment") for p in one.parameters])
        own_top, covariance, _ = Posterior([one]).climb(shared)
        gain, sd = _cost(one, np.where(of_imu, shared, own_top)) - _cost(one, own_top), np.sqrt(np.diag(covariance))
        differs = of_imu & (np.abs(own_top - shared) > np.maximum(np.log(UNLIKE), UNLIKE_SD * sd))
        differing |= differs & (2.0 * gain > chi2_limit(int(of_imu.sum()), CHANCE))
        values = own_top[:, None] + np.outer(sd, [0.0, *INTERVAL])
        figures.append([_figure(p, x, drive.prior) for p, x in zip(one.parameters, values, strict=True)])
    return [[each[i] for each in figures] for i in np.flatnonzero(differing)]


def _cost(drive: InnovationLikelihood, at: FloatArray) -> float:
    return likelihood.cost_of(*drive.normalised(at)) + drive.bias_seen(at)


NOT_LOST = 0.95  # a run without resets is valid if it accepts this share of the fixes of a run with resets [-]
LEAST_ACCEPTED = 0.3  # least share of accepted fixes; with fewer, repeat without statistical gate [-]
TOO_SMALL = 1.5  # largest mean normalised squared innovation with specified noise; correct noise gives up to 1.1 [-]
ENOUGH_FOR_AXES = 900.0  # length of the record to estimate only misalignments [s]
WORTH_TURNING = 0.5  # misalignments correct the samples if their effect exceeds this share of its uncertainty [-]
UNDERSTATED = 2.0  # report factors on reported sds whose whole interval is above this [-]
NO_NOISE = 10.0  # larger factors are no noise: the user should check scale, clock, axes and drive [-]
FEET, ALIKE_IN_METRES = (2.7, 4.0), 2.0  # height factors that indicate feet (3.28); least ratio to horizontal factor
FACTOR_WORTH = 0.1  # least reported change of a standard deviation [-]
# suffix of names with SI units in findings, by display unit
SUFFIXES = {
    "deg/sqrt(h)": "_rad_sqrt_s",
    "m/s/sqrt(h)": "_m_s_sqrt_s",
    "deg/h": "_rad_s",
    "ug": "_m_s2",
    "mrad": "_rad",
    "ppm": "",
}


def identify_noise(ready: FilterInput, spec: ImuSpec, kinds: Sequence[ImuSpec] = ()) -> DriveNoise | None:
    """Estimate the noise of IMU and fixes from the innovations of one drive. None if the drive is unsuitable.

    `spec`: IMU error specification, which serves as prior. `kinds`: alternative grades, if none was specified.
    """
    drive = _likelihood(ready, spec)
    with suppress(DivergenceError):
        return None if drive is None else identify([drive], kinds)
    return None


def known_likelihood(ready: FilterInput, spec: ImuSpec) -> tuple[InnovationLikelihood, FloatArray] | None:
    """Return the innovations of a drive, and its specified noise as parameters. None as in `_likelihood`."""
    drive = _likelihood(ready, spec)
    if drive is None:
        return None
    parameters, correlated = np.array([p.middle for p in drive.parameters]), ready.receiver.correlated
    parameters[-2] = -np.inf
    if correlated is not None:
        part = min(correlated.share / drive.parameters[-2].most, likelihood.ALL)
        parameters[-2:] = np.log([part / (1.0 - part), correlated.time])
    return drive, parameters


def _likelihood(ready: FilterInput, spec: ImuSpec) -> InnovationLikelihood | None:
    """Compute the innovations of a drive. None if it has too few accepted fixes, or if the filter diverges."""
    if likelihood.thinned(ready.gps).time.shape[0] < FEWEST:
        return None
    # reported sds that are too small make the gates reject most fixes: repeat without the statistical gate
    for gates in (ready.gates, ready.gates.believing()):
        with suppress(DivergenceError):
            drive = _with_gates(ready, spec, gates)
            if drive.fixes >= max(FEWEST, LEAST_ACCEPTED * drive.offered):
                return drive
    return None


def _with_gates(ready: FilterInput, spec: ImuSpec, gates: Gates) -> InnovationLikelihood:
    """Run with given gates, without resets if possible: a reset discards the effect of sensor errors."""
    drive = InnovationLikelihood(replace(ready, gates=gates), spec)
    if drive.reset:
        with suppress(DivergenceError):
            without = _with_gates(ready, spec, replace(gates, reset_after=np.inf))
            if without.fixes > NOT_LOST * drive.fixes:
                return without
    return drive


def with_noise(ready: FilterInput, noise: NoiseEstimate) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Apply the estimated noise and misalignments to a prepared recording, and report both."""
    ready, turned = _with_axes(ready.apply_noise(noise), noise.axes)
    return ready, (*_report(noise), *turned)


def with_rest(ready: FilterInput, found: NoiseEstimate | None, assumed: ImuSpec) -> FilterInput:
    """Reduce the gyro bias sd of stationary alignments by the estimated noise. `assumed`: the IMU of the alignment."""
    if found is None:
        return ready
    spec = found.spec
    starts = (replace(part, alignment=after_rest(part.alignment, assumed, spec)) for part in ready.starts)
    return replace(ready, starts=tuple(starts)).scale_sds(ready.model, np.ones(3), np.ones(3))


def usual_time() -> float:
    """Return the mean of the prior for the correlation time of position errors [s]."""
    middle, sd = likelihood.CORRELATION_TIME
    return float(np.exp(middle + AVERAGED["gps.correlation_time"] * sd**2))


def with_usual_noise(ready: FilterInput) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Apply typical time-correlated position errors, for a drive that does not determine them."""
    if ready.receiver.correlated is not None:
        return ready, ()
    time, share = usual_time(), 1.0 / (1.0 + np.exp(-likelihood.SHARE[0]))
    noise = CorrelatedNoise.of_fixes(share, time, ready.gps.position_sd)
    note = Finding.of(Code.ESTIMATE_CORRELATED_USUAL, share=share, time_s=time)
    return ready.replace_correlated(noise), (note,)


def with_known_noise(
    ready: FilterInput, spec: ImuSpec, *, lasting: bool, sizes: bool
) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Apply the misalignments that the drive determines, and keep the specified noise.

    `lasting`: estimate also the time-correlated errors of positions. `sizes`: estimate also the standard deviations of
    positions, if these are only assumed.
    """
    lasting &= sizes or ready.receiver.correlated is None
    needed = lasting or ready.model.axes_sd.any()
    likelihood_and_values = known_likelihood(ready.beginning(ENOUGH_FOR_AXES), spec) if needed else None
    if likelihood_and_values is None:
        return ready, ()
    drive, values, turned = *likelihood_and_values, tuple[Finding, ...]()
    if ready.model.axes_sd.any():
        with suppress(DivergenceError):
            ready, turned = _with_axes(ready, misalignments([drive], values, 0.0)[0])
    if not lasting:
        return ready, (*turned, *_too_small(ready, *drive.normalised(values)[:2]))
    faults: tuple[Finding, ...] = ()
    for velocities in (False, True):  # if innovations are too large, estimate velocity sds, too
        posterior = Posterior([drive.of_fixes(positions=sizes, velocities=velocities)])
        starts = [np.concatenate([posterior.middle[:-2], each]) for each in STARTS]
        top, covariance, (e, s, _) = posterior.climb(posterior.likeliest(starts)[0])
        if not (faults := faults or _too_small(ready, e, s)):
            break
    plausible = posterior.plausible(top, covariance)
    position, velocity, correlated = posterior.drives[0].fixes_of(plausible[0])
    ready = ready.scale_sds(ready.model, position, velocity)
    estimates = [_figure(p, x, spec) for p, x in zip(posterior.parameters, plausible.T, strict=True)]
    reports = *_report_factor(Code.ESTIMATE_POSITION_SD, position), _report_correlated(correlated, estimates)
    return ready.replace_correlated(correlated), (*turned, *faults, *reports)


def _too_small(ready: FilterInput, innovation: FloatArray, variance: FloatArray) -> tuple[Finding, ...]:
    """Report innovations that are larger than the specified noise allows. False fixes have limited effect."""
    size = float(np.mean(np.minimum(innovation**2 / variance, likelihood.HUBER**2)))
    given = Finding.of(Code.GIVEN_NOISE, ready.initial.time, mean_square=size, limit_mean_square=TOO_SMALL)
    return (given,) * bool(size > TOO_SMALL)


def _with_axes(ready: FilterInput, found: Misalignment) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Correct samples for the estimated misalignments, and set the remaining attitude uncertainty.

    Samples are corrected only if misalignments are more likely than none. The correction adds its own size to the
    uncertainty, as only the bias prior separates misalignments in roll and pitch from biases.
    """
    imu, turned = ready.imu, tuple[Finding, ...]()
    if found.evidence > 0.0 and (np.abs(found.attitude) > WORTH_TURNING * found.attitude_sd).any():
        imu = found.corrected(imu)
        turned = (Finding.of(Code.ESTIMATE_MISALIGNMENT, angle_rad=np.abs(found.terms).max()),)
    model = replace(ready.model, axes_sd=np.hypot(found.attitude_sd, found.attitude))
    return replace(ready, imu=imu, model=model), turned


def understated(found: NoiseEstimate | None, read: GpsData, begin: float) -> tuple[Finding, ...]:
    """Report fixes whose errors are certainly far larger than their reported standard deviations.

    `read`: fixes as read from the file. `begin`: time of the findings [s].
    """
    if found is None or not np.isfinite(read.position_sd).all():
        return ()
    significant = {each.key for each in found.figures if each.low >= UNDERSTATED}
    level, height = float(found.position_factor[:2].max()), float(found.position_factor[2])
    velocities = bool({"gps.velocity", "gps.vertical_velocity"} & significant) and np.isfinite(read.velocity_sd).all()
    factors: dict[str, Any] = {
        "position_factor": level * ("gps.horizontal" in significant),
        "height_factor": height * ("gps.vertical" in significant),
        "velocity_factor": float(found.velocity_factor.max()) * velocities,
    }
    if not (large := {name: factor for name, factor in factors.items() if factor > 0.0}):
        return ()
    code = Code.NOISE_SD_IMPLAUSIBLE if max(large.values()) > NO_NOISE else Code.NOISE_SD_UNDERSTATED
    findings = [Finding.of(code, begin, **large, limit_factor=UNDERSTATED)]
    noisy = np.median(read.position_sd[:, 2]) > CARRIER  # in precise fixes, feet show as wrong motion, not noise
    if noisy and FEET[0] < height < FEET[1] and height > ALIKE_IN_METRES * level:
        findings.append(Finding.of(Code.NOISE_HEIGHTS_IN_FEET, begin, height_factor=height, position_factor=level))
    return tuple(findings)


def _report(found: NoiseEstimate) -> list[Finding]:
    """Build the findings on the estimated noise of IMU and fixes."""
    imu = [figure for figure in found.figures if figure.observable and not figure.key.startswith("gps.")]
    figures: dict[str, Any] = {f"{each.key.replace('.', '_')}{SUFFIXES[each.unit]}": each.value for each in imu}
    findings = [Finding.of(Code.ESTIMATE_NOISE if figures else Code.ESTIMATE_NOISE_PRESET, **figures)]
    findings += _report_factor(Code.ESTIMATE_POSITION_SD, found.position_factor)
    findings += _report_factor(Code.ESTIMATE_VELOCITY_SD, found.velocity_factor)
    if found.correlated.velocity_sd is not None:
        size, time = np.max(found.correlated.velocity_sd), found.correlated.velocity_time
        findings.append(Finding.of(Code.ESTIMATE_CORRELATED_VELOCITY, sd_m_s=size, time_s=time))
    return [*findings, _report_correlated(found.correlated, found.figures)]


def _report_factor(code: Code, factor: FloatArray) -> list[Finding]:
    level, _, down = factor
    changed = max(abs(level - 1.0), abs(down - 1.0)) > FACTOR_WORTH
    return [Finding.of(code, horizontal_factor=level, vertical_factor=down)] * bool(changed)


def _report_correlated(found: CorrelatedNoise, figures: Sequence[NoiseFigure]) -> Finding:
    hardly = {"gps.share", "gps.correlation_time"} & {figure.key for figure in figures if not figure.observable}
    code = Code.ESTIMATE_CORRELATED_PLAUSIBLE if hardly else Code.ESTIMATE_CORRELATED
    time: Any = {"time_s": found.time} if found.time < likelihood.LONGEST else {"longer_than_s": likelihood.LONGEST}
    return Finding.of(code, share=found.share, **time)
