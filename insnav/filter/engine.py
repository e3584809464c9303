"""filterpy's Kalman filter behind guards.

filterpy checks nothing: one NaN, one wrong shape or one negative variance silently corrupts all later results. All
input and output is checked here.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from insnav.deferred import deferred
from insnav.exceptions import DivergenceError
from insnav.kernels.measurements import NOT_FINITE, fault_of, inverse, measurement_fault
from insnav.types import FloatArray

MAX_REPAIRS = 10  # rounding causes one or two in hours; more indicate a defect of model or data
# filterpy imports all its parts, and for them scipy.stats and scipy.linalg, in half a second; no run needs these
with deferred("filterpy.discrete_bayes", "filterpy.stats", "scipy.linalg"):
    KalmanFilter: Any = import_module("filterpy.kalman").KalmanFilter


class Engine:
    """Closed-loop error-state filter: the state is zero before every update; starts from a covariance, (n, n)."""

    def __init__(self, covariance: FloatArray) -> None:
        n = covariance.shape[0]
        self._filter = KalmanFilter(dim_x=n, dim_z=6)
        self._filter.P = covariance.copy()
        # numpy's inverse takes longer than the rest of an update with three numbers
        self._filter.inv = inverse
        self._zero = np.zeros((n, 1))
        self.repairs = 0

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the error state, (n, n); do not change it."""
        p: FloatArray = self._filter.P
        return p

    def predict(self, transition: FloatArray, noise: FloatArray, time: float) -> bool:
        """Propagate the covariance to `time` [s] by transition and noise, (n, n) each, accumulated since the last call.

        Returns whether a negative variance was repaired.

        Raises: DivergenceError: a number that is not finite, or too many repairs.
        """
        self._filter.predict(F=transition, Q=noise)
        return self._check(time, self._zero[:, 0])

    def update(self, z: FloatArray, h: FloatArray, r: FloatArray, time: float) -> tuple[FloatArray, bool]:
        """Apply a measurement: predicted minus measured, (m,), its derivative, (m, n), and its covariance.

        Returns: `error` (n,): estimated error, to subtract from the state.
        Raises: DivergenceError: as in `predict`; also if the measurement is not finite or its covariance not positive.
        """
        r = np.ascontiguousarray(r)  # one memory layout, one compiled kernel
        if measurement_fault(z, h, r):
            raise DivergenceError(
                "filter.bad_measurement", where=f"t = {time:.3f} s", innovation=str(z), variance=str(np.diagonal(r))
            )
        self._filter.update(z.reshape(-1, 1), R=r, H=h)
        error: FloatArray = self._filter.x[:, 0]
        self._filter.x = self._zero
        return error, self._check(time, error)

    def replace_covariance(self, covariance: FloatArray) -> None:
        """Set the covariance, at an explicit reset."""
        self._filter.P = covariance.copy()

    def _check(self, time: float, error: FloatArray) -> bool:
        fault = fault_of(self._filter.P, error)
        if fault == 0:
            return False
        if fault == NOT_FINITE:
            raise DivergenceError("filter.not_finite", where=f"t = {time:.3f} s")
        self.repairs += 1
        if self.repairs > MAX_REPAIRS:
            raise DivergenceError("filter.no_variance", where=f"t = {time:.3f} s", count=self.repairs)
        # relative to each state's own standard deviation: a common floor would follow the largest
        scale = np.sqrt(np.abs(np.diagonal(self._filter.P)))
        live = scale > 0.0
        unit = np.where(live, scale, 1.0)
        values, vectors = np.linalg.eigh(self._filter.P / np.outer(unit, unit))
        repaired = (vectors * np.maximum(values, 1e-12 * values[-1])) @ vectors.T * np.outer(unit, unit)
        repaired[~live, :] = repaired[:, ~live] = 0.0
        self._filter.P = repaired
        return True
