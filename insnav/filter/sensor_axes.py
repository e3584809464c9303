"""How far the axes of the sensors are turned, from what twelve constants do to the innovations.

A misalignment is a constant, which the filter takes for noise. Each of the twelve off-diagonal terms shifts the
innovations in proportion, so that beside the filter they are a linear regression: B. Friedland, "Treatment of bias in
recursive filtering", IEEE Trans. Autom. Control 14 (1969) 359-367. A drive tells some of them, and none that turns all
sensors alike; but the IMU error specification has one size for all, and that of the terms seen is evidence of it. With
so few the size is averaged over what is plausible: the most likely one would be too sure (D. J. C. MacKay, "Bayesian
interpolation", Neural Computation 4 (1992) 415-447, has the evidence; its maximum is not used). What the drive tells of
each term corrects the samples; what it leaves open, by what it does to the attitude, is the part of the attitude's
error that the filter does not know of (its "consider" covariance: S. F. Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3 (1966) 293-340).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav import spill, strapdown
from insnav.attitude import dcm_from_quat
from insnav.kernels.noise_likelihood import held
from insnav.kernels.smoother import STATE, TIME
from insnav.types import FloatArray, ImuData

TERMS = tuple((i, j) for i in range(3) for j in range(3) if i != j)  # axis i senses a part of what is about axis j
# Parts of a drive, and scatter of what they say of a term, by that expected, from which it is none by chance
BLOCKS, BY_CHANCE = 20, 2.5
GRID = np.linspace(-7.0, 4.0, 221)  # logarithm of the size, by the prior's


def errors_of_axes(
    epochs: FloatArray, transition: FloatArray, imu: ImuData, nominal: float
) -> tuple[FloatArray, FloatArray]:
    """What one radian of each misalignment, gyros first, adds to the errors of the filter from epoch to epoch.

    `epochs` (m, width): history of the filter; `transition` (m, 9, 21). `imu`, `nominal`: samples, interval [s].
    Returns: (12, m, 9) errors of position, velocity and attitude; (m, 3, 3) attitude matrices between the epochs.
    """
    time, q = epochs[:, TIME], epochs[:, STATE + 6 : STATE + 10].copy()
    q[1:] += np.sign(np.sum(q[1:] * q[:-1], axis=1))[:, None] * q[:-1]  # halfway from the epoch before
    c = dcm_from_quat(q / np.linalg.norm(q, axis=1)[:, None])
    parts = strapdown.intervals(imu, nominal)
    edges = np.concatenate([parts.end[:1] - parts.dt[:1], parts.end])

    def between(values: FloatArray) -> FloatArray:
        """Integral of a triad from epoch to epoch, (m, 3)."""
        whole = np.cumsum(values * parts.dt[:, None] if parts.instant else values, axis=0)
        at = np.column_stack([np.interp(time, edges, np.concatenate([[0.0], column])) for column in whole.T])
        return np.diff(at, axis=0, prepend=at[:1])

    turned, pushed = between(parts.gyro), between(parts.accel)
    # What it makes of gravity is a bias, and known as such: see `level_bias`. What it makes of a mean rate is not: good
    # gyros have far smaller biases.
    pushed[1:] -= pushed.sum(axis=0) * (np.diff(time) / (time[-1] - time[0]))[:, None]
    found = np.zeros((2 * len(TERMS), time.size, 9))
    for number, (i, j) in enumerate(TERMS):
        speed, accel = c[:, :, i] * pushed[:, j, None], found[len(TERMS) + number]
        found[number], accel[:, 3:6] = by_turn(-c[:, :, i] * turned[:, j, None], transition), speed
        accel[:, :3] = np.einsum("kij,kj->ki", transition[:, :3, 3:6], speed) / 2.0
    return found, c


def by_turn(tilt: FloatArray, transition: FloatArray) -> FloatArray:
    """Errors of position, velocity and attitude, (m, 9), by a `tilt` (m, 3) [rad] that grows from epoch to epoch.

    None while the filter holds the attitude.
    """
    tilt = np.where(held(transition)[:, None], 0.0, tilt)
    # spread evenly over the span, an error acts on the next one for half of it, on the one after for a third
    parts = (transition[:, :3, 6:9] / 3.0, transition[:, 3:6, 6:9] / 2.0)
    return np.hstack([*(np.einsum("kij,kj->ki", part, tilt) for part in parts), tilt])


def informed(
    innovation: FloatArray, by: FloatArray, weight: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Curvature (k, k) and slope (k,) of the log-likelihood by terms of which one adds `by` (k, n) to an innovation.

    Innovations that err together, as in multipath, say less than as many that err each by itself: slopes of parts of
    the drive then scatter more than their curvature allows, and count as much less (the "sandwich" covariance:
    P. J. Huber, "The behavior of maximum likelihood estimates under nonstandard conditions", 5th Berkeley Symp. 1
    (1967) 221-233; by blocks: K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13-22).

    `innovation`, `weight` (n,): innovations and their inverse variances. `sd` (k,): of the terms before.
    """
    scale = np.where(sd > 0.0, sd, 1.0)
    by = by * scale[:, None]
    fisher, slope = (by * weight) @ by.T, -(by * weight) @ innovation
    left = weight * (innovation + np.linalg.solve(fisher + np.eye(sd.size), slope) @ by)
    parts = np.array([by[:, part] @ left[part] for part in np.array_split(np.arange(left.size), BLOCKS)])
    scatter = BLOCKS * np.var(parts, axis=0, ddof=1) / np.maximum(np.diag(fisher), 1e-9)
    less = 1.0 / np.sqrt(np.where(scatter > BY_CHANCE, scatter, 1.0))
    if (less < 1.0).any():
        part = fisher @ (less[:, None] * np.linalg.inv(fisher + 1e-6 * np.eye(sd.size)) * less)
        fisher, slope = part @ fisher, part @ slope
    return fisher / np.outer(scale, scale), slope / scale


