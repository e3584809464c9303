"""Noise of the fixes: unreported standard deviations, lag of velocity behind position, time-correlated errors.

Multipath and atmosphere change over tens of seconds. A filter that assumes white errors is over-confident: it averages
many fixes. With velocities, this module estimates the errors, which become states of the filter.
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
from insnav.spline import Spline
from insnav.strapdown import Intervals
from insnav.types import BoolArray, FloatArray, GpsData
from insnav.units import DEG

POSITION_FLOOR, VELOCITY_FLOOR = 0.03, 0.05  # smallest standard deviation assumed [m], [m/s]
ALIKE = 2.0  # whole error of fixes over their fix-to-fix scatter, if no sd is reported [-]
AT_ONCE = 1 << 16  # numbers per component sorted at a time
WINDOW = 10.0  # time before and after for the scatter: shorter is noise, longer misses a tunnel's end [s]
# Stand-alone receiver [m], [m/s]: most of the position error changes over minutes, invisible in fix-to-fix scatter.
# Data sheet of the ZED-F9P (UBX-17051259): horizontal 1.5 m CEP, which is 1.177 sd of one axis.
DEFAULT_POSITION, DEFAULT_VELOCITY = (1.5, 1.5, 3.0), (0.2, 0.2, 0.3)
DISTINCT = 5  # least number of distinct latitudes and longitudes, or velocities, to find a rounding step
ON_STEP = 0.1  # of a step: tolerance of velocities to its multiples, from decimals
FINEST = 4  # decimals of relevant velocity steps [m/s]
CARRIER = 0.1  # position scatter beyond this is not carrier-phase quality [m]
FLOAT, FLOAT_SD = 2, 0.3  # ambiguities not fixed: decimetres at best, whatever the reported sd [m]
FIXED, DGPS = 1, 4  # further fix types; with satellite corrections 1.0 m CEP, same data sheet
BY_FIX = {FIXED: (POSITION_FLOOR,) * 3, FLOAT: (FLOAT_SD, FLOAT_SD, 2.0 * FLOAT_SD), DGPS: (1.0, 1.0, 2.0)}  # [m]
OPEN_SD = 100.0  # of an unmeasured height [m] or vertical velocity [m/s]: the largest of a usable fix, almost no weight
SPARSE = 2.0  # at longer intervals the velocity in between is unknown: motion dominates the scatter [s]
LAG_WORTH = 0.03  # a smaller lag is not corrected: at 2 m/s^2 it makes 0.06 m/s, the noise of a good velocity [s]


def heights_measured(lla: FloatArray) -> bool:
    """Return whether heights (n, 3) are measured, not one constant in every row while the vehicle moves."""
    return len(lla) < 2 or bool(np.ptp(lla[:, 2]) > 0.0 or np.ptp(lla[:, 0]) == 0.0)


def vertical_measured(v_n: FloatArray) -> bool:
    """Return whether vertical velocities are measured, not one constant in every row (n, 3) while others change."""
    known = v_n[np.isfinite(v_n).all(axis=1)]
    changes = known.max(axis=0, initial=-np.inf) - known.min(axis=0, initial=np.inf)
    return bool(changes[2] != 0.0 or not changes[:2].any())


def name_lag(lag: float, sd: float) -> Finding:
    """Report the lag of velocities behind positions [s] that insnav corrects."""
    return Finding.of(Code.GPS_VELOCITY_LAG, lag_s=lag, lag_sd_s=max(sd, 0.001))


def velocity_lag(gps: GpsData) -> tuple[float, float]:
    """Estimate the lag of velocities behind positions from the fixes alone.

    Some receivers combine the current position with the mean velocity since the previous fix. The slope of a spline
    through the positions, minus this velocity, is then the lag times the acceleration. A robust straight line through
    the horizontal components estimates it.

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
    gone = ned_offset(gps.lla[1:], gps.lla[:-1])[:, :2]  # fix by fix: the track may be long
    position = Spline(t, np.vstack([np.zeros(2), np.cumsum(gone, axis=0)]))
    even: BoolArray = np.asarray(np.abs(step / np.median(step) - 1.0) < 0.1)
    inside: BoolArray = np.zeros(t.shape[0], dtype=bool)
    inside[3:-2] = np.asarray(np.lib.stride_tricks.sliding_window_view(even, 5).all(axis=1), dtype=bool)
    if inside.sum() < 40:
        return 0.0, np.inf
    v = gps.v_n[:, :2]
    change = np.zeros_like(v)
    change[1:-1] = (v[2:] - v[:-2]) / (t[2:] - t[:-2])[:, None]
    t, v, instrument = t[inside], v[inside], change[inside].ravel()
    lag, sd = 0.0, np.inf
    for _ in range(20):
        # Gauss-Newton on the spline of velocity, shifted by the current lag. Noise of its acceleration is also in the
        # residual. The change of the measured velocity is free of it and serves as instrumental variable (Soderstrom
        # and Stoica, "System Identification", 1989, chapter 8).
        speed, a = position.changes(t - lag)
        d, a = (speed - v).ravel(), a.ravel()
        scale = 1.4826 * float(np.median(np.abs(d))) + 1e-9
        weight = 1.0 / (1.0 + (d / (3.0 * scale)) ** 2) ** 2
        power = float(np.sum(weight * instrument * a))
        if power < 1.0:
            return 0.0, np.inf
        correction = float(np.sum(weight * instrument * d)) / power
        lag = float(np.clip(lag + correction, -1.0, 1.0))
        sd = scale * float(np.sqrt(np.sum(weight * instrument**2))) / power
        if abs(correction) < 1e-5:
            break
    return lag, sd


