"""Coning and sculling: from samples to the rotation vector and velocity increment of each interval.

Inside an interval, a polynomial through the neighbouring samples represents angular rate and specific force. The
classical Runge-Kutta method integrates the quaternion from it, and Simpson's rule the velocity from the rotated
specific force. `glance` checks the plausibility of the samples in one pass.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit

WINDOW = 5  # samples that determine a polynomial; one more if they are instantaneous
LOOKAHEAD = WINDOW - 1  # most samples needed after an interval: at the start of a segment
UNIFORM = 1e-4  # relative spread of the intervals below which the weights for equal intervals apply


def uniform_weights(instant: bool) -> np.ndarray:
    """Compute the weights that convert equally spaced neighbouring samples to polynomial coefficients.

    `instant`: samples are values at the interval ends instead of integrals over intervals.

    Returns: ``w[size, offset, j, i]``, (WINDOW + 2, WINDOW + 1, WINDOW + 1, WINDOW + 1): weight of sample ``i`` in the
    coefficient of ``s**j``. The window has `size` samples, and ``s`` goes from 0 to 1 in its interval number `offset`.
    The polynomial is the rate or specific force times the interval.
    """
    largest = WINDOW + 1
    weights = np.zeros((largest + 1, largest, largest, largest))
    for size in range(1, largest + 1):
        power = np.arange(size)
        for offset in range(size):
            # s at the start of each increment, or of each instantaneous sample: number `offset` is at s = 1
            edge = np.arange(size) - offset + (1.0 if instant else 0.0)
            if instant:
                rows = edge[:, None] ** power
            else:
                rows = ((edge[:, None] + 1.0) ** (power + 1) - edge[:, None] ** (power + 1)) / (power + 1)
            weights[size, offset, :size, :size] = np.linalg.inv(rows)
    return weights


def stage_weights(weights: np.ndarray) -> np.ndarray:
    """Compute the weights that convert equally spaced samples to values at start, middle and end of an interval.

    A fourth row gives the exact integral over the first half minus the Runge-Kutta estimate of this integral, ``(5
    start + 8 middle - end) / 24``. This correction of the attitude at mid-interval halves the sculling error.

    `weights`: from `uniform_weights`.

    Returns: ``w[size, offset, stage, i]``, (WINDOW + 2, WINDOW + 1, 4, WINDOW + 1).
    """
    order = np.arange(WINDOW + 1)
    start, middle, end = np.array([0.0, 0.5, 1.0])[:, None] ** order
    half = 0.5 * middle / (order + 1) - (5.0 * start + 8.0 * middle - end) / 24.0
    power = np.stack([start, middle, end, half])
    return np.ascontiguousarray(np.einsum("sj,zoji->zosi", power, weights))


@inner()
def _regular(a, size, weights, scale, gyro, accel, coefficient):  # type: ignore[no-untyped-def]
    """Compute the polynomial coefficients of all six channels from equally spaced samples."""
    coefficient[:] = 0.0
    for i in range(size):
        for j in range(size):
            w = weights[j, i] * scale
            for channel in range(3):
                coefficient[channel, j] += w * gyro[a + i, channel]
                coefficient[channel + 3, j] += w * accel[a + i, channel]


@inner()
def _irregular(k, a, size, instant, end, dt, gyro, accel, node, table, coefficient):  # type: ignore[no-untyped-def]
    """Compute the coefficients of all six channels from unequally spaced samples, by Newton's divided differences."""
    start, scale = end[k] - dt[k], dt[k]
    points = size if instant else size + 1
    if instant:
        for i in range(points):
            node[i] = (end[a + i] - start) / scale
    else:
        node[0] = (end[a] - dt[a] - start) / scale
        for i in range(size):
            node[i + 1] = node[i] + dt[a + i] / scale
    for channel in range(6):
        if instant:
            for i in range(points):
                table[i] = (gyro[a + i, channel] if channel < 3 else accel[a + i, channel - 3]) * scale
        else:
            table[0] = 0.0
            for i in range(size):
                table[i + 1] = table[i] + (gyro[a + i, channel] if channel < 3 else accel[a + i, channel - 3])
        for order in range(1, points):
            for i in range(points - 1, order - 1, -1):
                table[i] = (table[i] - table[i - 1]) / (node[i] - node[i - order])
        # convert Newton's form to powers of s, in place (Horner's scheme)
        for i in range(points - 2, -1, -1):
            for j in range(i, points - 1):
                table[j] -= node[i] * table[j + 1]
        for j in range(WINDOW + 1):
            coefficient[channel, j] = 0.0
        for j in range(size):
            # with increments the table holds the integral: differentiate it
            coefficient[channel, j] = table[j] if instant else (j + 1.0) * table[j + 1]


