"""How much older fixes are than their timestamps, over seconds, by profile likelihood.

The filter has the delay as a state, which is linear: from zero it stops half way to 0.3 s, at a top of the likelihood
that is only a local one, and bends attitude and lever arm to it. Here the drive is cut into short windows, in which
specific force, turned by the gyros, gives the track up to a constant, a straight line and a parabola for each axis (the
errors of position, velocity, and of tilt and accelerometer bias) and a small turn (the error of the heading). For every
delay of a grid these and the lever arm are fitted to the fixes; what is left is the likelihood of that delay, with
everything else at its best (profile likelihood: Murphy and van der Vaart, "On profile likelihood", J. Am. Stat. Assoc.
95 (2000) 449-465). Its top is looked for over the whole grid, and from there the state of the filter is linear enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.alignment import in_motion
from insnav.attitude import dcm_from_quat, rph_from_quat
from insnav.earth import ned_offset
from insnav.exceptions import DivergenceError
from insnav.filter.error_model import initial_state
from insnav.filter.navigate import feed
from insnav.filter.prepare import Prepared
from insnav.filter.settings import FilterSettings
from insnav.filter.smoother import History
from insnav.kernels.errorstate import feed_back
from insnav.kernels.smoother import CORRECTION, STATE, TIME
from insnav.strapdown import TIME_TOLERANCE
from insnav.types import FloatArray, GpsData, IntArray
from insnav.units import DEG

REACH = 2.0  # delays looked for, early and late [s]
GRID = 0.2  # first steps: the likelihood of a delay is as wide as a manoeuvre [s]
FINE, FINE_STEPS = 0.04, 8  # steps about the best of these to either side; the rest is a parabola [s]
DRIFTS = 0.02 * np.arange(-10, 11)  # of the delay, from the middle to the ends of the record [s]
DRIFT_WORTH, LARGEST_DRIFT = 0.02, 4e-4  # a smaller one is not moved by [s], larger ones no crystal has [s/s]
LONGEST = 900.0  # of the record that is looked at [s]
SPAN = 20.0  # of a window: longer, gyro drift counts; shorter, little is left beside the parabola [s]
FEWEST, MOST = 8, 40  # fixes of a window
FEWEST_WINDOWS = 6  # fewer may agree by accident
WINDOWS = 40  # of these at most, those with the largest changes of velocity
HEADING_SD = 5.0 * DEG  # of the heading of a window, that of the filter [rad]
LEVER_SD = 0.3  # a lever arm that is given may be so far off here: it only widens the interval [m]
WORTH = 0.03  # smaller delays are linear enough for the state of the filter [s]
SURE = 5.0  # delays are believed beyond so many of their standard deviations
ROUNDS = 3  # of moving the clock
RETURN = 0.5  # part of a delay by which filter or windows must not go back once the clock was moved
LEAST_OTHER, OTHER_WORTH = 0.03, 0.45  # of an arm of vibration's own: the least, and what is worth states [m]
SCALES = 50  # steps of the search for a standard deviation
OPENED, FREEDOM = 2.0, 3.0  # times the scale of the prior of a lever arm at first; its degrees of freedom
LOOKED = 2.0  # times the standard deviation of the first run for the second: its measurements count little twice
LEAST_START = 0.5 * DEG  # least standard deviation of attitude from there [rad]
TRUE_FIXES = 0.9  # part of the fixes that the first look must have accepted for that
WORSE = 0.02  # by which a position's misfit may grow by chance when the clock is moved rightly (up to 0.0095 seen)


@dataclass(frozen=True, slots=True)
class Filtered:
    """The beginning of a drive as the filter sees it with the clock of its samples as it is."""

    ready: Prepared  # the beginning
    epochs: FloatArray | None  # see `insnav.kernels.smoother.keep`; none if the filter diverged
    delay: float  # in which its state ended, and its standard deviation [s]
    delay_sd: float
    # of each component: how vibration moves the antenna otherwise than turns do, and the lever arm as given [m]
    shaken: float
    lever_sd: float
    misfit: float  # how unlikely positions were, see `Record.misfit`


def filtered(ready: Prepared, *, started: bool = False) -> Filtered:
    """Navigate the beginning of a drive with what windows and the comparison of clocks need.

    A start in motion is navigated twice; `started`: the second time.
    """
    ready = ready if started else ready.beginning(LONGEST)
    # a late fix looks false in every bend, and a reset would open heading and biases, which the windows need
    gates = replace(ready.settings.gates, reset_after=np.inf)
    lever_sd = ready.settings.lever_sd
    other = float(np.hypot(OPENED * lever_sd, np.linalg.norm(ready.settings.lever_b)))
    settings = replace(ready.settings, aiding=None, smooth=True, output_interval=10.0, gates=gates)
    settings = replace(settings, lever_sd=OPENED * lever_sd, shaken=other)
    navigator = replace(ready, settings=settings).navigator()
    try:
        feed(navigator, ready.imu)
        history = navigator.history()
        epochs = history.rows()
        again = None if started else with_surer_start(ready, history)
    except DivergenceError:
        return Filtered(ready, None, 0.0, np.inf, 0.0, lever_sd, np.inf)
    if again is not None:
        return filtered(again, started=True)
    (arm, vibration), (arm_cov, vibration_cov) = navigator.levers()
    if lever_sd > 0.0:
        scales = lever_sd * np.geomspace(1.0, OPENED, SCALES)
        # antennas are within a metre or so, and now and then five: Student's distribution in three dimensions, a normal
        # one whose variance is unknown, too
        prior = -FREEDOM * (np.log(scales) + 0.5 * (lever_sd / scales) ** 2)
        lever_sd = scale_of(arm, arm_cov, OPENED * lever_sd, scales, prior)[0]
    shaken = 0.0
    if other > 0.0:
        shaken = scale_of(vibration, vibration_cov, other, np.geomspace(LEAST_OTHER, other, SCALES))[1]
    shaken = shaken if shaken > OTHER_WORTH else 0.0
    return Filtered(ready, epochs, *navigator.delay, shaken, lever_sd, navigator.misfit())


def scale_of(
    off: FloatArray, covariance: FloatArray, opened: float, scales: FloatArray, prior: ArrayLike = 0.0
) -> tuple[float, float]:
    """Standard deviation of three numbers about zero, by what a filter found of them: the likeliest, and the RMS.

    The RMS is over all that are plausible. Empirical and full Bayes: B. P. Carlin and T. A. Louis, "Bayes and empirical
    Bayes methods for data analysis" (Chapman and Hall 2000), chapters 2 and 3.

    `off` (3,) found with `opened` for it, and its covariance; `scales`, `prior`: standard deviations with the logarithm
    of what is likely of them before.
    """
    variance, axes = np.linalg.eigh(covariance)
    known = np.maximum(1.0 / variance - opened**-2.0, 1e-9)
    seen = (axes.T @ off) / (variance * known)
    total = 1.0 / known + scales[:, None] ** 2
    likely = prior - 0.5 * np.sum(seen**2 / total + np.log(total), axis=1)
    weight = np.exp(likely - likely.max())
    return float(scales[np.argmax(likely)]), float(np.sqrt(weight @ scales**2 / weight.sum()))


def delay_of(seen: Filtered) -> tuple[float, float, float]:
    """Delay of the fixes at the start of the record, its standard deviation [s], and its surely known drift [s/s].

    The standard deviation is infinite where nothing tells the delay; a drift that is not sure is zero.
    """
    ready, epochs = seen.ready, seen.epochs
    if epochs is None:
        return 0.0, np.inf, 0.0
    parts = strapdown.intervals(ready.imu, ready.nominal)
    gps = _usable(ready)
    windows = [
        _Window(parts, gps.rows(rows), epochs, ready.settings.velocity_lag)
        for rows in _lively(gps, epochs, ready.imu.time)
    ]
    if len(windows) < FEWEST_WINDOWS:
        return 0.0, np.inf, 0.0
    lever_b, lever_sd = ready.settings.lever_b, max(ready.settings.lever_sd, LEVER_SD)
    grid = np.arange(-REACH, REACH + 0.5 * GRID, GRID)
    best = int(np.argmin(_cost(_left(windows, grid, lever_b), lever_sd)[0]))
    near = grid[best] + FINE * np.arange(-FINE_STEPS, FINE_STEPS + 1)
    left = _left(windows, np.append(near, 0.0), lever_b)
    cost, _, each = _cost(left, lever_sd)
    gain, cost = float(cost[-1] - cost[:-1].min()), cost[:-1]
    begin, end = float(ready.imu.time[0]), float(ready.imu.time[-1])
    halfway = 0.5 * (end - begin)
    drift, drifting, moved = _drift(windows, left, lever_sd, begin + halfway)
    if drift:
        gain, cost, each = SURE**2, drifting, moved  # more than that
    middle = int(np.clip(np.argmin(cost), 1, near.size - 2))
    before, top, after = (cost[middle + k] for k in (-1, 0, 1))
    curvature = float(before - 2.0 * top + after) / FINE**2
    if curvature <= 0.0 or best in (0, grid.size - 1):  # no top, or one beyond the grid
        return 0.0, np.inf, 0.0
    away = 0.5 * float(before - after) / FINE / curvature
    delay = float(near[middle]) + away
    # the curvature at the top of an uneven likelihood is not its width: no delay at all must be as unlikely, too, and
    # windows must agree: the variance of the sum of their slopes, by their scatter (White, Econometrica 50 (1982) 1-25)
    width = abs(delay) / float(np.sqrt(2.0 * max(gain, 1e-9))) if abs(delay) > WORTH else 0.0
    before, top, after = (each[:, middle + k] for k in (-1, 0, 1))
    slopes = 0.5 * (after - before) / FINE + away * (before - 2.0 * top + after) / FINE**2
    scatter = float(np.sqrt(len(windows) * np.var(slopes, ddof=1))) / curvature
    return delay - drift * halfway, max(1.0 / np.sqrt(curvature), width, scatter), drift


def _usable(ready: Prepared) -> GpsData:
    gps = replace(ready.gps, time=ready.gps.time - ready.settings.delay)
    good = gps.position_sd.max(axis=1) <= ready.settings.gates.max_sd
    return gps.rows(good if gps.fix is None else good & (gps.fix != 0))


def _lively(gps: GpsData, epochs: FloatArray, samples: FloatArray) -> list[IntArray]:
    """Rows of the fixes of the windows in which the velocity changes most."""
    speed = in_motion.velocity(gps)
    found = []
    start = float(epochs[0, TIME]) + REACH + 1.0
    while start + SPAN + REACH + 1.0 <= samples[-1]:
        first, last = np.searchsorted(gps.time, [start, start + SPAN])
        inside = (speed.time >= start) & (speed.time < start + SPAN)
        if last - first >= FEWEST and inside.sum() >= FEWEST:
            spread = float(np.sum(np.std(speed.v_n[inside, :2], axis=0)))
            rows = np.unique(np.linspace(first, last - 1, min(last - first, MOST)).astype(int))
            found.append((spread, rows))
        start += SPAN
    found.sort(key=lambda each: -each[0])
    return [rows for spread, rows in found[:WINDOWS] if spread > in_motion.SLOWEST / 2.0]


class _Window:
    """Fixes of a window, and the track by the IMU alone through it."""

    def __init__(self, parts: strapdown.Intervals, gps: GpsData, epochs: FloatArray, lag: float) -> None:
        begin, end = gps.time[0] - REACH - 0.5, gps.time[-1] + REACH + 0.5
        row = epochs[np.searchsorted(epochs[:, TIME], begin, side="right") - 1]
        q_nb, bias = row[STATE + 6 : STATE + 10], row[CORRECTION : CORRECTION + 3]
        track = in_motion.history(parts, float(row[TIME]), end, rph_from_quat(q_nb), bias, gps.lla[0, 0])
        self._time, self._v = track.time, track.u_n[:, :2]
        step = np.diff(self._time)[:, None]
        self._p = np.vstack([np.zeros(2), np.cumsum(0.5 * (self._v[1:] + self._v[:-1]) * step, axis=0)])
        self._c = dcm_from_quat(track.q_nb)[:, :2].reshape(-1, 6)
        self._gps, self._lag, self.middle = gps, lag, float(gps.time.mean())
        self._moved = ned_offset(gps.lla, gps.lla[0])[:, :2]
        self._velocities = bool(np.isfinite(gps.v_n).all())

    def left(self, delays: FloatArray, lever_b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """What is left of fixes and lever arm after the fit, for each of `delays` (k,): their products.

        Returns: by lever arm twice (k, 3, 3), by lever arm and fixes (k, 3), by fixes twice (k,); degrees of freedom.
        """
        gps = self._gps
        at = gps.time - delays[:, None]
        middle = at.mean(axis=1, keepdims=True)
        p, c = self._at(self._p, at), self._at(self._c, at).reshape(*at.shape, 2, 3)
        s = at - middle
        weight = 1.0 / gps.position_sd[:, :2].max(axis=1)
        rows = [self._rows(np.stack([s**0, s, 0.5 * s**2], axis=-1), p, self._moved, c, weight)]
        if self._velocities:
            at = at - self._lag
            v, s = self._at(self._v, at), at - middle
            half = 0.05
            swing = (self._at(self._c, at + half) - self._at(self._c, at - half)).reshape(c.shape) / (2.0 * half)
            weight = 1.0 / gps.velocity_sd[:, :2].max(axis=1)
            rows.append(self._rows(np.stack([0.0 * s, s**0, s], axis=-1), v, gps.v_n[:, :2], swing, weight))
        prior = np.zeros((delays.size, 1, 11))
        prior[:, 0, 6] = 1.0 / HEADING_SD
        whole = np.concatenate([*rows, prior], axis=1)
        whole[..., 10] -= whole[..., 7:10] @ lever_b
        q, _ = np.linalg.qr(whole[..., :7])
        rest = whole[..., 7:] - q @ (np.swapaxes(q, 1, 2) @ whole[..., 7:])
        product = np.swapaxes(rest, 1, 2) @ rest
        return product[:, :3, :3], product[:, :3, 3], product[:, 3, 3], whole.shape[1] - 7

    def _at(self, values: FloatArray, time: FloatArray) -> FloatArray:
        return np.stack([np.interp(time, self._time, column) for column in values.T], axis=-1)

    @staticmethod
    def _rows(
        base: FloatArray, track: FloatArray, fixes: FloatArray, lever: FloatArray, weight: FloatArray
    ) -> FloatArray:
        """North and east: three errors each, heading, lever arm, and fixes less track, by their standard deviation."""
        flat, _ = np.linalg.qr(base)
        bent = track - flat @ (np.swapaxes(flat, 1, 2) @ track)
        rows = np.zeros((base.shape[0], 2, base.shape[1], 11))
        for axis, turned in enumerate((-bent[..., 1], bent[..., 0])):
            rows[:, axis, :, 3 * axis : 3 * axis + 3] = base
            rows[:, axis, :, 6] = turned
            rows[:, axis, :, 7:10] = lever[..., axis, :]
            rows[:, axis, :, 10] = fixes[:, axis] - track[..., axis]
        return (rows * weight[:, None]).reshape(base.shape[0], -1, 11)


_Left = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _left(windows: list[_Window], delays: FloatArray, lever_b: FloatArray) -> _Left:
    """What is left in each window with each delay, (windows, delays, ...), and its degrees of freedom, (windows,)."""
    found = [window.left(delays, lever_b) for window in windows]
    by_lever, mixed, fixes, freedom = (np.array([each[i] for each in found]) for i in range(4))
    return by_lever, mixed, fixes, freedom


def _drift(windows: list[_Window], left: _Left, lever_sd: float, middle: float) -> tuple[float, FloatArray, FloatArray]:
    """Drift of the delay [s/s], zero unless surely known, and the cost of delays with it, in all and by window.

    `left`: with delays `FINE` apart and one more; `middle`: time at which the delay is asked for [s].
    """
    away = np.array([window.middle for window in windows]) - middle
    reach = float(np.abs(away).max())
    rows, steps = np.arange(away.size)[:, None], np.arange(left[2].shape[1] - 1)
    costs, least = [], np.empty(DRIFTS.size)
    for number, drift in enumerate(DRIFTS):
        at = steps + (drift / reach / FINE * away)[:, None]
        near = np.clip(np.rint(at).astype(int), 1, steps.size - 2)

        def moved(values: FloatArray, near: IntArray = near, at: FloatArray = at) -> FloatArray:
            u = (at - near).reshape(*at.shape, *(1,) * (values.ndim - 2))
            one, two, three = (values[rows, near + k] for k in (-1, 0, 1))
            return np.asarray(two + 0.5 * u * (three - one) + 0.5 * u * u * (three - 2.0 * two + one))

        cost, unscaled, each = _cost((moved(left[0]), moved(left[1]), moved(left[2]), left[3]), lever_sd)
        known = np.abs(at - near).max(axis=0) <= 0.5 + 1e-9
        costs.append((np.where(known, cost, np.inf), each))
        least[number] = unscaled[known].min()
    best, none = int(np.argmin(least)), DRIFTS.size // 2
    gain = least[none] - least[max(best - 1, 0) : best + 2]  # a single high step is an accident of the weights
    # twice what it would be of white errors: those of urban fixes last (gain 15 of a clock that was right)
    sure = gain.size == 3 and gain.min() > SURE**2 and abs(DRIFTS[best]) > DRIFT_WORTH
    drift = float(DRIFTS[best] / reach)
    return drift if sure and abs(drift) < LARGEST_DRIFT else 0.0, *costs[best]


def _cost(left: _Left, lever_sd: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Negative log-likelihood of delays; windows that no delay explains weigh less.

    Returns: with the weights of the likeliest; with those of each delay, to compare with another call; the first by
    window, without the prior of the lever arm.
    """
    by_lever, mixed, fixes, freedom = left
    weight, cost, rest, each = np.ones(freedom.size), np.empty(0), np.empty(0), np.empty(0)
    for _ in range(3):
        total = np.einsum("w,wkij->kij", weight, by_lever) + np.eye(3) / lever_sd**2
        arm = np.linalg.solve(total, np.einsum("w,wki->ki", weight, mixed)[..., None])[..., 0]
        rest = fixes - 2.0 * np.einsum("wki,ki->wk", mixed, arm) + np.einsum("ki,wkij,kj->wk", arm, by_lever, arm)
        each = 0.5 * weight[:, None] * rest
        cost = each.sum(axis=0) + 0.5 * np.sum(arm**2, axis=1) / lever_sd**2
        weight = freedom / np.maximum(rest[:, np.argmin(cost)], 0.05 * freedom)
    return cost, 0.5 * freedom @ np.log(np.maximum(rest, 0.05 * freedom[:, None])), each


