"""Strapdown mechanization: samples -> increments with coning and sculling -> velocity, position, attitude.

`intervals` converts the samples of a recording to successive intervals with integrated rate and specific force, with
gaps filled and marked. `increments` adds the coning and sculling terms; `navigate` integrates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from insnav import spill
from insnav.attitude import quat_from_rph, rph_from_quat
from insnav.earth import near_pole
from insnav.exceptions import ConfigError, InputError
from insnav.kernels import alignment as _alignment
from insnav.kernels import increments as _increments
from insnav.kernels import mechanization as _mechanization
from insnav.types import FloatArray, ImuData, Increments, IntArray, Trajectory

Method = Literal["polynomial", "rk4", "rotvec", "euler"]
_STUDY = {"euler": _mechanization.EULER, "rotvec": _mechanization.ROTVEC, "rk4": _mechanization.RK4}

BESIDE = 16  # samples before and after an interval that affect the interval
TIME_TOLERANCE = 1e-6  # times closer than this [s] count as equal
LOST_WINDOW = 5  # sampling steps on either side, to distinguish lost samples from jitter
_BEFORE = {"end": 1.0, "mid": 0.5, "start": 0.0}  # share of the sampling interval before its timestamp
JOINED = 0.04  # length of joined intervals [s]: vehicles vibrate faster than this, but turn more slowly
GAP = 1.5  # an interval longer than this multiple of the nominal interval has lost samples


@dataclass(frozen=True, slots=True)
class Intervals:
    """Samples of a recording as successive intervals without gaps."""

    end: FloatArray  # (n,) end and length of each interval [s]; each starts at the end of the previous one
    dt: FloatArray
    # (n, 3) integral over the interval [rad], [m/s]; if `instant`, value at the end of the interval [rad/s], [m/s^2]
    gyro: FloatArray
    accel: FloatArray
    segment: IntArray  # (n,) number of the uninterrupted segment
    # (n,) zero for a measured interval; for intervals that fill a gap, with interpolated values, the length of the
    # whole gap [s]
    gap: FloatArray
    instant: bool  # see `gyro`. The first interval of an instantaneous record has zero length.


@lru_cache(maxsize=2)
def _weights(instant: bool) -> tuple[FloatArray, FloatArray]:
    # weights of the polynomial through samples at equal spacing
    weights = _increments.uniform_weights(instant)
    return weights, _increments.stage_weights(weights)


def nominal_interval(time: FloatArray) -> float:
    """Return the mean sampling interval, without gaps [s]; InputError for fewer than two samples."""
    if time.shape[0] < 2:
        raise InputError("data.few_samples", count=time.shape[0])
    step = np.diff(time[: 1 << 16])
    # mean, since the median of steps between timestamps in whole milliseconds is a whole millisecond
    return float(np.mean(step[step <= GAP * np.median(step)]))


def intervals(imu: ImuData, nominal: float | None = None) -> Intervals:
    """Convert samples to successive intervals and fill gaps.

    Parameters
    ----------
    imu : ImuData
        Samples in any form.
    nominal : float, optional
        Nominal sampling interval [s]; `nominal_interval` by default.

    Returns
    -------
    Intervals
        Missing samples are replaced by intervals of about nominal length, with rate and specific force interpolated
        linearly between the neighbours, marked by `gap`.
    """
    nominal = nominal_interval(imu.time) if nominal is None else nominal
    instant, time = imu.sampling == "instant", np.ascontiguousarray(imu.time)
    start, end, before = spill.empty(time.shape), spill.empty(time.shape), 1.0 if instant else _BEFORE[imu.stamp]
    for rows in spill.blocks(time.shape[0]):
        _increments.interval_ends(time, nominal, GAP, LOST_WINDOW, before, rows.start, rows.stop, start, end)
    segment = np.zeros(end.shape[0], dtype=np.int64)
    gap = np.zeros(end.shape[0])
    least_gap = (GAP - 1.0) * nominal
    gaps = np.flatnonzero(spill.by_blocks(lambda then, before: then - before > least_gap, start[1:], end[:-1]))
    gyro, accel = imu.gyro, imu.accel
    if gaps.size:
        # Rates are interpolated across a gap. Recorded increments are not converted to rates, to avoid rounding errors.
        length_of = end - start if imu.sampling == "increment" else np.ones(end.shape[0])
        insert_at, new_gap, new_end, new_values = [], [], [], []
        for k in gaps:  # fill the gap after interval k with `missing` intervals
            length = start[k + 1] - end[k]
            missing = max(1, round(length / nominal))
            share = np.arange(1, missing + 1)
            weight = (share / (missing + 1))[:, None]
            insert_at.append(np.full(missing, k + 1))
            new_gap.append(np.full(missing, length))
            new_end.append(np.append(end[k] + share[:-1] / missing * length, start[k + 1]))
            sides = [(values[k] / length_of[k], values[k + 1] / length_of[k + 1]) for values in (gyro, accel)]
            new_values.append([left + weight * (right - left) for left, right in sides])
        where = np.concatenate(insert_at)
        end = np.insert(end, where, np.concatenate(new_end))
        gyro, accel = (
            np.insert(values, where, np.concatenate(inserted), axis=0)
            for values, inserted in zip((gyro, accel), zip(*new_values, strict=True), strict=True)
        )
        gap = np.insert(gap, where, np.concatenate(new_gap))
        segment = np.concatenate([[0], np.cumsum(gap[1:] != gap[:-1])]).astype(np.int64)
    dt = spill.joined([end[:1] - start[0], spill.steps(end)])
    if instant:
        dt[0] = 0.0
    elif gaps.size or imu.sampling == "mean":
        scale = np.where(gap > 0.0, dt, 1.0)[:, None] if imu.sampling == "increment" else dt[:, None]
        gyro, accel = (spill.by_blocks(np.multiply, values, scale) for values in (gyro, accel))
    return Intervals(end, dt, gyro, accel, segment, gap, instant)


def pieces(imu: ImuData) -> Iterator[Intervals]:
    """Yield the `intervals` of a long record block by block; only segment numbers differ, which each block restarts."""
    nominal, rows = nominal_interval(imu.time), imu.time.shape[0]
    for block in spill.blocks(rows):
        # compute with neighbours on both sides, then cut them off
        first = max(block.start - BESIDE, 0)
        parts = intervals(imu.rows(slice(first, block.stop + BESIDE)), nominal)
        sample = np.flatnonzero(parts.gap == 0.0)
        begin = int(sample[block.start - first - 1]) + 1 if first < block.start else 0
        cut = slice(begin, int(sample[block.stop - first - 1]) + 1)
        gyro, accel = parts.gyro[cut], parts.accel[cut]
        yield Intervals(parts.end[cut], parts.dt[cut], gyro, accel, parts.segment[cut], parts.gap[cut], parts.instant)


def joined(blocks: Iterable[Intervals]) -> Intervals:
    """Join successive intervals of a segment to intervals of about `JOINED` [s], for uses that need no high rate."""
    finished, unfinished, count, inside = [], np.empty((0, 9)), 0, 0
    for parts in blocks:
        count = count or max(1, round(JOINED / float(np.median(parts.dt[: 1 << 16]))))
        out = np.empty((parts.end.shape[0] + 1, 9))
        out[: unfinished.shape[0]] = unfinished
        rows, inside = _alignment.joined(
            parts.end, parts.dt, parts.gyro, parts.accel, parts.gap, parts.instant, count, inside, out
        )
        finished.append(out[: max(rows - 1, 0)].copy())
        unfinished = out[max(rows - 1, 0) : rows].copy()
    finished.append(unfinished)
    columns = ([table[:, column] for table in finished] for column in (0, 1, slice(2, 5), slice(5, 8), 8))
    end, dt, gyro, accel, gap = (np.ascontiguousarray(spill.joined(table)) for table in columns)
    segment = np.cumsum(np.diff(gap, prepend=gap[:1]) != 0.0)
    spill.release()
    return Intervals(end, dt, gyro, accel, segment, gap, instant=False)


def split(parts: Intervals, times: FloatArray, first: int, last: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut intervals from `first` up to, not including, `last` at given times.

    `times` (m,): in order [s]. A time within a microsecond of the previous time or of an interval's end cuts nothing.
    Returns: `parent` (k,): interval of each piece. `s0`, `s1` (k,): start and end of the piece as a fraction of it.
    """
    parent = np.empty(last - first + times.size, np.int64)
    s0, s1 = np.empty((2, parent.size))
    count = _increments.split(parts.end, parts.dt, first, last, times, TIME_TOLERANCE, parent, s0, s1)
    return parent[:count], s0[:count], s1[:count]


