"""Causes of window errors by their growth: t for a wrong velocity, t^2 for a tilt or a bias, t^3 for a drift.

Over a minute or two, a nearly level vehicle without turns has the horizontal error
``p0 + v t + a t^2 / 2 + j t^3 / 6``. Here `v` is the velocity error at the start. ``a = g phi`` is a tilt or the bias
of a level accelerometer. ``j = g w`` is the drift of a level gyro (Titterton and Weston, "Strapdown Inertial Navigation
Technology", 2nd ed., 2004, chapter 12). The velocity error is its derivative.

The fit is weighted: sensor white noise, integrated two and three times, correlates neighbouring errors. Without the
weights, the coefficients would seem far too certain. The causes are compared with filter and specification.

`explain_end` finds the fewest terms that explain both errors at the end of a run.

An equivalent sensor error is the set of constant biases that best explain the errors of all windows, including turns. A
bias is constant in the body, an initial tilt is constant on the ground. Windows on several headings, or with turns,
make the two separately observable; a single straight window does not.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from insnav.attitude import dcm_from_quat
from insnav.earth import gravity_n
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.outage.free_inertial import Windows, growth_by_start_error
from insnav.exceptions import InputError
from insnav.filter.error_model import ErrorModel
from insnav.sample_statistics import CONFIDENCE, FEWEST, chi_square, effective_count, rms
from insnav.types import FloatArray

TERMS = ("t", "t²", "t³")
FITS = 0.95  # a curve fits if its misfit is below this quantile of true curves
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # Gauss-Legendre: exact for the noise polynomials
_EVERY = 5.0  # interval of the window's points in the fit [s]
_DIFFERENT = 0.8  # norm of the mean forward unit vector, below which headings differ [-]
CAUSES = ("velocity", "acceleration", "drift")
ROUGH = 10.0  # an error with a larger reduced chi-square follows no curve [-]


@dataclass(frozen=True, slots=True)
class Curve:
    """Growth curve of the error of one axis."""

    # (3,) velocity [m/s], acceleration [m/s^2], jerk [m/s^3], fitted jointly; with fewer than three observations only
    # the fewest terms that fit, with zero for all others
    value: FloatArray
    covariance: FloatArray  # (3, 3) covariance of `value`; infinite where not observable
    terms: tuple[str, ...]  # the fewest of `TERMS` that fit
    # reduced chi-square of the fit of all three terms [-]: about 1 if these terms and the covariance are correct;
    # ``NaN`` without degrees of freedom
    roughness: float

    @property
    def sd(self) -> FloatArray:
        """(3,) standard deviation of `value`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_curve(elapsed: FloatArray, position: FloatArray, velocity: FloatArray, covariance: FloatArray) -> Curve:
    """Fit position and velocity errors of one axis by generalised least squares.

    `elapsed` (k,): time since the start [s]. `position` (k,): error [m]. `velocity` (k,): error [m/s]; ``NaN`` if
    unknown. `covariance` (2 k, 2 k): of all positions, then all velocities, about the curve, from `about_the_curve`.
    """
    observed = np.concatenate([position, velocity])
    known = np.isfinite(observed)
    design = np.vstack([position_terms(elapsed), velocity_terms(elapsed)])[known]
    observed = observed[known]
    factor = cho_factor(covariance[np.ix_(known, known)], lower=True)
    m = len(observed)
    for size in (1, 2, 3):
        fits = [(*_solve(design[:, list(part)], observed, factor), part) for part in combinations(range(3), size)]
        estimate, _, misfit, part = min(fits, key=lambda each: each[2])
        if size >= m or misfit <= chi_square(m - size, FITS):
            break
    value, matrix, roughness = np.zeros(3), np.full((3, 3), np.inf), np.nan
    value[list(part)] = estimate
    if m >= 3:
        value, matrix, misfit_all = _solve(design, observed, factor)
        roughness = misfit_all / (m - 3) if m > 3 else np.nan
    return Curve(value, matrix, tuple(TERMS[i] for i in part), roughness)


