"""Noise of the fixes: unreported standard deviations, lag of velocity behind position, time-correlated errors.

Multipath and atmospheric errors change over tens of seconds. A filter that assumes white errors averages many fixes and
is over-confident. From velocities, this module estimates the size of these errors, which become states of the filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from insnav import spill
from insnav.alignment.clock_offset import ClockOffset, Unlike, find_clock_offset
from insnav.earth import ned_offset
from insnav.filter.gates import Gates, aside
from insnav.findings import Code, Finding
from insnav.kernels.earth import A
from insnav.spline import Spline, positive_parts
from insnav.strapdown import Intervals
from insnav.types import BoolArray, FloatArray, GpsData
from insnav.units import DEG

POSITION_FLOOR, VELOCITY_FLOOR = 0.03, 0.05  # least assumed sd of position [m], velocity [m/s]
ALIKE = 2.0  # assumed ratio of the whole error to the fix-to-fix scatter, if no sd is reported [-]
AT_ONCE = 1 << 16  # numbers per component that are sorted at a time
WINDOW = 10.0  # half width of the scatter window: a shorter one is noisy, a longer one misses a tunnel's end [s]
# Sd of a stand-alone receiver [m], [m/s]. Most of the position error changes over minutes: fix-to-fix scatter hides it.
# Data sheet of the ZED-F9P (UBX-17051259): horizontal 1.5 m CEP, which is 1.177 sd of one axis.
DEFAULT_POSITION, DEFAULT_VELOCITY = (1.5, 1.5, 3.0), (0.2, 0.2, 0.3)
DISTINCT = 5  # least number of distinct latitudes and longitudes, or velocities, to find a rounding step
ON_STEP = 0.1  # tolerance of values to multiples of the rounding step, as a share of the step [-]
FINEST = 4  # decimals of the finest velocity step that matters [m/s]
CARRIER = 0.1  # positions with more scatter are not of carrier-phase quality [m]
FLOAT, FLOAT_SD = 2, 0.3  # fix type with float ambiguities, and its least sd, whatever the receiver reports [m]
FIXED, DGPS = 1, 4  # further fix types; DGPS: 1.0 m CEP in the same data sheet
BY_FIX = {FIXED: (POSITION_FLOOR,) * 3, FLOAT: (FLOAT_SD, FLOAT_SD, 2.0 * FLOAT_SD), DGPS: (1.0, 1.0, 2.0)}  # [m]
OPEN_SD = 100.0  # sd of an unmeasured height [m] or vertical velocity [m/s]: usable, but with almost no weight
SPARSE = 2.0  # longest interval between fixes for estimates from scatter: motion dominates longer ones [s]
LAG_WORTH = 0.03  # a smaller lag is not corrected: at 2 m/s^2 it causes 0.06 m/s, the noise of a good velocity [s]


def heights_measured(lla: FloatArray) -> bool:
    """Test whether heights in `lla` (n, 3) are measured. A constant height in a moving vehicle is not."""
    return len(lla) < 2 or bool(np.ptp(lla[:, 2]) > 0.0 or np.ptp(lla[:, 0]) == 0.0)


def vertical_measured(v_n: FloatArray) -> bool:
    """Test whether vertical velocities in `v_n` (n, 3) are measured. A constant while the others change is not."""
    complete = v_n[np.isfinite(v_n).all(axis=1)]
    changes = complete.max(axis=0, initial=-np.inf) - complete.min(axis=0, initial=np.inf)
    return bool(changes[2] != 0.0 or not changes[:2].any())


def name_lag(lag: float, sd: float) -> Finding:
    """Report the lag of velocities behind positions [s], which insnav corrects, and its sd [s]."""
    return Finding.of(Code.GPS_VELOCITY_LAG, lag_s=lag, lag_sd_s=max(sd, 0.001))


def velocity_lag(gps: GpsData) -> tuple[float, float]:
    """Estimate the lag of velocities behind positions from the fixes alone.

    Some receivers combine the current position with the mean velocity since the previous fix. The slope of a spline
    through the positions, minus this velocity, is then the lag times the acceleration. A robust straight line through
    these differences over acceleration, for the horizontal components, estimates the lag.

    Returns: `lag`, `sd` [s]. The sd is infinite with too few or too sparse fixes, or without accelerations.
    """
    gps = gps.rows(np.flatnonzero(np.isfinite(gps.v_n).all(axis=1) & gps.valid))
    gps = gps.rows(~aside(Gates(), gps))
    t = gps.time
    if t.shape[0] < 50:
        return 0.0, np.inf
    step = np.diff(t)
    if np.median(step) > SPARSE:
        return 0.0, np.inf
    moved = ned_offset(gps.lla[1:], gps.lla[:-1])[:, :2]  # from fix to fix: the track may be long
    position = Spline(t, np.vstack([np.zeros(2), np.cumsum(moved, axis=0)]))
    regular: BoolArray = np.asarray(np.abs(step / np.median(step) - 1.0) < 0.1)
    usable: BoolArray = np.zeros(t.shape[0], dtype=bool)
    usable[3:-2] = np.asarray(np.lib.stride_tricks.sliding_window_view(regular, 5).all(axis=1), dtype=bool)
    if usable.sum() < 40:
        return 0.0, np.inf
    v = gps.v_n[:, :2]
    change = np.zeros_like(v)
    change[1:-1] = (v[2:] - v[:-2]) / (t[2:] - t[:-2])[:, None]
    t, v, instrument = t[usable], v[usable], change[usable].ravel()
    lag, sd = 0.0, np.inf
    for _ in range(20):
        # Gauss-Newton step for the lag. Noise of the spline's acceleration is also in the residual and would bias the
        # slope. The change of the measured velocity has no such noise: it serves as instrumental variable (Soderstrom
        # and Stoica, "System Identification", 1989, chapter 8).
        speed, acceleration = position.changes(t - lag)
        residual, acceleration = (speed - v).ravel(), acceleration.ravel()
        scale = 1.4826 * float(np.median(np.abs(residual))) + 1e-9
        weight = 1.0 / (1.0 + (residual / (3.0 * scale)) ** 2) ** 2
        power = float(np.sum(weight * instrument * acceleration))
        if power < 1.0:
            return 0.0, np.inf
        correction = float(np.sum(weight * instrument * residual)) / power
        lag = float(np.clip(lag + correction, -1.0, 1.0))
        sd = scale * float(np.sqrt(np.sum(weight * instrument**2))) / power
        if abs(correction) < 1e-5:
            break
    return lag, sd


def clock_offset(parts: Intervals, fixes: GpsData, *, worth: float = 0.0) -> ClockOffset | Unlike | None:
    """Estimate the clock offset from samples to positions, or find that no offset makes them agree; None if unknown.

    `parts`: samples as intervals. `fixes`: with standard deviations. `worth`: smaller offsets may give None [s].
    """
    offset = find_clock_offset(parts, fixes, worth=worth)
    if not isinstance(offset, ClockOffset):
        return offset
    lag, sd = velocity_lag(fixes)
    return replace(offset, offset=offset.offset - lag) if abs(lag) > max(LAG_WORTH, 5.0 * sd) else offset


def _scatter(
    time: FloatArray, values: FloatArray, floor: float, default: tuple[float, ...], least_scatter: float
) -> FloatArray:
    """Estimate the noise sd of a smooth series (n, 3) from third differences: the larger of an overall and a local sd.

    `floor`: lower limit. If the overall sd exceeds `least_scatter`, `default` is the lower limit.

    ``x[i] - 3 x[i+1] + 3 x[i+2] - x[i+3]`` removes any uniformly accelerated motion and has 20 times the variance of
    the noise. 1.4826 times the median of its magnitude is a robust standard deviation. The factor `ALIKE` accounts for
    the correlation of neighbouring errors, which partly cancel in the difference.
    """
    n = time.shape[0]
    good = np.flatnonzero(np.isfinite(values).all(axis=1))
    if good.size < 20 or float(np.median(np.diff(time[good]))) > SPARSE:
        return np.tile(np.asarray(default), (n, 1))
    third, middle = _third_differences(time[good], values[good])
    third *= ALIKE
    if third.shape[0] < 20:
        return np.tile(np.asarray(default), (n, 1))
    overall: FloatArray = np.median(third, axis=0)
    # a receiver that smooths may have metres of slow error, which are not in the scatter
    sd_floor = np.maximum(floor, default if overall[:2].max() > least_scatter else 0.0)
    begin, end = np.searchsorted(middle, [time - WINDOW, time + WINDOW])
    count = end - begin
    largest_count, sd = int(count.max()), np.empty((n, 3))
    for block in spill.blocks(n, size=1 + AT_ONCE // (largest_count + 1)):
        rows = begin[block, None] + np.arange(largest_count)
        window = np.where((rows < end[block, None])[..., None], third[np.minimum(rows, third.shape[0] - 1)], np.inf)
        window.sort(axis=1)
        low, high = (np.maximum(count[block, None, None] + i, 0) // 2 for i in (-1, 0))
        median = 0.5 * (np.take_along_axis(window, low, axis=1) + np.take_along_axis(window, high, axis=1))[:, 0]
        sd[block] = np.where(count[block, None] < 5, overall, np.maximum(overall, median))
    return np.asarray(np.maximum(sd, sd_floor))


def _third_differences(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return scaled third differences (k, c), whose median is the sd of white noise, and their times (k,) [s]."""
    step = np.diff(time)
    even = np.max(np.column_stack([step[:-2], step[1:-1], step[2:]]), axis=1) < 1.5 * np.median(step)
    third = np.abs(np.diff(values, n=3, axis=0)) * (1.4826 / np.sqrt(20.0))
    return third[even], time[1:-2][even]


