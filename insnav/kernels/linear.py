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

BLOCKS, WIDE = 8, 72  # blocks of nine rows, as many as states of navigation; states at most: compilers like known sizes
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


@inner(forceinline=True)
def fill_zeros(rows, columns):  # type: ignore[no-untyped-def]
    """Zeros (rows, columns) from the start of a cache line on: a load across two lines takes twice as long."""
    flat = np.zeros(rows * columns + 7)
    first = -(flat.ctypes.data // 8) % 8
    return flat[first : first + rows * columns].reshape(rows, columns)


@inner(forceinline=True)
def add_product(y, i, by, k, x, blocks, columns):  # type: ignore[no-untyped-def]
    """Add row `k` of `by` (..., blocks, 9) times `x` (blocks, 9, ...) to row `i` of `y`, for so many columns."""
    for a in range(blocks):
        b0, b1, b2, b3, b4 = by[k, a, 0], by[k, a, 1], by[k, a, 2], by[k, a, 3], by[k, a, 4]
        b5, b6, b7, b8 = by[k, a, 5], by[k, a, 6], by[k, a, 7], by[k, a, 8]
        for j in range(columns):
            part = b0 * x[a, 0, j] + b1 * x[a, 1, j] + b2 * x[a, 2, j] + b3 * x[a, 3, j] + b4 * x[a, 4, j]
            y[i, j] += part + b5 * x[a, 5, j] + b6 * x[a, 6, j] + b7 * x[a, 7, j] + b8 * x[a, 8, j]


@inner(forceinline=True)
def subtract_three(y, i, by, x, columns):  # type: ignore[no-untyped-def]
    """Subtract the product of column `i` of `by` (3, ...) with `x` (3, ...) from row `i` of `y`."""
    b0, b1, b2 = by[0, i], by[1, i], by[2, i]
    for j in range(columns):
        y[i, j] -= b0 * x[0, j] + b1 * x[1, j] + b2 * x[2, j]


@inner(forceinline=True)
def inner_product(x, i, y, k, n):  # type: ignore[no-untyped-def]
    """Product of row `i` of `x` with row `k` of `y`, which are zero beyond `n` up to a multiple of four."""
    s0 = s1 = s2 = s3 = 0.0
    for j in range(0, n, 4):
        s0 += x[i, j] * y[k, j]
        s1 += x[i, j + 1] * y[k, j + 1]
        s2 += x[i, j + 2] * y[k, j + 2]
        s3 += x[i, j + 3] * y[k, j + 3]
    return (s0 + s2) + (s1 + s3)


@inner(forceinline=True)
def shear(p, i, a, own, by, columns):  # type: ignore[no-untyped-def]
    """Replace state `i` in symmetric `p` by own times it plus by times state `a`, as a row and as a column."""
    for j in range(columns):
        p[i, j] = own * p[i, j] + by * p[a, j]
    p[i, i] = own * p[i, i] + by * p[i, a]
    for j in range(columns):
        p[j, i] = p[i, j]


@inner()
def read_transition(system, k, f, ft, d):  # type: ignore[no-untyped-def]
    """Fill `f` (9, ...) and `ft` (..., 16) with rows of navigation of F and their transpose, `d` (n,) with its diagonal."""
    span, phi, fade, cleared = system[0], system[1], system[2], system[5]
    n = fade.shape[1]
    for i in range(NAV):
        for a in range(phi.shape[2]):
            f[i, a] = ft[a, i] = phi[k, i, a]
    for i in range(NAV, n - 9):
        d[i] = fade[k, i]
    for i in range(n - 9, n):
        d[i], _ = read_row(fade[k, i], span[k], cleared[k], i, n)


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
    (m, n), s = fed.shape, system[1].shape[2]
    assert n <= WIDE
    p, ft, w, f, mean = fill_zeros(WIDE, WIDE), fill_zeros(WIDE, WIDE), fill_zeros(NAV, WIDE), fill_zeros(NAV, WIDE), fill_zeros(1, WIDE)
    p9, ft9 = p.reshape(BLOCKS, NAV, WIDE), ft.reshape(BLOCKS, NAV, WIDE)  # as factors
    w9, f9, mean9 = w.reshape(NAV, BLOCKS, NAV), f.reshape(NAV, BLOCKS, NAV), mean.reshape(1, BLOCKS, NAV)
    nav, ph, d, at = fill_zeros(NAV + 1, 16), fill_zeros(3, WIDE), np.ones(WIDE), np.empty(n, np.int64)
    short = (s + NAV - 1) // NAV
    mean[0, :n], p[:n, :n] = start
    live, following, total = n, 0, 0.0
    for k in range(m):
        while live > s and p[live - 1, live - 1] == 0.0:  # known exactly, as faults before they begin
            live -= 1
        wide = 8 * ((live + 7) // 8)
        if k > 0:
            read_transition(system, k, f, ft, d)
            for i in range(n - 9, n - 6):
                own, drift = read_row(system[2][k, i], system[0][k], system[5][k], i, n)
                if drift != 0.0:
                    mean[0, i] = own * mean[0, i] + drift * mean[0, i + 3]
                    d[i] = 1.0
                    if live > n - 9:
                        shear(p, i, i + 3, own, drift, wide)
            w[:], nav[:] = 0.0, 0.0
            add_product(nav, NAV, mean9, 0, ft9, short, 16)
            for i in range(NAV):
                add_product(w, i, f9, i, p9, short, wide)
                add_product(nav, i, w9, i, ft9, short, 16)
            for i in range(NAV, live):
                own = d[i]
                for j in range(wide):
                    p[i, j] *= own * d[j]
            for i in range(NAV):
                for j in range(wide):
                    p[i, j] = w[i, j] * d[j]
                for j in range(NAV, STATES):  # noise that drives sensor errors acts on navigation half a span later
                    p[i, j] += 0.5 * qd[k, j] * f[i, j]
                for j in range(i + 1):
                    p[i, j] = p[j, i] = nav[i, j] + q[k, i, j]
                mean[0, i] = nav[NAV, i]
            for j in range(NAV, n):
                mean[0, j] *= d[j]
                if qd[k, j] > 0.0:
                    p[j, j] += qd[k, j]
                    live = max(live, j + 1)
                for i in range(NAV):
                    p[j, i] = p[i, j]
        while following < row.shape[0] and row[following] <= k:
            for i in range(n):
                for c in range(jump.shape[2]):
                    by = jump[following, i, c]
                    if by != 0.0:
                        live = max(live, i + 1)
                        for j in range(n):
                            p[i, j] += by * jump[following, j, c]
            following += 1
        wide = 8 * ((live + 7) // 8)
        for i in range(NAV):
            mean_nav[k, i] = mean[0, i]
            for j in range(n):
                p_nav[k, i, j] = p[i, j]
        for first in (0, 3):
            used = False
            for c in range(3):
                i = first + c
                ph[c] = 0.0
                if var[k, i] <= 0.0:
                    innovation[k, i], variance[k, i], gain[k, i] = 0.0, -1.0, 0.0
                    continue
                used, error, own, count = True, z[k, i], var[k, i], 0
                for a in range(n):
                    by = h[k, i, a]
                    if by != 0.0:
                        error -= by * mean[0, a]
                        at[count] = a
                        count += 1
                        for j in range(wide):
                            ph[c, j] += by * p[a, j]
                for b in range(c):  # less what the components before have told
                    by = 0.0
                    for a in at[:count]:
                        by += h[k, i, a] * ph[b, a]
                    for j in range(wide):
                        ph[c, j] -= by * ph[b, j]
                for a in at[:count]:
                    own += h[k, i, a] * ph[c, a]
                innovation[k, i], variance[k, i] = error, own
                total += np.log(own) + error * error / own
                root = 1.0 / np.sqrt(own)
                for j in range(n):
                    ph[c, j] *= root
                    gain[k, i, j] = ph[c, j] * root
                    mean[0, j] += gain[k, i, j] * error
            if used:
                for a in range(live):
                    subtract_three(p, a, ph, ph, wide)
        for j in range(n):
            mean[0, j] -= fed[k, j]
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
    (m, n), s = r.shape, system[1].shape[2]
    assert n <= WIDE
    wide, short = 8 * ((n + 7) // 8), 8 * ((s + 7) // 8)
    p, t, f, ft = fill_zeros(WIDE, WIDE), fill_zeros(2 * NAV, WIDE), fill_zeros(NAV, WIDE), fill_zeros(WIDE, WIDE)
    score, x, hs, ks = fill_zeros(1, WIDE), fill_zeros(3, WIDE), fill_zeros(3, WIDE), fill_zeros(3, WIDE)
    p9, t9, f9, pt9 = p.reshape(BLOCKS, NAV, WIDE), t.reshape(2, NAV, WIDE), f.reshape(1, NAV, WIDE), p.reshape(WIDE, BLOCKS, NAV)
    ft9, score9, ks9, by = ft.reshape(WIDE, BLOCKS, NAV), score.reshape(1, BLOCKS, NAV), ks.reshape(3, BLOCKS, NAV), np.zeros((1, 1, NAV))
    d, fades, offset = np.zeros(WIDE), np.empty(3), n - 9  # d of navigation stays zero
    for k in range(m - 1, -1, -1):
        for first in (3, 0):
            u[k, first : first + 3] = uu[k, first : first + 3] = 0.0
            if max(variance[k, first], variance[k, first + 1], variance[k, first + 2]) <= 0.0:
                continue
            x[:] = 0.0
            for c in range(3):
                for j in range(n):  # zero where nothing was measured
                    hs[c, j], ks[c, j] = h[k, first + c, j], gain[k, first + c, j]
                if variance[k, first + c] <= 0.0:
                    hs[c] = 0.0
            terms = n
            while terms > 0 and ks[0, terms - 1] == 0.0 and ks[1, terms - 1] == 0.0 and ks[2, terms - 1] == 0.0:
                terms -= 1
            for c in range(3):
                add_product(x, c, ks9, c, p9, (terms + NAV - 1) // NAV, wide)
            for c in range(2, -1, -1):
                i = first + c
                if variance[k, i] <= 0.0:
                    continue
                error = innovation[k, i] / variance[k, i] - inner_product(ks, c, score, 0, n)
                own = 1.0 / variance[k, i] + inner_product(ks, c, x, c, n)
                u[k, i], uu[k, i] = error, own
                # (I - K h')' N (I - K h') + h h' / s is N - h x' - x h' with x = N K - h uu / 2
                for j in range(wide):
                    x[c, j] -= 0.5 * own * hs[c, j]
                    score[0, j] += error * hs[c, j]
                for b in range(c):
                    of_h, of_x = inner_product(ks, b, hs, c, n), inner_product(ks, b, x, c, n)
                    for j in range(wide):
                        x[b, j] -= of_h * x[c, j] + of_x * hs[c, j]
            for a in range(n):
                subtract_three(p, a, x, hs, wide)
                if hs[0, a] != 0.0 or hs[1, a] != 0.0 or hs[2, a] != 0.0:
                    subtract_three(p, a, hs, x, wide)
        for i in range(n):
            r[k, i] = score[0, i]
            for j in range(i):
                p[j, i] = p[i, j]
        drift = 0.0
        if k > 0:
            read_transition(system, k, f, ft, d)
            _, drift = read_row(system[2][k, offset], system[0][k], system[5][k], offset, n)
            for c in range(3):
                fades[c] = d[offset + 3 + c]
            for i in range(NAV + 1):
                for j in range(wide):
                    t[i, j] = d[j] * (p[i, j] if i < NAV else score[0, j])
                for j in range(offset, offset + 3):
                    t[i, j + 3] += drift * (p[i, j] if i < NAV else score[0, j])
                if i < NAV:
                    add_product(t, i, pt9, i, f9, 1, short)
            add_product(t, NAV, score9, 0, f9, 1, short)
            for j in range(wide):
                score[0, j] = t[NAV, j]
            if drift != 0.0:
                d[offset + 3 : offset + 6] = 1.0
        for a in range(n - 1, -1, -1):  # drifts before the offsets that they move
            for j in range(n):  # beside the work on it: memory is slow
                info[k, a, j] = p[a, j]
            if k == 0:
                continue
            if drift != 0.0:
                if offset + 3 <= a < offset + 6:
                    for j in range(wide):
                        p[a, j] = fades[a - offset - 3] * p[a, j] + drift * p[a - 3, j]
                for c in range(3):
                    p[a, offset + 3 + c] = fades[c] * p[a, offset + 3 + c] + drift * p[a, offset + c]
            for c in range(NAV):
                by[0, 0, c] = d[a] * p[a, c]
            for j in range(wide):
                p[a, j] *= d[a] * d[j]
            if a >= NAV:
                add_product(p, a, by, 0, f9, 1, short)
            if a < s:
                add_product(p, a, ft9, a, t9, 1, wide)


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
