"""Analytic budget: closed short-time laws of inertial error, and the same integrals along a motion.

An accelerometer error is integrated once to velocity and twice to position: ``B t^2 / 2`` for a bias,
``N t^1.5 / sqrt(3)`` for white noise. A gyro error is integrated once to a tilt, which couples gravity g into the level
axes. Velocity and position are ``g`` times its second and third integral: ``g eps t^3 / 6`` for a bias,
``g N sqrt(t^5 / 20)`` for white noise. Each law is the standard deviation of an n-fold integral of a unit error
(`integral`), without Earth rate and curvature. Compare Groves (2013), section 14.2 and chapter 5 (short-term error
propagation); Titterton and Weston, "Strapdown Inertial Navigation Technology", 2nd ed. (2004), chapter 12. For
integrals of white noise: Papoulis, "Probability, Random Variables, and Stochastic Processes" (1991), chapter 10.

Beyond two minutes the feedback through the Earth's curvature matters: a position error tilts the level. The closed
Schuler loop (`schuler`), ``w_s^2 = g / R``, then replaces every n-fold integral.

For a list of sources, constant errors are integrated along attitude and specific force of the motion. At rest this
equals ``1/2 B t^2`` and similar laws to the last digit. Turns and accelerations add scale factor, misalignment and
heading errors. Noise is integrated likewise, pulse by pulse, and gives the laws at rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from insnav.earth import earth_rate_n, gravity_n, radii, transport_rate_n
from insnav.errors.budget.covariance import (
    Steps,
    at_start,
    disturbance,
    integrated,
    last_step,
    processes,
    steps_of,
    unit_of,
)
from insnav.errors.budget.sources import SampledMotion, Source
from insnav.imu.error_terms import Process
from insnav.kernels.noise_along_motion import noise_variances
from insnav.types import FloatArray, IntArray

SHORT = 120.0  # up to here the short forms, beyond it the closed Schuler forms [s]
_STEPS = 1500  # of the integrals of noise
# number of integrations of a constant up to tilt, velocity and position; None: the Schuler loop has no effect
_ORDERS = {
    "initial velocity": (None, 0, 1),
    "initial tilt": (0, 1, 2),
    "initial heading": (1, 2, 3),
    "gyro": (1, 2, 3),
    "accel": (None, 1, 2),
    "gravity": (None, 1, 2),
}


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
    The loop ``dv' = -g phi + B``, ``phi' = dv / R - eps`` multiplies the short form of a constant, with x = w_s t, by
    cos x, sin x / x, 2 (1 - cos x) / x^2, 6 (x - sin x) / x^3 for n = 0 to 3 (Groves 2013, section 5.7; Titterton and
    Weston 2004, chapter 12), and by 24 (x^2 / 2 - 1 + cos x) / x^4 for n = 4. White noise sums squared pulse responses:
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


def gravity_of(motion: SampledMotion) -> float:
    """Compute gravity at the start of a motion [m/s^2]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.linalg.norm(gravity_n(lat, height)))


