"""One step, and a whole record, of the strapdown navigation equations in the local-level frame.

State ``x``: latitude, longitude [rad], height [m], velocity North, East, Down [m/s], quaternion ``q_nb``. Near a pole
North rotates arbitrarily fast. Steps there use Earth-fixed axes; the state keeps its form.

The simple methods of `increments`, for study, connect neighbouring samples by straight lines. Navigation uses
`insnav.kernels.increments` instead.
"""

from __future__ import annotations

import numpy as np
from numpy import cos, sin

from insnav.kernels import inner, njit
from insnav.kernels.earth import OMEGA, gravity_down, gravity_north, radii
from insnav.kernels.increments import quaternion_rate, turn_factors, turned

TWO_PI = 2.0 * np.pi
HALF_PI = 0.5 * np.pi
POLAR_CAP = 0.02  # cosine of the latitude below which Earth-fixed axes are used: 128 km around each pole


@inner()
def within_turn(lon):  # type: ignore[no-untyped-def]
    """Wrap a longitude [rad], at most one turn out of range, to -pi to pi."""
    if lon >= np.pi:
        return lon - TWO_PI
    return lon + TWO_PI if lon < -np.pi else lon


@njit(cache=True)
def quaternion_step(x, rx, ry, rz, px, py, pz):  # type: ignore[no-untyped-def]
    """Update the quaternion q of `x` to q(-r) (x) q (x) q(p): r rotates the navigation frame, p the body [rad]."""
    # quaternions from series in half the angle: r is tiny, and p exact to rounding below 0.6 rad; scalar parts minus 1
    r2 = 0.25 * (rx * rx + ry * ry + rz * rz)
    a0 = -0.5 * r2
    s = -0.5 * (1.0 - r2 / 6.0)
    a1, a2, a3 = s * rx, s * ry, s * rz
    p2 = 0.25 * (px * px + py * py + pz * pz)
    if p2 < 0.09:
        b0 = -p2 * (0.5 - p2 * (1 / 24.0 - p2 * (1 / 720.0 - p2 * (1 / 40320.0 - p2 / 3628800.0))))
        s = 0.5 - p2 * (1 / 12.0 - p2 * (1 / 240.0 - p2 * (1 / 10080.0 - p2 / 725760.0)))
    else:
        p = np.sqrt(p2)
        b0, s = np.cos(p) - 1.0, 0.5 * np.sin(p) / p
    b1, b2, b3 = s * px, s * py, s * pz
    # Sum the change of q separately and add it once: over hours at rest, repeated rounding errors would move the
    # vehicle by a millimetre.
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    c0 = q0 * b0 - q1 * b1 - q2 * b2 - q3 * b3
    c1 = q0 * b1 + q1 * b0 + q2 * b3 - q3 * b2
    c2 = q0 * b2 - q1 * b3 + q2 * b0 + q3 * b1
    c3 = q0 * b3 + q1 * b2 - q2 * b1 + q3 * b0
    g0, g1, g2, g3 = q0 + c0, q1 + c1, q2 + c2, q3 + c3
    norm = 0.5 - 0.5 * (g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3)
    x[6] = q0 + (c0 + (a0 * g0 - a1 * g1 - a2 * g2 - a3 * g3) + norm * q0)
    x[7] = q1 + (c1 + (a0 * g1 + a1 * g0 + a2 * g3 - a3 * g2) + norm * q1)
    x[8] = q2 + (c2 + (a0 * g2 - a1 * g3 + a2 * g0 + a3 * g1) + norm * q2)
    x[9] = q3 + (c3 + (a0 * g3 + a1 * g2 - a2 * g1 + a3 * g0) + norm * q3)


