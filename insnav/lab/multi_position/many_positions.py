"""Multi-position calibration without a table: a sensor in many poses, with turns between them.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014. In addition, the poses give the g-sensitivity of the gyros, which is removed before the
integration of the turns. In a MEMS gyro it is the largest remaining error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from insnav.exceptions import InputError
from insnav.lab.calibration import WRONG_UNIT
from insnav.lab.multi_position import gyro_rotations
from insnav.lab.multi_position import triad as gravity
from insnav.lab.multi_position.gyro_rotations import Activity, Pose, clipped, find_poses, measure_activity
from insnav.lab.multi_position.triad import MultiPosition, Triad, corrected
from insnav.types import BoolArray, FloatArray, ImuData

FACTORS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # candidate limits of rest, in standard deviations at rest
ALIKE = 1.0  # log determinant difference of nearly equal covariances: 6 % per standard deviation
LEAST_OWN = 0.1  # least share of the turns' scatter that is their own
FOLDS = 5
WRONG_NORM = 0.02  # relative scatter of gravity beyond any set of poses at rest


@dataclass(frozen=True, slots=True, kw_only=True)
class PosesCalibration(MultiPosition):
    """Result of a multi-pose calibration.

    The gyros refer to the accelerometer axes; their bias excludes g-sensitivity.
    """

    poses: tuple[Pose, ...]  # stretches at rest, in order of time
    factor: float  # limit of rest that was chosen, in standard deviations at rest
    norm_left_out: FloatArray  # (n,) as `norm_after`, each pose by a calibration without it [m/s^2]
    # (n - 1,) angle by which each turn misses the next pose [rad]: with the first guess, calibrated without the
    # g-sensitivity, and calibrated
    turn_before: FloatArray
    turn_plain: FloatArray
    turn_after: FloatArray
    turn_left_out: FloatArray  # (n - 1,) calibrated, each turn by a calibration without it [rad]
    turn_used: BoolArray  # (n - 1,) false if samples are missing or out of range
    # (n,) leverage of each pose on the nine accelerometer parameters [-]
    accel_share: FloatArray
    # (n - 1,) leverage of each turn on the nine gyro parameters; zero if unused [-]
    gyro_share: FloatArray
    # (3,) change of the gyro outputs at rest from the first to the last third of the record, without g-sensitivity
    # [rad/s]
    gyro_drift: FloatArray


def calibrate_poses(imu: ImuData, g: float, *, counts: bool = False) -> PosesCalibration:
    """Calibrate accelerometers and gyros by poses and the turns between them.

    `imu`: record of at least ten poses, in SI units, or in any units if `counts`. `g`: gravity where it was made
    [m/s^2]. `counts`: sensitivities are not known, not even roughly.
    Raises: InputError: no poses, too few, or such as leave a parameter undetermined; units, axes or signs that cannot
    be.
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
    plain = gyro_rotations.prepare(imu, poses, damaged)
    guess = gyro_rotations.first_guess(plain, rest.mean, up, counts)
    coarse = gyro_rotations.fit_turns(plain, rest.mean, guess, up, plain.use)
    felt = corrected(fit.triad, imu.accel)
    turns = gyro_rotations.prepare(replace(imu, gyro=imu.gyro - felt @ rest.g_sensitivity.T), poses, damaged)
    fine = gyro_rotations.fit_turns(turns, rest.bias, coarse.matrix, up, turns.use)
    covariance = _whole_covariance(imu, poses, damaged, fine, fit, rest)
    # of `coarse (I + E)`, from the covariance of E by rows
    square = np.einsum("ik,il,kjlj->ij", coarse.matrix, coarse.matrix, covariance.reshape(3, 3, 3, 3))
    matrix_sd = np.asarray(np.sqrt(square))
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
        turn_before=np.linalg.norm(
            gyro_rotations.residuals(gyro_rotations.rotations(plain, nominal, guess), _directions(start, force)), axis=1
        ),
        turn_plain=coarse.error,
        turn_after=fine.error,
        turn_left_out=_left_out(
            fine.error, lambda keep: gyro_rotations.fit_turns(turns, rest.bias, fine.matrix, up, turns.use & keep).error
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
    """Find the smallest limit of rest with nearly the least uncertain accelerometers."""
    found = [(factor, find_poses(imu, activity, factor)) for factor in FACTORS]
    most = max(len(poses) for _, poses in found)
    tried: list[tuple[float, float, tuple[Pose, ...], gravity.GravityFit, Triad]] = []
    refused: InputError | None = None
    for factor, poses in found:
        if 2 * len(poses) < most or not poses:  # a few poses fit well by chance
            continue
        force = np.array([pose.force for pose in poses])
        if not counts:
            refuse_force_units(force, g)
        try:
            start = gravity.sphere(force, g) if counts else Triad()
            fit = gravity.fit_gravity_norm(force, g, start)
        except InputError as error:
            refused = error
            continue
        tried.append((float(np.linalg.slogdet(fit.covariance)[1]), factor, poses, fit, start))
    if not tried:
        raise refused or InputError("lab.never_calm")
    # a looser limit that is better by chance includes motion, which the turns then lack
    least = min(item[0] for item in tried)
    _, factor, poses, fit, start = next(item for item in tried if item[0] < least + ALIKE)
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
    """Gyro outputs at rest: mean, bias and g-sensitivity with covariance per axis, (3, 4, 4), and drift."""

    mean: FloatArray
    bias: FloatArray
    g_sensitivity: FloatArray
    covariance: FloatArray
    drift: FloatArray


def _rest(poses: Sequence[Pose], accel: Triad) -> _Rest:
    """Split the output of the gyros at rest into bias and g-sensitivity.

    A straight line over the poses is weighted by their lengths. The scatter about it contains noise, bias instability
    and the Earth's rotation, and gives the uncertainty. The paper uses the bias of the initial rest only. All rests
    together are longer and average the Earth's rotation.
    """
    weight = np.array([pose.count for pose in poses], dtype=float)
    weight /= weight.mean()
    rate = np.array([pose.rate for pose in poses])
    design = np.column_stack((np.ones(len(poses)), corrected(accel, np.array([pose.force for pose in poses]))))
    inverse = np.linalg.inv(design.T @ (design * weight[:, None]))
    solution = inverse @ (design.T @ (rate * weight[:, None]))
    scatter = rate - design @ solution
    variance = np.sum(weight[:, None] * scatter**2, axis=0) / (len(poses) - 4)
    third = max(1, len(poses) // 3)
    drift = np.average(scatter[-third:], axis=0, weights=weight[-third:]) - np.average(
        scatter[:third], axis=0, weights=weight[:third]
    )
    return _Rest(
        np.average(rate, axis=0, weights=weight), solution[0], solution[1:].T, variance[:, None, None] * inverse, drift
    )


def _whole_covariance(
    imu: ImuData,
    poses: Sequence[Pose],
    damaged: BoolArray,
    fine: gyro_rotations.TurnFit,
    fit: gravity.GravityFit,
    rest: _Rest,
) -> FloatArray:
    """Compute the covariance of the gyro matrix including accelerometer, bias and g-sensitivity errors, (9, 9).

    Each of these is perturbed along its covariance by one standard deviation. Their contribution to the residual
    scatter is subtracted, to count once.
    """
    force = np.array([pose.force for pose in poses])
    felt = corrected(fit.triad, imu.accel)

    def misfit(accel: Triad, bias: FloatArray, sensitivity: FloatArray) -> FloatArray:
        turns = gyro_rotations.prepare(replace(imu, gyro=imu.gyro - felt @ sensitivity.T), poses, damaged)
        miss = gyro_rotations.residuals(gyro_rotations.rotations(turns, bias, fine.matrix), _directions(accel, force))
        return miss[turns.use].ravel()

    here = misfit(fit.triad, rest.bias, rest.g_sensitivity)
    moved = [
        misfit(gravity.unpacked(gravity.packed(fit.triad) + step), rest.bias, rest.g_sensitivity)
        for step in _steps(fit.covariance)
    ]
    for axis in range(3):
        for step in _steps(rest.covariance[axis]):
            bias, sensitivity = rest.bias.copy(), rest.g_sensitivity.copy()
            bias[axis] += step[0]
            sensitivity[axis] += step[1:]
            moved.append(misfit(fit.triad, bias, sensitivity))
    change = np.array(moved) - here
    effect = change @ fine.jacobian @ fine.normal.inverse
    seen = change - effect @ fine.jacobian.T
    own = 1.0 - float(np.sum(seen**2)) / (fine.sd**2 * (change.shape[1] - effect.shape[1])) if fine.sd > 0.0 else 1.0
    return np.asarray(max(own, LEAST_OWN) * fine.covariance + effect.T @ effect)


def _steps(covariance: FloatArray) -> FloatArray:
    """Vectors, (k, k), whose outer products add up to a covariance; also to one without noise, which is singular."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))).T)


def _left_out(error: FloatArray, without: Callable[[BoolArray], FloatArray]) -> FloatArray:
    """Compute errors by calibrations without these data, a fifth at a time; by all data if the rest is too small.

    `error` (n,): by the calibration of all. `without`: function from kept rows (n,) to errors (n,).
    """
    error = error.copy()
    for fold in range(FOLDS):
        keep = np.arange(error.size) % FOLDS != fold
        with suppress(InputError):
            error[~keep] = without(keep)[~keep]
    return error
