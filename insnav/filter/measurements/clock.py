"""Clock offset between a log and the IMU, from the speed in both."""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded on first use

from insnav.types import BoolArray, FloatArray

STEP = 0.2  # step of the search, before a finer fit [s]
LEAST_OVERLAP = 60.0  # least common time of both records [s]
LEAST_CORRELATION = 0.9  # of two records of one motion; hills and corners alone give 0.5
APART = 5.0  # offsets farther apart are different solutions [s]
CLEARER = 2.0  # least ratio of unexplained parts, every other offset to the best, ...
LEAST_UNEXPLAINED = 0.02  # ... whose unexplained part is at least this, however well two speeds agree [-]
LONGEST_GAP = 1.0  # longest interval over which a speed is interpolated [s]


def clock_offset(time: FloatArray, speed: FloatArray, log_time: FloatArray, log_speed: FloatArray) -> float | None:
    """Find the clock offset of a log, whatever its epoch: the shift of greatest correlation.

    On a repetitive route several shifts are similar; clocks that agree within seconds then decide.

    `time`, `speed` (n,): times [s] and known speed [m/s]. `log_time`, `log_speed` (m,): of the log; any unit of speed.
    Returns: time by the log minus time [s]; None if no shift stands out.
    """
    a, known_a = _even(time, speed)
    b, known_b = _even(log_time, log_speed)
    if min(a.size, b.size) * STEP < LEAST_OVERLAP:
        return None

    def sums(x: FloatArray, y: FloatArray) -> FloatArray:
        """Compute the sum of ``x[i] y[i + k]`` for every shift k, from ``1 - x.size`` on."""
        return np.asarray(scipy.signal.fftconvolve(y, x[::-1]))

    # centred correlation of the common rows, at every shift at once
    n = sums(known_a, known_b)
    enough = n * STEP >= max(LEAST_OVERLAP, 0.5 * STEP * min(known_a.sum(), known_b.sum()))
    n = np.maximum(n, 1.0)
    mean_a, mean_b = sums(a, known_b) / n, sums(known_a, b) / n
    power = (sums(a * a, known_b) / n - mean_a**2) * (sums(known_a, b * b) / n - mean_b**2)
    correlation = (sums(a, b) / n - mean_a * mean_b) / np.sqrt(np.maximum(power, 1e-6))
    correlation = np.where(enough, correlation, -1.0)
    offset = (np.arange(correlation.size) - (a.size - 1)) * STEP + log_time[0] - time[0]
    best = int(np.argmax(correlation))
    if correlation[best] < LEAST_CORRELATION:
        return None
    alike = 1.0 - correlation < max(CLEARER * (1.0 - correlation[best]), LEAST_UNEXPLAINED)
    if np.ptp(offset[alike]) > 2.0 * APART:
        alike &= np.abs(offset) <= APART
        if not alike.any():
            return None
        best = int(np.argmax(np.where(alike, correlation, -1.0)))
    before, peak, after = correlation[np.clip([best - 1, best, best + 1], 0, correlation.size - 1)]
    curvature = before - 2.0 * peak + after
    between = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0  # vertex of the parabola
    return float(offset[best] + between * STEP)


def near_values(time: FloatArray, at: FloatArray) -> BoolArray:
    """Find where values at `time` are close enough on both sides of `at` for interpolation, (n,)."""
    after = np.clip(np.searchsorted(time, at), 1, time.shape[0] - 1)
    inside = (at >= time[0]) & (at <= time[-1])
    return np.asarray(inside & (time[after] - time[after - 1] <= LONGEST_GAP))


def _even(time: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Resample speed at even times, zero in gaps; also return 1 where it is known."""
    at = np.arange(time[0], time[-1], STEP)
    known = near_values(time, at).astype(np.float64)
    return np.interp(at, time, speed) * known, known
