"""Linear error model of one filter run at epoch rate, on which faults are searched.

The states are navigation errors (9), sensor errors (12), further errors that may act on navigation, others, and nine fault states at the end: offset of
the positions (3), drift of that offset (3) and offset of the velocities (3). Errors are estimate minus truth:
    e_k = F_k e_{k-1} + w_k,  z_k = H_k e_k + v_k.
All functions take the same groups of arrays, for m epochs and n states:
    system: span (m,) [s]; phi (m, 9, s), the rows of navigation errors of F by the first s states, 21 or more; fade (m, n), its diagonal in the other
        rows; q (m, 9, 9), noise of the navigation errors, symmetric; qd (m, n), noise variances of the others, of which
        those of sensor errors j covary with navigation errors i by qd_j phi_ij / 2; cleared (m,) int, bits
        `NO_POSITION` and `NO_VELOCITY`: rows of F of these fault states are zero.
    measured: z (m, 6); h (m, 6, n); var (m, 6), variance of the white noise, not positive where nothing was measured;
        fed (m, n), error that the filter took off its state after the measurement.
    out: innovation (m, 6) and variance (m, 6), -1 where nothing was measured; gain (m, 6, n); mean (m, 9) and rows of
        the covariance (m, 9, n) of the navigation errors just before the measurement.
Components of a measurement are processed one after the other.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES

NO_POSITION, NO_VELOCITY = 1, 2  # bits: offset and drift of positions are over; the offset of velocities is over


@inner()
def read_row(own, span, bits, i, n):  # type: ignore[no-untyped-def]
    """Return the diagonal of F in row `i` beyond navigation, and what multiplies the drift if it is of an offset."""
    position = n - 9 <= i < n - 3
    if (position and bits & NO_POSITION) or (i >= n - 3 and bits & NO_VELOCITY):
        return 0.0, 0.0
    return own, span if position and i < n - 6 else 0.0


@inner()
def propagate(system, k, x, w):  # type: ignore[no-untyped-def]
    """Replace `x` (n, c) by F x; `w` (9, c) is work space."""
    (n, columns), (span, phi, fade, _q, _qd, cleared) = x.shape, system
    for i in range(NAV):
        for j in range(columns):
            total = 0.0
            for a in range(phi.shape[2]):
                total += phi[k, i, a] * x[a, j]
            w[i, j] = total
    for i in range(NAV, n):  # offsets of positions are before their drifts
        own, drift = read_row(fade[k, i], span[k], cleared[k], i, n)
        for j in range(columns):
            x[i, j] *= own
        if drift != 0.0:
            for j in range(columns):
                x[i, j] += drift * x[i + 3, j]
    for i in range(NAV):
        for j in range(columns):
            x[i, j] = w[i, j]


@inner()
def propagate_back(system, k, x, w):  # type: ignore[no-untyped-def]
    """Replace `x` (n, c) by F' x; `w` (9, c) is work space."""
    (n, columns), (span, phi, fade, _q, _qd, cleared) = x.shape, system
    for i in range(NAV):
        for j in range(columns):
            w[i, j], x[i, j] = x[i, j], 0.0
    for i in range(n - 1, NAV - 1, -1):
        own, _ = read_row(fade[k, i], span[k], cleared[k], i, n)
        for j in range(columns):
            x[i, j] *= own
        _, drift = read_row(fade[k, i], span[k], cleared[k], i - 3, n)
        if drift != 0.0:
            for j in range(columns):
                x[i, j] += drift * x[i - 3, j]
    for a in range(phi.shape[2]):
        for j in range(columns):
            total = 0.0
            for i in range(NAV):
                total += phi[k, i, a] * w[i, j]
            x[a, j] += total


@inner()
def transpose(x):  # type: ignore[no-untyped-def]
    """Transpose `x` (n, n) in place."""
    for i in range(x.shape[0]):
        for j in range(i):
            x[i, j], x[j, i] = x[j, i], x[i, j]


@inner()
def mirror(x):  # type: ignore[no-untyped-def]
    """Make `x` (n, n) exactly symmetric by its lower triangle."""
    for i in range(x.shape[0]):
        for j in range(i):
            x[j, i] = x[i, j]


@inner()
def multiply_row(row, x, y):  # type: ignore[no-untyped-def]
    """Fill `y` (c,) with row' x, of which rows (n, c) with a zero entry of `row` (n,) are skipped."""
    for j in range(y.shape[0]):
        y[j] = 0.0
    for a in range(row.shape[0]):
        by = row[a]
        if by != 0.0:
            for j in range(y.shape[0]):
                y[j] += by * x[a, j]


@inner()
def subtract_product(column, row, x):  # type: ignore[no-untyped-def]
    """Subtract column row' from `x` (n, c), where `column` (n,) is not zero."""
    for a in range(column.shape[0]):
        by = column[a]
        if by != 0.0:
            for j in range(row.shape[0]):
                x[a, j] -= by * row[j]


