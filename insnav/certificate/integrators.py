"""The integrators of the package in one shape, so that all of them get the same samples and the same questions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from insnav import strapdown
from insnav.attitude import quat_from_rotvec, quat_multiply
from insnav.strapdown import Method
from insnav.types import FloatArray, ImuData, Increments, Trajectory

METHODS: tuple[Method, ...] = ("polynomial", "rk4", "rotvec", "euler")  # the limits apply to the first


@dataclass(frozen=True, slots=True)
class Steps:
    """What an integrator makes of the samples of each interval."""

    # (n,) end and length [s]
    time: FloatArray
    dt: FloatArray
    rotation: FloatArray  # (n, 3) rotation vector of the body [rad]
    velocity: FloatArray  # (n, 3) integral of the specific force in the axes of the interval's start [m/s]


Start = tuple[FloatArray, FloatArray, FloatArray]  # latitude, longitude, height; velocity N, E, D; roll, pitch, heading


@dataclass(frozen=True, slots=True)
class Integrator:
    """One way from samples to attitude and position."""

    name: str
    steps: Callable[[ImuData], Steps]  # increments of a record, sampled as increments
    # trajectory of a record, ``(imu, start, height, v_down, every)``. The start is that at the end of the first sample,
    # as algorithms that look back need one before; height [m] and down velocity [m/s] are held to those at the ends of
    # the intervals that follow.
    navigate: Callable[[ImuData, Start, FloatArray, FloatArray, int], Trajectory]


def integrators() -> tuple[Integrator, ...]:
    """All strapdown integrators of this package; the first is the default one."""
    return tuple(Integrator(m, partial(_steps, m), partial(_navigate, m)) for m in METHODS)


def steps_of(inc: Increments) -> Steps:
    """Put increments together to rotation and velocity, as `insnav.types.Increments` defines them."""
    angle = np.linalg.norm(inc.dtheta, axis=1, keepdims=True)
    # (1 - cos a) / a^2 and (a - sin a) / a^3 without dividing by zero
    first = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    second = (1 - np.sinc(angle / np.pi)) / np.maximum(angle, 1e-4) ** 2
    cross = np.cross(inc.dtheta, inc.dvel)
    velocity = inc.dvel + first * cross + second * np.cross(inc.dtheta, cross) + inc.sculling
    return Steps(inc.time, inc.dt, inc.dtheta + inc.coning, velocity)


def attitude_after(rotation: FloatArray) -> FloatArray:
    """Quaternion after successive rotation vectors ``(n, 3)`` [rad], by pairs: roundings grow with log n."""
    q = quat_from_rotvec(rotation)
    while len(q) > 1:
        last = q[len(q) - len(q) % 2 :]
        q = np.concatenate([quat_multiply(q[: len(q) - 1 : 2], q[1::2]), last])
    return np.asarray(q[0] / np.linalg.norm(q[0]))


def _increments(method: Method, imu: ImuData) -> Increments:
    return strapdown.increments(strapdown.intervals(imu), method=method)


def _steps(method: Method, imu: ImuData) -> Steps:
    return steps_of(_increments(method, imu))


def _navigate(
    method: Method, imu: ImuData, start: Start, height: FloatArray, v_down: FloatArray, every: int
) -> Trajectory:
    inc = _increments(method, imu)
    return strapdown.navigate(inc.rows(slice(1, None)), *start, vertical=(height, v_down), every=every)
