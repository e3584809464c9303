"""Gates that accept or reject fixes: quality, information, physics and statistics, each with its own code.

A wrong covariance misleads a statistical test, so the physical gate does not use it. Rejections never increase the
covariance. A long uninterrupted series of rejections leads to one explicit reset.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from insnav.alignment.align import STATIC_SPEED
from insnav.alignment.in_motion import SUDDEN
from insnav.earth import ned_offset
from insnav.findings import Code, Finding
from insnav.sample_statistics import chi2_limit
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, IntArray


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits beyond which the gates reject or de-weight a fix."""

    # a fix with a larger reported position standard deviation is rejected [m]: it has almost no weight
    max_sd: float = 100.0
    max_speed: float = 400.0  # largest speed of a vehicle, above the speed of airliners [m/s]
    physical_sd: float = 5.0  # tolerance of the physical gates, in standard deviations of the fix [-]
    # probability that a good fix passes the statistical gate: one false rejection in 10,000 fixes, an hour at 3 Hz [-]
    probability: float = 0.9999
    # a smaller innovation is never rejected, but de-weighted to the limit of the statistical gate [m], [m/s]. Lever
    # arm, timestamps and vibration often cause such innovations
    small_position: float = 1.0
    small_velocity: float = 0.5
    # after rejecting all positions for this time, the filter is reset [s]: multipath is shorter, divergence is longer
    reset_after: float = 10.0

    nis_limit: float = field(init=False)  # limit of the NIS of three numbers, from `probability` [-]

    def __post_init__(self) -> None:
        limit = chi2_limit(3, 1.0 - self.probability) if self.probability < 1.0 else math.inf
        object.__setattr__(self, "nis_limit", limit)

    def believing(self) -> Gates:
        """Copy without statistical gate and resets: time-correlated errors mislead a statistical test."""
        return replace(self, probability=1.0, reset_after=math.inf)

    def small_of(self, position_sd: FloatArray) -> float:
        """Return the length up to which an innovation is never rejected [m], for a fix of `position_sd` (3,).

        If most of the error is time-correlated, the NIS compares innovations with the small white part. Steps as large
        as the whole error are normal, however.
        """
        return max(self.small_position, WHOLE_SD * float(min(position_sd.tolist())))

    def limit(self, count: int) -> float:
        """Return the limit of the NIS of `count` numbers [-]."""
        return self.nis_limit if count == 3 else chi2_limit(count, 1.0 - self.probability)


WHOLE_SD = 3.0  # plausible step between fixes, in sds of the whole position error [-]
IN_A_ROW = 3  # largest number of successive false fixes that `aside` finds
ON_LINE = 0.25  # deviation of the neighbours from a line, over the deviation of the false fix; at a jump: 2/3 [-]
OF_REFERENCE = -99  # fix type of reference positions, which are compared with the solution and have no receiver errors


def quality(gates: Gates, time: float, fix: int | None, position_sd: FloatArray) -> Finding | None:
    """Reject an invalid fix: type 0, or a standard deviation beyond `Gates.max_sd`."""
    if fix in (0, OF_REFERENCE):
        return Finding.of(Code.GATE_QUALITY, time)
    worst = max(position_sd.tolist())
    if worst > gates.max_sd:
        return Finding.of(Code.GATE_QUALITY, time, sd_m=worst, limit_m=gates.max_sd)
    return None


def pass_quality(gates: Gates, gps: GpsData) -> BoolArray:
    """Mark the fixes that `quality` does not reject."""
    good: BoolArray = gps.position_sd.max(axis=1) <= gates.max_sd
    return good & gps.valid


def physical_position(
    gates: Gates, time: float, distance: float, position_sd: FloatArray, gap: float
) -> Finding | None:
    """Reject a position whose `distance` [m] exceeds the largest possible move in the `gap` [s] since the last fix."""
    limit = gates.max_speed * gap + gates.physical_sd * max(position_sd.tolist())
    if distance <= limit:
        return None
    return Finding.of(Code.GATE_PHYSICAL_POSITION, time, distance_m=distance, limit_m=limit)


