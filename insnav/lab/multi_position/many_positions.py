"""Multi-position calibration without a table: a sensor in many poses, with turns between them.

Poses are intervals at rest. All criteria for poses are ratios (of variances, of directions), so raw counts work like
m/s^2. Gravity has the same magnitude in all poses: this calibrates the accelerometers. Integrated rates must rotate the
direction of gravity from pose to pose: this calibrates the gyros. The poses also give the g-sensitivity of the gyros,
the largest remaining error of a MEMS gyro. It is removed before the turns are integrated.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014. Section on the static detector: variance of the specific force in a moving window against a
multiple of the variance at rest. Here the quietest tenth of the record defines the variance at rest, so the record may
begin in motion. Section on gyroscopes: nine parameters from the direction of gravity by accelerometers and by
integrated rates over all turns. This module takes the difference in the plane across gravity (along gravity there
is no information), and integrates rates with `insnav.strapdown.increments`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from insnav.attitude import dcm_from_quat, quat_conjugate, quat_multiply
from insnav.exceptions import InputError
from insnav.kernels.alignment import gyro_history
from insnav.lab.calibration import WRONG_UNIT
from insnav.lab.multi_position import triad as gravity
from insnav.lab.multi_position.triad import AXES, MultiPosition, Normal, Triad, corrected, normal
from insnav.sample_statistics import moving_variance
from insnav.strapdown import Intervals, increments, intervals
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray, ImuData, IntArray
from insnav.units import DEG

WINDOW = 1.0  # length of the moving window of the variance [s]
SHORTEST = 0.5  # least length of a pose between two windows with motion [s]: 1.5 s of rest altogether
FEWEST = 10  # least number of samples of a pose
QUIET_SHARE = 0.1  # quantile of the variance that represents rest
CONTRAST = 25.0  # least variance ratio of the most active tenth to rest, in a record of positions and motions
KNOCK = 1.5 * WINDOW  # a shorter interruption of rest, without change of pose, is a knock [s]
SAME_POSE = 0.01  # largest change of specific force within one pose, relative to its spread in the record
CLIPPED = 3  # least number of successive extreme samples of a clipped channel
PARAMETERS = 9  # sensitivities of three gyros to three axes
NAMES = tuple(f"scale {a}" if a == b else f"misalignment {a}{b}" for a in AXES for b in AXES)
WORST_CONDITION = 150.0  # largest condition number of usable turns
FEWEST_TURNS = 6  # least number of turns: twelve components against nine parameters
_COARSE = 10  # number of samples that are summed for the initial guess
_TRIED = 60  # number of sensitivities tried for the initial guess
_SMALLEST, _LARGEST = 0.1, 15.0  # range of the largest turn in a hand calibration [rad]
MISFIT = 20.0 * DEG  # largest RMS misfit of plausible turns, before the fit
_STEP = 1e-6  # relative change of the sensitivity for numerical derivatives
_NO_EARTH = np.zeros(3)  # the rotation of the Earth is neglected
_START = np.array([1.0, 0.0, 0.0, 0.0])  # quaternion of the initial attitude
FACTORS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # candidate limits of rest, in standard deviations at rest
ALIKE = 1.0  # largest difference of log determinants of nearly equal covariances: 6 % in each sd
LEAST_OWN = 0.1  # least share of the turns' scatter that the gyros themselves cause
FOLDS = 5  # parts of the data for cross-validation
WRONG_NORM = 0.02  # poses at rest always have a smaller relative scatter of the magnitude of gravity


@dataclass(frozen=True, slots=True)
class Pose:
    """Means over one interval at rest."""

    first: int  # samples ``first`` up to, not including, ``last``
    last: int
    start: float  # time of the first sample [s]
    end: float  # time of the last sample [s]
    force: FloatArray  # (3,) mean of the accelerometers [unit of the record]
    rate: FloatArray  # (3,) mean of the gyros [unit of the record]
    force_sd: FloatArray  # (3,) standard deviation of one accelerometer sample

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.last - self.first


def pose_between(imu: ImuData, first: int, last: int) -> Pose:
    """Compute the means of a pose over samples ``first`` up to, not including, ``last``.

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
    """Compute the variance of the specific force along a record, relative to rest.

    Raises: InputError: the record is too short, or rest and motion do not differ.
    """
    interval = float(np.median(np.diff(imu.time))) if imu.time.size > 1 else np.inf
    window = 2 * round(0.5 * WINDOW / interval) + 1 if np.isfinite(interval) else 0
    if window < FEWEST or imu.time.size < 10 * window:
        raise InputError("lab.poses_short", count=imu.time.size, interval_s=interval, rate_hz=FEWEST / WINDOW)
    variance = moving_variance(imu.accel, window).sum(axis=1)
    variance[: window // 2] = variance[-(window // 2) :] = np.inf  # the ends have no whole window
    finite = variance[np.isfinite(variance)]
    # a simulated record without noise has no variance at rest: the lower limit is the level of rounding
    floor = max(float(np.quantile(finite, QUIET_SHARE)), 1e-12 * float(np.mean(imu.accel**2)), np.finfo(float).tiny)
    contrast = float(np.quantile(finite, 1.0 - QUIET_SHARE)) / floor
    if contrast < CONTRAST:
        raise InputError("lab.no_contrast", ratio=np.sqrt(contrast))
    return Activity(variance / floor, interval)


def find_poses(imu: ImuData, activity: Activity, factor: float) -> tuple[Pose, ...]:
    """Find the intervals at rest in a record.

    `activity`: activity of this record. `factor`: largest standard deviation at rest, relative to the quietest tenth.
    Poses are in order of time. Between a pose and motion there is half a window. If a knock interrupts a pose, only the
    longer part is kept, so that the pose counts once.
    """
    still: BoolArray = activity.ratio < factor * factor
    shortest = max(FEWEST, round(SHORTEST / activity.interval))
    candidates = [pose_between(imu, first, end) for first, end in runs_of(still).tolist() if end - first >= shortest]
    if not candidates:
        return ()
    force = np.array([pose.force for pose in candidates])
    spread = float(np.linalg.norm(force - force.mean(axis=0), axis=1).max())
    poses = candidates[:1]
    for pose in candidates[1:]:
        change = float(np.linalg.norm(pose.force - poses[-1].force))
        if pose.start - poses[-1].end > KNOCK or change > SAME_POSE * spread:
            poses.append(pose)
        elif pose.count > poses[-1].count:
            poses[-1] = pose
    return tuple(poses)


def clipped(values: FloatArray, moving: BoolArray) -> BoolArray:
    """Find samples in which a channel stays at its largest or smallest value.

    `values` (n, 3): samples in any unit. `moving` (n,): rows to test: repeated values at rest are normal.
    Returns (n,): True if clipped.
    """
    at_limit = np.zeros(values.shape[0], dtype=np.bool_)
    for column in values.T:
        for extreme in (column.min(), column.max()):
            for first, end in runs_of((column == extreme) & moving):
                if end - first >= CLIPPED:
                    at_limit[first:end] = True
    return at_limit


@dataclass(frozen=True, slots=True)
class Turns:
    """Record prepared for the integration of turns from pose to pose."""

    parts: Intervals  # gyros and accelerometers in the unit of the record
    start: IntArray  # (m,) index of the first sample interval of each turn
    end: IntArray  # (m,) index of the first sample interval after each turn
    moving: IntArray  # (k,) sample intervals inside turns; intervals at rest are not integrated
    use: BoolArray  # (m,) True for turns with all samples present and in range


@dataclass(frozen=True, slots=True)
class TurnFit:
    """Calibrated gyro sensitivity, and the remaining errors of the turns."""

    matrix: FloatArray  # (3, 3) unit of the record per rad/s
    covariance: FloatArray  # (9, 9) of E, by rows, in ``matrix = start (I + E)``, from the scatter of the residuals
    jacobian: FloatArray  # (2 k, 9) derivative by E of the residuals of the turns used
    # (m,) angle between the directions of gravity after each turn, by gyros and by accelerometers [rad]
    error: FloatArray
    sd: float  # standard deviation of one component of a turn error, from the scatter [rad]
    normal: Normal  # shows how well the turns determine the parameters


def prepare(imu: ImuData, poses: Sequence[Pose], damaged: BoolArray) -> Turns:
    """Find the turns of a record. `poses`: at least two. `damaged` (n,): samples at the end of the range."""
    parts = intervals(imu)
    pose_end = np.array([pose.end for pose in poses[:-1]])
    pose_start = np.array([pose.start for pose in poses[1:]])
    start = np.searchsorted(parts.end, pose_end, side="right").astype(np.int64)
    end = np.searchsorted(parts.end, pose_start, side="right").astype(np.int64)
    gap_count = np.concatenate(([0], np.cumsum(parts.gap > 0.0)))
    damaged_count = np.concatenate(([0], np.cumsum(damaged)))
    samples = np.array([[a.last, b.first] for a, b in itertools.pairwise(poses)])
    use = (gap_count[end] == gap_count[start]) & (damaged_count[samples[:, 1]] == damaged_count[samples[:, 0]])
    moving = np.concatenate([np.arange(a, b) for a, b in zip(start, end, strict=True)])
    return Turns(parts, start, end, moving.astype(np.int64), use)


def _attitudes(dt: FloatArray, dtheta: FloatArray) -> FloatArray:
    """Compute the attitude quaternion before and after each increment, relative to the start, (n + 1, 4)."""
    n = dt.shape[0]
    quaternion, unused = np.empty((n + 1, 4)), np.empty((n + 1, 3))
    gyro_history(_START, _NO_EARTH, dt, dtheta, dtheta, quaternion, unused)
    return quaternion


def _between(quaternion: FloatArray, start: IntArray, end: IntArray) -> FloatArray:
    """Return the matrix that converts body coordinates before each turn to body coordinates after it, (m, 3, 3)."""
    return np.swapaxes(dcm_from_quat(quat_multiply(quat_conjugate(quaternion[start]), quaternion[end])), 1, 2)


def rotations(turns: Turns, bias: FloatArray, matrix: FloatArray) -> FloatArray:
    """Compute the rotation of each turn by the corrected gyros.

    `bias` (3,): in the unit of the record. `matrix` (3, 3): unit of the record per rad/s. Returns (m, 3, 3): converts a
    fixed vector from body coordinates before the turn to body coordinates after it.
    """
    parts = turns.parts
    step = 1.0 if parts.instant else parts.dt[:, None]
    gyro = np.ascontiguousarray((parts.gyro - bias * step) @ np.linalg.inv(matrix).T)
    count = turns.moving.shape[0]
    inc = increments(replace(parts, gyro=gyro), (turns.moving, np.zeros(count), np.ones(count)))
    end = np.cumsum(turns.end - turns.start)
    return _between(_attitudes(inc.dt, inc.dtheta + inc.coning), end - (turns.end - turns.start), end)


def across(up: FloatArray) -> FloatArray:
    """Return two unit vectors perpendicular to each direction `up` (m, 3), as (m, 2, 3)."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up), axis=1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack((first, np.cross(up, first)), axis=1)


def residuals(rotation: FloatArray, up: FloatArray) -> FloatArray:
    """Compute the difference between the directions of gravity by gyros and by accelerometers after each turn.

    `rotation` (m, 3, 3): from `rotations`. `up` (m + 1, 3): unit vectors along the specific force in the poses. Returns
    (m, 2): components across gravity [rad]; their length is the angle between both directions, even a large one.
    """
    carried = np.einsum("mij,mj->mi", rotation, up[:-1])
    sideways = np.einsum("mkj,mj->mk", across(up[1:]), carried)
    sine = np.linalg.norm(sideways, axis=1)
    angle = np.arctan2(sine, np.sum(carried * up[1:], axis=1))
    return np.asarray(sideways * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None])


def first_guess(turns: Turns, bias: FloatArray, up: FloatArray, counts: bool) -> FloatArray:
    """Find an initial sensitivity, equal for all axes; refuse exchanged axes.

    `bias` (3,): in the unit of the record. `up` (m + 1, 3): unit vectors along the specific force in the poses.
    `counts`: the sensitivity is unknown; otherwise it is about 1. Returns (3, 3). Raises: InputError: gyros with other
    axes or signs than the accelerometers, or without signal in the turns.
    """
    parts = turns.parts
    step = parts.dt[:, None]
    angles = parts.gyro * (step if parts.instant else 1.0) - bias * step
    total = np.concatenate((np.zeros((1, 3)), np.cumsum(angles, axis=0)))
    # sums of a few samples are accurate enough for a first guess, and fast
    knots = np.unique(np.concatenate((np.arange(0, len(total), _COARSE), turns.start, turns.end)))
    angle = np.diff(total[knots], axis=0)
    length = np.diff(np.concatenate(([0.0], np.cumsum(parts.dt)))[knots])
    start, end = np.searchsorted(knots, turns.start), np.searchsorted(knots, turns.end)

    def misfit(matrix: FloatArray) -> float:
        rotation = _between(_attitudes(length, angle @ np.linalg.inv(matrix).T), start, end)
        return float(np.sqrt(np.mean(residuals(rotation, up)[turns.use] ** 2)))

    largest_turn = np.linalg.norm(total[turns.end] - total[turns.start], axis=1)[turns.use].max()
    scales = largest_turn / np.geomspace(_SMALLEST, _LARGEST, _TRIED) if counts else np.ones(1)
    best, scale = min((misfit(scale * np.eye(3)), scale) for scale in scales)
    if best < MISFIT:
        return scale * np.eye(3)
    if not counts and misfit(np.eye(3) / DEG) < MISFIT:
        raise InputError("lab.gyros_in_degrees")
    alternatives = [  # all exchanges and signs of the gyro axes
        (misfit(s * np.diag(signs)[list(order)]), order, signs)
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
        for s in scales
    ]
    smallest, order, signs = min(alternatives, key=lambda item: item[0])
    if smallest < 0.5 * best and smallest < MISFIT:
        columns = tuple(f"{'+' if signs[o] > 0 else '-'}{AXES[o]}" for o in order)
        raise InputError("lab.gyros_exchanged", axes=columns, angle_rad=smallest, before_rad=best)
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
        return residuals(rotations(turns, bias, start @ (np.eye(3) + e.reshape(3, 3))), up)[use].ravel()

    def slope(e: FloatArray) -> FloatArray:
        here = misfit(e)
        return np.column_stack([(misfit(e + step) - here) / _STEP for step in _STEP * np.eye(PARAMETERS)])

    solution = least_squares(misfit, np.zeros(PARAMETERS), jac=slope, method="lm", xtol=1e-10, ftol=1e-10)
    determined = normal(solution.jac)
    if not determined.condition < WORST_CONDITION:
        weak, condition = tuple(NAMES[i] for i in determined.weak), determined.condition
        raise InputError("lab.turns_undetermined", parameters=weak, condition=condition, limit=WORST_CONDITION)
    matrix = start @ (np.eye(3) + solution.x.reshape(3, 3))
    sd = float(np.sqrt(2.0 * solution.cost / (2 * count - PARAMETERS)))
    error = np.linalg.norm(residuals(rotations(turns, bias, matrix), up), axis=1)
    return TurnFit(matrix, determined.inverse * sd**2, np.asarray(solution.jac), error, sd, determined)


@dataclass(frozen=True, slots=True, kw_only=True)
class PosesCalibration(MultiPosition):
    """Result of a multi-pose calibration.

    The gyros refer to the accelerometer axes; their bias excludes g-sensitivity.
    """

    poses: tuple[Pose, ...]  # intervals at rest, in order of time
    factor: float  # limit of rest that was chosen, in standard deviations at rest
    norm_left_out: FloatArray  # (n,) as `norm_after`, each pose by a calibration without this pose [m/s^2]
    # (n - 1,) angle by which each turn misses the next pose [rad]: by the first guess, by a calibration without
    # g-sensitivity, and by the calibration
    turn_before: FloatArray
    turn_plain: FloatArray
    turn_after: FloatArray
    turn_left_out: FloatArray  # (n - 1,) as `turn_after`, with each turn by a calibration without this turn [rad]
    turn_used: BoolArray  # (n - 1,) false if samples are missing or out of range
    # (n,) leverage of each pose on the nine accelerometer parameters [-]
    accel_share: FloatArray
    # (n - 1,) leverage of each turn on the nine gyro parameters; zero if unused [-]
    gyro_share: FloatArray
    # (3,) change of gyro output at rest from the first to the last third of the record, without g-sensitivity [rad/s]
    gyro_drift: FloatArray


def calibrate_poses(imu: ImuData, g: float, *, counts: bool = False) -> PosesCalibration:
    """Calibrate accelerometers and gyros by poses and the turns between them.

    `imu`: record of at least ten poses, in SI units, or in any units if `counts`. `g`: local gravity
    [m/s^2]. `counts`: sensitivities are unknown, as for raw counts.
    Raises: InputError: too few poses, poses that leave a parameter undetermined, or impossible units, axes or signs.
    """
    if imu.sampling == "increment":
        raise InputError("lab.increments")
    activity = measure_activity(imu)
    factor, poses, fit, start = _best_poses(imu, activity, g, counts)
    force = np.array([pose.force for pose in poses])
    if fit.sd > WRONG_NORM * g:
        raise InputError("lab.force_varies", sd_m_s2=fit.sd)
    if not counts and np.abs(fit.triad.bias).max() > WRONG_UNIT * g:
        raise InputError("lab.force_offset", bias_m_s2=tuple(fit.triad.bias.tolist()))
    up = _directions(fit.triad, force)
    rest = _rest(poses, fit.triad)
    damaged = clipped(imu.gyro, activity.ratio > factor * factor)
    plain = prepare(imu, poses, damaged)
    guess = first_guess(plain, rest.mean, up, counts)
    coarse = fit_turns(plain, rest.mean, guess, up, plain.use)
    true_force = corrected(fit.triad, imu.accel)
    turns = prepare(replace(imu, gyro=imu.gyro - true_force @ rest.g_sensitivity.T), poses, damaged)
    fine = fit_turns(turns, rest.bias, coarse.matrix, up, turns.use)
    covariance = _whole_covariance(imu, poses, damaged, fine, fit, rest)
    # variances of `coarse (I + E)`, from the covariance of E by rows
    matrix_variance = np.einsum("ik,il,kjlj->ij", coarse.matrix, coarse.matrix, covariance.reshape(3, 3, 3, 3))
    matrix_sd = np.asarray(np.sqrt(matrix_variance))
    gyro = Triad(rest.bias, fine.matrix, np.sqrt(rest.covariance[:, 0, 0]), matrix_sd, fine.normal.condition)
    scale = np.diag(gyro.matrix)
    if not counts and np.abs(scale - 1.0).max() > WRONG_UNIT:
        raise InputError("lab.gyro_unit", scale=tuple(scale.tolist()))
    nominal = np.zeros(3) if not counts else rest.mean
    share = np.zeros(turns.use.shape[0])
    share[turns.use] = fine.normal.leverage.reshape(-1, 2).sum(axis=1)
    return PosesCalibration(
        poses=poses,
        factor=factor,
        accel=fit.triad,
        gyro=gyro,
        g_sensitivity=rest.g_sensitivity,
        g_sensitivity_sd=np.sqrt(np.array([np.diag(c)[1:] for c in rest.covariance])),
        g=g,
        norm_before=gravity.norm_error(start, force, g),
        norm_after=fit.error,
        norm_left_out=_left_out(
            fit.error,
            lambda keep: gravity.norm_error(gravity.fit_gravity_norm(force[keep], g, fit.triad).triad, force, g),
        ),
        turn_before=np.linalg.norm(residuals(rotations(plain, nominal, guess), _directions(start, force)), axis=1),
        turn_plain=coarse.error,
        turn_after=fine.error,
        turn_left_out=_left_out(
            fine.error, lambda keep: fit_turns(turns, rest.bias, fine.matrix, up, turns.use & keep).error
        ),
        turn_used=turns.use,
        accel_share=fit.normal.leverage,
        gyro_share=share,
        clipped=int(np.count_nonzero(damaged)),
        gyro_drift=np.asarray(np.linalg.solve(fine.matrix, rest.drift)),
        counts=counts,
    )


def _best_poses(
    imu: ImuData, activity: Activity, g: float, counts: bool
) -> tuple[float, tuple[Pose, ...], gravity.GravityFit, Triad]:
    """Choose the smallest limit of rest at which the accelerometers have nearly their least uncertainty."""
    candidates = [(factor, find_poses(imu, activity, factor)) for factor in FACTORS]
    most_poses = max(len(poses) for _, poses in candidates)
    fits: list[tuple[float, float, tuple[Pose, ...], gravity.GravityFit, Triad]] = []
    refusal: InputError | None = None
    for factor, poses in candidates:
        if 2 * len(poses) < most_poses or not poses:  # few poses may fit well by chance
            continue
        force = np.array([pose.force for pose in poses])
        if not counts:
            refuse_force_units(force, g)
        try:
            start = gravity.sphere(force, g) if counts else Triad()
            fit = gravity.fit_gravity_norm(force, g, start)
        except InputError as error:
            refusal = error
            continue
        fits.append((float(np.linalg.slogdet(fit.covariance)[1]), factor, poses, fit, start))
    if not fits:
        raise refusal or InputError("lab.never_calm")
    # a looser limit that is better by chance would include motion, which would then be missing in the turns
    least = min(item[0] for item in fits)
    _, factor, poses, fit, start = next(item for item in fits if item[0] < least + ALIKE)
    return factor, poses, fit, start


def refuse_force_units(force: FloatArray, g: float) -> None:
    """Refuse accelerometers whose magnitude at rest differs from gravity.

    `force` (n, 3): mean of each pose [m/s^2]. `g`: gravity [m/s^2].
    """
    length = float(np.median(np.linalg.norm(force, axis=1)))
    if abs(length / g - 1.0) > WRONG_UNIT:
        raise InputError("lab.force_unit", force_m_s2=length, gravity_m_s2=g)


def _directions(triad: Triad, force: FloatArray) -> FloatArray:
    f = corrected(triad, force)
    return np.asarray(f / np.linalg.norm(f, axis=1)[:, None])


@dataclass(frozen=True, slots=True)
class _Rest:
    """Gyro outputs at rest, in the unit of the record."""

    mean: FloatArray  # (3,)
    bias: FloatArray  # (3,)
    g_sensitivity: FloatArray  # (3, 3)
    covariance: FloatArray  # (3, 4, 4) for each gyro: covariance of its bias and g-sensitivity
    drift: FloatArray  # (3,) change from the first to the last third of the record


def _rest(poses: Sequence[Pose], accel: Triad) -> _Rest:
    """Split the output of the gyros at rest into bias and g-sensitivity.

    The linear fit over the poses is weighted by their lengths. Its scatter contains noise, bias instability and the
    Earth's rotation, and gives the uncertainty. The paper uses the bias of the initial pose only. All poses together
    are longer and average the Earth's rotation.
    """
    weight = np.array([pose.count for pose in poses], dtype=float)
    weight /= weight.mean()
    rate = np.array([pose.rate for pose in poses])
    design = np.column_stack((np.ones(len(poses)), corrected(accel, np.array([pose.force for pose in poses]))))
    inverse = np.linalg.inv(design.T @ (design * weight[:, None]))
    solution = inverse @ (design.T @ (rate * weight[:, None]))
    scatter = rate - design @ solution
    variance = np.sum(weight[:, None] * scatter**2, axis=0) / (len(poses) - 4)
    n_third = max(1, len(poses) // 3)
    drift = np.average(scatter[-n_third:], axis=0, weights=weight[-n_third:]) - np.average(
        scatter[:n_third], axis=0, weights=weight[:n_third]
    )
    return _Rest(
        np.average(rate, axis=0, weights=weight), solution[0], solution[1:].T, variance[:, None, None] * inverse, drift
    )


def _whole_covariance(
    imu: ImuData, poses: Sequence[Pose], damaged: BoolArray, fine: TurnFit, fit: gravity.GravityFit, rest: _Rest
) -> FloatArray:
    """Compute the covariance of the gyro matrix including accelerometer, bias and g-sensitivity errors, (9, 9).

    Each source of error is perturbed by one standard deviation. Its contribution to the residual scatter is subtracted,
    so that it counts only once.
    """
    force = np.array([pose.force for pose in poses])
    f_b = corrected(fit.triad, imu.accel)

    def misfit(accel: Triad, bias: FloatArray, sensitivity: FloatArray) -> FloatArray:
        turns = prepare(replace(imu, gyro=imu.gyro - f_b @ sensitivity.T), poses, damaged)
        return residuals(rotations(turns, bias, fine.matrix), _directions(accel, force))[turns.use].ravel()

    nominal = misfit(fit.triad, rest.bias, rest.g_sensitivity)
    perturbed = [
        misfit(gravity.unpacked(gravity.packed(fit.triad) + step), rest.bias, rest.g_sensitivity)
        for step in _steps(fit.covariance)
    ]
    for axis in range(3):
        for step in _steps(rest.covariance[axis]):
            bias, sensitivity = rest.bias.copy(), rest.g_sensitivity.copy()
            bias[axis] += step[0]
            sensitivity[axis] += step[1:]
            perturbed.append(misfit(fit.triad, bias, sensitivity))
    change = np.array(perturbed) - nominal
    effect = change @ fine.jacobian @ fine.normal.inverse
    left = change - effect @ fine.jacobian.T
    share = 1.0 - float(np.sum(left**2)) / (fine.sd**2 * (change.shape[1] - effect.shape[1])) if fine.sd > 0.0 else 1.0
    return np.asarray(max(share, LEAST_OWN) * fine.covariance + effect.T @ effect)


def _steps(covariance: FloatArray) -> FloatArray:
    """Return vectors, (k, k), whose outer products add up to a covariance; it may be singular, as without noise."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))).T)


def _left_out(error: FloatArray, without: Callable[[BoolArray], FloatArray]) -> FloatArray:
    """Compute errors by calibrations without the evaluated rows, a fifth of all rows at a time (cross-validation).

    With too few other rows, a row keeps its `error` (n,) by all data. `without`: from kept rows (n,) to errors (n,).
    """
    error = error.copy()
    for fold in range(FOLDS):
        keep = np.arange(error.size) % FOLDS != fold
        with suppress(InputError):
            error[~keep] = without(keep)[~keep]
    return error
