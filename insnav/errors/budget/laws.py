"""Closed short-time laws of inertial error, without Earth rate and curvature.

An accelerometer error is integrated once to velocity and twice to position: ``B t^2 / 2`` for a bias,
``N t^1.5 / sqrt(3)`` for white noise. A gyro error is integrated once to a tilt, which couples gravity g into the level
axes. Velocity and position are ``g`` times its second and third integral: ``g eps t^3 / 6`` for a bias,
``g N sqrt(t^5 / 20)`` for white noise. Each law is the standard deviation of an n-fold integral of a unit error
(`integral`). Compare Groves (2013), section 14.2 and chapter 5 (short-term error propagation); Titterton and Weston,
"Strapdown Inertial Navigation Technology", 2nd ed. (2004), chapter 12. For integrals of white noise: Papoulis,
"Probability, Random Variables, and Stochastic Processes" (1991), chapter 10.

Beyond two minutes the feedback through the Earth's curvature matters: a position error tilts the level. The closed
Schuler loop (`schuler`), ``w_s^2 = g / R``, then replaces every n-fold integral.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from insnav.imu.error_terms import Process
from insnav.types import FloatArray

SHORT = 120.0  # up to here the short forms, beyond it the closed Schuler forms [s]


def integral(kind: Process, order: int, time: ArrayLike) -> FloatArray:
    """Compute the standard deviation of the n-fold integral of a unit error that begins at time zero.

    `kind`: process of the error, ``constant``, ``ramp``, ``white`` or ``random walk``; see
    `insnav.imu.error_terms.ErrorTerm`. `order`: n; `time` [s].
    Returns: [s^n], [s^(n + 1)] for a ramp, [s^(n - 1/2)] for white noise, [s^(n + 1/2)] for a random walk.

    Notes
    -----
    A constant: ``t^n / n!``. A ramp is the integral of a constant, n + 1. The n-fold integral of white noise w is
    ``int (t - u)^(n-1) / (n-1)! w(u) du``, so its variance is ``t^(2n-1) / ((2n-1) (n-1)!^2)``: t, t^3/3, t^5/20,
    t^7/252. A random walk is the integral of white noise, n + 1.
    """
    t = np.asarray(time, dtype=np.float64)
    if kind in ("ramp", "random walk"):
        return integral("constant" if kind == "ramp" else "white", order + 1, t)
    if kind == "constant":
        return np.asarray(t**order / math.factorial(order))
    return np.asarray(t ** (order - 0.5) / (math.sqrt(2 * order - 1) * math.factorial(order - 1)))


def schuler(kind: Process, order: int, time: ArrayLike, rate: float) -> FloatArray:
    """Compute the factor of the closed Schuler loop on the short form of an n-fold integral.

    `kind`: process of the error; slow processes (Gauss-Markov, flicker) count as constant. `time` [s], above zero.
    `rate`: Schuler rate ``sqrt(g / R)`` [rad/s].
    Returns: one for short times.

    Notes
    -----
    The loop ``dv' = -g phi + B``, ``phi' = dv / R - eps`` multiplies the short form of a constant by a factor of
    x = w_s t. For n = 0 to 4 it is ``cos x``, ``sin x / x``, ``2 (1 - cos x) / x^2``, ``6 (x - sin x) / x^3`` and
    ``24 (x^2 / 2 - 1 + cos x) / x^4``. Sources up to n = 3: Groves (2013), section 5.7; Titterton and Weston (2004),
    chapter 12. White noise sums squared pulse responses:
    the integral of the squared response of one order less.
    """
    x = rate * np.asarray(time, dtype=np.float64)
    if kind in ("ramp", "random walk"):
        return schuler("constant" if kind == "ramp" else "white", order + 1, time, rate)
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