@dataclass(frozen=True, slots=True)
class Misalignment:
    """What a drive tells about misalignments."""

    size: tuple[float, float, float]  # root mean square by that of the specification, and its interval of 95 %
    terms: FloatArray  # (12,) mean of each [rad]
    attitude: FloatArray  # (3,) mean of what they do to roll, pitch, heading [rad]
    attitude_sd: FloatArray  # (3,) standard deviation of that [rad]
    evidence: float  # log odds of misalignments, their size averaged over, against none

    def corrected(self, imu: ImuData) -> ImuData:
        """Samples less what the terms make of them, of specific force beside a bias."""

        def of(values: FloatArray, terms: FloatArray, mean: FloatArray) -> FloatArray:
            askew = np.zeros((3, 3))
            askew[tuple(np.transpose(TERMS))] = terms
            return spill.by_blocks(lambda rows: rows - (rows - mean) @ askew.T, values)

        gyro, accel = np.split(self.terms, 2)
        return replace(imu, gyro=of(imu.gyro, gyro, np.zeros(3)), accel=of(imu.accel, accel, spill.mean(imu.accel)))


def misalignment(
    fisher: FloatArray, slope: FloatArray, turned: FloatArray, sd: FloatArray, prior_sd: float
) -> Misalignment:
    """Misalignments from their likelihood.

    `fisher` (12, 12), `slope` (12,): curvature and slope of the log-likelihood by the terms. `turned` (12, k, 3): error
    of roll, pitch, heading at some epochs by each [-]. `sd` (12,): of the specification [rad]. `prior_sd`: of the
    logarithm of the size, zero if the specification is that of this IMU.
    """
    grid = GRID if prior_sd > 0.0 else np.zeros(1)
    scaled, log = fisher * np.outer(sd, sd), -0.5 * (grid / max(prior_sd, 1e-9)) ** 2
    means, spreads = np.empty((grid.size, sd.size)), np.empty((grid.size, sd.size, sd.size))
    for k, x in enumerate(grid):
        spreads[k] = np.linalg.inv(scaled + np.exp(-2.0 * x) * np.eye(sd.size))
        means[k] = spreads[k] @ (slope * sd)
        log[k] += 0.5 * (slope * sd @ means[k] + np.linalg.slogdet(spreads[k])[1]) - x * sd.size
    weight = np.exp(log - log.max())
    evidence = float(log.max() + np.log(weight.sum() / np.sum(np.exp(-0.5 * (grid / max(prior_sd, 1e-9)) ** 2))))
    weight /= weight.sum()
    low, high = np.exp(np.interp([0.025, 0.975], np.cumsum(weight), grid)).tolist()
    terms = weight @ means
    spread = np.einsum("k,kij->ij", weight, spreads) + (means - terms).T @ (weight[:, None] * (means - terms))
    turned = turned * sd[:, None, None]
    return Misalignment(
        (float(np.sqrt(weight @ np.exp(2.0 * grid))), low, high),
        sd * terms,
        np.einsum("a,akx->x", terms, turned) / turned.shape[1],
        np.sqrt(np.einsum("akx,ab,bkx->x", turned, spread, turned) / turned.shape[1]),
        evidence,
    )
