"""Agreement of a run with its fixes: residuals from the smoothed track, likelihood, contradictions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav import strapdown
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset, ned_offset
from insnav.filter.prepare import LONGEST_GAP
from insnav.filter.settings import FilterSettings
from insnav.findings import Code, of_code
from insnav.sample_statistics import chi2_limit
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Run

LIMIT = chi2_limit(3, 0.01)  # squared normalised residual of three numbers of a fix that the track supports [-]
GROSS = chi2_limit(3, 1e-9)  # of an accepted fix: filter and smoother contradict each other [-]
MEDIAN = chi2_limit(3, 0.5)
LONGEST = 3.0  # longest time without use of fixes that agree with the smoothed track [s]
ENDS = 0.2  # fixes up to this time outside the track are compared with its end [s]
# Cost of fixes, twice the negative log-likelihood: NIS from which it grows logarithmically, cost of an unused fix, and
# additional cost of each run of unused fixes of any length [-]. False fixes come in runs.
LARGEST, UNUSED, EPISODE = 30.0, 10.0, 30.0


def residuals(run: Run, gps: GpsData, settings: FilterSettings) -> tuple[FloatArray, FloatArray]:
    """Compute residuals of fixes from the smoothed track at the antenna, each velocity at its own time.

    Returns: (2, n, 3) position and velocity residuals, North, East, Down [m], [m/s]. (2, n) their squares normalised by
    reported plus smoothed covariance: 3 on average, if both are true. ``NaN`` without a value, or outside the track.
    """
    assert run.smoothed is not None
    track = run.smoothed.solution
    assert track.sd is not None
    time = gps.time - settings.delay
    after, lla = strapdown.between(track.time, track.lla, time)
    late, v_n = strapdown.between(track.time, track.v_n, time - settings.velocity_lag)
    antenna = lla_offset(lla, dcm_from_rph(track.rph[after]) @ run.lever_b)
    turned = dcm_from_rph(track.rph[late]) - dcm_from_rph(track.rph[late - 1])  # the antenna moves around the IMU
    swing = turned @ run.lever_b / (track.time[late] - track.time[late - 1])[:, None]
    off = np.array([ned_offset(gps.lla, antenna), gps.v_n - v_n - swing])
    outside = (time < track.time[0] - ENDS) | (time > track.time[-1] + ENDS)
    near = np.minimum(time - track.time[after - 1], track.time[after] - time) <= ENDS
    outside |= (track.time[after] - track.time[after - 1] > LONGEST_GAP) & ~near
    off[:, outside] = np.nan
    smoothed = np.array([track.sd[after, :3], track.sd[after, 3:6]])
    return off, np.sum(off**2 / (np.array([gps.position_sd, gps.velocity_sd]) ** 2 + smoothed**2), axis=2)


def unlikely(run: Run, gps: GpsData, settings: FilterSettings) -> float:
    """Compute twice the negative log-likelihood of all fixes under white noise of the reported standard deviations.

    An unused fix costs `UNUSED` in addition.
    """
    found, rows = run.innovations, rows_of(run, gps, settings)
    total = EPISODE * sum(1 for _ in of_code(run.events, Code.FILTER_RESET))
    for nis, sd, reported, used in (
        (found.nis_position, found.sd[:, :3], gps.position_sd[rows], found.used_position),
        (found.nis_velocity, found.sd[:, 3:], gps.velocity_sd[rows], found.used_velocity),
    ):
        known = np.isfinite(nis)
        large = LARGEST * (1.0 + np.log(np.maximum(nis, LARGEST) / LARGEST))  # heavy tails
        cost = (np.where(nis > LARGEST, large, nis) + 2.0 * np.log(sd / reported).sum(axis=1))[known & used]
        usual = float(np.median(cost)) if cost.size else 0.0
        total += float(np.sum(cost)) + int((known & ~used).sum()) * (UNUSED + usual)
        total += EPISODE * len(stretches(found.time, known & ~used))
    return total


def contradicted(run: Run, gps: GpsData, settings: FilterSettings) -> bool:
    """Return whether the filter reset, accepted fixes against the smoothed track, or rejected many that agree."""
    if any(of_code(run.events, Code.FILTER_RESET)):
        return True
    gates, rows = settings.gates, rows_of(run, gps, settings)
    off, square = (each[:, rows] for each in residuals(run, gps, settings))
    square = square / _scales(run)[:, None]
    believed = np.array([run.innovations.used_position, run.innovations.used_velocity])
    far = np.linalg.norm(off, axis=2) > 2.0 * np.array([[gates.small_position], [gates.small_velocity]])
    if (believed & far & (square > GROSS)).any():
        return True
    offered = np.isfinite(run.innovations.nis_position) & (gps.position_sd[rows] <= gates.max_sd).all(axis=1)
    supported = np.asarray(offered & ~believed[0] & (square[0] < LIMIT))
    return any(stop - start > LONGEST for start, stop in stretches(run.innovations.time, supported))


def rows_of(run: Run, gps: GpsData, settings: FilterSettings) -> IntArray:
    """Return the row of the fix of each innovation."""
    return np.searchsorted(gps.time - settings.delay, run.innovations.time - 1e-6)


def without_rejected(gps: GpsData, run: Run, settings: FilterSettings) -> GpsData:
    """Mark fixes as invalid where a run rejected their position; the gates test the velocities again."""
    found, rows = run.innovations, rows_of(run, gps, settings)
    fix = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix.copy()
    fix[rows[~found.used_position]] = 0
    return replace(gps, fix=fix)


def _scales(run: Run) -> FloatArray:
    """Compute the inflation factors of squared innovations of position and velocity, (2,), at least one."""
    both = [nis[np.isfinite(nis)] for nis in (run.innovations.nis_position, run.innovations.nis_velocity)]
    return np.array([max(1.0, float(np.median(nis)) / MEDIAN) if nis.size else 1.0 for nis in both])


def stretches(time: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """Return first and last time of each unbroken sequence of chosen fixes."""
    return [(float(time[start]), float(time[stop - 1])) for start, stop in runs_of(chosen)]
