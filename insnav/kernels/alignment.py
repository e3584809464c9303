"""Attitude history and integrated specific force from gyros alone, and rotations between vectors, for alignment."""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.mechanization import quaternion_step

SWEEPS = 20  # largest number of sweeps of Jacobi rotations; about five suffice
REWEIGHTED, NEAR = 10, 0.05  # iterations of the mean rotation; distance from it with full weight [-]


@njit(cache=True)
def gyro_history(q, w_ie_n, dt, dtheta, dvel, q_out, u_out):  # type: ignore[no-untyped-def]
    """Integrate the gyros from an attitude ``q_nb``, (4,), and integrate the specific force in these axes.

    The axes n rotate with the Earth, `w_ie_n` (3,) [rad/s], at a fixed place. The increments are angles [rad] and
    velocities [m/s] without bias. Row 0 of `q_out`, (n + 1, 4), and of `u_out`, (n + 1, 3), the integral of
    ``C_nb f_b`` [m/s], is the start.
    """
    # copies arrays element by element, as slices take seconds to compile
    x = np.zeros(10)
    for i in range(4):
        x[6 + i] = q[i]
        q_out[0, i] = q[i]
    u_out[0, 0] = u_out[0, 1] = u_out[0, 2] = 0.0
    for k in range(dt.shape[0]):
        # resolve the specific force with the attitude half-way through the interval
        h = 0.5 * dt[k]
        wn, we, wd = h * w_ie_n[0], h * w_ie_n[1], h * w_ie_n[2]
        rx, ry, rz = 0.5 * dtheta[k, 0], 0.5 * dtheta[k, 1], 0.5 * dtheta[k, 2]
        quaternion_step(x, wn, we, wd, rx, ry, rz)
        a, b, c, d = x[6], x[7], x[8], x[9]
        fx, fy, fz = dvel[k, 0], dvel[k, 1], dvel[k, 2]
        tx, ty, tz = 2.0 * (c * fz - d * fy), 2.0 * (d * fx - b * fz), 2.0 * (b * fy - c * fx)
        u_out[k + 1, 0] = u_out[k, 0] + fx + a * tx + c * tz - d * ty
        u_out[k + 1, 1] = u_out[k, 1] + fy + a * ty + d * tx - b * tz
        u_out[k + 1, 2] = u_out[k, 2] + fz + a * tz + b * ty - c * tx
        quaternion_step(x, wn, we, wd, rx, ry, rz)
        for i in range(4):
            q_out[k + 1, i] = x[6 + i]


@njit(cache=True)
def joined(end, dt, gyro, accel, gap, instant, count, inside, out):  # type: ignore[no-untyped-def]
    """Join each `count` successive intervals of a segment with equal `gap` into one; see `insnav.strapdown.joined`.

    The rotation vector includes its second-order term (Bortz, IEEE Trans. AES 7 (1971) 61-66). The specific force is in
    the axes at the middle. `out` (m, 9): end, length, angles, velocities, gap. The first row continues the last
    interval of the previous call, which has `inside` parts so far.

    Returns: number of rows filled, and number of parts in the last row.
    """
    rows = 1 if inside > 0 else 0
    for k in range(end.shape[0]):
        if dt[k] == 0.0:
            continue
        scale = dt[k] if instant else 1.0
        x, y, z = gyro[k, 0] * scale, gyro[k, 1] * scale, gyro[k, 2] * scale
        fx, fy, fz = accel[k, 0] * scale, accel[k, 1] * scale, accel[k, 2] * scale
        if rows == 0 or inside == count or gap[k] != out[rows - 1, 8]:  # start a new row
            rows, inside = rows + 1, 0
            for i in range(1, 8):
                out[rows - 1, i] = 0.0
        inside += 1
        row = out[rows - 1]
        a, b, c = row[2], row[3], row[4]
        # the axes at the middle turn by half of each further rotation: resolve the earlier velocity increment in them
        px, py, pz = row[5], row[6], row[7]
        row[2] = a + x + 0.5 * (b * z - c * y)
        row[3] = b + y + 0.5 * (c * x - a * z)
        row[4] = c + z + 0.5 * (a * y - b * x)
        row[5] = px + fx + 0.5 * (b * fz - c * fy) - 0.5 * (y * pz - z * py)
        row[6] = py + fy + 0.5 * (c * fx - a * fz) - 0.5 * (z * px - x * pz)
        row[7] = pz + fz + 0.5 * (a * fy - b * fx) - 0.5 * (x * py - y * px)
        row[0], row[1], row[8] = end[k], row[1] + dt[k], gap[k]
    return rows, inside


