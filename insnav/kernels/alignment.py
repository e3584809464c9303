"""Attitude history and integrated specific force from gyros alone, for alignment."""

from __future__ import annotations

import numpy as np
from numba import njit

from insnav.kernels.mechanization import quaternion_step


@njit(cache=True)
def gyro_history(q, w_ie_n, dt, dtheta, dvel, q_out, u_out):  # type: ignore[no-untyped-def]
    """Integrate the gyros from an attitude ``q_nb``, (4,), and the specific force along it.

    The axes n turn with the Earth, `w_ie_n` (3,) [rad/s], and do not move over it. Increments are of angle [rad] and
    velocity [m/s], bias taken off; row 0 of `q_out`, (n + 1, 4), and `u_out`, (n + 1, 3), the integral of ``C_nb f_b``
    [m/s], is the start.
    """
    # element by element: assigning slices takes seconds to compile
    x = np.zeros(10)
    for i in range(4):
        x[6 + i] = q[i]
        q_out[0, i] = q[i]
    u_out[0, 0] = u_out[0, 1] = u_out[0, 2] = 0.0
    for k in range(dt.shape[0]):
        h = dt[k]
        # specific force along the attitude half-way through the interval
        quaternion_step(
            x,
            0.5 * h * w_ie_n[0],
            0.5 * h * w_ie_n[1],
            0.5 * h * w_ie_n[2],
            0.5 * dtheta[k, 0],
            0.5 * dtheta[k, 1],
            0.5 * dtheta[k, 2],
        )
        a, b, c, d = x[6], x[7], x[8], x[9]
        fx, fy, fz = dvel[k, 0], dvel[k, 1], dvel[k, 2]
        tx, ty, tz = 2.0 * (c * fz - d * fy), 2.0 * (d * fx - b * fz), 2.0 * (b * fy - c * fx)
        u_out[k + 1, 0] = u_out[k, 0] + fx + a * tx + c * tz - d * ty
        u_out[k + 1, 1] = u_out[k, 1] + fy + a * ty + d * tx - b * tz
        u_out[k + 1, 2] = u_out[k, 2] + fz + a * tz + b * ty - c * tx
        quaternion_step(
            x,
            0.5 * h * w_ie_n[0],
            0.5 * h * w_ie_n[1],
            0.5 * h * w_ie_n[2],
            0.5 * dtheta[k, 0],
            0.5 * dtheta[k, 1],
            0.5 * dtheta[k, 2],
        )
        for i in range(4):
            q_out[k + 1, i] = x[6 + i]
