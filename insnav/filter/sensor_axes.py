"""How far the axes of the sensors are turned, from what twelve constants do to the innovations.

A misalignment is a constant, which the filter takes for noise. Each of the twelve off-diagonal terms shifts the
innovations in proportion, so that beside the filter they are a linear regression: B. Friedland, "Treatment of bias in
recursive filtering", IEEE Trans. Autom. Control 14 (1969) 359-367. A drive tells some of them, and none that turns all
sensors alike; but the IMU error specification has one size for all, and that of the terms seen is evidence of it. With
so few the size is averaged over what is plausible: the most likely one would be too sure (D. J. C. MacKay, "Bayesian
interpolation", Neural Computation 4 (1992) 415-447, has the evidence; its maximum is not used).
"""

from __future__ import annotations

import numpy as np

from insnav import strapdown
from insnav.attitude import dcm_from_quat
from insnav.kernels.smoother import STATE, TIME
from insnav.types import FloatArray, ImuData

TERMS = tuple((i, j) for i in range(3) for j in range(3) if i != j)  # axis i senses a part of what is about axis j
GRID = np.linspace(-7.0, 4.0, 221)  # logarithm of the size, by the prior's


def errors_of_axes(epochs: FloatArray, transition: FloatArray, imu: ImuData, nominal: float) -> FloatArray:
    """What one radian of each misalignment, gyros first, adds to the errors of the filter from epoch to epoch.

    `epochs` (m, width): history of the filter; `transition` (m, 9, 21); `imu`, `nominal`: samples, interval [s].
    Returns: (12, m, 9) errors of position, velocity and attitude.
    """
    time, q = epochs[:, TIME], epochs[:, STATE + 6 : STATE + 10].copy()
    q[1:] += np.sign(np.sum(q[1:] * q[:-1], axis=1))[:, None] * q[:-1]  # halfway from the epoch before
    c = dcm_from_quat(q / np.linalg.norm(q, axis=1)[:, None])
    parts = strapdown.intervals(imu, nominal)
    edges = np.concatenate([parts.end[:1] - parts.dt[:1], parts.end])

    def between(values: FloatArray) -> FloatArray:
        """Integral of a triad from epoch to epoch less its mean, of which a misalignment makes a bias, (m, 3)."""
        whole = np.cumsum(values * parts.dt[:, None] if parts.instant else values, axis=0)
        at = np.column_stack([np.interp(time, edges, np.concatenate([[0.0], column])) for column in whole.T])
        at -= (time - time[0])[:, None] * (at[-1] - at[0]) / (time[-1] - time[0])
        return np.diff(at, axis=0, prepend=at[:1])

    turned, pushed = between(parts.gyro), between(parts.accel)
    found = np.zeros((2 * len(TERMS), time.size, 9))
    for number, (i, j) in enumerate(TERMS):
        tilt, speed = -c[:, :, i] * turned[:, j, None], c[:, :, i] * pushed[:, j, None]
        gyro, accel = found[number], found[len(TERMS) + number]
        # spread evenly over the span, an error acts on the next one for half of it, on the one after for a third
        gyro[:, 6:], accel[:, 3:6] = tilt, speed
        gyro[:, 3:6] = np.einsum("kij,kj->ki", transition[:, 3:6, 6:9], tilt) / 2.0
        gyro[:, :3] = np.einsum("kij,kj->ki", transition[:, :3, 6:9], tilt) / 3.0
        accel[:, :3] = np.einsum("kij,kj->ki", transition[:, :3, 3:6], speed) / 2.0
    return found


def size_of_misalignment(
    fisher: FloatArray, slope: FloatArray, sd: FloatArray, prior_sd: float
) -> tuple[float, float, float]:
    """Root mean square of the size of the misalignments by that of the specification, and its interval of 95 %.

    `fisher` (12, 12), `slope` (12,): curvature and slope of the log-likelihood by the terms; `sd` (12,): of the
    specification [rad]; `prior_sd`: of the logarithm of the size.
    """
    fisher, slope = fisher * np.outer(sd, sd), slope * sd
    log = np.empty(GRID.size)
    for k, x in enumerate(GRID):
        curvature = fisher + np.exp(-2.0 * x) * np.eye(sd.size)
        volume = np.linalg.slogdet(curvature)[1] + 2.0 * x * sd.size
        log[k] = 0.5 * (slope @ np.linalg.solve(curvature, slope) - volume - (x / prior_sd) ** 2)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    low, high = np.exp(np.interp([0.025, 0.975], np.cumsum(weight), GRID)).tolist()
    return float(np.sqrt(weight @ np.exp(2.0 * GRID))), low, high
