"""A line of straight pieces through points, borders and their number found from the points.

A border is put where it takes most off the sum of squares, then all are moved in turn until none moves any more: the
forward selection of hinges of J. H. Friedman, Multivariate Adaptive Regression Splines, Annals of Statistics 19
(1991), section 3. How many there are is decided by an information criterion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.types import FloatArray

MOST = 12  # pieces
FEWEST_POINTS = 3  # in a piece
PENALTY = 3.0  # times log n for a border: in noise alone fewer than 1 in 100 records get one
_ROUNDS = 20  # of moving borders
_EXACT = 1e-9  # share of the spread of the points that counts as no misfit


@dataclass(frozen=True, slots=True)
class Pieces:
    """Straight pieces that meet at their borders.

    Attributes
    ----------
    knot : (k,) array
        The two ends and the borders between, increasing.
    value : (k,) array
        Of the line at the knots.
    sd : (k,) array
        Standard deviation of these, borders taken as known.
    residual : (n,) array
        Points minus line.
    left_out : (n,) array
        The same, each by a line fitted without that point, borders kept.
    sigma : float
        Standard deviation of a point about the line.
    """

    knot: FloatArray
    value: FloatArray
    sd: FloatArray
    residual: FloatArray
    left_out: FloatArray
    sigma: float

    @property
    def straight(self) -> bool:
        """Whether there is no border."""
        return self.knot.size == 2

    @property
    def slope(self) -> FloatArray:
        """Of each piece, (k - 1,)."""
        return np.diff(self.value) / np.diff(self.knot)


def fit_pieces(x: FloatArray, y: FloatArray) -> Pieces:
    """Fit as many straight pieces as the points bear.

    Parameters
    ----------
    x, y : (n,) array
        Points, in any order; at least six different x.

    Returns
    -------
    Pieces
        Its ends are the outermost points.
    """
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    n = x.size
    candidates = x[FEWEST_POINTS : n - FEWEST_POINTS]
    floor = n * (_EXACT * float(np.ptp(y)) + 1e-300) ** 2
    borders = np.empty(0)
    best = borders
    lowest = _criterion(x, y, borders, floor)
    while borders.size + 1 < MOST:
        added = _best_border(x, y, borders, candidates)
        if added is None:
            break
        borders = _moved(x, y, np.sort(np.append(borders, added)), candidates)
        criterion = _criterion(x, y, borders, floor)
        if criterion < lowest:
            best, lowest = borders, criterion
    fitted = _fitted(x, y, np.concatenate((x[:1], best, x[-1:])))
    back = np.empty(n, dtype=np.int64)
    back[order] = np.arange(n)
    return Pieces(*fitted[:3], fitted[3][back], fitted[4][back], fitted[5])


def _hinges(x: FloatArray, borders: FloatArray) -> FloatArray:
    """Functions that are zero up to a border and rise beyond it, (n, borders)."""
    return np.asarray(np.maximum(x[:, None] - borders, 0.0))


def _projector(x: FloatArray, borders: FloatArray) -> FloatArray:
    """Orthonormal columns that span all lines with these borders."""
    return np.linalg.qr(np.column_stack((np.ones_like(x), x, _hinges(x, borders))))[0]


def _misfit(x: FloatArray, y: FloatArray, borders: FloatArray) -> FloatArray:
    q = _projector(x, borders)
    return np.asarray(y - q @ (q.T @ y))


def _criterion(x: FloatArray, y: FloatArray, borders: FloatArray, floor: float) -> float:
    squares = max(float(np.sum(_misfit(x, y, borders) ** 2)), floor)
    return float(x.size * np.log(squares / x.size) + PENALTY * borders.size * np.log(x.size))


def _best_border(x: FloatArray, y: FloatArray, borders: FloatArray, candidates: FloatArray) -> float | None:
    """Candidate that takes most off the sum of squares, with enough points between it and its neighbours."""
    place = np.searchsorted(x, candidates)
    taken = np.searchsorted(x, borders)
    free = np.ones(candidates.size, dtype=np.bool_)
    for other in taken:
        free &= np.abs(place - other) >= FEWEST_POINTS
    if not free.any():
        return None
    q = _projector(x, borders)
    rest = y - q @ (q.T @ y)
    hinges = _hinges(x, candidates[free])
    new = hinges - q @ (q.T @ hinges)
    length = np.sum(new**2, axis=0)
    gain = np.where(length > 1e-12 * np.sum(hinges**2, axis=0), (rest @ new) ** 2 / np.maximum(length, 1e-300), 0.0)
    return float(candidates[free][int(np.argmax(gain))])


def _moved(x: FloatArray, y: FloatArray, borders: FloatArray, candidates: FloatArray) -> FloatArray:
    """Each border in turn to where it is best given the others, until none moves."""
    for _ in range(_ROUNDS):
        before = borders.copy()
        for i in range(borders.size):
            others = np.delete(borders, i)
            found = _best_border(x, y, others, candidates)
            if found is not None:
                borders = np.sort(np.append(others, found))
        if np.array_equal(before, borders):
            break
    return borders


def _fitted(
    x: FloatArray, y: FloatArray, knot: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Knots, values there and their standard deviations, residuals, left-out residuals, scatter."""
    design = np.column_stack([np.interp(x, knot, row) for row in np.eye(knot.size)])
    value = np.asarray(np.linalg.lstsq(design, y, rcond=None)[0], dtype=np.float64)
    residual = y - design @ value
    sigma = float(np.sqrt(np.sum(residual**2) / max(x.size - knot.size, 1)))
    inverse = np.linalg.inv(design.T @ design)
    leverage = np.sum((design @ inverse) * design, axis=1)
    left_out = np.asarray(residual / np.maximum(1.0 - leverage, 1e-9))
    return knot, value, sigma * np.sqrt(np.diag(inverse)), residual, left_out, sigma
