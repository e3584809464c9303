"""How sure a figure of overlapping windows is: blocks of them drawn anew.

Windows that overlap have errors alike. Blocks as long as the overlap keep neighbours together, so that what is drawn
varies as much as other drives would (moving, circular blocks: Politis and Romano, "A circular block-resampling
procedure for stationary data", 1992; Lahiri, "Resampling Methods for Dependent Data", 2003, chapter 2).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import t as student

from insnav.types import FloatArray

DRAWS = 1000
CONFIDENCE = 0.95
FEWEST = 4.0  # independent windows below which no interval is told
_SEED = 20210412


def effective_count(start: FloatArray, length: float) -> float:
    """How many windows that do not overlap the windows amount to.

    Parameters
    ----------
    start : (n,) array
        Where they begin, increasing [s].
    length : float
        Of each [s].

    Returns
    -------
    float
        Time that they cover together by their length: between 1 and n.
    """
    if len(start) == 0:
        return 0.0
    covered = float(np.minimum(np.diff(start), length).sum()) + length
    return covered / length


def block_weights(start: FloatArray, length: float, draws: int = DRAWS) -> FloatArray:
    """How often each window is in each draw of blocks that are as long as the overlap.

    Parameters
    ----------
    start : (n,) array
        Where the windows begin, increasing [s].
    length : float
        Of each [s].
    draws : int

    Returns
    -------
    (draws, n) array
        Always the same for the same windows; each row has the sum n.
    """
    n = len(start)
    size = min(n, max(1, int(np.ceil(n / effective_count(start, length)))))
    rng = np.random.default_rng(_SEED)
    first = rng.integers(0, n, size=(draws, -(-n // size)))
    rows = ((first[:, :, None] + np.arange(size)) % n).reshape(draws, -1)[:, :n]
    flat = np.bincount((rows + n * np.arange(draws)[:, None]).ravel(), minlength=draws * n)
    return np.asarray(flat.reshape(draws, n), dtype=np.float64)


def means(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Mean over the windows in each draw of what is known.

    Parameters
    ----------
    values : (n, ...) array
        ``NaN`` where not known.
    weights : (draws, n) array
        From `block_weights`.

    Returns
    -------
    (draws, ...) array
        ``NaN`` where nothing is known.
    """
    known = np.isfinite(values)
    shape = values.shape[1:]
    total = weights @ np.where(known, values, 0.0).reshape(len(values), -1)
    count = weights @ known.reshape(len(values), -1).astype(np.float64)
    with np.errstate(invalid="ignore"):
        return np.asarray((total / np.where(count > 0.0, count, np.nan)).reshape(-1, *shape))


def interval(
    start: FloatArray, length: float, statistic: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Interval of a figure that holds with 95 %.

    Parameters
    ----------
    start : (n,) array
        Where the windows begin [s].
    length : float
        Of each [s].
    statistic : callable
        Given the weights ``(draws, n)``, the figure of each draw ``(draws, ...)``.

    Returns
    -------
    low, high : array
        ``NaN`` where there are fewer than `FEWEST` independent windows.

    Notes
    -----
    Quantiles of the draws are too narrow for few independent windows: they hold with 62 % for four of them. The scatter
    of the draws' logarithm, with Student's t of as many degrees of freedom as there are independent windows less one,
    holds with about 90 % for four to sixty.
    """
    weights = block_weights(start, length)
    found, middle = statistic(weights), statistic(np.ones((1, weights.shape[1])))[0]
    count = effective_count(start, length)
    if count < FEWEST:
        return np.full_like(middle, np.nan), np.full_like(middle, np.nan)
    reach = float(student.ppf(0.5 * (1.0 + CONFIDENCE), count - 1.0)) * np.sqrt(count / (count - 1.0))
    # what may be nothing has no logarithm
    positive = (found > 0.0).all(axis=0) & (middle > 0.0)
    size = np.where(positive, found, 1.0)
    spread = np.exp(reach * np.std(np.log(size), axis=0))
    wide = reach * np.std(found, axis=0)
    low = np.where(positive, middle / spread, np.maximum(middle - wide, 0.0))
    return np.asarray(low), np.asarray(np.where(positive, middle * spread, middle + wide))
