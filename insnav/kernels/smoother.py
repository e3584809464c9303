"""Fixed-interval smoother: propagates the information of later measurements backwards through the filter's epochs.

The backward pass is the Bryson-Frazier smoother in Bierman's discrete form ("Fixed interval smoothing with discrete
measurements", Int. J. Control 18 (1973) 65-75). It uses an adjoint vector and matrix, not inverses of covariances,
which are singular where a state is known. Errors are estimate minus truth. The filter is closed-loop and expects every
error to be zero: the smoothed error comes from later data alone.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES, at_fix_time, feed_back, less_sure
from insnav.kernels.measurements import inverse

# first column of each quantity in a row of the history
TIME, KIND, SOURCE, STATE, CORRECTION, ARM, RESIDUAL, NOISE = 0, 1, 2, 3, 13, 25, 37, 43
JACOBIAN = NOISE + 36
COAST, RESTART = 0, -1  # values of `KIND` without a measurement; otherwise one bit for each used row
POSITION, VELOCITY = 7, 56  # bits of `KIND` for the three rows of position and of velocity
FIX, AIDING = 1, 2  # values of `SOURCE`


def width(n: int) -> int:
    """Return the row width of the history of a filter with `n` states."""
    return JACOBIAN + 6 * n + NAV * STATES + (n - NAV) + n * (n + 1) // 2


@njit(cache=True)
def keep(row, time, x, correction, arm, phi, p):  # type: ignore[no-untyped-def]
    """Store a filter epoch: state (10,), sensor errors (12,) and covariance before its measurement, at `time` [s].

    `arm` (12,): see `insnav.kernels.measurements.correct_with_arm`. `phi`: transition from the previous epoch. `row`
    (width(n),): filled.
    """
    n = p.shape[0]
    row[TIME] = time
    row[KIND] = COAST
    row[SOURCE] = 0.0
    keep_state(row, x, correction, arm)
    at = JACOBIAN + 6 * n
    for i in range(NAV):
        for j in range(STATES):
            row[at] = phi[i, j]
            at += 1
    for i in range(NAV, n):
        row[at] = phi[i, i]
        at += 1
    for i in range(n):
        for j in range(i + 1):
            row[at] = p[i, j]
            at += 1


@njit(cache=True)
def keep_state(row, x, correction, arm):  # type: ignore[no-untyped-def]
    """Store the state after the measurement."""
    for i in range(10):
        row[STATE + i] = x[i]
    for i in range(SENSOR):
        row[CORRECTION + i] = correction[i]
        row[ARM + i] = arm[i]


@njit(cache=True)
def keep_measurement(row, kind, source, z, h, r):  # type: ignore[no-untyped-def]
    """Store the measurement of an epoch: predicted minus measured, its derivative and its covariance."""
    row[KIND] = kind
    row[SOURCE] = source
    n = h.shape[1]
    for i in range(6):
        row[RESIDUAL + i] = z[i]
        for j in range(6):
            row[NOISE + 6 * i + j] = r[i, j]
        for j in range(n):
            row[JACOBIAN + n * i + j] = h[i, j]


@inner()
def _used(row, n, p, z, h, hp, chosen):  # type: ignore[no-untyped-def]
    """Select the used rows of a measurement: ``z``, ``H`` and ``H P``; return the inverse of ``H P H' + R``.

    `row` (width(n),). `p` (n, n): covariance before the measurement. Filled from the first row on: `z` (6,), `h`, `hp`
    (6, n). `chosen` (6,): work space.
    Returns: inverse (m, m) for m used rows; m is 0 without a measurement.
    """
    m, kind = 0, int(row[KIND])
    for i in range(6):
        if kind > COAST and kind & (1 << i):
            chosen[m] = i
            m += 1
    s = np.zeros((m, m))
    for i in range(m):
        at = int(chosen[i])
        z[i] = row[RESIDUAL + at]
        for j in range(n):
            h[i, j] = row[JACOBIAN + n * at + j]
            hp[i, j] = 0.0
        for a in range(n):
            share = h[i, a]
            if share != 0.0:
                for j in range(n):
                    hp[i, j] += share * p[a, j]
        for j in range(i + 1):
            total = row[NOISE + 6 * at + int(chosen[j])]
            for a in range(n):
                total += hp[i, a] * h[j, a]
            s[i, j] = s[j, i] = total
    return inverse(s)


@inner()
def _product(a, b, rows, out):  # type: ignore[no-untyped-def]
    """Multiply the first rows of a matrix with a square matrix, four rows at a time."""
    n = b.shape[0]
    fours = n - n % 4
    for i in range(rows):
        for j in range(n):
            out[i, j] = 0.0
        for k in range(0, fours, 4):
            a0, a1, a2, a3 = a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3]
            for j in range(n):
                out[i, j] += a0 * b[k, j] + a1 * b[k + 1, j] + a2 * b[k + 2, j] + a3 * b[k + 3, j]
        for k in range(fours, n):
            for j in range(n):
                out[i, j] += a[i, k] * b[k, j]


@njit(cache=True)
def backward(  # type: ignore[no-untyped-def]
    history, n, least, adjoint, information, after, before, covariance, variance, innovations
):
    """Propagate the adjoint backwards through some epochs, and compute the smoothed errors there.

    `history` (m, width(n)): epochs in order of time. `least`: smallest sd of the delay [s]. `adjoint` (n,),
    `information` (n, n): after the last epoch, zero at the end of the record. On return: after the epoch before the
    first. Filled: `after`, `before` (m, 21): smoothed error of the filter's state after and before the measurement.
    `covariance` (m, 9, 9) of smoothed position, velocity and attitude, as in `at_fix_time`. `variance` (m, 12) of the
    smoothed sensor errors. `innovations` (m, 25), at fixes, else ``NaN``: predicted minus measured, and variance of the
    prediction. Columns 0 to 11 are filtered, 12 to 23 smoothed. Column 24: the filter's variance of attitude about
    Down.
    """
    p, part, kept, lines = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((4, n))
    h, hp, weight, by = np.zeros((6, n)), np.zeros((6, n)), np.zeros((6, n)), np.zeros((6, n))
    z, pull, x, moved, rows = lines[0], lines[1], lines[2], lines[3], min(n, STATES + 1)
    for k in range(history.shape[0] - 1, -1, -1):
        row = history[k]
        at = JACOBIAN + 6 * n + NAV * STATES + n - NAV
        for i in range(n):
            for j in range(i + 1):
                p[i, j] = p[j, i] = row[at]
                at += 1
        s = _used(row, n, p, z, h, hp, pull)
        m = s.shape[0]
        # adjoint before the measurement: (I - K H)' adjoint + H' S^-1 z, with the gain K = P H' S^-1
        for i in range(m):
            pull[i] = 0.0
            for j in range(n):
                weight[i, j] = 0.0  # row i of S^-1 H
                for a in range(m):
                    weight[i, j] += s[i, a] * h[a, j]
                pull[i] += hp[i, j] * adjoint[j]
        for j in range(n):
            for i in range(m):
                adjoint[j] -= weight[i, j] * pull[i]
        for i in range(STATES):
            total = 0.0
            for j in range(n):
                total += p[i, j] * adjoint[j]
            after[k, i] = total
        for j in range(n):
            for i in range(m):
                adjoint[j] += weight[i, j] * z[i]
        # `(I - K H)' information (I - K H) + H' S^-1 H = information + u w' + w u'`, symmetric, where `w = S^-1 H`
        # and `u = (w H P information P H' + H) / 2 - H P information`
        _product(hp, information, m, by)
        for a in range(m):
            for c in range(m):
                pull[c] = 0.0
                for j in range(n):
                    pull[c] += by[a, j] * hp[c, j]
            for j in range(n):
                total = h[a, j]
                for c in range(m):
                    total += pull[c] * weight[c, j]
                part[a, j] = 0.5 * total - by[a, j]
        for a in range(m):
            for i in range(n):
                left, right = part[a, i], weight[a, i]
                for j in range(n):
                    information[i, j] += left * weight[a, j] + right * part[a, j]
        _product(p, information, rows, part)
        for i in range(n):
            moved[i] = 0.0  # error before the measurement
            for j in range(n):
                moved[i] += p[i, j] * adjoint[j]
        for i in range(rows):  # smoothed covariance, only the required elements
            for j in range(i + 1):
                if j == i or (j < NAV and not NAV <= i < STATES):
                    kept[i, j] = p[i, j]
                    for a in range(n):
                        kept[i, j] -= part[i, a] * p[j, a]
                    kept[j, i] = kept[i, j]
        for i in range(STATES):
            before[k, i] = moved[i]
        for i in range(SENSOR):
            variance[k, i] = kept[NAV + i, NAV + i]
        for i in range(10):
            x[i] = row[STATE + i]
        at_fix_time(less_sure(kept, least), x, covariance[k])
        _compare(row, n, p, information, moved, h, by, innovations[k])
        _past(row, n, adjoint, information, part, moved)


@inner()
def _past(row, n, adjoint, information, part, moved):  # type: ignore[no-untyped-def]
    """Propagate adjoint and information to the previous epoch; `part` (n, n), `moved` (n,): work space."""
    rest = 0.0 if int(row[KIND]) == RESTART else 1.0  # later measurements carry no information on states before a reset
    first, at = JACOBIAN + 6 * n, JACOBIAN + 6 * n + NAV * STATES - NAV
    # phi = [[A, B], [0, diag(d)]]: information phi, then phi' times the product
    for i in range(n):
        for j in range(STATES):
            total = 0.0
            for k in range(NAV):
                total += information[i, k] * row[first + k * STATES + j]
            part[i, j] = total
        for j in range(NAV, n):
            part[i, j] = information[i, j] * row[at + j] + (part[i, j] if j < STATES else 0.0)
        moved[i] = adjoint[i] * row[at + i] if i >= NAV else 0.0
    for k in range(NAV):
        for j in range(STATES):
            moved[j] += row[first + k * STATES + j] * adjoint[k]
    for i in range(n):
        adjoint[i] = rest * moved[i]
        for j in range(n):
            information[i, j] = row[at + i] * part[i, j] if i >= NAV else 0.0
        for j in range(n if i < STATES else 0):
            total = information[i, j]
            for k in range(NAV):
                total += row[first + k * STATES + i] * part[k, j]
            information[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            information[i, j] *= rest
            information[j, i] = information[i, j]


@inner()
def _compare(row, n, p, information, error, hp, by, out):  # type: ignore[no-untyped-def]
    """Compute a fix's innovation and variance by filter and smoother; `hp`, `by` (6, n): work space."""
    if row[SOURCE] != FIX:
        for i in range(25):
            out[i] = np.nan
        return
    for i in range(6):
        for j in range(n):
            hp[i, j] = 0.0
        for a in range(n):
            share = row[JACOBIAN + n * i + a]
            if share != 0.0:
                for j in range(n):
                    hp[i, j] += share * p[a, j]
    _product(hp, information, hp.shape[0], by)  # a literal 6 would make numba compile `_product` again
    for i in range(6):
        shift, before, explained = 0.0, 0.0, 0.0
        for j in range(n):
            h = row[JACOBIAN + n * i + j]
            shift += h * error[j]
            before += h * hp[i, j]
            explained += by[i, j] * hp[i, j]
        out[i], out[6 + i] = row[RESIDUAL + i], before
        out[12 + i], out[18 + i] = row[RESIDUAL + i] - shift, before - explained
    out[24] = p[8, 8]


