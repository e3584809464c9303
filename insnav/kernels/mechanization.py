"""One step, and a whole record, of the strapdown navigation equations in the local-level frame.

State ``x``: latitude, longitude [rad], height [m], velocity North, East, Down [m/s], quaternion ``q_nb``. Near a pole
North rotates arbitrarily fast. Steps there use Earth-fixed axes; the state keeps its form.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.earth import OMEGA, gravity_down, gravity_north, radii
from insnav.kernels.increments import turn_factors, turned

TWO_PI = 2.0 * np.pi
HALF_PI = 0.5 * np.pi
POLAR_CAP = 0.02  # cosine of the latitude below which Earth-fixed axes are used: 128 km around each pole


@inner()
def within_turn(lon):  # type: ignore[no-untyped-def]
    """Wrap a longitude to -pi to pi, from less than one turn outside [rad]."""
    if lon >= np.pi:
        return lon - TWO_PI
    return lon + TWO_PI if lon < -np.pi else lon


@njit(cache=True)
def quaternion_step(x, rx, ry, rz, px, py, pz):  # type: ignore[no-untyped-def]
    """Q <- q(-r) (x) q (x) q(p): navigation frame rotated by r, body by p, both rotation vectors [rad]."""
    # half-angle series: both rotations of one step are small, and exact to rounding below 0.6 rad; scalar parts less 1
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
    # The change of q is accumulated separately and added once. Several equal rounding errors per step, over hours at
    # rest, would move the vehicle by a millimetre.
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
    Groves (2013) section 5.3, Earth-frame equations, without transport rate and its tangent of the latitude. The end of
    the step converts the state to North, East, Down there. Latitude and height follow the ellipsoid normal half-way,
    with third-order errors in the angle travelled. Longitude is an arctangent. The rotation of the axes,
    ``q_y(lat1 + pi/2) q_z(lon0 - lon1) q_y(-lat0 - pi/2)``, is expanded so that it is exactly zero at rest.
    """
    lat, lon, h = x[0], x[1], x[2]
    vn, ve, vd = x[3], x[4], x[5]
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    rm, rn = radii(sin_lat)
    tn, td = OMEGA * cos_lat * dt, -OMEGA * sin_lat * dt  # the Earth's rotation
    un, ue, ud = un + 0.5 * td * ue, ue - 0.5 * (td * un - tn * ud), ud - 0.5 * tn * ue
    mn = vn + 0.5 * (un + north * gravity_north(sin_lat, cos_lat, h) * dt) + td * ve
    me = ve + 0.5 * ue - (td * vn - tn * vd)
    md = vd + 0.5 * (ud + gravity_down(sin_lat, h) * dt) - tn * ve
    # Half-way: down has leaned back by the angle travelled. The north component of gravity points along the distance
    # from the axis, so it has an east component, too.
    an, ae, h_mid = 0.25 * dt * (vn + mn) / (rm + h), 0.25 * dt * (ve + me) / (rn + h), h - 0.25 * dt * (vd + md)
    g = gravity_down(sin_lat + an * cos_lat, h_mid)
    g_north = north * gravity_north(sin_lat, cos_lat - an * sin_lat, h_mid) - g * an
    g_east = -north * gravity_north(1.0, ae, h_mid) - g * ae
    v1n = vn + un + g_north * dt + 2.0 * td * me
    v1e = ve + ue + g_east * dt - 2.0 * (td * mn - tn * md)
    v1d = vd + ud + g * dt - 2.0 * tn * me
    dn, de, dd = 0.5 * dt * (vn + v1n), 0.5 * dt * (ve + v1e), 0.5 * dt * (vd + v1d)

    rho = (rn + h) * cos_lat  # distance from the axis
    out, along = -sin_lat * dn - cos_lat * dd, cos_lat * dn - sin_lat * dd
    turn = np.arctan2(de, rho + out)
    out = ((2.0 * rho + out) * out + de * de) / (rho + np.sqrt((rho + out) * (rho + out) + de * de))
    rise = (cos_lat * along - sin_lat * out) / (rm + h)
    sin_mid, cos_mid = sin_lat + 0.5 * rise * cos_lat, cos_lat - 0.5 * rise * sin_lat
    rm, rn = radii(sin_mid)
    up = cos_mid * out + sin_mid * along
    rise = (cos_mid * along - sin_mid * out) / (rm + h + 0.5 * up)
    rise *= 1.0 + rise * rise / 24.0  # the chord to the arc
    x[0] = min(max(lat + rise, -HALF_PI), HALF_PI)
    x[1] = within_turn(lon + turn)

    quaternion_step(x, tn, 0.0, td, px, py, pz)
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
    a0, a1, a2, a3 = c * np.cos(0.5 * rise), -s * cos_mid, c * np.sin(0.5 * rise), s * sin_mid
    wn, we, wd = turned(a0, a1, a2, a3, v1n, v1e, v1d)
    x[2] = height if hold else h + up
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
    """Compute ``C_nb`` of the state, row by row (9,)."""
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
    bx = vx + f1 * kx + f2 * (ty * kz - tz * ky) + sx
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
    # Extrapolation to mid-interval needs every velocity change. Without Earth rotation of u, the error is 1e-7 m/s at
    # 50 Hz. Through the transport rate it moves a vehicle at rest by a millimetre in 4 h. Without Coriolis, 0.03 m/s^2
    # at 250 m/s gives metres after an hour.
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
    # latitude half-way: the change of the sine and cosine over half a step is far below their second-order term
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