def position_terms(elapsed: FloatArray) -> FloatArray:
    """Compute the position error from unit initial velocity, acceleration and jerk, (k, 3)."""
    return np.column_stack([elapsed, elapsed**2 / 2.0, elapsed**3 / 6.0])


def velocity_terms(elapsed: FloatArray) -> FloatArray:
    """Compute the velocity error from unit initial velocity, acceleration and jerk, (k, 3)."""
    return np.column_stack([np.ones_like(elapsed), elapsed, elapsed**2 / 2.0])


def about_the_curve(
    elapsed: FloatArray,
    reference_variance: FloatArray,
    start_variance: float,
    accel_noise: float,
    gyro_noise: float,
    gravity: float,
) -> FloatArray:
    """Compute the covariance of position and velocity errors about their growth curve.

    `elapsed` (k,): time since the start [s]. `reference_variance` (2 k,): variance of the reference positions, then
    velocities [m^2], [m^2/s^2]; 1 if unknown. `start_variance`: of the start position, common to all positions [m^2].
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
    # terms of very different size are scaled to one for a well-conditioned normal matrix
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv((weighted / scale).T @ (design / scale), hermitian=True)
    estimate = inverse @ ((weighted / scale).T @ observed) / scale
    residual = observed - design @ estimate
    return estimate, inverse / np.outer(scale, scale), float(residual @ cho_solve(factor, residual))


AXES = ("north", "east")
SHORTEST = 5.0  # least time without fixes; earlier, the error of the last fix dominates [s]


@dataclass(frozen=True, slots=True)
class EndAxis:
    """Errors of one horizontal axis at the end of a run."""

    axis: str  # ``north`` or ``east``
    position: float  # position error [m]
    velocity: float  # velocity error [m/s]
    power: float  # exponent n of a growth with t^n, from ``v t / p``; NaN without a position error
    # (3,) initial velocity [m/s], acceleration [m/s^2], jerk [m/s^3], each as the only cause; and their sd
    alone: FloatArray
    sd: FloatArray
    left: FloatArray  # (3,) error that each cause alone leaves unexplained, in sd of the reference
    terms: tuple[str, ...]  # the fewest of t, t², t³ that explain both errors; any two always do

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
    axes = []
    for axis, p, v in zip(AXES, position, velocity, strict=True):
        observed = np.array([p, v]) / sd
        size = np.sum(design**2, axis=0)
        alone = design.T @ observed / size
        unexplained = np.linalg.norm(observed[:, None] - design * alone, axis=0)
        curve = fit_curve(at, np.array([p]), np.array([v]), np.diag(sd**2))
        power = float(v * time / p) if p != 0.0 else float("nan")
        axes.append(EndAxis(axis, float(p), float(v), power, alone, 1.0 / np.sqrt(size), unexplained, curve.terms))
    return tuple(axes)


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


@dataclass(frozen=True, slots=True)
class SensorFit:
    """Constant sensor errors, body axes, that were not corrected in the windows."""

    accel: FloatArray  # (3,) accelerometer bias [m/s^2]
    accel_sd: FloatArray  # (3,) its standard deviation [m/s^2]
    gyro: FloatArray  # (3,) gyro bias [rad/s]
    gyro_sd: FloatArray  # (3,) its standard deviation [rad/s]
    spread: float  # chi-square over its expectation [-]; if above one, it increases the variances by this factor
    # True if headings differ enough to separate the bias of level accelerometers from a tilt common to all starts
    level_observable: bool


def fit_sensors(windows: Windows, model: ErrorModel) -> SensorFit:
    """Fit six biases jointly to all windows.

    The fit also estimates the errors of each start, with the filter's covariance as prior.

    Notes
    -----
    Error model: ``d phi = -C w dt``, ``d v = (f x phi + C b) dt``, ``d p = v dt`` for biases b and w in the samples
    (Groves 2013, section 14.2.4, without Earth rotation and curvature, which contribute 0.05 % in a minute).
    """
    normal, right, misfit, points = np.zeros((6, 6)), np.zeros(6), 0.0, 0
    equations: list[tuple[FloatArray, FloatArray]] = []  # normal matrix and right side of every window
    stride = max(1, round(_EVERY / float(windows.grid[0])))
    rows = np.arange(len(windows.grid) - 1, -1, -stride)[::-1]
    for i in range(windows.count):
        bias, start = _responses(windows, i)
        bias, start = bias[:, rows], start[:, rows]
        observed = np.concatenate([windows.error[i, rows, :3].T.ravel(), windows.error[i, rows, 3:].T.ravel()])
        known = np.isfinite(observed)
        # rows: positions North, East, Down at all epochs, then velocities
        design, by_start = (matrix.reshape(-1, matrix.shape[-1])[known] for matrix in (bias, start))
        noise = _noise(windows, i, rows, model)[np.ix_(known, known)]
        noise += by_start @ windows.start_covariance[i, :9, :9] @ by_start.T
        factor = cho_factor(noise, lower=True)
        weighted = cho_solve(factor, design)
        equations.append((design.T @ weighted, weighted.T @ observed[known]))
        normal += equations[-1][0]
        right += equations[-1][1]
        misfit += float(observed[known] @ cho_solve(factor, observed[known]))
        points += int(known.sum())
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    estimate = inverse @ right
    misfit -= float(right @ estimate)
    spread_ratio = misfit / max(points - 6, 1)
    # overlapping windows share data, so the variance of the fit grows by this factor
    repeated = windows.count / effective_count(windows.start, windows.length)
    # model errors, such as misalignment in turns, are common within a window: the scatter between windows reveals them
    # (Liang and Zeger, Biometrika 73 (1986) 13-22, with the windows as clusters)
    scores = np.array([b - n @ estimate for n, b in equations])
    count = effective_count(windows.start, windows.length)
    robust = np.diag(inverse @ scores.T @ scores @ inverse) * repeated * count / max(count - 1.0, 1.0)
    variance = np.maximum(np.diag(inverse) * max(spread_ratio, 1.0) * repeated, robust)
    # a filter with an unknown bias has a tilt that rotates with the body: the fit cannot separate it from the bias
    tilt = float(np.mean(np.einsum("nii->n", windows.start_covariance[:, 6:8, 6:8]))) / 2.0
    level = 1.0 - np.mean(dcm_from_quat(windows.q_nb[:, 0])[:, 2] ** 2, axis=0)
    variance[:3] += level * tilt * float(gravity_n(*windows.lla[0, [0, 2]])[2]) ** 2
    sd = np.sqrt(variance)
    # if headings differ, the forward unit vectors have a short mean, and a common tilt averages out
    forward = dcm_from_quat(windows.q_nb)[..., :2, 0].reshape(-1, 2).mean(axis=0)
    differ = float(np.linalg.norm(forward)) < _DIFFERENT
    return SensorFit(estimate[:3], sd[:3], estimate[3:], sd[3:], spread_ratio, differ)


def _responses(windows: Windows, i: int) -> tuple[FloatArray, FloatArray]:
    """Compute position and velocity errors of window i per bias, (6, k, 6), and per start error, (6, k, 9)."""
    time = np.concatenate([[0.0], windows.elapsed[i]])
    c = dcm_from_quat(windows.q_nb[i])
    f = np.gradient(windows.v_n[i], time, axis=0) - gravity_n(windows.lla[i, 0], windows.lla[i, 2])
    cross = np.zeros((len(time), 3, 3))  # cross product matrix of f
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -f[:, 2], f[:, 1], -f[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    eye = np.tile(np.eye(3), (len(time), 1, 1))
    attitude = -_integral(time, c)  # attitude error per unit gyro bias
    v = np.concatenate([_integral(time, c), _integral(time, cross @ attitude)], axis=2)
    p = _integral(time, v)
    v_start = np.concatenate([np.zeros_like(eye), eye, _integral(time, cross)], axis=2)
    p_start = np.concatenate([eye, time[:, None, None] * eye, _integral(time, v_start[:, :, 6:])], axis=2)
    bias, start = np.concatenate([p, v], axis=1), np.concatenate([p_start, v_start], axis=1)
    return np.moveaxis(bias[1:], 1, 0), np.moveaxis(start[1:], 1, 0)


def _integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate values from the first time to each time by the trapezoid rule, corrected by the slopes at the ends."""
    step = np.diff(time)[:, None, None]
    slope = np.gradient(values, time, axis=0)
    parts = 0.5 * step * (values[1:] + values[:-1]) - step**2 / 12.0 * (slope[1:] - slope[:-1])
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(parts, axis=0)])


