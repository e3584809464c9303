"""How well a run agrees with its fixes: residuals from the smoothed track, likelihood, contradictions."""

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
LONGEST = 3.0  # fixes that the smoothed track supports may be rejected for so long [s]
ENDS = 0.2  # a fix so little before or after the track is compared with its end [s]
# likelihood of runs, twice its negative logarithm: from where on the NIS of a fix counts by its logarithm, what a
# fix costs that was not used, and as much more a row of them, however long: a false one is seldom alone [-]
LARGEST, UNUSED, EPISODE = 30.0, 10.0, 30.0


def residuals(run: Run, gps: GpsData, settings: FilterSettings) -> tuple[FloatArray, FloatArray]:
    """Compare fixes with the smoothed track at the antenna, velocities with that of the time they are of.

    Returns: (2, n, 3) what positions and velocities are off, North, East, Down [m], [m/s]; (2, n) its square, by the
    variance reported and smoothed: 3 on average, if both are true. ``NaN`` without a value, or outside the track.
    """
    assert run.smoothed is not None
    track = run.smoothed.solution
    assert track.sd is not None
    time = gps.time - settings.delay
    after, lla = strapdown.between(track.time, track.lla, time)
    late, v_n = strapdown.between(track.time, track.v_n, time - settings.velocity_lag)
    antenna = lla_offset(lla, dcm_from_rph(track.rph[after]) @ run.lever_b)
    turned = dcm_from_rph(track.rph[late]) - dcm_from_rph(track.rph[late - 1])  # the antenna swings about the IMU
    swing = turned @ run.lever_b / (track.time[late] - track.time[late - 1])[:, None]
    off = np.array([ned_offset(gps.lla, antenna), gps.v_n - v_n - swing])
    outside = (time < track.time[0] - ENDS) | (time > track.time[-1] + ENDS)
    near = np.minimum(time - track.time[after - 1], track.time[after] - time) <= ENDS
    outside |= (track.time[after] - track.time[after - 1] > LONGEST_GAP) & ~near
    off[:, outside] = np.nan
    smoothed = np.array([track.sd[after, :3], track.sd[after, 3:6]])
    return off, np.sum(off**2 / (np.array([gps.position_sd, gps.velocity_sd]) ** 2 + smoothed**2), axis=2)


def unlikely(run: Run, gps: GpsData, settings: FilterSettings) -> float:
    """Twice the negative log-likelihood of all fixes against white noise of the reported standard deviations.

    A fix that was not used costs more than those that were.
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
    """Whether the filter reset, believed a fix that the smoothed track contradicts, or rejected many it supports."""
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
    """Row of the fix of each innovation."""
    return np.searchsorted(gps.time - settings.delay, run.innovations.time - 1e-6)


def without_rejected(gps: GpsData, run: Run, settings: FilterSettings) -> GpsData:
    """Fixes of which those whose position a run rejected are marked as none; velocities the gates decide anew."""
    found, rows = run.innovations, rows_of(run, gps, settings)
    fix = np.ones(gps.time.shape[0], dtype=np.int64) if gps.fix is None else gps.fix.copy()
    fix[rows[~found.used_position]] = 0
    return replace(gps, fix=fix)


def _scales(run: Run) -> FloatArray:
    """How much larger squared innovations of position and velocity are than they should be, (2,); no less than one."""
    both = [nis[np.isfinite(nis)] for nis in (run.innovations.nis_position, run.innovations.nis_velocity)]
    return np.array([max(1.0, float(np.median(nis)) / MEDIAN) if nis.size else 1.0 for nis in both])


def stretches(time: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """First and last time of each unbroken row of chosen fixes."""
    return [(float(time[start]), float(time[stop - 1])) for start, stop in runs_of(chosen)]
