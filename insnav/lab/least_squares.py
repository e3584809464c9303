"""Linear least squares of all bench methods: estimates, their uncertainty, and undetermined parameters.

Sources: G. A. F. Seber and A. J. Lee, Linear Regression Analysis, 2nd ed. (2003), chapters 3 (estimation), 5
(confidence intervals) and 10 (deleted residuals).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from insnav.exceptions import InputError
from insnav.types import BoolArray, FloatArray

RANK_TOLERANCE = 1e-9  # singular values of the scaled design below this share of the largest count as zero
AFFINE = ("sensitivity to x", "to y", "to z", "bias")  # parameters of a sensor among three axes
LEVEL = 0.95  # of a printed interval, unless stated otherwise
FALSE_ALARM = 0.05  # probability that a row of a good fit is reported as outlier


@dataclass(frozen=True, slots=True)
class Fit:
    """Result of linear least squares."""

    names: tuple[str, ...]  # of the k parameters
    value: FloatArray  # (k,) estimates
    covariance: FloatArray  # (k, k) of the estimates, from the scatter of the residuals
    residual: FloatArray  # (n,) measured minus fitted, in the unit of the measurement
    sigma: float  # standard deviation of a measurement: root of the sum of squares over `dof`
    dof: int  # degrees of freedom, ``n - k``
    condition: float  # condition number of the design with columns of length 1, independent of units

    @property
    def sd(self) -> FloatArray:
        """One standard deviation of each estimate, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals: the sum of squares over n, not over `dof`."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def worst(self) -> int:
        """Row of the largest residual."""
        return int(np.argmax(np.abs(self.residual)))

    def half_width(self, level: float = LEVEL) -> FloatArray:
        """Compute the half width of the confidence interval of each estimate, (k,).

        `level`: probability with which the interval holds the true value, normally distributed errors given.
        """
        return self.sd * coverage_factor(self.dof, level)


def coverage_factor(dof: float, level: float = LEVEL) -> float:
    """Compute the half width of a confidence interval in standard deviations: Student's t.

    `dof`: degrees of freedom of the standard deviation, infinite if it is known. `level`: probability of the interval.
    """
    return float(stdtrit(min(dof, 1e9), 0.5 + 0.5 * level))


def outliers(fit: Fit, design: FloatArray) -> tuple[int, ...]:
    """Find outlying rows.

    Each residual is compared with the scatter of all other rows (deleted residual: Seber and Lee, section 10.2), at a
    level that lets all rows of a good fit pass except with a probability of `FALSE_ALARM`.

    `design` (n, k): of that fit.
    """
    if fit.dof < 2 or fit.sigma <= 0.0:
        return ()
    leverage = np.sum((design @ (fit.covariance / fit.sigma**2)) * design, axis=1)
    spare = np.maximum(fit.dof * fit.sigma**2 * (1.0 - leverage) - fit.residual**2, 1e-300)
    deleted = np.abs(fit.residual) * np.sqrt((fit.dof - 1) / spare)
    limit = coverage_factor(fit.dof - 1, 1.0 - FALSE_ALARM / fit.residual.size)
    return tuple(int(row) for row in np.flatnonzero(deleted > limit))


def linear_fit(design: FloatArray, measured: FloatArray, names: Sequence[str], *, where: str = "") -> Fit:
    """Fit ``measured = design @ parameters`` by least squares.

    `design` (n, k): derivative of each measurement by each parameter. `measured` (n,): measurements with independent
    errors of equal variance.
    Raises: InputError: a value that is not finite, no more measurements than parameters, or undetermined parameters, by
    name.
    """
    design = np.asarray(design, dtype=np.float64)
    measured = np.asarray(measured, dtype=np.float64)
    n, k = design.shape
    finite = np.isfinite(design).all(axis=1) & np.isfinite(measured)
    if not finite.all():
        raise InputError("lab.not_finite", where=where, row=int(np.argmin(finite)) + 1)
    if n <= k:
        raise InputError("lab.few_measurements", where=where, parameters=tuple(names), count=n, unknowns=k, limit=k + 1)
    lengths = np.linalg.norm(design, axis=0)
    idle = [name for name, length in zip(names, lengths, strict=True) if not length > 0.0]
    if idle:
        raise InputError("lab.parameters_idle", where=where, parameters=tuple(idle))
    left, singular, right = np.linalg.svd(design / lengths, full_matrices=False)
    loose = singular <= RANK_TOLERANCE * singular[0]
    if loose.any():
        shares = np.sqrt(np.sum(right[loose] ** 2, axis=0))  # weight of each parameter in the undetermined combinations
        mixed = [name for name, share in zip(names, shares, strict=True) if share > 1e-6]
        raise InputError("lab.parameters_mixed", where=where, parameters=tuple(mixed))
    scaled = right.T @ ((left.T @ measured) / singular)
    value = scaled / lengths
    residual = measured - design @ value
    dof = n - k
    sigma = float(np.sqrt(np.sum(residual**2) / dof))
    inverse = (right.T / singular) / lengths[:, None]
    return Fit(
        names=tuple(names),
        value=value,
        covariance=sigma**2 * inverse @ inverse.T,
        residual=residual,
        sigma=sigma,
        dof=dof,
        condition=float(singular[0] / singular[-1]),
    )


def affine_fits(
    true: FloatArray, measured: FloatArray, where: Sequence[str], used: BoolArray | None = None
) -> tuple[Fit, ...]:
    """Fit each column of `measured` (n, m) by three components (n, 3) and a bias. `used` (n, m): rows that count."""
    design = np.column_stack((true, np.ones(len(true))))
    rows = np.ones(measured.shape, dtype=np.bool_) if used is None else used
    sensors = zip(measured.T, rows.T, where, strict=True)
    return tuple(linear_fit(design[good], column[good], AFFINE, where=name) for column, good, name in sensors)
