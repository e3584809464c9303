"""Offset between the clocks of IMU and receiver, from common turns and accelerations.

The IMU's mounting need not be known. Its turn rate about the vertical is compared with the course rate, and the size of
its horizontal specific force with the GPS acceleration. A correlation at every lag covers both records: by fast Fourier
transform, with masks for missing samples (masked normalised correlation: Padfield, "Masked object registration in the
Fourier domain", IEEE Trans. Image Processing 21 (2012) 2706-2718). Least squares refine the offset. Its standard
deviation allows for residuals correlated in blocks of the record (Liang and Zeger, Biometrika 73 (1986) 13-22), for
lever arm and levelling, and for disagreement of turns and accelerations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insnav import spill
from insnav.alignment.in_motion import velocity
from insnav.kernels.alignment import level_history
from insnav.kernels.earth import A
from insnav.strapdown import Intervals
from insnav.types import BoolArray, FloatArray, GpsData

FEWEST_TURNS = 20  # least number of useful intervals
TURNS = 0.04  # least RMS turn of useful intervals [rad]
SHARP = 2.5  # the sense of larger turns is ambiguous [rad]
COARSE = 0.5  # assumed resolution of the best lag [s]
STEEPEST = 1.55  # latitude, north or south, beyond which the course changes with every metre [rad]
STEP = 0.1  # interval of the comparison grid [s]
SPAN = 1.0  # least interval of turns and velocity changes [s]
LEVELLING = 30.0  # time constant of the gravity estimate, longer than accelerations [s]
PASSES = 3  # each pass reduces the effect of gyro bias on gravity to a tenth in five minutes
LONG = 8.0 * LEVELLING  # records longer than this omit their first `LEVELLING` [s]
SLOW = 0.8  # below this speed the GPS course is noise [m/s]
SHORTEST = 20.0  # least overlap of the records [s]
SHOWN = 0.3  # correlation of turns or accelerations that proves an offset [-]
SHARE = 0.3  # least overlap as a share of the shorter record [-]
# Turns and accelerations decorrelate over this time, unless their interval is longer. Single turns take as long, and
# the correlation peak is as wide [s]
MEMORY = 2.0
SURE = 15.0  # least log-likelihood gain over no correlation: chance does not reach it at any lag
AS_TOLD = 0.3  # share of the best log-likelihood that zero offset needs to be accepted
AS_LIKELY = 0.92  # zero offset is kept at this share of the best: circles in wind and slow motion have no clear best
JUDGED = 0.75  # least share of the fixes' motion that zero offset must compare, to be rejected [-]
APART = 5.0  # least distance between distinct lags [s]
BLOCKS = 12  # parts of the record; residuals are correlated within a part
SYSTEMATIC = 0.01  # offset error by lever arm and levelling, RMS of simulated city drives [s]
# Residual in standard deviations that indicates a false velocity, if it also exceeds the RMS of the signal. Otherwise
# every turn of a mostly straight flight would be rejected.
OUTSIDE = 4.0
# Acceleration of the fixes, relative to its noise, that is significant. Then one of the correlations is at least 0.7 in
# a hundred simulated and recorded drives. 25 pairs of different drives had up to 0.35 at zero offset, up to 0.6 at the
# best offset.
SEEN = 1.5
DRIVES = 0.15  # least acceleration: on rough ground IMUs sense twice the 0.15 m/s^2 of the fixes [m/s^2]
ALIKE, UNLIKE = 0.6, 0.4  # a larger correlation of motion shows one drive, a smaller correlation two drives [-]
LONG_ENOUGH = 60.0  # least common time to detect different drives [s]
AS_IS = 3.0  # smaller offsets are a GPS delay [s]
DENSE = 6.0  # longer intervals may contain full circles: a flight with a fix every 10 s has r = 0.3 [s]
NOISE = 2.0  # accelerations of fixes beyond this multiple of the samples' RMS are noise, whatever their sd
# Least refined correlation of turns or accelerations for an offset. Accelerations with the same negative correlation
# contradict turns: gravity was estimated in a banked turn [-]
LEAST = 0.5
# IMU at rest: averaging time, largest differences of its means, and least acceleration of moving fixes. Consumer biases
# vary by 0.03 m/s^2 and 0.001 rad/s in ten minutes. Ships, trains and flights may change no faster.
MEAN, STILL, STILL_TURN, MOVED = 10.0, 0.05, 0.005, 0.3  # units: [s], [m/s^2], [rad/s], [m/s^2]


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Offset of the IMU clock behind the receiver clock."""

    offset: float  # offset to be added to the times of the IMU [s]
    sd: float  # standard deviation of the offset [s]
    turns: float  # correlation of turn rates at this offset [-]
    accelerations: float  # correlation of horizontal accelerations [-]
    overlap: float  # common time of the records with this offset [s]

    @property
    def is_shown(self) -> bool:
        """Return whether turns or accelerations prove the offset."""
        return max(abs(self.turns), self.accelerations) > SHOWN


