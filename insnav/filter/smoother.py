"""History of all filter epochs, and the backward pass of the smoother over this history."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_quat, skew
from insnav.kernels import smoother as kernel
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES
from insnav.types import BoolArray, FloatArray

ROWS = 2048  # number of epochs in a block of the history


@dataclass(frozen=True, slots=True)
class SmoothedErrors:
    """Errors of the filter at its epochs, as estimated by the smoother."""

    time: FloatArray  # (m,) times of the epochs [s]
    state: FloatArray  # (m, 10) filter's state after the measurement; see `insnav.kernels.mechanization`
    correction: FloatArray  # (m, 12) sensor errors estimated by the filter
    used: BoolArray  # (m,) true if a fix was accepted at the epoch
    after: FloatArray  # (m, 21) errors after, and before, the measurement: filtered minus smoothed state
    before: FloatArray
    covariance: FloatArray  # (m, 9, 9) covariance of smoothed position, velocity and attitude
    variance: FloatArray  # (m, 12) variances of the smoothed sensor errors
    # (m, 25) innovations and smoothed residuals of all fixes, with variances; see `insnav.kernels.smoother.backward`
    innovations: FloatArray


class History:
    """Growing history of all filter epochs, stored in blocks of `ROWS` epochs."""

    def __init__(self, states: int) -> None:
        self._states = states
        self._width = kernel.width(states)
        self._blocks: list[FloatArray] = []
        self._used = ROWS

    def new_row(self) -> FloatArray:
        """Add an epoch, and return its row for `insnav.kernels.smoother.keep` to fill."""
        if self._used == ROWS:
            self._blocks.append(spill.empty((ROWS, self._width)))
            self._used = 0
        self._used += 1
        return self.last

    @property
    def last(self) -> FloatArray:
        """Return the row of the last epoch."""
        row: FloatArray = self._blocks[-1][self._used - 1]
        return row

    def epoch(
        self, time: float, x: FloatArray, correction: FloatArray, arm: FloatArray, phi: FloatArray, p: FloatArray
    ) -> None:
        """Store state and covariance before a measurement, and the transition from the previous epoch."""
        kernel.keep(self.new_row(), time, x, correction, arm, phi, p)

    def measurement(self, position: bool, velocity: bool, z: FloatArray, h: FloatArray, r: FloatArray) -> None:
        """Store the accepted part of a fix at the last epoch: predicted minus measured, derivative and covariance."""
        kind = (kernel.POSITION if position else 0) + (kernel.VELOCITY if velocity else 0)
        kernel.keep_measurement(self.last, kind, kernel.FIX, z, h, r)

    def aiding(self, part: slice, z: FloatArray, h: FloatArray, r: FloatArray) -> None:
        """Store the accepted rows of an aiding measurement at the last epoch."""
        used_rows = (1 << part.stop) - (1 << part.start)  # bit mask: one bit per filled row
        kernel.keep_measurement(self.last, used_rows, kernel.AIDING, z, h, r)

    def restart(self, time: float, x: FloatArray, correction: FloatArray, arm: FloatArray, p: FloatArray) -> None:
        """Store a reset at `time` [s]. Later data carry no information on earlier states."""
        self.epoch(time, x, correction, arm, np.eye(self._states), p)
        self.last[kernel.KIND] = kernel.RESTART

    def blocks(self) -> list[FloatArray]:
        """Return all epochs, in arrays of up to `ROWS`."""
        return [*self._blocks[:-1], self._blocks[-1][: self._used]]

    def rows(self) -> FloatArray:
        """Return all epochs in one array."""
        return np.concatenate(self.blocks())

    def smooth(self, least_delay_sd: float = 0.0) -> SmoothedErrors:
        """Run the smoother, which deletes the history on the way. `least_delay_sd`: lower limit of the delay sd [s]."""
        count = (len(self._blocks) - 1) * ROWS + self._used
        n, m = self._states, STATES
        adjoint, information = np.zeros(n), np.zeros((n, n))
        head = spill.empty((count, kernel.RESIDUAL))
        after, before, variance = spill.empty((count, m)), spill.empty((count, m)), np.empty((count, SENSOR))
        covariance, innovations = spill.empty((count, NAV, NAV)), spill.empty((count, 25))
        results = after, before, covariance, variance, innovations
        arm = self.last[kernel.ARM : kernel.ARM + 3].copy()
        for k in range(len(self._blocks) - 1, -1, -1):
            last = min(count, (k + 1) * ROWS)
            part = slice(k * ROWS, last)
            block = self._blocks[k][: last - k * ROWS]
            earlier, arm_of = self._blocks[k - 1][-1] if k else block[0], slice(kernel.ARM, kernel.RESIDUAL)
            kernel.backward(block, n, least_delay_sd, adjoint, information, *(each[part] for each in results))
            head[part] = block[:, : kernel.RESIDUAL]
            arms = np.vstack([earlier[arm_of], block[:, arm_of]])  # copy only the arms: a row has a thousand numbers
            _place(head[part], arms, arm, after[part], before[part], covariance[part])
            self._blocks.pop()
            spill.release()
        kind = head[:, kernel.KIND]
        return SmoothedErrors(
            head[:, kernel.TIME].copy(),
            head[:, kernel.STATE : kernel.CORRECTION].copy(),
            head[:, kernel.CORRECTION : kernel.ARM].copy(),
            (kind > kernel.COAST) & (head[:, kernel.SOURCE] == kernel.FIX),
            *results,
        )


def _place(
    head: FloatArray, arms: FloatArray, arm: FloatArray, after: FloatArray, before: FloatArray, covariance: FloatArray
) -> None:
    """Set the smoothed position to the smoothed antenna position minus the smoothed lever arm in smoothed attitude.

    Otherwise the product of lever-arm and attitude errors remains: centimetres, far above the antenna's uncertainty.

    `head` (m, RESIDUAL): rows of the epochs. `arms` (m + 1, 12): lever arms before and after them, see
    `insnav.kernels.measurements.correct_with_arm`. `arm` (3,): smoothed lever arm [m]. `after`, `before` and
    `covariance` are corrected in place, see `SmoothedErrors`.
    """
    arm_errors, turned = arms[:, :3] - arm, arms[:, 3:].reshape(-1, 3, 3)
    if not arm_errors.any():
        return
    c = dcm_from_quat(head[:, kernel.STATE + 6 : kernel.CORRECTION])
    arm_error = np.einsum("kij,kj->ki", c, arm_errors[:-1])
    for error, part in ((before, slice(0, -1)), (after, slice(1, None))):
        error[:, :3] += np.cross(arm_error, error[:, 6:9]) - np.einsum("kij,kj->ki", turned[part], arm_errors[part])
    mapping = np.tile(np.eye(NAV), (len(arm_error), 1, 1))
    mapping[:, :3, 6:] = skew(arm_error)
    covariance[:] = mapping @ covariance @ np.swapaxes(mapping, 1, 2)
