"""Likelihood of filter innovations for noise parameters other than the run's, without repeating the run.

A filter has run once; its epochs store transition, measurement and feedback. The error of that nominal run is a linear
system, with noise linear in its spectral densities. Any set of densities thus costs one pass of covariance algebra over
the epochs. This is the innovations form of the likelihood (F. C. Schweppe, "Evaluation of likelihood functions for
Gaussian signals", IEEE Trans. Inf. Theory 11 (1965) 61-70; T. Kailath, "An innovations approach to least-squares
estimation", IEEE Trans. Autom. Control 13 (1968) 646-655).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.kernels import njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.epoch import beyond_linear, count_tilt
from insnav.kernels.errorstate import SENSOR, STATES
from insnav.kernels.smoother import COAST, CORRECTION, JACOBIAN, KIND, NOISE, RESIDUAL, RESTART, STATE, TIME

OPENED = 15  # states to which a reset adds variance: navigation errors and biases
MOST = 40  # length of rows; a filter has up to 35 states. A constant length compiles to faster code


def _white(phi: np.ndarray, span: np.ndarray, column: int) -> np.ndarray:
    """Compute the covariance at the end of each span by unit white noise on three states from `column` on, (m, 9, 9).

    Noise propagates over the time from its occurrence to the end of the span. The blocks of the transition grow as
    powers of this time: attitude to velocity and velocity to position linearly, attitude to position quadratically.
    """
    injected = phi[:, :, column : column + 3]
    power = np.repeat([column // 3 - a if a <= column // 3 else 1 for a in range(3)], 3)
    share = span[:, None, None] / (power[:, None] + power + 1.0)
    return np.asarray(share * (injected @ np.swapaxes(injected, 1, 2)))


def held(transition: np.ndarray) -> np.ndarray:
    """Find, in transitions (m, 9, 21), the epochs of a long stationary period, where the filter ignores the gyros."""
    return np.asarray((transition[:, 6:9, 9:12] == 0.0).all(axis=(1, 2)))


def tape(
    history: np.ndarray, n: int, noise: np.ndarray, bridged: np.ndarray, rounding: Sequence[tuple[Any, ...]] = ()
) -> tuple[np.ndarray, ...]:
    """Extract from the history of a run the input of the innovation likelihood.

    `history` (m, width(n)): epochs, see `insnav.kernels.smoother`. `noise` (20,): spectral densities of the run, see
    `insnav.kernels.errorstate`. `bridged` (m,): a data gap was bridged before the epoch. `rounding`: changes of the
    gyros' rounding error: time [s], variance before and after (3,).
    Returns, for each epoch: time since the previous epoch [s]. Kind, as in the history. Transition (9, 21). Noise of
    unit density of gyros and accelerometers (2, 9, 9), and the factor for misalignment of one rad^2 s (2,). Variance
    added to velocity and attitude by bridging or sway at rest, then the squares for second-order noise, see
    `beyond_linear` of `insnav.kernels.epoch` (9,). Measurement (6,), predicted minus measured, and derivative (6, n).
    Error that the run subtracted from its state (n,). Sensor errors before and after this subtraction (2, 12).
    Variances added to position, velocity, attitude and biases by an explicit reset (15,), else zero. Variances of the
    rounding errors of gyros before and after a change (2, 3), else NaN.
    """
    m, kind, time = history.shape[0], history[:, KIND].astype(np.int64), history[:, TIME]
    span = np.diff(time, prepend=time[:1])
    jacobian, transition, covariance = np.split(
        history[:, JACOBIAN:], [6 * n, history.shape[1] - JACOBIAN - n * (n + 1) // 2], axis=1
    )
    phi = transition[:, : NAV * STATES].reshape(m, NAV, STATES)
    before = np.empty((m, n, n))
    rows, columns = np.tril_indices(n)
    before[:, rows, columns] = before[:, columns, rows] = covariance
    measured = (kind > COAST)[:, None]  # epochs with a measurement
    h = np.where(measured[:, :, None], jacobian.reshape(m, 6, n), 0.0)
    used = measured & (kind[:, None] >> np.arange(6) & 1 > 0)  # (m, 6) components that the run used
    z = np.where(used, history[:, RESIDUAL : RESIDUAL + 6], 0.0)
    of_used = np.where(used[:, :, None], h, 0.0)
    hp = of_used @ before
    both = used[:, :, None] & used[:, None]  # pairs of used components
    noise_of = np.where(both, history[:, NOISE : NOISE + 36].reshape(m, 6, 6), np.eye(6))
    s = hp @ np.swapaxes(of_used, 1, 2) + noise_of  # innovation covariance
    gain = np.linalg.inv(s) @ hp
    reduction = np.swapaxes(gain[:, :, :STATES], 1, 2) @ hp[:, :, :STATES]  # of the covariance
    after = np.roll(before[:, :STATES, :STATES] - reduction, 1, axis=0)  # covariance after the previous epoch
    gyro, accel = _white(phi, span, 6), _white(phi, span, 3)
    still = held(phi)  # in a long stationary period, the filter ignores the gyros
    gyro[still] = 0.0
    by_gyro, own = (np.diagonal(each, axis1=1, axis2=2) for each in (gyro, before))
    # noise beyond white and driving noise comes from misalignment, a bridged gap or a stationary period
    rest = own[:, :NAV] - noise[0] * by_gyro - noise[3] * np.diagonal(accel, axis1=1, axis2=2)
    rest -= np.sum(phi @ after * phi, axis=2)
    fed, state = np.einsum("mi,mij->mj", z, gain), history[:, STATE : STATE + 10]
    change = state[1:, 3:5] + fed[1:, 3:5] - state[:-1, 3:5]
    change = np.sum(np.insert(change, 0, 0.0, axis=0) ** 2, axis=1) * (kind != RESTART)
    tilted = np.zeros(4)
    counted = np.array([count_tilt(tilted, *each) for each in fed[:, 6:8]])
    corrected = np.roll([counted, counted * np.sum(fed[:, 12:15] ** 2, axis=1)], 1, axis=1)
    squares = np.column_stack([change, *corrected])
    second = np.array([beyond_linear(*each)[0] for each in zip(squares, after[:, 8, 8], np.zeros(m), strict=True)])
    rest[:, 3:5] -= second[:, None]
    rest[span <= 0.0] = 0.0
    pushed, turned = (np.maximum(0.0, rest[:, i : i + 3].sum(axis=1)) / 3.0 for i in (3, 6))
    bridge = np.hstack([(bridged | still)[:, None] * np.maximum(0.0, rest[:, 3:]), squares])
    share, open_span = np.zeros((m, 2)), ~bridged & ~still & (span > 0.0)
    if noise[18] > 0.0:
        share[open_span, 0] = (turned / noise[18])[open_span] / span[open_span]
        pushed = np.maximum(0.0, pushed - noise[18] * share[:, 0] * by_gyro[:, 3:6].sum(axis=1) / 3.0)
    if noise[19] > 0.0:
        share[open_span, 1] = (pushed / noise[19])[open_span] / span[open_span]
    restart = own[:, :OPENED] - (np.arange(OPENED) > 5) * np.diagonal(after, axis1=1, axis2=2)[:, :OPENED]
    drawn = np.full((m + 1, 2, 3), np.nan)
    for at, old, new in rounding:
        row = drawn[int(np.searchsorted(time, at - 1e-6))]
        row[:] = np.where(np.isnan(new), row, [np.where(np.isnan(row[0]), old, row[0]), new])
    used_from_now = history[:, CORRECTION : CORRECTION + SENSOR]
    return (
        span,
        kind,
        phi.copy(),
        np.stack([gyro, accel], axis=1),
        share,
        bridge,
        z,
        h,
        fed,
        np.stack([used_from_now + fed[:, NAV:STATES], used_from_now], axis=1),
        restart * (kind == RESTART)[:, None],
        drawn[:m],
    )


@njit(cache=True, nogil=True)
def innovations(  # type: ignore[no-untyped-def]
    run, density, driving, decay, lasting, lasting_sd, lasting_time, variance, start, push, limit, out
):
    """Compute the innovations of the filter under other noise, about the nominal run.

    `run`: from `tape`. `decay` (12,): inverse correlation times of the sensor errors [1/s]. `density` (4,): of white
    noise of gyros and accelerometers, and by misalignment of each. `driving` (12,): driving noise of the sensor errors.
    `lasting`: first state of the time-correlated errors of position, or of position and velocity; negative without.
    `lasting_sd` (k,) [m, m/s], `lasting_time` (k,) [s].
    `variance` (m, 6): white noise of the measurements. `start`: mean (n,) and covariance (n, n) of the error of the
    nominal run. `push` (k, m, 9): known error that each span adds to position, velocity and attitude, then k - 1
    derivatives of it. Overwritten by the mean errors at the end of each epoch and their derivatives. `limit`:
    innovations beyond this many standard deviations are de-weighted (Huber). `out` (k + 1, 6 m): filled with innovation
    and variance of every used component, conditional on earlier components, and derivatives of the innovation. Returns:
    number of components.
    """
    span, kind, phi, white, share, bridge, z, h, fed, correction, restart, drawn = run
    each, n = push.shape[0], start[0].shape[0]
    means = np.zeros((each, n))
    mean = means[0]
    wide = 8 * ((n + 7) // 8)  # columns, padded with zeros to whole vector registers
    p, work = np.zeros((wide, MOST)), np.zeros((19, MOST))
    w, ph, moved = work[:9], work[9:15], work[15]
    fade, last, inverse = work[16], work[17], work[18]
    for i in range(n):
        mean[i], fade[i] = start[0][i], 1.0
        for j in range(n):
            p[i, j] = start[1][i, j]
    lasts = lasting_sd.shape[0] if lasting > 0 else 0
    usual, count = -1.0, 0
    bias, bias_variance = np.zeros((each, 3)), np.ones(3)  # gyro biases without rounding error, at its last change
    for k in range(span.shape[0]):
        dt = span[k]
        if dt > 0.0:
            if abs(dt - usual) > 1e-9:  # decay factors for another time step
                usual = dt
                for j in range(SENSOR):
                    fade[NAV + j] = np.exp(-dt * decay[j])
                for j in range(lasts):
                    fade[lasting + j] = np.exp(-dt / lasting_time[j])
            of_accel = p[NAV + 3, NAV + 3] + p[NAV + 4, NAV + 4] + p[NAV + 5, NAV + 5]
            second, shown = beyond_linear(bridge[k, 6:], p[8, 8] + mean[8] ** 2, of_accel)
            gyro = density[0] + density[2] * share[k, 0]
            accel = density[1] + density[3] * share[k, 1]
            for i in range(NAV):
                for j in range(wide):  # this loop over columns vectorises
                    total = 0.0
                    for a in range(STATES):
                        total += phi[k, i, a] * p[a, j]
                    w[i, j] = total
            for c in range(each):
                for i in range(NAV):
                    total = push[c, k, i]
                    for a in range(STATES):
                        total += phi[k, i, a] * means[c, a]
                    moved[i] = total
                for i in range(NAV):
                    means[c, i] = moved[i]
            for i in range(NAV):
                for j in range(i + 1):
                    total = gyro * white[k, 0, i, j] + accel * white[k, 1, i, j]
                    for a in range(STATES):
                        total += w[i, a] * phi[k, j, a]
                    p[i, j] = p[j, i] = total
            for i in range(6):
                p[3 + i, 3 + i] += bridge[k, i] + (second if i < 2 else 0.0)  # bridged gaps and second-order terms
            for i in range(NAV, n):
                by = fade[i]
                for j in range(8, wide):  # from 8, for whole registers; column 8 is overwritten below
                    p[i, j] *= by * fade[j]
            for i in range(NAV):
                for j in range(NAV, wide):
                    p[i, j] = w[i, j] * fade[j]
                # noise of sensor errors acts on the navigation errors for half the span on average
                for j in range(SENSOR):
                    p[i, NAV + j] += 0.5 * dt * driving[j] * phi[k, i, NAV + j]
            for j in range(NAV, n):
                for i in range(NAV):
                    p[j, i] = p[i, j]
            for c in range(1, each):
                for j in range(NAV, n):
                    means[c, j] *= fade[j]
            for j in range(SENSOR):
                p[NAV + j, NAV + j] += dt * driving[j] + (shown if 3 <= j < 6 else 0.0)
                # the error is relative to the nominal run, which changed its own correction over the span
                mean[NAV + j] = fade[NAV + j] * (mean[NAV + j] - last[j]) + correction[k, 0, j]
            for j in range(3):
                bias_variance[j] += dt * driving[j]
                before, state = drawn[k, 0, j], NAV + j
                if np.isnan(before):  # no change of the rounding error at this epoch
                    continue
                by = bias_variance[j] / (bias_variance[j] + before)  # see `insnav.filter.estimate.Estimate`
                mean[state] -= correction[k, 0, j]
                for c in range(each):
                    means[c, state] = bias[c, j] = bias[c, j] + by * (means[c, state] - bias[c, j])
                mean[state] += correction[k, 0, j]
                for i in range(n):
                    p[state, i] *= by
                for i in range(n):
                    p[i, state] *= by
                bias_variance[j] = p[state, state] + by * before
                p[state, state] = bias_variance[j] + drawn[k, 1, j]
            for j in range(lasts):
                at = lasting + j
                p[at, at] += (1.0 - fade[at] ** 2) * lasting_sd[j] ** 2
                mean[at] *= fade[at]
        if kind[k] == RESTART:  # explicit reset: clear position and velocity, add variance
            for i in range(n):
                if i < 6 or 0 <= i - lasting < lasts:
                    means[:, i] = 0.0
                    for j in range(n):
                        p[i, j] = p[j, i] = 0.0
            for i in range(OPENED):
                p[i, i] += restart[k, i]
            for j in range(lasts):
                at, own = lasting + j, lasting_sd[j] ** 2
                p[at, at] = own
                p[j, j] = max(p[j, j], 1.0001 * own)
                p[j, at] = p[at, j] = -own
        elif kind[k] > COAST:  # measurement: process its components one after the other
            used = 0
            for i in range(6):
                if not kind[k] & (1 << i):
                    continue
                error, s = z[k, i], variance[k, i]
                for j in range(wide):
                    ph[used, j] = 0.0
                for a in range(n):
                    by = h[k, i, a]
                    if by != 0.0:
                        error -= by * mean[a]
                        for j in range(wide):
                            ph[used, j] += by * p[a, j]
                for b in range(used):  # subtract the information of earlier components
                    by = 0.0
                    for a in range(n):
                        by += h[k, i, a] * ph[b, a]
                    by *= inverse[b]
                    for a in range(n):
                        ph[used, a] -= by * ph[b, a]
                for a in range(n):
                    s += h[k, i, a] * ph[used, a]
                out[0, count], out[1, count] = error, s
                far = abs(error) / np.sqrt(s)
                if far > limit:
                    s *= far / limit  # Huber's weight: a larger variance
                inverse[used] = 1.0 / s
                for a in range(n):
                    mean[a] += error / s * ph[used, a]
                for c in range(1, each):
                    error = 0.0
                    for a in range(n):
                        error -= h[k, i, a] * means[c, a]
                    out[1 + c, count] = error
                    if far <= limit:  # beyond the limit, the influence is constant (Huber)
                        for a in range(n):
                            means[c, a] += error / s * ph[used, a]
                used += 1
                count += 1
            for b in range(used, 6):
                inverse[b] = 0.0
            for b in range(0, used, 3):
                for a in range(n):
                    g0, g1, g2 = inverse[b] * ph[b, a], inverse[b + 1] * ph[b + 1, a], inverse[b + 2] * ph[b + 2, a]
                    for j in range(wide):
                        p[a, j] -= g0 * ph[b, j] + g1 * ph[b + 1, j] + g2 * ph[b + 2, j]
            for a in range(n):
                mean[a] -= fed[k, a]  # the run subtracted this error from its state
        for c in range(each):
            for i in range(NAV):
                push[c, k, i] = means[c, i]
        for i in range(SENSOR):
            last[i] = correction[k, 1, i]
    return count
