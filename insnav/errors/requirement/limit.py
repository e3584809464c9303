"""Limit on a position error, and the probability that a Gaussian error stays within it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import brentq
from scipy.special import betaincinv, erf

from insnav.exceptions import ConfigError
from insnav.sample_statistics import CONFIDENCE, chi_square
from insnav.types import FloatArray

Component = Literal["horizontal", "vertical", "3d"]
COMPONENTS: dict[Component, tuple[int, ...]] = {"horizontal": (0, 1), "vertical": (2,), "3d": (0, 1, 2)}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)
_FAR = 8.0  # standard deviations beyond which the probability is negligible


@dataclass(frozen=True, slots=True)
class Requirement:
    """Requirement: the error is within the limit with this probability."""

    error: float  # limit of the position error [m]
    after: float  # time without aiding [s]
    probability: float = 0.95
    component: Component = "horizontal"  # component of the position error

    def __post_init__(self) -> None:
        checks = (
            (0.0 < self.error <= 1e6, f"{self.error:g} m", "--error", "> 0, ≤ 1e6 m"),
            (0.5 <= self.after <= 3600.0, f"{self.after:g} s", "--after", "≥ 0.5 s, ≤ 3600 s"),
            (0.5 <= self.probability <= 0.999, f"{self.probability:g}", "--probability", "≥ 0.5, ≤ 0.999"),
            (self.component in COMPONENTS, str(self.component), "--component", ", ".join(COMPONENTS)),
        )
        for good, given, where, fix in checks:
            if not good:
                raise ConfigError("require.not_sensible", where=where, given=given, allowed=fix)

    @property
    def axes(self) -> tuple[int, ...]:
        """Relevant axes of North, East, Down."""
        return COMPONENTS[self.component]

    def size(self, covariance: FloatArray) -> float:
        """Compute the error at the required probability, of a covariance ``(9, 9)`` or ``(3, 3)`` [m]."""
        chosen = np.asarray(covariance)[np.ix_(self.axes, self.axes)]
        return length_quantile(np.linalg.eigvalsh(chosen).astype(np.float64), self.probability)

    def sizes(self, covariances: FloatArray) -> FloatArray:
        """Compute `size` of many covariances ``(..., n, n)``, by a table accurate to 1e-3."""
        chosen = np.asarray(covariances)[..., self.axes, :][..., :, self.axes]
        variances = np.maximum(np.linalg.eigvalsh(chosen)[..., ::-1], 0.0)
        sd = np.sqrt(np.maximum(variances, 1e-300))
        if len(self.axes) == 1:
            return np.asarray(sd[..., 0] * length_quantile(np.ones(1), self.probability))
        grid, table = _table(len(self.axes), self.probability)
        ratios = sd[..., 1:] / sd[..., :1]
        found = RegularGridInterpolator((grid,) * (len(self.axes) - 1), table, method="linear")(ratios)
        return np.asarray(sd[..., 0] * found)

    @property
    def text(self) -> str:
        """Requirement in words."""
        return (
            f"{self.component} error within {self.error:g} m after {self.after:g} s with probability "
            f"{self.probability:g}"
        )


def length_probability(variances: FloatArray, length: float) -> float:
    """Compute the probability that a Gaussian vector is not longer than `length`.

    `variances` (n,): along its principal axes, n up to 3. They are integrated in turn, ``P(l_1 z_1^2 + ... <= r^2)``,
    by Gauss-Legendre nodes in the angle t of ``z = z_max sin t``.
    """
    kept = np.sort(variances[variances > 1e-14 * max(float(np.max(variances)), 1e-300)])[::-1]
    return float(_inside(kept, np.array([length**2]))[0]) if len(kept) else 1.0


def _inside(variances: FloatArray, squares: FloatArray) -> FloatArray:
    if len(variances) == 1:
        return np.asarray(erf(np.sqrt(np.maximum(squares, 0.0) / (2.0 * variances[0]))))
    ends = np.minimum(np.sqrt(np.maximum(squares, 0.0) / variances[-1]), _FAR)[:, None]
    angle = 0.5 * np.pi * _NODES
    z = ends * np.sin(angle)
    rest = squares[:, None] - variances[-1] * z**2
    inner = _inside(variances[:-1], rest.ravel()).reshape(z.shape)
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) * ends * np.cos(angle) * 0.5 * np.pi
    return np.asarray((inner * density) @ _WEIGHTS)


def length_quantile(variances: FloatArray, probability: float) -> float:
    """Compute the length of a Gaussian vector at a probability; zero without spread.

    `variances` (n,): along its principal axes, n up to 3.
    """
    largest = float(np.max(variances))
    if largest <= 0.0:
        return 0.0
    scaled = np.maximum(variances, 0.0) / largest
    low, high = (np.sqrt(chi_square(n, probability)) for n in (1, len(scaled)))
    if high - low < 1e-12:
        return float(low * np.sqrt(largest))
    found = brentq(lambda r: length_probability(scaled, r) - probability, 0.99 * low, 1.01 * high, xtol=1e-10)
    return float(found * np.sqrt(largest))


@functools.cache
def _table(axes: int, probability: float) -> tuple[FloatArray, FloatArray]:
    """Tabulate the quantile of the length by ratios of smaller standard deviations to the largest."""
    grid = np.linspace(0.0, 1.0, 33 if axes == 2 else 17)
    ratios = np.stack(np.meshgrid(*(grid,) * (axes - 1), indexing="ij"), axis=-1).reshape(-1, axes - 1)
    found = [length_quantile(np.append(1.0, ratio**2), probability) for ratio in ratios]
    return grid, np.array(found).reshape((len(grid),) * (axes - 1))


def binomial_interval(count: int, of: int) -> tuple[float, float]:
    """Compute the 95 % interval of a probability, `count` of `of` (Clopper and Pearson, Biometrika 26 (1934) 404)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - tail)) if count < of else 1.0
    return low, high