def white_noise(time: FloatArray, values: FloatArray) -> tuple[float, int]:
    """Estimate the white noise of a smooth series (n, c), norm of all components, and the number of differences."""
    if len(time) < 4:
        return 0.0, 0
    third, _ = _third_differences(time, values)
    return float(np.linalg.norm(np.median(third, axis=0))) if len(third) else 0.0, len(third)


def _by_fix(gps: GpsData, scatter: FloatArray) -> FloatArray:
    """Return the standard deviation of each position by its fix type, (n, 3) [m]; `scatter` (n, 3) is a lower limit.

    If the scatter is too large for fixed ambiguities, type 1 is only a validity flag.
    """
    sd = np.tile(DEFAULT_POSITION, (gps.time.shape[0], 1))
    if gps.fix is not None:
        for kind, of_kind in BY_FIX.items():
            sd[(gps.fix == kind) & (kind != FIXED or float(np.median(scatter[:, :2])) < CARRIER)] = of_kind
    return np.asarray(np.maximum(sd, scatter))


def _digits(lla: FloatArray) -> int:
    """Find the number of decimals of latitudes and longitudes ``(n, 3)`` in degrees; zero if unknown or above five.

    It is unknown if there are few fixes, or if the vehicle stays within few rounding steps. The innovations later show
    rounding errors of a tenth of a metre.
    """
    degrees = lla[:, :2] / DEG

    def whole(digits: int) -> bool:
        steps = degrees * 10.0**digits
        return bool((np.abs(steps - np.round(steps)) < 1e-9 * 10.0**digits).all())

    if len(lla) < DISTINCT or not whole(5) or min(len(np.unique(each)) for each in degrees.T) < DISTINCT:
        return 0
    return next(digits for digits in range(2, 6) if whole(digits))


