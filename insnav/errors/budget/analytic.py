"""The analytic budget: the short laws applied to a list of sources, with the motion's own integrals where it counts.

Constant errors are integrated along the attitude and the specific force of the motion: at rest this is ``1/2 B t^2``
and the like to the last digit; turns and accelerations bring in scale factor, misalignment and heading. Noise follows
the laws of `insnav.errors.budget.laws`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from insnav.earth import gravity_n, radii
from insnav.errors.budget import laws
from insnav.errors.budget.covariance import at_start, disturbance, processes
from insnav.errors.budget.sampled_motion import SampledMotion
from insnav.errors.budget.sources import BODY, Source
from insnav.types import FloatArray, IntArray

# how often a constant is integrated on its way to tilt, velocity and position; None: the loop does not touch it
_ORDERS = {
    "initial velocity": (None, 0, 1),
    "initial tilt": (0, 1, 2),
    "initial heading": (None, 1, 2),
    "gyro": (1, 2, 3),
    "accel": (None, 1, 2),
    "gravity": (None, 1, 2),
}


def gravity_of(motion: SampledMotion) -> float:
    """Gravity where a motion begins [m/s^2]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.linalg.norm(gravity_n(lat, height)))


def schuler_rate(motion: SampledMotion) -> float:
    """Schuler rate where a motion begins, ``sqrt(g / R)`` with the mean of both radii of curvature [rad/s]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.sqrt(gravity_of(motion) / (np.mean(radii(lat)) + height)))


def analytic(sources: tuple[Source, ...], motion: SampledMotion, rows: IntArray, *, hold: bool = False) -> FloatArray:
    """Standard deviation that each source makes, by closed forms.

    `rows` (m,): samples after which results are wanted, increasing.
    Returns: (m, s, 9): of position N, E, D [m], velocity [m/s], attitude [rad]: short forms up to `laws.SHORT`, beyond
    it the closed Schuler forms in the level axes. The vertical channel is that of the short forms at all times.
    """
    time, g, rate = motion.elapsed[rows - 1], gravity_of(motion), schuler_rate(motion)
    out = np.zeros((len(rows), len(sources), 9))
    force_n, mean_square = motion.force_n, np.cumsum(motion.C_nb**2 * motion.dt[:, None, None], axis=0)
    along = np.sqrt(mean_square[rows - 1] / time[:, None, None])  # what of axis j points along local axis i
    for k, source in enumerate(sources):
        if source.sd == 0.0:
            continue
        if source.kind in ("constant", "ramp"):
            out[:, k] = source.sd * np.abs(_constant(source, motion, force_n)[rows])
        else:
            out[:, k] = _noise(source, motion, rows, force_n, along[:, :, BODY.index(source.axis)], g)
        out[:, k] *= _in_the_loop(source, time, rate)
    if hold:
        out[..., [2, 5]] = 0.0
    return out


def _constant(source: Source, motion: SampledMotion, force_n: FloatArray) -> FloatArray:
    """Errors by a unit of a constant source at the ends of all samples, ``(n + 1, 9)``.

    ``phi' = -C e_gyro``, ``dv' = f x phi + C e_accel``, ``dp' = dv``.
    """
    dt = motion.dt[:, None]
    state, given = np.tile(at_start(source), (len(dt) + 1, 1)), disturbance(source, motion)
    phi, velocity, position = state[:, 6:], state[:, 3:6], state[:, :3]
    phi[1:] += np.cumsum(given[:, :3] * dt, axis=0)
    push = np.cross(force_n, 0.5 * (phi[1:] + phi[:-1])) + given[:, 3:]
    velocity[1:] += np.cumsum(push * dt, axis=0)
    position[1:] += np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt, axis=0)
    return state


def _noise(
    source: Source, motion: SampledMotion, rows: IntArray, force_n: FloatArray, along: FloatArray, g: float
) -> FloatArray:
    """Standard deviations by a noise, ``(m, 9)``.

    White noise follows its law along the mean direction of its axis. A slowly changing bias acts as a constant one on
    this motion, smaller by the ratio of the two laws.
    """
    time = motion.elapsed[rows - 1]
    orders = (3, 2, 1) if source.group == "gyro" else (2, 1, 0)  # of position, velocity, attitude
    variance = np.zeros((len(rows), 9))
    bias = _constant(replace(source, kind="constant", term="bias"), motion, force_n)[rows]
    for white, drive, decay, first in processes(source, motion):
        if white > 0.0:
            variance += (math.sqrt(white) * _white(source.group, time, along, g)) ** 2
            continue
        for part, order in enumerate(orders):
            if first > 0.0:
                law = math.sqrt(first) * laws.integral(
                    "Gauss-Markov", max(order, 1), time, 1.0 / decay if decay else np.inf
                )
            else:
                law = math.sqrt(drive) * laws.integral("random walk", max(order, 1), time)
            share = law / laws.integral("constant", max(order, 1), time)
            columns = slice(3 * part, 3 * part + 3)
            variance[:, columns] += (share[:, None] * bias[:, columns]) ** 2
    return np.asarray(np.sqrt(variance))


def _white(group: str, time: FloatArray, along: FloatArray, g: float) -> FloatArray:
    """By unit white noise of an axis that points `along` (m, 3) North, East, Down."""
    once, twice, thrice = (laws.integral("white", order, time)[:, None] for order in (1, 2, 3))
    if group == "accel":
        return np.concatenate([along * twice, along * once, 0.0 * along], axis=1)
    # a tilt about east lets gravity into north, and the other way round
    level = g * along[:, [1, 0, 2]] * [1.0, 1.0, 0.0]
    return np.concatenate([level * thrice, level * twice, along * once], axis=1)


def _in_the_loop(source: Source, time: FloatArray, rate: float) -> FloatArray:
    """Factor of the Schuler loop on the level errors beyond `laws.SHORT`, ``(m, 9)``."""
    factor = np.ones((len(time), 9))
    orders = _ORDERS.get(source.family) or _ORDERS.get(source.group)
    late = time > laws.SHORT
    if orders is None or not late.any():
        return factor
    for order, columns in zip(orders, (slice(6, 8), slice(3, 5), slice(0, 2)), strict=True):
        if order is not None:
            factor[late, columns] = np.abs(laws.schuler(source.kind, order, time[late], rate))[:, None]
    return factor