@dataclass(frozen=True, slots=True)
class Unlike:
    """Evidence of two different drives: no common motion of IMU and receiver at zero offset."""

    turns: float  # correlation of turn rates, the best near zero offset [-]
    accelerations: float  # correlation of horizontal accelerations [-]
    overlap: float  # common time of the records [s]
    at_rest: bool = False  # True if the IMU is stationary while the fixes move


@dataclass(frozen=True, slots=True)
class _Track:
    """Integrated turn and velocity change of a record; their differences over spans are compared."""

    time: FloatArray  # (n,) times of the rows [s]
    turn: FloatArray  # (n,) turn about the vertical, or course [rad]
    change: FloatArray  # (n, 2) horizontal velocity, apart from slow changes [m/s]
    turns: BoolArray  # (n,) rows with a known turn
    known: BoolArray  # (n,) rows with a known velocity change
    sd: float = 0.0  # scatter of `change`, each component [m/s]


@dataclass(frozen=True, slots=True)
class _Compared:
    """Turns and accelerations of samples and fixes, correlated at every lag."""

    span: float  # time over which changes are compared [s]
    lags: FloatArray  # (k,) clock offsets that are compared [s]
    alike: FloatArray  # (2, k) correlation of turns and of accelerations [-]
    common: FloatArray  # (2, k) common time [s]
    score: FloatArray  # (k,) log-likelihood of each lag
    most: float  # largest time-weighted mean of both correlations, at the best lag [-]
    felt: float  # RMS acceleration of the samples [m/s^2]
    seen: float  # RMS acceleration of the fixes [m/s^2]
    judged: float  # share of the fixes' motion that is compared at zero offset [-]


def find_clock_offset(parts: Intervals, gps: GpsData, *, worth: float = 0.0) -> ClockOffset | Unlike | None:
    """Find the offset of the clocks, or evidence of different drives; None if neither is significant.

    `parts`: samples as intervals. `gps`: fixes with standard deviations. `worth`: smaller offsets are not refined and
    give None [s].
    """
    imu, track = _of_imu(parts), _of_gps(gps)
    if track is None or len(imu.time) < 10:
        return None
    if common := _at_rest(parts, track):
        return Unlike(0.0, 0.0, common, at_rest=True)
    compared = _of_tracks(imu, track)
    if compared is None:
        return None
    significant = max(DRIVES, SEEN * math.sqrt(2.0) * track.sd / compared.span) < compared.seen < NOISE * compared.felt
    if significant and compared.span < DENSE and compared.most < ALIKE:
        unlike = Unlike(*_near(compared))
        return unlike if max(abs(unlike.turns), abs(unlike.accelerations)) < UNLIKE else None
    lag = _best_lag(compared)
    if compared.span >= DENSE:  # the resolution is no better than the interval of sparse fixes
        worth = max(worth, compared.span)
    refined = None if lag is None or abs(lag) < worth - COARSE else _refined(imu, track, lag, compared.span)
    if refined is None or refined.accelerations < -LEAST or max(abs(refined.turns), refined.accelerations) < LEAST:
        return None
    return refined


def likeness(parts: Intervals, *others: GpsData) -> list[float]:
    """Compute the correlation of accelerations between samples and each set of fixes at zero offset; 0: unknown [-]."""
    imu, correlations = _of_imu(parts), []
    for gps in others:
        track = _of_gps(gps)
        compared = None if track is None or len(imu.time) < 10 else _of_tracks(imu, track)
        _, accelerations, common = (0.0, 0.0, 0.0) if compared is None else _near(compared)
        correlations.append(accelerations if common else 0.0)
    return correlations


