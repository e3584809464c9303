"""Continuous line of straight pieces through points, with borders and their number from the points.

A border is added where it lowers the sum of squares most; then all borders are moved in turn until convergence. This is
the forward selection of hinges by J. H. Friedman, Multivariate Adaptive Regression Splines, Annals of Statistics 19
(1991), section 3. An information criterion decides their number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.exceptions import ConfigError
from insnav.types import FloatArray, IntArray

MOST = 12  # pieces
FEWEST_POINTS = 3  # in a piece
PENALTY = 3.0  # factor on log n for a border: in pure noise fewer than 1 in 100 records get a border
_ROUNDS = 20  # of moving borders
_EXACT = 1e-9  # share of the spread of the points that counts as no misfit


@dataclass(frozen=True, slots=True)
class Pieces:
    """Straight pieces that meet at their borders."""

    knot: FloatArray  # (k,) the two ends and the borders between, increasing
    value: FloatArray  # (k,) of the line at the knots
    covariance: FloatArray  # (k, k) of these, borders taken as known
    residual: FloatArray  # (n,) points minus line
    left_out: FloatArray  # (n,) residual of each point from a line fitted without it, with the same borders
    sigma: float  # standard deviation of a point of weight 1 about the line

    @property
    def straight(self) -> bool:
        """True without a border."""
        return self.knot.size == 2

    @property
    def slope_sd(self) -> FloatArray:
        """Standard deviations of the slopes, (k - 1,)."""
        c = self.covariance
        variance = np.diag(c)[1:] + np.diag(c)[:-1] - 2.0 * np.diag(c, 1)
        return np.asarray(np.sqrt(variance) / np.diff(self.knot))

    @property
    def slope(self) -> FloatArray:
        """Slope of each piece, (k - 1,)."""
        return np.diff(self.value) / np.diff(self.knot)

    @property
    def intercept(self) -> FloatArray:
        """Intercept of each piece, (k - 1,)."""
        return np.asarray(self.value[:-1] - self.slope * self.knot[:-1])

    def room(self, piece: int) -> tuple[float, float]:
        """Return the range of intercepts for which a piece, from 0, meets its neighbours in order."""
        move = np.zeros(self.knot.size)  # of the borders per unit of the intercept
        for border, other in ((piece, piece - 1), (piece + 1, piece + 1)):
            if 0 < border < self.knot.size - 1:
                move[border] = -1.0 / (self.slope[piece] - self.slope[other])
        with np.errstate(divide="ignore"):
            limit = -np.diff(self.knot) / np.diff(move)
        room = limit[np.isfinite(limit)]
        own = float(self.intercept[piece])
        return own + max(room[room < 0.0], default=-np.inf), own + min(room[room > 0.0], default=np.inf)

    def with_intercept(self, piece: int, intercept: float, x: FloatArray) -> Pieces:
        """Move one piece up or down; its neighbours keep their lines and meet it at other borders.

        `piece`: from 0. `intercept`: new one. `x` (n,): of the points. Raises: ConfigError: it meets them nowhere
        between.
        """
        shift = intercept - self.intercept[piece]
        last = self.knot.size - 1
        knot, kept = self.knot.copy(), np.zeros((last + 1, last + 1))
        for border in range(last + 1):
            fixed = border - 1 if border > 0 and (border - 1 != piece or border == last) else min(border, last - 1)
            if border in (piece, piece + 1) and 0 < border < last:
                with np.errstate(divide="ignore"):
                    knot[border] -= shift / (self.slope[piece] - self.slope[fixed])
            share = (knot[border] - self.knot[fixed]) / (self.knot[fixed + 1] - self.knot[fixed])
            kept[border, fixed : fixed + 2] = 1.0 - share, share
        if not (np.isfinite(knot).all() and (np.diff(knot) > 0.0).all()):
            low, high = self.room(piece)
            raise ConfigError(
                "lab.piece_past_neighbours", before_rad_s=self.intercept[piece], low_rad_s=low, high_rad_s=high
            )
        value = kept @ self.value
        ends = [border for border in (0, last) if border in (piece, piece + 1)]
        value[ends] += shift
        moved = Pieces(knot, value, kept @ self.covariance @ kept.T, self.residual, self.left_out, self.sigma)
        change = moved.at(x) - self.at(x)
        return replace(moved, residual=self.residual - change, left_out=self.left_out - change)

    def at(self, x: FloatArray) -> FloatArray:
        """Evaluate the line at x (n,), with extended outer pieces."""
        piece = np.searchsorted(self.knot[1:-1], x)
        return np.asarray(self.intercept[piece] + self.slope[piece] * x)


def fit_pieces(x: FloatArray, y: FloatArray, weight: FloatArray | None = None) -> Pieces:
    """Fit as many straight pieces as the points support.

    `x`, `y` (n,): points, in any order; at least six different x. `weight` (n,): how many points each stands for;
    default one. Its ends are the outermost points.
    """
    order = np.argsort(x, kind="stable")
    root = np.ones(x.size) if weight is None else np.sqrt(weight[order])
    x, y = x[order], y[order]
    points = _Points(x, root, root * y)
    candidates = x[FEWEST_POINTS : x.size - FEWEST_POINTS]
    floor = float(np.sum((_EXACT * root * np.ptp(y)) ** 2)) + 1e-300
    borders = best = np.empty(0)
    lowest = _criterion(points, borders, floor)
    while borders.size + 1 < MOST:
        added = _best_border(points, borders, candidates)
        if added is None:
            break
        borders = _moved(points, np.sort(np.append(borders, added)), candidates)
        criterion = _criterion(points, borders, floor)
        if criterion < lowest:
            best, lowest = borders, criterion
    back = np.argsort(order)
    return _fitted(points, np.concatenate((x[:1], best, x[-1:])), back)


@dataclass(frozen=True, slots=True)
class _Points:
    """Points: increasing x, roots of the weights, and y times these."""

    x: FloatArray
    root: FloatArray
    y: FloatArray


def _hinges(points: _Points, borders: FloatArray) -> FloatArray:
    """Build functions that are zero up to a border and rise beyond it, weighted, (n, borders)."""
    return np.asarray(np.maximum(points.x[:, None] - borders, 0.0) * points.root[:, None])


def _rest(points: _Points, borders: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return orthonormal columns of all lines with these borders, and the residual of the best line."""
    straight = np.column_stack((points.root, points.root * points.x))
    q = np.linalg.qr(np.hstack((straight, _hinges(points, borders))))[0]
    return q, np.asarray(points.y - q @ (q.T @ points.y))