def clock_offset(parts: Intervals, fixes: GpsData, *, worth: float = 0.0) -> ClockOffset | Unlike | None:
    """Estimate the IMU clock's lag behind the positions, or find that no clock explains them; None if unknown.

    `parts`: samples as intervals. `fixes`: with standard deviations. `worth`: smaller offsets may give None [s].
    """
    found = find_clock_offset(parts, fixes, worth=worth)
    if not isinstance(found, ClockOffset):
        return found
    lag, sd = velocity_lag(fixes)
    return replace(found, offset=found.offset - lag) if abs(lag) > max(LAG_WORTH, 5.0 * sd) else found


def _scatter(
    time: FloatArray, values: FloatArray, floor: float, default: tuple[float, ...], least_scatter: float
) -> FloatArray:
    """Estimate white noise of a smooth series from third differences, overall and locally: the larger.

    Above `least_scatter`, the scatter of carrier-phase fixes, `default` is the lower limit.

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
    # smoothing in the receiver hides metres of slow error from this estimate
    sd_floor = np.maximum(floor, default if overall[:2].max() > least_scatter else 0.0)
    begin, end = np.searchsorted(middle, [time - WINDOW, time + WINDOW])
    count = end - begin
    most, sd = int(count.max()), np.empty((n, 3))
    for block in spill.blocks(n, size=1 + AT_ONCE // (most + 1)):
        rows = begin[block, None] + np.arange(most)
        near = np.where((rows < end[block, None])[..., None], third[np.minimum(rows, third.shape[0] - 1)], np.inf)
        near.sort(axis=1)
        low, high = (np.maximum(count[block, None, None] + i, 0) // 2 for i in (-1, 0))
        median = 0.5 * (np.take_along_axis(near, low, axis=1) + np.take_along_axis(near, high, axis=1))[:, 0]
        sd[block] = np.where(count[block, None] < 5, overall, np.maximum(overall, median))
    return np.asarray(np.maximum(sd, sd_floor))


def _third_differences(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return third differences whose medians are the sd of white noise, (k, c), and their times (k,) [s]."""
    step = np.diff(time)
    even = np.max(np.column_stack([step[:-2], step[1:-1], step[2:]]), axis=1) < 1.5 * np.median(step)
    third = np.abs(np.diff(values, n=3, axis=0)) * (1.4826 / np.sqrt(20.0))
    return third[even], time[1:-2][even]


def white_noise(time: FloatArray, values: FloatArray) -> tuple[float, int]:
    """Estimate the white noise of a smooth series (n, c), all components together, and the number of differences."""
    if len(time) < 4:
        return 0.0, 0
    third, _ = _third_differences(time, values)
    return float(np.linalg.norm(np.median(third, axis=0))) if len(third) else 0.0, len(third)


