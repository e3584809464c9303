"""Noise of known coefficients, made from the definitions."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from insnav.types import FloatArray, ImuData


def noise(
    rng: np.random.Generator,
    n: int,
    interval: float,
    *,
    Q: float = 0.0,
    N: float = 0.0,
    K: float = 0.0,
    R: float = 0.0,
    sd: float = 0.0,
    time: float = 1.0,
) -> FloatArray:
    """Samples that are means over their intervals; `sd` and `time` are of a Gauss-Markov process."""
    values = rng.standard_normal(n) * N / math.sqrt(interval)
    values += np.cumsum(rng.standard_normal(n)) * K * math.sqrt(interval)
    values += R * interval * np.arange(n)
    values += np.diff(rng.uniform(-0.5, 0.5, n + 1)) * math.sqrt(12.0) * Q / interval
    if sd > 0.0:
        decay = math.exp(-interval / time)
        before = 20 * int(time / interval)
        drive = rng.standard_normal(n + before) * sd * math.sqrt(1.0 - decay**2)
        values += lfilter([1.0], [1.0, -decay], drive)[before:]
    return values


def at_rest(n: int, interval: float, **more: object) -> ImuData:
    """An IMU without errors, level and still; stamps at the ends of the intervals."""
    time = interval * np.arange(1, n + 1)
    accel = np.tile([0.0, 0.0, -9.80665], (n, 1))
    return ImuData(time, np.zeros((n, 3)), accel, **more)  # type: ignore[arg-type]
