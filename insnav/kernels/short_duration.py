"""The short-duration form of the navigation equations: velocity without Earth rate and transport rate, by Euler."""

from __future__ import annotations

from numpy import cos, sin

from insnav.kernels import njit
from insnav.kernels.earth import OMEGA, gravity_down, gravity_north, radii
from insnav.kernels.increments import turned
from insnav.kernels.mechanization import quaternion_step, within_turn


@njit(cache=True)
def navigate(x, turning, dt, dtheta, dvel, coning, every, out):  # type: ignore[no-untyped-def]
    """Mechanize a record; store the state after each `every`-th interval in the rows of `out`.

    `x` (10,): state as in `insnav.kernels.mechanization`, changed in place. `turning`: the attitude follows the
    rotation of North, East, Down, as in the full form. `dt` (n,): intervals [s]. `dtheta`, `dvel`, `coning` (n, 3):
    measured angle [rad] and velocity [m/s] increments, and coning [rad]; the form neglects sculling. `every`:
    decimation. `out` (n // every, 10).
    """
    for k in range(dt.shape[0]):
        lat, lon, h, vn, ve, vd = x[0], x[1], x[2], x[3], x[4], x[5]
        t, s, c = dt[k], sin(lat), cos(lat)
        rm, rn = radii(s)
        fx, fy, fz = dvel[k, 0], dvel[k, 1], dvel[k, 2]
        un, ue, ud = turned(x[6], x[7], x[8], x[9], fx, fy, fz)
        x[0] = lat + t * vn / (rm + h)
        x[1] = within_turn(lon + t * ve / ((rn + h) * c))
        x[2] = h - t * vd
        x[3] = vn + fx + un + t * gravity_north(s, c, h)
        x[4] = ve + fy + ue
        x[5] = vd + fz + ud + t * gravity_down(s, h)
        zn, ze, zd = 0.0, 0.0, 0.0
        if turning:
            wn = ve / (rn + h)
            zn, ze, zd = (OMEGA * c + wn) * t, -vn / (rm + h) * t, -(OMEGA * s + wn * s / c) * t
        px, py, pz = dtheta[k, 0] + coning[k, 0], dtheta[k, 1] + coning[k, 1], dtheta[k, 2] + coning[k, 2]
        quaternion_step(x, zn, ze, zd, px, py, pz)
        if (k + 1) % every == 0:
            for i in range(10):
                out[(k + 1) // every - 1, i] = x[i]