def schuler_rate(motion: SampledMotion) -> float:
    """Compute the Schuler rate at the start of a motion, ``sqrt(g / R)`` with the mean radius of curvature [rad/s]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.sqrt(gravity_of(motion) / (np.mean(radii(lat)) + height)))


def analytic(sources: tuple[Source, ...], motion: SampledMotion, rows: IntArray, *, hold: bool = False) -> FloatArray:
    """Compute the standard deviation from each source, by closed forms.

    `rows` (m,): samples after which results are returned, increasing.
    Returns: (m, s, 9): of position N, E, D [m], velocity [m/s], attitude [rad]. Short forms apply up to `SHORT`,
    then the closed Schuler forms in the level axes. The vertical channel uses the short forms at all times.
    """
    time, rate = motion.elapsed[rows - 1], schuler_rate(motion)
    out = np.zeros((len(rows), len(sources), 9))
    steps = steps_of(motion, rows, count=_STEPS, longest=math.inf)
    at = np.searchsorted(steps.edges, rows)
    for k, source in enumerate(sources):
        if source.sd == 0.0:
            continue
        if source.kind in ("constant", "ramp"):
            out[:, k] = source.sd * np.abs(_constant(source, motion)[rows]) * _in_the_loop(source, time, rate)
        else:
            out[:, k] = _noise(source, motion, steps, at, np.where(time > SHORT, rate, 0.0))
    if hold:
        out[..., [2, 5]] = 0.0
    return out


def _constant(source: Source, motion: SampledMotion) -> FloatArray:
    """Compute errors from a unit constant source at the ends of all samples, ``(n + 1, 9)``.

    ``phi' = -C e_gyro``, ``dv' = f x phi + C e_accel``, ``dp' = dv``. Rotation of the level axes is included only where
    it alone couples an error: heading into the tilt, ``phi' = -w_in x psi``, vertical velocity into the level axes.
    """
    dt = motion.dt[:, None]
    state, given = np.tile(at_start(source), (len(dt) + 1, 1)), disturbance(source, motion)
    phi, velocity, position = state[:, 6:], state[:, 3:6], state[:, :3]
    heading, lat = state[0, 8], motion.lla[:, 0]
    w_ie, w_en = earth_rate_n(lat), transport_rate_n(lat, motion.lla[:, 2], motion.v_n)
    given[:, :3] -= np.cross(w_ie + w_en, [0.0, 0.0, heading])
    phi[1:] += np.cumsum(given[:, :3] * dt, axis=0)
    push = np.cross(motion.force_n, 0.5 * (phi[1:] + phi[:-1])) + given[:, 3:6]
    push[:, :2] -= np.cross(2.0 * w_ie + w_en, (np.cumsum(push * dt, axis=0) + velocity[0]) * [0.0, 0.0, 1.0])[:, :2]
    velocity[1:] += np.cumsum(push * dt, axis=0)
    position[1:] += np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt, axis=0)
    return state


def _noise(source: Source, motion: SampledMotion, steps: Steps, at: IntArray, loop: FloatArray) -> FloatArray:
    """Compute standard deviations from a noise, ``(m, 9)``.

    `at` (m,): steps after which results are returned. `loop` (m,): Schuler rate, zero for the short forms.

    Notes
    -----
    Pulse responses at u: a velocity error ``c`` becomes ``(t - u) c`` of position. An attitude error ``a`` couples the
    specific force into the velocity, ``(F(t) - F(u)) x a`` with its integral F, and so on. Their squares, or products
    with the autocorrelation of the noise, are integrated over u (Papoulis 1991, chapter 10). At rest this gives the
    laws of `integral`.
    """
    dt = steps.dt
    given = integrated(disturbance(unit_of(source), motion), motion, steps) / dt[:, None]
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(steps.force_n * dt[:, None], axis=0)])
    position = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt[:, None], axis=0)
    position = np.concatenate([np.zeros((1, 3)), position])
    white, drive, decay, first = np.array(processes(source, motion)).T.copy()
    gone = np.minimum(dt[:, None] * decay, 700.0)
    tau = 1.0 / np.maximum(decay, 1e-30)
    gained = np.where(gone > 0.0, -np.expm1(-gone) * tau, dt[:, None])
    # 2 (x - 1 + exp(-x)) of the step, by its series where that form cancels
    alone = np.where(gone > 0.01, 2.0 * (gone - 1.0 + np.exp(-gone)) * tau**2, dt[:, None] ** 2 * (1.0 - gone / 3.0))
    variance = np.empty((len(at), 9))
    noise_variances(
        dt,
        velocity,
        position,
        given,
        loop,
        at,
        white,
        np.where(first > 0.0, 0.0, drive),
        first,
        np.exp(-gone),
        gained,
        alone,
        variance,
    )
    if source.kind == "quantisation":
        variance += (source.sd * last_step(source, motion, steps.edges[at], hold=False)) ** 2
    return np.asarray(np.sqrt(variance))


def _in_the_loop(source: Source, time: FloatArray, rate: float) -> FloatArray:
    """Compute the factor of the Schuler loop on the level errors beyond `SHORT`, ``(m, 9)``."""
    factor = np.ones((len(time), 9))
    orders = _ORDERS.get(source.family) or _ORDERS.get(source.group)
    late = time > SHORT
    if orders is None or not late.any():
        return factor
    for order, columns in zip(orders, (slice(6, 8), slice(3, 5), slice(0, 2)), strict=True):
        if order is not None:
            factor[late, columns] = np.abs(schuler(source.kind, order, time[late], rate))[:, None]
    return factor
