"""The closed short-time laws of inertial error, on paper: Earth rate and curvature of the Earth dropped.

An accelerometer error is integrated once to velocity and twice to position; a gyro error is integrated once to a tilt,
which lets gravity g into the level axes, so that it comes to ``g`` times its second integral in velocity and its third
in position. So every law is the standard deviation of an n-fold integral of an error of unit size (`integral`), and the
named functions below say which. Compare Groves (2013), section 14.2 and chapter 5 (short-term error propagation);
Titterton and Weston, "Strapdown Inertial Navigation Technology", 2nd ed. (2004), chapter 12; for the integrals of white
noise Papoulis, "Probability, Random Variables, and Stochastic Processes" (1991), chapter 10.

Beyond two minutes the loop through the Earth's curvature counts: an error in position tilts the level. Then every
n-fold integral is replaced by its counterpart in the closed Schuler loop (`schuler`), ``w_s^2 = g / R``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from insnav.imu.error_terms import Process
from insnav.types import FloatArray

SHORT = 120.0  # up to here the short forms, beyond it the closed Schuler forms [s]
_SERIES = 0.5  # below this share of the correlation time the series of the Gauss-Markov integrals


def integral(kind: Process, order: int, time: ArrayLike, correlation_time: float = math.inf) -> FloatArray:
    """Standard deviation of the n-fold integral of an error of unit size that begins at time zero.

    Parameters
    ----------
    kind : str
        How the error goes on; see `insnav.errors.budget.sources.Source`. Flicker noise has no law of its own: it is a
        sum of Gauss-Markov processes.
    order : int
        n; 1, 2 or 3 for a Gauss-Markov process.
    time : array_like
        [s].
    correlation_time : float
        Of a Gauss-Markov process [s].

    Returns
    -------
    array
        [s^n], [s^(n + 1)] for a ramp, [s^(n - 1/2)] for white noise, [s^(n + 1/2)] for a random walk.

    Notes
    -----
    A constant: ``t^n / n!``. A ramp is the integral of a constant, n + 1. The n-fold integral of white noise w is
    ``int (t - u)^(n-1) / (n-1)! w(u) du``, so its variance is ``t^(2n-1) / ((2n-1) (n-1)!^2)``: t, t^3/3, t^5/20,
    t^7/252. A random walk is the integral of white noise, n + 1. A Gauss-Markov process has the double integral of
    ``exp(-|u - v| / T)`` with the same kernels.
    """
    t = np.asarray(time, dtype=np.float64)
    if kind == "constant" or (kind == "Gauss-Markov" and math.isinf(correlation_time)):
        return np.asarray(t**order / math.factorial(order))
    if kind == "ramp":
        return integral("constant", order + 1, t)
    if kind == "white":
        return np.asarray(t ** (order - 0.5) / (math.sqrt(2 * order - 1) * math.factorial(order - 1)))
    if kind == "random walk":
        return integral("white", order + 1, t)
    return np.asarray(correlation_time**order * np.sqrt(_markov(order, t / correlation_time)))


def _markov(order: int, z: FloatArray) -> FloatArray:
    """Variance of the n-fold integral of a Gauss-Markov process of unit variance and unit correlation time.

    The closed forms lose their digits where z is small: there the series of the same functions.
    """
    small = np.minimum(z, _SERIES)
    series = np.zeros_like(small)
    for k in range(2 * order, 2 * order + 16):
        if order == 1:
            term = 2.0
        elif order == 2:
            term = 2.0 * (k - 1.0)
        else:
            term = (k - 1.0) * (k - 2.0)
        series += (-1.0) ** k * term / math.factorial(k) * small**k
    large = np.maximum(z, _SERIES)
    fade = np.exp(-large)
    if order == 1:
        closed = 2.0 * (large - 1.0 + fade)
    elif order == 2:
        closed = 2.0 * (large**3 / 3.0 - large**2 / 2.0 + 1.0 - (1.0 + large) * fade)
    else:
        closed = large**5 / 10.0 - large**4 / 4.0 + large**3 / 3.0 - 2.0 + (large**2 + 2.0 * large + 2.0) * fade
    return np.where(z < _SERIES, series, closed)


def velocity(error: float, time: ArrayLike) -> FloatArray:
    """Position error [m] of an initial velocity error [m/s]: ``v t``."""
    return error * integral("constant", 1, time)


def tilt(error: float, time: ArrayLike, g: float) -> FloatArray:
    """Position error [m] of an initial tilt [rad]: gravity shows as ``g phi`` in a level axis, ``1/2 g phi t^2``."""
    return error * g * integral("constant", 2, time)


def heading(error: float, speed_gained: ArrayLike, time: ArrayLike) -> FloatArray:
    """Position error [m] across the way of a heading error [rad].

    The specific force that changes the velocity is turned by it, so that the velocity error is ``psi dv``; with a
    velocity `speed_gained` [m/s] that grows evenly from zero the position error is ``1/2 psi dv t``. At constant
    velocity a heading error does nothing.
    """
    return error * 0.5 * np.asarray(speed_gained, dtype=np.float64) * integral("constant", 1, time)


def accel_bias(error: float, time: ArrayLike) -> FloatArray:
    """Position error [m] of an accelerometer bias [m/s^2]: ``1/2 B t^2``.

    The same for whatever shows a constant acceleration: scale factor times specific force, misalignment times the
    specific force across, non-linearity times its square, gravity that the model does not have.
    """
    return error * integral("constant", 2, time)


def gyro_bias(error: float, time: ArrayLike, g: float) -> FloatArray:
    """Position error [m] of a gyro bias [rad/s]: the tilt is ``eps t``, the position ``1/6 g eps t^3``.

    The same for whatever shows a constant rate, such as g-sensitivity times gravity.
    """
    return error * g * integral("constant", 3, time)


def gyro_scale_factor(error: float, turned: float, time: ArrayLike, g: float) -> FloatArray:
    """Position error [m] of a gyro scale factor or misalignment [-] in a steady turn by `turned` [rad].

    About a level axis the tilt grows to ``s theta``, as with a bias ``s theta / t``: ``1/6 g s theta t^2``.
    """
    return error * turned * g * integral("constant", 2, time) / 3.0


def velocity_random_walk(density: float, time: ArrayLike) -> FloatArray:
    """Position error [m] of accelerometer white noise [m/s/sqrt(s)]: ``N t^1.5 / sqrt(3)``."""
    return density * integral("white", 2, time)


def angle_random_walk(density: float, time: ArrayLike, g: float) -> FloatArray:
    """Position error [m] of gyro white noise [rad/sqrt(s)]: ``g N sqrt(t^5 / 20)``."""
    return density * g * integral("white", 3, time)


def accel_rate_random_walk(density: float, time: ArrayLike) -> FloatArray:
    """Position error [m] of an accelerometer bias that walks at random [m/s^2/sqrt(s)]: ``K sqrt(t^5 / 20)``."""
    return density * integral("random walk", 2, time)


def gyro_rate_random_walk(density: float, time: ArrayLike, g: float) -> FloatArray:
    """Position error [m] of a gyro bias that walks at random [rad/s/sqrt(s)]: ``g K sqrt(t^7 / 252)``."""
    return density * g * integral("random walk", 3, time)


def accel_instability(sd: float, time: ArrayLike, correlation_time: float) -> FloatArray:
    """Position error [m] of an in-run accelerometer bias, a Gauss-Markov process of standard deviation `sd` [m/s^2].

    With z = t / T: ``sd T^2 sqrt(2 (z^3/3 - z^2/2 + 1 - (1 + z) e^-z))``, for t << T that of a bias.
    """
    return sd * integral("Gauss-Markov", 2, time, correlation_time)


def gyro_instability(sd: float, time: ArrayLike, correlation_time: float, g: float) -> FloatArray:
    """Position error [m] of an in-run gyro bias, a Gauss-Markov process of standard deviation `sd` [rad/s].

    With z = t / T: ``g sd T^3 sqrt(z^5/10 - z^4/4 + z^3/3 - 2 + (z^2 + 2 z + 2) e^-z)``, for t << T that of a bias.
    """
    return sd * g * integral("Gauss-Markov", 3, time, correlation_time)


def schuler(kind: Process, order: int, time: ArrayLike, rate: float) -> FloatArray:
    """What the closed Schuler loop makes of an n-fold integral, as a factor on the short form.

    Parameters
    ----------
    kind : str
        How the error goes on. What changes slowly (Gauss-Markov, flicker) is taken as constant here.
    order : int
        n, 0 to 4.
    time : array_like
        [s], above zero.
    rate : float
        Schuler rate ``sqrt(g / R)`` [rad/s].

    Returns
    -------
    array
        One for short times.

    Notes
    -----
    The loop ``dv' = -g phi + B``, ``phi' = dv / R - eps`` answers a constant with x = w_s t by cos x, sin x / x,
    2 (1 - cos x) / x^2, 6 (x - sin x) / x^3 times the short form, n = 0 to 3 (Groves 2013, section 5.7; Titterton and
    Weston 2004, chapter 12). The next integral goes by 24 (x^2 / 2 - 1 + cos x) / x^4. White noise is the sum of the
    squares of answers to pulses: the integral of the square of the answer of one order less.
    """
    x = rate * np.asarray(time, dtype=np.float64)
    if kind == "random walk":
        return schuler("white", order + 1, time, rate)
    if kind == "ramp":
        return schuler("constant", order + 1, time, rate)
    s, c = np.sin(x), np.cos(x)
    if kind == "white":
        squares = (
            x / 2 + s * c / 2,
            x / 2 - s * c / 2,
            1.5 * x - 2 * s + s * c / 2,
            x**3 / 3 + 2 * x * c - 2 * s + x / 2 - s * c / 2,
        )
        return np.asarray(np.sqrt(squares[order - 1]) / integral("white", order, x))
    answers = (c, s, 1 - c, x - s, x * x / 2 - 1 + c)
    return np.asarray(answers[order] / integral("constant", order, x))
