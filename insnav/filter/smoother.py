"""History of the filter's epochs, and the smoother's backward pass over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav import spill
from insnav.attitude import dcm_from_quat, skew
from insnav.kernels import smoother as kernel
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES
from insnav.types import BoolArray, FloatArray

ROWS = 2048  # epochs in a block of the history


@dataclass(frozen=True, slots=True)
class SmoothedErrors:
    """Smoothed errors of the filter at its epochs."""

    time: FloatArray  # (m,) [s]
    state: FloatArray  # (m, 10) filter's state after the measurement; see `insnav.kernels.mechanization`
    correction: FloatArray  # (m, 12) its sensor errors
    used: BoolArray  # (m,) whether a fix was accepted at the epoch
    after: FloatArray  # (m, 21) error of the state after and before the measurement, estimate minus smoothed
    before: FloatArray
    covariance: FloatArray  # (m, 9, 9) of smoothed position, velocity and attitude
    variance: FloatArray  # (m, 12) variances of the smoothed sensor errors
    # (m, 25) innovations and smoothed residuals of all fixes, with variances; see `insnav.kernels.smoother.backward`
    innovations: FloatArray


class History:
    """History of all filter epochs, in blocks."""

    def __init__(self, states: int) -> None:
        self._states = states
        self._width = kernel.width(states)
        self._blocks: list[FloatArray] = []
        self._used = ROWS

    def new_row(self) -> FloatArray:
        """Return the row of a new epoch, for `insnav.kernels.smoother.keep`."""
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
        """Store state and covariance before a measurement, and the transition up to it."""
        kernel.keep(self.new_row(), time, x, correction, arm, phi, p)

    def measurement(self, position: bool, velocity: bool, z: FloatArray, h: FloatArray, r: FloatArray) -> None:
        """Store the accepted part of a fix at the last epoch: predicted minus measured, derivative and covariance."""
        kind = (kernel.POSITION if position else 0) + (kernel.VELOCITY if velocity else 0)
        kernel.keep_measurement(self.last, kind, kernel.FIX, z, h, r)

    def aiding(self, part: slice, z: FloatArray, h: FloatArray, r: FloatArray) -> None:
        """Store the accepted rows of an aiding measurement at the last epoch."""
        used_rows = (1 << part.stop) - (1 << part.start)  # one bit each
        kernel.keep_measurement(self.last, used_rows, kernel.AIDING, z, h, r)

    def restart(self, time: float, x: FloatArray, correction: FloatArray, arm: FloatArray, p: FloatArray) -> None:
        """Store a reset: later data carry no information on earlier states."""
        self.epoch(time, x, correction, arm, np.eye(self._states), p)
        self.last[kernel.KIND] = kernel.RESTART

    def blocks(self) -> list[FloatArray]:
        """Return all epochs, in arrays of up to `ROWS`."""
        return [*self._blocks[:-1], self._blocks[-1][: self._used]]

    def rows(self) -> FloatArray:
        """Return all epochs in one array."""
        return np.concatenate(self.blocks())

    def smooth(self, least_delay_sd: float = 0.0) -> SmoothedErrors:
        """Run the backward pass, which consumes the history. `least_delay_sd`: lower limit of the delay sd [s]."""
        count = (len(self._blocks) - 1) * ROWS + self._used
        n, m = self._states, STATES
        adjoint, information = np.zeros(n), np.zeros((n, n))
        head = spill.empty((count, kernel.RESIDUAL))
        after, before, variance = spill.empty((count, m)), spill.empty((count, m)), np.empty((count, SENSOR))
        covariance, innovations = spill.empty((count, NAV, NAV)), spill.empty((count, 25))
        found = after, before, covariance, variance, innovations
        arm = self.last[kernel.ARM : kernel.ARM + 3].copy()
        for number in range(len(self._blocks) - 1, -1, -1):
            last = min(count, (number + 1) * ROWS)
            part = slice(number * ROWS, last)
            block = self._blocks[number][: last - number * ROWS]
            earlier, arm_of = self._blocks[number - 1][-1] if number else block[0], slice(kernel.ARM, kernel.RESIDUAL)
            kernel.backward(block, n, least_delay_sd, adjoint, information, *(each[part] for each in found))
            head[part] = block[:, : kernel.RESIDUAL]
            arms = np.vstack([earlier[arm_of], block[:, arm_of]])  # a whole row has a thousand numbers
            _place(head[part], arms, arm, after[part], before[part], covariance[part])
            self._blocks.pop()
            spill.release()
        kind = head[:, kernel.KIND]
        return SmoothedErrors(
            head[:, kernel.TIME].copy(),
            head[:, kernel.STATE : kernel.CORRECTION].copy(),
            head[:, kernel.CORRECTION : kernel.ARM].copy(),
            (kind > kernel.COAST) & (head[:, kernel.SOURCE] == kernel.FIX),
            *found,
        )


def _place(
    head: FloatArray, arms: FloatArray, arm: FloatArray, after: FloatArray, before: FloatArray, covariance: FloatArray
) -> None:
    """Place the smoothed position at the smoothed antenna minus the smoothed lever arm in smoothed attitude.

    The product of lever-arm and attitude errors is centimetres, far above the uncertainty of the antenna.

    `head` (m, RESIDUAL): of the epochs. `arms` (m + 1, 12): before and after them, see
    `insnav.kernels.measurements.correct_with_arm`. `arm` (3,): smoothed [m]. The others change, see
    `SmoothedErrors`.
    """
    off, turned = arms[:, :3] - arm, arms[:, 3:].reshape(-1, 3, 3)
    if not off.any():
        return
    c = dcm_from_quat(head[:, kernel.STATE + 6 : kernel.CORRECTION])
    wrong = np.einsum("kij,kj->ki", c, off[:-1])
    for error, each in ((before, slice(0, -1)), (after, slice(1, None))):
        error[:, :3] += np.cross(wrong, error[:, 6:9]) - np.einsum("kij,kj->ki", turned[each], off[each])
    by = np.tile(np.eye(NAV), (len(wrong), 1, 1))
    by[:, :3, 6:] = skew(wrong)
    covariance[:] = by @ covariance @ np.swapaxes(by, 1, 2)
