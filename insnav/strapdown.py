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

BESIDE = 16  # samples on either side that affect an interval
TIME_TOLERANCE = 1e-6  # times closer than this are equal [s]
LOST_WINDOW = 5  # steps on either side that separate lost samples from jitter
_BEFORE = {"end": 1.0, "mid": 0.5, "start": 0.0}  # share of the interval before its stamp
JOINED = 0.04  # a vehicle vibrates faster, but does not turn faster [s]
GAP = 1.5  # an interval longer than this multiple of the nominal one has lost samples


@dataclass(frozen=True, slots=True)
class Intervals:
    """Samples as successive intervals without gaps."""

    end: FloatArray  # (n,) end and length of each interval [s]; each starts at the end of the previous one
    dt: FloatArray
    # (n, 3) integral over the interval [rad], [m/s], or, if `instant`, value at its end [rad/s], [m/s^2]
    gyro: FloatArray
    accel: FloatArray
    segment: IntArray  # (n,) number of the uninterrupted segment
    # (n,) zero for measured data; else the length of the gap [s] that this interval helps to bridge, with values by
    # linear interpolation
    gap: FloatArray
    instant: bool  # see `gyro`. The first interval of an instantaneous record has zero length.


@lru_cache(maxsize=2)
def _weights(instant: bool) -> tuple[FloatArray, FloatArray]:
    weights = _increments.uniform_weights(instant)
    return weights, _increments.stage_weights(weights)


def nominal_interval(time: FloatArray) -> float:
    """Return the mean sample interval without gaps [s]; InputError for fewer than two samples."""
    if time.shape[0] < 2:
        raise InputError("data.few_samples", count=time.shape[0])
    step = np.diff(time[: 1 << 16])
    # the median of timestamps in full milliseconds is one of them
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
    least = (GAP - 1.0) * nominal
    gaps = np.flatnonzero(spill.by_blocks(lambda then, before: then - before > least, start[1:], end[:-1]))
    gyro, accel = imu.gyro, imu.accel
    if gaps.size:
        # Rates are interpolated across a gap. Recorded increments are not converted to rates, to avoid rounding errors.
        length_of = end - start if imu.sampling == "increment" else np.ones(end.shape[0])
        at, new_gap, new_end, new = [], [], [], []
        for k in gaps:
            length = start[k + 1] - end[k]
            missing = max(1, round(length / nominal))
            share = np.arange(1, missing + 1)
            way = (share / (missing + 1))[:, None]
            at.append(np.full(missing, k + 1))
            new_gap.append(np.full(missing, length))
            new_end.append(np.append(end[k] + share[:-1] / missing * length, start[k + 1]))
            sides = [(each[k] / length_of[k], each[k + 1] / length_of[k + 1]) for each in (gyro, accel)]
            new.append([left + way * (right - left) for left, right in sides])
        where = np.concatenate(at)
        end = np.insert(end, where, np.concatenate(new_end))
        gyro, accel = (
            np.insert(each, where, np.concatenate(some), axis=0)
            for each, some in zip((gyro, accel), zip(*new, strict=True), strict=True)
        )
        gap = np.insert(gap, where, np.concatenate(new_gap))
        segment = np.concatenate([[0], np.cumsum(gap[1:] != gap[:-1])]).astype(np.int64)
    dt = spill.joined([end[:1] - start[0], spill.steps(end)])
    if instant:
        dt[0] = 0.0
    elif gaps.size or imu.sampling == "mean":
        scale = np.where(gap > 0.0, dt, 1.0)[:, None] if imu.sampling == "increment" else dt[:, None]
        gyro, accel = (spill.by_blocks(np.multiply, each, scale) for each in (gyro, accel))
    return Intervals(end, dt, gyro, accel, segment, gap, instant)


def pieces(imu: ImuData) -> Iterator[Intervals]:
    """Yield `intervals` of a long record block by block: identical, except that segments are counted in each."""
    nominal, rows = nominal_interval(imu.time), imu.time.shape[0]
    for block in spill.blocks(rows):
        first = max(block.start - BESIDE, 0)
        parts = intervals(imu.rows(slice(first, block.stop + BESIDE)), nominal)
        sample = np.flatnonzero(parts.gap == 0.0)
        begin = int(sample[block.start - first - 1]) + 1 if first < block.start else 0
        own = slice(begin, int(sample[block.stop - first - 1]) + 1)
        gyro, accel = parts.gyro[own], parts.accel[own]
        yield Intervals(parts.end[own], parts.dt[own], gyro, accel, parts.segment[own], parts.gap[own], parts.instant)


