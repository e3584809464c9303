"""Agreement of fixes with each other, and of a run with its fixes: statistics, likelihood, contradictions."""

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

FALSE = 1.0  # velocities differing by more from the position change may be false [m/s] ...
SIGMAS = 8.0  # ... if the difference also exceeds this multiple of the usual difference
MEDIANS = 5.0  # a jump exceeds so many medians: exceeded by one in 3e7 of normal errors in two directions
BEND = 0.35  # of the slope change between fixes: largest deviation of a straight line in a bend
REPORTED = 5.0  # least size of a contradiction in reported standard deviations of the positions
NEAR = 2.5  # median intervals over which positions determine a velocity


@dataclass(frozen=True, slots=True)
class FixFigures:
    """Statistics of the fixes."""

    n: int
    rate: float  # [Hz]
    largest_speed: float  # [m/s]
    with_velocity: float  # share of fixes that have one
    with_sd: float  # share whose position has a standard deviation
    reported_sd: FloatArray  # (3,) median of the standard deviations as reported, N, E, D [m]; NaN without
    scatter: FloatArray  # (3,) white part of the position error by third differences [m]
    velocity_lag: float  # lag of velocities behind positions [s]; NaN if not observable
    velocity_lag_sd: float
    false_velocities: float  # share that contradict the positions
    worst_velocity: float  # largest such difference [m/s]
    jumps: int | None  # positions that jump against velocities
    largest_jump: float  # [m]
    fix_types: Mapping[int, int]  # fixes of each type


def look_at_fixes(gps: GpsData) -> FixFigures:
    """Compute statistics of fixes as read."""
    step = np.diff(gps.time)
    usual = float(np.median(step))
    known = np.isfinite(gps.v_n).all(axis=1)
    gone = ned_offset(gps.lla[1:], gps.lla[:-1])
    path = np.vstack([np.zeros(3), np.cumsum(gone, axis=0)])
    lag, lag_sd = velocity_lag(gps)
    even: BoolArray = np.asarray(step < NEAR * usual)
    third = path[3:] - 3.0 * path[2:-1] + 3.0 * path[1:-2] - path[:-3]
    whole = even[2:] & even[1:-1] & even[:-2]
    scatter = 1.4826 * np.median(np.abs(third[whole]), axis=0) / np.sqrt(20.0) if whole.any() else np.full(3, np.nan)
    contradictions = _contradictions(gps, gone, step, even, lag if lag_sd < 0.02 else 0.0)
    reported = np.isfinite(gps.position_sd).all(axis=1)
    if known.any():
        speed = np.linalg.norm(gps.v_n[known, :2], axis=1)
    else:  # over a span in which four sd of a position difference are less than `FALSE`
        noise = 4.0 * np.sqrt(2.0) * float(np.hypot(*scatter[:2])) if whole.any() else 0.0
        span = int(np.clip(np.ceil(noise / (FALSE * usual)), 1, len(gone)))
        speed = np.linalg.norm((path[span:] - path[:-span])[:, :2], axis=1) / (gps.time[span:] - gps.time[:-span])
    return FixFigures(
        len(gps.time),
        1.0 / usual,
        float(speed.max()),
        float(known.mean()),
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
    """Find false velocities (share and worst) and position jumps (number and largest); unknown without both.

    Between fixes the positions should change by the mean of both velocities. If a single step differs, the position has
    jumped and stays. If a velocity is false, both adjacent steps differ and their sum reflects that velocity.
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
    off, bend = v[1:-1] - mean, np.diff(slope, axis=0)
    level, vertical = np.linalg.norm(off[:, :2], axis=1), np.abs(off[:, 2])
    usable = even[1:] & even[:-1] & np.isfinite(level)
    if not usable.any():
        return np.nan, np.nan, None, np.nan
    limits = [max(FALSE, SIGMAS * float(np.median(each[usable]))) for each in (level, vertical)]
    limit, apart = limits[0], np.maximum(level, vertical)
    # positions with poor reported sd determine no velocity: the slope uses two of them
    poor = REPORTED * np.hypot(sd[2:], sd[:-2]) / (step[1:] + step[:-1])[:, None]
    beyond = level > limits[0] + BEND * np.linalg.norm(bend[:, :2], axis=1) + poor[:, :2].max(axis=1)
    beyond |= vertical > limits[1] + BEND * np.abs(bend[:, 2]) + poor[:, 2]
    jump = np.linalg.norm((gone - 0.5 * (v[1:] + v[:-1]) * step[:, None])[:, :2], axis=1)
    # a jump: the positions leave the line while the velocities before and after agree
    smooth = np.linalg.norm((v[1:] - v[:-1])[:, :2], axis=1) < limit
    apart_by = max(3.0, MEDIANS * float(np.nanmedian(jump[even])))
    jumped = even & smooth & (jump > np.maximum(apart_by, REPORTED * np.hypot(sd[1:], sd[:-1])[:, :2].max(axis=1)))
    beside = jumped[1:] | jumped[:-1]
    wrong = usable & beyond & ~beside
    return (
        float(np.mean(wrong[usable])),
        float(np.max(apart[wrong], initial=0.0)),
        int(jumped.sum()),
        float(np.max(jump[jumped], initial=0.0)),
    )


# Twice the negative log-likelihood of an unused fix, and of each run of unused fixes in addition: false fixes come in
# runs [-]. From `FALSE_FROM` on, the cost of a fix grows logarithmically.
UNUSED, EPISODE = 10.0, 30.0


def unlikely(run: Run, ready: FilterInput) -> float:
    """Compute twice the negative log-likelihood of all fixes under white noise of the reported standard deviations.

    An unused fix costs `UNUSED` in addition.
    """
    found, gps, rows = run.innovations, ready.gps, rows_of(run, ready)
    total = EPISODE * sum(1 for _ in of_code(run.events, Code.FILTER_RESET))
    for nis, sd, reported, used in (
        (found.nis_position, found.sd[:, :3], gps.position_sd[rows], found.used_position),
        (found.nis_velocity, found.sd[:, 3:], gps.velocity_sd[rows], found.used_velocity),
    ):
        known = np.isfinite(nis)
        large = FALSE_FROM * (1.0 + np.log(np.maximum(nis, FALSE_FROM) / FALSE_FROM))  # heavy tails
        cost = (np.where(nis > FALSE_FROM, large, nis) + 2.0 * np.log(sd / reported).sum(axis=1))[known & used]
        usual = float(np.median(cost)) if cost.size else 0.0
        total += float(np.sum(cost)) + int((known & ~used).sum()) * (UNUSED + usual)
        total += EPISODE * sum(1 for _ in runs_of(known & ~used))
    return total


def rows_of(run: Run, ready: FilterInput) -> IntArray:
    """Return the row of the fix of each innovation."""
    return np.searchsorted(ready.fix_time, run.innovations.time - 1e-6)


def without_rejected(ready: FilterInput, run: Run) -> GpsData:
    """Mark fixes as invalid where a run rejected their position; the gates test the velocities again."""
    found, gps, rows = run.innovations, ready.gps, rows_of(run, ready)
    fix = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix.copy()
    fix[rows[~found.used_position]] = 0
    return replace(gps, fix=fix)