def _rounding(values: FloatArray) -> tuple[float, FloatArray]:
    """Find the rounding step of values (n,), or zero, and the number of successive equal values around each (n,).

    A repeated nonzero value keeps its rounding error, so the mean of such fixes is no better than one fix.
    """
    repeats = np.ones(values.size)
    finite = np.flatnonzero(np.isfinite(values))
    distinct, number = np.unique(np.round(values[finite], FINEST), return_inverse=True)
    if distinct.size < 2:
        return 0.0, repeats
    lengths = np.diff(np.flatnonzero(np.diff(number, prepend=-1, append=-1)))
    repeats[finite] = np.where(distinct[number] == 0.0, 1, np.repeat(lengths, lengths))
    if distinct.size < DISTINCT:
        return 0.0, repeats
    steps = np.diff(distinct)
    multiples = np.concatenate([[0.0], np.cumsum(np.round(steps / steps.min()))])
    step = float(multiples @ (distinct - distinct[0]) / (multiples @ multiples))
    error = np.abs(distinct - distinct[0] - step * multiples)
    return (step if error.max() < ON_STEP * step else 0.0), repeats


def with_sd(gps: GpsData, *, scatter_alone: bool = True) -> tuple[GpsData, tuple[Finding, ...]]:
    """Fill in missing standard deviations, and return also findings on the assumptions.

    `scatter_alone`: a small position scatter proves carrier-phase fixes, and the scatter gives the whole error.
    Otherwise the fix type gives the whole error, and scatter only its white part: the filter separates both parts.
    """
    notes = []
    position_sd, velocity_sd = gps.position_sd, gps.velocity_sd
    measured = 3 if heights_measured(gps.lla) else 2  # number of measured components
    missing: BoolArray = np.isnan(position_sd)
    partly = missing & ~missing.all(axis=1, keepdims=True)  # some components lack an sd
    if missing.any():
        carrier, code = CARRIER, Code.GPS_POSITION_SD_SCATTER
        if not scatter_alone:
            carrier = np.inf
            code = Code.GPS_POSITION_SD_STAND_ALONE if gps.fix is None else Code.GPS_POSITION_SD_FIX_TYPE
        estimated = _scatter(gps.time, ned_offset(gps.lla, gps.lla[0]), POSITION_FLOOR, DEFAULT_POSITION, carrier)
        if not scatter_alone:
            estimated = _by_fix(gps, estimated / ALIKE)
        largest = np.fmax.reduce(position_sd, axis=1, keepdims=True)  # lower limit of a missing sd
        position_sd = np.where(missing, np.fmax(estimated, largest), position_sd)
        rows = missing[:, :measured].any(axis=1)
        if rows.any():
            middle = np.median(position_sd[rows], axis=0).tolist()
            notes.append(Finding.of(code, count=rows.sum(), sd_m=middle, floor_m=POSITION_FLOOR))
    if digits := _digits(gps.lla):
        step = 10.0**-digits * DEG * A * np.array([1.0, math.cos(float(gps.lla[0, 0])), 0.0])
        if (position_sd < step / math.sqrt(12.0)).any():
            position_sd = np.maximum(position_sd, step / math.sqrt(12.0))  # sd of rounding
            least = step[:2].max() / math.sqrt(12.0)
            notes.append(Finding.of(Code.GPS_ROUNDED_POSITION, sd_m=least, step_m=step[0], decimals=digits))
    if gps.fix is not None:
        overconfident = (gps.fix == FLOAT) & (np.where(partly, 0.0, position_sd).max(axis=1) < FLOAT_SD)
        if overconfident.any():
            position_sd = np.where(overconfident[:, None], np.maximum(position_sd, FLOAT_SD), position_sd)
            notes.append(Finding.of(Code.GPS_FLOAT, count=overconfident.sum(), limit_m=FLOAT_SD))
    if measured < 3:
        position_sd = np.where([False, False, True], OPEN_SD, position_sd)
    v_n = gps.v_n if vertical_measured(gps.v_n) else np.where([True, True, False], gps.v_n, np.nan)
    half_known = np.logical_xor(*np.isfinite(v_n[:, :2]).T)
    if half_known.any():
        v_n = np.where(half_known[:, None], np.nan, v_n)
        notes.append(Finding.of(Code.GPS_VELOCITY_HALF, count=half_known.sum()))
    no_vertical = np.isfinite(v_n[:, :2]).all(axis=1) & np.isnan(v_n[:, 2])
    if no_vertical.any():
        v_n = np.where(no_vertical[:, None] & [False, False, True], 0.0, v_n)
        velocity_sd = np.where(no_vertical[:, None] & [False, False, True], OPEN_SD, velocity_sd)
        notes.append(Finding.of(Code.GPS_VELOCITY_LEVEL, count=no_vertical.sum()))
    given = np.isfinite(v_n).all(axis=1)
    missing = np.asarray(given & np.isnan(velocity_sd).any(axis=1))
    if missing.any():
        estimated = _scatter(gps.time, v_n, VELOCITY_FLOOR, DEFAULT_VELOCITY, np.inf)
        estimated[no_vertical, 2] = OPEN_SD
        velocity_sd = np.where(missing[:, None], estimated, velocity_sd)
        middle = np.median(velocity_sd[missing], axis=0).tolist()
        notes.append(
            Finding.of(Code.GPS_VELOCITY_SD_SCATTER, count=missing.sum(), sd_m_s=middle, floor_m_s=VELOCITY_FLOOR)
        )
    steps, repeats = zip(*map(_rounding, v_n.T), strict=True) if len(v_n) >= DISTINCT else ((0.0,), ())
    step = np.where(steps, steps, max(steps))  # 0 is unknown: use the largest step of the axes
    if step.any() and (velocity_sd < (least := step * np.sqrt(np.column_stack(repeats) / 12.0))).any():
        velocity_sd = np.maximum(velocity_sd, least)
        sd = max(steps) / math.sqrt(12.0)
        notes.append(Finding.of(Code.GPS_ROUNDED_VELOCITY, sd_m_s=sd, step_m_s=max(steps)))
    return replace(gps, v_n=v_n, position_sd=position_sd, velocity_sd=velocity_sd), tuple(notes)


