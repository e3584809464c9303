"""Recorded error over predicted error: one line through all windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.errors.outage.free_inertial import Windows
from insnav.errors.outage.statistics import columns_at, components, table_times
from insnav.sample_statistics import CONFIDENCE, chi_square, effective_count, interval
from insnav.types import FloatArray

_MEAN_SIZE = np.sqrt(2.0 / np.pi)  # of a normal number, by its standard deviation
_ONE_SENSOR = 1.7  # numbers that the turn-on errors of two level axes are, unequal as they are (201 simulated drives)


@dataclass(frozen=True, slots=True)
class Regression:
    """Size of the recorded error by its predicted standard deviation."""

    slope: float  # one if the prediction is right, two if errors are twice as large
    # 95 % confidence interval: the wider of a block bootstrap and of chi-square with two axes of as many windows as are
    # independent, one if all have the same turn-on errors; ``NaN`` if the effective sample size is too small
    low: float
    high: float
    # share of the variation of the sizes that the line explains [-]: at most about 0.6 for normal errors of very
    # different predicted size, and less the more alike the predictions are
    r_squared: float
    # (m,) the points: predicted standard deviation, reference included, and size of the error over the mean size of a
    # standard normal number [m]
    predicted: FloatArray
    recorded: FloatArray


def regression(windows: Windows) -> Regression:
    """Regress North and East errors at the times of the tables on their prediction, through the origin.

    The points are weighted by the inverse of their predicted variance, as the scatter grows with the size.
    """
    at = columns_at(windows, table_times(windows))
    error, variance, reference = (values[:, at, :2] for values in components(windows))
    predicted = np.sqrt(variance + reference)
    recorded = np.abs(error) / _MEAN_SIZE

    ratio, known = recorded / predicted, np.isfinite(recorded)
    total, count = np.where(known, ratio, 0.0).sum(axis=(1, 2)), known.sum(axis=(1, 2))

    def slope(weights: FloatArray) -> FloatArray:
        return np.asarray((weights @ total) / (weights @ count))

    low, high = interval(windows.start, windows.length, slope)
    found = float(np.mean(ratio[known]))
    freedom = _ONE_SENSOR if windows.uncalibrated else 2.0 * effective_count(windows.start, windows.length)
    ends = (chi_square(freedom, 0.5 + sign * 0.5 * CONFIDENCE) for sign in (1.0, -1.0))
    narrow, wide = (found * np.sqrt(freedom / end) for end in ends)
    low, high = np.minimum(low, narrow), np.maximum(high, wide)
    x, y = predicted[known], recorded[known]
    left = float(np.sum((y - found * x) ** 2 / x**2))
    mean = float(np.sum(y / x**2) / np.sum(1.0 / x**2))
    about = float(np.sum((y - mean) ** 2 / x**2))
    return Regression(found, float(low), float(high), 1.0 - left / about if about > 0.0 else np.nan, x, y)