@njit(cache=True)
def polar_step(x, dt, un, ue, ud, px, py, pz, north, hold, height, v_down):  # type: ignore[no-untyped-def]
    """Advance the state by one interval in axes that are North, East, Down at its start, fixed to the Earth.

    `x`, `dt`, `north`, `hold`, `height`, `v_down`: see `step`. `un`, `ue`, `ud`: velocity increment of the specific
    force along these axes [m/s]. `px`, `py`, `pz`: rotation vector of the body over the interval [rad].

    Notes
    -----
    Groves (2013) section 5.3, Earth-frame equations: they have no transport rate, and thus no tangent of the latitude.
    The end of the step converts the state to North, East, Down there. Latitude and height follow the ellipsoid normal
    half-way, with third-order errors in the angle travelled. Longitude is an arctangent. The rotation of the axes,
    ``q_y(lat1 + pi/2) q_z(lon0 - lon1) q_y(-lat0 - pi/2)``, is expanded so that it is exactly zero at rest.
    """
    lat, lon, h = x[0], x[1], x[2]
    vn, ve, vd = x[3], x[4], x[5]
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    rm, rn = radii(sin_lat)
    tn, td = OMEGA * cos_lat * dt, -OMEGA * sin_lat * dt  # rotation of the Earth in this interval [rad]
    un, ue, ud = un + 0.5 * td * ue, ue - 0.5 * (td * un - tn * ud), ud - 0.5 * tn * ue
    mn = vn + 0.5 * (un + north * gravity_north(sin_lat, cos_lat, h) * dt) + td * ve
    me = ve + 0.5 * ue - (td * vn - tn * vd)
    md = vd + 0.5 * (ud + gravity_down(sin_lat, h) * dt) - tn * ve
    # At mid-interval, Down has tilted by the angle travelled. The north component of gravity is proportional to the
    # vector from the Earth's axis, so it has an east part, too.
    an, ae, h_mid = 0.25 * dt * (vn + mn) / (rm + h), 0.25 * dt * (ve + me) / (rn + h), h - 0.25 * dt * (vd + md)
    g = gravity_down(sin_lat + an * cos_lat, h_mid)
    g_north = north * gravity_north(sin_lat, cos_lat - an * sin_lat, h_mid) - g * an
    g_east = -north * gravity_north(1.0, ae, h_mid) - g * ae
    v1n = vn + un + g_north * dt + 2.0 * td * me
    v1e = ve + ue + g_east * dt - 2.0 * (td * mn - tn * md)
    v1d = vd + ud + g * dt - 2.0 * tn * me
    dn, de, dd = 0.5 * dt * (vn + v1n), 0.5 * dt * (ve + v1e), 0.5 * dt * (vd + v1d)

    rho = (rn + h) * cos_lat  # distance from the Earth's axis [m]
    out, along = -sin_lat * dn - cos_lat * dd, cos_lat * dn - sin_lat * dd
    turn = np.arctan2(de, rho + out)
    out = ((2.0 * rho + out) * out + de * de) / (rho + np.sqrt((rho + out) * (rho + out) + de * de))
    rise = (cos_lat * along - sin_lat * out) / (rm + h)
    sin_mid, cos_mid = sin_lat + 0.5 * rise * cos_lat, cos_lat - 0.5 * rise * sin_lat
    rm, rn = radii(sin_mid)
    up = cos_mid * out + sin_mid * along
    rise = (cos_mid * along - sin_mid * out) / (rm + h + 0.5 * up)
    rise *= 1.0 + rise * rise / 24.0  # convert the chord to the arc
    x[0] = min(max(lat + rise, -HALF_PI), HALF_PI)
    x[1] = within_turn(lon + turn)

    quaternion_step(x, tn, 0.0, td, px, py, pz)
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
    a0, a1, a2, a3 = c * np.cos(0.5 * rise), -s * cos_mid, c * np.sin(0.5 * rise), s * sin_mid
    wn, we, wd = turned(a0, a1, a2, a3, v1n, v1e, v1d)
    x[2] = height if hold else h + up  # with `hold`, the vertical channel follows the given height
    x[3], x[4], x[5] = v1n + wn, v1e + we, v_down if hold else v1d + wd
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    q0, q1, q2, q3 = (
        a0 * q0 - a1 * q1 - a2 * q2 - a3 * q3,
        a0 * q1 + a1 * q0 + a2 * q3 - a3 * q2,
        a0 * q2 - a1 * q3 + a2 * q0 + a3 * q1,
        a0 * q3 + a1 * q2 - a2 * q1 + a3 * q0,
    )
    norm = 1.5 - 0.5 * (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    x[6], x[7], x[8], x[9] = norm * q0, norm * q1, norm * q2, norm * q3
    return un, ue, ud


@njit(cache=True)
def rotation(x, c):  # type: ignore[no-untyped-def]
    """Compute ``C_nb`` of the state `x` (10,) into `c` (9,), row by row."""
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    c[0] = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
    c[1] = 2.0 * (q1 * q2 - q0 * q3)
    c[2] = 2.0 * (q1 * q3 + q0 * q2)
    c[3] = 2.0 * (q1 * q2 + q0 * q3)
    c[4] = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
    c[5] = 2.0 * (q2 * q3 - q0 * q1)
    c[6] = 2.0 * (q1 * q3 - q0 * q2)
    c[7] = 2.0 * (q2 * q3 + q0 * q1)
    c[8] = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3


@njit(cache=True)
def step(x, dt, tx, ty, tz, vx, vy, vz, coning, sculling, k, c, north, hold, height, v_down):  # type: ignore[no-untyped-def]
    """Advance the state by one interval; return the velocity increment of the specific force, ``(3,)`` in n.

    `x` (10,): state, changed in place. `dt`: interval [s]. `tx`, `ty`, `tz`, `vx`, `vy`, `vz`: corrected angle [rad]
    and velocity [m/s] increment in body axes. `coning` [rad], `sculling` [m/s] (n, 3): row `k` counts. `c` (9,): filled
    with ``C_nb`` at the start of the interval, row by row. `north`: share of normal gravity's north component: 1, or 0
    to neglect it as most other packages do. `hold`: constrain the vertical channel to `height` [m] and `v_down` [m/s]
    at the end of the interval.

    Notes
    -----
    Velocity: Groves (2013) eq. 5.54 with the rotation of the navigation frame half-way (Savage 1998, part 2). Coriolis,
    transport rate and gravity are taken at mid-interval, with the velocity extrapolated by the measured specific force.
    Position: trapezoid rule, whose error telescopes. Attitude: quaternions of both frames.
    """
    px, py, pz = tx + coning[k, 0], ty + coning[k, 1], tz + coning[k, 2]
    sx, sy, sz = sculling[k, 0], sculling[k, 1], sculling[k, 2]
    rotation(x, c)
    f1, f2 = turn_factors(tx * tx + ty * ty + tz * tz)
    kx, ky, kz = ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx
    bx = vx + f1 * kx + f2 * (ty * kz - tz * ky) + sx  # velocity increment in axes at the start of the interval
    by = vy + f1 * ky + f2 * (tz * kx - tx * kz) + sy
    bz = vz + f1 * kz + f2 * (tx * ky - ty * kx) + sz
    un = c[0] * bx + c[1] * by + c[2] * bz
    ue = c[3] * bx + c[4] * by + c[5] * bz
    ud = c[6] * bx + c[7] * by + c[8] * bz

    lat, lon, h = x[0], x[1], x[2]
    vn, ve, vd = x[3], x[4], x[5]
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    if cos_lat < POLAR_CAP:
        return polar_step(x, dt, un, ue, ud, px, py, pz, north, hold, height, v_down)
    g = gravity_down(sin_lat, h)
    rm, rn = radii(sin_lat)
    # Extrapolate the velocity to mid-interval with every change. Without Earth rotation of u, it is wrong by 1e-7 m/s
    # at 50 Hz: a vehicle at rest moves by 1 mm in 4 h. Without Coriolis acceleration, 0.03 m/s^2 at 250 m/s, the error
    # is metres after an hour.
    en, ed = OMEGA * cos_lat, -OMEGA * sin_lat
    north_by, east_by = 1.0 / (rm + h), 1.0 / (rn + h)
    wn, we = ve * east_by, -vn * north_by
    wd = -wn * (sin_lat / cos_lat)
    zn, ze, zd = 0.5 * (en + wn) * dt, 0.5 * we * dt, 0.5 * (ed + wd) * dt
    kn, ke, kd = 2.0 * en + wn, we, 2.0 * ed + wd
    g_north = north * gravity_north(sin_lat, cos_lat, h)
    mn = vn + 0.5 * (un - ze * ud + zd * ue + (g_north - ke * vd + kd * ve) * dt)
    me = ve + 0.5 * (ue - zd * un + zn * ud - (kd * vn - kn * vd) * dt)
    md = vd + 0.5 * (ud - zn * ue + ze * un + (g - kn * ve + ke * vn) * dt)
    if hold:
        md = 0.5 * (vd + v_down)
    # sine and cosine of the latitude at mid-interval, to first order: the change over half a step is tiny
    half = 0.5 * dt * mn * north_by
    sin_mid, cos_mid = sin_lat + half * cos_lat, cos_lat - half * sin_lat
    h_mid = h - 0.5 * dt * md
    north_by, east_by, secant = 1.0 / (rm + h_mid), 1.0 / (rn + h_mid), 1.0 / cos_mid
    wn, we = me * east_by, -mn * north_by
    wd = -wn * sin_mid * secant
    en, ed = OMEGA * cos_mid, -OMEGA * sin_mid
    zn, ze, zd = (en + wn) * dt, we * dt, (ed + wd) * dt
    kn, ke, kd = 2.0 * en + wn, we, 2.0 * ed + wd
    un, ue, ud = un - 0.5 * (ze * ud - zd * ue), ue - 0.5 * (zd * un - zn * ud), ud - 0.5 * (zn * ue - ze * un)
    v1n = vn + un + (north * gravity_north(sin_mid, cos_mid, h_mid) - (ke * md - kd * me)) * dt
    v1e = ve + ue - (kd * mn - kn * md) * dt
    v1d = vd + ud + (gravity_down(sin_mid, h_mid) - (kn * me - ke * mn)) * dt
    if hold:
        v1d = v_down
    x[0] = lat + 0.5 * dt * (vn + v1n) * north_by
    x[1] = within_turn(lon + 0.5 * dt * (ve + v1e) * (east_by * secant))
    x[2] = height if hold else h - 0.5 * dt * (vd + v1d)
    x[3], x[4], x[5] = v1n, v1e, v1d
    quaternion_step(x, zn, ze, zd, px, py, pz)
    return un, ue, ud


@njit(cache=True)
def free_inertial(x, dt, dtheta, dvel, coning, sculling, north, hold, height, v_down, every, out):  # type: ignore[no-untyped-def]
    """Mechanize a whole record; store the state after each `every`-th interval in the rows of `out`."""
    c = np.zeros(9)
    row = 0
    for k in range(dt.shape[0]):
        h = height[k] if hold else 0.0
        d = v_down[k] if hold else 0.0
        tx, ty, tz = dtheta[k, 0], dtheta[k, 1], dtheta[k, 2]
        vx, vy, vz = dvel[k, 0], dvel[k, 1], dvel[k, 2]
        step(x, dt[k], tx, ty, tz, vx, vy, vz, coning, sculling, k, c, north, hold, h, d)
        if (k + 1) % every == 0:
            for i in range(10):
                out[row, i] = x[i]
            row += 1


EULER, ROTVEC, RK4 = 0, 1, 2


@inner()
def _line(instant, k, dt, values, channel):  # type: ignore[no-untyped-def]
    """Compute integrand times interval at start, middle and end of interval k, from straight lines between samples.

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
    """Advance quaternion and velocity by the Runge-Kutta method (Hairer, Norsett, Wanner 1993, section II.1)."""
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
    """Compute increments of whole intervals by a simple method, like `insnav.kernels.increments.increments`.

    `method`: `EULER`: constant rate, from the start of the interval or its mean; attitude and specific force are not
    rotated within it. `ROTVEC`: the mean rate is the rotation vector. `RK4`: Runge-Kutta on straight lines between
    samples. Other arguments: as in `insnav.kernels.increments.increments`.
    """
    for k in range(dt.shape[0]):
        if dt[k] == 0.0:  # before the first instantaneous sample there is no interval
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
        # subtract the effect of a constant rate on the velocity increment, which is not sculling
        f1, f2 = turn_factors(tx * tx + ty * ty + tz * tz)
        kx, ky, kz = ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx
        sculling[k, 0] = ux - vx - f1 * kx - f2 * (ty * kz - tz * ky)
        sculling[k, 1] = uy - vy - f1 * ky - f2 * (tz * kx - tx * kz)
        sculling[k, 2] = uz - vz - f1 * kz - f2 * (tx * ky - ty * kx)


@njit(cache=True)
def navigate(x, turning, dt, dtheta, dvel, coning, every, out):  # type: ignore[no-untyped-def]
    """Mechanize a record by the short-duration form; store the state after each `every`-th interval in `out`.

    `x` (10,): state as in `insnav.kernels.mechanization`, changed in place. `turning`: the attitude follows the
    rotation of North, East, Down, as in the full form. `dt` (n,): intervals [s]. `dtheta`, `dvel`, `coning` (n, 3):
    measured angle [rad] and velocity [m/s] increments, and coning [rad]; the short-duration form neglects sculling.
    `out` (n // every, 10).
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