def physical_velocity(gates: Gates, time: float, v_n: FloatArray) -> Finding | None:
    """Reject a velocity beyond `Gates.max_speed`."""
    speed = math.hypot(*v_n.tolist())
    if speed <= gates.max_speed:
        return None
    return Finding.of(Code.GATE_PHYSICAL_VELOCITY, time, speed_m_s=speed, limit_m_s=gates.max_speed)


def impossible(gates: Gates, gps: GpsData) -> BoolArray:
    """Find positions too far from both the previous and the next fix for any vehicle, (n,)."""
    sd = gps.position_sd.max(axis=1)
    limit = gates.max_speed * np.diff(gps.time) + gates.physical_sd * (sd[1:] + sd[:-1])
    distant = np.linalg.norm(ned_offset(gps.lla[1:], gps.lla[:-1]), axis=1) > limit
    return np.asarray(np.append(True, distant) & np.append(distant, True))


def aside(gates: Gates, gps: GpsData) -> BoolArray:
    """Find positions farther from the line between neighbouring fixes than any vehicle can swerve and return, (n,).

    Up to `IN_A_ROW` successive fixes are found. The fixes around them must be collinear, unlike at a lasting jump.
    """
    aside_fixes = np.zeros(gps.time.size, dtype=np.bool_)
    remaining = np.flatnonzero(gps.valid)  # leave out invalid fixes, which may be anywhere
    while (false := _beside(gates, gps.rows(remaining))).any():  # repeat: a false fix masks others
        aside_fixes[remaining[false]], remaining = True, remaining[~false]
    return aside_fixes


def _beside(gates: Gates, gps: GpsData) -> BoolArray:
    time, sd, false = gps.time, gps.position_sd.max(axis=1), np.zeros(gps.time.size, dtype=np.bool_)
    # sum of steps from fix to fix: one local frame would not suit a long track
    place = np.cumsum(np.vstack([np.zeros(3), ned_offset(gps.lla[1:], gps.lla[:-1])]), axis=0)

    def off(row: IntArray, first: IntArray, last: IntArray) -> tuple[FloatArray, FloatArray]:
        """Compute the distance of fixes from the line between two others, and its limit by dynamics and errors [m]."""
        since, until = time[row] - time[first], time[last] - time[row]
        share = (since / (since + until))[:, None]
        way = place[row] - (1.0 - share) * place[first] - share * place[last]
        errors = gates.physical_sd * (sd[row] + np.maximum(sd[first], sd[last]))
        return np.linalg.norm(way, axis=1), 0.5 * SUDDEN * since * until + errors

    # series of `length` fixes off the line between their neighbours, which are collinear with the fixes around
    for length in range(1, IN_A_ROW + 1):
        first = np.arange(1, time.size - length - 2)  # row of the fix before the series
        last = first + length + 1
        distance, limit = np.array([off(first + k, first, last) for k in range(1, length + 1)]).swapaxes(0, 1)
        aligned = np.minimum(off(first, first - 1, last)[0], off(last, first, last + 1)[0])
        start = first[(distance > limit).all(axis=0) & (aligned < ON_LINE * distance.min(axis=0))]
        false[(start[:, None] + np.arange(1, length + 1)).ravel()] = True
    return false


def statistical(
    gates: Gates, time: float, codes: tuple[Code, Code], nis: float, size: float, small: float
) -> Finding | None:
    """Reject an innovation with an improbable NIS, or de-weight it if its length `size` is up to `small` [m] or [m/s].

    `codes`: code of a rejection, code of a de-weighting. Returns None if the innovation passes.
    """
    if nis <= gates.nis_limit:
        return None
    return Finding.of(codes[int(size <= small)], time, nis=nis, limit_nis=gates.nis_limit)


def whole_record(
    time: float, row: int, false: BoolArray, distance: float, change: float
) -> tuple[Finding | None, Finding | None]:
    """Reject position or velocity of a fix that the search over the whole record found false.

    `false` (2, n): false positions and velocities. `distance`, `change`: lengths of the innovations [m], [m/s].
    """
    position, velocity = false[:, row]
    return (
        Finding.of(Code.GATE_RECORD_POSITION, time, distance_m=distance) if position else None,
        Finding.of(Code.GATE_RECORD_VELOCITY, time, speed_m_s=change) if velocity else None,
    )


