"""Error-free measurements of an exact motion: a perfect IMU, a perfect receiver, a reference."""

from __future__ import annotations

import numpy as np

from insnav.attitude import dcm_from_rph
from insnav.earth import earth_rate_n, lla_offset
from insnav.exceptions import ConfigError
from insnav.simulate.truth import Truth
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Trajectory

_LONGEST_PIECE = 0.02  # [s]; five nodes a piece leave less than 1e-13 of an increment up to 15 Hz
_FINE = 4.2  # pieces between two knots from which four nodes suffice: the motion is slower than the knots
_CHUNK = 1024  # pieces at a time: the arrays of one chunk fit in the cache
_SLIVER = 1e-9  # [s]; a knot closer to a sample time needs no separate piece


def imu_from_truth(truth: Truth, time: FloatArray, sampling: Sampling = "increment") -> ImuData:
    """Measure with a perfect IMU.

    `time` (n + 1,): edges of the sampling intervals [s], strictly increasing: sample i covers ``time[i]`` to
    ``time[i + 1]`` and is stamped with its end. ``instant`` has no intervals: (n,) times. `sampling` {"increment",
    "mean", "instant"}: integral over the interval, mean over it, or value at the instant. Returns: n samples, each
    integrated over its exact floating-point interval. Raises: ConfigError: times outside the motion, not increasing, or
    too few.
    """
    time = np.asarray(time, dtype=np.float64)
    if sampling == "instant":
        at = truth.evaluate(time)
        return ImuData(time, at.w_ib_b, at.f_b, sampling="instant")
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise ConfigError("sim.no_increasing_times", where="time", count=len(time))
    tau = truth.elapsed(time)
    total = integrate(truth, tau)
    if sampling == "mean":
        total /= np.diff(tau)[:, None]
    return ImuData(time[1:], total[:, :3].copy(), total[:, 3:].copy(), sampling=sampling, stamp="end")


def integrate(truth: Truth, edges: FloatArray) -> FloatArray:
    """Integrate angular rate [rad] and specific force [m/s] between successive edges ``(n + 1,)`` [s], ``(n, 6)``.

    Gauss-Legendre quadrature on pieces that end at every edge and every knot, so that derivatives are continuous within
    each. The edges count from the start of the motion.
    """
    knots = truth.knots
    breaks = pieces(edges, knots)
    half = 0.5 * np.diff(breaks)
    fine = len(knots) > 1 and 2.0 * half.max() * _FINE < np.median(np.diff(np.unique(knots)))
    abscissae, weights = np.polynomial.legendre.leggauss(4 if fine else 5)
    middle = breaks[:-1] + half
    parts = np.empty((len(half), 6))
    for i in range(0, len(half), _CHUNK):
        part = slice(i, i + _CHUNK)
        nodes = middle[part, None] + half[part, None] * abscissae
        w_ib_b, f_b = truth.sensed(nodes.ravel())
        for column, values in enumerate(w_ib_b + f_b):
            parts[part, column] = half[part] * (values.reshape(nodes.shape) @ weights)
    if len(breaks) == len(edges):
        return parts
    total: FloatArray = np.add.reduceat(parts, np.searchsorted(breaks, edges[:-1]), axis=0)
    return total


def pieces(edges: FloatArray, knots: FloatArray) -> FloatArray:
    """Return edges, the knots between them, and further points that limit pieces to `_LONGEST_PIECE`."""
    knots = np.unique(knots[(knots > edges[0]) & (knots < edges[-1])])
    after = np.searchsorted(edges, knots)
    clear = np.minimum(edges[after] - knots, knots - edges[after - 1]) > _SLIVER
    breaks = np.union1d(edges, knots[clear])
    count = np.ceil(np.diff(breaks) / _LONGEST_PIECE - 1e-6).astype(np.int64)
    if np.all(count <= 1):
        return breaks
    count = np.maximum(count, 1)
    step = np.repeat(np.diff(breaks) / count, count)
    number = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    return np.append(np.repeat(breaks[:-1], count) + number * step, breaks[-1])


def reference(truth: Truth, time: FloatArray) -> Trajectory:
    """Sample position, velocity and attitude of the IMU at times ``(n,)`` [s], strictly increasing.

    Raises: ConfigError: times outside the motion.
    """
    at = truth.evaluate(time)
    return Trajectory(np.asarray(time, dtype=np.float64), at.lla, at.v_n, at.rph)


def gps_from_truth(truth: Truth, time: FloatArray, lever_b: FloatArray) -> GpsData:
    """Measure with a perfect receiver at times ``(n,)`` [s], its antenna at `lever_b` ``(3,)`` from the IMU [m].

    Returns: position and velocity of the antenna, v + C_nb (w_eb_b x lever) (Groves 2013, section 14.3.1). The lever
    arm is projected on the tangent plane, with an error of 1e-7 m per metre. Standard deviations are unknown.
    Raises: ConfigError: times outside the motion.
    """
    at = truth.evaluate(time)
    C_nb = dcm_from_rph(at.rph)
    w_eb_n = (C_nb @ at.w_ib_b[:, :, None])[:, :, 0] - earth_rate_n(at.lla[:, 0])
    lever_n = C_nb @ np.asarray(lever_b, dtype=np.float64)
    unknown = np.full((len(at.lla), 3), np.nan)
    return GpsData(
        time=np.asarray(time, dtype=np.float64),
        lla=lla_offset(at.lla, lever_n),
        v_n=at.v_n + np.cross(w_eb_n, lever_n),
        position_sd=unknown,
        velocity_sd=unknown.copy(),
    )
