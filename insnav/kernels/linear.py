"""Linear error model of one filter run at epoch rate, on which faults are searched.

The states are navigation errors (9), sensor errors (12), further errors that may act on navigation, and other states.
The last nine are fault states: offset of the positions (3), drift of this offset (3), offset of the velocities (3).
Errors are estimate minus truth: ``e_k = F_k e_{k-1} + w_k``, ``z_k = H_k e_k + v_k``.
Functions take the same groups of arrays, for m epochs and n states.

- `system`:
  - span (m,) [s];
  - phi (m, 9, s), the rows of navigation errors of F, for the first s states (21 or more);
  - fade (m, n), the diagonal of F in the other rows;
  - q (m, 9, 9), noise of the navigation errors, symmetric;
  - qd (m, n), noise variances of the others; sensor error j covaries with navigation error i by ``qd_j phi_ij / 2``;
  - cleared (m,) int, bits `NO_POSITION` and `NO_VELOCITY`: the rows of F of these fault states are zero.
- `measured`:
  - z (m, 6); h (m, 6, n);
  - var (m, 6), variance of the white noise, not positive if nothing was measured;
  - fed (m, n), error that the filter subtracted from its state after the measurement.
- `out`:
  - innovation (m, 6) and variance (m, 6), -1 if nothing was measured;
  - gain (m, 6, n);
  - numbers (c,) int of some states, with their mean (m, c) and rows of the covariance (m, c, n) before the measurement.

Components of a measurement are processed one after the other, and change matrices in groups. Rows are padded by
zeros. The covariance of states at the end that are known exactly, such as faults before they begin, is not changed.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES

NO_POSITION, NO_VELOCITY = 1, 2  # bits: offset and drift of positions are over; the offset of velocities is over


@inner(forceinline=True)
def make_rows(count, width):  # type: ignore[no-untyped-def]
    """Return zeros (count, width) aligned with a cache line, as loads across two lines take longer."""
    flat = np.zeros(count * width + 7)
    first = -(flat.ctypes.data // 8) % 8
    return flat[first : first + count * width].reshape(count, width)


@inner(forceinline=True)
def padded(columns):  # type: ignore[no-untyped-def]
    """Round up to a multiple of 8, the step of a vectorized loop, which takes remaining numbers one at a time."""
    return 8 * ((columns + 7) // 8)


@inner(forceinline=True)
def add_product(y, i, by, k, x, blocks, columns):  # type: ignore[no-untyped-def]
    """Add row `k` of `by` times `x` (blocks, 9, ...) to row `i` of `y`, in the first `columns`."""
    for a in range(blocks):
        c = NAV * a
        b0, b1, b2, b3, b4 = by[k, c], by[k, c + 1], by[k, c + 2], by[k, c + 3], by[k, c + 4]
        b5, b6, b7, b8 = by[k, c + 5], by[k, c + 6], by[k, c + 7], by[k, c + 8]
        for j in range(columns):
            part = b0 * x[a, 0, j] + b1 * x[a, 1, j] + b2 * x[a, 2, j] + b3 * x[a, 3, j] + b4 * x[a, 4, j]
            y[i, j] += part + b5 * x[a, 5, j] + b6 * x[a, 6, j] + b7 * x[a, 7, j] + b8 * x[a, 8, j]


@inner(forceinline=True)
def subtract_products(y, i, a, x, b, z, columns):  # type: ignore[no-untyped-def]
    """Subtract row `i` of a' x + b' z, for matrices (3, ...), from row `i` of `y`, in the first `columns`."""
    a0, a1, a2, b0, b1, b2 = a[0, i], a[1, i], a[2, i], b[0, i], b[1, i], b[2, i]
    for j in range(columns):
        part = a0 * x[0, j] + a1 * x[1, j] + a2 * x[2, j]
        y[i, j] -= part + b0 * z[0, j] + b1 * z[1, j] + b2 * z[2, j]


@inner(forceinline=True, fastmath={"contract", "reassoc"})  # else each addition waits for the addition before
def inner_product(x, i, y, k, columns):  # type: ignore[no-untyped-def]
    """Compute the inner product of row `i` of `x` and row `k` of `y`, over the first `columns`."""
    total = 0.0
    for j in range(columns):
        total += x[i, j] * y[k, j]
    return total


@inner()
def read_transition(system, k, f, d):  # type: ignore[no-untyped-def]
    """Read F: rows of navigation into `f`, the diagonal of the others into `d`. Return the drift time [s]."""
    span, phi, fade, _q, _qd, cleared = system
    n = fade.shape[1]
    f[:, : phi.shape[2]], d[NAV:n] = phi[k], fade[k, NAV:]
    if cleared[k] & NO_POSITION:
        d[n - 9 : n - 3] = 0.0
    if cleared[k] & NO_VELOCITY:
        d[n - 3 : n] = 0.0
    return 0.0 if cleared[k] & NO_POSITION else span[k]


@inner(forceinline=True)
def propagate(x, c, d, drift, ft9, blocks, nav, n):  # type: ignore[no-untyped-def]
    """Replace row `c` of `x` by F times this row, F from `read_transition`: `ft9` in blocks, `d`, time `drift` [s].

    `blocks`: number of blocks that navigation errors depend on. `nav` (1, 16): work space.
    """
    nav[:] = 0.0
    add_product(nav, 0, x, c, ft9, blocks, 16)
    for j in range(NAV, n):  # the position offset grows by its drift, which later turns of this loop change
        x[c, j] *= d[j]
        if n - 9 <= j < n - 6:
            x[c, j] += drift * x[c, j + 3]
    x[c, :NAV] = nav[0, :NAV]


@inner(forceinline=True)
def propagate_back(y, i, x, c, d, drift, f9, short, n):  # type: ignore[no-untyped-def]
    """Fill row `i` of `y` with row `c` of `x` times F, whose first `short` columns are not diagonal."""
    for j in range(n):
        y[i, j] = d[j] * x[c, j]
    for j in range(n - 9, n - 6):
        y[i, j + 3] += drift * x[c, j]
    add_product(y, i, x, c, f9, 1, short)


@inner(forceinline=True)
def move_drift(p, i, a, d, drift, columns):  # type: ignore[no-untyped-def]
    """Replace state `i` in symmetric `p`, as row and as column, by ``d[i]`` times it plus `drift` times state `a`."""
    for j in range(columns):
        p[i, j] = d[i] * p[i, j] + drift * p[a, j]
    p[i, i] = d[i] * p[i, i] + drift * p[i, a]
    for j in range(columns):
        p[j, i] = p[i, j]
    d[i] = 1.0


@inner(forceinline=True)
def close_loop(x, size, by, along, i, columns):  # type: ignore[no-untyped-def]
    """Subtract, from each of `size` rows of `x`, its inner product with row `i` of `by` times row `i` of `along`."""
    for c in range(size):
        total = inner_product(x, c, by, i, columns)
        for j in range(columns):
            x[c, j] -= total * along[i, j]


@njit(cache=True, nogil=True)
def forward(system, measured, start, jumps, out):  # type: ignore[no-untyped-def]
    """Run the filter, fill `out`, and return -2 log likelihood without its constant.

    `start`: mean (n,) and covariance (n, n) just before the measurement of epoch 0. `jumps`: epochs (j,) int in
    ascending order, and columns J (j, n, 3). J J' is added to the covariance just before the measurement of the epoch.
    """
    (z, h, var, fed), (q, qd), (row, jump) = measured, system[3:5], jumps
    innovation, variance, gain, told, mean_told, p_told = out
    (m, n), s = fed.shape, system[1].shape[2]
    blocks, of_s = -(-n // NAV), -(-s // NAV)
    size = padded(NAV * blocks)
    p, ft, w, f = make_rows(size, size), make_rows(NAV * of_s, 16), make_rows(NAV, size), make_rows(NAV, size)
    mean, ph, hs, d = make_rows(1, size), make_rows(6, size), make_rows(1, size), np.zeros(size)
    p9, ft9 = p[: NAV * blocks].reshape(blocks, NAV, size), ft.reshape(of_s, NAV, 16)
    nav, moved = np.empty((NAV, 16)), np.empty((1, 16))
    mean[0, :n], p[:n, :n] = start
    live, following, total, full = n, 0, 0.0, padded(n)
    for k in range(m):
        while live > s and p[live - 1, live - 1] == 0.0:  # skip exactly known states, like later faults
            live -= 1
        wide = padded(live)
        if k > 0:
            drift = read_transition(system, k, f, d)
            ft[:s, :NAV] = f[:, :s].T
            propagate(mean, 0, d, drift, ft9, of_s, moved, n)
            if live > n - 9 and drift != 0.0:
                for i in range(n - 9, n - 6):
                    move_drift(p, i, i + 3, d, drift, wide)
            w[:], nav[:] = 0.0, 0.0
            for i in range(NAV):
                add_product(w, i, f, i, p9, of_s, wide)
                add_product(nav, i, w, i, ft9, of_s, 16)
            for i in range(NAV, live):
                own = d[i]
                for j in range(wide):
                    p[i, j] *= own * d[j]
            for i in range(NAV):
                for j in range(wide):
                    p[i, j] = w[i, j] * d[j]
                for j in range(NAV, STATES):  # driving noise acts on navigation for half the span on average
                    p[i, j] += 0.5 * qd[k, j] * f[i, j]
                for j in range(i + 1):
                    p[i, j] = p[j, i] = nav[i, j] + q[k, i, j]
            for j in range(NAV, n):
                if qd[k, j] > 0.0:
                    p[j, j] += qd[k, j]
                    live = max(live, j + 1)
                for i in range(NAV):
                    p[j, i] = p[i, j]
        while following < row.shape[0] and row[following] <= k:  # add the variance of jumps at this epoch
            for i, c in np.ndindex(n, jump.shape[2]):
                if jump[following, i, c] != 0.0:
                    live = max(live, i + 1)
                    p[i, :n] += jump[following, i, c] * jump[following, :, c]
            following += 1
        wide = padded(live)
        for i in range(told.shape[0]):
            mean_told[k, i] = mean[0, told[i]]
            for j in range(n):
                p_told[k, i, j] = p[told[i], j]
        for i in range(6):
            ph[i] = 0.0
            if var[k, i] <= 0.0:
                innovation[k, i], variance[k, i], gain[k, i] = 0.0, -1.0, 0.0
                continue
            for a in range(n):
                by = hs[0, a] = h[k, i, a]
                if by != 0.0:
                    for j in range(wide):
                        ph[i, j] += by * p[a, j]
            for b in range(i):  # subtract the part explained by earlier components
                if var[k, b] > 0.0:
                    by = inner_product(hs, 0, ph, b, full)
                    for j in range(wide):
                        ph[i, j] -= by * ph[b, j]
            error = z[k, i] - inner_product(hs, 0, mean, 0, full)  # innovation of the component
            own = var[k, i] + max(inner_product(hs, 0, ph, i, full), 0.0)  # negative only by rounding
            innovation[k, i], variance[k, i] = error, own
            total += np.log(own) + error * error / own
            root = 1.0 / np.sqrt(own)  # scale P h so that its outer product is the reduction of P
            for j in range(n):
                ph[i, j] *= root
                gain[k, i, j] = ph[i, j] * root
                mean[0, j] += gain[k, i, j] * error
        if max(var[k, 0], var[k, 1], var[k, 2], var[k, 3], var[k, 4], var[k, 5]) > 0.0:
            for a in range(live):
                subtract_products(p, a, ph[:3], ph[:3], ph[3:], ph[3:], wide)
        mean[0, :n] -= fed[k]  # the filter run subtracted this error from its state
    return total


@njit(cache=True, nogil=True)
def backward(system, measured, out, rows, r, info, u, uu, told, driven):  # type: ignore[no-untyped-def]
    """Run the adjoint smoother: compute how a step of the state at each epoch affects the log likelihood.

    `rows` (k,) int, ascending: epochs to keep. Fills their score `r` (k, n) and information `info` (k, n, n) just
    before the measurement. If `r` has nine columns fewer, the fault states are omitted, which is exact while they are
    zero. The smoothed error is mean + P r with covariance P - P info P. Fills for each component the smoothing error
    `u` (m, 6) and its variance `uu` (m, 6). The smoothed residual is var * u, with variance var - var^2 uu. Fills
    `told` (m, 4, c) for the states in `numbers`: smoothed error, score, diagonals of P info and of info. Fills `driven`
    (m,) with the trace of q (info - r r'). Sources: P. de Jong and J. Penzer, "Diagnosing shocks in time series", J.
    Am. Stat. Assoc. 93 (1998) 796-806; J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods, 2nd
    ed., Oxford 2012, ch. 4 and 6.4.
    """
    h, q, (innovation, variance, gain, numbers, mean_told, p_told) = measured[1], system[3], out
    m, s, left, whole, n = u.shape[0], system[1].shape[2], rows.shape[0] - 1, system[2].shape[1], r.shape[1]
    wide, short, blocks = padded(n), padded(s), -(-n // NAV)
    size = padded(NAV * blocks)
    p, t, f = make_rows(size, size), make_rows(NAV, size), make_rows(NAV, size)
    x, hs, ks, score = make_rows(3, size), make_rows(3, size), make_rows(3, size), make_rows(1, size)
    p9, t9, f9 = p[: NAV * blocks].reshape(blocks, NAV, size), t.reshape(1, NAV, size), f.reshape(1, NAV, size)
    d, seen = np.zeros(max(whole, size)), np.empty(size, np.int64)  # d of navigation errors: zero
    for k in range(m - 1, -1, -1):
        for first in (3, 0):  # velocity, then position: the reverse of the filter's order
            u[k, first : first + 3] = uu[k, first : first + 3] = 0.0
            if max(variance[k, first], variance[k, first + 1], variance[k, first + 2]) <= 0.0:
                continue
            x[:], count = 0.0, 0
            for c in range(3):
                for j in range(n):  # the gain is zero where nothing was measured
                    hs[c, j], ks[c, j] = h[k, first + c, j], gain[k, first + c, j]
                if variance[k, first + c] <= 0.0:
                    hs[c] = 0.0
            for j in range(n):
                if hs[0, j] != 0.0 or hs[1, j] != 0.0 or hs[2, j] != 0.0:
                    seen[count], count = j, count + 1
            for c in range(3):
                add_product(x, c, ks, c, p9, blocks, wide)
            for c in range(2, -1, -1):
                i = first + c
                if variance[k, i] <= 0.0:
                    continue
                error = innovation[k, i] / variance[k, i] - inner_product(ks, c, score, 0, wide)  # smoothing error
                own = 1.0 / variance[k, i] + inner_product(ks, c, x, c, wide)
                u[k, i], uu[k, i] = error, own
                # (I - K h')' N (I - K h') + h h' / s is N - h x' - x h' with x = N K - h uu / 2
                for j in range(wide):
                    x[c, j] -= 0.5 * own * hs[c, j]
                    score[0, j] += error * hs[c, j]
                for b in range(c):
                    of_h = inner_product(ks, b, hs, c, wide)
                    of_x = inner_product(ks, b, x, c, wide)
                    for j in range(wide):
                        x[b, j] -= of_h * x[c, j] + of_x * hs[c, j]
            for a in seen[:count]:
                subtract_products(p, a, x, hs, hs, x, wide)
            for a in seen[:count]:
                for j in range(n):
                    p[j, a] = p[a, j]
        if left >= 0 and rows[left] == k:  # keep score and information of this epoch
            r[left], info[left], left = score[0, :n], p[:n, :n], left - 1
        for i in range(numbers.shape[0]):
            own = numbers[i]
            told[k, 0, i] = mean_told[k, i] + inner_product(p_told[k], i, score, 0, n)
            told[k, 1, i], told[k, 3, i] = score[0, own], p[own, own]
            told[k, 2, i] = inner_product(p_told[k], i, p, own, n)
        total = 0.0
        for i in range(NAV):
            for j in range(NAV):
                x[0, j] = q[k, i, j]
            total += inner_product(x, 0, p, i, NAV) - score[0, i] * inner_product(x, 0, score, 0, NAV)
        driven[k] = total
        if k > 0:
            drift = read_transition(system, k, f, d) * (n == whole)
            d[n:] = 0.0
            propagate_back(x, 0, score, 0, d, drift, f9, short, n)
            score[0] = x[0]
            for i in range(n - 6, n - 3):
                if drift != 0.0:
                    move_drift(p, i, i - 3, d, drift, wide)
            for i in range(NAV):  # half of the block of navigation errors, as both terms of the sum contain the block
                propagate_back(t, i, p, i, d, 0.0, f9, short, n)
                for j in range(n):
                    t[i, j] = 0.5 * (t[i, j] + d[j] * p[i, j])
            for a in range(n):
                own, columns = d[a], padded(a + 1)
                for j in range(columns):
                    p[a, j] *= own * d[j]
                add_product(p, a, t.T, a, f9, 1, min(columns, short))
                if a < s:
                    add_product(p, a, f.T, a, t9, 1, columns)
            for a in range(n):
                for j in range(a):
                    p[j, a] = p[a, j]


@inner()
def combine(g, info, y):  # type: ignore[no-untyped-def]
    """Set the first d rows of `y` to g^T info, for `g` (n, d) and `info` (n, n)."""
    n, size = g.shape
    for c in range(size):
        y[c] = 0.0
        for i in range(n):
            if g[i, c] != 0.0:
                y[c, :n] += g[i, c] * info[i]


@njit(cache=True, nogil=True)
def cross(system, measured, out, info, at, g, last):  # type: ignore[no-untyped-def]
    """Return cross information (m, d, d) of steps along `g` (n, d), d up to 9, at epoch `at` and each epoch to `last`.

    Of epochs a < b it is g' L' info_b g if `at` is b, its transpose if `at` is a; `info` is from `backward`. L is the
    closed-loop transition from a to b, both just before the measurement. Other epochs are zero.
    """
    (n, size), (m, _, s), way = g.shape, system[1].shape, 1 if last > at else -1
    wide, short, of_s, found = padded(NAV * -(-n // NAV)), padded(s), -(-s // NAV), np.zeros((m, size, size))
    x, y, f, ft = make_rows(NAV, wide), make_rows(NAV, wide), make_rows(NAV, wide), make_rows(NAV * of_s, 16)
    hs, ks, nav, d = make_rows(6, wide), make_rows(6, wide), make_rows(1, wide), np.zeros(wide)
    f9, ft9 = f.reshape(1, NAV, wide), ft.reshape(of_s, NAV, 16)
    x[:size, :n] = y[:size, :n] = g.T
    if way < 0:  # backwards, start from g' info
        combine(g, info[at], x)
    for k in range(at, last + way, way):
        if k != at:
            drift = read_transition(system, max(k, k - way), f, d)
            ft[:s, :NAV] = f[:, :s].T
            count = 0
            for i in range(6):
                if out[1][min(k, k - way), i] > 0.0:
                    hs[count, :n], ks[count, :n] = measured[1][min(k, k - way), i], out[2][min(k, k - way), i]
                    count += 1
            for i in range(count * (way > 0)):
                close_loop(x, size, hs, ks, i, wide)
            for c in range(size):
                if way > 0:
                    propagate(x, c, d, drift, ft9, of_s, nav, n)
                else:
                    propagate_back(nav, 0, x, c, d, drift, f9, short, n)
                    x[c] = nav[0]
            for i in range(count - 1, count * (way > 0) - 1, -1):
                close_loop(x, size, ks, hs, i, wide)
        if way > 0:
            combine(g, info[k], y)
        for e, c in np.ndindex(size, size):
            found[k, e, c] = inner_product(y, e, x, c, wide)
    return found


@njit(cache=True, nogil=True)
def gains(score, info, variances, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k, m) with t r' (I + t N)^-1 r - log det(I + t N), for variances t (k,).

    `score` (m, d) r, `info` (m, d, d) N. Pivots of I + t N below one, caused by rounding, are raised to one.
    """
    (m, size), a, r = score.shape, np.empty(info.shape[1:]), np.empty(info.shape[1])
    for k, number in np.ndindex(m, variances.shape[0]):
        t, square, volume = variances[number], 0.0, 1.0
        for i in range(size):
            r[i] = score[k, i]
            for j in range(i + 1):
                a[i, j] = t * info[k, i, j] + (1.0 if i == j else 0.0)
        for i in range(size):
            pivot = max(a[i, i], 1.0)
            square, volume = square + r[i] * r[i] / pivot, volume * pivot
            for j in range(i + 1, size):
                by = a[j, i] / pivot
                r[j] -= by * r[i]
                for c in range(i + 1, j + 1):
                    a[j, c] -= by * a[c, i]
        out[number, k] = t * square - np.log(volume)