LONGEST = 400.0  # longest time difference at which position errors are compared [s]
TIMES = np.geomspace(3.0, 300.0, 25)  # tested correlation times [s]
WORTH = 0.1  # least share of the variance with an effect on the filter [-]
FEWEST = 100  # least number of fixes to determine a correlation time
ROUGH = 0.05  # largest error of integrated velocity between fixes, in position sds [-]
WHOLE = 0.7  # least share of the reported variance that counts as complete [-]
WORTH_REPORTED = 0.3  # least missing share of the reported variance that counts as time-correlated [-]
MISFIT = 1.3  # largest misfit, relative to white errors alone, to accept the reported variance as true [-]
SHORTEST_REPORTED = 10.0  # shortest correlation time of a missing part: a shorter one would be visible [s]
TOO_MUCH = 3.0  # largest ratio of apparent to reported variance: a larger one has other causes [-]
LARGEST_SHARE = 0.95  # largest time-correlated share: part of the error is always white [-]
BETTER = 0.8  # largest misfit with a correlated part, relative to white errors alone, to accept that part [-]
CHI2_MEDIAN = 0.4549  # median of chi-square with one degree of freedom


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """Time-correlated (Gauss-Markov) errors of position and, if detected, of velocity."""

    share: float  # time-correlated share of the position variance [-]
    time: float  # correlation time of the position error [s]
    sd: FloatArray  # (3,) standard deviation of the time-correlated position error, North, East, Down [m]
    by_reported: bool = False  # inferred only from scatter smaller than the reported variance
    velocity_sd: FloatArray | None = None  # (3,) sd of the time-correlated velocity error [m/s]; None without
    velocity_time: float = np.inf  # correlation time of the velocity error [s]

    @classmethod
    def of_fixes(cls, share: float, time: float, position_sd: FloatArray, *, by_reported: bool = False) -> Self:
        """Build the noise from its share [-], its correlation time [s], and position sds (n, 3) [m]."""
        return cls(share, time, np.sqrt(share) * np.median(position_sd, axis=0), by_reported)

    @property
    def sds(self) -> FloatArray:
        """Standard deviations of the states, (3,) or (6,) [m, m/s]."""
        return self.sd if self.velocity_sd is None else np.concatenate([self.sd, self.velocity_sd])

    @property
    def times(self) -> FloatArray:
        """Correlation times of the states, (3,) or (6,) [s]."""
        return np.repeat([self.time, self.velocity_time], 3)[: self.sds.size]


