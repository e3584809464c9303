"""Noise of a measurement from its residuals in a first pass: robust fits and time-correlated noise."""

from __future__ import annotations

import numpy as np

from insnav.types import FloatArray

INTERVAL = 0.25  # between aiding measurements of a kind [s]
# A residual that persists for minutes is systematic: white noise cannot represent it. Beyond this inflation the
# measurement would have no weight.
LARGEST_INFLATION = 3.0
UNCORRELATED = 0.05  # a smaller autocorrelation is chance [-]


def robust_fit(design: FloatArray, values: FloatArray, step: float) -> tuple[FloatArray, FloatArray, float]:
    """Least squares with Huber's weights (P. J. Huber, Robust Statistics, 1981, chapter 7).

    `design`, `values` (n,). `step`: time between rows [s].
    Returns: `found`, `residual` (n,). `sd`: standard deviation of the first parameter, with the effective sample size
    of time-correlated residuals.
    """
    weight = np.ones(values.shape[0])
    found: FloatArray = np.zeros(design.shape[1])
    residual: FloatArray = values.copy()
    for _ in range(10):
        found[:] = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
        residual[:] = values - design @ found
        # 1.4826 median |r| is the standard deviation of a normal distribution; 1.5 of it is Huber's usual limit
        scale = 1.4826 * float(np.median(np.abs(residual))) or 1.0
        weight = np.sqrt(np.minimum(1.0, 1.5 * scale / np.maximum(np.abs(residual), 1e-12)))
    covariance = np.linalg.inv((design * weight[:, None] ** 2).T @ design) * float(np.mean((weight * residual) ** 2))
    alike = _sum_of_correlations(residual, max(1, round(INTERVAL / step))) * max(1, round(INTERVAL / step))
    return found, residual, float(np.sqrt(covariance[0, 0] * alike))


def time_correlated_sd(residual: FloatArray, step: float) -> float:
    """Compute the sd of noise, white every `INTERVAL`, that averages out like a residual of rows `step` [s].

    The mean of m values has the variance ``sd^2 / m (1 + 2 sum rho_k)`` for m far beyond the correlation time.
    """
    rms = float(np.sqrt(np.mean(residual**2)))
    alike = _sum_of_correlations(residual, max(1, round(INTERVAL / step)))
    return rms * min(LARGEST_INFLATION, float(np.sqrt(alike)))


def _sum_of_correlations(residual: FloatArray, stride: int) -> float:
    """Compute ``1 + 2 sum rho_k`` over lags of `stride` rows, up to the first that is not positive."""
    r = residual[::stride]
    power = float(np.mean(r * r)) or 1.0
    total = 1.0
    for lag in range(1, min(r.shape[0] // 3, 400)):
        rho = float(np.mean(r[lag:] * r[:-lag])) / power
        if rho <= UNCORRELATED:
            break
        total += 2.0 * rho
    return total
