"""Smooth functions of time with exact derivatives: position and attitude of a truth."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from insnav.spill import by_blocks
from insnav.types import FloatArray


class Curve(Protocol):
    """Interface of three functions of time.

    Attributes
    ----------
    knots : (m,) array
        Times at which some high derivative jumps [s]; empty if there is none. Quadrature stops there.
    """

    @property
    def knots(self) -> FloatArray:
        """See above."""
        ...

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Values ``(n, 3)`` of derivative number `order` (0, 1 or 2) at times `t` ``(n,)`` [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Harmonic:
    """Straight line plus one harmonic: ``offset + rate t + cosine cos(w t) + sine sin(w t)``."""

    # (3,) coefficients, in the unit of the curve (`rate` per second)
    offset: FloatArray
    rate: FloatArray
    cosine: FloatArray
    sine: FloatArray
    omega: float = 0.0  # angular frequency w [rad/s]

    @property
    def knots(self) -> FloatArray:
        """Knots: none, as all derivatives are continuous."""
        return np.empty(0)

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate derivative number `order`, ``(n, 3)``, at times `t` ``(n,)`` [s]."""
        t = t[:, None]
        phase = self.omega * t + order * (np.pi / 2)
        value: FloatArray = self.omega**order * (self.cosine * np.cos(phase) + self.sine * np.sin(phase))
        if order == 0:
            value += self.offset + self.rate * t
        elif order == 1:
            value += self.rate
        return value


@dataclass(frozen=True, slots=True)
class Spline:
    """Piecewise polynomial, with coefficients of shape ``(degree + 1, pieces, m)``."""

    polynomials: PPoly

    @property
    def knots(self) -> FloatArray:
        """Times at which the polynomials meet [s]."""
        breaks: FloatArray = self.polynomials.x
        return breaks

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Evaluate derivative number `order`, ``(n, m)``, at times `t` ``(n,)`` [s]."""
        return by_blocks(lambda part: self._values(part, order), t)

    def _values(self, t: FloatArray, order: int) -> FloatArray:
        """Differentiate only the pieces that contain `t`: storing whole derivatives takes more memory than samples."""
        c, x = self.polynomials.c, self.polynomials.x
        first, last = np.searchsorted(x[1:-1], (t.min(), t.max()), side="right")
        part = PPoly.construct_fast(c[:, first : last + 1], x[first : last + 2])
        for _ in range(order):
            part = part.derivative()
        values: FloatArray = part(t)
        return values

    def integral(self) -> Spline:
        """Integrate; the result is zero at the first knot."""
        return Spline(self.polynomials.antiderivative())


def spline_of(basis: BSpline) -> Spline:
    """Convert a B-spline to the polynomials between its knots."""
    breaks = np.unique(basis.t)
    taylor = np.empty((basis.k + 1, breaks.size - 1, *basis.c.shape[1:]))
    for k in range(basis.k + 1):
        taylor[basis.k - k] = basis(breaks[:-1], nu=k) / factorial(k)
    return Spline(PPoly(taylor, breaks))


def spline_through(t: FloatArray, values: FloatArray, degree: int = 7) -> Spline:
    """Interpolate values ``(m, 3)`` by a spline of odd degree, continuous in ``degree - 1`` derivatives."""
    return spline_of(make_interp_spline(t, values, k=degree))