@dataclass(frozen=True, slots=True)
class Rough:
    """Interval of multipath, with more driving noise of the time-correlated position error."""

    begin: float  # begin and end of the interval [s]
    end: float
    driven: float  # root of the spectral density of the driving noise, each axis [m/sqrt(s)]
    time: float  # correlation time of the error [s]

    @property
    def sd(self) -> float:
        """Standard deviation of the position error after a long time with this noise [m]."""
        return float(self.driven * np.sqrt(0.5 * self.time))

    def drive(self, now: float, times: FloatArray, sds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Adapt correlation times [s] and standard deviations of the time-correlated states to time `now` [s]."""
        if not self.begin <= now < self.end + 3.0 * self.time:  # after three correlation times the error has decayed
            return times, sds
        times, sds = times.copy(), sds.copy()
        times[:3] = self.time
        if now < self.end:
            sds[:3] = np.hypot(sds[:3], self.sd)
        return times, sds


def correlated_noise(gps: GpsData, lag: float, *, reported: bool = True) -> CorrelatedNoise | None:
    """Estimate the time-correlated part of the position error.

    Position change minus integrated velocity over m fixes is the difference of two position errors plus the sum of m
    velocity errors. Half its variance grows from the white part at small m to the whole variance at large m. Velocity
    noise adds a part in proportion to m. A non-negative fit separates the three parts.

    `lag`: lag of velocities behind positions [s]. `reported`: use the receiver's own standard deviations where a drive
    is too short to show the whole error.
    Returns: None without velocities, with too few fixes, or with white errors only.
    """
    good = np.isfinite(gps.v_n).all(axis=1) & np.isfinite(gps.position_sd).all(axis=1)
    if good.sum() < FEWEST:
        return None
    t, sd = gps.time[good], gps.position_sd[good]
    step = np.diff(t)
    interval = float(np.median(step))
    gap = step > 1.5 * interval
    lla, v = gps.lla[good], gps.v_n[good][:, :2]
    moved = ned_offset(lla[1:], lla[:-1])[:, :2]
    integrated = np.diff(Spline(t, v).integral(t + lag), axis=0)
    # error of the integral: a sixteenth of its change with every other velocity, as the spline is of fourth order
    halved = np.diff(Spline(t[::2], v[::2]).integral(t + lag), axis=0)
    even = ~np.logical_or(gap[0:-1:2], gap[1::2])
    error_of_integral = (halved - integrated)[: 2 * even.shape[0]].reshape(-1, 2, 2).sum(axis=1)[even] / 16.0
    if error_of_integral.size == 0 or np.sqrt(np.mean(error_of_integral**2)) > ROUGH * float(np.median(sd[:, :2])):
        return None  # the velocities are too sparse for an accurate integral
    # position error minus the sum of velocity errors
    error = np.vstack([np.zeros(2), np.cumsum(moved - integrated, axis=0)])
    stretch = np.concatenate([[0], np.cumsum(gap)])
    largest_lag = min(LONGEST / interval, t.shape[0] / 4)
    lags = np.unique(np.geomspace(1, max(largest_lag, 2), 30).astype(int))
    variance, weight = [], []
    for m in lags:  # half the variance of differences over m fixes, relative to the reported variance
        same_stretch = stretch[m:] == stretch[:-m]
        if same_stretch.sum() < 20:
            continue
        difference = (error[m:] - error[:-m])[same_stretch] / sd[:, :2][m:][same_stretch]
        # robust variance: median of the squares over the median of chi-square with one degree of freedom
        variance.append(0.5 * float(np.median(difference * difference)) / CHI2_MEDIAN)
        weight.append(np.sqrt(same_stretch.sum() / m))
    if len(variance) < 8:
        return None
    x, y = lags[: len(variance)] * interval, np.array(variance)
    scale = np.array(weight) / (y + 0.05)
    ones = np.ones_like(x)
    white_only = positive_parts(np.column_stack([ones, x]) * scale[:, None], y * scale)[1]
    fits = [_fit(x, y, scale, float(each)) for each in TIMES]
    misfit, time, (white, correlated, _) = min(fits, key=lambda found: found[0])
    total = white + correlated
    # accept the correlated part if it fits better, the total agrees with the reported sd, and the record is long enough
    visible = TIMES[0] < time <= x[-1] / 5.0 and WHOLE < total <= TOO_MUCH
    by_reported = not (visible and misfit <= BETTER * white_only and correlated >= max(0.05, WORTH * total))
    if by_reported:
        share, time = _by_reported(x, y, scale, white_only) if reported else (0.0, 0.0)
        if share < WORTH_REPORTED:
            return None
    else:
        share = correlated / total
    share = min(float(share), LARGEST_SHARE)
    return CorrelatedNoise.of_fixes(share, time, sd, by_reported=by_reported)


def _fit(x: FloatArray, y: FloatArray, scale: FloatArray, time: float) -> tuple[float, float, FloatArray]:
    """Fit white, time-correlated and linear (velocity noise) parts; return misfit, correlation time and parts."""
    terms = np.column_stack([np.ones_like(x), 1.0 - np.exp(-x / time), x])
    parts, misfit = positive_parts(terms * scale[:, None], y * scale)
    return misfit, time, parts


def _by_reported(x: FloatArray, y: FloatArray, scale: FloatArray, white_only: float) -> tuple[float, float]:
    """Estimate share and correlation time of position errors under the assumption that the reported variance is true.

    A drive shorter than the correlation time shows the white part only. If successive fixes scatter less than reported,
    they either share an error or are better than reported. This function assumes a shared error, unless white errors of
    another size fit much better. A long record shows, for example, that errors do not grow further.
    """
    best = np.inf, 0.0, 0.0
    for time in TIMES[TIMES >= SHORTEST_REPORTED]:
        fading = np.exp(-x / time)  # model: white + (1 - white) (1 - fading) + slope x
        (white, _), misfit = positive_parts(np.column_stack([fading, x]) * scale[:, None], (y - 1.0 + fading) * scale)
        best = min(best, (misfit, 1.0 - float(white), float(time)))
    return (best[1], best[2]) if best[0] <= MISFIT * white_only else (0.0, 0.0)
