"""North-pointing platform: its equations of motion, and four methods to integrate them from sampled specific force.

State ``y``, 18 numbers, first of an ideal platform: latitude, longitude [rad], height [m], velocity North, East, Down
[m/s], integral of the height error [m/s^2]. Then the same seven states of the platform with errors, and the quaternion
from its axes to true North, East, Down. The same method integrates both from the same samples: their difference is the
effect of the errors alone.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.earth import OMEGA, gravity_down, gravity_north, radii
from insnav.kernels.increments import turned
from insnav.kernels.mechanization import within_turn

FORWARD, BACKWARD, MEAN, FOURTH = 0, 1, 2, 3  # methods: Euler, implicit Euler, trapezoid, fourth-order Runge-Kutta
OFF, FREE, DAMPED = 0, 1, 2  # states of the vertical channel: omitted, undamped, damped
STATES = 18
COMPUTED = 7  # first state of the platform with errors
TURN = 14  # first element of its quaternion
NEIGHBOURS = 6  # samples for the interpolated value half-way between two samples
ITERATIONS = 4  # iterations of an implicit step; each reduces its error by a factor of 30 or more, 1e4 at 100 Hz
NEAREST_POLE = 1e-3  # smallest cosine of the latitude: 6 km from a pole
HIGHEST = 1e6  # largest height [m]


@njit(cache=True)
def midpoints(time, values, out):  # type: ignore[no-untyped-def]
    """Interpolate half-way between successive samples, by the polynomial through the six nearest samples.

    Lagrange's form at the true times; ``time`` (n,), ``values`` (n, m), ``out`` (n - 1, m).
    """
    n = time.shape[0]
    count = min(NEIGHBOURS, n)
    weight = np.empty(count)
    for k in range(n - 1):
        first = min(max(k - count // 2 + 1, 0), n - count)
        at = 0.5 * (time[k + 1] - time[k])
        for i in range(count):
            here = time[first + i] - time[k]
            w = 1.0
            for j in range(count):
                if j != i:
                    there = time[first + j] - time[k]
                    w *= (at - there) / (here - there)
            weight[i] = w
        for c in range(values.shape[1]):
            total = 0.0
            for i in range(count):
                total += weight[i] * values[first + i, c]
            out[k, c] = total


@njit(cache=True)
def quadrature(method, time, values, mid, out):  # type: ignore[no-untyped-def]
    """Integrate samples ``(n,)``, with midpoints `mid` (n - 1,), from the first on by the method's rule: `out` (n,)."""
    out[0] = 0.0
    for k in range(time.shape[0] - 1):
        a, b = values[k], values[k + 1]
        if method == FORWARD:
            mean = a
        elif method == BACKWARD:
            mean = b
        elif method == MEAN:
            mean = 0.5 * (a + b)
        else:
            mean = (a + 4.0 * mid[k] + b) / 6.0
        out[k + 1] = out[k] + (time[k + 1] - time[k]) * mean


@njit(cache=True)
def channel(y, o, fn, fe, fd, height, vertical, gains, d):  # type: ignore[no-untyped-def]
    """Compute rates of the seven states from `o` on, in `d`; return the rate of North, East, Down in inertial space.

    Groves (2013), eq. 2.111, 2.123, 5.44 and 5.53; third-order damping of the vertical channel.
    """
    lat, h, vn, ve, vd = y[o], y[o + 2], y[o + 3], y[o + 4], y[o + 5]
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    rm, rn = radii(sin_lat)
    en, ed = OMEGA * cos_lat, -OMEGA * sin_lat
    wn, we = ve / (rn + h), -vn / (rm + h)
    wd = -wn * sin_lat / cos_lat
    kn, ke, kd = 2.0 * en + wn, we, 2.0 * ed + wd
    d[o] = -we
    d[o + 1] = wn / cos_lat
    normal = np.isnan(gains[3])
    g_north = gravity_north(sin_lat, cos_lat, h) if normal else 0.0
    d[o + 3] = fn + g_north - (ke * vd - kd * ve)
    d[o + 4] = fe - (kd * vn - kn * vd)
    d[o + 2] = d[o + 5] = d[o + 6] = 0.0
    if vertical != OFF:
        d[o + 2] = -vd
        d[o + 5] = fd + (gravity_down(sin_lat, h) if normal else gains[3]) - (kn * ve - ke * vn)
        if vertical == DAMPED:
            above = h - height
            d[o + 2] -= gains[0] * above
            d[o + 5] += gains[1] * above + y[o + 6]
            d[o + 6] = gains[2] * above
    return en + wn, we, ed + wd