def _criterion(points: _Points, borders: FloatArray, floor: float) -> float:
    n = points.x.size
    squares = max(float(np.sum(_rest(points, borders)[1] ** 2)), floor)
    return float(n * np.log(squares / n) + PENALTY * borders.size * np.log(n))


def _best_border(points: _Points, borders: FloatArray, candidates: FloatArray) -> float | None:
    """Find the candidate that lowers the sum of squares most, with enough points to its neighbours."""
    place = np.searchsorted(points.x, candidates)
    free = np.ones(candidates.size, dtype=np.bool_)
    for other in np.searchsorted(points.x, borders):
        free &= np.abs(place - other) >= FEWEST_POINTS
    if not free.any():
        return None
    q, rest = _rest(points, borders)
    hinges = _hinges(points, candidates[free])
    new = hinges - q @ (q.T @ hinges)
    length = np.sum(new**2, axis=0)
    real = length > 1e-12 * np.sum(hinges**2, axis=0)
    gain = np.where(real, (rest @ new) ** 2 / np.maximum(length, 1e-300), 0.0)
    return float(candidates[free][int(np.argmax(gain))])


def _moved(points: _Points, borders: FloatArray, candidates: FloatArray) -> FloatArray:
    """Move each border in turn to its best position given the others, until convergence."""
    for _ in range(_ROUNDS):
        before = borders
        for i in range(borders.size):
            others = np.delete(borders, i)
            found = _best_border(points, others, candidates)
            if found is not None:
                borders = np.sort(np.append(others, found))
        if np.array_equal(before, borders):
            break
    return borders


def _fitted(points: _Points, knot: FloatArray, back: IntArray) -> Pieces:
    """Compute values at the knots, and residuals in the original order of the points."""
    line = np.column_stack([np.interp(points.x, knot, row) for row in np.eye(knot.size)])
    design = line * points.root[:, None]
    value = np.asarray(np.linalg.lstsq(design, points.y, rcond=None)[0], dtype=np.float64)
    residual = points.y - design @ value
    sigma = float(np.sqrt(np.sum(residual**2) / max(points.x.size - knot.size, 1)))
    inverse = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
    leverage = np.sum((design @ inverse) * design, axis=1)
    residual = residual / points.root
    left_out = residual / np.maximum(1.0 - leverage, 1e-9)
    return Pieces(knot, value, sigma**2 * inverse, residual[back], left_out[back], sigma)
