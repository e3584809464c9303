"""Stationary vehicle: detection, levelling, gyrocompass, gyro bias.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013, section 5.6.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_rph, wrap_two_pi
from insnav.earth import OMEGA_EARTH, earth_rate_n, gravity_n
from insnav.exceptions import AlignmentError
from insnav.imu.specification import ImuSpec, gyro_bias_sd, level_bias_sd
from insnav.kernels.alignment import window_scatter
from insnav.strapdown import Intervals
from insnav.tabular import runs_of
from insnav.types import Alignment, BoolArray, FloatArray
from insnav.units import G0

WINDOW = 0.5  # length of the classified windows: several periods of an idling engine [s]
FEWEST = 10  # least number of samples in a mean
SHORTEST = 3.0  # a shorter stop gives the level no better than the first fixes [s]
CALM_ACCEL, CALM_GYRO = 0.3, 0.03  # largest sd in a quiet window without GPS [m/s^2], [rad/s]
QUIET_FACTOR = 4.0  # a quiet window may also have this multiple of the sd in the quietest tenth of the record
LOUD_ACCEL, LOUD_GYRO = 1.0, 0.15  # largest sd in any quiet window, even with an engine running [m/s^2], [rad/s]
TURNING = 0.01  # difference of a mean rate from the median of quiet windows in a turn: 0.6 deg/s [rad/s]
PUSHED = 0.2  # change of mean specific force between windows in motion: 0.02 g [m/s^2]
# A soft departure changes rate and force less, but for longer: deviation of means in robust standard deviations, least
# deviation [m/s^2], [rad/s], duration [s]. A quieter IMU detects it earlier.
DEPARTED, DEPARTED_ACCEL, DEPARTED_GYRO, DEPARTED_TIME = 6.0, 1e-3, 1e-5, 2.0
COMPARED = 60.0  # means of windows are compared with earlier windows of this span, at least of `SHORTEST` [s]
# In a longer initial stop the attitude is constant. Drifting gyros would rotate an unknown lever arm and make it
# observable. Horizontal noise would reduce the heading sd, 25 -> 5 deg in 15 min, by linearisation (see
# `insnav.filter.delay_and_lever.with_surer_start`). Attitude changes are measured by means over SWAYED. A stop that
# ends within LEFT of the end of the record starts no drive [s].
LONG_REST, SWAYED, LEFT = 300.0, 10.0, 1.0
ROCKS = np.deg2rad(0.5)  # level change between parts, beyond the effect of boarding passengers [rad]
CONTRADICTED = 5.0  # a rate farther from the Earth's rotation contradicts the IMU model [sd]


@dataclass(frozen=True, slots=True)
class StationaryMeans:
    """Means over a stationary interval."""

    start: float  # start and end of the interval [s]
    end: float
    rate: FloatArray  # (3,) mean angular rate [rad/s] and specific force [m/s^2] in body axes
    force: FloatArray
    rate_sd: FloatArray  # (3,) standard deviation of both means, from the scatter of ten partial means
    force_sd: FloatArray


def rates(parts: Intervals, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
    """Compute angular rate and specific force of each interval, (n, 3) each."""
    if parts.instant:
        return parts.gyro[rows], parts.accel[rows]
    gyro, accel = (spill.by_blocks(np.divide, each[rows], parts.dt[rows, None]) for each in (parts.gyro, parts.accel))
    return gyro, accel


def summarize(parts: Intervals, start: float, end: float) -> StationaryMeans:
    """Compute mean rate and specific force over the sample intervals that end in (start, end] [s]."""
    rate, force = rates(parts, slice(*np.searchsorted(parts.end, [start, end], side="right")))
    if rate.shape[0] < FEWEST:
        raise AlignmentError("align.short_static", count=rate.shape[0], begin=start, end=end)
    return _means(start, end, rate, force)


def _means(start: float, end: float, rate: FloatArray, force: FloatArray) -> StationaryMeans:
    n = max(2, min(10, rate.shape[0]))

    def scatter(values: FloatArray) -> FloatArray:
        parts_mean = np.array([spill.mean(chunk) for chunk in np.array_split(values, n)])
        return np.asarray(parts_mean.std(axis=0, ddof=1) / np.sqrt(n))

    return StationaryMeans(start, end, spill.mean(rate), spill.mean(force), scatter(rate), scatter(force))


def sway(parts: Intervals, still: FloatArray, at: StationaryMeans | None = None) -> tuple[StationaryMeans, FloatArray]:
    """Compute means of a stop, and the changes of level and heading between successive parts of it, (k, 2) [rad].

    Heading changes are relative to the mean rate. A short stop, or a stop without departure, has no changes,
    as filters track the gyro bias there. Next to a disturbed part the changes are NaN. `still` (m, 2): stationary
    intervals of the stop [s]; means use the parts within them, if enough. `at`: means of a short stop, if known.
    """
    start, end = float(still[0, 0]), float(still[-1, 1])
    if end - start < LONG_REST or end > parts.end[-1] - LEFT:
        return at or summarize(parts, *still[0]), np.empty((0, 2))
    first, last = np.searchsorted(parts.end, [start, end], side="right")
    step = float(np.median(parts.dt[1 : 1 << 16]))
    size = max(4, round(SWAYED / step))
    rate, _, force, _ = _windows(parts, (last - first) // size, size, first)
    # parts that lie within a stationary interval
    ends = parts.end[first + size - 1 : last : size]
    interval = np.searchsorted(still[:, 1], ends)
    calm = ends - size * step > still[interval, 0] - step
    at = _means(start, end, *((rate[calm], force[calm]) if calm.sum() >= FEWEST else (rate, force)))
    down = -at.force / np.linalg.norm(at.force)
    turned = 0.5 * (rate[1:] + rate[:-1] - 2.0 * at.rate) @ down * size * step
    tilted = np.linalg.norm(np.cross(np.diff(force, axis=0), down), axis=1) / G0
    calm = calm[1:] & calm[:-1] & (tilted < ROCKS)
    return at, np.where(calm[:, None], np.column_stack([tilted, turned]), np.nan)


def stays(alignment: Alignment, time: float) -> bool:
    """Return whether the attitude is constant at a time [s]: in a long, undisturbed initial stop."""
    if alignment.static is None or time > alignment.left or not alignment.sway.size:
        return False
    begin, changes = alignment.static[0], alignment.sway[:, 0]
    row = int((time - begin) * (changes.size + 1) / (alignment.left - begin) - 0.5)
    return bool(np.isfinite(changes[min(max(row, 0), changes.size - 1)]))


def find_stationary(parts: Intervals, slow: BoolArray | None = None) -> tuple[float, float] | None:
    """Find the first stationary interval, see `stationary`: start and end [s]."""
    return next(stationary(parts, slow, SHORTEST), None)


def stationary(parts: Intervals, slow: BoolArray | None = None, shortest: float = 0.0) -> Iterator[tuple[float, float]]:
    """Yield stationary intervals of some length in order: start and end [s].

    A window of half a second is stationary if `slow` is true and its mean specific force is constant. Its mean rate
    must equal the rate of the other quiet windows. Without `slow`, specific force and rate must also scatter little, or
    little more than in the quietest tenth of the record. With `slow`, an idling engine does no harm.

    `slow` (n,): false where another sensor detects motion.
    """
    size = _samples_in_window(parts)
    n = parts.end.shape[0] // size
    if n < 2:
        return
    mean_w, loud_w, mean_f, loud_f = _windows(parts, n, size)
    quiet = (loud_f < LOUD_ACCEL) & (loud_w < LOUD_GYRO)
    if slow is not None:
        quiet &= slow[: n * size].reshape(n, size).all(axis=1)
    if not quiet.any():
        return
    if slow is None:
        quiet &= loud_f <= max(CALM_ACCEL, QUIET_FACTOR * float(np.quantile(loud_f[quiet], 0.1)))
        quiet &= loud_w <= max(CALM_GYRO, QUIET_FACTOR * float(np.quantile(loud_w[quiet], 0.1)))
    quiet &= (np.abs(mean_w - np.median(mean_w[quiet], axis=0)) < TURNING).all(axis=1)
    change = np.linalg.norm(np.diff(mean_f, axis=0), axis=1) > PUSHED
    quiet[1:] &= ~change
    for begin, last in runs_of(quiet):
        # without fixes a sensor step resembles a soft departure
        end = last if slow is None else begin + _before_departure(mean_f[begin:last], mean_w[begin:last])
        start = float(parts.end[begin * size] - parts.dt[begin * size])
        stop = float(parts.end[end * size - 1])
        if stop - start >= shortest:
            # the last window may contain the start of the motion
            yield start, stop - (WINDOW if end < n else 0.0)


def _samples_in_window(parts: Intervals) -> int:
    return max(4, round(WINDOW / float(np.median(parts.dt[1 : 1 << 16]))))


def _windows(
    parts: Intervals, n: int, size: int, begin: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute mean rate (n, 3), norm of its sd (n,), and both of specific force, in `n` windows from row `begin`."""
    mean, loud = np.empty((2, n, 3)), np.empty((2, n))
    for some in spill.blocks(n, size=1 + spill.ROWS // size):  # blocks limit memory in a stop of days
        samples = parts.dt, parts.gyro, parts.accel, parts.instant
        window_scatter(*samples, size, begin, some.start, some.stop, mean, loud)
    return mean[0], loud[0], mean[1], loud[1]


def _before_departure(force: FloatArray, rate: FloatArray) -> int:
    """Count the windows before a soft departure, which is searched in the second half of a stop; all without one."""
    differs = _unlike((rate, force), (rate, force))
    row = round(DEPARTED_TIME / WINDOW)
    if differs.size < 2 * row:
        return differs.size
    sustained: BoolArray = np.asarray(np.lib.stride_tricks.sliding_window_view(differs, row).all(axis=1))
    sustained[: differs.size // 2] = False
    return int(np.argmax(sustained)) if sustained.any() else differs.size


def _unlike(means: Sequence[FloatArray], rest: Sequence[FloatArray]) -> BoolArray:
    """Find windows whose mean rate or force, (m, 3) each, differs from the means (k, 3) in a stop."""
    differs = np.zeros(means[0].shape[0], dtype=np.bool_)
    for mean, stop, least in zip(means, rest, (DEPARTED_GYRO, DEPARTED_ACCEL), strict=True):
        median = np.median(stop, axis=0)
        limit = np.maximum(DEPARTED * 1.4826 * np.median(np.abs(stop - median), axis=0), least)
        differs |= (np.abs(mean - median) > limit).any(axis=1)
    return differs


def departure(parts: Intervals, rest: tuple[float, float]) -> float:
    """Find the first sustained difference of IMU means from earlier means: the departure from a stop [s]."""
    if parts.end.size < FEWEST:
        return rest[1]
    size = _samples_in_window(parts)
    length = size * float(np.median(parts.dt[1 : 1 << 16]))
    number, duration, fewest = (max(2, round(span / length)) for span in (COMPARED, DEPARTED_TIME, SHORTEST))
    begin, now = np.searchsorted(parts.end, rest, side="right")
    begin = max(begin, now - number * size)
    if now - begin < fewest * size:
        return rest[1]
    before = _windows(parts, (now - begin) // size, size, begin)
    while now + duration * size <= parts.end.size:
        current = _windows(parts, min(number, (parts.end.size - now) // size), size, now)
        odd = _unlike(current[::2], before[::2])
        for first, last in runs_of(odd):
            if last - first >= duration:
                return float(parts.end[now + first * size - 1])
        # windows at the end that differ are compared again in the next block
        more = odd.size - int(np.argmin(odd[::-1])) if odd[-1] else odd.size
        before, now = current, now + more * size
    return float(parts.end[-1])


def level(force: FloatArray) -> tuple[float, float]:
    """Compute roll and pitch [rad] of a stationary body from specific force, (3,) (Groves 2013, section 5.6.2)."""
    x, y, z = force
    return float(np.arctan2(-y, -z)), float(np.arctan2(x, np.hypot(y, z)))


def tilt_sd(rest: StationaryMeans, spec: ImuSpec, lat: float, height: float) -> FloatArray:
    """Compute the level sd about North and East [rad], for any heading (Groves 2013, section 5.6.2)."""
    g = gravity_n(lat, height)[2]
    return np.full(2, float(np.sqrt(np.max(level_bias_sd(spec.accel) ** 2 + rest.force_sd**2))) / g + 2e-6)


def gyrocompass(rest: StationaryMeans, spec: ImuSpec, lat: float, tilt: float) -> tuple[float, float]:
    """Compute heading and its standard deviation [rad] from the Earth's rotation (Groves 2013, section 5.6.2).

    The standard deviation is infinite at the poles and meaningless above about a radian. A `tilt` error (1 sd) [rad]
    about North rotates the vertical part of the Earth rate into East. The bias across the heading is unobservable. If
    the measured excess contradicts the IMU model, the sd of this bias is twice the excess (3 sd cover 98.6 %).
    """
    w = _levelled_rate(rest)
    sd = max(_rate_sd(rest, spec), 2.0 * unexplained_rate(rest, spec, lat))
    sd = float(np.hypot(sd, OMEGA_EARTH * np.sin(lat) * tilt)) / (OMEGA_EARTH * max(np.cos(lat), 1e-9))
    return float(wrap_two_pi(np.arctan2(-w[1], w[0]))), sd


def unexplained_rate(rest: StationaryMeans, spec: ImuSpec, lat: float) -> float:
    """Compute the excess of the levelled rate over the Earth rate [rad/s]; zero if the IMU model explains it."""
    w, earth = _levelled_rate(rest), earth_rate_n(lat)
    misfit = float(np.hypot(np.hypot(w[0], w[1]) - earth[0], w[2] - earth[2]))
    return misfit if misfit > CONTRADICTED * _rate_sd(rest, spec) else 0.0


def _levelled_rate(rest: StationaryMeans) -> FloatArray:
    return dcm_from_rph(np.array([*level(rest.force), 0.0])) @ rest.rate


def _rate_sd(rest: StationaryMeans, spec: ImuSpec) -> float:
    walk = spec.gyro.random_walk**2 / (rest.end - rest.start)
    return float(np.sqrt(np.max(gyro_bias_sd(spec.gyro) ** 2 + walk + rest.rate_sd**2)))


def latitude_from_sensors(rest: StationaryMeans) -> float:
    """Compute latitude [rad], with its sign, from the angle between the Earth's rotation and gravity."""
    up = rest.force / np.linalg.norm(rest.force)
    return float(np.arcsin(np.clip(rest.rate @ up / np.linalg.norm(rest.rate), -1.0, 1.0)))


def gyro_bias(
    rest: StationaryMeans, spec: ImuSpec, rph: FloatArray, heading_sd: float, lat: float
) -> tuple[FloatArray, FloatArray]:
    """Compute mean gyro output minus the Earth's rotation, and its standard deviation [rad/s], (3,) each."""
    earth = earth_rate_n(lat)
    bias = rest.rate - dcm_from_rph(rph).T @ earth
    walk = spec.gyro.random_walk**2 / (rest.end - rest.start)
    # an unknown heading leaves the horizontal Earth rate unknown about both level axes
    horizontal = OMEGA_EARTH * np.cos(lat) * min(heading_sd, 1.0)
    sd = np.sqrt(walk + rest.rate_sd**2 + spec.gyro.bias_instability**2 + np.array([1.0, 1.0, 0.05]) * horizontal**2)
    return bias, sd
