"""Aiding measurements: vehicle velocity (NHC, odometer), zero velocity and heading, with innovation statistics."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.earth import OMEGA
from insnav.kernels.gps_measurement import crossed, inverse
from insnav.kernels.mechanization import rotation


@njit(cache=True)
def vehicle_velocity(x, rate, to_vehicle, lever, speed, z, h):  # type: ignore[no-untyped-def]
    """Compute a point's velocity in vehicle axes minus its measurement.

    `x`: state. `rate`: body rate [rad/s]. `to_vehicle`: rotation from IMU to vehicle axes. `lever`: point relative to
    the IMU, body axes [m]. `speed`: measured forward speed [m/s]. The first three of ``z`` are predicted minus
    measured: forward, right (zero), down (zero) [m/s]. The first three rows of ``h`` are their derivatives by the
    state.

    ``z = C_vb (C_bn v + w x lever)``; with ``C_hat = (I - [phi x]) C`` the derivative by velocity is ``C_vb C_bn``, by
    attitude ``-C_vb C_bn [v x]``, by gyro bias ``C_vb [lever x]``.
    """
    c, seen = np.zeros((3, 3)), np.zeros((3, 3))
    rotation(x, c.reshape(9))
    h[:3] = 0.0
    crossed(to_vehicle, lever, 0, 9, h)
    for i in range(3):
        z[i] = 0.0
        for j in range(3):
            for k in range(3):
                seen[i, j] += to_vehicle[i, k] * c[j, k]
            h[i, 3 + j] = seen[i, j]
            z[i] += seen[i, j] * x[3 + j] - h[i, 9 + j] * rate[j]
    crossed(seen, -x[3:6], 0, 6, h)
    z[0] -= speed


@njit(cache=True)
def zero_velocity(x, bias, rate, z, h):  # type: ignore[no-untyped-def]
    """Compute velocity N, E, D [m/s] and gyro rate against the Earth [rad/s], both zero for a stationary vehicle.

    `bias` is the estimated gyro bias, `rate` the mean gyro output including the bias [rad/s]. ``z``, (6,), is predicted
    minus measured. ``h``, (6, n), is its derivative by the error states.
    """
    c = np.zeros((3, 3))
    rotation(x, c.reshape(9))
    earth = OMEGA * np.array([np.cos(x[0]), 0.0, -np.sin(x[0])])
    h[:] = 0.0
    crossed(c.T.copy(), -earth, 3, 6, h)  # -C_bn [w_ie x]
    for i in range(3):
        z[i] = x[3 + i]
        h[i, 3 + i] = 1.0
        z[3 + i] = bias[i] + c[0, i] * earth[0] + c[2, i] * earth[2] - rate[i]
        h[3 + i, 9 + i] = 1.0


@njit(cache=True)
def body_heading(x, heading, z, h):  # type: ignore[no-untyped-def]
    """Compute heading of the body minus a measured heading [rad], within +-pi, in ``z[0]``; its derivative in ``h[0]``.

    ``C_hat = (I - [phi x]) C`` turns the body by ``-phi``; the derivative of ``atan2(C_hat_10, C_hat_00)`` follows.
    """
    c = np.zeros((3, 3))
    rotation(x, c.reshape(9))
    for j in range(h.shape[1]):
        h[0, j] = 0.0
    level2 = c[0, 0] * c[0, 0] + c[1, 0] * c[1, 0]  # squared cosine of the pitch
    difference = np.arctan2(c[1, 0], c[0, 0]) - heading
    z[0] = difference - 2.0 * np.pi * np.floor(difference / (2.0 * np.pi) + 0.5)
    # d atan2(c10, c00) with dc = -[phi x] c
    h[0, 6] = c[2, 0] * c[0, 0] / level2
    h[0, 7] = c[2, 0] * c[1, 0] / level2
    h[0, 8] = -1.0


@njit(cache=True)
def innovation(p, z, h, r, first, last, s):  # type: ignore[no-untyped-def]
    """Compute covariance and NIS of an innovation: rows `first` to `last` - 1, white noise of variances `r`."""
    n = p.shape[0]
    m = last - first
    for i in range(m):
        for j in range(m):
            total = r[first + i] if i == j else 0.0
            for k in range(n):
                share = h[first + i, k]
                if share != 0.0:
                    for a in range(n):
                        total += share * p[k, a] * h[first + j, a]
            s[i, j] = total
    inv, nis = inverse(s), 0.0
    for i in range(m):
        for j in range(m):
            nis += z[first + i] * inv[i, j] * z[first + j]
    return nis
