"""Delay of fixes relative to their timestamps, by profile likelihood; test of a specified lever arm or heading.

The delay is a linear state of the filter. If the true delay is 0.3 s, a filter that starts at zero stops half way. This
is a local maximum of the likelihood, with wrong attitude and lever arm. This module therefore computes the likelihood
of the fixes on a grid of delays, each with its best attitude, biases and lever arm (`insnav.filter.late_fixes`; profile
likelihood: Murphy and van der Vaart, "On profile likelihood", J. Am. Stat. Assoc. 95 (2000) 449-465). It shifts the
samples to the best delay, near which the filter is linear enough. With a clock error of half the vibration period,
vibration would give a lever arm wrong by metres. Vibration is therefore used only after the shift.
"""

from __future__ import annotations

from collections.abc import Callable
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
from insnav.filter.noise_identification import SHORT, usual_time
from insnav.filter.prepare import align_again
from insnav.filter.receiver import Lag, Receiver
from insnav.filter.smoother import History
from insnav.findings import Code, Finding
from insnav.kernels.errorstate import feed_back
from insnav.types import Alignment, FloatArray, Run, Trajectory
from insnav.units import DEG, DEG_PER_SQRT_H

GRID = 0.1  # step of the first search for the delay: the likelihood is as wide as a manoeuvre [s]
COARSE = np.arange(-REACH, REACH + 0.5 * GRID, GRID)
FINE = 0.02  # step of the second search, around the best delay; then a parabola [s]
NEAR = FINE * np.arange(-round(GRID / FINE), round(GRID / FINE) + 1)
DRIFTS = FINE * np.arange(-10, 11)  # tested changes of the delay over half the record; one step is ignored [s]
LARGEST_DRIFT = 4e-4  # largest drift: no crystal drifts more [s/s]
LONGEST = 900.0  # length of the part of the record that is used [s]
FIXES = 600  # largest number of used fixes, in addition to a long stationary start
# Least delay to shift the samples: the filter estimates smaller ones. With larger ones, rotational vibration at 8 Hz
# biases the lever arm for good. Also least sd of a lag that is a state: at 2 m/s^2, it causes 6 mm/s [s]
WORTH = 0.003
DOUBTFUL = 0.03  # larger delays, and larger sds of a delay, need a further test [s]
WIDEST = 0.5  # largest initial sd of the delay state, for a delay that the drive hardly determines [s]
SURE, REFINED = 4.0, 2.0  # least delay to shift the samples, in sd: alone, and with other evidence [-]
ROUNDS = 3  # largest number of shifts of the samples
BACK = 0.5  # undo a small time shift if the next would reverse more than this part of it [-]
LEAST_OTHER, OTHER_WORTH = 0.03, 0.45  # vibration arm minus lever arm: least tested size, least size for a state [m]
# Instants whose mean is a lagging velocity, in lags before the fix: one, many since the previous fix, a low-pass filter
MOMENTS = (1.0,), tuple(0.25 * np.arange(0.5, 8.0)), tuple(-1.0109 * np.log(1.0 - np.arange(0.5, 32.0) / 32.0))
LAGS = 0.2 * np.arange(-1, 6)  # initial values of the lag search, relative to the assumed lag [s]
NEWTON, LAG_STEP = 6, 0.005  # largest number of Newton steps; step of numerical derivatives [s]
# Prior: share of receivers whose velocities lag [-], and sd of the lag [s]. Doppler counted since the previous fix lags
# by half an interval, and a filter in the receiver lags by its time constant. The sd also limits a Newton step
LAGGING, LAG_SD = 0.1, 0.2
# factor on the sd of a lag from fixes alone, and least sd [s]: in a town, such a lag was wrong by eight sd
ALONE, ALONE_LEAST = 3.0, 0.02
OPENED, FREEDOM = 2.0, 3.0  # initial factor on the prior sd of a lever arm; degrees of freedom of its Student prior
STARTS = 2  # number of repetitions of a start in motion, each with the smoothed start of the run before
# factor on the smoothed sds of this start: with 2, heading errors of recorded minutes were two to four times their sd
LOOKED_START = 5.0
LOOKED = 2.0  # factor on an sd that starts a further run: its measurements then hardly count twice
LEAST_START = 0.5 * DEG  # least initial sd of attitude [rad]
TRUE_FIXES = 0.9  # least share of accepted fixes in a valid run [-]
POOR = 3.0, 0.5  # sd added to positions [m] and velocities [m/s] in a repeated run, if it is not valid
# A delay explains the fixes if their mean normalised squared innovation is below this, with all accepted. Recorded
# RTK had 2 to 4, and 97 with false fixes that drifted for half a minute
EXPLAINED = 10.0
BETTER = 0.5  # least decrease of the misfit by a shift, with all fixes accepted, if gates reject many [-]
WORSE = 0.02  # largest increase of the misfit per fix by chance after a correct shift; up to 0.0095 was seen [-]
# The misfit increases more if vibration distorts a start in motion. The shift is accepted even so if the next search
# finds no further delay, and the cost per measured value decreases by this [-]
CHEAPER = 0.1


