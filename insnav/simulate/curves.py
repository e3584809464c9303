"""Smooth functions of time with exact derivatives: what position and attitude of a truth are made of."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import Protocol

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

from insnav.types import FloatArray


class Curve(Protocol):
    """Anything that is three functions of time.

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
        """No derivative jumps."""
        return np.empty(0)

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Values ``(n, 3)`` of derivative number `order` at times `t` ``(n,)`` [s]."""
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
    """Piecewise polynomial."""

    # the function and its first two derivatives, each a polynomial of its own: half the cost of ``nu``
    derivatives: tuple[PPoly, PPoly, PPoly]

    @property
    def knots(self) -> FloatArray:
        """Where the polynomials meet [s]."""
        breaks: FloatArray = self.derivatives[0].x
        return breaks

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Values ``(n, 3)`` of derivative number `order` at times `t` ``(n,)`` [s]."""
        value: FloatArray = self.derivatives[order](t)
        return value

    def integral(self) -> Spline:
        """Integrate; the result is zero at the first knot."""
        return spline_of(self.derivatives[0].antiderivative())


def spline_of(polynomials: PPoly) -> Spline:
    """Curve of a piecewise polynomial with coefficients of shape ``(degree + 1, pieces, 3)``."""
    first = polynomials.derivative()
    return Spline((polynomials, first, first.derivative()))


def spline_through(t: FloatArray, values: FloatArray, degree: int = 7) -> Spline:
    """Interpolating spline of odd degree through values ``(m, 3)``, continuous in ``degree - 1`` derivatives."""
    basis = make_interp_spline(t, values, k=degree)
    breaks = np.unique(basis.t)
    taylor = [basis(breaks[:-1], nu=k) / factorial(k) for k in range(degree, -1, -1)]
    return spline_of(PPoly(np.stack(taylor), breaks))
