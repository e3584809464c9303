"""Integrators of this package and of python-ins with a common interface, and checks of their errors."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from insnav import strapdown
from insnav.attitude import quat_from_rotvec, quat_multiply
from insnav.exceptions import ConfigError
from insnav.strapdown import Method
from insnav.types import FloatArray, ImuData, Increments, Trajectory
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class Check:
    """Numerical property, measured against a closed form or a published value."""

    topic: str  # subject of the check, such as ``coning``
    case: str  # test case
    unit: str  # unit of `limit` and `values`
    limit: float  # largest error allowed
    # name and error of each integrator: first the default of navigation. The limit applies to the first `required`
    # integrators only.
    values: tuple[tuple[str, float], ...]
    required: int = 1  # number of integrators to which the limit applies

    @property
    def name(self) -> str:
        """Topic and case."""
        return f"{self.topic}: {self.case}"

    @property
    def error(self) -> float:
        """Largest error of the integrators to which the limit applies; NaN if one of these errors is NaN."""
        errors = [value for _, value in self.values[: self.required]]
        return math.nan if any(math.isnan(value) for value in errors) else max(errors)

    @property
    def passed(self) -> bool:
        """True if the error is within the limit, false for NaN."""
        return self.error <= self.limit


METHODS: tuple[Method, ...] = ("polynomial", "rk4", "rotvec", "euler")  # limits apply only to the first method


@dataclass(frozen=True, slots=True)
class Steps:
    """Result of an integrator for each sampling interval."""

    time: FloatArray  # (n,) end of each interval [s]
    dt: FloatArray  # (n,) length of each interval [s]
    rotation: FloatArray  # (n, 3) rotation vector of the body over each interval [rad]
    velocity: FloatArray  # (n, 3) integral of the specific force in the axes of the interval's start [m/s]


Start = tuple[FloatArray, FloatArray, FloatArray]  # start: position; velocity N, E, D; roll, pitch, heading


@dataclass(frozen=True, slots=True)
class Integrator:
    """Algorithm from samples to attitude and position."""

    name: str
    steps: Callable[[ImuData], Steps]  # increments of a record whose samples are increments
    # trajectory of a record, ``(imu, start, height, v_down, every)``. The start is at the end of the first sample,
    # since some algorithms need an earlier sample. Height [m] and down velocity [m/s] are constrained to these values
    # at the ends of the following intervals.
    navigate: Callable[[ImuData, Start, FloatArray, FloatArray, int], Trajectory]


def integrators() -> tuple[Integrator, ...]:
    """All strapdown integrators of this package; the first is the default one."""
    return tuple(_own(method) for method in METHODS)


def _own(method: Method) -> Integrator:
    def increments(imu: ImuData) -> Increments:
        return strapdown.increments(strapdown.intervals(imu), method=method)

    def navigate(imu: ImuData, start: Start, height: FloatArray, v_down: FloatArray, every: int) -> Trajectory:
        after = increments(imu).rows(slice(1, None))
        return strapdown.navigate(after, *start, vertical=(height, v_down), every=every)

    return Integrator(method, lambda imu: steps_of(increments(imu)), navigate)


def steps_of(inc: Increments) -> Steps:
    """Combine increments to rotation and velocity, as defined in `insnav.types.Increments`."""
    angle = np.linalg.norm(inc.dtheta, axis=1, keepdims=True)
    # (1 - cos a) / a^2 and (a - sin a) / a^3 without dividing by zero
    first = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    second = (1 - np.sinc(angle / np.pi)) / np.maximum(angle, 1e-4) ** 2
    cross = np.cross(inc.dtheta, inc.dvel)
    velocity = inc.dvel + first * cross + second * np.cross(inc.dtheta, cross) + inc.sculling
    return Steps(inc.time, inc.dt, inc.dtheta + inc.coning, velocity)


def attitude_after(rotation: FloatArray) -> FloatArray:
    """Compute the quaternion after successive rotation vectors ``(n, 3)`` [rad], by pairs: rounding grows as log n."""
    q = quat_from_rotvec(rotation)
    while len(q) > 1:
        unpaired = q[len(q) - len(q) % 2 :]
        q = np.concatenate([quat_multiply(q[: len(q) - 1 : 2], q[1::2]), unpaired])
    return np.asarray(q[0] / np.linalg.norm(q[0]))


def pyins() -> Integrator:
    """Build the integrator of python-ins: its increments use the previous ones; its mechanization is local-level.

    Its normal gravity has no north component, which causes errors of metres after an hour at a height of 500 m.
    Raises: ConfigError: python-ins is not installed.
    """
    if find_spec("pyins") is None:
        raise ConfigError("verify.no_pyins", where="--peer")
    return Integrator("pyins", _pyins_steps, _pyins_navigate)


def _pyins_increments(imu: ImuData) -> Any:
    """Return the increments of python-ins, one per sample except the first, which is only the previous sample."""
    import pandas as pd

    pyins_strapdown, util = import_module("pyins.strapdown"), import_module("pyins.util")
    samples = pd.DataFrame(
        np.hstack([imu.gyro, imu.accel]), index=pd.Index(imu.time), columns=util.GYRO_COLS + util.ACCEL_COLS
    )
    return pyins_strapdown.compute_increments_from_imu(samples, "increment")


def _pyins_steps(imu: ImuData) -> Steps:
    table = _pyins_increments(imu).to_numpy()
    return Steps(imu.time[1:], table[:, 0], table[:, 1:4], table[:, 4:7])


def _pyins_navigate(imu: ImuData, start: Start, height: FloatArray, v_down: FloatArray, every: int) -> Trajectory:
    """Navigate by python-ins at constant height, then replace height and down velocity by the given ones."""
    import pandas as pd

    theirs, util = import_module("pyins.strapdown"), import_module("pyins.util")
    lla, v_n, rph = start
    first = np.concatenate([lla[:2] / DEG, lla[2:], v_n, rph / DEG])
    pva = pd.Series(first, index=util.TRAJECTORY_COLS, name=imu.time[0])
    with warnings.catch_warnings(), np.errstate(all="ignore"):  # python-ins divides by zero at a pole
        warnings.simplefilter("ignore")
        try:
            table = theirs.Integrator(pva, with_altitude=False).integrate(_pyins_increments(imu)).to_numpy()
        except ZeroDivisionError:
            table = np.full((imu.time.size, 9), np.nan)
    rows = table[every::every]
    chosen = slice(every - 1, None, every)
    lla = np.column_stack([rows[:, :2] * DEG, height[chosen]])
    v_n = np.column_stack([rows[:, 3:5], v_down[chosen]])
    return Trajectory(imu.time[1:][chosen], lla, v_n, rows[:, 6:9] * DEG)
