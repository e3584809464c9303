"""Poses of a bench record, and gyro calibration by the turns between them.

Poses are intervals at rest. All criteria are ratios (of variances, of directions): raw counts work like m/s^2.
Integrated rates must rotate gravity from pose to pose.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, section on the static detector: variance of the specific force in a moving window against a
multiple of the variance at rest. Here the quietest tenth of the record defines the variance at rest, so the record may
begin in motion. Section on gyroscopes: nine parameters from the direction of gravity by accelerometers and by
integrated rates over all turns. This module takes the difference in the plane across gravity (along it there is no
information), and integrates rates with `insnav.strapdown.increments`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from insnav.attitude import dcm_from_quat, quat_conjugate, quat_multiply
from insnav.exceptions import InputError
from insnav.kernels.alignment import gyro_history
from insnav.lab.multi_position.triad import AXES, Normal, normal
from insnav.sample_statistics import moving_variance
from insnav.strapdown import Intervals, increments, intervals
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData, IntArray
from insnav.units import DEG

WINDOW = 1.0  # window of the variance [s]
SHORTEST = 0.5  # least rest between two windows with motion [s]: 1.5 s of rest altogether
FEWEST = 10  # samples of a pose
QUIET_SHARE = 0.1  # quantile of the variance that represents rest
CONTRAST = 25.0  # least variance ratio of the most active tenth to rest, in a record of positions and motions
KNOCK = 1.5 * WINDOW  # a shorter break of rest, without change of pose, is a knock [s]
SAME_POSE = 0.01  # change of specific force, over its spread in the record, within one pose
CLIPPED = 3  # successive extreme samples that mark the end of the range
PARAMETERS = 9
NAMES = tuple(f"scale {a}" if a == b else f"misalignment {a}{b}" for a in AXES for b in AXES)
WORST_CONDITION = 150.0
FEWEST_TURNS = 6  # turns: twelve components against nine parameters
_COARSE = 10  # samples joined for the initial guess
_TRIED = 60  # sensitivities tried
_SMALLEST, _LARGEST = 0.1, 15.0  # plausible turn of the largest movement of a hand calibration [rad]
MISFIT = 20.0 * DEG  # of plausible turns, before the fit
_STEP = 1e-6  # of a relative change of the sensitivity, for slopes
_NO_EARTH = np.zeros(3)
_START = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Pose:
    """Means over one interval at rest."""

    first: int  # samples ``first`` up to, not including, ``last``
    last: int
    start: float  # times of the first and of the last of them [s]
    end: float
    force: FloatArray  # (3,) mean of the accelerometers and of the gyros, in the units of the record
    rate: FloatArray
    force_sd: FloatArray  # (3,) standard deviation of one sample

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.last - self.first


def pose_between(imu: ImuData, first: int, last: int) -> Pose:
    """Means over samples ``first`` up to, not including, ``last``.

    `first`, `last`: at least two samples inside the record.
    """
    force, rate = imu.accel[first:last], imu.gyro[first:last]
    start, end = float(imu.time[first]), float(imu.time[last - 1])
    return Pose(first, last, start, end, force.mean(axis=0), rate.mean(axis=0), force.std(axis=0, ddof=1))


@dataclass(frozen=True, slots=True)
class Activity:
    """Variance of the specific force along a record, relative to rest."""

    ratio: FloatArray  # (n,) variance in a moving window over that at rest [-]
    interval: float  # sampling interval [s]


def measure_activity(imu: ImuData) -> Activity:
    """Measure the activity of a record.

    Raises: InputError: the record is too short, or rest and motion do not differ.
    """
    interval = float(np.median(np.diff(imu.time))) if imu.time.size > 1 else np.inf
    window = 2 * round(0.5 * WINDOW / interval) + 1 if np.isfinite(interval) else 0
    if window < FEWEST or imu.time.size < 10 * window:
        raise InputError("lab.poses_short", count=imu.time.size, interval_s=interval, rate_hz=FEWEST / WINDOW)
    variance = moving_variance(imu.accel, window).sum(axis=1)
    variance[: window // 2] = variance[-(window // 2) :] = np.inf  # no whole window about these
    known = variance[np.isfinite(variance)]
    # a simulated record without noise has no variance at all at rest: rounding is the least there can be
    floor = max(float(np.quantile(known, QUIET_SHARE)), 1e-12 * float(np.mean(imu.accel**2)), np.finfo(float).tiny)
    contrast = float(np.quantile(known, 1.0 - QUIET_SHARE)) / floor
    if contrast < CONTRAST:
        raise InputError("lab.no_contrast", ratio=np.sqrt(contrast))
    return Activity(variance / floor, interval)


def find_poses(imu: ImuData, activity: Activity, factor: float) -> tuple[Pose, ...]:
    """Find the intervals at rest in a record.

    `activity`: of this record. `factor`: largest standard deviation at rest, relative to the quietest tenth. Poses are
    in order of time. The window keeps half its length between a pose and any motion. Of a pose interrupted by a knock
    the longer part is kept, to count the pose once.
    """
    still: BoolArray = activity.ratio < factor * factor
    shortest = max(FEWEST, round(SHORTEST / activity.interval))
    found = [pose_between(imu, first, end) for first, end in runs_of(still).tolist() if end - first >= shortest]
    if not found:
        return ()
    force = np.array([pose.force for pose in found])
    spread = float(np.linalg.norm(force - force.mean(axis=0), axis=1).max())
    kept = found[:1]
    for pose in found[1:]:
        change = float(np.linalg.norm(pose.force - kept[-1].force))
        if pose.start - kept[-1].end > KNOCK or change > SAME_POSE * spread:
            kept.append(pose)
        elif pose.count > kept[-1].count:
            kept[-1] = pose
    return tuple(kept)


def clipped(values: FloatArray, moving: BoolArray) -> BoolArray:
    """Find samples in which a channel stays at its largest or smallest value.

    `values` (n, 3): samples in any unit. `moving` (n,): rows to test: repeated values at rest are normal.
    Returns (n,).
    """
    found = np.zeros(values.shape[0], dtype=np.bool_)
    for column in values.T:
        for extreme in (column.min(), column.max()):
            for first, end in runs_of((column == extreme) & moving):
                if end - first >= CLIPPED:
                    found[first:end] = True
    return found


@dataclass(frozen=True, slots=True)
class Turns:
    """The record prepared for integration between poses."""

    parts: Intervals  # gyros and accelerometers in the unit of the record
    start: IntArray  # (m,) intervals from which and up to which each turn lasts
    end: IntArray
    moving: IntArray  # (k,) intervals that belong to a turn: rest is not integrated
    use: BoolArray  # (m,) turns with all samples present and in range


@dataclass(frozen=True, slots=True)
class TurnFit:
    """Calibrated gyro sensitivity with its turn errors."""

    matrix: FloatArray  # (3, 3) unit of the record per rad/s
    covariance: FloatArray  # (9, 9) of E, by rows, in ``matrix = start (I + E)``, from the scatter of the residuals
    jacobian: FloatArray  # (2 k, 9) derivative of the residuals of the turns used by E
    # (m,) angle between the directions of gravity after each turn, by gyros and by accelerometers [rad]
    error: FloatArray
    sd: float  # standard deviation of one component of it, from the scatter [rad]
    normal: Normal  # analysis of the determination by the turns


def prepare(imu: ImuData, poses: Sequence[Pose], damaged: BoolArray) -> Turns:
    """Find the turns of a record.

    `poses`: at least two. `damaged` (n,): samples at the end of the range.
    """
    parts = intervals(imu)
    begin = np.array([pose.end for pose in poses[:-1]])
    finish = np.array([pose.start for pose in poses[1:]])
    start = np.searchsorted(parts.end, begin, side="right").astype(np.int64)
    end = np.searchsorted(parts.end, finish, side="right").astype(np.int64)
    holes = np.concatenate(([0], np.cumsum(parts.gap > 0.0)))
    bad = np.concatenate(([0], np.cumsum(damaged)))
    samples = np.array([[a.last, b.first] for a, b in itertools.pairwise(poses)])
    use = (holes[end] == holes[start]) & (bad[samples[:, 1]] == bad[samples[:, 0]])
    moving = np.concatenate([np.arange(a, b) for a, b in zip(start, end, strict=True)])
    return Turns(parts, start, end, moving.astype(np.int64), use)


def _attitudes(dt: FloatArray, dtheta: FloatArray) -> FloatArray:
    """Attitude after each increment against the first, (n + 1, 4)."""
    n = dt.shape[0]
    quaternion, unused = np.empty((n + 1, 4)), np.empty((n + 1, 3))
    gyro_history(_START, _NO_EARTH, dt, dtheta, dtheta, quaternion, unused)
    return quaternion


def _between(quaternion: FloatArray, start: IntArray, end: IntArray) -> FloatArray:
    """Matrix that takes body coordinates before each turn to those after it, (m, 3, 3)."""
    turn = quat_multiply(quat_conjugate(quaternion[start]), quaternion[end])
    return np.swapaxes(dcm_from_quat(turn), 1, 2)


def rotations(turns: Turns, bias: FloatArray, matrix: FloatArray) -> FloatArray:
    """Rotation of each turn by the corrected gyros.

    `bias` (3,): in the unit of the record. `matrix` (3, 3): unit of the record per rad/s. Returns (m, 3, 3): takes a
    vector that stands still from body coordinates before the turn to those after it.
    """
    parts = turns.parts
    step = 1.0 if parts.instant else parts.dt[:, None]
    gyro = np.ascontiguousarray((parts.gyro - bias * step) @ np.linalg.inv(matrix).T)
    count = turns.moving.shape[0]
    inc = increments(replace(parts, gyro=gyro), (turns.moving, np.zeros(count), np.ones(count)))
    end = np.cumsum(turns.end - turns.start)
    return _between(_attitudes(inc.dt, inc.dtheta + inc.coning), end - (turns.end - turns.start), end)


def across(up: FloatArray) -> FloatArray:
    """Two unit vectors across each direction, (m, 2, 3)."""
    smallest = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    first = np.cross(up, smallest)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack((first, np.cross(up, first)), axis=1)


def residuals(rotation: FloatArray, up: FloatArray) -> FloatArray:
    """Direction of gravity by the gyros across that by the accelerometers after each turn.

    `rotation` (m, 3, 3): from `rotations`. `up` (m + 1, 3): unit vectors along the specific force in the poses. Returns
    (m, 2): components [rad]; their length is the angle between the two even if it is large.
    """
    carried = np.einsum("mij,mj->mi", rotation, up[:-1])
    sideways = np.einsum("mkj,mj->mk", across(up[1:]), carried)
    sine = np.linalg.norm(sideways, axis=1)
    angle = np.arctan2(sine, np.sum(carried * up[1:], axis=1))
    return np.asarray(sideways * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None])


def first_guess(turns: Turns, bias: FloatArray, up: FloatArray, counts: bool) -> FloatArray:
    """Find an initial sensitivity, equal for all axes; refuse exchanged axes.

    `bias` (3,): in the unit of the record. `up` (m + 1, 3): unit vectors along the specific force in the poses.
    `counts`: the sensitivity is unknown; else it is about 1. Returns (3, 3). Raises: InputError: gyros with other axes
    or signs than the accelerometers, or without signal in the turns.
    """
    parts = turns.parts
    step = parts.dt[:, None]
    angles = parts.gyro * (step if parts.instant else 1.0) - bias * step
    total = np.concatenate((np.zeros((1, 3)), np.cumsum(angles, axis=0)))
    # a few sums of samples are enough for a first guess, and quick
    knots = np.unique(np.concatenate((np.arange(0, len(total), _COARSE), turns.start, turns.end)))
    angle = np.diff(total[knots], axis=0)
    length = np.diff(np.concatenate(([0.0], np.cumsum(parts.dt)))[knots])
    start, end = np.searchsorted(knots, turns.start), np.searchsorted(knots, turns.end)

    def misfit(matrix: FloatArray) -> float:
        rotation = _between(_attitudes(length, angle @ np.linalg.inv(matrix).T), start, end)
        return float(np.sqrt(np.mean(residuals(rotation, up)[turns.use] ** 2)))

    reach = np.linalg.norm(total[turns.end] - total[turns.start], axis=1)[turns.use].max()
    scales = reach / np.geomspace(_SMALLEST, _LARGEST, _TRIED) if counts else np.ones(1)
    tried = [(misfit(scale * np.eye(3)), scale) for scale in scales]
    best, scale = min(tried)
    if best < MISFIT:
        return scale * np.eye(3)
    if not counts and misfit(np.eye(3) / DEG) < MISFIT:
        raise InputError("lab.gyros_in_degrees")
    others = [
        (misfit(s * np.diag(signs)[list(order)]), order, signs)
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
        for s in scales
    ]
    less, order, signs = min(others, key=lambda item: item[0])
    if less < 0.5 * best and less < MISFIT:
        columns = tuple(f"{'+' if signs[o] > 0 else '-'}{AXES[o]}" for o in order)
        raise InputError("lab.gyros_exchanged", axes=columns, angle_rad=less, before_rad=best)
    raise InputError("lab.turns_unseen", angle_rad=best, option="" if counts else "--counts")


def fit_turns(turns: Turns, bias: FloatArray, start: FloatArray, up: FloatArray, use: BoolArray) -> TurnFit:
    """Calibrate gyros by the turns between poses.

    `bias` (3,): in the unit of the record. `start` (3, 3): first guess of the sensitivity. `up` (m + 1, 3): unit
    vectors along the specific force in the poses, by calibrated accelerometers. `use` (m,): turns to use. Raises:
    InputError: too few turns, or turns that leave a parameter undetermined.
    """
    count = int(np.count_nonzero(use))
    if count < FEWEST_TURNS:
        raise InputError("lab.few_turns", count=count, limit=FEWEST_TURNS, parameters=PARAMETERS)

    def misfit(e: FloatArray) -> FloatArray:
        matrix = start @ (np.eye(3) + e.reshape(3, 3))
        return residuals(rotations(turns, bias, matrix), up)[use].ravel()

    def slope(e: FloatArray) -> FloatArray:
        here = misfit(e)
        return np.column_stack([(misfit(e + step) - here) / _STEP for step in _STEP * np.eye(PARAMETERS)])

    done = least_squares(misfit, np.zeros(PARAMETERS), jac=slope, method="lm", xtol=1e-10, ftol=1e-10)
    determined = normal(done.jac)
    if not determined.condition < WORST_CONDITION:
        raise InputError(
            "lab.turns_undetermined",
            parameters=tuple(NAMES[i] for i in determined.weak),
            condition=determined.condition,
            limit=WORST_CONDITION,
        )
    matrix = start @ (np.eye(3) + done.x.reshape(3, 3))
    sd = float(np.sqrt(2.0 * done.cost / (2 * count - PARAMETERS)))
    error = np.linalg.norm(residuals(rotations(turns, bias, matrix), up), axis=1)
    return TurnFit(matrix, determined.inverse * sd**2, np.asarray(done.jac), error, sd, determined)
