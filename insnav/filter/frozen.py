"""Fixes without information: a receiver repeats or extrapolates its last fix, or a logger writes zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.earth import ned_offset
from insnav.findings import Code, Finding
from insnav.tabular import runs_of
from insnav.types import FloatArray, GpsData, ImuData

UNUSABLE = 1e4  # standard deviation of invalid positions [m]
# Least distance by velocities at a repeated position. With jitter: [m], and its largest share of a step. Without: [m],
# multiples of the resolution. Last, the largest speed at rest [m/s]
FROZEN, HARDLY, SAME, STEPS, AT_REST = 30.0, 0.01, 3.0, 10.0, 0.5
KEPT = 0.9  # share of the steps by velocities that must cover the distance
PARKED = 0.2  # of their sd: positions of a stationary vehicle with false velocities scatter more
# With repeated or missing velocities, samples detect motion: duration [s], averaging time [s], scatter of means above
# rest [m/s^2], distance covered [m]
WHILE, MEANS, SHAKEN, JOURNEY = 10.0, 2.0, 0.3, 100.0
COASTS, FEWEST = 5.0, 4  # no vehicle keeps a velocity to the last digit for this time [s] and number of fixes
# Share of the usual distance between a position and its prediction by velocity, in extrapolated fixes. Largest share of
# fixes in motion: noise-free simulated fixes are collinear, too
EXACT, LARGEST = 0.2, 0.3
FAR = 10.0  # distance, in sd, between positions and the prediction by constant velocities


def without_frozen(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove repeated positions in motion, repeated velocities, and fixes extrapolated from these."""
    gps, positions = _without_frozen_positions(gps, imu)
    gps, velocities = _without_held_velocities(gps, imu)
    gps, both = _without_coasting(gps)
    return gps, [*positions, *velocities, *both]


