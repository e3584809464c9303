"""One pass over the samples for what tells that nothing is the matter with them."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit


@njit(cache=True)
def glance(gyro, accel, scale, limit):  # type: ignore[no-untyped-def]
    """Largest value and change of each axis, (6,), whether two changes in a row exceed `limit`, any value comes thrice.

    `gyro`, `accel` (n, 3), divided by `scale` (n,) for values and changes, but not for what comes thrice.
    """
    largest, change = np.zeros(6), np.zeros(6)
    far, thrice = np.zeros(6, np.bool_), np.zeros(6, np.bool_)
    value, before, above, same = np.zeros(6), np.zeros(6), np.zeros(6, np.bool_), np.zeros(6, np.bool_)
    for k in range(gyro.shape[0]):
        inverse = 1.0 / scale[k]
        for axis in range(6):
            now = gyro[k, axis] if axis < 3 else accel[k, axis - 3]
            last, value[axis] = value[axis], now * inverse
            largest[axis] = max(largest[axis], abs(value[axis]))
            if k > 0:
                step = abs(value[axis] - last)
                change[axis] = max(change[axis], step)
                far[axis] |= above[axis] and step > limit[axis]
                thrice[axis] |= same[axis] and now == before[axis]
                above[axis], same[axis] = step > limit[axis], now == before[axis]
            before[axis] = now
    return largest, change, far, thrice
