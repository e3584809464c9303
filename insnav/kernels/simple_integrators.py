"""Attitude and velocity integrators for study: plain algorithms on the same samples, and the short-duration form.

The former join neighbouring samples by straight lines. To navigate, use `insnav.kernels.increments`.
"""

from __future__ import annotations

import numpy as np
from numpy import cos, sin

from insnav.kernels import inner, njit
from insnav.kernels.earth import OMEGA, gravity_down, gravity_north, radii
from insnav.kernels.increments import quaternion_rate, turn_factors, turned
from insnav.kernels.mechanization import quaternion_step, within_turn

EULER, ROTVEC, RK4 = 0, 1, 2


@inner()
def _line(instant, k, dt, values, channel):  # type: ignore[no-untyped-def]
    """Compute integrand times interval at the start, middle and end of interval k, samples joined by straight lines.

    An instantaneous sample is the value at the end of its interval. A mean or an increment is the value at the middle.
    """
    h, here = dt[k], values[k, channel]
    if instant:
        before = values[k - 1, channel]
        return h * before, 0.5 * h * (before + here), h * here
    start = end = here
    if k > 0:
        start = (values[k - 1, channel] * h * h / dt[k - 1] + here * dt[k - 1]) / (dt[k - 1] + h)
    if k + 1 < dt.shape[0]:
        end = (values[k + 1, channel] * h * h / dt[k + 1] + here * dt[k + 1]) / (dt[k + 1] + h)
    return start, here, end


@inner()
def _forward(q0, q1, q2, q3, x, y, z):  # type: ignore[no-untyped-def]
    """Rotate a vector by a quaternion of any length except zero."""
    scale = 1.0 / np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    tx, ty, tz = turned(scale * q0, scale * q1, scale * q2, scale * q3, x, y, z)
    return x + tx, y + ty, z + tz


@inner()
def _runge_kutta(xb, yb, zb, xm, ym, zm, xe, ye, ze, fb, gb, hb, fm, gm, hm, fe, ge, he):  # type: ignore[no-untyped-def]
    """Classical fourth-order step of quaternion and velocity together (Hairer, Norsett, Wanner 1993, section II.1)."""
    a0, a1, a2, a3 = quaternion_rate(1.0, 0.0, 0.0, 0.0, xb, yb, zb)
    p0, p1, p2, p3 = 1.0 + 0.5 * a0, 0.5 * a1, 0.5 * a2, 0.5 * a3
    b0, b1, b2, b3 = quaternion_rate(p0, p1, p2, p3, xm, ym, zm)
    r0, r1, r2, r3 = 1.0 + 0.5 * b0, 0.5 * b1, 0.5 * b2, 0.5 * b3
    c0, c1, c2, c3 = quaternion_rate(r0, r1, r2, r3, xm, ym, zm)
    s0 = 1.0 + c0
    d0, d1, d2, d3 = quaternion_rate(s0, c1, c2, c3, xe, ye, ze)
    ux, uy, uz = _forward(p0, p1, p2, p3, fm, gm, hm)
    vx, vy, vz = _forward(r0, r1, r2, r3, fm, gm, hm)
    wx, wy, wz = _forward(s0, c1, c2, c3, fe, ge, he)
    return (
        1.0 + (a0 + 2.0 * b0 + 2.0 * c0 + d0) / 6.0,
        (a1 + 2.0 * b1 + 2.0 * c1 + d1) / 6.0,
        (a2 + 2.0 * b2 + 2.0 * c2 + d2) / 6.0,
        (a3 + 2.0 * b3 + 2.0 * c3 + d3) / 6.0,
        (fb + 2.0 * ux + 2.0 * vx + wx) / 6.0,
        (gb + 2.0 * uy + 2.0 * vy + wy) / 6.0,
        (hb + 2.0 * uz + 2.0 * vz + wz) / 6.0,
    )


@njit(cache=True)
def increments(method, instant, dt, gyro, accel, dtheta, dvel, coning, sculling):  # type: ignore[no-untyped-def]
    """Compute increments of whole intervals by a plain method; form of `insnav.kernels.increments.increments`.

    `method`: `EULER`: constant rate, from the start of the interval or its mean; attitude and specific force are not
    rotated within it. `ROTVEC`: the mean rate is the rotation vector. `RK4`: Runge-Kutta on straight lines between
    samples. Other arguments: see there.
    """
    for k in range(dt.shape[0]):
        if dt[k] == 0.0:  # the first instantaneous value ends no interval
            for i in range(3):
                dtheta[k, i] = dvel[k, i] = coning[k, i] = sculling[k, i] = 0.0
            continue
        xb, xm, xe = _line(instant, k, dt, gyro, 0)
        yb, ym, ye = _line(instant, k, dt, gyro, 1)
        zb, zm, ze = _line(instant, k, dt, gyro, 2)
        fb, fm, fe = _line(instant, k, dt, accel, 0)
        gb, gm, ge = _line(instant, k, dt, accel, 1)
        hb, hm, he = _line(instant, k, dt, accel, 2)
        tx, ty, tz, vx, vy, vz = xm, ym, zm, fm, gm, hm
        if method == EULER and instant:
            tx, ty, tz, vx, vy, vz = xb, yb, zb, fb, gb, hb
        elif method == RK4:
            tx, ty, tz = (xb + 4.0 * xm + xe) / 6.0, (yb + 4.0 * ym + ye) / 6.0, (zb + 4.0 * zm + ze) / 6.0
            vx, vy, vz = (fb + 4.0 * fm + fe) / 6.0, (gb + 4.0 * gm + ge) / 6.0, (hb + 4.0 * hm + he) / 6.0
        dtheta[k, 0], dtheta[k, 1], dtheta[k, 2] = tx, ty, tz
        dvel[k, 0], dvel[k, 1], dvel[k, 2] = vx, vy, vz
        if method == ROTVEC:
            for i in range(3):
                coning[k, i] = sculling[k, i] = 0.0
            continue
        if method == EULER:
            q0, q1, q2, q3, ux, uy, uz = 1.0, 0.5 * tx, 0.5 * ty, 0.5 * tz, vx, vy, vz
        else:
            q0, q1, q2, q3, ux, uy, uz = _runge_kutta(
                xb, yb, zb, xm, ym, zm, xe, ye, ze, fb, gb, hb, fm, gm, hm, fe, ge, he
            )
        sine = np.sqrt(q1 * q1 + q2 * q2 + q3 * q3)
        stretch = 2.0 * np.arctan2(sine, q0) / sine if sine > 1e-9 else 2.0 / q0
        coning[k, 0], coning[k, 1], coning[k, 2] = stretch * q1 - tx, stretch * q2 - ty, stretch * q3 - tz
        # the effect of a constant rate on the velocity increment is not sculling
        f1, f2 = turn_factors(tx * tx + ty * ty + tz * tz)
        kx, ky, kz = ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx
        sculling[k, 0] = ux - vx - f1 * kx - f2 * (ty * kz - tz * ky)
        sculling[k, 1] = uy - vy - f1 * ky - f2 * (tz * kx - tx * kz)
        sculling[k, 2] = uz - vz - f1 * kz - f2 * (tx * ky - ty * kx)


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
