"""A record with long gaps of the IMU, navigated in parts: attitude, position and velocity anew, sensor errors kept.

What the body did in the gap is not known; what its sensors are is, but for what fades in the gap. So in the gap the
transition of position, velocity and attitude is zero, their covariance that of a new alignment, and the smoother
carries what later parts say of the sensors back into earlier ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from insnav import spill
from insnav.filter.error_model import InitialState
from insnav.kernels.dynamics import NAV
from insnav.types import Alignment, FloatArray, ImuData

LONGEST_GAP = 3.0  # longest data gap that is bridged: the turn within a longer one is anybody's guess [s]
SHORTEST = 10.0  # shorter parts are not navigated: no alignment fits in [s]


@dataclass(frozen=True, slots=True)
class Part:
    """Where the filter goes on after a gap."""

    after: float  # time of the last sample before the gap [s]
    alignment: Alignment
    initial: InitialState


@dataclass(frozen=True, slots=True)
class Across:
    """How a new alignment depends on the errors of the sensors."""

    slope: FloatArray  # (9, 12) of position, velocity, attitude error by sensor error
    own: FloatArray  # (9, 9) covariance that has other causes

    @classmethod
    def of(cls, initial: InitialState) -> Across:
        """From the covariance of an initial state, in which the sensor errors are uncorrelated with each other."""
        p = initial.covariance
        variance = np.diag(p)[NAV:]
        slope = np.where(variance > 0.0, p[:NAV, NAV:] / np.where(variance > 0.0, variance, 1.0), 0.0)
        return cls(slope, p[:NAV, :NAV] - (slope * variance) @ slope.T)


def spans(imu: ImuData) -> list[slice]:
    """Rows between long gaps."""
    edges = [0, *(np.flatnonzero(spill.steps(imu.time) > LONGEST_GAP) + 1).tolist(), imu.time.shape[0]]
    return [slice(first, last) for first, last in pairwise(edges)]