def _noise(windows: Windows, i: int, at: np.ndarray, model: ErrorModel) -> FloatArray:
    """Compute the covariance from reference and white noise, (6 k, 6 k)."""
    k = len(at)
    total = np.zeros((6 * k, 6 * k))
    gravity = float(gravity_n(windows.lla[i, 0], windows.lla[i, 2])[2])
    for axis in range(3):
        reference = np.concatenate([windows.reference_sd[i, at, axis], windows.reference_sd[i, at, 3 + axis]]) ** 2
        gyro = float(model.noise[:3].mean()) if axis < 2 else 0.0
        block = about_the_curve(windows.elapsed[i, at], reference, 0.0, float(model.noise[3:6].mean()), gyro, gravity)
        rows = np.concatenate([np.arange(k) + axis * k, np.arange(k) + (3 + axis) * k])
        total[np.ix_(rows, rows)] = block
    return total


@dataclass(frozen=True, slots=True)
class Cause:
    """One term of the growth on one axis, over all windows."""

    # root mean square over the windows, noise variance subtracted: velocity [m/s], effective horizontal acceleration
    # [m/s^2], drift [rad/s]
    rms: float
    # mean over the windows, and its standard deviation from their scatter and effective sample size
    mean: float
    mean_sd: float
    fit_sd: float  # RMS standard deviation of the fit of one window
    # RMS standard deviation at the starts, of the filter, or for uncalibrated sensors of the specification
    filter_sd: float
    spec_sd: float  # by the specification alone: accelerometer bias, gyro bias; ``NaN`` for a velocity
    share: float  # share of the mean square error at the end [-]; contributions may cancel
    ratio: float  # mean square over summed variances of `filter_sd` and `fit_sd`: one if the prediction is right [-]
    limit: float  # upper 97.5 % limit of that ratio [-]

    @property
    def explained(self) -> bool:
        """True if not larger than predicted."""
        return self.ratio <= self.limit


