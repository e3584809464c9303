"""Growth curve of an error: t for a wrong velocity, t^2 for a tilt or a bias, t^3 for a drift.

Over a minute or two, a nearly level vehicle without turns has the horizontal error
``p0 + v t + a t^2 / 2 + j t^3 / 6``. Here `v` is the velocity error at the start. ``a = g phi`` is a tilt or the bias
of a level accelerometer. ``j = g w`` is the drift of a level gyro (Titterton and Weston, "Strapdown Inertial Navigation
Technology", 2nd ed., 2004, chapter 12). The velocity error is its derivative.

The fit is weighted: sensor white noise, integrated two and three times, correlates neighbouring errors. Without the
weights, the coefficients would seem far too certain.

`explain_end` finds the fewest terms that explain both errors at the end of a run.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.exceptions import InputError
from insnav.sample_statistics import chi_square
from insnav.types import FloatArray

TERMS = ("t", "t²", "t³")
FITS = 0.95  # a curve fits if its misfit is below this quantile of true curves
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # exact for the polynomials of the kernels


@dataclass(frozen=True, slots=True)
class Curve:
    """Growth curve of the error of one axis."""

    # (3,) velocity [m/s], acceleration [m/s^2], jerk [m/s^3], fitted jointly; with fewer than three values only the
    # fewest terms, the others zero
    value: FloatArray
    covariance: FloatArray  # (3, 3) from noise and reference; infinite where not observable
    terms: tuple[str, ...]  # the fewest of `TERMS` that fit
    # squared residual of all three terms over its expectation [-]: about 1 for such a curve and correct noise; ``NaN``
    # without degrees of freedom
    roughness: float

    @property
    def sd(self) -> FloatArray:
        """(3,) standard deviation of `value`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_curve(elapsed: FloatArray, position: FloatArray, velocity: FloatArray, covariance: FloatArray) -> Curve:
    """Fit position and velocity errors of one axis by generalised least squares.

    `elapsed` (k,): time since the start [s]. `position` (k,): error [m]. `velocity` (k,): error [m/s]; ``NaN`` if
    unknown. `covariance` (2 k, 2 k): of all positions, then all velocities, about the curve; see `about_the_curve`.
    """
    observed = np.concatenate([position, velocity])
    known = np.isfinite(observed)
    design = np.vstack([position_terms(elapsed), velocity_terms(elapsed)])[known]
    observed = observed[known]
    factor = cho_factor(covariance[np.ix_(known, known)], lower=True)
    m = len(observed)
    for size in (1, 2, 3):
        tries = [(*_solve(design[:, list(part)], observed, factor), part) for part in combinations(range(3), size)]
        estimate, _, misfit, part = min(tries, key=lambda each: each[2])
        if size >= m or misfit <= chi_square(m - size, FITS):
            break
    value, spread, roughness = np.zeros(3), np.full((3, 3), np.inf), np.nan
    value[list(part)] = estimate
    if m >= 3:
        value, spread, left = _solve(design, observed, factor)
        roughness = left / (m - 3) if m > 3 else np.nan
    return Curve(value, spread, tuple(TERMS[i] for i in part), roughness)


def position_terms(elapsed: FloatArray) -> FloatArray:
    """Compute position derivatives by velocity, acceleration and jerk, (k, 3)."""
    return np.column_stack([elapsed, elapsed**2 / 2.0, elapsed**3 / 6.0])


def velocity_terms(elapsed: FloatArray) -> FloatArray:
    """Compute velocity derivatives by velocity, acceleration and jerk, (k, 3)."""
    return np.column_stack([np.ones_like(elapsed), elapsed, elapsed**2 / 2.0])


def about_the_curve(
    elapsed: FloatArray,
    reference_variance: FloatArray,
    start_variance: float,
    accel_noise: float,
    gyro_noise: float,
    gravity: float,
) -> FloatArray:
    """Compute the covariance of positions and velocities about their curve.

    `elapsed` (k,): time since the start [s]. `reference_variance` (2 k,): of the reference positions, then velocities;
    ignored if unknown [m^2], [m^2/s^2]. `start_variance`: of the position at the start, common to all positions [m^2].
    `accel_noise`, `gyro_noise`: spectral densities of the white noise [m^2/s^3], [rad^2/s]. `gravity` [m/s^2].
    Returns: (2 k, 2 k).

    Notes
    -----
    Acceleration noise at s contributes ``t - s`` times itself to position at t, and itself to velocity. A rotation at s
    contributes ``g (t - s)^2 / 2`` and ``g (t - s)``. Integrals over s of products of these are the covariances
    (Maybeck, "Stochastic Models, Estimation, and Control", vol. 1, 1979, section 4.9).
    """
    common = np.minimum(elapsed[:, None], elapsed)
    s = common[..., None] * 0.5 * (1.0 + _NODES)
    weight = common[..., None] * 0.5 * _WEIGHTS
    since_i, since_j = elapsed[:, None, None] - s, elapsed[None, :, None] - s
    total = np.zeros((2 * len(elapsed), 2 * len(elapsed)))
    k = len(elapsed)
    for density, order, size in ((accel_noise, 1, 1.0), (gyro_noise, 2, 0.5 * gravity)):
        p_i, p_j = size * since_i**order, size * since_j**order
        v_i, v_j = order * size * since_i ** (order - 1), order * size * since_j ** (order - 1)
        total[:k, :k] += density * (p_i * p_j * weight).sum(axis=-1)
        mixed = density * (p_i * v_j * weight).sum(axis=-1)
        total[:k, k:] += mixed
        total[k:, :k] += mixed.T
        total[k:, k:] += density * (v_i * v_j * weight).sum(axis=-1)
    total[:k, :k] += start_variance
    return np.asarray(total + np.diag(np.where(np.isfinite(reference_variance), reference_variance, 1.0)))