def _by_fix(gps: GpsData, scatter: FloatArray) -> FloatArray:
    """Return the standard deviation of each position by its fix type, at least its scatter (n, 3) [m]; (n, 3).

    Type 1 with the scatter of single-point fixes is a validity flag and has no meaning.
    """
    sd = np.tile(DEFAULT_POSITION, (gps.time.shape[0], 1))
    if gps.fix is not None:
        for kind, of_kind in BY_FIX.items():
            sd[(gps.fix == kind) & (kind != FIXED or float(np.median(scatter[:, :2])) < CARRIER)] = of_kind
    return np.asarray(np.maximum(sd, scatter))


def _digits(lla: FloatArray) -> int:
    """Find the decimals of a degree in latitudes and longitudes ``(n, 3)``; zero if more than five.

    The rounding is unknown if a receiver stays on one step or has few fixes. The innovations reveal a tenth of a metre.
    """
    degrees = lla[:, :2] / DEG

    def whole(digits: int) -> bool:
        steps = degrees * 10.0**digits
        return bool((np.abs(steps - np.round(steps)) < 1e-9 * 10.0**digits).all())

    if len(lla) < DISTINCT or not whole(5) or min(len(np.unique(each)) for each in degrees.T) < DISTINCT:
        return 0
    return next(digits for digits in range(2, 6) if whole(digits))


def _rounding(values: FloatArray) -> tuple[float, FloatArray]:
    """Find the rounding step of values (n,), and the lengths of runs of equal values; or zero.

    A repeated nonzero value keeps its rounding error: the mean of such fixes is no better than one fix.
    """
    alike = np.ones(values.size)
    known = np.flatnonzero(np.isfinite(values))
    distinct, which = np.unique(np.round(values[known], FINEST), return_inverse=True)
    if distinct.size < 2:
        return 0.0, alike
    size = np.diff(np.flatnonzero(np.diff(which, prepend=-1, append=-1)))
    alike[known] = np.where(distinct[which] == 0.0, 1, np.repeat(size, size))
    if distinct.size < DISTINCT:
        return 0.0, alike
    gaps = np.diff(distinct)
    multiples = np.concatenate([[0.0], np.cumsum(np.round(gaps / gaps.min()))])
    step = float(multiples @ (distinct - distinct[0]) / (multiples @ multiples))
    off = np.abs(distinct - distinct[0] - step * multiples)
    return (step if off.max() < ON_STEP * step else 0.0), alike


