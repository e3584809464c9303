"""Equivalent sensor error: the constant biases that best explain the errors of all windows, including turns.

A bias is constant in the body, an initial tilt is constant on the ground. Windows on several headings, or with turns,
make the two separately observable; a single straight window does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from insnav.attitude import dcm_from_quat
from insnav.earth import gravity_n
from insnav.errors.diagnosis.growth_curves import about_the_curve
from insnav.errors.outage.free_inertial import Windows
from insnav.filter.error_model import ErrorModel
from insnav.sample_statistics import effective_count
from insnav.types import FloatArray

_EVERY = 5.0  # interval of the window's points in the fit [s]
_DIFFERENT = 0.8  # norm of the mean forward unit vector, below which headings differ [-]


@dataclass(frozen=True, slots=True)
class SensorFit:
    """Constant sensor errors, body axes, that were not corrected in the windows."""

    # (3,) accelerometer bias [m/s^2]
    accel: FloatArray
    accel_sd: FloatArray
    # (3,) gyro bias [rad/s]
    gyro: FloatArray
    gyro_sd: FloatArray
    spread: float  # misfit over its expectation [-]; above one, the standard deviations include its root
    # headings differ enough to separate the level accelerometers' bias from a tilt common to all starts
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
    each: list[tuple[FloatArray, FloatArray]] = []  # normal matrix and right side of every window
    stride = max(1, round(_EVERY / float(windows.grid[0])))
    at = np.arange(len(windows.grid) - 1, -1, -stride)[::-1]
    for i in range(windows.count):
        bias, start = _responses(windows, i)
        bias, start = bias[:, at], start[:, at]
        observed = np.concatenate([windows.error[i, at, :3].T.ravel(), windows.error[i, at, 3:].T.ravel()])
        known = np.isfinite(observed)
        # rows: all North, East, Down, then the velocities
        design, own = (each.reshape(-1, each.shape[-1])[known] for each in (bias, start))
        spread = _noise(windows, i, at, model)[np.ix_(known, known)]
        spread += own @ windows.start_covariance[i, :9, :9] @ own.T
        factor = cho_factor(spread, lower=True)
        weighted = cho_solve(factor, design)
        each.append((design.T @ weighted, weighted.T @ observed[known]))
        normal += each[-1][0]
        right += each[-1][1]
        misfit += float(observed[known] @ cho_solve(factor, observed[known]))
        points += int(known.sum())
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    found = inverse @ right
    misfit -= float(right @ found)
    spread_ratio = misfit / max(points - 6, 1)
    # overlapping windows share data
    repeated = windows.count / effective_count(windows.start, windows.length)
    # model errors, such as misalignment in turns, are common within a window: the scatter between windows reveals them
    # (Liang and Zeger, Biometrika 73 (1986) 13-22, with the windows as clusters)
    scores = np.array([b - n @ found for n, b in each])
    count = effective_count(windows.start, windows.length)
    robust = np.diag(inverse @ scores.T @ scores @ inverse) * repeated * count / max(count - 1.0, 1.0)
    variance = np.maximum(np.diag(inverse) * max(spread_ratio, 1.0) * repeated, robust)
    # a tilt that rotates with the body over all starts, as a filter makes of an unknown bias, equals that bias
    tilt = float(np.mean(np.einsum("nii->n", windows.start_covariance[:, 6:8, 6:8]))) / 2.0
    level = 1.0 - np.mean(dcm_from_quat(windows.q_nb[:, 0])[:, 2] ** 2, axis=0)
    variance[:3] += level * tilt * float(gravity_n(*windows.lla[0, [0, 2]])[2]) ** 2
    sd = np.sqrt(variance)
    # forward unit vectors have a short mean if headings differ: a common tilt then averages out
    ahead = dcm_from_quat(windows.q_nb)[..., :2, 0].reshape(-1, 2).mean(axis=0)
    differ = float(np.linalg.norm(ahead)) < _DIFFERENT
    return SensorFit(found[:3], sd[:3], found[3:], sd[3:], spread_ratio, differ)


def _responses(windows: Windows, i: int) -> tuple[FloatArray, FloatArray]:
    """Compute position and velocity errors of window i per bias, (6, k, 6), and per start error, (6, k, 9)."""
    time = np.concatenate([[0.0], windows.elapsed[i]])
    c = dcm_from_quat(windows.q_nb[i])
    gravity = gravity_n(windows.lla[i, 0], windows.lla[i, 2])
    f = np.gradient(windows.v_n[i], time, axis=0) - gravity
    cross = np.zeros((len(time), 3, 3))  # f x
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -f[:, 2], f[:, 1], -f[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    eye = np.tile(np.eye(3), (len(time), 1, 1))
    turned = -_integral(time, c)  # attitude by gyro bias
    v = np.concatenate([_integral(time, c), _integral(time, cross @ turned)], axis=2)
    p = _integral(time, v)
    v_start = np.concatenate([np.zeros_like(eye), eye, _integral(time, cross)], axis=2)
    p_start = np.concatenate([eye, time[:, None, None] * eye, _integral(time, v_start[:, :, 6:])], axis=2)
    bias, start = np.concatenate([p, v], axis=1), np.concatenate([p_start, v_start], axis=1)
    return np.moveaxis(bias[1:], 1, 0), np.moveaxis(start[1:], 1, 0)


def _integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate from the first time to each, by the trapezoid rule with end correction of the slopes."""
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
        turning = float(model.noise[:3].mean()) if axis < 2 else 0.0
        own = about_the_curve(windows.elapsed[i, at], reference, 0.0, float(model.noise[3:6].mean()), turning, gravity)
        rows = np.concatenate([np.arange(k) + axis * k, np.arange(k) + (3 + axis) * k])
        total[np.ix_(rows, rows)] = own
    return total