@inner()
def _value(coefficient, channel, s):  # type: ignore[no-untyped-def]
    c = coefficient
    return c[channel, 0] + s * (
        c[channel, 1] + s * (c[channel, 2] + s * (c[channel, 3] + s * (c[channel, 4] + s * c[channel, 5])))
    )


@inner()
def _integral(coefficient, channel, s):  # type: ignore[no-untyped-def]
    c = coefficient
    return s * (
        c[channel, 0]
        + s
        * (
            c[channel, 1] / 2.0
            + s
            * (c[channel, 2] / 3.0 + s * (c[channel, 3] / 4.0 + s * (c[channel, 4] / 5.0 + s * c[channel, 5] / 6.0)))
        )
    )


@njit(cache=True)
def quaternion_rate(q0, q1, q2, q3, x, y, z):  # type: ignore[no-untyped-def]
    """Compute the quaternion rate q' = 1/2 q (x) w (Groves 2013, appendix E.6)."""
    return (
        -0.5 * (q1 * x + q2 * y + q3 * z),
        0.5 * (q0 * x + q2 * z - q3 * y),
        0.5 * (q0 * y + q3 * x - q1 * z),
        0.5 * (q0 * z + q1 * y - q2 * x),
    )


@njit(cache=True)
def turned(q0, q1, q2, q3, x, y, z):  # type: ignore[no-untyped-def]
    """Rotate a vector by a quaternion and subtract the vector: (C(q) - I) v, without cancellation."""
    tx, ty, tz = 2.0 * (q2 * z - q3 * y), 2.0 * (q3 * x - q1 * z), 2.0 * (q1 * y - q2 * x)
    return q0 * tx + q2 * tz - q3 * ty, q0 * ty + q3 * tx - q1 * tz, q0 * tz + q1 * ty - q2 * tx


@njit(cache=True)
def turn_factors(angle2):  # type: ignore[no-untyped-def]
    """Compute (1 - cos a) / a^2 and (a - sin a) / a^3 from the squared angle (Savage 1998, part 2)."""
    if angle2 < 0.04:
        # the seventh-order series is exact to rounding below 0.2 rad
        return (
            0.5 - angle2 * (1 / 24.0 - angle2 * (1 / 720.0 - angle2 * (1 / 40320.0 - angle2 / 3628800.0))),
            1 / 6.0 - angle2 * (1 / 120.0 - angle2 * (1 / 5040.0 - angle2 * (1 / 362880.0 - angle2 / 39916800.0))),
        )
    angle = np.sqrt(angle2)
    return (1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle2 * angle)


