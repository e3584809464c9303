"""Agreement of fixes with each other (statistics, contradictions), and of a run with its fixes (likelihood)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from insnav.earth import ned_offset
from insnav.filter.filter_input import FilterInput
from insnav.filter.gps_noise import velocity_lag
from insnav.filter.run_recorder import FALSE_FROM
from insnav.findings import Code, of_code
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Run

FALSE = 1.0  # a velocity is false if it differs by more from the rate of position change [m/s] ...
SIGMAS = 8.0  # ... and by more than this multiple of the median difference [-]
MEDIANS = 5.0  # a jump exceeds this multiple of the median step error, as one in 3e7 normal errors in 2 dimensions does
BEND = 0.35  # velocity error by straight lines between fixes in a bend, as a share of the slope change [-]
REPORTED = 5.0  # a contradiction exceeds this multiple of the reported position sd [-]
NEAR = 2.5  # longest interval for which positions determine a velocity, in median intervals [-]


@dataclass(frozen=True, slots=True)
class FixFigures:
    """Statistics of the fixes."""

    n: int  # number of fixes
    rate: float  # number of fixes per second [Hz]
    largest_speed: float  # largest horizontal speed [m/s]
    with_velocity: float  # share of fixes with a velocity [-]
    with_sd: float  # share of fixes with a position sd [-]
    reported_sd: FloatArray  # (3,) median of the reported position sds, N, E, D [m]; NaN without
    scatter: FloatArray  # (3,) white part of the position errors, from third differences [m]
    velocity_lag: float  # lag of velocities behind positions [s]; NaN if not observable
    velocity_lag_sd: float  # standard deviation of the lag [s]
    false_velocities: float  # share of velocities that contradict the positions [-]
    worst_velocity: float  # largest error of a false velocity [m/s]
    jumps: int | None  # number of jumps of the position that velocities do not confirm; None if unknown
    largest_jump: float  # largest of these jumps [m]
    fix_types: Mapping[int, int]  # number of fixes of each type


def look_at_fixes(gps: GpsData) -> FixFigures:
    """Compute statistics of the fixes as read from a file."""
    step = np.diff(gps.time)
    interval = float(np.median(step))
    with_velocity = np.isfinite(gps.v_n).all(axis=1)
    moved = ned_offset(gps.lla[1:], gps.lla[:-1])
    path = np.vstack([np.zeros(3), np.cumsum(moved, axis=0)])
    lag, lag_sd = velocity_lag(gps)
    even: BoolArray = np.asarray(step < NEAR * interval)
    third = path[3:] - 3.0 * path[2:-1] + 3.0 * path[1:-2] - path[:-3]
    whole = even[2:] & even[1:-1] & even[:-2]
    scatter = 1.4826 * np.median(np.abs(third[whole]), axis=0) / np.sqrt(20.0) if whole.any() else np.full(3, np.nan)
    contradictions = _contradictions(gps, moved, step, even, lag if lag_sd < 0.02 else 0.0)
    reported = np.isfinite(gps.position_sd).all(axis=1)
    if with_velocity.any():
        speed = np.linalg.norm(gps.v_n[with_velocity, :2], axis=1)
    else:  # largest speed by positions, over a span in which 4 sd of their error are less than `FALSE` in speed
        noise = 4.0 * np.sqrt(2.0) * float(np.hypot(*scatter[:2])) if whole.any() else 0.0
        span = int(np.clip(np.ceil(noise / (FALSE * interval)), 1, len(moved)))
        speed = np.linalg.norm((path[span:] - path[:-span])[:, :2], axis=1) / (gps.time[span:] - gps.time[:-span])
    return FixFigures(
        len(gps.time),
        1.0 / interval,
        float(speed.max()),
        float(with_velocity.mean()),
        float(reported.mean()),
        np.median(gps.position_sd[reported], axis=0) if reported.any() else np.full(3, np.nan),
        scatter,
        lag if lag_sd < np.inf else np.nan,
        lag_sd if lag_sd < np.inf else np.nan,
        *contradictions,
        dict(Counter(int(each) for each in gps.fix)) if gps.fix is not None else {},
    )


def _contradictions(
    gps: GpsData, gone: FloatArray, step: FloatArray, even: BoolArray, lag: float
) -> tuple[float, float, int | None, float]:
    """Find false velocities (share, largest error) and position jumps (number, largest); unknown without velocities.

    From fix to fix, the position should change by the mean of both velocities. If a single step differs, the position
    has jumped for good. A false velocity contradicts the mean slope of the two steps next to it.
    """
    v = gps.v_n.copy()
    rows = np.isfinite(v).all(axis=1)
    if rows.sum() < 10:
        return np.nan, np.nan, None, np.nan
    if lag:
        for i in range(3):
            v[rows, i] = np.interp(gps.time[rows] + lag, gps.time[rows], v[rows, i])
    slope = gone / step[:, None]
    mean = 0.5 * (slope[1:] + slope[:-1])
    sd = np.where(np.isfinite(gps.position_sd), gps.position_sd, 0.0)
    difference, bend = v[1:-1] - mean, np.diff(slope, axis=0)
    horizontal, vertical = np.linalg.norm(difference[:, :2], axis=1), np.abs(difference[:, 2])
    usable = even[1:] & even[:-1] & np.isfinite(horizontal)
    if not usable.any():
        return np.nan, np.nan, None, np.nan
    limits = [max(FALSE, SIGMAS * float(np.median(each[usable]))) for each in (horizontal, vertical)]
    limit, error = limits[0], np.maximum(horizontal, vertical)
    # tolerance for the error of a slope between two positions, by their reported sd
    slope_error = REPORTED * np.hypot(sd[2:], sd[:-2]) / (step[1:] + step[:-1])[:, None]
    exceeding = horizontal > limits[0] + BEND * np.linalg.norm(bend[:, :2], axis=1) + slope_error[:, :2].max(axis=1)
    exceeding |= vertical > limits[1] + BEND * np.abs(bend[:, 2]) + slope_error[:, 2]
    jump = np.linalg.norm((gone - 0.5 * (v[1:] + v[:-1]) * step[:, None])[:, :2], axis=1)
    # a jump: the position step disagrees with two velocities that agree with each other
    agreeing = np.linalg.norm((v[1:] - v[:-1])[:, :2], axis=1) < limit
    least_jump = max(3.0, MEDIANS * float(np.nanmedian(jump[even])))
    jumped = even & agreeing & (jump > np.maximum(least_jump, REPORTED * np.hypot(sd[1:], sd[:-1])[:, :2].max(axis=1)))
    next_to_jump = jumped[1:] | jumped[:-1]
    false = usable & exceeding & ~next_to_jump
    return (
        float(np.mean(false[usable])),
        float(np.max(error[false], initial=0.0)),
        int(jumped.sum()),
        float(np.max(jump[jumped], initial=0.0)),
    )


# Cost of an unused fix, and additional cost of each series of successive unused fixes [-]: false fixes come in series.
# Costs are twice the negative log-likelihood. For an NIS above `FALSE_FROM`, the cost grows only logarithmically.
UNUSED, EPISODE = 10.0, 30.0


def unlikely(run: Run, ready: FilterInput) -> float:
    """Compute the cost of a run: twice the negative log-likelihood of all fixes under white noise of the reported sd.

    An unused fix costs the median cost plus `UNUSED`. A reset costs `EPISODE`.
    """
    innovations, gps, rows = run.innovations, ready.gps, rows_of(run, ready)
    total = EPISODE * sum(1 for _ in of_code(run.events, Code.FILTER_RESET))
    for nis, sd, reported, used in (
        (innovations.nis_position, innovations.sd[:, :3], gps.position_sd[rows], innovations.used_position),
        (innovations.nis_velocity, innovations.sd[:, 3:], gps.velocity_sd[rows], innovations.used_velocity),
    ):
        measured = np.isfinite(nis)
        large = FALSE_FROM * (1.0 + np.log(np.maximum(nis, FALSE_FROM) / FALSE_FROM))  # logarithmic for false fixes
        cost = (np.where(nis > FALSE_FROM, large, nis) + 2.0 * np.log(sd / reported).sum(axis=1))[measured & used]
        median_cost = float(np.median(cost)) if cost.size else 0.0
        total += float(np.sum(cost)) + int((measured & ~used).sum()) * (UNUSED + median_cost)
        total += EPISODE * sum(1 for _ in runs_of(measured & ~used))
    return total


def rows_of(run: Run, ready: FilterInput) -> IntArray:
    """Return the row of the fix that each innovation of a run belongs to."""
    return np.searchsorted(ready.fix_time, run.innovations.time - 1e-6)


def without_rejected(ready: FilterInput, run: Run) -> GpsData:
    """Copy the fixes, and mark them as invalid where a run rejected their position. Velocities are tested again."""
    innovations, gps, rows = run.innovations, ready.gps, rows_of(run, ready)
    fix = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix.copy()
    fix[rows[~innovations.used_position]] = 0
    return replace(gps, fix=fix)
