"""Noise estimate from the innovations of a drive, and misalignment of the sensor axes from twelve constants.

A misalignment is a constant, which the filter treats as noise. Each of the twelve off-diagonal terms changes the
innovations in proportion, so a linear regression outside the filter estimates the terms (B. Friedland, "Treatment of
bias in recursive filtering", IEEE Trans. Autom. Control 14 (1969) 359-367). A drive determines only some terms, and
never a common rotation of all sensors. The IMU error specification has one size for all terms. The observed terms are
evidence of this size (D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415-447). The size is
averaged over plausible values: the most likely size of few terms would be over-confident. The mean of each term
corrects the samples. The remaining uncertainty adds to the attitude error outside the filter (S. F. Schmidt,
"Application of state-space methods to navigation problems", Advances in Control Systems 3 (1966) 293-340).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav import spill, strapdown
from insnav.alignment.static import LONG_REST
from insnav.attitude import dcm_from_quat
from insnav.filter.error_model import ErrorModel, InitialState, initial_state
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.imu.specification import ImuSpec
from insnav.kernels.noise_likelihood import held
from insnav.kernels.smoother import STATE, TIME
from insnav.types import Alignment, FloatArray, ImuData

TERMS = tuple((i, j) for i in range(3) for j in range(3) if i != j)  # axis i senses a part of the signal of axis j
# Number of parts of a drive. If the slopes of the parts scatter by more than this factor, a term loses weight
BLOCKS, BY_CHANCE = 20, 2.5
GRID = np.linspace(-7.0, 4.0, 221)  # logarithms of the size of all terms, relative to the prior


def errors_of_axes(
    epochs: FloatArray, transition: FloatArray, imu: ImuData, nominal: float
) -> tuple[FloatArray, FloatArray]:
    """Compute the navigation error that each misalignment adds from epoch to epoch, per radian, gyros first.

    `epochs` (m, width): history of the filter; `transition` (m, 9, 21). `imu`, `nominal`: samples, interval [s].
    Returns: (12, m, 9) errors of position, velocity and attitude; (m, 3, 3) attitude matrices between the epochs.
    """
    time, q = epochs[:, TIME], epochs[:, STATE + 6 : STATE + 10].copy()
    q[1:] += np.sign(np.sum(q[1:] * q[:-1], axis=1))[:, None] * q[:-1]  # attitude halfway between epochs
    c_nb = dcm_from_quat(q / np.linalg.norm(q, axis=1)[:, None])
    parts = strapdown.intervals(imu, nominal)
    edges = np.concatenate([parts.end[:1] - parts.dt[:1], parts.end])

    def between(values: FloatArray) -> FloatArray:
        """Integrate a triad from epoch to epoch, (m, 3)."""
        integral = np.cumsum(values * parts.dt[:, None] if parts.instant else values, axis=0)
        at_epochs = np.column_stack([np.interp(time, edges, np.concatenate([[0.0], column])) for column in integral.T])
        return np.diff(at_epochs, axis=0, prepend=at_epochs[:1])

    turned, gained = between(parts.gyro), between(parts.accel)
    # Remove the mean specific force: gravity times a misalignment is an accelerometer bias, which the filter estimates
    # (see `level_bias`). Keep the mean rate: times the misalignment it is far larger than the biases of good gyros.
    gained[1:] -= gained.sum(axis=0) * (np.diff(time) / (time[-1] - time[0]))[:, None]
    errors = np.zeros((2 * len(TERMS), time.size, 9))
    for number, (i, j) in enumerate(TERMS):
        speed, accel = c_nb[:, :, i] * gained[:, j, None], errors[len(TERMS) + number]
        errors[number], accel[:, 3:6] = by_turn(-c_nb[:, :, i] * turned[:, j, None], transition), speed
        accel[:, :3] = np.einsum("kij,kj->ki", transition[:, :3, 3:6], speed) / 2.0
    return errors, c_nb


def by_turn(tilt: FloatArray, transition: FloatArray) -> FloatArray:
    """Compute errors of position, velocity and attitude, (m, 9), by a `tilt` (m, 3) [rad] that grows during each span.

    They are zero in a long stationary start, where the filter ignores the gyros.
    """
    tilt = np.where(held(transition)[:, None], 0.0, tilt)
    # a tilt that grows evenly over a span acts on the velocity for half of it, and on the position for a third
    parts = (transition[:, :3, 6:9] / 3.0, transition[:, 3:6, 6:9] / 2.0)
    return np.hstack([*(np.einsum("kij,kj->ki", part, tilt) for part in parts), tilt])


def informed(
    innovation: FloatArray, by: FloatArray, weight: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute curvature (k, k) and slope (k,) of the log-likelihood by terms with the effect `by` (k, n).

    Correlated innovations, as in multipath, carry less information than independent ones. The slopes of parts of the
    drive then scatter more than the curvature implies. Such terms get less weight (the "sandwich" covariance: P. J.
    Huber, "The behavior of maximum likelihood estimates under nonstandard conditions", 5th Berkeley Symp. 1 (1967)
    221-233; by blocks: K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13-22).

    `innovation`, `weight` (n,): innovations and their inverse variances. `sd` (k,): prior of the terms.
    """
    scale = np.where(sd > 0.0, sd, 1.0)
    by = by * scale[:, None]
    fisher, slope = (by * weight) @ by.T, -(by * weight) @ innovation
    residual = weight * (innovation + np.linalg.solve(fisher + np.eye(sd.size), slope) @ by)
    # the scatter of the slopes of parts, at the estimate, shows whether innovations are correlated
    parts = np.array([by[:, part] @ residual[part] for part in np.array_split(np.arange(residual.size), BLOCKS)])
    scatter = BLOCKS * np.var(parts, axis=0, ddof=1) / np.maximum(np.diag(fisher), 1e-9)
    factor = 1.0 / np.sqrt(np.where(scatter > BY_CHANCE, scatter, 1.0))
    if (factor < 1.0).any():
        part = fisher @ (factor[:, None] * np.linalg.inv(fisher + 1e-6 * np.eye(sd.size)) * factor)
        fisher, slope = part @ fisher, part @ slope
    return fisher / np.outer(scale, scale), slope / scale