@njit(cache=True)
def correct(time, state, epoch, after, before):  # type: ignore[no-untyped-def]
    """Correct the filter's states by the smoothed errors, also between epochs.

    The error is smooth between two epochs. Position error follows the cubic through position and velocity errors at
    both ends. All other errors follow a straight line.

    `time` (n,) [s], `state` (n, 10): filter's states, after the measurement where there was one, changed in place.
    `epoch` (m,): times of the epochs [s]. `after`, `before`: from `backward`.
    """
    m, k, end = epoch.shape[0], 0, epoch.shape[0]
    while k + 1 < end:  # binary search; numpy's would double the compile time
        middle = (k + end) // 2
        if epoch[middle] < time[0]:
            k = middle
        else:
            end = middle
    error, unused = np.zeros(STATES), np.zeros(SENSOR)
    for row in range(time.shape[0]):
        t = time[row]
        while k + 1 < m and epoch[k + 1] <= t + 1e-6:
            k += 1
        if t < epoch[k] - 1e-6 or (k + 1 == m and t > epoch[k] + 1e-6):
            continue  # no correction without an epoch before and after this time
        span = epoch[k + 1] - epoch[k] if t > epoch[k] + 1e-6 else 0.0
        for i in range(NAV):
            error[i] = after[k, i]
        if span > 0.0:
            share = (t - epoch[k]) / span
            rest, blend = 1.0 - share, share * share * (3.0 - 2.0 * share)  # cubic Hermite interpolation
            for i in range(3):
                bend = rest * after[k, 3 + i] - share * before[k + 1, 3 + i]
                error[i] = (1.0 - blend) * after[k, i] + blend * before[k + 1, i] + span * share * rest * bend
            for i in range(3, NAV):
                error[i] = rest * after[k, i] + share * before[k + 1, i]
        feed_back(state[row], unused, error)