@dataclass(frozen=True, slots=True)
class Aligned:
    """Recording ready for the filter, with the samples on the clock of the fixes."""

    ready: FilterInput
    findings: tuple[Finding, ...]
    clock: float = 0.0  # shift of the samples to fix time at the middle of the record [s]: the estimated delay
    rate: float = 0.0  # rate of the shift over the record [s/s]


@dataclass(frozen=True, slots=True)
class Filtered:
    """Result of a filter run over the first part of a drive, without a shift of the samples."""

    ready: FilterInput  # first part of the drive
    used: FilterInput  # input of the run: the first part, with wider priors of the receiver and no resets
    epochs: FloatArray | None  # history, see `insnav.kernels.smoother.keep`; None if the filter diverged
    delay: float  # final delay state, and its standard deviation [s]
    delay_sd: float
    shaken: float  # estimated size of vibration arm minus lever arm, each component [m]
    lever_sd: float  # estimated prior sd of each component of the lever arm [m]
    misfit: float  # mean cost of the fixes [-], see `Record.misfit`
    squares: float  # mean normalised squared innovation [-]


def filtered(ready: FilterInput, *, starts: int | None = None) -> Filtered:
    """Run the filter over the first part of a drive, to estimate the delay or to compare alternatives by their misfit.

    A start in motion is repeated `starts` times, by default `STARTS` times; see `with_surer_start`.
    """
    ready = ready if starts is not None else _thinned(ready.beginning(LONGEST))
    starts = STARTS if starts is None else starts
    # no resets: a late fix looks false in every bend, and a reset would make heading and biases uncertain
    gates = replace(ready.gates, reset_after=np.inf)
    receiver, lever_arm, lever_sd = ready.receiver, ready.receiver.lever_arm, ready.receiver.lever_arm.sd
    other_sd = float(np.hypot(OPENED * lever_sd, np.linalg.norm(lever_arm.value)))
    correlated = receiver.correlated
    if correlated is not None and correlated.by_reported:  # limit the correlation time
        correlated = replace(correlated, time=min(correlated.time, usual_time()))
    wide_arm, delay = replace(lever_arm, sd=OPENED * lever_sd, shaken=other_sd), replace(receiver.delay, settled=False)
    receiver = replace(receiver, lever_arm=wide_arm, delay=delay, correlated=correlated)
    used = replace(ready.keep_history(), receiver=receiver, gates=gates)
    navigator = Navigator(used)
    try:
        feed(navigator, ready.imu)
        history = navigator.history()
        epochs = history.rows()
        next_start = with_surer_start(ready, history) if starts else None
        if starts and next_start is None and ready.alignment.static is None:  # if gates reject fixes, accept all
            other_run = Navigator(_doubted(_believed(used)))
            feed(other_run, ready.imu)
            next_start = with_surer_start(ready, other_run.history())
    except (DivergenceError, InputError):  # the filter diverged, perhaps to a pole
        return Filtered(ready, used, None, 0.0, np.inf, 0.0, lever_sd, np.inf, np.inf)
    if next_start is not None:
        return filtered(next_start, starts=starts - 1)
    (arm, vibration), (arm_cov, vibration_cov) = navigator.levers()
    if lever_sd > 0.0:
        scales = lever_sd * np.geomspace(1.0, OPENED)
        # Student's distribution in three dimensions as prior: most antennas are within a metre, a few at five
        prior = -FREEDOM * (np.log(scales) + 0.5 * (lever_sd / scales) ** 2)
        lever_sd = scale_of(arm, arm_cov, OPENED * lever_sd, scales, prior)[0]
    shaken = 0.0
    if other_sd > 0.0:
        shaken = scale_of(vibration, vibration_cov, other_sd, np.geomspace(LEAST_OTHER, other_sd))[1]
    shaken = shaken if shaken > OTHER_WORTH else 0.0
    return Filtered(ready, used, epochs, *navigator.delay, shaken, lever_sd, *navigator.misfit())