@dataclass(frozen=True, slots=True)
class Misalignment:
    """Misalignments estimated from a drive."""

    size: tuple[float, float, float]  # root mean square relative to the specification, and its 95 % interval
    terms: FloatArray  # (12,) mean of each misalignment [rad]
    attitude: FloatArray  # (3,) mean error of roll, pitch, heading by the misalignments [rad]
    attitude_sd: FloatArray  # (3,) standard deviation of these attitude errors [rad]
    evidence: float  # log odds of misalignments, with averaged size, against none

    def corrected(self, imu: ImuData) -> ImuData:
        """Correct samples for misalignments, except for the effect of the mean specific force (a bias)."""

        def of(values: FloatArray, terms: FloatArray, mean: FloatArray) -> FloatArray:
            askew = np.zeros((3, 3))
            askew[tuple(np.transpose(TERMS))] = terms
            return spill.by_blocks(lambda rows: rows - (rows - mean) @ askew.T, values)

        gyro, accel = np.split(self.terms, 2)
        return replace(imu, gyro=of(imu.gyro, gyro, np.zeros(3)), accel=of(imu.accel, accel, spill.mean(imu.accel)))


def misalignment(
    fisher: FloatArray, slope: FloatArray, turned: FloatArray, sd: FloatArray, prior_sd: float
) -> Misalignment:
    """Estimate misalignments from their likelihood.

    `fisher` (12, 12), `slope` (12,): curvature and slope of the log-likelihood by the terms. `turned` (12, k, 3): error
    of roll, pitch, heading at k epochs per term [-]. `sd` (12,): specified sd of the terms [rad]. `prior_sd`: sd of
    the logarithm of the size, zero if the specification belongs to this IMU.
    """
    grid = GRID if prior_sd > 0.0 else np.zeros(1)
    scaled, log_weight = fisher * np.outer(sd, sd), -0.5 * (grid / max(prior_sd, 1e-9)) ** 2
    means, spreads = np.empty((grid.size, sd.size)), np.empty((grid.size, sd.size, sd.size))
    for k, x in enumerate(grid):
        spreads[k] = np.linalg.inv(scaled + np.exp(-2.0 * x) * np.eye(sd.size))
        means[k] = spreads[k] @ (slope * sd)
        log_weight[k] += 0.5 * (slope * sd @ means[k] + np.linalg.slogdet(spreads[k])[1]) - x * sd.size
    weight = np.exp(log_weight - log_weight.max())
    evidence = float(log_weight.max() + np.log(weight.sum() / np.sum(np.exp(-0.5 * (grid / max(prior_sd, 1e-9)) ** 2))))
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


