"""Least-squares analysis of a sensor triad, and calibration of accelerometers by the magnitude of gravity in all poses.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, section on accelerometers: nine parameters from the squared difference of corrected specific
force and gravity over all poses. This module minimises the difference of magnitudes, not of squares, and parametrises
the sensitivity, not its inverse. Both have the same solution.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from insnav.exceptions import InputError
from insnav.imu.specification import zero_matrix, zeros
from insnav.types import FloatArray

AXES = ("x", "y", "z")
WEAK = 0.35  # parameters with a larger weight in the least determined combination are reported
PARAMETERS = 9  # biases and lower triangular sensitivity of three accelerometers
_ROW, _COLUMN = np.tril_indices(3)
NAMES = tuple(f"bias {a}" for a in AXES) + tuple(
    f"scale {AXES[i]}" if i == j else f"misalignment {AXES[i]}{AXES[j]}" for i, j in zip(_ROW, _COLUMN, strict=True)
)
WORST_CONDITION = 150.0  # beyond it, moving a pose by a degree changes the result by as much as sensor errors


@dataclass(frozen=True, slots=True)
class Triad:
    """Bias and sensitivity of three sensors, ``measured = matrix @ true + bias``, and their standard deviations.

    The default is sensors without errors, in SI units.
    """

    bias: FloatArray = field(default_factory=zeros)  # (3,) bias in the unit of the record
    # (3, 3) unit of the record per m/s^2 or rad/s
    matrix: FloatArray = field(default_factory=partial(np.eye, 3))
    bias_sd: FloatArray = field(default_factory=zeros)
    matrix_sd: FloatArray = field(default_factory=zero_matrix)  # zero for elements fixed by definition
    condition: float = 1.0  # condition number of the least-squares problem, columns scaled to unit length


@dataclass(frozen=True, slots=True, kw_only=True)
class MultiPosition:
    """Results that all calibrations without a table have."""

    accel: Triad  # both triads: unit of the record per SI unit
    gyro: Triad
    # (3, 3) change of gyro output per specific force [unit of the record per m/s^2]
    g_sensitivity: FloatArray
    g_sensitivity_sd: FloatArray
    g: float  # gravity used [m/s^2]
    # (n,) magnitude of specific force minus gravity in each position [m/s^2], before and after calibration. Raw units
    # are first converted with one sensitivity for all axes
    norm_before: FloatArray
    norm_after: FloatArray
    clipped: int  # number of samples at the end of the range
    counts: bool  # the record is in raw units


def corrected(triad: Triad, measured: FloatArray) -> FloatArray:
    """Correct measured values: ``inverse(matrix) @ (measured - bias)``.

    `measured` (n, 3): in the unit of the record. Returns (n, 3): in SI units.
    """
    return np.ascontiguousarray(np.linalg.solve(triad.matrix, (measured - triad.bias).T).T)


@dataclass(frozen=True, slots=True)
class Normal:
    """Covariance, leverage, condition number and weakest parameters of a least-squares problem, from its Jacobian."""

    # (p, p) inverse of the normal matrix; the covariance of the parameters for residuals of unit variance
    inverse: FloatArray
    leverage: FloatArray  # (m,) share of each residual in its own prediction; the sum is the number of parameters
    condition: float  # condition number with columns of unit length; infinite if singular
    weak: tuple[int, ...]  # parameters with large weight in the least determined combination
    direction: FloatArray  # (p,) weights of all parameters in this combination, in scaled parameters
    scale: FloatArray  # (p,) lengths of the columns of the Jacobian


def normal(jacobian: FloatArray) -> Normal:
    """Analyse a least-squares problem by the singular values of its scaled Jacobian.

    `jacobian` (m, p): derivative of the residuals by the parameters.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    left, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    enough_rows = jacobian.shape[0] >= jacobian.shape[1]
    condition = float(singular[0] / singular[-1]) if enough_rows and singular[-1] > 1e-12 * singular[0] else np.inf
    share = np.abs(right[-1])
    weak = tuple(int(i) for i in np.argsort(-share) if share[i] > WEAK)
    inverse = (right.T / np.maximum(singular, 1e-12 * singular[0]) ** 2) @ right / np.outer(scale, scale)
    return Normal(inverse, np.sum(left**2, axis=1), condition, weak, right[-1], scale)


def directions() -> FloatArray:
    """Return 26 directions over the sphere, (26, 3): axes, midway between two axes, midway between three axes."""
    points = np.array([point for point in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(point)])
    return np.asarray(points / np.linalg.norm(points, axis=1)[:, None])


def pose_words(direction: FloatArray) -> tuple[str, ...]:
    """Name the axes that point up or down in the pose in which the specific force points along a direction.

    `direction` (3,): one of `directions`.

    Examples
    --------
    >>> pose_words(np.array([0.0, 0.7, -0.7]))
    ('y up', 'z down')
    """
    return tuple(f"{a} {'up' if d > 0 else 'down'}" for a, d in zip(AXES, direction, strict=True) if abs(d) > 1e-6)


@dataclass(frozen=True, slots=True)
class GravityFit:
    """Calibrated accelerometers with their gravity errors."""

    # lower triangular sensitivity: body x is the sensitive axis of accelerometer x, body y is in the plane of
    # the sensitive axes x and y
    triad: Triad
    covariance: FloatArray  # (9, 9) covariance of bias x, y, z and the lower triangle of the matrix by rows
    error: FloatArray  # (n,) length of the corrected specific force minus gravity in each pose [m/s^2]
    sd: float  # standard deviation of `error`, from its scatter [m/s^2]
    normal: Normal  # shows how well the poses determine the parameters