def _believed(ready: FilterInput) -> FilterInput:
    """Copy with gates that accept every fix, whatever its innovation."""
    return replace(ready, gates=replace(ready.gates.believing(), max_speed=np.inf))


def _doubted(ready: FilterInput) -> FilterInput:
    """Copy with large standard deviations of the fixes."""
    position_sd, velocity_sd = np.hypot(ready.gps.position_sd, POOR[0]), np.hypot(ready.gps.velocity_sd, POOR[1])
    return replace(ready, gps=replace(ready.gps, position_sd=position_sd, velocity_sd=velocity_sd))


def _thinned(ready: FilterInput) -> FilterInput:
    """Drop false fixes, and thin the others to about `FIXES` in the used part. Keep the fix of the initial state."""
    ready = replace(ready, gps=ready.gps.rows(~aside(ready.gates, ready.gps)))
    time = ready.gps.time
    number = np.floor((time - time[0]) / (min(time[-1] - time[0], LONGEST) / FIXES) + 1e-6)
    kept = np.diff(number, prepend=-1.0) > 0.0
    kept[np.argmin(np.abs(ready.fix_time - ready.initial.time))] = True  # fix of the initial state
    return replace(ready, gps=ready.gps.rows(np.flatnonzero(kept)))


def scale_of(
    off: FloatArray, covariance: FloatArray, opened: float, scales: FloatArray, prior: ArrayLike = 0.0
) -> tuple[float, float]:
    """Estimate the sd of a zero-mean prior of three numbers: its most likely value, and its RMS over all `scales`.

    Empirical and full Bayes: B. P. Carlin and T. A. Louis, "Bayes and empirical Bayes methods for data analysis"
    (Chapman and Hall 2000), chapters 2 and 3.

    `off` (3,), `covariance`: estimates of the numbers with the prior sd `opened`. `scales`, `prior`: tested standard
    deviations, and the logarithm of their prior probability.
    """
    variance, axes = np.linalg.eigh(covariance)
    information = np.maximum(1.0 / variance - opened**-2.0, 1e-9)
    by_data = (axes.T @ off) / (variance * information)
    total = 1.0 / information + scales[:, None] ** 2
    log_weight = prior - 0.5 * np.sum(by_data**2 / total + np.log(total), axis=1)
    weight = np.exp(log_weight - log_weight.max())
    return float(scales[np.argmax(log_weight)]), float(np.sqrt(weight @ scales**2 / weight.sum()))


class Found(NamedTuple):
    """Estimate of the delay of the fixes, and of the lag of their velocities."""

    delay: float  # delay at the start of the record, and its standard deviation, infinite if unobservable [s]
    sd: float
    drift: float  # rate of the delay, or zero if not significant [s/s]
    lag: float  # lag of velocities behind positions, and its standard deviation [s]
    lag_sd: float
    moments: tuple[float, ...]  # model of a lagging velocity, one of `MOMENTS`
    sum_sd: float = np.inf  # sd of delay plus lag, which velocities determine [s]
    misfit: float = np.nan  # misfit in the run of this estimate, only if gates would reject many fixes [-]
    # mean cost per measured value: without a further delay, and with this estimate [-]
    cost: float = np.nan
    least: float = np.nan

    @property
    def least_delay_sd(self) -> float:
        """Least plausible standard deviation of the delay, or 0 if unobservable [s]."""
        return self.sd if self.sd < np.inf else 0.0


def delay_of(seen: Filtered, alone: tuple[float, float] = (0.0, np.inf)) -> Found:
    """Estimate the delay of the fixes and the lag of their velocities from a filter run.

    Most receivers have no lag, and velocities then determine the delay far better than positions do. With a lag,
    velocities give a wrong delay. Both hypotheses are weighted by likelihood and prior odds (Bayesian model averaging:
    J. A. Hoeting, D. Madigan, A. E. Raftery and C. T. Volinsky, Statistical Science 14 (1999) 382-417). `alone`: lag
    from the fixes alone, without the IMU, and its sd [s], which follows from scatter instead of the reported sds. In a
    drive of a minute, either a delay or a lag would explain the data without it.
    """
    likelihood = _likelihood(seen)
    if likelihood is not None and (likelihood.accepted >= TRUE_FIXES or not likelihood.moves):
        estimate = _found(seen, likelihood, alone)
        if not estimate.least_delay_sd:  # the delay is not observable
            return estimate
        best = [estimate.delay + estimate.drift * likelihood.half, estimate.drift, estimate.lag]
        cost, least = likelihood.mean_costs(*np.array([[0.0, 0.0, likelihood.lag], best]).T)
        return estimate._replace(cost=cost, least=least)
    # with a delay of seconds, nearly all fixes look false, and precise ones distort the filter: use large sds
    believing = _believed(seen.ready)
    wide_run = filtered(_doubted(believing), starts=0)
    estimate = _found(wide_run, _likelihood(wide_run), alone)
    if estimate.sd <= DOUBTFUL:
        return estimate
    # the reported sds determine the delay to milliseconds, if they agree with the innovations at some delay
    precise_run = filtered(believing, starts=0)
    likelihood = _likelihood(precise_run)
    mean_square = EXPLAINED if likelihood is None else likelihood.off(COARSE)
    if mean_square >= EXPLAINED:
        return estimate
    precise = _found(precise_run, likelihood, alone)
    # widen the sds by the misfit: it is systematic, and distorts the filter, including lever arm and delay
    wider = max(1.0, float(np.sqrt(mean_square)))
    widened = precise._replace(sd=wider * precise.sd, sum_sd=wider * precise.sum_sd, misfit=precise_run.misfit)
    return widened if precise.sd <= DOUBTFUL else estimate


