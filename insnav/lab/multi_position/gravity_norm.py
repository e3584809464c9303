"""Accelerometer calibration by the magnitude of gravity, equal in every pose.

References
----------
D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, section on accelerometers: nine parameters from the squared difference of corrected specific
force and gravity over all poses. This module minimises the difference of magnitudes, not of squares, and parametrises
the sensitivity, not its inverse. Both have the same solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from insnav.exceptions import InputError
from insnav.lab.multi_position.triad import AXES, Normal, Triad, corrected, directions, normal, pose_words
from insnav.types import FloatArray

PARAMETERS = 9
_ROW, _COLUMN = np.tril_indices(3)
NAMES = tuple(f"bias {a}" for a in AXES) + tuple(
    f"scale {AXES[i]}" if i == j else f"misalignment {AXES[i]}{AXES[j]}" for i, j in zip(_ROW, _COLUMN, strict=True)
)
WORST_CONDITION = 150.0  # beyond it, moving a pose by a degree changes the result by as much as the errors sought


@dataclass(frozen=True, slots=True)
class GravityFit:
    """Calibrated accelerometers with their gravity errors."""

    # lower triangular sensitivity: body x is the sensitive axis of accelerometer x, body y is in the plane of both
    # sensitive axes
    triad: Triad
    covariance: FloatArray  # (9, 9) of bias x, y, z and the lower triangle of the matrix by rows
    error: FloatArray  # (n,) length of the corrected specific force minus gravity in each pose [m/s^2]
    sd: float  # standard deviation of one such error, from their scatter [m/s^2]
    normal: Normal  # analysis of the determination by the poses


def sphere(force: FloatArray, g: float) -> Triad:
    """Bias and one sensitivity for all axes: the sphere through the poses by linear least squares.

    ``|c|^2 = 2 b.c + (k^2 g^2 - |b|^2)``, linear in the bias b and the term in brackets.

    `force` (n, 3): mean of each pose in the unit of the record. `g`: gravity [m/s^2]. Raises: InputError: the poses do
    not lie around a sphere.
    """
    middle = force.mean(axis=0)
    size = float(np.abs(force - middle).max()) or 1.0  # counts around 32768 would cost half the digits
    x = (force - middle) / size
    solution, _, rank, singular = np.linalg.lstsq(
        np.column_stack((2.0 * x, np.ones(len(x)))), np.sum(x * x, axis=1), rcond=None
    )
    square = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or singular[-1] < 1e-3 * singular[0] or square <= 0.0:
        raise InputError("lab.poses_in_plane")
    scale = size * float(np.sqrt(square)) / g
    return Triad(middle + size * solution[:3], scale * np.eye(3))


def packed(triad: Triad) -> FloatArray:
    """Nine parameters of accelerometers: bias, lower triangle by rows."""
    return np.concatenate((triad.bias, triad.matrix[_ROW, _COLUMN]))


def _matrix(parameters: FloatArray) -> FloatArray:
    matrix = np.zeros((3, 3))
    matrix[_ROW, _COLUMN] = parameters[3:]
    return matrix


def unpacked(parameters: FloatArray) -> Triad:
    """Inverse of `packed`, without standard deviations."""
    return Triad(parameters[:3], _matrix(parameters))


def norm_error(triad: Triad, force: FloatArray, g: float) -> FloatArray:
    """Length of the corrected specific force minus gravity, (n,) [m/s^2]."""
    return np.asarray(np.linalg.norm(corrected(triad, force), axis=1) - g)


def norm_jacobian(parameters: FloatArray, force: FloatArray) -> FloatArray:
    """Derivative of `norm_error` by the nine parameters, (n, 9).

    With ``c = M f + b`` and u along f: ``d|f| = u . df``, ``df = -inv(M) (dM f + db)``.
    """
    matrix = _matrix(parameters)
    f = np.linalg.solve(matrix, (force - parameters[:3]).T).T
    u = f / np.linalg.norm(f, axis=1)[:, None]
    v = np.linalg.solve(matrix.T, u.T).T
    return np.column_stack((-v, -v[:, _ROW] * f[:, _COLUMN]))


def fit_gravity_norm(force: FloatArray, g: float, start: Triad) -> GravityFit:
    """Calibrate accelerometers by the length of gravity.

    `force` (n, 3): mean of each pose in the unit of the record. `g`: gravity [m/s^2]. `start`: first guess: `Triad()`
    for SI, `sphere` for counts. Raises: InputError: too few poses, or poses that leave a parameter undetermined.
    """
    n = force.shape[0]
    if n <= PARAMETERS:
        raise InputError("lab.few_poses", count=n, parameters=PARAMETERS)
    before = normal(norm_jacobian(packed(start), force))
    _refuse_singular(before, g)
    # lengths of the columns as the unit of each parameter: biases in counts are 1e4, misalignments 1e-4
    done = least_squares(
        lambda p: norm_error(unpacked(p), force, g),
        packed(start),
        jac=lambda p: norm_jacobian(p, force),
        method="lm",
        x_scale=1.0 / before.scale,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    determined = normal(norm_jacobian(done.x, force))
    _refuse_singular(determined, g)
    error = norm_error(unpacked(done.x), force, g)
    sd = float(np.sqrt(error @ error / (n - PARAMETERS)))
    covariance = determined.inverse * sd**2
    deviation = np.sqrt(np.diag(covariance))
    found = unpacked(done.x)
    triad = Triad(found.bias, found.matrix, deviation[:3], _matrix(deviation), determined.condition)
    return GravityFit(triad, covariance, error, sd, determined)


def _refuse_singular(determined: Normal, g: float) -> None:
    if determined.condition < WORST_CONDITION:
        return
    raise InputError(
        "lab.poses_undetermined",
        parameters=tuple(NAMES[i] for i in determined.weak),
        condition=determined.condition,
        limit=WORST_CONDITION,
        pose=missing_pose(determined, g),
    )


def missing_pose(determined: Normal, g: float) -> tuple[str, ...]:
    """Name the pose that would show most of the least determined combination of parameters.

    `determined`: by the poses so far. `g`: gravity [m/s^2].
    """
    candidates = directions()
    # as if the sensors were perfect: a few percent do not change which pose is missing
    rows = norm_jacobian(packed(Triad()), g * candidates)
    rows /= np.linalg.norm(rows, axis=0)
    gain = np.abs(rows @ determined.direction)
    return pose_words(candidates[int(np.argmax(gain))])