def sphere(force: FloatArray, g: float) -> Triad:
    """Estimate biases and one sensitivity for all axes, by linear least squares: a sphere through the poses.

    Output c: ``|c|^2 = 2 b.c + (k^2 g^2 - |b|^2)``, linear in the bias b and in the term with the sensitivity k.

    `force` (n, 3): mean of each pose in the unit of the record. `g`: gravity [m/s^2]. Raises: InputError: the poses do
    not lie around a sphere.
    """
    middle = force.mean(axis=0)
    half_range = float(np.abs(force - middle).max()) or 1.0  # unscaled counts around 32768 would lose half the digits
    x = (force - middle) / half_range
    solution, _, rank, singular = np.linalg.lstsq(
        np.column_stack((2.0 * x, np.ones(len(x)))), np.sum(x * x, axis=1), rcond=None
    )
    square = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or singular[-1] < 1e-3 * singular[0] or square <= 0.0:
        raise InputError("lab.poses_in_plane")
    scale = half_range * float(np.sqrt(square)) / g
    return Triad(middle + half_range * solution[:3], scale * np.eye(3))


def packed(triad: Triad) -> FloatArray:
    """Return the nine parameters of accelerometers: bias, and lower triangle of the matrix by rows."""
    return np.concatenate((triad.bias, triad.matrix[_ROW, _COLUMN]))


def _matrix(parameters: FloatArray) -> FloatArray:
    matrix = np.zeros((3, 3))
    matrix[_ROW, _COLUMN] = parameters[3:]
    return matrix


def unpacked(parameters: FloatArray) -> Triad:
    """Convert nine parameters to a triad without standard deviations: the inverse of `packed`."""
    return Triad(parameters[:3], _matrix(parameters))


def norm_error(triad: Triad, force: FloatArray, g: float) -> FloatArray:
    """Compute the magnitude of the corrected specific force minus gravity, (n,) [m/s^2]."""
    return np.asarray(np.linalg.norm(corrected(triad, force), axis=1) - g)


def norm_jacobian(parameters: FloatArray, force: FloatArray) -> FloatArray:
    """Compute the derivative of `norm_error` by the nine parameters, (n, 9).

    With ``c = M f + b`` and u along f: ``d|f| = u . df``, ``df = -inv(M) (dM f + db)``.
    """
    matrix = _matrix(parameters)
    f = np.linalg.solve(matrix, (force - parameters[:3]).T).T
    v = np.linalg.solve(matrix.T, (f / np.linalg.norm(f, axis=1)[:, None]).T).T
    return np.column_stack((-v, -v[:, _ROW] * f[:, _COLUMN]))


def fit_gravity_norm(force: FloatArray, g: float, start: Triad) -> GravityFit:
    """Calibrate accelerometers by the known magnitude of gravity.

    `force` (n, 3): mean of each pose in the unit of the record. `g`: gravity [m/s^2]. `start`: first guess: `Triad()`
    for SI, `sphere` for counts. Raises: InputError: too few poses, or poses that leave a parameter undetermined.
    """
    n = force.shape[0]
    if n <= PARAMETERS:
        raise InputError("lab.few_poses", count=n, parameters=PARAMETERS)
    initial = normal(norm_jacobian(packed(start), force))
    _refuse_singular(initial, g)
    # scaled by the lengths of the columns, since biases in counts are 1e4 and misalignments 1e-4
    solution = least_squares(
        lambda p: norm_error(unpacked(p), force, g),
        packed(start),
        jac=lambda p: norm_jacobian(p, force),
        method="lm",
        x_scale=1.0 / initial.scale,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    determined = normal(norm_jacobian(solution.x, force))
    _refuse_singular(determined, g)
    error = norm_error(unpacked(solution.x), force, g)
    sd = float(np.sqrt(error @ error / (n - PARAMETERS)))
    covariance = determined.inverse * sd**2
    deviation = np.sqrt(np.diag(covariance))
    fitted = unpacked(solution.x)
    triad = Triad(fitted.bias, fitted.matrix, deviation[:3], _matrix(deviation), determined.condition)
    return GravityFit(triad, covariance, error, sd, determined)


def _refuse_singular(determined: Normal, g: float) -> None:
    if determined.condition < WORST_CONDITION:
        return
    weak, condition, pose = tuple(NAMES[i] for i in determined.weak), determined.condition, missing_pose(determined, g)
    raise InputError("lab.poses_undetermined", parameters=weak, condition=condition, limit=WORST_CONDITION, pose=pose)


def missing_pose(determined: Normal, g: float) -> tuple[str, ...]:
    """Name the additional pose that best determines the least determined combination of parameters.

    `determined`: analysis of the present poses. `g`: gravity [m/s^2].
    """
    candidates = directions()
    # perfect sensors are assumed, since errors of a few percent do not change the result
    rows = norm_jacobian(packed(Triad()), g * candidates)
    rows /= np.linalg.norm(rows, axis=0)
    return pose_words(candidates[int(np.argmax(np.abs(rows @ determined.direction)))])