UNUSABLE = 1e4  # standard deviation that marks a position as invalid [m]
# A repeated position is frozen if velocities imply a larger distance. With jitter: [m]. Without: [m], and resolutions
FROZEN, SAME, STEPS = 30.0, 3.0, 10.0
KEPT = 0.9  # share of the velocity steps that must cover this distance; jitter is at most 1 - `KEPT` of a step
PARKED = 0.2  # largest jitter in position sds: positions of a stationary vehicle scatter more
# If velocities repeat or are missing, samples detect motion. Least duration [s], averaging time [s], least scatter of
# the means [m/s^2], least size of the track [m]
WHILE, MEANS, SHAKEN, JOURNEY = 10.0, 2.0, 0.3, 100.0
COASTS, FEWEST = 5.0, 4  # no vehicle keeps a velocity to the last digit for this time [s] and this number of fixes
# Extrapolated fixes agree with their velocities within the first share of the usual difference. They are at most the
# second share of all fixes in motion: in a noise-free simulation, all fixes are collinear
EXACT, LARGEST = 0.2, 0.3
FAR = 10.0  # distance between positions and their prediction by repeated velocities that proves these false, in sd


def without_frozen(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove positions that repeat in motion, repeated velocities, and extrapolated fixes, with findings on each."""
    gps, positions = _without_frozen_positions(gps, imu)
    gps, velocities = _without_held_velocities(gps, imu)
    gps, both = _without_coasting(gps)
    return gps, [*positions, *velocities, *both]


def _without_frozen_positions(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove positions, and velocities, that repeat while the vehicle moves. Report the largest episode.

    Velocities prove motion. If they are repeated as well, the IMU samples prove it.
    """
    position_sd, v_n = gps.position_sd.copy(), gps.v_n.copy()
    frozen = list[tuple[float, float, int, int, float]]()
    by_position = ned_offset(gps.lla[1:], gps.lla[:-1])
    mean = np.nan_to_num(0.5 * (v_n[1:] + v_n[:-1])[:, :2])
    expected = mean * (np.diff(gps.time) * (np.linalg.norm(mean, axis=1) > STATIC_SPEED))[:, None]
    level = np.abs(by_position[:, :2])
    step, written = np.linalg.norm(level, axis=1), float(np.min(level, initial=FROZEN, where=level != 0.0))
    jitter = np.minimum((1.0 - KEPT) * np.linalg.norm(expected, axis=1), PARKED * gps.position_sd[1:, :2].min(axis=1))
    # steps far shorter than velocities imply count as repeated positions with jitter
    unmoved = (step == 0.0) | (step < jitter)
    repeated = (by_position == 0.0).all(axis=1) & ((np.diff(v_n, axis=0) == 0.0) | np.isnan(v_n[1:])).all(axis=1)
    travels = float(np.ptp(ned_offset(gps.lla, gps.lla[0])[:, :2], axis=0).max(initial=0.0)) > JOURNEY
    for first, last in runs_of(unmoved & gps.valid[1:]):
        distance, rows = _way(expected[first:last]), slice(first + 1, last + 1)
        least = FROZEN if step[first:last].any() else max(SAME, STEPS * written)
        all_repeated = travels and bool(repeated[first:last].all())
        scatter = _scatter(imu, *gps.time[[first, last]]) if all_repeated and distance <= least else 0.0
        if distance > least or scatter > SHAKEN:
            position_sd[rows] = UNUSABLE
            v_n[rows][repeated[first:last]] = np.nan
            frozen.append((distance, least, first, last, scatter))
    if not frozen:
        return gps, []
    distance, least, first, last, scatter = max(frozen)
    values = {"scatter_m_s2": scatter, "limit_m_s2": SHAKEN} if scatter else {"distance_m": distance, "limit_m": least}
    return replace(gps, position_sd=position_sd, v_n=v_n), [_report(Code.GPS_FROZEN, gps, first, last, frozen, values)]


def _way(steps: FloatArray) -> float:
    """Return the length of the sum of steps (n, 2) [m], without the largest ones: a few velocities may be false."""
    length = np.linalg.norm(steps, axis=1)
    return float(np.linalg.norm(steps[np.argsort(length)[: max(1, int(KEPT * length.size))]].sum(axis=0)))


def _without_held_velocities(gps: GpsData, imu: ImuData) -> tuple[GpsData, list[Finding]]:
    """Remove velocities that repeat while the positions contradict them. Report the largest episode."""
    v_n, held = gps.v_n.copy(), list[tuple[float, int, int]]()
    repeated = (np.diff(v_n, axis=0) == 0.0).all(axis=1)
    for first, last in runs_of(repeated):
        # sum of steps from fix to fix: north rotates along a long track
        moved = ned_offset(gps.lla[first + 1 : last + 1], gps.lla[first:last])
        error = np.cumsum(moved - v_n[first] * np.diff(gps.time[first : last + 1])[:, None], axis=0)
        distance, zero = float(np.linalg.norm(error[:, :2], axis=1).max()), not v_n[first].any()
        if distance > max(FROZEN, FAR * float(np.median(gps.position_sd[first : last + 1, :2]))) and (
            not zero or _scatter(imu, *gps.time[[first, last]]) > SHAKEN
        ):
            v_n[first + (not zero) : last + 1] = np.nan
            held.append((distance, first, last))
    if not held:
        return gps, []
    distance, first, last = max(held)
    values = {"distance_m": distance, "limit_m": FROZEN}
    return replace(gps, v_n=v_n), [_report(Code.GPS_FROZEN_VELOCITY, gps, first, last, held, values)]


def _without_coasting(gps: GpsData) -> tuple[GpsData, list[Finding]]:
    """Remove fixes that a receiver extrapolates in a straight line, as in tunnels. Report the longest episode."""
    position_sd, v_n, coasts = gps.position_sd.copy(), gps.v_n.copy(), list[tuple[float, int, int]]()
    step = np.diff(gps.time)
    moved, predicted = ned_offset(gps.lla[1:], gps.lla[:-1]), 0.5 * (v_n[1:] + v_n[:-1]) * step[:, None]
    off = np.linalg.norm((moved - predicted)[:, :2], axis=1)
    repeated, moves = (np.diff(v_n, axis=0) == 0.0).all(axis=1), np.linalg.norm(v_n[1:, :2], axis=1) > STATIC_SPEED
    normal = moves & ~repeated & np.isfinite(off)
    for first, last in runs_of(repeated & moves) if normal.any() else ():
        lasts = float(gps.time[last] - gps.time[first])
        if last - first >= FEWEST and lasts >= COASTS and np.median(off[first:last]) < EXACT * np.median(off[normal]):
            position_sd[first + 1 : last + 1], v_n[first + 1 : last + 1] = UNUSABLE, np.nan
            coasts.append((lasts, first, last))
    if not 0 < sum(last - first for _, first, last in coasts) < LARGEST * np.count_nonzero(moves):
        return gps, []
    lasts, first, last = max(coasts)
    values = {"duration_s": lasts, "limit_s": COASTS}
    coasting = _report(Code.GPS_EXTRAPOLATED, gps, first, last, coasts, values)
    return replace(gps, position_sd=position_sd, v_n=v_n), [coasting]


def _report(
    code: Code, gps: GpsData, first: int, last: int, episodes: Sequence[object], shown: dict[str, Any]
) -> Finding:
    """Report the largest episode: its time, its number of repeated fixes, and the number of further episodes."""
    begin, end = gps.time[[first, last]]
    further = len(episodes) - 1 or np.nan
    return Finding.of(code, begin, end, subject="gps", **shown, count=last - first, more_count=further)


def _scatter(imu: ImuData, first: float, last: float) -> float:
    """Compute the scatter of means of the specific force [m/s^2], which is small at rest. Zero if the span is short."""
    rows = slice(*np.searchsorted(imu.time, [first, last]).tolist())
    time, accel = imu.time[rows], imu.accel[rows]
    if last - first < WHILE or time.size < WHILE:
        return 0.0
    scale = 1.0 / float(np.median(np.diff(time))) if imu.sampling == "increment" else 1.0
    width = max(1, int(time.size * MEANS / (last - first)))
    count = time.size // width
    means = scale * np.einsum("ijk->ik", accel[: count * width].reshape(count, width, 3)) / width
    return float(np.linalg.norm(np.std(means, axis=0)))