@njit(cache=True)
def derivative(y, f, k, vertical, gains, disturbed, errors, d):  # type: ignore[no-untyped-def]
    """Compute the rate of the whole state, in `d`.

    `y`, `d` (18,): state and its rate. `f` (n, 4): specific force along the true North, East, Down [m/s^2], and height
    for the damping [m], in row `k`. `vertical`: `OFF`, `FREE` or `DAMPED`. `gains` (4,): damping gains [1/s], [1/s^2],
    [1/s^3], and the vertical gravity [m/s^2], ``NaN`` for normal gravity. `disturbed`: there are errors; otherwise the
    second half of the state does not change. `errors` (6,): platform drift [rad/s] and accelerometer bias [m/s^2],
    along the platform axes.

    Notes
    -----
    The platform rotates at the commanded (computed) rate plus its drift; true North, East, Down rotate at the true
    rate. For a small platform tilt ``phi`` this is ``phi' = -w_in x phi + drift + dw_in``. Its accelerometers measure
    ``f - phi x f + bias`` (Britting 1971, chapter on the local-level system).
    """
    wn, we, wd = channel(y, 0, f[k, 0], f[k, 1], f[k, 2], f[k, 3], vertical, gains, d)
    if not disturbed:
        return
    q0, q1, q2, q3 = y[TURN], y[TURN + 1], y[TURN + 2], y[TURN + 3]
    fn, fe, fd = f[k, 0], f[k, 1], f[k, 2]
    un, ue, ud = turned(q0, -q1, -q2, -q3, fn, fe, fd)
    cn, ce, cd = channel(
        y, COMPUTED, fn + un + errors[3], fe + ue + errors[4], fd + ud + errors[5], f[k, 3], vertical, gains, d
    )
    # 1/2 (q p - r q): p is the platform rate in its axes, r the rate of true North, East, Down
    px, py, pz = cn + errors[0], ce + errors[1], cd + errors[2]
    sx, sy, sz = px - wn, py - we, pz - wd
    tx, ty, tz = px + wn, py + we, pz + wd
    d[TURN] = -0.5 * (q1 * sx + q2 * sy + q3 * sz)
    d[TURN + 1] = 0.5 * (q0 * sx + q2 * tz - q3 * ty)
    d[TURN + 2] = 0.5 * (q0 * sy + q3 * tx - q1 * tz)
    d[TURN + 3] = 0.5 * (q0 * sz + q1 * ty - q2 * tx)


@inner()
def _moved(y, h, d, out):  # type: ignore[no-untyped-def]
    for i in range(STATES):
        out[i] = y[i] + h * d[i]


@njit(cache=True)
def advance(method, h, f, mid, k, vertical, gains, disturbed, errors, y, work):  # type: ignore[no-untyped-def]
    """Advance the state from sample k to the next, `h` later, in place; `work` is (5, 18), initially zero."""
    a, b, c, e, z = work[0], work[1], work[2], work[3], work[4]
    if method != BACKWARD:
        derivative(y, f, k, vertical, gains, disturbed, errors, a)
    if method == FORWARD:
        _moved(y, h, a, z)
    elif method == FOURTH:
        _moved(y, 0.5 * h, a, z)
        derivative(z, mid, k, vertical, gains, disturbed, errors, b)
        _moved(y, 0.5 * h, b, z)
        derivative(z, mid, k, vertical, gains, disturbed, errors, c)
        _moved(y, h, c, z)
        derivative(z, f, k + 1, vertical, gains, disturbed, errors, e)
        for i in range(STATES):
            z[i] = y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + e[i])
    else:  # implicit: evaluate the final rate at the current estimate of the final state
        for i in range(STATES):
            z[i] = y[i]
        for _ in range(ITERATIONS):
            derivative(z, f, k + 1, vertical, gains, disturbed, errors, b)
            if method == MEAN:
                for i in range(STATES):
                    z[i] = y[i] + 0.5 * h * (a[i] + b[i])
            else:
                _moved(y, h, b, z)
    for i in range(STATES):
        y[i] = z[i]
    for o in range(1, TURN, COMPUTED):
        y[o] = within_turn(y[o])
    norm = 1.5 - 0.5 * (y[TURN] ** 2 + y[TURN + 1] ** 2 + y[TURN + 2] ** 2 + y[TURN + 3] ** 2)
    for i in range(TURN, STATES):
        y[i] *= norm


@njit(cache=True)
def navigate(method, time, f, mid, vertical, gains, disturbed, errors, y, every, out):  # type: ignore[no-untyped-def]
    """Integrate a whole record; store the state at each `every`-th sample, including the first, in the rows of `out`.

    Returns: number of steps: one less than samples, or fewer if a state leaves the range in which the equations hold.
    """
    work = np.zeros((5, STATES))
    last = 2 if disturbed else 1
    for i in range(STATES):
        out[0, i] = y[i]
    for k in range(time.shape[0] - 1):
        advance(method, time[k + 1] - time[k], f, mid, k, vertical, gains, disturbed, errors, y, work)
        for part in range(last):
            o = part * COMPUTED
            # this form also rejects NaN
            if not (np.cos(y[o]) > NEAREST_POLE and abs(y[o]) < 1.6 and abs(y[o + 2]) < HIGHEST):
                return k
        if (k + 1) % every == 0:
            for i in range(STATES):
                out[(k + 1) // every, i] = y[i]
    return time.shape[0] - 1