@njit(cache=True)
def interval_ends(time, nominal, longest, window, before, first, last, start, end):  # type: ignore[no-untyped-def]
    """Fill `start` and `end` (n,) [s] of the intervals of samples `first` to `last` - 1, stamped at `time` (n,).

    `before`: share of the interval before its timestamp. The `nominal` interval [s] replaces a step with missing
    samples. Such a step exceeds `longest` nominal intervals, and jitter within `window` steps does not explain it.
    """
    n = time.shape[0]
    for k in range(max(first - 1, 0), last):
        step = nominal  # replaced below if no sample is missing
        if k < n - 1 and time[k + 1] - time[k] <= longest * nominal:
            step = time[k + 1] - time[k]
        elif k < n - 1:
            begin, stop = max(k - window, 0), min(k + window + 1, n - 1)
            # jitter alone: up to 4 ms at 100 Hz moves the ends of the window by 0.8 of a step
            if time[stop] - time[begin] <= (stop - begin + 0.85) * nominal:
                step = time[k + 1] - time[k]
        end[k] = time[k] + (1.0 - before) * step
        if k < n - 1:
            start[k + 1] = time[k + 1] - before * step
    if first == 0:
        start[0] = time[0] - before * nominal


@njit(cache=True)
def split(end, dt, first, last, times, tolerance, parent, s0, s1):  # type: ignore[no-untyped-def]
    """Split intervals `first` to `last` - 1 at increasing `times` (m,) [s], not within `tolerance` of other edges.

    Fills the interval number `parent` of each piece, and its start `s0` and end `s1` as fractions of the interval.
    Returns: number of pieces.
    """
    count, i, before = 0, 0, -np.inf
    for k in range(first, last):
        begin, done = end[k] - dt[k], 0.0
        while i < times.shape[0] and times[i] - tolerance <= end[k]:
            time, i = times[i], i + 1
            if time - before > tolerance and time - begin > tolerance and end[k] - time > tolerance:
                parent[count], s0[count], s1[count] = k, done, (time - begin) / dt[k]
                done = s1[count]
                count += 1
            before = time
        parent[count], s0[count], s1[count] = k, done, 1.0
        count += 1
    return count