@dataclass(frozen=True, slots=True)
class AxisDiagnosis:
    """Diagnosis of one axis."""

    axis: str  # ``north`` or ``east``
    causes: tuple[Cause, ...]  # velocity error, acceleration error and gyro drift
    curves: tuple[Curve, ...]  # growth curves, one per window
    terms: dict[str, int]  # number of windows by their required terms
    leading: int  # index of the largest contribution in `CAUSES`


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Diagnosis of both axes."""

    axes: tuple[AxisDiagnosis, ...]  # diagnosis of North, then of East
    gravity: float  # converts acceleration to tilt and jerk to drift [m/s^2]
    windows: Windows  # the windows used, in the order of the curves
    rough: int  # number of windows whose error follows no curve, as reference or sensors jump
    # True if only stationary and straight windows are used, where tilt and bias are not separable. False if these are
    # too few: then all windows are used, although errors follow no curve in turns
    steady: bool


def diagnose(windows: Windows, model: ErrorModel) -> Diagnosis:
    """Fit curves to all windows without turns, or to all windows if these are too few, and summarise their causes."""
    without_turn = windows.motion != "turning"
    steady = effective_count(windows.start[without_turn], windows.length) >= FEWEST
    windows = windows.only(without_turn) if steady else windows
    gravity = float(np.mean([gravity_n(lla[0], lla[2])[2] for lla in windows.lla]))
    curves = [[_fitted(windows, i, axis, model, gravity) for i in range(windows.count)] for axis in (0, 1)]
    smooth = np.array([not (a.roughness > ROUGH or b.roughness > ROUGH) for a, b in zip(*curves, strict=True)])
    if not steady or effective_count(windows.start[smooth], windows.length) < FEWEST:
        smooth[:] = True
    windows = windows.only(smooth)
    # covariance of velocity, acceleration and jerk (n, 2, 3, 3) from the filter's covariance at each start
    responses = map(growth_by_start_error, windows.q_nb[:, 0], windows.lla)
    starts = zip(responses, windows.start_covariance, strict=True)
    predicted = np.array([response @ start @ np.swapaxes(response, 1, 2) for response, start in starts])
    C_nb = dcm_from_quat(windows.q_nb[:, 0])
    axes = []
    for axis, name in enumerate(AXES):
        # a gyro error about East affects North, and about North East
        accel, gyro = C_nb[:, axis] * model.sd[3:6], C_nb[:, 1 - axis] * model.sd[:3]
        spec = np.array([np.nan, rms(np.linalg.norm(accel, axis=-1)), rms(np.linalg.norm(gyro, axis=-1))])
        kept = [curve for curve, keep in zip(curves[axis], smooth, strict=True) if keep]
        axes.append(_axis(name, kept, predicted[:, axis], spec, windows, gravity))
    return Diagnosis(tuple(axes), gravity, windows, int((~smooth).sum()), steady)


def _fitted(windows: Windows, i: int, axis: int, model: ErrorModel, gravity: float) -> Curve:
    """Fit the curve of one window on one axis."""
    reference = np.concatenate([windows.reference_sd[i, :, axis], windows.reference_sd[i, :, 3 + axis]]) ** 2
    at_start = float(windows.start_covariance[i, axis, axis])
    accel_noise, gyro_noise = float(model.noise[3:6].mean()), float(model.noise[:3].mean())
    noise = about_the_curve(windows.elapsed[i], reference, at_start, accel_noise, gyro_noise, gravity)
    return fit_curve(windows.elapsed[i], windows.error[i, :, axis], windows.error[i, :, 3 + axis], noise)


def _axis(
    name: str, curves: list[Curve], predicted: FloatArray, spec_sd: FloatArray, windows: Windows, gravity: float
) -> AxisDiagnosis:
    value = np.array([curve.value for curve in curves])
    fit = np.array([curve.sd for curve in curves])
    stated = np.sqrt(np.einsum("nii->ni", predicted))
    count = effective_count(windows.start, windows.length)
    contribution = np.mean((value * position_terms(windows.elapsed[:, -1])) ** 2, axis=0)
    units = np.array([1.0, 1.0, 1.0 / gravity])  # a jerk over gravity is a gyro drift
    samples = 1.0 if windows.uncalibrated else max(count, 1.0)  # turn-on errors are common to all windows
    limit = float(chi_square(samples, 0.5 + 0.5 * CONFIDENCE) / samples)
    causes = []
    for k in range(3):
        square, noise = float(np.mean(value[:, k] ** 2)), float(np.mean(fit[:, k] ** 2))
        causes.append(
            Cause(
                float(np.sqrt(max(square - noise, 0.0))) * units[k],
                float(np.mean(value[:, k])) * units[k],
                float(np.std(value[:, k]) / np.sqrt(max(count - 1.0, 1.0))) * units[k],
                float(np.sqrt(noise)) * units[k],
                rms(stated[:, k]) * units[k],
                float(spec_sd[k]),
                float(contribution[k] / contribution.sum()) if contribution.sum() > 0.0 else np.nan,
                float(np.mean(value[:, k] ** 2 / (fit[:, k] ** 2 + stated[:, k] ** 2))),
                limit,
            )
        )
    terms = dict(Counter(" + ".join(curve.terms) for curve in curves))
    assert len(TERMS) == len(causes)
    return AxisDiagnosis(name, tuple(causes), tuple(curves), terms, int(np.argmax(contribution)))
