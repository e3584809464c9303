"""How sure a figure of overlapping windows is: blocks of them drawn anew.

Windows that overlap have errors alike. Blocks as long as the overlap keep neighbours together, so that what is drawn
varies as much as other drives would (moving, circular blocks: Politis and Romano, "A circular block-resampling
procedure for stationary data", 1992; Lahiri, "Resampling Methods for Dependent Data", 2003, chapter 2).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from insnav.types import FloatArray, IntArray

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


def block_rows(start: FloatArray, length: float, draws: int = DRAWS) -> IntArray:
    """Rows of windows drawn in blocks that are as long as the overlap.

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
        Always the same for the same windows.
    """
    n = len(start)
    size = min(n, max(1, int(np.ceil(n / effective_count(start, length)))))
    rng = np.random.default_rng(_SEED)
    first = rng.integers(0, n, size=(draws, -(-n // size)))
    rows = (first[:, :, None] + np.arange(size)) % n
    return np.asarray(rows.reshape(draws, -1)[:, :n], dtype=np.int64)


def interval(
    start: FloatArray, length: float, statistic: Callable[[IntArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Interval of a figure that holds with 95 %.

    Parameters
    ----------
    start : (n,) array
        Where the windows begin [s].
    length : float
        Of each [s].
    statistic : callable
        Given the rows ``(draws, n)``, the figure of each draw ``(draws, ...)``.

    Returns
    -------
    low, high : array
        Quantiles of the draws; ``NaN`` where there are fewer than `FEWEST` independent windows.
    """
    found = statistic(block_rows(start, length))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(found, [tail, 1.0 - tail], axis=0)
    if effective_count(start, length) < FEWEST:
        return np.full_like(low, np.nan), np.full_like(high, np.nan)
    return low, high
