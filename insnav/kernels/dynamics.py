"""Linear error dynamics of position, velocity and attitude: the perturbed navigation equations."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.earth import OMEGA, A, gravity_down, radii

NAV = 9  # navigation errors: position N, E, D [m], velocity [m/s], attitude [rad]


@njit(cache=True)
def system_matrix(x, f_n, out):  # type: ignore[no-untyped-def]
    """Compute the continuous-time system matrix ``F`` of the errors of position, velocity and attitude.

    `x` (10,): navigation state; see `insnav.kernels.mechanization`. `f_n` (3,): specific force in n [m/s^2]. `out` (9,
    9): filled with ``F``.

    Notes
    -----
    Perturbation of the equations in `insnav.kernels.mechanization.step`; compare Groves (2013), section 14.2.4, who
    keeps position errors in radians. Position errors here are ``(R_M + h) dL``, ``(R_N + h) cos L dlon`` and ``-dh``.
    The velocity rows neglect the change of the radii with latitude, 0.7 % of terms of 1e-9.
    """
    sin_lat, cos_lat = np.sin(x[0]), np.cos(x[0])
    tan_lat = sin_lat / cos_lat
    h, vn, ve, vd = x[2], x[3], x[4], x[5]
    rm, rn = radii(sin_lat)
    rm, rn = rm + h, rn + h
    wie_n, wie_d = OMEGA * cos_lat, -OMEGA * sin_lat
    wen_n, wen_e, wen_d = ve / rn, -vn / rm, -ve * tan_lat / rn
    for i in range(NAV):
        for j in range(NAV):
            out[i, j] = 0.0
    out[0, 0], out[0, 2], out[0, 3] = -vd / rm, vn / rm, 1.0
    out[1, 0], out[1, 1], out[1, 2], out[1, 4] = ve * tan_lat / rn, -vd / rn - vn * tan_lat / rn, ve / rn, 1.0
    out[2, 5] = 1.0
    # derivatives of the Earth rate and the transport rate by position N, D [1/(m s)]
    ie_n, ie_d = wie_d / rm, -wie_n / rm  # d w_ie / d position N
    en_d0 = -ve / (cos_lat * cos_lat * rn * rm)
    en_n2, en_e2, en_d2 = ve / (rn * rn), -vn / (rm * rm), -ve * tan_lat / (rn * rn)
    # velocity: f x phi - (2 w_ie + w_en) x dv + v x (2 dw_ie + dw_en) + dg
    kn, ke, kd = 2.0 * wie_n + wen_n, wen_e, 2.0 * wie_d + wen_d
    out[3, 4], out[3, 5], out[4, 3], out[4, 5], out[5, 3], out[5, 4] = kd, -ke, -kd, kn, ke, -kn
    dn, dd = 2.0 * ie_n, 2.0 * ie_d + en_d0
    out[3, 0], out[4, 0], out[5, 0] = ve * dd, vd * dn - vn * dd, -ve * dn
    out[3, 2], out[4, 2], out[5, 2] = ve * en_d2 - vd * en_e2, vd * en_n2 - vn * en_d2, vn * en_e2 - ve * en_n2
    # velocity again: derivatives of the transport rate by velocity
    out[3, 3] += vd / rm
    out[3, 4] -= ve * tan_lat / rn
    out[4, 4] += vd / rn + vn * tan_lat / rn
    out[5, 3] -= vn / rm
    out[5, 4] -= ve / rn
    out[5, 2] += 2.0 * gravity_down(sin_lat, h) / A
    out[3, 7], out[3, 8] = -f_n[2], f_n[1]
    out[4, 6], out[4, 8] = f_n[2], -f_n[0]
    out[5, 6], out[5, 7] = -f_n[1], f_n[0]
    # attitude: -w_in x phi + dw_ie + dw_en
    wn, we, wd = wie_n + wen_n, wen_e, wie_d + wen_d
    out[6, 7], out[6, 8], out[7, 6], out[7, 8], out[8, 6], out[8, 7] = wd, -we, -wd, wn, we, -wn
    out[6, 0], out[8, 0] = ie_n, ie_d + en_d0
    out[6, 2], out[7, 2], out[8, 2] = en_n2, en_e2, en_d2
    out[6, 4], out[7, 3], out[8, 4] = 1.0 / rn, -1.0 / rm, -tan_lat / rn


@njit(cache=True)
def second_order(f, dt, a):  # type: ignore[no-untyped-def]
    """Compute ``a = F dt + (F dt)^2 / 2``: the transition over a step of `dt` [s] minus the identity, (9, 9).

    All products go row by row: the innermost loop follows the memory, and most of F is zero.
    """
    for i in range(NAV):
        for j in range(NAV):
            a[i, j] = dt * f[i, j]
        for k in range(NAV):
            share = 0.5 * dt * dt * f[i, k]
            if share != 0.0:
                for j in range(NAV):
                    a[i, j] += share * f[k, j]