def with_sd(gps: GpsData, *, scatter_alone: bool = True) -> tuple[GpsData, tuple[Finding, ...]]:
    """Fill in missing standard deviations; return also findings on assumptions.

    `scatter_alone`: small position scatter means carrier-phase fixes. Otherwise the fix type gives the whole error, and
    the fix-to-fix scatter only its white part, for a filter that separates the two.
    """
    notes = []
    position_sd, velocity_sd = gps.position_sd, gps.velocity_sd
    measured = 3 if heights_measured(gps.lla) else 2  # components
    missing: BoolArray = np.isnan(position_sd)
    beside = missing & ~missing.all(axis=1, keepdims=True)  # components with a reported sd
    if missing.any():
        carrier, code = CARRIER, Code.GPS_POSITION_SD_SCATTER
        if not scatter_alone:
            carrier = np.inf
            code = Code.GPS_POSITION_SD_STAND_ALONE if gps.fix is None else Code.GPS_POSITION_SD_FIX_TYPE
        found = _scatter(gps.time, ned_offset(gps.lla, gps.lla[0]), POSITION_FLOOR, DEFAULT_POSITION, carrier)
        if not scatter_alone:
            found = _by_fix(gps, found / ALIKE)
        largest = np.fmax.reduce(position_sd, axis=1, keepdims=True)  # largest reported sd: the others are no better
        position_sd = np.where(missing, np.fmax(found, largest), position_sd)
        rows = missing[:, :measured].any(axis=1)
        if rows.any():
            middle = np.median(position_sd[rows], axis=0).tolist()
            notes.append(Finding.of(code, count=rows.sum(), sd_m=middle, floor_m=POSITION_FLOOR))
    if digits := _digits(gps.lla):
        step = 10.0**-digits * DEG * A * np.array([1.0, math.cos(float(gps.lla[0, 0])), 0.0])
        if (position_sd < step / math.sqrt(12.0)).any():
            position_sd = np.maximum(position_sd, step / math.sqrt(12.0))  # rounding error: uniform within half a step
            least = step[:2].max() / math.sqrt(12.0)
            notes.append(Finding.of(Code.GPS_ROUNDED_POSITION, sd_m=least, step_m=step[0], decimals=digits))
    if gps.fix is not None:
        sure = (gps.fix == FLOAT) & (np.where(beside, 0.0, position_sd).max(axis=1) < FLOAT_SD)
        if sure.any():
            position_sd = np.where(sure[:, None], np.maximum(position_sd, FLOAT_SD), position_sd)
            notes.append(Finding.of(Code.GPS_FLOAT, count=sure.sum(), limit_m=FLOAT_SD))
    if measured < 3:
        position_sd = np.where([False, False, True], OPEN_SD, position_sd)
    v_n = gps.v_n if vertical_measured(gps.v_n) else np.where([True, True, False], gps.v_n, np.nan)
    half = np.logical_xor(*np.isfinite(v_n[:, :2]).T)
    if half.any():
        v_n = np.where(half[:, None], np.nan, v_n)
        notes.append(Finding.of(Code.GPS_VELOCITY_HALF, count=half.sum()))
    level = np.isfinite(v_n[:, :2]).all(axis=1) & np.isnan(v_n[:, 2])
    if level.any():
        v_n = np.where(level[:, None] & [False, False, True], 0.0, v_n)
        velocity_sd = np.where(level[:, None] & [False, False, True], OPEN_SD, velocity_sd)
        notes.append(Finding.of(Code.GPS_VELOCITY_LEVEL, count=level.sum()))
    given = np.isfinite(v_n).all(axis=1)
    missing = np.asarray(given & np.isnan(velocity_sd).any(axis=1))
    if missing.any():
        found = _scatter(gps.time, v_n, VELOCITY_FLOOR, DEFAULT_VELOCITY, np.inf)
        found[level, 2] = OPEN_SD
        velocity_sd = np.where(missing[:, None], found, velocity_sd)
        middle = np.median(velocity_sd[missing], axis=0).tolist()
        notes.append(
            Finding.of(Code.GPS_VELOCITY_SD_SCATTER, count=missing.sum(), sd_m_s=middle, floor_m_s=VELOCITY_FLOOR)
        )
    steps, alike = zip(*map(_rounding, v_n.T), strict=True) if len(v_n) >= DISTINCT else ((0.0,), ())
    step = np.where(steps, steps, max(steps))  # few values: assume the step of the others
    if step.any() and (velocity_sd < (least := step * np.sqrt(np.column_stack(alike) / 12.0))).any():
        velocity_sd = np.maximum(velocity_sd, least)
        sd = max(steps) / math.sqrt(12.0)
        notes.append(Finding.of(Code.GPS_ROUNDED_VELOCITY, sd_m_s=sd, step_m_s=max(steps)))
    return replace(gps, v_n=v_n, position_sd=position_sd, velocity_sd=velocity_sd), tuple(notes)


LARGEST_SHARE = 0.95  # part of the error is always white [-]


@dataclass(frozen=True, slots=True)
class CorrelatedNoise:
    """Gauss-Markov part of the errors of position and, where it was found, of velocity."""

    share: float  # of the variance of a fix [-]
    time: float  # correlation time [s]
    sd: FloatArray  # (3,) standard deviation of that part, North, East, Down [m]
    velocity_sd: FloatArray | None = None  # (3,) sd of the time-correlated velocity error [m/s]; None without
    velocity_time: float = np.inf  # its correlation time [s]

    @classmethod
    def of_fixes(cls, share: float, time: float, position_sd: FloatArray) -> Self:
        """Build the part of fixes with standard deviations (n, 3) [m], from its share [-] and time [s]."""
        return cls(share, time, np.sqrt(share) * np.median(position_sd, axis=0))

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
    """Interval with more driving noise of the time-correlated position error: multipath."""

    begin: float  # [s]
    end: float
    driven: float  # root of the spectral density of that noise, each axis [m/sqrt(s)]
    time: float  # correlation time of the error [s]

    @property
    def sd(self) -> float:
        """Stationary standard deviation from this noise [m]."""
        return float(self.driven * np.sqrt(0.5 * self.time))

    def drive(self, now: float, times: FloatArray, sds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return correlation times [s] and standard deviations of the states at time `now`, positions first."""
        if not self.begin <= now < self.end + 3.0 * self.time:  # then the remaining error has decayed
            return times, sds
        times, sds = times.copy(), sds.copy()
        times[:3] = self.time
        if now < self.end:
            sds[:3] = np.hypot(sds[:3], self.sd)
        return times, sds
