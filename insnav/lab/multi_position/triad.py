"""Calibration of three sensors by least squares: result with uncertainty, and missing poses."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from insnav.imu.higher_order import zero_matrix, zeros
from insnav.types import FloatArray

AXES = ("x", "y", "z")
WEAK = 0.35  # share of a parameter in the weakest direction from which it is reported


@dataclass(frozen=True, slots=True)
class Triad:
    """Bias and sensitivity of three sensors, ``measured = matrix @ true + bias``, and their standard deviations.

    By default sensors without errors, in SI units.
    """

    bias: FloatArray = field(default_factory=zeros)  # (3,) in the unit of the record
    # (3, 3) unit of the record per m/s^2 or rad/s; a standard deviation of zero where the value is a definition
    matrix: FloatArray = field(default_factory=partial(np.eye, 3))
    bias_sd: FloatArray = field(default_factory=zeros)
    matrix_sd: FloatArray = field(default_factory=zero_matrix)
    condition: float = 1.0  # condition number of the problem with its columns scaled to unit length


@dataclass(frozen=True, slots=True, kw_only=True)
class MultiPosition:
    """Common results of all calibrations without a table."""

    accel: Triad  # in the unit of the record per SI unit
    gyro: Triad
    # (3, 3) part of the gyros' output that goes with the specific force [unit of the record per m/s^2]
    g_sensitivity: FloatArray
    g_sensitivity_sd: FloatArray
    g: float  # gravity used [m/s^2]
    # (n,) magnitude of specific force minus gravity in each position [m/s^2], calibrated and before. Raw units: before
    # is with one bias and sensitivity for all axes
    norm_before: FloatArray
    norm_after: FloatArray
    clipped: int  # samples at the end of the range
    counts: bool  # the record is in raw units


def corrected(triad: Triad, measured: FloatArray) -> FloatArray:
    """True values of measured ones: ``inverse(matrix) @ (measured - bias)``.

    `measured` (n, 3): in the unit of the record. Returns (n, 3): in SI units.
    """
    return np.ascontiguousarray(np.linalg.solve(triad.matrix, (measured - triad.bias).T).T)


@dataclass(frozen=True, slots=True)
class Normal:
    """Analysis of the Jacobian of a least-squares problem."""

    # (p, p) inverse of the normal matrix; the covariance of the parameters for residuals of unit variance
    inverse: FloatArray
    leverage: FloatArray  # (m,) share of each residual in its own prediction; the sum is the number of parameters
    condition: float  # condition number with columns of unit length; infinite if singular
    weak: tuple[int, ...]  # parameters that make up the least determined combination
    direction: FloatArray  # (p,) that combination, in scaled parameters
    scale: FloatArray  # (p,) lengths of the columns


def normal(jacobian: FloatArray) -> Normal:
    """Analyse a least-squares problem by the singular values of its scaled Jacobian.

    `jacobian` (m, p): derivative of the residuals by the parameters.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    left, size, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    full = jacobian.shape[0] >= jacobian.shape[1]
    condition = float(size[0] / size[-1]) if full and size[-1] > 1e-12 * size[0] else np.inf
    share = np.abs(right[-1])
    weak = tuple(int(i) for i in np.argsort(-share) if share[i] > WEAK)
    safe = np.maximum(size, 1e-12 * size[0])
    inverse = (right.T / safe**2) @ right / np.outer(scale, scale)
    return Normal(inverse, np.sum(left**2, axis=1), condition, weak, right[-1], scale)


def directions() -> FloatArray:
    """26 directions evenly over the sphere: axes, halfway between two, halfway between three, (26, 3)."""
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
