"""How far and how long a vehicle moved."""

from __future__ import annotations

import numpy as np

from insnav.errors.metrics import MOVING_M_S
from insnav.types import Trajectory


def distance_and_time(solution: Trajectory) -> tuple[float, float]:
    """Sum up the way and the time in motion; what noise makes of a vehicle at rest is not counted.

    Parameters
    ----------
    solution : Trajectory
        With velocity everywhere.

    Returns
    -------
    distance : float
        [m].
    moving : float
        Time faster than `MOVING_M_S` [s].
    """
    speed = np.linalg.norm(solution.v_n, axis=1)[1:]
    step = np.where(speed > MOVING_M_S, np.diff(solution.time), 0.0)
    return float(np.sum(speed * step)), float(np.sum(step))