def joined(blocks: Iterable[Intervals]) -> Intervals:
    """Join successive intervals of a segment to about `JOINED`, for uses without high rate."""
    found, row, count, inside = [], np.empty((0, 9)), 0, 0
    for parts in blocks:
        count = count or max(1, round(JOINED / float(np.median(parts.dt[: 1 << 16]))))
        out = np.empty((parts.end.shape[0] + 1, 9))
        out[: row.shape[0]] = row
        rows, inside = _alignment.joined(
            parts.end, parts.dt, parts.gyro, parts.accel, parts.gap, parts.instant, count, inside, out
        )
        found.append(out[: max(rows - 1, 0)].copy())
        row = out[max(rows - 1, 0) : rows].copy()
    found.append(row)
    columns = ([some[:, which] for some in found] for which in (0, 1, slice(2, 5), slice(5, 8), 8))
    end, dt, gyro, accel, gap = (np.ascontiguousarray(spill.joined(some)) for some in columns)
    segment = np.cumsum(np.diff(gap, prepend=gap[:1]) != 0.0)
    spill.release()
    return Intervals(end, dt, gyro, accel, segment, gap, instant=False)


def split(parts: Intervals, times: FloatArray, first: int, last: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut intervals from `first` up to, not including, `last` at given times.

    `times` (m,): in order [s]. A time within a microsecond of the previous one or of an interval's end cuts nothing.
    Returns: `parent` (k,): interval of each piece. `s0`, `s1` (k,): its start and end as a fraction of the interval.
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
    (six values of an instantaneous record), at their true times and never across a gap. Fourth-order Runge-Kutta
    integrates the quaternion. Post-processing can use samples on both sides. A cone of 1 deg at 10 Hz, sampled at 100
    Hz, leaves 0.04 deg/h (instantaneous samples 0.13). With the previous increment alone, 9.8 deg/h remain.

    Parameters
    ----------
    parts : Intervals
        From `intervals`.
    pieces : tuple of arrays, optional
        From `split`; by default whole intervals.
    method : {"polynomial", "rk4", "rotvec", "euler"}
        The others are for comparison. ``rk4``: Runge-Kutta on the straight line between samples, without any coning
        benefit. ``rotvec``: the increment is the rotation vector. ``euler``: the rate at the start of the interval, or
        its mean, without rotation of the specific force.

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
    """Navigate free-inertial: without aiding, optionally with a given vertical channel.

    Parameters
    ----------
    inc : Increments
        From `increments`.
    lla, v_n, rph : (3,) array
        State at the start of the first interval. `lla`: latitude, longitude [rad], height [m]. `v_n`: velocity North,
        East, Down [m/s]. `rph`: roll, pitch, heading [rad].
    vertical : tuple of (n,) arrays, optional
        Height [m] and down velocity [m/s] at the end of every interval. Without it the vertical channel is free, and
        its error grows as ``cosh(sqrt(2 g / R) t)``: by e every 570 s.
    north_gravity : bool
        Include the north component of normal gravity above the ellipsoid (0.7 ug at 1 km). False is only for
        comparison with data or packages that neglect it.
    every : int
        Decimation: return every n-th state.

    Returns
    -------
    Trajectory
        States at the ends of intervals ``every``, ``2 every``, …; within a kilometre of a pole the heading is ``NaN``.
        North and East there are relative to the given longitude, as everywhere.

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
    """Find the row nearest in time to each wanted time; the later of two equally near."""
    wanted = np.asarray(wanted, dtype=float)
    after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
    return np.asarray(after - (wanted - time[after - 1] < time[after] - wanted))


def between(time: FloatArray, values: FloatArray, wanted: FloatArray) -> tuple[IntArray, FloatArray]:
    """Find the row after each wanted time, and interpolate the values linearly, constant beyond the ends."""
    after = np.clip(np.searchsorted(time, wanted), 1, time.shape[0] - 1)
    part = np.clip((wanted - time[after - 1]) / (time[after] - time[after - 1]), 0.0, 1.0)[:, None]
    return after, values[after - 1] + part * (values[after] - values[after - 1])


def navigate_short(
    inc: Increments, lla: FloatArray, v_n: FloatArray, rph: FloatArray, *, turning: bool = True, every: int = 1
) -> Trajectory:
    """Navigate by ``v(t + T) = v(t) + T (f_n + g)``: Euler's rule without Earth and transport rate.

    `inc`: its sculling is not used. `lla`, `v_n`, `rph` (3,): state at the start of the first interval, as in
    `navigate`. `turning`: the attitude follows the
    rotation of North, East, Down. Otherwise it remains in the initial axes, which tilt at the Earth's rate: by far the
    larger error. `every`: return every n-th state.
    Returns: states at the ends of intervals ``every``, ``2 every``, …

    Notes
    -----
    Velocity: Groves (2013), eq. 5.53 without its Coriolis term. The attitude at the start of each interval rotates the
    specific force, and the velocity there moves the position. Compared with the full form, the velocity error is the
    integral of ``(2 w_ie + w_en) x v``: horizontally about ``2 W sin(L) v t``. The position error is half of that times
    t.
    """
    x = np.concatenate([lla, v_n, quat_from_rph(rph)])
    out = np.empty((inc.time.shape[0] // every, 10))
    _mechanization.navigate(x, turning, inc.dt, inc.dtheta, inc.dvel, inc.coning, every, out)
    time = inc.time[every - 1 :: every][: out.shape[0]]
    return Trajectory(time, out[:, :3], out[:, 3:6], rph_from_quat(out[:, 6:]))
