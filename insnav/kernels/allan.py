"""Sums for the overlapping Allan variance and for the covariance of its estimates."""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit

BLOCK = 2048  # terms of a partial sum, which fits into the cache and limits rounding errors
FAR = 30.0  # lag in sums of both averaging times beyond which a derivative replaces differences, which would cancel
SHORT = 8  # largest number of lags between two edges that are summed lag by lag

# nodes and weights of Gauss and Legendre's rule on (-1, 1)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@njit(cache=True, nogil=True)
def running_sum(values, mean, out):  # type: ignore[no-untyped-def]
    """Compute the running sum of values minus their mean, from zero, compensated (W. Kahan, CACM 8 (1965) 40).

    `values` (n,); `mean`. `out` (n + 1,): filled.
    """
    total, lost = 0.0, 0.0
    out[0] = 0.0
    for k in range(values.shape[0]):
        term = (values[k] - mean) - lost
        new = total + term
        lost = (new - total) - term
        total = new
        out[k + 1] = total


# the only kernel with reassociated (vectorised) sums: it calls no numpy function that other kernels share
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _square_sum(near, middle, far):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(near.shape[0]):  # index from 0: a possibly negative index would prevent vectorisation
        z = far[k] - 2.0 * middle[k] + near[k]
        total += z * z
    return total


@njit(cache=True, nogil=True)
def mean_square_second_difference(x, factors, out):  # type: ignore[no-untyped-def]
    """Compute the mean squared second difference of `x` over each distance.

    `x` (n,): from `running_sum`. `factors` (k,) int: distances m [samples], 2 m < n. `out` (k,): filled with the mean
    of ``(x[i + 2m] - 2 x[i + m] + x[i])^2`` over all i.
    """
    n = x.shape[0]
    for j in range(factors.shape[0]):
        m = factors[j]
        count = n - 2 * m
        total = 0.0
        for first in range(0, count, BLOCK):
            last = min(first + BLOCK, count)
            total += _square_sum(x[first:last], x[first + m : last + m], x[first + 2 * m : last + 2 * m])
        out[j] = total / count


@inner()
def _phase_covariance(t, theta, time):  # type: ignore[no-untyped-def]
    """Compute the autocovariance of the integrated noise at lag t >= 0, except terms in 1 and t^2, which cancel.

    `theta`: Q^2, N^2, B^2, K^2 (quantisation, white, flicker, random walk), variance of a Gauss-Markov process. `time`:
    correlation time of this process.
    """
    if t < 0.5:
        return theta[0]
    value = -0.5 * theta[1] * t
    if theta[2] > 0.0:
        value += theta[2] / (2.0 * np.pi) * t * t * np.log(t)
    value += theta[3] / 12.0 * t * t * t
    if theta[4] > 0.0:
        u = t / time
        if u < 0.05:  # a series, as the leading terms of the closed form cancel
            f = -u * u * u * (1.0 / 6.0 - u / 24.0 + u * u / 120.0 - u * u * u / 720.0)
        else:
            f = np.exp(-u) + u - 1.0 - 0.5 * u * u
        value -= theta[4] * time * time * f
    return value


@inner()
def _square(d, mi, mj, theta, time, ni, nj):  # type: ignore[no-untyped-def]
    """Compute the squared covariance of two second differences at lag `d`, times the number of such pairs."""
    pairs = min(ni, nj - d) - max(0.0, -d)
    if pairs <= 0.0:
        return 0.0
    centre = abs(d + mj - mi)
    if centre > FAR * (mi + mj):  # fourth derivative of the autocovariance; zero for the other terms
        r = -theta[2] / (np.pi * centre * centre)
        if theta[4] > 0.0:
            r -= theta[4] / (time * time) * np.exp(-centre / time)
        r *= mi * mi * mj * mj
        return pairs * r * r
    r = 0.0
    for a in range(3):
        for b in range(3):
            r += (
                (-2.0 if a == 1 else 1.0)
                * (-2.0 if b == 1 else 1.0)
                * _phase_covariance(abs(d + b * mj - a * mi), theta, time)
            )
    return pairs * r * r


@inner()
def _pair(mi, mj, n, theta, time):  # type: ignore[no-untyped-def]
    ni, nj = float(n - 2 * mi), float(n - 2 * mj)
    low, high = 1.0 - ni, nj - 1.0
    span = 2.0 * (mi + mj)
    edges = np.empty(19)  # lags between which the covariance is smooth
    edges[0], edges[1] = low, high
    for a in range(3):
        for b in range(3):
            edges[2 + 3 * a + b] = a * mi - b * mj
    first, last = -2.0 * mj, 2.0 * mi  # lags at which second differences cease to overlap
    edges[11], edges[12], edges[13] = first - 0.5 * span, first - 2.0 * span, first - 8.0 * span
    edges[14], edges[15], edges[16] = last + 0.5 * span, last + 2.0 * span, last + 8.0 * span
    edges[17], edges[18] = 0.0, nj - ni
    for i in range(19):
        edges[i] = np.floor(min(max(edges[i], low), high))
    edges.sort()
    total = _square(edges[0], mi, mj, theta, time, ni, nj)
    for i in range(18):
        begin, end = edges[i], edges[i + 1]
        if end == begin:
            continue
        total += _square(end, mi, mj, theta, time, ni, nj)
        inside = end - begin - 1.0
        if inside <= SHORT:
            d = begin + 1.0
            while d < end:
                total += _square(d, mi, mj, theta, time, ni, nj)
                d += 1.0
        else:  # Gauss-Legendre integral in place of the sum: each lag represents half a lag on either side
            half = 0.5 * inside
            for q in range(_NODES.shape[0]):
                d = 0.5 * (begin + end) + half * _NODES[q]
                total += half * _WEIGHTS[q] * _square(d, mi, mj, theta, time, ni, nj)
    return total / (ni * nj)


@njit(cache=True)
def variance_covariance(factors, n, theta, time, diagonal, out):  # type: ignore[no-untyped-def]
    """Compute the covariance of overlapping Allan variances of one Gaussian record, in sample units.

    `factors` (k,) int: averaging times m [samples]. `n`: number of points of the integral, one more than samples.
    `theta` (5,): Q^2, N^2, B^2, K^2 and Gauss-Markov variance with one sample as the unit of time. `time`: correlation
    time [samples]. `diagonal`: compute the variances only. `out` (k, k): filled.
    """
    for i in range(factors.shape[0]):
        mi = float(factors[i])
        for j in range(i, i + 1 if diagonal else factors.shape[0]):
            mj = float(factors[j])
            value = 2.0 * _pair(mi, mj, n, theta, time) / (4.0 * mi * mi * mj * mj)
            out[i, j] = value
            out[j, i] = value