def increments(
    parts: Intervals, pieces: tuple[IntArray, FloatArray, FloatArray] | None = None, *, method: Method = "polynomial"
) -> Increments:
    """Compute angle and velocity increments with coning and sculling terms.

    A polynomial represents rate and specific force inside the interval. It goes through five neighbouring increments
    (six values of an instantaneous record) before and after it, at their true times and never across a gap.
    Fourth-order Runge-Kutta integrates the quaternion. A coning motion of 1 deg at 10 Hz, sampled at 100 Hz, causes a
    drift of 0.04 deg/h (instantaneous samples 0.13). Use of only the previous increment would cause 9.8 deg/h.

    Parameters
    ----------
    parts : Intervals
        From `intervals`.
    pieces : tuple of arrays, optional
        From `split`; by default whole intervals.
    method : {"polynomial", "rk4", "rotvec", "euler"}
        All but ``polynomial`` are for comparison. ``rk4``: Runge-Kutta on the straight line between samples, which does
        not reduce the coning error. ``rotvec``: the angle increment is the rotation vector. ``euler``: constant rate,
        from the start of the interval or as its mean; the specific force is not rotated.

    Returns
    -------
    Increments
        One row per piece.

    Raises
    ------
    ConfigError
        Pieces with another method than ``polynomial``, or an unknown method.

    References
    ----------
    Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21 (1998) 19-28, 208-221: the
    decomposition into increments, coning and sculling. The polynomial through neighbouring increments: Miller, "A new
    strapdown attitude algorithm", J. Guidance 6 (1983) 287-291.
    """
    if method != "polynomial":
        return _plain_increments(parts, pieces, method)
    if pieces is None:
        n = parts.end.shape[0]
        pieces = np.arange(n, dtype=np.int64), np.zeros(n), np.ones(n)
    parent, s0, s1 = pieces
    samples = parts.end, parts.dt, parts.gyro, parts.accel, parts.segment
    out = tuple(np.empty((parent.shape[0], 3)) for _ in range(4))
    _increments.increments(parts.instant, *samples, *_weights(parts.instant), *pieces, *out)
    end, dt = parts.end[parent], parts.dt[parent]
    time = np.where(s1 == 1.0, end, end - (1.0 - s1) * dt)
    return Increments(time, (s1 - s0) * dt, *out)


