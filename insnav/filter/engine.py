"""Covariance of the filter behind guards: one NaN, or one negative variance, would spoil all that follows, silently."""

from __future__ import annotations

import numpy as np

from insnav.exceptions import DivergenceError
from insnav.kernels.gps_measurement import predict, update
from insnav.types import FloatArray

MAX_REPAIRS = 10  # rounding costs one or two in hours; more are a defect of model or data


class Engine:
    """Closed-loop error-state filter: the state is zero before every update; starts from a covariance, (n, n)."""

    def __init__(self, covariance: FloatArray) -> None:
        self.covariance = covariance.copy()  # of the error state, (n, n), changed in place; for others to read only
        self.repairs = 0

    def predict(self, transition: FloatArray, noise: FloatArray, time: float) -> bool:
        """Carry the covariance to `time` [s] by transition and noise, (n, n) each, accumulated since the last call.

        The transition is ``[[A, B], [0, diag(d)]]``, see `insnav.kernels.errorstate`.
        Returns whether a negative variance had to be repaired.

        Raises: DivergenceError: a number that is not finite, or too many repairs.
        """
        return self._checked(predict(self.covariance, transition, noise), time)

    def update(self, z: FloatArray, h: FloatArray, r: FloatArray, time: float) -> tuple[FloatArray, bool]:
        """Use a measurement: predicted minus measured, (m,), its derivative by the error state, (m, n), its covariance.

        Returns: `error` (n,): estimated error, for the caller to correct the state by.
        Raises: DivergenceError: as `predict`; also where the measurement is not finite or its covariance not positive.
        """
        error = np.empty(h.shape[1])
        fault = update(self.covariance, z, h, np.ascontiguousarray(r), error)  # one kind of array, one kernel
        if fault == 4:
            raise DivergenceError(
                "a measurement is not finite or has no positive variance",
                where=f"time {time:.3f} s",
                why=f"innovation {z}, variance {np.diagonal(r)}",
                fix="check the GPS file around this time",
            )
        if fault == 3:
            raise DivergenceError("the filter's state is not finite", where=f"time {time:.3f} s")
        return error, self._checked(fault, time)

    def replace_covariance(self, covariance: FloatArray) -> None:
        """Set the covariance, at an explicit reset."""
        self.covariance = covariance.copy()

    def _checked(self, fault: int, time: float) -> bool:
        if fault == 0:
            return False
        if fault == 1:
            raise DivergenceError("the filter's covariance is not finite", where=f"time {time:.3f} s")
        self.repairs += 1
        if self.repairs > MAX_REPAIRS:
            raise DivergenceError(
                "the filter's covariance keeps losing positive variances",
                where=f"time {time:.3f} s",
                why=f"{self.repairs} repairs",
                fix="check the standard deviations of the GPS file and the IMU error specification",
            )
        # in units of each state's own standard deviation, or the largest would set the floor for all
        scale = np.sqrt(np.abs(np.diagonal(self.covariance)))
        live = scale > 0.0
        unit = np.where(live, scale, 1.0)
        values, vectors = np.linalg.eigh(self.covariance / np.outer(unit, unit))
        repaired = (vectors * np.maximum(values, 1e-12 * values[-1])) @ vectors.T * np.outer(unit, unit)
        repaired[~live, :] = repaired[:, ~live] = 0.0
        self.covariance = repaired
        return True
