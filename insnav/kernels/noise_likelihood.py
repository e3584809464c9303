"""Likelihood of the innovations of a filter under other noise than it was run with, without integrating again.

A filter has run once; its epochs keep transition, measurement and feedback. The error of that nominal run is a linear
system whose noise is linear in its spectral densities, so that any set of densities costs one pass of covariance
algebra over the epochs: the innovations form of the likelihood (F. C. Schweppe, "Evaluation of likelihood functions for
Gaussian signals", IEEE Trans. Inf. Theory 11 (1965) 61-70; T. Kailath, "An innovations approach to least-squares
estimation", IEEE Trans. Autom. Control 13 (1968) 646-655).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES
from insnav.kernels.smoother import COAST, CORRECTION, JACOBIAN, KIND, RESIDUAL, RESTART, TIME, used

GROUPS = 4  # of white noise: gyro, accelerometer, gyro misalignment, accelerometer misalignment
GYRO, ACCEL, GYRO_AXES, ACCEL_AXES = 0, 1, 2, 3
OPENED = 15  # states that a reset opens: navigation errors and biases


@njit(cache=True)
def _white(phi, span, column, out):  # type: ignore[no-untyped-def]
    """Noise at the end of a span of unit white noise on three states from `column` on, isotropic, (9, 9).

    Injected at s, it shows at the end by the transition over the rest of the span, whose blocks grow as powers of that
    rest: attitude to velocity and velocity to position with the first, attitude to position with the second.
    """
    for a in range(3):
        power_a = column // 3 - a if a <= column // 3 else 1
        for b in range(3):
            power_b = column // 3 - b if b <= column // 3 else 1
            share = span / (power_a + power_b + 1.0)
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(3):
                        total += phi[3 * a + i, column + k] * phi[3 * b + j, column + k]
                    out[3 * a + i, 3 * b + j] = share * total


@njit(cache=True)
def tape(history, n, noise, decay, bridged):  # type: ignore[no-untyped-def]
    """Take from the history of a run what the likelihood of its innovations needs.

    `history` (m, width(n)): epochs, see `insnav.kernels.smoother`; `noise` (20,), `decay` (12,): spectral densities and
    inverse correlation times [1/s] of the run, see `insnav.kernels.errorstate`; `bridged` (m,): a gap of the samples
    was bridged on the way to the epoch.
    Returns, for each epoch: span since the one before [s]; kind, as in the history; transition (9, 21); noise by group
    of unit density (4, 9, 9), that of misalignment of one rad^2 s; variance that bridging added to velocity, attitude
    (2,); measurement (6,), predicted minus measured, and derivative (6, n); error that the run took off its state (n,);
    sensor errors it used from then on (12,); variances of position, velocity, attitude and biases that an explicit
    reset set or added (15,), zero elsewhere.
    """
    m = history.shape[0]
    span, kind = np.zeros(m), np.zeros(m, dtype=np.int64)
    phi, white = np.zeros((m, NAV, STATES)), np.zeros((m, GROUPS, NAV, NAV))
    bridge, z, h = np.zeros((m, 2)), np.zeros((m, 6)), np.zeros((m, 6, n))
    fed, correction, restart = np.zeros((m, n)), np.zeros((m, SENSOR)), np.zeros((m, OPENED))
    before, after = np.zeros((n, n)), np.zeros((n, n))
    residual, used_h, hp = np.zeros(6), np.zeros((6, n)), np.zeros((6, n))
    unit, rest, row_of = np.zeros((2, NAV, NAV)), np.zeros(NAV), np.zeros(STATES)
    for k in range(m):
        row = history[k]
        kind[k] = int(row[KIND])
        span[k] = row[TIME] - history[k - 1, TIME] if k > 0 else 0.0
        for j in range(SENSOR):  # element by element: assigning slices takes seconds to compile
            correction[k, j] = row[CORRECTION + j]
        at = JACOBIAN + 6 * n
        for i in range(NAV):
            for j in range(STATES):
                phi[k, i, j] = row[at]
                at += 1
        at += n - NAV
        for i in range(n):
            for j in range(i + 1):
                before[i, j] = before[j, i] = row[at]
                at += 1
        if k > 0 and span[k] > 0.0:
            # what white noise and driving noise leave of the whole is that of misalignment, or of a bridged gap
            for g in range(2):
                _white(phi[k], span[k], 6 - 3 * g, unit[g])
            for i in range(NAV):
                for j in range(STATES):
                    row_of[j] = 0.0
                for a in range(STATES):
                    for j in range(STATES):
                        row_of[j] += phi[k, i, a] * after[a, j]
                rest[i] = before[i, i] - (noise[0] * unit[0, i, i] + noise[3] * unit[1, i, i])
                for j in range(STATES):
                    rest[i] -= row_of[j] * phi[k, i, j]
            turned = max(0.0, rest[6] + rest[7] + rest[8]) / 3.0
            pushed = max(0.0, rest[3] + rest[4] + rest[5]) / 3.0
            by_axes = 0.0
            if bridged[k]:
                bridge[k, 0], bridge[k, 1] = pushed, turned
            elif noise[18] > 0.0:
                by_axes = turned / span[k]
                for i in range(3, 6):
                    pushed -= by_axes * unit[0, i, i] / 3.0
            by_push = 0.0
            if not bridged[k] and noise[19] > 0.0:
                by_push = max(0.0, pushed) / noise[19] / span[k]
            for i in range(NAV):
                for j in range(NAV):
                    gyro, accel = unit[0, i, j], unit[1, i, j]
                    white[k, GYRO, i, j], white[k, ACCEL, i, j] = gyro, accel
                    if by_axes > 0.0:
                        white[k, GYRO_AXES, i, j] = gyro * (by_axes / noise[18])
                    white[k, ACCEL_AXES, i, j] = accel * by_push
        if kind[k] == RESTART:
            for i in range(OPENED):
                restart[k, i] = before[i, i] - (after[i, i] if i > 5 else 0.0)
        if kind[k] > COAST:
            for i in range(6):
                z[k, i] = row[RESIDUAL + i]
                for j in range(n):
                    h[k, i, j] = row[JACOBIAN + n * i + j]
        for i in range(n):
            for j in range(n):
                after[i, j] = before[i, j]
        inverse = used(row, n, before, residual, used_h, hp)
        for a in range(inverse.shape[0]):
            for b in range(inverse.shape[0]):
                for i in range(n):
                    share = inverse[a, b] * hp[b, i]  # of the gain
                    fed[k, i] += share * residual[a]
                    for j in range(n):
                        after[i, j] -= share * hp[a, j]
    return span, kind, phi, white, bridge, z, h, fed, correction, restart


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def innovations(  # type: ignore[no-untyped-def]
    run,
    nominal_decay,
    density,
    driving,
    decay,
    lasting,
    lasting_sd,
    lasting_time,
    variance,
    start,
    push,
    limit,
    out,
):
    """Innovations of the filter that other noise makes, about the nominal run.

    `run`: from `tape`; `nominal_decay`, `decay` (12,): inverse correlation times of the sensor errors in the nominal
    run and in the other [1/s]; `density` (4,): of each group of white noise; `driving` (12,): of what drives the sensor
    errors; `lasting`: first of three states of a time-correlated position error, or negative, with `lasting_sd` (3,)
    [m] and `lasting_time` [s]; `variance` (m, 6): white noise of the measurements; `start`: mean (n,) and covariance
    (n, n) of the error of the nominal run; `push` (m, 9): known errors that each span adds to position, velocity and
    attitude, overwritten by the mean of these errors at the end of each epoch; `limit`: an innovation beyond so many
    standard deviations is de-weighted, in the manner of Huber; `out` (2, 6 m): filled with innovation and variance of
    every component of a measurement used, one given those before.
    Returns: number of components.
    """
    span, kind, phi, white, bridge, z, h, fed, correction, restart = run
    mean, p = start[0].copy(), start[1].copy()
    n = mean.shape[0]
    w, fade = np.zeros((NAV, n)), np.ones(n)
    ph, moved = np.zeros(n), np.zeros(NAV)
    last, pace, usual = np.zeros(SENSOR), np.ones(SENSOR), -1.0
    count = 0
    for k in range(span.shape[0]):
        dt = span[k]
        if dt > 0.0:
            if dt != usual:
                usual = dt
                for j in range(SENSOR):
                    fade[NAV + j], pace[j] = np.exp(-dt * decay[j]), np.exp(-dt * nominal_decay[j])
                if lasting >= 0:
                    for j in range(3):
                        fade[lasting + j] = np.exp(-dt / lasting_time)
            f = phi[k]
            for i in range(NAV):
                for j in range(n):  # zeros included: compiled for many columns at a time
                    total = 0.0
                    for a in range(STATES):
                        total += f[i, a] * p[a, j]
                    w[i, j] = total
                moved[i] = 0.0
                for a in range(STATES):
                    moved[i] += f[i, a] * mean[a]
            for i in range(NAV):
                mean[i] = moved[i] + push[k, i]
                for j in range(i + 1):
                    total = 0.0
                    for a in range(STATES):
                        total += w[i, a] * f[j, a]
                    for g in range(GROUPS):
                        total += density[g] * white[k, g, i, j]
                    p[i, j] = total
                for j in range(NAV, n):
                    p[i, j] = w[i, j] * fade[j]
                # noise that drives the sensor errors shows in the navigation errors with half a span's delay
                for j in range(SENSOR):
                    p[i, NAV + j] += 0.5 * dt * driving[j] * f[i, NAV + j]
                for j in range(NAV, n):
                    p[j, i] = p[i, j]
            for i in range(NAV):
                for j in range(i):
                    p[j, i] = p[i, j]
            for i in range(3):
                p[3 + i, 3 + i] += bridge[k, 0]
                p[6 + i, 6 + i] += bridge[k, 1]
            for i in range(NAV, n):
                for j in range(NAV, n):
                    p[i, j] *= fade[i] * fade[j]
            for j in range(SENSOR):
                p[NAV + j, NAV + j] += dt * driving[j]
                # the nominal run let its correction decay at its own pace
                mean[NAV + j] = fade[NAV + j] * mean[NAV + j] + (pace[j] - fade[NAV + j]) * last[j]
            if lasting >= 0:
                for j in range(3):
                    at = lasting + j
                    p[at, at] += (1.0 - fade[at] ** 2) * lasting_sd[j] ** 2
                    mean[at] *= fade[at]
        if kind[k] == RESTART:
            for i in range(6):  # element by element: assigning slices takes seconds to compile
                for j in range(n):
                    p[i, j] = p[j, i] = 0.0
                mean[i] = 0.0
            for i in range(OPENED):
                p[i, i] += restart[k, i]
            if lasting >= 0:
                for j in range(3):
                    at = lasting + j
                    for i in range(n):
                        p[at, i] = p[i, at] = 0.0
                    mean[at] = 0.0
                    p[at, at] = lasting_sd[j] ** 2
                    p[j, j] = max(p[j, j], 1.0001 * lasting_sd[j] ** 2)
                    p[j, at] = p[at, j] = -(lasting_sd[j] ** 2)
        elif kind[k] > COAST:
            for i in range(6):
                if not kind[k] & (1 << i):
                    continue
                for j in range(n):
                    ph[j] = 0.0
                error = z[k, i]
                for a in range(n):
                    share = h[k, i, a]
                    if share != 0.0:
                        error -= share * mean[a]
                        source = p[a]
                        for j in range(n):
                            ph[j] += share * source[j]
                s = variance[k, i]
                for a in range(n):
                    s += h[k, i, a] * ph[a]
                out[0, count], out[1, count] = error, s
                count += 1
                far = abs(error) / np.sqrt(s)
                if far > limit:
                    s *= far / limit
                inv = 1.0 / s
                for a in range(n):
                    share = ph[a] * inv
                    mean[a] += share * error
                    target = p[a]
                    for j in range(n):
                        target[j] -= share * ph[j]
            for a in range(n):
                mean[a] -= fed[k, a]
        for i in range(NAV):
            push[k, i] = mean[i]
        last = correction[k]
    return count