@njit(cache=True)
def window_histories(dt, dtheta, dvel, first, out):  # type: ignore[no-untyped-def]
    """Integrate increments in windows of equal length, each in the axes at its start, without the Earth's rotation.

    `dvel`: of velocity or position. `first` (w,): first interval of each window. Filled: `out` (w, k + 1, 3), from 0.
    """
    identity, unused, no_rotation = np.zeros(4), np.zeros((out.shape[1], 4)), np.zeros(3)
    identity[0] = 1.0
    for w in range(first.shape[0]):
        rows = slice(first[w], first[w] + out.shape[1] - 1)
        gyro_history(identity, no_rotation, dt[rows], dtheta[rows], dvel[rows], unused, out[w])


@njit(cache=True)
def window_scatter(dt, gyro, accel, instant, size, begin, first, last, mean, loud):  # type: ignore[no-untyped-def]
    """Compute mean and scatter of rate and specific force in windows of `size` intervals, from row `begin` on.

    Windows `first` to `last` - 1 are filled: `mean` (2, n, 3), and `loud` (2, n), the norm of their sd [rad/s],
    [m/s^2].
    """
    here = np.zeros((size, 6))
    for w in range(first, last):
        row = begin + w * size
        for k in range(size):
            scale = 1.0 if instant else 1.0 / dt[row + k]
            for i in range(3):
                here[k, i], here[k, 3 + i] = scale * gyro[row + k, i], scale * accel[row + k, i]
        for s in range(2):
            square = 0.0
            for i in range(3):
                total = 0.0
                for k in range(size):
                    total += here[k, 3 * s + i]
                mean[s, w, i] = total / size
                for k in range(size):
                    square += (here[k, 3 * s + i] - mean[s, w, i]) ** 2
            loud[s, w] = np.sqrt(square / size)