def _at_rest(parts: Intervals, track: _Track) -> float:
    """Return the common time if the IMU is always stationary in it and the fixes move [s]; else zero."""
    first, last = max(parts.end[0], track.time[0]), min(parts.end[-1], track.time[-1])
    starts = np.arange(first, last - MEAN, MEAN)
    if last - first < LONG_ENOUGH or not _moves(track, starts):
        return 0.0
    lowest, highest = np.full((2, 3), np.inf), np.full((2, 3), -np.inf)
    for rows in map(slice, *np.searchsorted(parts.end, (starts, starts + MEAN))):
        duration = parts.dt[rows].sum()
        if duration > 0.0:
            weights = parts.dt[rows] if parts.instant else np.ones(rows.stop - rows.start)
            mean = np.array([weights @ each[rows] for each in (parts.accel, parts.gyro)]) / duration
            lowest, highest = np.minimum(lowest, mean), np.maximum(highest, mean)
            if (highest - lowest > np.array([[STILL], [STILL_TURN]])).any():
                return 0.0
    return float(last - first)


def _moves(track: _Track, starts: FloatArray) -> bool:
    """Return whether the mean acceleration of the fixes exceeds `MOVED` in a tenth of the time."""
    v = track.change
    path = np.vstack([[0.0, 0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(track.time)[:, None], axis=0)])
    at = [np.column_stack([np.interp(each, track.time, axis) for axis in path.T]) for each in (starts, starts + MEAN)]
    change = np.linalg.norm(np.diff((at[1] - at[0]) / MEAN, axis=0), axis=1) / MEAN
    return bool(np.percentile(change, 90.0) > MOVED)


def _of_imu(parts: Intervals) -> _Track:
    scale = parts.dt[:, None] if parts.instant else 1.0
    n = len(parts.dt)
    turn, change = np.empty(n + 1), np.empty((n + 1, 2))
    gyro, accel = parts.gyro * scale, parts.accel * scale
    bias = np.zeros(3)  # a consumer gyro's bias would tilt gravity by 18 deg and corrupt the accelerations
    # turn about the vertical, and horizontal velocity by a slow gravity estimate
    for _ in range(PASSES):
        level_history(parts.dt, gyro, accel, bias, LEVELLING, turn, change)
    time = np.concatenate([[parts.end[0] - parts.dt[0]], parts.end])
    spill.release()
    known = np.concatenate([[True], parts.gap == 0.0])
    if time[-1] - time[0] > LONG:
        known[: np.searchsorted(time, time[0] + LEVELLING)] = False  # gravity is not yet estimated
    return _Track(time, turn, change, known, known)


