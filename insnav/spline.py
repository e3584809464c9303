"""Cubic splines with not-a-knot ends, and non-negative least squares, without importing scipy.

Importing scipy.interpolate and scipy.optimize takes a fifth of a second, as long as navigating a half-hour drive.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from insnav.types import FloatArray


class Spline:
    """Cubic spline through `values` (n, m) at `time` (n,), increasing, n >= 4, with not-a-knot ends.

    C. de Boor, "A Practical Guide to Splines", 1978, chapter IV.
    """

    def __init__(self, time: FloatArray, values: FloatArray) -> None:
        h = np.diff(time)[:, None]
        chord = np.diff(values, axis=0) / h
        slope = _slopes(h, chord)
        bend = (slope[:-1] + slope[1:] - 2.0 * chord) / h
        area = h * (values[:-1] + values[1:]) / 2.0 + h**2 * (slope[:-1] - slope[1:]) / 12.0
        integral = np.cumsum(area, axis=0) - area
        self._time, self._parts = time, (integral, values[:-1], slope[:-1], (chord - slope[:-1]) / h - bend, bend / h)

    def _at(self, time: FloatArray) -> tuple[FloatArray, ...]:
        """Return, for each `time` (k,): offset within its piece, integral before the piece, and its coefficients."""
        piece = np.clip(np.searchsorted(self._time, time, side="right") - 1, 0, self._time.size - 2)
        return (time - self._time[piece])[:, None], *(part[piece] for part in self._parts)

    def changes(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Evaluate first and second derivative at `time` (k,), (k, m) each."""
        u, _, _, b, c, d = self._at(time)
        return b + u * (2.0 * c + 3.0 * u * d), 2.0 * c + 6.0 * u * d

    def integral(self, time: FloatArray) -> FloatArray:
        """Evaluate the integral from the first knot to `time` (k,), (k, m)."""
        u, before, a, b, c, d = self._at(time)
        return before + u * (a + u * (b / 2.0 + u * (c / 3.0 + u * d / 4.0)))


def _slopes(h: FloatArray, rise: FloatArray) -> FloatArray:
    """Solve for the slopes at the knots, (n, m), from steps `h` (n - 1, 1) and chord slopes `rise` (n - 1, m).

    Cyclic reduction doubles the distance of the unknowns in each equation (R. W. Hockney, "A fast direct solution of
    Poisson's equation using Fourier analysis", J. ACM 12 (1965) 95-113).
    """
    first, last = h[0] + h[1], h[-1] + h[-2]
    ends = (
        ((h[0] + 2.0 * first) * h[1] * rise[0] + h[0] ** 2 * rise[1]) / first,
        ((h[-1] + 2.0 * last) * h[-2] * rise[-1] + h[-1] ** 2 * rise[-2]) / last,
    )
    diagonal = 2.0 * (h[:-1] + h[1:])
    right = 3.0 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])
    diagonal[[0, -1]] /= 2.0  # the end conditions eliminate the end slopes
    right[0] -= ends[0]
    right[-1] -= ends[1]
    before, after, inner = h[1:] / diagonal, h[:-1] / diagonal, right / diagonal
    before[0] = after[-1] = 0.0
    step, n = 1, inner.shape[0]  # distance of the unknowns in each equation, their number
    while step < n and max(np.abs(before).max(), np.abs(after).max()) > 1e-18:
        down = [np.pad(terms[:-step], ((step, 0), (0, 0))) for terms in (before, after, inner)]
        up = [np.pad(terms[step:], ((0, step), (0, 0))) for terms in (before, after, inner)]
        pivot = 1.0 - before * down[1] - after * up[0]
        inner = (inner - before * down[2] - after * up[2]) / pivot
        before, after, step = -before * down[0] / pivot, -after * up[1] / pivot, 2 * step
    start, end = (ends[0] - first * inner[0]) / h[1], (ends[1] - last * inner[-1]) / h[-2]
    return np.vstack([start, inner, end])


def positive_parts(terms: FloatArray, values: FloatArray) -> tuple[FloatArray, float]:
    """Fit `values` (n,) by a sum of `terms` (n, k) with non-negative coefficients (k,); return these and the misfit.

    The best fit is the unconstrained fit of one subset of the terms, so all subsets are tried: `k` must be small.
    """
    count = terms.shape[1]
    best, smallest = np.zeros(count), float(np.linalg.norm(values))
    for size in range(1, count + 1):
        for subset in combinations(range(count), size):
            coefficients = np.linalg.lstsq(terms[:, subset], values, rcond=None)[0]
            misfit = float(np.linalg.norm(values - terms[:, subset] @ coefficients))
            if (coefficients >= 0.0).all() and misfit < smallest:
                best, smallest = np.zeros(count), misfit
                best[list(subset)] = coefficients
    return best, smallest
