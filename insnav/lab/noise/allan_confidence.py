"""How sure overlapping Allan deviations are, and how they depend on one another.

Second differences of a Gaussian signal are Gaussian, so the covariance of two Allan variances is twice the mean of the
squared covariances of their second differences, which the noise model gives (C. A. Greenhall and W. J. Riley,
Uncertainty of stability variances based on finite differences, Proc. 35th PTTI Meeting (2003)). Nothing of the record
is needed for it but its length.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from insnav.kernels.allan import variance_covariance
from insnav.types import FloatArray, IntArray

FEW_FREEDOM = 3.0  # with fewer equivalent degrees of freedom an interval spans a factor of three and more


def covariance(
    factors: IntArray, n: int, interval: float, squares: FloatArray, correlation_time: float, *, diagonal: bool = False
) -> FloatArray:
    """Covariance of the Allan variances of one record.

    factors (k,): averaging times [samples]; n: number of samples; interval: sampling interval [s]; squares (5,):
    q^2 [unit^2 s^2], N^2 [unit^2 s], B^2 [unit^2], K^2 [unit^2/s] and variance of a Gauss-Markov process [unit^2];
    correlation_time: of that process [s]; diagonal: only the variances are filled. Returns (k, k): [unit^4].
    """
    out = np.zeros((factors.size, factors.size))
    scaled = squares * interval ** np.array([-2.0, -1.0, 0.0, 1.0, 0.0])
    size = float(scaled.max()) or 1.0
    time = correlation_time / interval if np.isfinite(correlation_time) else 1.0
    variance_covariance(factors, n + 1, scaled / size, time, diagonal, out)
    return out * size**2


def freedom(variance: FloatArray, estimate_variance: FloatArray) -> FloatArray:
    """Equivalent degrees of freedom ``2 E^2 / var`` (NIST SP 1065, section 5.4.1).

    variance (k,): Allan variances of the model; estimate_variance (k,): variances of their estimates.
    """
    return np.asarray(2.0 * variance**2 / estimate_variance)


def chi_square_interval(
    value: FloatArray | float, degrees: FloatArray | float, confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Confidence interval of a standard deviation from an estimate with chi-square distributed square.

    value (k,): estimated standard deviations; degrees (k,): their degrees of freedom; confidence: such as 0.95, the
    same part left out on both sides. Returns low, high (k,): ``value sqrt(degrees / chi^2)`` (NIST SP 1065, section
    5.3).
    """
    tail = 0.5 * (1.0 - confidence)
    low = value * np.sqrt(degrees / chi2.ppf(1.0 - tail, degrees))
    high = value * np.sqrt(degrees / np.maximum(chi2.ppf(tail, degrees), np.finfo(float).tiny))
    return low, high