def _of_gps(gps: GpsData) -> _Track | None:
    speed = velocity(gps)
    if len(speed.time) < 10:
        return None
    v = speed.v_n[:, :2]
    fast = np.hypot(v[:, 0], v[:, 1]) > np.maximum(SLOW, 4.0 * speed.sd)
    # North rotates as the vehicle moves east, which gyros do not sense: near a pole this dominates
    lat = np.interp(speed.time, gps.time, gps.lla[:, 0])
    north = v[:, 1] * np.tan(np.clip(lat, -STEEPEST, STEEPEST)) / A
    rotation = np.concatenate([[0.0], np.cumsum(0.5 * (north[1:] + north[:-1]) * np.diff(speed.time))])
    course = np.arctan2(v[:, 1], v[:, 0]) - rotation
    v = np.hypot(v[:, 0], v[:, 1])[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    turn = np.zeros(len(v))
    rows = np.flatnonzero(fast)
    turn[rows] = np.unwrap(course[rows])
    known = np.abs(lat) < STEEPEST
    fast &= known
    # the reported sd may describe time-correlated errors, which mask no acceleration, or may be too small
    scatter = 1.4826 / math.sqrt(6.0) * float(np.median(np.abs(np.diff(v, n=2, axis=0))))
    return _Track(speed.time, turn, _levelled(speed.time, v), np.asarray(fast), known, scatter)


def _levelled(time: FloatArray, v: FloatArray) -> FloatArray:
    """Remove slow changes from velocities (n, 2) [m/s], as the gravity estimate removes them from the samples."""
    gain = 1.0 - np.exp(-np.diff(time, prepend=time[0]) / LEVELLING)
    slow, (north, east) = [], v[0].tolist()
    for share, (v_north, v_east) in zip(gain.tolist(), v.tolist(), strict=True):
        north, east = north + share * (v_north - north), east + share * (v_east - east)
        slow.append((north, east))
    return v - np.array(slow)


def _over(track: _Track, ends: Sequence[FloatArray]) -> FloatArray:
    """Compute turn [rad] and size of the velocity change [m/s] between pairs of times, (2, m)."""
    turn = [np.interp(each, track.time, track.turn) for each in ends]
    change = [np.column_stack([np.interp(each, track.time, track.change[:, i]) for i in range(2)]) for each in ends]
    return np.array([turn[1] - turn[0], np.linalg.norm(change[1] - change[0], axis=1)])


def _rates(track: _Track, span: float) -> tuple[float, FloatArray, BoolArray]:
    """Compute turn rate and acceleration over spans on a grid: grid start [s], values (2, m), masks (2, m)."""
    grid = np.arange(track.time[0] + 0.5 * span, track.time[-1] - 0.5 * span, STEP)
    ends = grid - 0.5 * span, grid + 0.5 * span
    values = _over(track, ends) / span
    known = np.array([_covered(track, flags, ends) for flags in (track.turns, track.known)])
    return float(grid[0]) if len(grid) else 0.0, values, known


def _covered(track: _Track, flags: BoolArray, ends: tuple[FloatArray, FloatArray]) -> BoolArray:
    """Return whether all rows of a span are known, from the last one before it to the first one after it."""
    step = np.diff(track.time)
    bad = np.concatenate([[0], np.cumsum(~flags)])
    gap = np.concatenate([[0], np.cumsum(step > 2.5 * np.median(step))])
    first = np.clip(np.searchsorted(track.time, ends[0], side="right") - 1, 0, len(flags) - 1)
    last = np.clip(np.searchsorted(track.time, ends[1]), 0, len(flags) - 1)
    return np.asarray((bad[last + 1] == bad[first]) & (gap[last] == gap[first]))


def _of_tracks(imu: _Track, track: _Track) -> _Compared | None:
    """Compare samples and fixes over spans of at least two fix intervals; None if the records are too short."""
    span = max(SPAN, 2.0 * float(np.median(np.diff(track.time))))
    return _compared(_rates(imu, span), _rates(track, span), span)


def _compared(
    imu: tuple[float, FloatArray, BoolArray], gps: tuple[float, FloatArray, BoolArray], span: float
) -> _Compared | None:
    """Correlate turns and accelerations, changes over `span` [s], at every lag; None if the records are too short."""
    n, m = imu[1].shape[1], gps[1].shape[1]
    if min(n, m) * STEP < SHORTEST:
        return None
    lags = gps[0] - imu[0] + (np.arange(n + m - 1) - (n - 1)) * STEP
    score, alike, common = np.zeros(n + m - 1), np.zeros((2, n + m - 1)), np.zeros((2, n + m - 1))
    imu_rms = gps_rms = power = judged = 0.0
    row = np.round((gps[0] - imu[0]) / STEP).astype(int) + np.arange(m)
    within = (row >= 0) & (row < n)
    for i, (x, mx, y, my) in enumerate(zip(imu[1], imu[2], gps[1], gps[2], strict=True)):
        if not (mx.any() and my.any()):
            continue
        imu_rms, gps_rms = float(np.std(x[mx])), float(np.std(y[my]))  # the last round keeps the accelerations
        motion = np.where(my & within, (y - np.median(y[my])) ** 2, 0.0)
        power, judged = power + motion.sum(), judged + motion[within] @ mx[row[within]]
        correlation, count = correlate_masked(x, mx, y, my)
        enough = count * STEP >= max(SHORTEST, SHARE * STEP * min(mx.sum(), my.sum()))
        r = np.where(enough, np.clip(correlation, -0.999, 0.999), 0.0)
        # log-likelihood of a correlation r of n independent values: -n / 2 log(1 - r^2)
        score -= 0.5 * (count * STEP / max(MEMORY, span)) * np.log1p(-(r**2))
        alike[i], common[i] = r, count * STEP
    best = int(np.argmax(score))
    most = float(np.sqrt(np.average(alike[:, best] ** 2, weights=common[:, best] + 1e-9)))
    return _Compared(span, lags, alike, common, score, most, imu_rms, gps_rms, judged / power if power > 0.0 else 1.0)


def _near(compared: _Compared) -> tuple[float, float, float]:
    """Return the correlations of turns and accelerations near zero offset, 1 if too short, and the common time [s]."""
    near = np.flatnonzero((abs(compared.lags) < AS_IS) & (compared.common[1] >= LONG_ENOUGH))
    turns, accelerations = (float(max(each[near], key=abs, default=1.0)) for each in compared.alike)
    return turns, accelerations, float(compared.common[1, near].max(initial=0.0))


def _best_lag(compared: _Compared) -> float | None:
    """Find the most likely lag [s]; None if another lag is nearly as likely."""
    lags, score = compared.lags, compared.score
    best = int(np.argmax(score))
    around = abs(np.arange(len(lags)) - best) * STEP < APART
    second = float(np.max(score[~around], initial=0.0))
    if score[best] < SURE or score[best] < second + 0.5 * SURE:
        return None
    at_zero = float(np.max(score[np.abs(lags) < COARSE], initial=0.0))
    if abs(lags[best]) > COARSE and at_zero > AS_LIKELY * score[best]:
        return None
    near_zero = float(np.max(score[(np.abs(lags) < APART) & ~around], initial=0.0))
    if abs(lags[best]) >= APART and near_zero > max(SURE, AS_TOLD * score[best]):
        return None  # the motion repeats itself, and zero offset explains it, too
    if abs(lags[best]) >= APART and compared.judged < JUDGED:
        return None  # most motion is where gravity is not yet estimated
    return float(lags[best])


def correlate_masked(x: FloatArray, mx: BoolArray, y: FloatArray, my: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Correlate two series at every lag over their common values; also return the number of common values.

    Entry k is for x of length n, delayed by ``k - (n - 1)`` steps.
    """
    size = len(x) + len(y) - 1
    size = min(m << math.ceil(math.log2(size / m)) for m in (1, 3, 5, 9, 15))  # small factors make the FFT fast
    x, y = np.where(mx, x - x[mx].mean(), 0.0), np.where(my, y - y[my].mean(), 0.0)
    # six transforms: values, squares and masks of both series
    of_x, square_x, ones_x = (np.fft.rfft(each[::-1], size) for each in (x, x**2, mx.astype(np.float64)))
    of_y, square_y, ones_y = (np.fft.rfft(each, size) for each in (y, y**2, my.astype(np.float64)))

    def sums(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> FloatArray:
        return np.asarray(np.fft.irfft(b * a, size)[: len(x) + len(y) - 1])

    count = np.maximum(np.round(sums(ones_x, ones_y)), 1e-9)
    sum_x, sum_y = sums(of_x, ones_y), sums(ones_x, of_y)
    power_x = np.maximum(sums(square_x, ones_y) - sum_x**2 / count, 0.0)
    power_y = np.maximum(sums(ones_x, square_y) - sum_y**2 / count, 0.0)
    power = np.sqrt(power_x * power_y)
    least = 1e-3 * float(power.max(initial=0.0))
    return np.where(power > least, (sums(of_x, of_y) - sum_x * sum_y / count) / np.maximum(power, 1e-300), 0.0), count


def _refined(imu: _Track, gps: _Track, lag: float, span: float) -> ClockOffset | None:
    """Refine the lag: fit turns and accelerations of the fixes by the samples, over spans between fixes."""
    rows = max(1, round(span / float(np.median(np.diff(gps.time)))))
    ends = gps.time[:-rows], gps.time[rows:]
    if not len(ends[0]):
        return None
    length = ends[1] - ends[0]
    turn, change_of_v = gps.turn[rows:] - gps.turn[:-rows], gps.change[rows:] - gps.change[:-rows]
    measured = np.array([turn, np.linalg.norm(change_of_v, axis=1)]) / length
    known = np.array([_covered(gps, flags, ends) for flags in (gps.turns, gps.known)])

    def residuals(offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        shifted = [each - offset for each in ends]
        inside = (shifted[0] > imu.time[0]) & (shifted[1] < imu.time[-1])
        sensed = _over(imu, shifted) / length
        use = known & inside & np.array([_covered(imu, imu.known, (shifted[0], shifted[1]))] * 2)
        residual, weight, r = np.zeros_like(measured), np.zeros(2), np.zeros(2)
        for i in range(2):
            if np.count_nonzero(use[i]) < 10:
                continue
            row = np.flatnonzero(use[i])
            for _ in range(2):  # the second time without false velocities
                x, y = sensed[i, row], measured[i, row]
                x, y = x - x.mean(), y - y.mean()
                power = float(np.sum(x**2))
                if power == 0.0 or float(np.sum(y**2)) == 0.0:
                    break
                r[i] = float(np.sum(x * y)) / np.sqrt(power * float(np.sum(y**2)))
                fitted = float(np.sum(x * y)) / power * x
                misfit = y - fitted
                residual[i], weight[i] = 0.0, 1.0 / max(float(np.mean(misfit**2)), 1e-12)
                residual[i, row] = misfit
                limit = OUTSIDE * (1.4826 * float(np.median(np.abs(misfit))) + 1e-9)
                row = row[np.abs(misfit) < max(limit, float(np.sqrt(np.mean(fitted**2))))]
                if row.size < 10:
                    break
        return residual, weight, r

    # search on a grid around the lag, then Gauss-Newton
    offsets = np.arange(lag - MEMORY, lag + MEMORY, 0.05)
    likelihood = [_likelihood(residual, r) for residual, _, r in map(residuals, offsets)]
    at = float(offsets[int(np.argmax(likelihood))])
    sd, split, step = np.inf, 0.0, 1e-2
    for _ in range(20):
        residual, weight, r = residuals(at)
        slope = (residuals(at + step)[0] - residuals(at - step)[0]) / (2.0 * step)
        weighted = weight[:, None] * slope
        power = float(np.sum(weighted * slope))
        if power <= 0.0:
            return None
        change = -float(np.sum(weighted * residual)) / power
        gradient = np.sum(weighted * residual, axis=0)
        blocks = [float(np.sum(part)) for part in np.array_split(gradient, BLOCKS)]
        sd = float(np.sqrt(np.sum(np.square(blocks)) * BLOCKS / (BLOCKS - 1.0))) / power
        info = np.sum(weighted * slope, axis=1)
        alone = -np.sum(weighted * residual, axis=1) / np.where(info > 0.0, info, np.inf)  # turns, accelerations alone
        split = float(np.abs(alone[0] - alone[1])) if (info > 0.0).all() else 0.0
        at += float(np.clip(change, -0.2, 0.2))
        if abs(change) < 1e-4:
            break
    common = min(float(gps.time[-1]), float(imu.time[-1]) + at) - max(float(gps.time[0]), float(imu.time[0]) + at)
    return ClockOffset(at, float(np.linalg.norm([sd, SYSTEMATIC, 0.5 * split])), float(r[0]), float(r[1]), common)


def _likelihood(left: FloatArray, r: FloatArray) -> float:
    """Compute the log-likelihood of the correlations `r` (2,), weighted by the number of nonzero residuals `left`."""
    count = np.count_nonzero(left, axis=1)
    return float(np.sum(-0.5 * count * np.log1p(-(np.clip(r, -0.9999, 0.9999) ** 2))))


def turn_scale(parts: Intervals, gps: GpsData) -> tuple[float, float]:
    """Compute the ratio of course turns to gyro turns, and the correlation of both; zeros without turns.

    Gyro turns are about the mean specific force, which is near vertical in ground vehicles.
    """
    speed = velocity(gps)
    rows = np.flatnonzero(speed.fast)
    if rows.size < FEWEST_TURNS:
        return 0.0, 0.0
    scale = parts.dt[:, None] if parts.instant else 1.0
    up = np.sum(parts.accel * scale, axis=0)
    turn: FloatArray = np.cumsum((parts.gyro * scale) @ (-up / max(float(np.linalg.norm(up)), 1e-9)))
    step = max(1, round(MEMORY / max(float(np.median(np.diff(speed.time))), 1e-3)))
    first, last = rows[:-step], rows[step:]
    complete = (last - first == step) & (speed.time[first] > parts.end[0]) & (speed.time[last] < parts.end[-1])
    first, last = first[complete], last[complete]
    course = np.unwrap(np.arctan2(speed.v_n[:, 1], speed.v_n[:, 0]))
    course_turn = course[last] - course[first]
    gyro_turn = np.interp(speed.time[last], parts.end, turn) - np.interp(speed.time[first], parts.end, turn)
    small = np.abs(course_turn) < SHARP
    if np.count_nonzero(small) < FEWEST_TURNS:
        return 0.0, 0.0
    course_turn, gyro_turn = course_turn[small] - course_turn[small].mean(), gyro_turn[small] - gyro_turn[small].mean()
    power = float(np.sum(gyro_turn**2))
    if float(np.std(course_turn)) < TURNS or power == 0.0:
        return 0.0, 0.0
    both = float(np.sum(course_turn * gyro_turn))
    return both / power, both / float(np.sqrt(power * np.sum(course_turn**2)))