def _without_frozen_positions(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove positions that repeat in motion, with velocities repeated there; report the largest episode.

    Velocities reveal motion, or the IMU samples where whole fixes are repeated.
    """
    position_sd, v_n = gps.position_sd.copy(), gps.v_n.copy()
    frozen = list[tuple[float, float, int, int, float]]()
    moved = ned_offset(gps.lla[1:], gps.lla[:-1])
    mean = np.nan_to_num(0.5 * (v_n[1:] + v_n[:-1])[:, :2])
    gone = mean * (np.diff(gps.time) * (np.linalg.norm(mean, axis=1) > AT_REST))[:, None]
    level = np.abs(moved[:, :2])
    step, written = np.linalg.norm(level, axis=1), float(np.min(level, initial=FROZEN, where=level != 0.0))
    jitter = np.minimum(HARDLY * np.linalg.norm(gone, axis=1), PARKED * gps.position_sd[1:, :2].min(axis=1))
    same = (step == 0.0) | (step < jitter)
    repeated = (moved == 0.0).all(axis=1) & ((np.diff(v_n, axis=0) == 0.0) | np.isnan(v_n[1:])).all(axis=1)
    travels = float(np.ptp(ned_offset(gps.lla, gps.lla[0])[:, :2], axis=0).max(initial=0.0)) > JOURNEY
    for first, last in runs_of(same if gps.fix is None else same & (gps.fix[1:] != 0)):
        far, rows = _way(gone[first:last]), slice(first + 1, last + 1)
        least = FROZEN if step[first:last].any() else max(SAME, STEPS * written)
        whole = travels and bool(repeated[first:last].all())
        shaken = _scatter(imu, *gps.time[[first, last]]) if whole and far <= least else 0.0
        if far > least or shaken > SHAKEN:
            position_sd[rows] = UNUSABLE
            v_n[rows][repeated[first:last]] = np.nan
            frozen.append((far, least, first, last, shaken))
    if not frozen:
        return gps, []
    far, least, first, last, shaken = max(frozen)
    shown = {"scatter_m_s2": shaken, "limit_m_s2": SHAKEN} if shaken else {"distance_m": far, "limit_m": least}
    return replace(gps, position_sd=position_sd, v_n=v_n), [_report(Code.GPS_FROZEN, gps, first, last, frozen, shown)]


def _way(steps: FloatArray) -> float:
    """Return the length of the sum of steps (n, 2) [m] without the few largest: velocities may be false, too."""
    length = np.linalg.norm(steps, axis=1)
    return float(np.linalg.norm(steps[np.argsort(length)[: max(1, int(KEPT * length.size))]].sum(axis=0)))


def _without_held_velocities(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove constant or zero velocities while the positions move otherwise; report the largest episode."""
    v_n, held = gps.v_n.copy(), list[tuple[float, int, int]]()
    same = (np.diff(v_n, axis=0) == 0.0).all(axis=1)
    for first, last in runs_of(same):
        # fix by fix: north rotates along a long track
        moved = ned_offset(gps.lla[first + 1 : last + 1], gps.lla[first:last])
        off = np.cumsum(moved - v_n[first] * np.diff(gps.time[first : last + 1])[:, None], axis=0)
        far, rests = float(np.linalg.norm(off[:, :2], axis=1).max()), not v_n[first].any()
        if far > max(FROZEN, FAR * float(np.median(gps.position_sd[first : last + 1, :2]))) and (
            not rests or _scatter(imu, *gps.time[[first, last]]) > SHAKEN
        ):
            v_n[first + (not rests) : last + 1] = np.nan
            held.append((far, first, last))
    if not held:
        return gps, []
    far, first, last = max(held)
    shown = {"distance_m": far, "limit_m": FROZEN}
    return replace(gps, v_n=v_n), [_report(Code.GPS_FROZEN_VELOCITY, gps, first, last, held, shown)]


def _without_coasting(gps: GpsData) -> tuple[GpsData, list[Finding]]:
    """Remove fixes that a receiver extrapolates in a straight line, as in tunnels; report the largest episode."""
    position_sd, v_n, coasts = gps.position_sd.copy(), gps.v_n.copy(), list[tuple[float, int, int]]()
    step = np.diff(gps.time)
    moved, led = ned_offset(gps.lla[1:], gps.lla[:-1]), 0.5 * (v_n[1:] + v_n[:-1]) * step[:, None]
    off = np.linalg.norm((moved - led)[:, :2], axis=1)
    same, moves = (np.diff(v_n, axis=0) == 0.0).all(axis=1), np.linalg.norm(v_n[1:, :2], axis=1) > AT_REST
    usual = moves & ~same & np.isfinite(off)
    for first, last in runs_of(same & moves) if usual.any() else ():
        lasts = float(gps.time[last] - gps.time[first])
        if last - first >= FEWEST and lasts >= COASTS and np.median(off[first:last]) < EXACT * np.median(off[usual]):
            position_sd[first + 1 : last + 1], v_n[first + 1 : last + 1] = UNUSABLE, np.nan
            coasts.append((lasts, first, last))
    if not 0 < sum(last - first for _, first, last in coasts) < LARGEST * np.count_nonzero(moves):
        return gps, []
    lasts, first, last = max(coasts)
    shown = {"duration_s": lasts, "limit_s": COASTS}
    coasting = _report(Code.GPS_EXTRAPOLATED, gps, first, last, coasts, shown)
    return replace(gps, position_sd=position_sd, v_n=v_n), [coasting]


def _report(
    code: Code, gps: GpsData, first: int, last: int, episodes: Sequence[object], shown: dict[str, Any]
) -> Finding:
    """Report the largest episode: its rows, its number of repeated fixes, and the number of episodes."""
    begin, end = gps.time[[first, last]]
    more = len(episodes) - 1 or np.nan
    return Finding.of(code, begin, end, subject="gps", **shown, count=last - first, more_count=more)


def _scatter(imu: ImuData, first: float, last: float) -> float:
    """Compute the sd of the mean specific force [m/s^2], small at rest; zero for a short span."""
    rows = slice(*np.searchsorted(imu.time, [first, last]).tolist())
    time, accel = imu.time[rows], imu.accel[rows]
    if last - first < WHILE or time.size < WHILE:
        return 0.0
    scale = 1.0 / float(np.median(np.diff(time))) if imu.sampling == "increment" else 1.0
    width = max(1, int(time.size * MEANS / (last - first)))
    count = time.size // width
    means = scale * np.einsum("ijk->ik", accel[: count * width].reshape(count, width, 3)) / width
    return float(np.linalg.norm(np.std(means, axis=0)))