@njit(cache=True)
def increments(  # type: ignore[no-untyped-def]
    instant, end, dt, gyro, accel, segment, weights, stages, parent, s0, s1, dtheta, dvel, coning, sculling
):
    """Compute increments, coning and sculling of pieces of intervals.

    `instant`: `gyro` and `accel` are values at `end` instead of integrals over the interval. `end`, `dt` (n,): end and
    length of each interval [s]. `gyro`, `accel` (n, 3): integrated rate [rad] and specific force [m/s] of the interval,
    or values [rad/s], [m/s^2] at its end. `segment` (n,) int: number of the uninterrupted segment; polynomials stay
    within it. `weights`, `stages`: from `uniform_weights` and `stage_weights`. `parent` (m,) int: interval of each
    piece. `s0`, `s1` (m,): start and end of the piece as a fraction of its interval. `dtheta`, `dvel`, `coning`,
    `sculling` (m, 3): results; see `insnav.types.Increments`.
    """
    n = end.shape[0]
    coefficient, stage = np.zeros((6, WINDOW + 1)), np.zeros((6, 3))
    node = np.zeros(WINDOW + 2)
    table = np.zeros(WINDOW + 2)
    wanted = WINDOW + 1 if instant else WINDOW  # samples in a full window
    before = 3 if instant else 2  # usual number of samples before the interval's sample
    last, a, size, offset = -1, 0, 0, 0
    regular, ready, scale = False, False, 1.0
    for m in range(parent.shape[0]):
        k = parent[m]
        if dt[k] == 0.0:  # before the first instantaneous sample there is no interval
            for i in range(3):
                dtheta[m, i] = dvel[m, i] = coning[m, i] = sculling[m, i] = 0.0
            continue
        if k != last:
            last = k
            left, right = min(wanted - 1, k), min(wanted - 1, n - 1 - k)  # samples on either side in the segment
            while segment[k - left] != segment[k]:
                left -= 1
            while segment[k + right] != segment[k]:
                right -= 1
            size = min(wanted, left + right + 1)
            offset = min(left, max(before, size - 1 - right))
            a = k - offset  # first sample of the window
            regular = True
            # the first sample of an instantaneous segment has no interval of its own
            for i in range(a + 1 if instant else a, a + size):
                if abs(dt[i] - dt[k]) > UNIFORM * dt[k]:
                    regular = False
            scale = dt[k] if instant else 1.0
            ready = False  # compute polynomial coefficients only where needed
        b, e = s0[m], s1[m]  # start and end of the piece
        h = e - b
        if regular and h == 1.0:  # a whole interval with equal spacing: tabulated weights suffice
            xb = yb = zb = xm = ym = zm = xe = ye = ze = xh = yh = zh = fm = gm = hm = fe = ge = he = 0.0
            for i in range(size):
                wb = stages[size, offset, 0, i] * scale
                wm = stages[size, offset, 1, i] * scale
                we = stages[size, offset, 2, i] * scale
                wh = stages[size, offset, 3, i] * scale
                x, y, z = gyro[a + i, 0], gyro[a + i, 1], gyro[a + i, 2]
                xb += wb * x
                yb += wb * y
                zb += wb * z
                xm += wm * x
                ym += wm * y
                zm += wm * z
                xe += we * x
                ye += we * y
                ze += we * z
                xh += wh * x
                yh += wh * y
                zh += wh * z
                x, y, z = accel[a + i, 0], accel[a + i, 1], accel[a + i, 2]
                fm += wm * x
                gm += wm * y
                hm += wm * z
                fe += we * x
                ge += we * y
                he += we * z
        else:
            if not ready:
                ready = True
                if regular:
                    _regular(a, size, weights[size, offset], scale, gyro, accel, coefficient)
                else:
                    _irregular(k, a, size, instant, end, dt, gyro, accel, node, table, coefficient)
            mid = 0.5 * (b + e)
            for i in range(3):
                stage[0, i], stage[1, i] = h * _value(coefficient, i, b), h * _value(coefficient, i, mid)
                stage[2, i] = h * _value(coefficient, i, e)
                stage[3, i] = _integral(coefficient, i, mid) - _integral(coefficient, i, b)
                stage[3, i] -= (5.0 * stage[0, i] + 8.0 * stage[1, i] - stage[2, i]) / 24.0
                stage[4, i], stage[5, i] = h * _value(coefficient, i + 3, mid), h * _value(coefficient, i + 3, e)
            xb, yb, zb = stage[0, 0], stage[0, 1], stage[0, 2]
            xm, ym, zm = stage[1, 0], stage[1, 1], stage[1, 2]
            xe, ye, ze = stage[2, 0], stage[2, 1], stage[2, 2]
            xh, yh, zh = stage[3, 0], stage[3, 1], stage[3, 2]
            fm, gm, hm = stage[4, 0], stage[4, 1], stage[4, 2]
            fe, ge, he = stage[5, 0], stage[5, 1], stage[5, 2]
        if h == 1.0 and not instant:  # the increment of a whole interval was measured
            for i in range(3):
                dtheta[m, i] = gyro[k, i]
                dvel[m, i] = accel[k, i]
        else:
            if not ready:
                ready = True
                _regular(a, size, weights[size, offset], scale, gyro, accel, coefficient)
            for i in range(3):
                dtheta[m, i] = _integral(coefficient, i, e) - _integral(coefficient, i, b)
                dvel[m, i] = _integral(coefficient, i + 3, e) - _integral(coefficient, i + 3, b)

        a0, a1, a2, a3 = quaternion_rate(1.0, 0.0, 0.0, 0.0, xb, yb, zb)  # Runge-Kutta stages
        b0, b1, b2, b3 = quaternion_rate(1.0 + 0.5 * a0, 0.5 * a1, 0.5 * a2, 0.5 * a3, xm, ym, zm)
        c0, c1, c2, c3 = quaternion_rate(1.0 + 0.5 * b0, 0.5 * b1, 0.5 * b2, 0.5 * b3, xm, ym, zm)
        d0, d1, d2, d3 = quaternion_rate(1.0 + c0, c1, c2, c3, xe, ye, ze)
        q0 = 1.0 + (a0 + 2.0 * b0 + 2.0 * c0 + d0) / 6.0
        q1 = (a1 + 2.0 * b1 + 2.0 * c1 + d1) / 6.0
        q2 = (a2 + 2.0 * b2 + 2.0 * c2 + d2) / 6.0
        q3 = (a3 + 2.0 * b3 + 2.0 * c3 + d3) / 6.0
        # Quaternion at mid-interval from the same stages (third-order dense output of the Runge-Kutta method). ``xh``,
        # ``yh``, ``zh`` correct it for the exact integral of the rate.
        m0 = 1.0 + (5.0 * a0 + 4.0 * b0 + 4.0 * c0 - d0) / 24.0
        m1 = (5.0 * a1 + 4.0 * b1 + 4.0 * c1 - d1) / 24.0 + 0.5 * xh
        m2 = (5.0 * a2 + 4.0 * b2 + 4.0 * c2 - d2) / 24.0 + 0.5 * yh
        m3 = (5.0 * a3 + 4.0 * b3 + 4.0 * c3 - d3) / 24.0 + 0.5 * zh

        sine2 = q1 * q1 + q2 * q2 + q3 * q3
        u = sine2 / (q0 * q0)  # squared tangent of half the angle; the series is exact to rounding below 0.1 rad
        if u < 0.0025:
            stretch = 1.0 / 7.0 - u * (1.0 / 9.0 - u * (1.0 / 11.0 - u / 13.0))
            stretch = 2.0 * (1.0 - u * (1.0 / 3.0 - u * (0.2 - u * stretch))) / q0
        else:
            stretch = 2.0 * np.arctan2(np.sqrt(sine2), q0) / np.sqrt(sine2)
        # remove the leading error of the Runge-Kutta method at a constant rate: 0.5 ppm at 1000 deg/s and 100 Hz
        tx, ty, tz = dtheta[m, 0], dtheta[m, 1], dtheta[m, 2]
        angle2 = tx * tx + ty * ty + tz * tz
        kept = 1.0 - angle2 * angle2 / 1920.0
        coning[m, 0] = stretch * q1 - kept * tx
        coning[m, 1] = stretch * q2 - kept * ty
        coning[m, 2] = stretch * q3 - kept * tz

        ux, uy, uz = turned(m0, m1, m2, m3, fm, gm, hm)  # change of the specific force by rotation, at mid-interval
        wx, wy, wz = turned(q0, q1, q2, q3, fe, ge, he)
        vx, vy, vz = dvel[m, 0], dvel[m, 1], dvel[m, 2]
        f1, f2 = turn_factors(angle2)  # effect of a constant rate, which is not sculling
        kx, ky, kz = ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx
        sculling[m, 0] = (4.0 * ux + wx) / 6.0 - f1 * kx - f2 * (ty * kz - tz * ky)
        sculling[m, 1] = (4.0 * uy + wy) / 6.0 - f1 * ky - f2 * (tz * kx - tx * kz)
        sculling[m, 2] = (4.0 * uz + wz) / 6.0 - f1 * kz - f2 * (tx * ky - ty * kx)


@njit(cache=True)
def glance(gyro, accel, scale, limit, back):  # type: ignore[no-untyped-def]
    """Return the largest value and change of each axis, (6,), and whether any value jumps and returns, or repeats.

    `gyro`, `accel` (n, 3) are divided by `scale` (n,) for values and changes. Jump: two successive changes of opposite
    sign beyond `limit` (6,), whose sum is below `back` times the smaller change. Repeat: one raw value three times.
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
                step[axis] = here - value[axis]
                size, least = abs(step[axis]), min(abs(step[axis]), abs(earlier))
                change[axis] = max(change[axis], size)
                odd |= earlier * step[axis] < 0.0 and least > limit[axis] and abs(earlier + step[axis]) < back * least
                odd |= k > 1 and before[axis] == now == older[axis]
            value[axis], older[axis], before[axis] = here, before[axis], now
    return largest, change, odd
