"""Delay of fixes behind their timestamps, by profile likelihood; test of a specified delay, lever arm or heading.

The filter has the delay as a linear state. From zero it stops half way to 0.3 s, at a local top of the likelihood, and
distorts attitude and lever arm. This module computes the likelihood of the fixes on a grid of delays, each with its
best attitude, biases and lever arm (`insnav.filter.late_fixes`; profile likelihood: Murphy and van der Vaart, "On
profile likelihood", J. Am. Stat. Assoc. 95 (2000) 449-465). It shifts the samples to the best delay, where the filter
is linear enough. With a clock error of half the vibration period, vibration gives a lever arm wrong by metres.
Vibration is used only after the shift.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.alignment.align import THEN_FILTER
from insnav.alignment.in_motion import SPAN, STEADY, bias_by_course, gives_velocities, sure_motion
from insnav.attitude import dcm_from_quat, quat_from_rph, rph_from_quat, wrap_pi
from insnav.exceptions import DivergenceError, InputError
from insnav.filter.ambiguity import with_wider_sd
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import aside
from insnav.filter.gps_noise import LAG_WORTH, name_lag, velocity_lag
from insnav.filter.innovation_likelihood import HUBER
from insnav.filter.late_fixes import BLOCKS, REACH, LateFixes
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.noise_identification import SHORT, usual_errors
from insnav.filter.prepare import align_again
from insnav.filter.receiver import Lag, Receiver
from insnav.filter.smoother import History
from insnav.findings import Code, Finding
from insnav.kernels.errorstate import feed_back
from insnav.types import Alignment, FloatArray, Run, Trajectory
from insnav.units import DEG, DEG_PER_SQRT_H

GRID = 0.1  # first steps: the likelihood of a delay is as wide as a manoeuvre [s]
COARSE = np.arange(-REACH, REACH + 0.5 * GRID, GRID)
FINE = 0.02  # further steps around the best value; then a parabola [s]
NEAR = FINE * np.arange(-round(GRID / FINE), round(GRID / FINE) + 1)
DRIFTS = FINE * np.arange(-10, 11)  # of the delay, from the middle to the ends of the record; one step is ignored [s]
LARGEST_DRIFT = 4e-4  # no crystal drifts more [s/s]
LONGEST = 900.0  # part of the record that is used [s]
FIXES = 600  # used at most, in addition to a long stationary start
# The filter state estimates smaller delays. With larger ones, vibration in rotation at 8 Hz biases the lever arm
# permanently. A smaller sd of a lag needs no state: at 2 m/s^2 it makes 6 mm/s [s]
WORTH = 0.003
DOUBTFUL = 0.03  # larger delays and standard deviations are estimated again [s]
WIDEST = 0.5  # largest initial sd of the filter's delay, if the drive hardly determines it [s]
SURE, REFINED = 4.0, 2.0  # significance of a delay in standard deviations; with other evidence
ROUNDS = 3  # of moving the clock
BACK = 0.5  # reject a move and the next if that reverses more than this part of it, within the filter's reach
LEAST_OTHER, OTHER_WORTH = 0.03, 0.45  # vibration lever arm: smallest, and size from which it becomes states [m]
# Sampling instants averaged into a velocity, in lags before the fix: one, many since the previous fix, or a low-pass
# filter
MOMENTS = (1.0,), tuple(0.25 * np.arange(0.5, 8.0)), tuple(-1.0109 * np.log(1.0 - np.arange(0.5, 32.0) / 32.0))
LAGS = 0.2 * np.arange(-1, 6)  # initial values of the lag search, relative to the assumed lag [s]
NEWTON, LAG_STEP = 6, 0.005  # Newton steps, and step of the derivatives [s]
# Prior: share of receivers with a lag, and its sd. Doppler counted since the previous fix lags by half an interval, a
# filter in the receiver by its time constant. No Newton step exceeds this sd [s]
LAGGING, LAG_SD = 0.1, 0.2
# multiple of the lag sd from fixes alone, and least value [s]: in a town the lag was wrong by eight sd
ALONE, ALONE_LEAST = 3.0, 0.02
OPENED, FREEDOM = 2.0, 3.0  # initial factor on the prior scale of a lever arm; its degrees of freedom
STARTS = 2  # repetitions of a start in motion, each from the previous run
# factor on attitude sd for that start: with 2, heading sds of recorded minutes were half to a quarter of the errors
LOOKED_START = 5.0
LOOKED = 2.0  # factor on the sd of the first run for the second: counts its measurements little twice
LEAST_START = 0.5 * DEG  # least initial sd of attitude [rad]
TRUE_FIXES = 0.9  # least share of accepted fixes in the first run
POOR = 3.0, 0.5  # sd of positions [m] and velocities [m/s] for another run otherwise
# Mean normalised squared innovation with all fixes accepted, at the best delay. Recorded RTK had 2 to 4, and 97 with a
# drag of half a minute
EXPLAINED = 10.0
BETTER = 0.5  # least decrease of the misfit with another clock, all fixes accepted, where gates reject many
WORSE = 0.02  # largest chance increase of the misfit per fix after a correct shift (up to 0.0095 seen)
# The misfit grows further where vibration distorts a start in motion. The shift is still accepted if the next search
# finds no further delay and the cost per measured value falls by this much [-]
CHEAPER = 0.1


@dataclass(frozen=True, slots=True)
class Aligned:
    """Recording ready for the filter, on the clock of its fixes."""

    ready: FilterInput
    findings: tuple[Finding, ...]
    clock: float = 0.0  # shift of the samples to fix time at the middle of the record [s]: the estimated delay
    rate: float = 0.0  # rate of this shift [s/s]


@dataclass(frozen=True, slots=True)
class Filtered:
    """Result of the filter over the beginning of a drive, with the clock of its samples unchanged."""

    ready: FilterInput  # the beginning
    used: FilterInput  # the navigated input: the beginning, with other receiver and gates
    epochs: FloatArray | None  # see `insnav.kernels.smoother.keep`; none if the filter diverged
    delay: float  # final delay state, and its standard deviation [s]
    delay_sd: float
    # sd of each component: vibration lever arm, and prior of the lever arm [m]
    shaken: float
    lever_sd: float
    # misfit of the fixes, and mean normalised squared innovation [-], see `Record.misfit`
    misfit: float
    squares: float


def filtered(ready: FilterInput, *, starts: int | None = None) -> Filtered:
    """Navigate the beginning of a drive for the comparison of clocks.

    A start in motion is navigated again, `starts` times.
    """
    ready = ready if starts is not None else _thinned(ready.beginning(LONGEST))
    starts = STARTS if starts is None else starts
    # a late fix looks false in every bend, and a reset would open heading and biases
    gates = replace(ready.gates, reset_after=np.inf)
    receiver, lever_arm, lever_sd = ready.receiver, ready.receiver.lever_arm, ready.receiver.lever_arm.sd
    other = float(np.hypot(OPENED * lever_sd, np.linalg.norm(lever_arm.value)))
    opened, delay = replace(lever_arm, sd=OPENED * lever_sd, shaken=other), replace(receiver.delay, settled=False)
    correlated = receiver.correlated or usual_errors(ready.gps.position_sd)
    receiver = replace(receiver, lever_arm=opened, delay=delay, correlated=correlated)
    used = replace(ready.keep_history(), receiver=receiver, gates=gates)
    navigator = Navigator(used)
    try:
        feed(navigator, ready.imu)
        history = navigator.history()
        epochs = history.rows()
        again = with_surer_start(ready, history) if starts else None
    except (DivergenceError, InputError):  # it diverged, perhaps to a pole
        return Filtered(ready, used, None, 0.0, np.inf, 0.0, lever_sd, np.inf, np.inf)
    if starts and again is None and ready.alignment.static is None:  # gates reject fixes after a bad start
        other_run = Navigator(_doubted(_believed(used)))
        with suppress(DivergenceError, InputError):  # false fixes may lead a run without gates away
            feed(other_run, ready.imu)
            again = with_surer_start(ready, other_run.history())
    if again is not None:
        return filtered(again, starts=starts - 1)
    (arm, vibration), (arm_cov, vibration_cov) = navigator.levers()
    if lever_sd > 0.0:
        scales = lever_sd * np.geomspace(1.0, OPENED)
        # most antennas are within a metre, a few at five: Student's distribution in three dimensions, that is, a normal
        # distribution of unknown variance
        prior = -FREEDOM * (np.log(scales) + 0.5 * (lever_sd / scales) ** 2)
        lever_sd = scale_of(arm, arm_cov, OPENED * lever_sd, scales, prior)[0]
    shaken = 0.0
    if other > 0.0:
        shaken = scale_of(vibration, vibration_cov, other, np.geomspace(LEAST_OTHER, other))[1]
    shaken = shaken if shaken > OTHER_WORTH else 0.0
    return Filtered(ready, used, epochs, *navigator.delay, shaken, lever_sd, *navigator.misfit())


def _believed(ready: FilterInput) -> FilterInput:
    """Return a recording whose fixes are accepted whatever their innovation."""
    return replace(ready, gates=replace(ready.gates.believing(), max_speed=np.inf))


def _doubted(ready: FilterInput) -> FilterInput:
    """Return a recording with very uncertain fixes."""
    position_sd, velocity_sd = np.hypot(ready.gps.position_sd, POOR[0]), np.hypot(ready.gps.velocity_sd, POOR[1])
    return replace(ready, gps=replace(ready.gps, position_sd=position_sd, velocity_sd=velocity_sd))


def _thinned(ready: FilterInput) -> FilterInput:
    """Thin the fixes of the part that is used; keep the fix of the start, drop certainly false fixes."""
    ready = replace(ready, gps=ready.gps.rows(~aside(ready.gates, ready.gps)))
    time = ready.gps.time
    number = np.floor((time - time[0]) / (min(time[-1] - time[0], LONGEST) / FIXES) + 1e-6)
    wanted = np.diff(number, prepend=-1.0) > 0.0
    wanted[np.argmin(np.abs(ready.fix_time - ready.initial.time))] = True  # the fix of the known attitude
    return replace(ready, gps=ready.gps.rows(np.flatnonzero(wanted)))


def scale_of(
    off: FloatArray, covariance: FloatArray, opened: float, scales: FloatArray, prior: ArrayLike = 0.0
) -> tuple[float, float]:
    """Estimate the sd of a zero-mean prior of three numbers: its most likely value, and its RMS over all `scales`.

    Empirical and full Bayes: B. P. Carlin and T. A. Louis, "Bayes and empirical Bayes methods for data analysis"
    (Chapman and Hall 2000), chapters 2 and 3.

    `off` (3,): estimates with prior sd `opened`, and their covariance. `scales`, `prior`: standard deviations, and the
    logarithm of their prior probability.
    """
    variance, axes = np.linalg.eigh(covariance)
    known = np.maximum(1.0 / variance - opened**-2.0, 1e-9)
    seen = (axes.T @ off) / (variance * known)
    total = 1.0 / known + scales[:, None] ** 2
    likely = prior - 0.5 * np.sum(seen**2 / total + np.log(total), axis=1)
    weight = np.exp(likely - likely.max())
    return float(scales[np.argmax(likely)]), float(np.sqrt(weight @ scales**2 / weight.sum()))


class Found(NamedTuple):
    """Estimate of the fix clock."""

    delay: float  # at the start of the record, and its standard deviation, infinite if unobservable [s]
    sd: float
    drift: float  # of the delay, if significant [s/s]
    lag: float  # of velocities behind positions, and its standard deviation [s]
    lag_sd: float
    moments: tuple[float, ...]  # of `MOMENTS`
    sum_sd: float = np.inf  # sd of delay plus lag, which velocities determine [s]
    misfit: float = np.nan  # misfit of the fixes in the run of this estimate, if gates would reject many [-]
    # mean cost per measured value: with the clock unchanged, and with this estimate [-]
    cost: float = np.nan
    least: float = np.nan

    @property
    def least_delay_sd(self) -> float:
        """Least plausible standard deviation of the delay, or 0 if unobservable [s]."""
        return self.sd if self.sd < np.inf else 0.0


def delay_of(seen: Filtered, alone: tuple[float, float] = (0.0, np.inf)) -> Found:
    """Estimate the delay of the fixes and the lag of their velocities.

    Most receivers have no lag, and velocities then determine the delay far better than positions do. With a lag,
    velocities give a wrong delay. Both hypotheses are weighted by likelihood and prior odds (Bayesian model averaging:
    J. A. Hoeting, D. Madigan, A. E. Raftery and C. T. Volinsky, Statistical Science 14 (1999) 382-417). `alone`: lag
    from the fixes alone, without the IMU, and its sd [s]. It uses the observed scatter instead of the reported sd.
    Within a minute, a delay would explain the same data.
    """
    likelihood = _likelihood(seen)
    if likelihood is not None and (likelihood.accepted >= TRUE_FIXES or not likelihood.moves):
        found = _found(seen, likelihood, alone)
        if not found.least_delay_sd:  # perhaps without any fix
            return found
        there = [found.delay + found.drift * likelihood.half, found.drift, found.lag]
        cost, least = likelihood.mean_costs(*np.array([[0.0, 0.0, likelihood.lag], there]).T)
        return found._replace(cost=cost, least=least)
    # with seconds of delay, nearly all fixes look false, and precise fixes distort the filter
    believing = _believed(seen.ready)
    rough = filtered(_doubted(believing), starts=0)
    found = _found(rough, _likelihood(rough), alone)
    if found.sd <= DOUBTFUL:
        return found
    # precise fixes determine it to milliseconds, if the reported sds are true at some delay
    believed = filtered(believing, starts=0)
    likelihood = _likelihood(believed)
    off = EXPLAINED if likelihood is None else likelihood.off(COARSE)
    if off >= EXPLAINED:
        return found
    told = _found(believed, likelihood, alone)
    # the misfit is systematic: it distorts the filter, and the lever arm with the delay
    wider = max(1.0, float(np.sqrt(off)))
    sure = told._replace(sd=wider * told.sd, sum_sd=wider * told.sum_sd, misfit=believed.misfit)
    return sure if told.sd <= DOUBTFUL else found


def _likelihood(seen: Filtered) -> LateFixes | None:
    """Compute the likelihood of the fixes from a run; None if it diverged."""
    return None if seen.epochs is None else LateFixes(seen.used, seen.epochs)


def _found(seen: Filtered, likelihood: LateFixes | None, alone: tuple[float, float]) -> Found:
    """Estimate the fix clock from a run; see `delay_of`."""
    known = seen.used.receiver.lag
    nothing = Found(0.0, np.inf, 0.0, known.value, 0.0, known.moments)
    if likelihood is None or likelihood.blocks < BLOCKS or not likelihood.moves:  # fewer may agree by chance
        return nothing
    best = likelihood.likeliest(COARSE, likelihood.lag)
    if best in (0, COARSE.size - 1):  # no top within the grid
        return nothing
    near = COARSE[best] + NEAR
    fine, drift = likelihood.costs(near), 0.0
    rates = DRIFTS[np.abs(DRIFTS) < LARGEST_DRIFT * likelihood.half + FINE] / likelihood.half
    drifting = likelihood.costs(near[[np.argmin(fine.sum(axis=1))]], rates).sum(axis=1)
    least = int(np.clip(np.argmin(drifting), 1, rates.size - 2))
    # a single high value is chance
    sure = drifting[rates.size // 2] - drifting[least - 1 : least + 2].max() > SURE**2
    wide = abs(float(rates[least])) * likelihood.half
    if sure and wide > FINE and likelihood.cost_of_step(near, wide) > drifting[least]:
        drift = float(rates[least])
        fine = likelihood.costs(near, drift)
    middle = int(np.clip(np.argmin(fine.sum(axis=1)), 1, near.size - 2))
    before, top, after = fine[middle - 1 : middle + 2]
    bend, slopes = (before - 2.0 * top + after) / FINE**2, 0.5 * (after - before) / FINE
    curvature = float(bend.sum())
    innovation, variance = likelihood.innovations(near[middle], drift, likelihood.lag)
    if curvature <= 0.0 or np.median(np.abs(innovation) / np.sqrt(variance)) > HUBER:  # no delay explains the fixes
        return nothing
    away = -float(np.clip(slopes.sum() / curvature, -FINE, FINE))
    delay = float(near[middle]) + away
    # for an uneven likelihood the curvature is too optimistic. Zero delay must be as improbable, too, and parts must
    # agree: variance of the sum of their slopes, by their scatter (White, Econometrica 50 (1982) 1-25)
    width = 0.0
    if abs(delay) > DOUBTFUL and not drift:
        width = abs(delay) / float(np.sqrt(2.0 * max(likelihood.costs(np.zeros(1)).sum() - top.sum(), 1e-9)))
    scatter = float(np.sqrt(bend.size * np.var(slopes + away * bend, ddof=1))) / curvature
    sd = max(1.0 / float(np.sqrt(curvature)), width, scatter)
    lag, lag_sd, sum_sd = likelihood.lag, 0.0, sd
    if likelihood.velocities:
        began = likelihood.moments
        (other, along), covariance, evidence = _with_lag(likelihood, delay, drift, alone)
        share = 1.0 / (1.0 + np.exp(min(-evidence, 500.0)) * (1.0 - LAGGING) / LAGGING)
        costs = []
        for likelihood.moments in MOMENTS if abs(share * along) > LAG_WORTH else ():
            costs.append(likelihood.costs(np.array([other]), drift, np.array([along])).sum())
        likelihood.moments = MOMENTS[np.argmin(costs)] if costs else MOMENTS[0]
        if likelihood.moments != began:
            (other, along), covariance, _ = _with_lag(likelihood, other, drift, alone)
        apart = share * (1.0 - share)
        differ = other + along - likelihood.lag - delay
        sum_sd = float(np.sqrt(share * covariance.sum() + (1.0 - share) * sd**2 + apart * differ**2))
        sd = float(np.sqrt(share * max(covariance[0, 0], sd**2) + (1.0 - share) * sd**2 + apart * (other - delay) ** 2))
        delay += share * (other - delay)
        lag, lag_sd = share * along, float(np.sqrt(share * covariance[1, 1] + apart * along**2))
    # round to the microsecond: memory alignment changes the rounding of sums, and must not change the run
    every = delay - drift * likelihood.half, sd, lag, lag_sd, sum_sd
    delay, sd, lag, lag_sd, sum_sd = (round(float(each), 6) for each in every)
    return Found(delay, sd, drift, lag, lag_sd, likelihood.moments, sum_sd)


def _with_lag(
    likelihood: LateFixes, delay: float, drift: float, alone: tuple[float, float]
) -> tuple[FloatArray, FloatArray, float]:
    """Find the most likely delay and velocity lag jointly, with the prior of the lag, by Gauss-Newton.

    `delay`: with the assumed lag [s].
    Returns: delay and lag (2,) [s], their covariance, and the log odds of this lag against none (Laplace).
    """
    start = np.array([(delay - by * lag, likelihood.lag + lag) for by in (0.0, 1.0) for lag in LAGS])
    shown, weight = alone[0], float(np.hypot(ALONE * alone[1], ALONE_LEAST)) ** -2.0
    off = 0.5 * weight * (start[:, 1] - shown) ** 2
    at = start[likelihood.likeliest(start[:, 0], start[:, 1], off, drift)]
    known = np.array([REACH, LAG_SD]) ** -2.0 + [0.0, weight]
    for _ in range(NEWTON):
        slopes, curvature = likelihood.slopes(at[0], drift, at[1], LAG_STEP)
        covariance = np.linalg.inv(curvature + np.diag(known))
        step = -covariance @ (slopes.sum(axis=1) + known * at * [0.0, 1.0] - [0.0, weight * shown])
        at = at + np.clip(step, -LAG_SD, LAG_SD)
        if np.abs(step).max() < LAG_STEP:
            break
    scatter = covariance @ (slopes.shape[1] * np.cov(slopes)) @ covariance
    ratio = np.maximum(np.diag(scatter) / np.diag(covariance), 1.0)
    none = np.array([delay, delay + likelihood.lag, at[0] + at[1], at[0]])
    costs = likelihood.costs(none, drift, np.append(np.zeros(3), at[1])).sum(axis=1)
    gain = (costs[:3].min() - costs[3]) / ratio[1] - 0.5 * (known[1] * at[1] - 2.0 * weight * shown) * at[1]
    covariance = covariance * np.sqrt(np.outer(ratio, ratio))
    return at, covariance, float(gain + 0.5 * np.log(min(covariance[1, 1] / LAG_SD**2, 1.0)))


def on_time(prepared: Callable[[float, float], Aligned], receiver: Receiver) -> Aligned:
    """Prepare a recording with its samples shifted to the time of the fixes, if the delay is significant.

    The search also estimates the vibration lever arm and the attitude of a start in motion. `prepared`: function of the
    clock shift at the start [s] and its rate [s/s]. `receiver`: a specified delay is not estimated.
    """
    best = prepared(0.0, 0.0)
    clock, rate = own = 0.0, 0.0
    if receiver.delay.sd <= 0.0 and receiver.lever_arm.sd <= 0.0 and not receiver.lever_arm.value.any():
        return best
    ready = best.ready
    seen = filtered(ready)
    lag = ready.receiver.lag
    further, width, lags = seen, receiver.delay.sd, (lag.value, 0.0, lag.moments)
    before, last, least_delay_sd, shown = (best, seen, own), 0.0, 0.0, 0.0
    half = 0.5 * min(float(np.ptp(ready.imu.time)), LONGEST)  # half of the used part of the record [s]
    alone = velocity_lag(ready.gps) if receiver.delay.sd > 0.0 else (0.0, np.inf)
    tried, misfit, cost = before, np.nan, np.nan
    for _ in range(ROUNDS if receiver.delay.sd > 0.0 else 0):
        found = delay_of(further, alone)
        if found.misfit < misfit - BETTER:  # gates reject many fixes, and the others do not determine the delay
            best, seen, own = tried
        misfit, cost = found.misfit, found.cost if further is seen else cost
        delay, sd, drift = found[:3]
        least_delay_sd, shown = found.least_delay_sd, clock + delay + half * (rate + drift)
        was, lags = further.used.receiver.lag, found[3:6]
        lagging = abs(found.lag - was.value) >= LAG_WORTH or found.moments != was.moments
        # velocities determine the sum of delay and lag: a negligible lag leaves both to the clock
        ahead, ahead_sd = (delay, sd) if lagging else (delay + found.lag - was.value, found.sum_sd)
        # after a shift, or if the linear state of the filter significantly agrees in sign
        agrees = further.delay * np.sign(ahead) > SURE * further.delay_sd
        sure = SURE if clock == 0.0 and not agrees else REFINED
        # within its reach, the delay of a run with that lag is valid; another lag distorts it
        near = abs(ahead) < receiver.delay.sd
        moved = bool(abs(ahead) >= max(WORTH, sure * ahead_sd) or drift) and not (lagging and near)
        left = float(np.hypot(sd, delay - ahead if moved else delay))
        width = max(receiver.delay.sd, min(LOOKED * left, WIDEST))
        if moved and abs(last) < receiver.delay.sd and ahead * last < -BACK * last**2:
            best, seen, own = before
            break
        if not moved and not lagging:
            if found.least < cost - CHEAPER:
                best, seen, own = tried
            break
        before, last = (best, seen, own), 0.0 if drift or not moved else ahead
        if moved:
            clock, rate = clock + ahead, rate + drift
        there = prepared(clock, rate)
        lagged = replace(there.ready.receiver, lag=Lag(found.lag, moments=found.moments))
        there = replace(there, ready=replace(there.ready, receiver=lagged))
        # within its reach, the filter's state explains a delay as well, except for nonlinearity
        refined = further is seen and sure == REFINED and near and not drift
        further = filtered(there.ready)
        tried = there, further, (clock, rate)
        if refined or further.misfit <= seen.misfit + WORSE:  # a large delay is found in steps: the first may be worse
            best, seen, own = tried
    ready, receiver = best.ready, best.ready.receiver
    lever_arm = replace(receiver.lever_arm, shaken=seen.shaken, sd=seen.lever_sd)
    shown -= own[0] + half * own[1]
    searched = replace(receiver.delay, sd=width, least_sd=least_delay_sd, shown=shown)
    lag = Lag(lags[0], LOOKED * lags[1] if lags[1] > WORTH else 0.0, lags[2])
    ready = replace(ready, receiver=replace(receiver, lever_arm=lever_arm, delay=searched, lag=lag))
    if len(ready.starts) == 1:  # of a start in motion
        ready = replace(ready, starts=seen.ready.starts)
    lagging, known = abs(lags[0]) > LAG_WORTH, lags[1] > 0.0
    notes = [note for note in best.findings if lagging > known or note.code is not Code.GPS_VELOCITY_LAG]
    if lagging and known:
        notes.append(name_lag(lags[0], lags[1]))
    if best.clock != 0.0:
        notes.append(Finding.of(Code.GPS_DELAY_MOVED, delay_s=best.clock))
    if best.rate != 0.0:
        notes.append(Finding.of(Code.IMU_CLOCK_RATE, rate=best.rate))
    return replace(best, ready=ready, findings=tuple(notes))


def with_surer_start(ready: FilterInput, history: History) -> FilterInput | None:
    """Start in motion with smoothed attitude and gyro bias of a first run; None if it is stationary or specified.

    Fixes observe the lever arm through the attitude. An attitude error of degrees that is corrected during the run
    resembles turns, and biases the arm (G. P. Huang, A. I. Mourikis and S. I. Roumeliotis, "Observability-based rules
    for designing consistent EKF SLAM estimators", Int. J. Robotics Research 29 (2010) 502-528).
    """
    alignment = ready.alignment
    if alignment.static is not None or alignment.heading_method is Code.ALIGN_HEADING_GIVEN:
        return None
    found, time = history.smooth(), ready.fix_time
    fixes = np.count_nonzero((time > found.time[0]) & (time <= found.time[-1] + strapdown.TIME_TOLERANCE))
    if np.count_nonzero(found.used) < TRUE_FIXES * fixes:
        return None
    x, correction = found.state[0].copy(), found.correction[0].copy()
    feed_back(x, correction, found.after[0])
    sd = LOOKED_START * np.sqrt(np.diagonal(found.covariance[0])[6:])
    alignment = replace(
        alignment,
        rph=rph_from_quat(x[6:10]),
        sd=np.minimum(np.maximum(sd, LEAST_START), alignment.sd),
        gyro_bias=correction[:3],
        gyro_bias_sd=LOOKED_START * np.sqrt(found.variance[0, :3]),
        level_method=THEN_FILTER.get(Code(alignment.level_method), alignment.level_method),
        heading_method=THEN_FILTER.get(Code(alignment.heading_method), alignment.heading_method),
    )
    return align_again(ready, alignment if gives_velocities(ready.gps) else _with_course(ready, alignment))


def _with_course(ready: FilterInput, alignment: Alignment) -> Alignment:
    """Refine the vertical gyro bias of an alignment by the later course: a straight road has no other evidence.

    Remaining errors of the other biases tilt the gyro frame and leak into the vertical.
    """
    gps = replace(ready.gps, time=ready.fix_time)
    rows = slice(*np.searchsorted(ready.imu.time, alignment.time + np.array([-SPAN, STEADY + SPAN])))
    samples = strapdown.intervals(ready.imu.rows(rows), ready.nominal)
    bias, sd = bias_by_course(samples, alignment, sure_motion(gps, alignment.time)[0], float(gps.lla[0, 0]))
    sd = float(np.hypot(sd, alignment.gyro_bias_sd[:2] @ np.abs(np.sin(alignment.rph[1::-1]))))
    share = 1.0 / (1.0 + (sd / alignment.gyro_bias_sd[2]) ** 2)
    by, by_sd = alignment.gyro_bias.copy(), alignment.gyro_bias_sd.copy()
    by[2] += share * bias
    by_sd[2] *= np.sqrt(1.0 - share)
    return replace(alignment, gyro_bias=by, gyro_bias_sd=by_sd)


WRONG = 0.4  # smallest reported error of a lever arm [m]
OPENED_ARM = 2.0  # standard deviation of each component in the run that tests a specified lever arm [m]
SURE_ARM = 6.0  # smallest reported error, in standard deviations of the estimate
# Share of the lever-arm information that may come from gyro noise before it is reported. Approximate time over which
# noise rotates the attitude before fixes correct it [s]
PRETENDED, SHOWN_AFTER = 0.2, 10.0
NO_GYROS = 30.0 * DEG_PER_SQRT_H  # no gyro has this noise; hard mounts in vehicles: up to 8 deg/√h [rad/√s]
WRONG_HEADING = 3.0  # a specified heading, this many sd from the heading of the drive, is tested against it


def with_right_heading(given: Aligned, found: Aligned) -> Aligned:
    """Return a recording prepared with or without the specified heading, whichever makes the fixes more likely."""
    assumed, shown = given.ready.alignment, found.ready.alignment
    off = abs(float(wrap_pi(shown.rph[2] - assumed.rph[2])))
    limit = WRONG_HEADING * float(assumed.sd[2])
    if off < limit:
        return given
    chosen, code = found, Code.GIVEN_HEADING_REJECTED
    if filtered(given.ready).misfit <= filtered(found.ready).misfit:
        chosen, code = given, Code.GIVEN_HEADING_KEPT
        if off < WRONG_HEADING * np.hypot(assumed.sd[2], shown.sd[2]):
            return given
    values: dict[str, Any] = {"difference_rad": off, "limit_rad": limit, "given_rad": assumed.rph[2]}
    values |= {"estimate_rad": shown.rph[2], "estimate_sd_rad": shown.sd[2]}
    heading = Finding.of(code, chosen.ready.initial.time, **values)
    return replace(chosen, findings=(*chosen.findings, heading))


def pretended(ready: FilterInput, run: Run) -> float:
    """Compute the share of the lever-arm information, on its weakest axis, that may come from gyro noise.

    Apparent rotation by gyro noise acts as evidence for a lever arm of zero length, as the antenna does not move
    (errors in variables: W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.1). Per fix and axis, this is
    twice the attitude variance by that noise over the innovation variance.
    """
    row = np.searchsorted(run.epochs.time, run.innovations.time).clip(max=run.epochs.time.size - 1)
    attitude = np.diagonal(run.epochs.covariance, axis1=1, axis2=2)[row, 6:]
    turned = np.minimum(attitude, SHOWN_AFTER * ready.model.noise[:3].mean()).mean(axis=1)
    told = 2.0 * turned / np.mean(run.innovations.sd[:, :3] ** 2, axis=1)
    return float(told[run.innovations.used_position].sum() * np.max(run.lever_sd_alone) ** 2)


def with_hidden_lever(ready: FilterInput, run: Run) -> tuple[Run, tuple[Finding, ...]]:
    """Widen the standard deviations of arm, delay and positions if the lever arm may come from gyro noise.

    Standard deviations are doubled: in short parts of a recorded car with RTK, arms were wrong by 3 to 4 of them. Where
    noise outweighs the drive, its bias towards zero is added. Impossible gyro noise is reported.
    """
    part, noise = pretended(ready, run), float(np.sqrt(ready.model.noise[:3].mean()))
    begin = float(run.solution.time[0])
    if noise > NO_GYROS:
        return run, (Finding.of(Code.NOISE_GYROS, begin, noise_rad_sqrt_s=noise, limit_rad_sqrt_s=NO_GYROS),)
    if part <= PRETENDED:
        return run, ()
    of_each = part * (run.lever_sd_alone / np.max(run.lever_sd_alone)) ** 2
    short = np.where(of_each > 1.0, of_each, 0.0) * np.abs(run.lever_b)
    sd = np.hypot(2.0 * run.lever_sd, short)
    more = sd**2 - run.lever_sd**2

    def wider(solution: Trajectory, of: FloatArray) -> FloatArray:
        c_nb = dcm_from_quat(quat_from_rph(solution.rph))
        of[:, :3] = np.sqrt(of[:, :3] ** 2 + c_nb**2 @ more)
        return of

    hidden = Finding.of(Code.NOISE_HIDES_LEVER_ARM, begin, share=part, limit_share=PRETENDED, noise_rad_sqrt_s=noise)
    return replace(with_wider_sd(run, wider), lever_sd=sd, gps_delay_sd=2.0 * run.gps_delay_sd), (hidden,)


def lever_contradicted(arm: FloatArray, run: Run) -> Finding:
    """Report a specified arm (3,) [m] that a run without it contradicts, with the run's estimate to specify."""
    values: dict[str, Any] = {"difference_m": np.abs(run.lever_b - arm).max(), "limit_m": WRONG, "given_m": tuple(arm)}
    values |= {"estimate_m": tuple(run.lever_b), "estimate_sd_m": tuple(run.lever_sd)}
    return Finding.of(Code.GIVEN_LEVER_ARM_REJECTED, run.solution.time[0], **values)


def looked(ready: FilterInput, arm_sd: float = 0.0) -> Run:
    """Navigate the first part of a drive forward; `arm_sd`: least sd of its lever arm [m]."""
    some, receiver = ready.beginning(SHORT), ready.receiver
    lever_arm = replace(receiver.lever_arm, sd=max(receiver.lever_arm.sd, arm_sd))
    receiver = replace(receiver, lever_arm=lever_arm, delay=replace(receiver.delay, least_sd=0.0))
    some = replace(some, receiver=receiver, output=replace(some.output, smooth=False))
    return feed(Navigator(some), some.imu).finish()


def lever_off(ready: FilterInput, arm: FloatArray) -> tuple[Run, FloatArray, FloatArray]:
    """Test a specified lever arm (3,) [m]: run that estimates it, differences and least reported ones (3,) [m]."""
    run = looked(ready, OPENED_ARM)
    return run, np.abs(run.lever_b - arm), np.maximum(WRONG, SURE_ARM * run.lever_sd)