@dataclass(frozen=True, slots=True)
class NoiseFigure:
    """Estimated noise parameter, with its prior and interval."""

    key: str  # dotted name, such as ``gyro.random_walk`` or ``gps.share``
    unit: str  # unit for display of the parameter
    # prior (nearest grade), estimate, and its 95 % interval [SI]; RMS of the axes, or factors on reported sds
    prior: float
    value: float
    low: float
    high: float
    observable: bool  # true if the drive determines it, not the prior


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """Noise estimate from the innovations of a drive."""

    spec: ImuSpec  # estimated IMU, whose misalignments are from the regression
    filter_spec: ImuSpec  # the same, with the misalignment as noise of the filter
    axes: Misalignment  # misalignments of the IMU, from the regression
    position_factor: FloatArray  # (3,) factors on position standard deviations, North, East, Down [-]
    velocity_factor: FloatArray  # (3,) factors on velocity standard deviations [-]
    correlated: CorrelatedNoise  # time-correlated part of the position error
    figures: tuple[NoiseFigure, ...]  # estimated parameters, with intervals
    gain: float  # increase of the log-likelihood over the prior
    # mean square of the normalised innovations with the prior, and with the estimate [-]
    mean_before: float
    mean_after: float
    far_off: bool  # true if attitude errors of the run were too large for linear innovations

    @property
    def white(self) -> FloatArray:
        """Ratio of the white position error to the reported sd, horizontal and vertical, (2,)."""
        return np.asarray(self.position_factor[1:] * np.sqrt(1.0 - self.correlated.share))


def after_rest(alignment: Alignment, assumed: ImuSpec, estimated: ImuSpec) -> Alignment:
    """Reduce the gyro bias sd of a stationary alignment if the estimated in-run instability is smaller than assumed.

    `assumed`: the IMU of the alignment. A larger estimate is ignored: vibration of the drive, absent at rest, may cause
    it. After a long stationary period the sd is kept, too: the bias changes more in it than in a short drive.
    """
    if alignment.static is None or alignment.static[1] - alignment.static[0] >= LONG_REST:
        return alignment
    before, after = assumed.gyro.bias_instability, estimated.gyro.bias_instability
    reduction = before**2 - np.minimum(before, after) ** 2
    return replace(alignment, gyro_bias_sd=np.sqrt(np.maximum(alignment.gyro_bias_sd**2 - reduction, 0.0)))


def start_by(initial: InitialState, alignment: Alignment, model: ErrorModel, factor: FloatArray) -> InitialState:
    """Adapt the initial state to another error model, and to a `factor` (3,) on position sds of fixes."""
    sd = np.sqrt(np.diag(initial.covariance)[:6])
    place = initial.lla, initial.v_n, sd[:3] * factor if initial.from_fix else sd[:3], sd[3:]
    return initial_state(alignment, model, *place, own=initial.own, from_fix=initial.from_fix)