def _likelihood(seen: Filtered) -> LateFixes | None:
    """Build the likelihood of the delay from a filter run; None if the run diverged."""
    return None if seen.epochs is None else LateFixes(seen.used, seen.epochs)


def _found(seen: Filtered, likelihood: LateFixes | None, alone: tuple[float, float]) -> Found:
    """Estimate delay and lag from a filter run and its likelihood; see `delay_of`."""
    assumed = seen.used.receiver.lag
    nothing = Found(0.0, np.inf, 0.0, assumed.value, 0.0, assumed.moments)
    if likelihood is None or likelihood.blocks < BLOCKS or not likelihood.moves:  # fewer parts may agree by chance
        return nothing
    best = likelihood.likeliest(COARSE, likelihood.lag)
    if best in (0, COARSE.size - 1):  # the grid of delays contains no maximum
        return nothing
    delays = COARSE[best] + NEAR
    # the delay may also drift, unless a single step of the delay is more likely
    costs_near, drift = likelihood.costs(delays), 0.0
    rates = DRIFTS[np.abs(DRIFTS) < LARGEST_DRIFT * likelihood.half + FINE] / likelihood.half
    costs_by_rate = likelihood.costs(delays[[np.argmin(costs_near.sum(axis=1))]], rates).sum(axis=1)
    best_rate = int(np.clip(np.argmin(costs_by_rate), 1, rates.size - 2))
    # three neighbouring rates must be better: a single one may be chance
    significant = costs_by_rate[rates.size // 2] - costs_by_rate[best_rate - 1 : best_rate + 2].max() > SURE**2
    drift_range = abs(float(rates[best_rate])) * likelihood.half
    if significant and drift_range > FINE and likelihood.cost_of_step(delays, drift_range) > costs_by_rate[best_rate]:
        drift = float(rates[best_rate])
        costs_near = likelihood.costs(delays, drift)
    middle = int(np.clip(np.argmin(costs_near.sum(axis=1)), 1, delays.size - 2))
    before, top, after = costs_near[middle - 1 : middle + 2]
    curvatures, slopes = (before - 2.0 * top + after) / FINE**2, 0.5 * (after - before) / FINE
    curvature = float(curvatures.sum())
    innovation, variance = likelihood.innovations(delays[middle], drift, likelihood.lag)
    if curvature <= 0.0 or np.median(np.abs(innovation) / np.sqrt(variance)) > HUBER:  # no delay explains the fixes
        return nothing
    to_top = -float(np.clip(slopes.sum() / curvature, -FINE, FINE))
    delay = float(delays[middle]) + to_top
    # The sd by curvature is too small if the likelihood is no parabola. Lower limits: the sd with which zero delay
    # is as improbable as computed, and the scatter of the slopes of the parts (White, Econometrica 50 (1982) 1-25)
    width = 0.0
    if abs(delay) > DOUBTFUL and not drift:
        width = abs(delay) / float(np.sqrt(2.0 * max(likelihood.costs(np.zeros(1)).sum() - top.sum(), 1e-9)))
    scatter = float(np.sqrt(curvatures.size * np.var(slopes + to_top * curvatures, ddof=1))) / curvature
    sd = max(1.0 / float(np.sqrt(curvature)), width, scatter)
    lag, lag_sd, sum_sd = likelihood.lag, 0.0, sd
    if likelihood.velocities:  # average over the hypotheses with a lag (probability `share`) and without
        moments_before = likelihood.moments
        (other, along), covariance, evidence = _with_lag(likelihood, delay, drift, alone)
        share = 1.0 / (1.0 + np.exp(min(-evidence, 500.0)) * (1.0 - LAGGING) / LAGGING)
        costs = []
        for likelihood.moments in MOMENTS if abs(share * along) > LAG_WORTH else ():
            costs.append(likelihood.costs(np.array([other]), drift, np.array([along])).sum())
        likelihood.moments = MOMENTS[np.argmin(costs)] if costs else MOMENTS[0]
        if likelihood.moments != moments_before:
            (other, along), covariance, _ = _with_lag(likelihood, other, drift, alone)
        apart = share * (1.0 - share)
        differ = other + along - likelihood.lag - delay
        sum_sd = float(np.sqrt(share * covariance.sum() + (1.0 - share) * sd**2 + apart * differ**2))
        sd = float(np.sqrt(share * max(covariance[0, 0], sd**2) + (1.0 - share) * sd**2 + apart * (other - delay) ** 2))
        delay += share * (other - delay)
        lag, lag_sd = share * along, float(np.sqrt(share * covariance[1, 1] + apart * along**2))
    # round to microseconds: rounding errors of sums depend on memory alignment, and must not change the result
    results = delay - drift * likelihood.half, sd, lag, lag_sd, sum_sd
    delay, sd, lag, lag_sd, sum_sd = (round(float(each), 6) for each in results)
    return Found(delay, sd, drift, lag, lag_sd, likelihood.moments, sum_sd)


def _with_lag(
    likelihood: LateFixes, delay: float, drift: float, alone: tuple[float, float]
) -> tuple[FloatArray, FloatArray, float]:
    """Find the most likely delay and velocity lag jointly, with the prior of the lag, by Gauss-Newton.

    `delay`: most likely delay with the assumed lag [s].
    Returns: delay and lag (2,) [s], their covariance, and the log odds of this lag against no lag (Laplace).
    """
    starts = np.array([(delay - by * lag, likelihood.lag + lag) for by in (0.0, 1.0) for lag in LAGS])
    lag_alone, information = alone[0], float(np.hypot(ALONE * alone[1], ALONE_LEAST)) ** -2.0
    prior_cost = 0.5 * information * (starts[:, 1] - lag_alone) ** 2
    top = starts[likelihood.likeliest(starts[:, 0], starts[:, 1], prior_cost, drift)]
    prior = np.array([REACH, LAG_SD]) ** -2.0 + [0.0, information]
    # Gauss-Newton steps for delay and lag; the prior has a sd for both, and the lag from the fixes alone
    for _ in range(NEWTON):
        slopes, curvature = likelihood.slopes(top[0], drift, top[1], LAG_STEP)
        covariance = np.linalg.inv(curvature + np.diag(prior))
        step = -covariance @ (slopes.sum(axis=1) + prior * top * [0.0, 1.0] - [0.0, information * lag_alone])
        top = top + np.clip(step, -LAG_SD, LAG_SD)
        if np.abs(step).max() < LAG_STEP:
            break
    scatter = covariance @ (slopes.shape[1] * np.cov(slopes)) @ covariance
    ratio = np.maximum(np.diag(scatter) / np.diag(covariance), 1.0)
    alternatives = np.array([delay, delay + likelihood.lag, top[0] + top[1], top[0]])
    costs = likelihood.costs(alternatives, drift, np.append(np.zeros(3), top[1])).sum(axis=1)
    gain = (costs[:3].min() - costs[3]) / ratio[1] - 0.5 * (prior[1] * top[1] - 2.0 * information * lag_alone) * top[1]
    covariance = covariance * np.sqrt(np.outer(ratio, ratio))
    return top, covariance, float(gain + 0.5 * np.log(min(covariance[1, 1] / LAG_SD**2, 1.0)))


def on_time(prepared: Callable[[float, float], Aligned], receiver: Receiver) -> Aligned:
    """Prepare a recording and, if the delay of its fixes is significant, shift its samples to the time of the fixes.

    The search also estimates the lever arm of vibration, and the attitude of a start in motion. `prepared`: function
    that prepares the recording, for a clock shift at the start [s] and its rate [s/s]. `receiver`: as specified; a
    specified delay is not estimated.
    """
    best = prepared(0.0, 0.0)
    clock, rate = best_shift = 0.0, 0.0
    if receiver.delay.sd <= 0.0 and receiver.lever_arm.sd <= 0.0 and not receiver.lever_arm.value.any():
        return best
    ready = best.ready
    best_run = filtered(ready)
    lag = ready.receiver.lag
    current, state_sd, lags = best_run, receiver.delay.sd, (lag.value, 0.0, lag.moments)
    before, last_move, least_delay_sd, total = (best, best_run, best_shift), 0.0, 0.0, 0.0
    half = 0.5 * min(float(np.ptp(ready.imu.time)), LONGEST)  # half of the used part of the record [s]
    alone = velocity_lag(ready.gps) if receiver.delay.sd > 0.0 else (0.0, np.inf)
    latest, misfit, cost = before, np.nan, np.nan
    # each round estimates the delay from the last run, shifts the samples, and runs the filter again
    for _ in range(ROUNDS if receiver.delay.sd > 0.0 else 0):
        estimate = delay_of(current, alone)
        if estimate.misfit < misfit - BETTER:  # gates reject many: with all fixes, the shift is better
            best, best_run, best_shift = latest
        misfit, cost = estimate.misfit, estimate.cost if current is best_run else cost
        delay, sd, drift = estimate[:3]
        least_delay_sd, total = estimate.least_delay_sd, clock + delay + half * (rate + drift)
        used_lag, lags = current.used.receiver.lag, estimate[3:6]
        lagging = abs(estimate.lag - used_lag.value) >= LAG_WORTH or estimate.moments != used_lag.moments
        # velocities determine the sum of delay and lag: if the lag is negligible, shift the clock by the sum
        move, move_sd = (delay, sd) if lagging else (delay + estimate.lag - used_lag.value, estimate.sum_sd)
        # other evidence: an earlier shift, or a delay state of the same sign that is significant
        agrees = current.delay * np.sign(move) > SURE * current.delay_sd
        least_significance = SURE if clock == 0.0 and not agrees else REFINED
        # do not shift by a small delay together with a new lag: the delay of the next run, with this lag, is valid
        small = abs(move) < receiver.delay.sd
        moved = bool(abs(move) >= max(WORTH, least_significance * move_sd) or drift) and not (lagging and small)
        remaining = float(np.hypot(sd, delay - move if moved else delay))
        state_sd = max(receiver.delay.sd, min(LOOKED * remaining, WIDEST))
        if moved and abs(last_move) < receiver.delay.sd and move * last_move < -BACK * last_move**2:
            best, best_run, best_shift = before
            break
        if not moved and not lagging:
            if estimate.least < cost - CHEAPER:
                best, best_run, best_shift = latest
            break
        before, last_move = (best, best_run, best_shift), 0.0 if drift or not moved else move
        if moved:
            clock, rate = clock + move, rate + drift
        shifted = prepared(clock, rate)
        receiver_with_lag = replace(shifted.ready.receiver, lag=Lag(estimate.lag, moments=estimate.moments))
        shifted = replace(shifted, ready=replace(shifted.ready, receiver=receiver_with_lag))
        # accept a small refinement whatever its misfit: the delay state explains a small delay nearly as well
        refined = current is best_run and least_significance == REFINED and small and not drift
        current = filtered(shifted.ready)
        latest = shifted, current, (clock, rate)
        if refined or current.misfit <= best_run.misfit + WORSE:  # or go on: the first of several shifts may be worse
            best, best_run, best_shift = latest
    ready, receiver = best.ready, best.ready.receiver
    lever_arm = replace(receiver.lever_arm, shaken=best_run.shaken, sd=best_run.lever_sd)
    total -= best_shift[0] + half * best_shift[1]
    searched = replace(receiver.delay, sd=state_sd, least_sd=least_delay_sd, shown=total)
    lag = Lag(lags[0], LOOKED * lags[1] if lags[1] > WORTH else 0.0, lags[2])
    ready = replace(ready, receiver=replace(receiver, lever_arm=lever_arm, delay=searched, lag=lag))
    if len(ready.starts) == 1:  # use the improved start in motion
        ready = replace(ready, starts=best_run.ready.starts)
    lagging, estimated = abs(lags[0]) > LAG_WORTH, lags[1] > 0.0
    notes = [note for note in best.findings if lagging > estimated or note.code is not Code.GPS_VELOCITY_LAG]
    if lagging and estimated:
        notes.append(name_lag(lags[0], lags[1]))
    if best.clock != 0.0:
        notes.append(Finding.of(Code.GPS_DELAY_MOVED, delay_s=best.clock))
    if best.rate != 0.0:
        notes.append(Finding.of(Code.IMU_CLOCK_RATE, rate=best.rate))
    return replace(best, ready=ready, findings=tuple(notes))


def with_surer_start(ready: FilterInput, history: History) -> FilterInput | None:
    """Copy with a start in motion improved by the smoothed attitude and gyro bias of a run, or None.

    Fixes observe the lever arm through the attitude. The correction of an initial attitude error of degrees resembles
    turns, and biases the arm (G. P. Huang, A. I. Mourikis and S. I. Roumeliotis, "Observability-based rules for
    designing consistent EKF SLAM estimators", Int. J. Robotics Research 29 (2010) 502-528). The result is None for a
    stationary start, for a specified heading, and if the run rejected many fixes.
    """
    alignment = ready.alignment
    if alignment.static is not None or alignment.heading_method is Code.ALIGN_HEADING_GIVEN:
        return None
    smoothed, time = history.smooth(), ready.fix_time
    fixes = np.count_nonzero((time > smoothed.time[0]) & (time <= smoothed.time[-1] + strapdown.TIME_TOLERANCE))
    if np.count_nonzero(smoothed.used) < TRUE_FIXES * fixes:
        return None
    x, correction = smoothed.state[0].copy(), smoothed.correction[0].copy()
    feed_back(x, correction, smoothed.after[0])
    sd = LOOKED_START * np.sqrt(np.diagonal(smoothed.covariance[0])[6:])
    alignment = replace(
        alignment,
        rph=rph_from_quat(x[6:10]),
        sd=np.minimum(np.maximum(sd, LEAST_START), alignment.sd),
        gyro_bias=correction[:3],
        gyro_bias_sd=LOOKED_START * np.sqrt(smoothed.variance[0, :3]),
        level_method=THEN_FILTER.get(Code(alignment.level_method), alignment.level_method),
        heading_method=THEN_FILTER.get(Code(alignment.heading_method), alignment.heading_method),
    )
    return align_again(ready, alignment if gives_velocities(ready.gps) else _with_course(ready, alignment))


def _with_course(ready: FilterInput, alignment: Alignment) -> Alignment:
    """Refine the vertical gyro bias of an alignment by the course after it: a straight road has no other evidence.

    If the vehicle is tilted, errors of the horizontal gyro biases add to the error of the result.
    """
    gps = replace(ready.gps, time=ready.fix_time)
    rows = slice(*np.searchsorted(ready.imu.time, alignment.time + np.array([-SPAN, STEADY + SPAN])))
    samples = strapdown.intervals(ready.imu.rows(rows), ready.nominal)
    bias, sd = bias_by_course(samples, alignment, sure_motion(gps, alignment.time)[0], float(gps.lla[0, 0]))
    sd = float(np.hypot(sd, alignment.gyro_bias_sd[:2] @ np.abs(np.sin(alignment.rph[1::-1]))))
    share = 1.0 / (1.0 + (sd / alignment.gyro_bias_sd[2]) ** 2)
    gyro_bias, gyro_bias_sd = alignment.gyro_bias.copy(), alignment.gyro_bias_sd.copy()
    gyro_bias[2] += share * bias
    gyro_bias_sd[2] *= np.sqrt(1.0 - share)
    return replace(alignment, gyro_bias=gyro_bias, gyro_bias_sd=gyro_bias_sd)


WRONG = 0.4  # least error of a specified lever arm that is reported [m]
OPENED_ARM = 2.0  # prior sd of each component in the run that tests a specified lever arm [m]
SURE_ARM = 6.0  # least reported error, in standard deviations of the estimate [-]
# Largest share of the lever-arm information that gyro noise may cause without a report [-]. Approximate time over which
# noise rotates the attitude until fixes correct it [s]
PRETENDED, SHOWN_AFTER = 0.2, 10.0
NO_GYROS = 30.0 * DEG_PER_SQRT_H  # more noise than any gyro; hard-mounted in vehicles: up to 8 deg/√h [rad/√s]
WRONG_HEADING = 3.0  # a specified heading is tested if the heading of the drive differs by this many sd [-]


def with_right_heading(given: Aligned, found: Aligned) -> Aligned:
    """Return the recording prepared with (`given`) or without (`found`) a specified heading, whichever fits better."""
    assumed, estimated = given.ready.alignment, found.ready.alignment
    difference = abs(float(wrap_pi(estimated.rph[2] - assumed.rph[2])))
    limit = WRONG_HEADING * float(assumed.sd[2])
    if difference < limit:
        return given
    chosen, code = found, Code.GIVEN_HEADING_REJECTED
    if filtered(given.ready).misfit <= filtered(found.ready).misfit:
        chosen, code = given, Code.GIVEN_HEADING_KEPT
        if difference < WRONG_HEADING * np.hypot(assumed.sd[2], estimated.sd[2]):
            return given
    values: dict[str, Any] = {"difference_rad": difference, "limit_rad": limit, "given_rad": assumed.rph[2]}
    values |= {"estimate_rad": estimated.rph[2], "estimate_sd_rad": estimated.sd[2]}
    heading = Finding.of(code, chosen.ready.initial.time, **values)
    return replace(chosen, findings=(*chosen.findings, heading))


def pretended(ready: FilterInput, run: Run) -> float:
    """Compute the share of the lever-arm information, on its weakest axis, that may come from gyro noise.

    Gyro noise is apparent rotation. As the antenna does not move with it, it seems to be evidence for a lever arm of
    zero (errors in variables: W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.1). Its information per fix
    and axis is twice the attitude variance by this noise, divided by the innovation variance.
    """
    row = np.searchsorted(run.epochs.time, run.innovations.time).clip(max=run.epochs.time.size - 1)
    attitude = np.diagonal(run.epochs.covariance, axis1=1, axis2=2)[row, 6:]
    by_noise = np.minimum(attitude, SHOWN_AFTER * ready.model.noise[:3].mean()).mean(axis=1)
    information = 2.0 * by_noise / np.mean(run.innovations.sd[:, :3] ** 2, axis=1)
    return float(information[run.innovations.used_position].sum() * np.max(run.lever_sd_alone) ** 2)


def with_hidden_lever(ready: FilterInput, run: Run) -> tuple[Run, tuple[Finding, ...]]:
    """Widen the standard deviations of lever arm, delay and positions if gyro noise may determine the lever arm.

    Standard deviations are doubled: in short parts of a recorded car with RTK, arms were wrong by 3 to 4 of them. On
    axes with more information from noise than from the drive, the bias to zero is added. Implausible noise is reported.
    """
    share, noise = pretended(ready, run), float(np.sqrt(ready.model.noise[:3].mean()))
    begin = float(run.solution.time[0])
    if noise > NO_GYROS:
        return run, (Finding.of(Code.NOISE_GYROS, begin, noise_rad_sqrt_s=noise, limit_rad_sqrt_s=NO_GYROS),)
    if share <= PRETENDED:
        return run, ()
    of_each = share * (run.lever_sd_alone / np.max(run.lever_sd_alone)) ** 2
    bias_to_zero = np.where(of_each > 1.0, of_each, 0.0) * np.abs(run.lever_b)
    sd = np.hypot(2.0 * run.lever_sd, bias_to_zero)
    added = sd**2 - run.lever_sd**2

    def wider(solution: Trajectory, of: FloatArray) -> FloatArray:
        c_nb = dcm_from_quat(quat_from_rph(solution.rph))
        of[:, :3] = np.sqrt(of[:, :3] ** 2 + c_nb**2 @ added)
        return of

    hidden = Finding.of(Code.NOISE_HIDES_LEVER_ARM, begin, share=share, limit_share=PRETENDED, noise_rad_sqrt_s=noise)
    return replace(with_wider_sd(run, wider), lever_sd=sd, gps_delay_sd=2.0 * run.gps_delay_sd), (hidden,)


def lever_contradicted(arm: FloatArray, run: Run) -> Finding:
    """Report a specified lever arm (3,) [m] that the estimate of a run contradicts, together with this estimate."""
    values: dict[str, Any] = {"difference_m": np.abs(run.lever_b - arm).max(), "limit_m": WRONG, "given_m": tuple(arm)}
    values |= {"estimate_m": tuple(run.lever_b), "estimate_sd_m": tuple(run.lever_sd)}
    return Finding.of(Code.GIVEN_LEVER_ARM_REJECTED, run.solution.time[0], **values)


def looked(ready: FilterInput, arm_sd: float = 0.0) -> Run:
    """Run the filter without smoother over the first part of a drive. `arm_sd`: least sd of its lever arm [m]."""
    part, receiver = ready.beginning(SHORT), ready.receiver
    lever_arm = replace(receiver.lever_arm, sd=max(receiver.lever_arm.sd, arm_sd))
    receiver = replace(receiver, lever_arm=lever_arm, delay=replace(receiver.delay, least_sd=0.0))
    part = replace(part, receiver=receiver, output=replace(part.output, smooth=False))
    return feed(Navigator(part), part.imu).finish()


def lever_off(ready: FilterInput, arm: FloatArray) -> tuple[Run, FloatArray, FloatArray]:
    """Test a specified lever arm (3,) [m]. Returns a run that estimates it, differences and their limits (3,) [m]."""
    run = looked(ready, OPENED_ARM)
    return run, np.abs(run.lever_b - arm), np.maximum(WRONG, SURE_ARM * run.lever_sd)