def _plain_increments(
    parts: Intervals, pieces: tuple[IntArray, FloatArray, FloatArray] | None, method: Method
) -> Increments:
    if pieces is not None or method not in _STUDY:
        raise ConfigError(
            "data.integrator_of_parts" if method in _STUDY else "data.unknown_integrator",
            where="method",
            method=method,
            known=("polynomial", *_STUDY),
        )
    out = tuple(np.empty_like(parts.gyro) for _ in range(4))
    _mechanization.increments(_STUDY[method], parts.instant, parts.dt, parts.gyro, parts.accel, *out)
    return Increments(parts.end, parts.dt, *out)


def navigate(
    inc: Increments,
    lla: FloatArray,
    v_n: FloatArray,
    rph: FloatArray,
    *,
    vertical: tuple[FloatArray, FloatArray] | None = None,
    north_gravity: bool = True,
    every: int = 1,
) -> Trajectory:
    """Navigate without aiding (free-inertial), optionally with a given vertical channel.

    Parameters
    ----------
    inc : Increments
        From `increments`.
    lla, v_n, rph : (3,) array
        State at the start of the first interval. `lla`: latitude, longitude [rad], height [m]. `v_n`: velocity North,
        East, Down [m/s]. `rph`: roll, pitch, heading [rad].
    vertical : tuple of (n,) arrays, optional
        Height [m] and down velocity [m/s] at the end of every interval. Without it the vertical channel is free, and
        its error grows as ``cosh(sqrt(2 g / R) t)``: by a factor e every 570 s.
    north_gravity : bool
        Include the north component of normal gravity above the ellipsoid (0.7 ug at 1 km). False is only for
        comparison with data or packages that neglect it.
    every : int
        Decimation: return every `every`-th state.

    Returns
    -------
    Trajectory
        States at the ends of intervals ``every``, ``2 every``, …; within a kilometre of a pole the heading is ``NaN``.
        North and East of the velocity refer to the longitude in the same row, also near a pole.

    References
    ----------
    Groves (2013), section 5.4, near the poles section 5.3; Savage (1998), part 2.
    """
    x = np.concatenate([lla, v_n, quat_from_rph(rph)])
    out = np.empty((inc.time.shape[0] // every, 10))
    channel = vertical is not None, *(vertical or (np.empty(0), np.empty(0)))
    given = inc.dt, inc.dtheta, inc.dvel, inc.coning, inc.sculling
    _mechanization.free_inertial(x, *given, 1.0 if north_gravity else 0.0, *channel, every, out)
    time = inc.time[every - 1 :: every][: out.shape[0]]
    rph_n = rph_from_quat(out[:, 6:])
    rph_n[near_pole(out[:, 0]), 2] = np.nan
    return Trajectory(time, out[:, :3], out[:, 3:6], rph_n)


def nearest_rows(time: FloatArray, wanted: ArrayLike) -> IntArray:
    """Find the row of `time` (n,) nearest to each wanted time (m,); of two equally near rows, the later one."""
    wanted = np.asarray(wanted, dtype=float)
    after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
    return np.asarray(after - (wanted - time[after - 1] < time[after] - wanted))


def between(time: FloatArray, values: FloatArray, wanted: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the row after each wanted time, and `values` (n, k) interpolated linearly, constant beyond the ends."""
    after = np.clip(np.searchsorted(time, wanted), 1, time.shape[0] - 1)
    part = np.clip((wanted - time[after - 1]) / (time[after] - time[after - 1]), 0.0, 1.0)[:, None]
    return after, values[after - 1] + part * (values[after] - values[after - 1])


def navigate_short(
    inc: Increments, lla: FloatArray, v_n: FloatArray, rph: FloatArray, *, turning: bool = True, every: int = 1
) -> Trajectory:
    """Navigate by ``v(t + T) = v(t) + T (f_n + g)``: Euler's rule without Earth and transport rate.

    `inc`: its sculling is not used. `lla`, `v_n`, `rph` (3,): state at the start of the first interval, as in
    `navigate`. `turning`: the attitude follows the rotation of North, East, Down. Otherwise it refers to the initial
    axes, which tilt at the Earth's rate: by far the larger error. `every`: return every `every`-th state.
    Returns: states at the ends of intervals ``every``, ``2 every``, …

    Notes
    -----
    Velocity: Groves (2013), eq. 5.53 without its Coriolis term. Each step uses the attitude and the velocity at its
    start. Compared with the full form, the velocity error is the integral of ``(2 w_ie + w_en) x v``: horizontally
    about ``2 W sin(L) v t``. The position error is half of the velocity error times ``t``.
    """
    x = np.concatenate([lla, v_n, quat_from_rph(rph)])
    out = np.empty((inc.time.shape[0] // every, 10))
    _mechanization.navigate(x, turning, inc.dt, inc.dtheta, inc.dvel, inc.coning, every, out)
    time = inc.time[every - 1 :: every][: out.shape[0]]
    return Trajectory(time, out[:, :3], out[:, 3:6], rph_from_quat(out[:, 6:]))