@njit(cache=True, nogil=True)
def forward(system, measured, start, jumps, out):  # type: ignore[no-untyped-def]
    """Run the filter, fill `out`, and return -2 log likelihood without its constant.

    `start`: mean (n,) and covariance (n, n) just before the measurement of epoch 0; `jumps`: epochs (j,) int in
    ascending order, and columns (j, n, 3): J J' is added to the covariance just before the measurement of that epoch.
    """
    (z, h, var, fed), (q, qd), (row, jump) = measured, system[3:5], jumps
    innovation, variance, gain, mean_nav, p_nav = out
    m, n = fed.shape
    mean, p, w, ph = start[0].copy().reshape(n, 1), start[1].copy(), np.empty((NAV, n)), np.empty(n)
    following, total = 0, 0.0
    for k in range(m):
        if k > 0:
            propagate(system, k, mean, w)
            propagate(system, k, p, w)
            transpose(p)
            propagate(system, k, p, w)
            for i in range(NAV):
                for j in range(NAV):
                    p[i, j] += q[k, i, j]
                for j in range(NAV, STATES):  # noise that drives sensor errors acts on navigation half a span later
                    p[j, i] += 0.5 * qd[k, j] * system[1][k, i, j]
            for j in range(NAV, n):
                p[j, j] += qd[k, j]
            mirror(p)
        while following < row.shape[0] and row[following] <= k:
            for c in range(jump.shape[2]):
                for i in range(n):
                    for j in range(n):
                        p[i, j] += jump[following, i, c] * jump[following, j, c]
            following += 1
        mean_nav[k], p_nav[k] = mean[:NAV, 0], p[:NAV]
        for i in range(6):
            if var[k, i] <= 0.0:
                innovation[k, i], variance[k, i], gain[k, i] = 0.0, -1.0, 0.0
                continue
            error, s = z[k, i], var[k, i]
            multiply_row(h[k, i], p, ph)
            for a in range(n):
                error -= h[k, i, a] * mean[a, 0]
                s += h[k, i, a] * ph[a]
            innovation[k, i], variance[k, i] = error, s
            total += np.log(s) + error * error / s
            root = 1.0 / np.sqrt(s)
            for j in range(n):
                gain[k, i, j] = ph[j] / s
                mean[j, 0] += gain[k, i, j] * error
                ph[j] *= root
            subtract_product(ph, ph, p)
        mean[:, 0] -= fed[k]
    return total


@njit(cache=True, nogil=True)
def backward(system, measured, out, r, info, u, uu):  # type: ignore[no-untyped-def]
    """Run the adjoint smoother: what a step of the state at each epoch adds to the log likelihood.

    Fills score `r` (m, n) and information `info` (m, n, n) just before the measurement of each epoch: the smoothed
    error is mean + P r with covariance P - P info P. Fills for each component the smoothing error `u` (m, 6) and its
    variance `uu` (m, 6): the smoothed residual is var * u, with variance var - var^2 uu. Sources: P. de Jong and
    J. Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93 (1998) 796-806; J. Durbin and S. J. Koopman,
    Time Series Analysis by State Space Methods, 2nd ed., Oxford 2012, ch. 4 and 6.4.
    """
    h, (innovation, variance, gain) = measured[1], out[:3]
    m, n = r.shape
    score, p, w, pk = np.zeros((n, 1)), np.zeros((n, n)), np.empty((NAV, n)), np.empty(n)
    for k in range(m - 1, -1, -1):
        for i in range(5, -1, -1):
            u[k, i] = uu[k, i] = 0.0
            if variance[k, i] <= 0.0:
                continue
            error, own = innovation[k, i] / variance[k, i], 1.0 / variance[k, i]
            multiply_row(gain[k, i], p, pk)
            for a in range(n):
                error -= gain[k, i, a] * score[a, 0]
                own += gain[k, i, a] * pk[a]
            u[k, i], uu[k, i] = error, own
            # (I - K h')' N (I - K h') + h h' / s is N - h x' - x h' with x = N K - h uu / 2
            for a in range(n):
                pk[a] -= 0.5 * own * h[k, i, a]
                score[a, 0] += h[k, i, a] * error
            subtract_product(h[k, i], pk, p)
            subtract_product(pk, h[k, i], p)
        mirror(p)
        r[k], info[k] = score[:, 0], p
        if k > 0:
            propagate_back(system, k, score, w)
            propagate_back(system, k, p, w)
            transpose(p)
            propagate_back(system, k, p, w)


@njit(cache=True, nogil=True)
def cross_backward(system, measured, out, info_b, b, g, first):  # type: ignore[no-untyped-def]
    """Return cross information (m, d, d) of steps along `g` (n, d) at epochs `first` to `b` with such at `b`.

    With L the closed-loop transition from just before the measurement of epoch a to that of b, and `info_b` (n, n) the
    information at b, entry a is g' L' info_b g; entries of other epochs are zero.
    """
    n, size = g.shape
    x, y, w = np.empty((n, size)), np.empty(size), np.empty((NAV, size))
    cross = np.zeros((system[0].shape[0], size, size))
    for i in range(n):
        multiply_row(info_b[i], g, x[i])
    for k in range(b, first - 1, -1):
        if k < b:
            propagate_back(system, k + 1, x, w)
            for i in range(5, -1, -1):
                if out[1][k, i] > 0.0:
                    multiply_row(out[2][k, i], x, y)
                    subtract_product(measured[1][k, i], y, x)
        for c in range(size):
            multiply_row(g[:, c], x, cross[k, c])
    return cross


@njit(cache=True, nogil=True)
def cross_forward(system, measured, out, info, a, g, last):  # type: ignore[no-untyped-def]
    """Return cross information (m, d, d) of steps along `g` (n, d) at epochs `a` to `last` with such at `a`.

    With L as in `cross_backward` and `info` (m, n, n) from `backward`, entry b is g' info_b L g; entries of other
    epochs are zero.
    """
    n, size = g.shape
    x, y, w, row = g.copy(), np.empty(size), np.empty((NAV, size)), np.empty(n)
    cross = np.zeros((system[0].shape[0], size, size))
    for k in range(a, last + 1):
        if k > a:
            for i in range(6):
                if out[1][k - 1, i] > 0.0:
                    multiply_row(measured[1][k - 1, i], x, y)
                    subtract_product(out[2][k - 1, i], y, x)
            propagate(system, k, x, w)
        for c in range(size):
            multiply_row(g[:, c], info[k], row)
            multiply_row(row, x, cross[k, c])
    return cross