def on_time(prepared: Callable[[float, float], Prepared], settings: FilterSettings) -> Prepared:
    """Prepare a recording, its samples moved into the time of the fixes where these are late or early.

    Whether vibration moves the antenna otherwise than turns do is seen on the way, and where a moving start was.
    `prepared`: prepares with the clock of the samples moved by so much at the start [s], and made faster by so much
    [s/s]; `settings`: of the filter; a delay that is given is not looked for.
    """
    start = ready = prepared(0.0, 0.0)
    clock = rate = 0.0
    if settings.delay_sd <= 0.0 and settings.lever_sd <= 0.0 and not settings.lever_b.any():
        return ready
    first = seen = filtered(ready)
    for number in range(ROUNDS if settings.delay_sd > 0.0 else 0):
        seen = filtered(ready) if number else first
        delay, sd, drift = delay_of(seen)
        returns = (seen.delay, delay if abs(delay) > SURE * sd else 0.0)
        back = any(ready.clock * each < 0.0 and abs(each) > RETURN * abs(ready.clock) for each in returns)
        if back or seen.misfit > first.misfit + WORSE:
            # windows of steady turns take a heading for a delay; the filter, which has one heading, does not
            (ready, seen), rate = _by_the_filter(start, first, prepared), 0.0
            break
        if abs(delay) < max(WORTH, SURE * sd) and not drift:
            if abs(seen.delay) > SURE * seen.delay_sd and not rate:
                ready, seen = _by_the_filter(ready, seen, prepared)
            break
        clock, rate = clock + delay, rate + drift
        ready = prepared(clock, rate)
    ready = replace(ready, settings=replace(ready.settings, shaken=seen.shaken, lever_sd=seen.lever_sd))
    if seen.ready.clock == ready.clock and not ready.parts:  # of a start in motion
        ready = replace(ready, alignment=seen.ready.alignment, initial=seen.ready.initial)
    notes = []
    if ready.clock != 0.0:
        which = "late" if ready.clock > 0.0 else "early"
        notes.append(f"the fixes are {abs(ready.clock):.2f} s {which}: IMU time is moved by that")
    if rate != 0.0:
        which = "slow" if rate > 0.0 else "fast"
        notes.append(f"the clock of the IMU is {abs(1e6 * rate):.0f} ppm {which} against GPS time: corrected")
    return replace(ready, notes=(*ready.notes, *notes))


