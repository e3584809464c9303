"""One pass over the samples that finds out whether all of them are plausible."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit


@njit(cache=True)
def glance(gyro, accel, scale, limit):  # type: ignore[no-untyped-def]
    """Return largest value and change of each axis, (6,); whether two changes in a row exceed `limit` or values repeat.

    `gyro`, `accel` (n, 3) are divided by `scale` (n,) for values and changes. Repeat: the same raw value three times.
    """
    largest, change, value, step = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    before, older, odd = np.zeros(6), np.zeros(6), False
    for k in range(gyro.shape[0]):
        inverse = 1.0 / scale[k]
        for axis in range(6):
            now = gyro[k, axis] if axis < 3 else accel[k, axis - 3]
            here, earlier = now * inverse, step[axis]
            largest[axis] = max(largest[axis], abs(here))
            if k > 0:
                step[axis] = abs(here - value[axis])
                change[axis] = max(change[axis], step[axis])
                odd |= earlier > limit[axis] < step[axis] or (k > 1 and before[axis] == now == older[axis])
            value[axis], older[axis], before[axis] = here, before[axis], now
    return largest, change, odd