def _solve(
    design: FloatArray, observed: FloatArray, factor: tuple[FloatArray, bool]
) -> tuple[FloatArray, FloatArray, float]:
    """Solve for the estimate, its covariance, and the weighted sum of squared residuals."""
    weighted = cho_solve(factor, design)
    # terms of very different size: scaled to one for a well-conditioned normal matrix
    scale = np.linalg.norm(design, axis=0)
    normal = (weighted / scale).T @ (design / scale)
    inverse = np.linalg.pinv(normal, hermitian=True)
    estimate = inverse @ ((weighted / scale).T @ observed) / scale
    left = observed - design @ estimate
    return estimate, inverse / np.outer(scale, scale), float(left @ cho_solve(factor, left))


AXES = ("north", "east")
SHORTEST = 5.0  # without fixes; before, the error of the last fix dominates [s]


@dataclass(frozen=True, slots=True)
class EndAxis:
    """Errors of one horizontal axis at the end of a run."""

    axis: str  # ``north`` or ``east``
    position: float  # error [m]
    velocity: float  # error [m/s]
    power: float  # exponent of time of both errors, ``v t / p``; NaN without a position error
    # (3,) initial velocity [m/s], acceleration [m/s^2], jerk [m/s^3], each as the only cause; and their sd
    alone: FloatArray
    sd: FloatArray
    left: FloatArray  # (3,) unexplained remainder of each cause, in standard deviations of the reference
    terms: tuple[str, ...]  # the fewest of t, t², t³ that explain both errors; if two, any two do

    @property
    def fits(self) -> tuple[bool, ...]:
        """True for each cause that alone explains the errors, at 95 %."""
        return tuple(bool(each**2 <= chi_square(1, FITS)) for each in self.left)


def explain_end(
    time: float, position: FloatArray, velocity: FloatArray, position_sd: float, velocity_sd: float
) -> tuple[EndAxis, ...]:
    """Explain the errors at the end of a run that began without error.

    `time`: length of the run [s]. `position`, `velocity` (2,): errors North, East [m], [m/s]. `position_sd`,
    `velocity_sd`: standard deviations of the reference [m], [m/s].
    """
    at = np.array([time])
    sd = np.array([position_sd, velocity_sd])
    design = np.vstack([position_terms(at), velocity_terms(at)]) / sd[:, None]
    found = []
    for axis, p, v in zip(AXES, position, velocity, strict=True):
        observed = np.array([p, v]) / sd
        size = np.sum(design**2, axis=0)
        alone = design.T @ observed / size
        left = np.linalg.norm(observed[:, None] - design * alone, axis=0)
        curve = fit_curve(at, np.array([p]), np.array([v]), np.diag(sd**2))
        power = float(v * time / p) if p != 0.0 else float("nan")
        found.append(EndAxis(axis, float(p), float(v), power, alone, 1.0 / np.sqrt(size), left, curve.terms))
    return tuple(found)


def end_of_run(found: EvaluatedRun) -> tuple[float, FloatArray, FloatArray]:
    """Return the time since the last fix [s], the growth of the position error, and the velocity error, (2,) N, E.

    Raises: InputError: a run without reference of position and velocity, or with fixes up to its end.
    """
    errors, fixes = found.errors, found.run.innovations
    if errors is None or not np.isfinite(errors.velocity[-1, :2]).all():
        raise InputError("diagnosis.no_end_error")
    used = fixes.time[fixes.used_position]
    begin = float(used[-1]) if used.size else float(errors.time[0])
    first = int(np.searchsorted(errors.time, begin - 1e-6))
    time = float(errors.time[-1]) - begin
    if time < SHORTEST:
        raise InputError("diagnosis.ends_with_fixes", before_s=max(time, 0.0))
    return time, errors.position[-1, :2] - errors.position[first, :2], errors.velocity[-1, :2]