def with_surer_start(ready: Prepared, history: History) -> Prepared | None:
    """Start in motion with attitude and gyro bias as a first run has smoothed them; none if it is stationary or given.

    A lever arm is seen through the attitude: one that is off by degrees and is corrected on the way looks like turns,
    which show the arm surely and wrongly (G. P. Huang, A. I. Mourikis and S. I. Roumeliotis, "Observability-based rules
    for designing consistent EKF SLAM estimators", Int. J. Robotics Research 29 (2010) 502-528).
    """
    alignment, initial = ready.alignment, ready.initial
    if alignment.static is not None or alignment.heading_method == "given":
        return None
    found, time = history.smooth(), ready.gps.time - ready.settings.delay
    fixes = np.count_nonzero((time > found.time[0]) & (time <= found.time[-1] + TIME_TOLERANCE))
    if np.count_nonzero(found.used) < TRUE_FIXES * fixes:
        return None
    x, correction = found.state[0].copy(), found.correction[0].copy()
    feed_back(x, correction, found.after[0])
    sd = LOOKED * np.sqrt(np.diagonal(found.covariance[0])[6:])
    alignment = replace(
        alignment,
        rph=rph_from_quat(x[6:10]),
        sd=np.minimum(np.maximum(sd, LEAST_START), alignment.sd),
        gyro_bias=correction[:3],
        gyro_bias_sd=LOOKED * np.sqrt(found.variance[0, :3]),
        level_method=f"{alignment.level_method}, then filter",
        heading_method=f"{alignment.heading_method}, then filter",
    )
    own = np.sqrt(np.diagonal(initial.covariance)[:6])
    place = initial.lla, initial.v_n, own[:3], own[3:]
    initial = initial_state(alignment, ready.model, *place, from_fix=initial.from_fix)
    return replace(ready, alignment=alignment, initial=initial)


def _by_the_filter(
    ready: Prepared, seen: Filtered, prepared: Callable[[float, float], Prepared]
) -> tuple[Prepared, Filtered]:
    """Follow the delay that the filter itself finds, step by step, as long as positions become likelier."""
    for _ in range(2 * ROUNDS):  # its state goes half way
        if abs(seen.delay) < WORTH:
            break
        moved = prepared(ready.clock + seen.delay, 0.0)
        further = filtered(moved)
        if further.misfit > seen.misfit:
            break
        ready, seen = moved, further
    return ready, seen
