"""Another package in the shape of the own integrators, to stand beside them in the certificate."""

from __future__ import annotations

import warnings
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from insnav.certificate.integrators import Integrator, Start, Steps
from insnav.exceptions import ConfigError
from insnav.types import FloatArray, ImuData, Trajectory
from insnav.units import DEG


def pyins() -> Integrator:
    """Strapdown integrator of python-ins: increments with the term of the previous one, local-level mechanization.

    Its normal gravity has no north component, which alone is metres after an hour at a height of 500 m. Without
    python-ins a `ConfigError` names the option.
    """
    if find_spec("pyins") is None:
        raise ConfigError(
            "python-ins is not installed",
            where="--peer",
            why="no package of the name pyins was found",
            fix="pip install python-ins, or leave --peer out",
        )
    return Integrator("pyins", _steps, _navigate)


def _increments(imu: ImuData) -> Any:
    """Its table of increments: one for every sample but the first, which it only looks back at."""
    import pandas as pd

    strapdown, util = import_module("pyins.strapdown"), import_module("pyins.util")
    samples = pd.DataFrame(
        np.hstack([imu.gyro, imu.accel]), index=pd.Index(imu.time), columns=util.GYRO_COLS + util.ACCEL_COLS
    )
    return strapdown.compute_increments_from_imu(samples, "increment")


def _steps(imu: ImuData) -> Steps:
    table = _increments(imu).to_numpy()
    return Steps(imu.time[1:], table[:, 0], table[:, 1:4], table[:, 4:7])


def _navigate(imu: ImuData, start: Start, height: FloatArray, v_down: FloatArray, every: int) -> Trajectory:
    """Navigate with its height held to the first, and tell that given: only what is horizontal is its own."""
    import pandas as pd

    strapdown, util = import_module("pyins.strapdown"), import_module("pyins.util")
    lla, v_n, rph = start
    first = np.concatenate([lla[:2] / DEG, lla[2:], v_n, rph / DEG])
    pva = pd.Series(first, index=util.TRAJECTORY_COLS, name=imu.time[0])
    with warnings.catch_warnings(), np.errstate(all="ignore"):  # it divides by zero at a pole, and uses pandas of old
        warnings.simplefilter("ignore")
        try:
            table = strapdown.Integrator(pva, with_altitude=False).integrate(_increments(imu)).to_numpy()
        except ZeroDivisionError:
            table = np.full((imu.time.size, 9), np.nan)
    found = table[every::every]
    chosen = slice(every - 1, None, every)
    return Trajectory(
        imu.time[1:][chosen],
        np.column_stack([found[:, :2] * DEG, height[chosen]]),
        np.column_stack([found[:, 3:5], v_down[chosen]]),
        found[:, 6:9] * DEG,
    )