@inner()
def _nearest(b, sign, k, v, out):  # type: ignore[no-untyped-def]
    """Find the rotation (3, 3), times a `sign`, nearest to `sign` times a sum of outer products `b`. `k`, `v`: work.

    Davenport's q-method (Markley and Mortari, J. Astronautical Sciences 48 (2000) 359-380): the quaternion is the
    eigenvector of the largest eigenvalue, here computed by Jacobi rotations.
    """
    k[0, 0] = sign * (b[0, 0] + b[1, 1] + b[2, 2])  # Davenport's matrix (4, 4)
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        k[0, i + 1] = k[i + 1, 0] = sign * (b[m, j] - b[j, m])
        k[i + 1, i + 1] = 2.0 * sign * b[i, i] - k[0, 0]
        k[i + 1, j + 1] = k[j + 1, i + 1] = sign * (b[i, j] + b[j, i])
    size = 0.0
    for i in range(4):
        for j in range(4):
            v[i, j] = 1.0 if i == j else 0.0
            size += k[i, j] ** 2
    for _ in range(SWEEPS):
        off = 0.0
        for i in range(3):
            for j in range(i + 1, 4):
                off += k[i, j] ** 2
                if k[i, j] == 0.0:
                    continue
                half = 0.5 * (k[j, j] - k[i, i]) / k[i, j]
                t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(half * half + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for m in range(4):
                    k[m, i], k[m, j] = c * k[m, i] - s * k[m, j], s * k[m, i] + c * k[m, j]
                for m in range(4):
                    k[i, m], k[j, m] = c * k[i, m] - s * k[j, m], s * k[i, m] + c * k[j, m]
                    v[m, i], v[m, j] = c * v[m, i] - s * v[m, j], s * v[m, i] + c * v[m, j]
        if off <= 1e-32 * size:  # the matrix is diagonal to rounding
            break
    most = 0
    for i in range(1, 4):
        if k[i, i] > k[most, most]:
            most = i
    q0, q1, q2, q3 = v[0, most], v[1, most], v[2, most], v[3, most]
    out[0, 0] = sign * (q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    out[1, 1] = sign * (q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3)
    out[2, 2] = sign * (q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    out[0, 1], out[1, 0] = sign * 2.0 * (q1 * q2 - q0 * q3), sign * 2.0 * (q1 * q2 + q0 * q3)
    out[0, 2], out[2, 0] = sign * 2.0 * (q1 * q3 + q0 * q2), sign * 2.0 * (q1 * q3 - q0 * q2)
    out[1, 2], out[2, 1] = sign * 2.0 * (q2 * q3 - q0 * q1), sign * 2.0 * (q2 * q3 + q0 * q1)


@njit(cache=True)
def mean_rotation(seen, felt, weight, sign, each, mean, away):  # type: ignore[no-untyped-def]
    """Find the rotation, times a `sign`, from `felt` to `seen` vectors (w, m, 3), for each window and for all.

    A window far from the mean is de-weighted: `weight` (w,) is divided by the distance. Filled: `each` (w, 3, 3),
    `mean` (3, 3), and `away` (w,), the Frobenius distance of each window from the mean.
    """
    k, v, b = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((3, 3))
    for w in range(seen.shape[0]):
        for i in range(3):
            for j in range(3):
                b[i, j] = 0.0
                for m in range(seen.shape[1]):
                    b[i, j] += seen[w, m, i] * felt[w, m, j]
        _nearest(b, sign, k, v, each[w])
        away[w] = 1.0
    for _ in range(1 + REWEIGHTED):
        for i in range(3):
            for j in range(3):
                b[i, j] = 0.0
                for w in range(seen.shape[0]):
                    b[i, j] += weight[w] / max(away[w], NEAR) * each[w, i, j]
        _nearest(b, sign, k, v, mean)
        for w in range(seen.shape[0]):
            square = 0.0
            for i in range(3):
                for j in range(3):
                    square += (each[w, i, j] - mean[i, j]) ** 2
            away[w] = np.sqrt(square)


@njit(cache=True)
def level_history(dt, dtheta, dvel, bias, time_constant, turn, change):  # type: ignore[no-untyped-def]
    """Integrate the turn about the vertical, and the horizontal specific force, of an IMU of unknown mounting.

    The gyros propagate the down axis in body axes, and the specific force corrects it with a `time_constant` [s]. A
    horizontal axis, propagated likewise, keeps its direction when the vehicle turns. Increments (n, 3) [rad], [m/s].
    `bias` (3,) of the gyros [rad/s]: the mean correction is added to it, since accelerations of a vehicle average to
    zero. `turn` (n + 1,) [rad] and `change` (n + 1, 2) [m/s] are integrals from zero.
    """
    d, h, pulled, length = np.zeros(3), np.zeros(3), np.zeros(3), 0.0
    for k in range(min(dt.shape[0], 25)):  # initial down axis, which the specific force then corrects
        for i in range(3):
            d[i] -= dvel[k, i]
    size = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    if size == 0.0:
        d[2], size = 1.0, 1.0
    for i in range(3):
        d[i] /= size
    flat = 0  # body axis nearest to the horizontal plane
    for i in range(1, 3):
        if abs(d[i]) < abs(d[flat]):
            flat = i
    h[flat] = 1.0
    turn[0] = change[0, 0] = change[0, 1] = 0.0
    for k in range(dt.shape[0]):
        wx, wy, wz = dtheta[k, 0] - bias[0] * dt[k], dtheta[k, 1] - bias[1] * dt[k], dtheta[k, 2] - bias[2] * dt[k]
        fx, fy, fz = dvel[k, 0], dvel[k, 1], dvel[k, 2]
        norm = np.sqrt(fx * fx + fy * fy + fz * fz)
        gain = min(dt[k] / time_constant, 0.1) / norm if norm > 0.0 else 0.0
        # directions fixed in space, resolved in a turning body: v' = v x w
        x, y, z = d[0], d[1], d[2]
        pulled[0] += gain * (y * fz - z * fy)
        pulled[1] += gain * (z * fx - x * fz)
        pulled[2] += gain * (x * fy - y * fx)
        length += dt[k]
        d[0] = x + y * wz - z * wy - gain * fx
        d[1] = y + z * wx - x * wz - gain * fy
        d[2] = z + x * wy - y * wx - gain * fz
        size = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
        for i in range(3):
            d[i] /= size
        x, y, z = h[0], h[1], h[2]
        h[0] = x + y * wz - z * wy
        h[1] = y + z * wx - x * wz
        h[2] = z + x * wy - y * wx
        along = h[0] * d[0] + h[1] * d[1] + h[2] * d[2]
        for i in range(3):
            h[i] -= along * d[i]
        size = np.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
        for i in range(3):
            h[i] /= size
        turn[k + 1] = turn[k] + wx * d[0] + wy * d[1] + wz * d[2]
        change[k + 1, 0] = change[k, 0] + fx * h[0] + fy * h[1] + fz * h[2]
        # d x h is the second level axis
        cx, cy, cz = d[1] * h[2] - d[2] * h[1], d[2] * h[0] - d[0] * h[2], d[0] * h[1] - d[1] * h[0]
        change[k + 1, 1] = change[k, 1] + fx * cx + fy * cy + fz * cz
    for i in range(3):
        bias[i] -= pulled[i] / length
