"""Error budgets: each source propagated alone through linear error dynamics, and free-inertial runs with errors.

Error = estimate - truth; `insnav.kernels.dynamics` defines the nine states.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV, second_order, system_matrix
from insnav.kernels.mechanization import step

WIDTH = NAV + 1  # states: the navigation errors, and the process that causes them


@inner()
def _transition(x, f_n, dt, hold, f, a):  # type: ignore[no-untyped-def]
    """Compute the transition ``a = I + F dt + (F dt)^2 / 2``; height-constrained errors stay zero."""
    system_matrix(x, f_n, f)
    second_order(f, dt, a)
    for i in range(NAV):
        a[i, i] += 1.0
    if hold:
        for j in range(NAV):
            a[2, j] = a[5, j] = 0.0


@inner()
def _entering(f, dt, hold, given, out):  # type: ignore[no-untyped-def]
    """Compute the error at the end of a step by a disturbance u, integrated over the step: ``(I + F dt / 2) u``."""
    for i in range(3):  # `given`: attitude, velocity, position; `out`: order of the states
        out[i], out[3 + i], out[6 + i] = given[6 + i], given[3 + i], given[i]
    for i in range(NAV):
        total = 0.0
        for k in range(3):
            total += f[i, 3 + k] * given[3 + k] + f[i, 6 + k] * given[k]
        out[i] += 0.5 * dt * total
    if hold:
        out[2] = out[5] = 0.0


@njit(cache=True)
def sensitivities(x, f_n, dt, given, state, hold, rows, out):  # type: ignore[no-untyped-def]
    """Propagate the errors that a constant times a known disturbance causes.

    `x` (m, 10): navigation state in the middle of each step. `f_n` (m, 3): mean specific force in n [m/s^2]. `dt` (m,):
    steps [s]. `given` (m, s, 9): disturbance of each of s sources, integrated over the step: attitude [rad], velocity
    [m/s], position [m]. `state` (s, 9): errors at the start; changed. `hold`: no error in the vertical channel. `rows`
    (r,) int: steps after which errors are stored, increasing. `out` (r, s, 9): errors there.
    """
    f, a, b, w = np.empty((NAV, NAV)), np.empty((NAV, NAV)), np.empty(NAV), np.empty(NAV)
    row = 0
    for k in range(dt.shape[0]):
        _transition(x[k], f_n[k], dt[k], hold, f, a)
        for s in range(state.shape[0]):
            _entering(f, dt[k], hold, given[k, s], b)
            for i in range(NAV):
                total = b[i]
                for j in range(NAV):
                    total += a[i, j] * state[s, j]
                w[i] = total
            for i in range(NAV):
                state[s, i] = w[i]
        if row < rows.shape[0] and k + 1 == rows[row]:
            for s in range(state.shape[0]):
                for i in range(NAV):
                    out[row, s, i] = state[s, i]
            row += 1


@inner()
def _half(p, b, white, drive, dt):  # type: ignore[no-untyped-def]
    """Add half of the noise of a step: half enters before the transition, half after it."""
    for i in range(NAV):
        share = 0.5 * white / dt * b[i]
        for j in range(NAV):
            p[i, j] += share * b[j]
    p[NAV, NAV] += 0.5 * drive * dt


@njit(cache=True)
def noises(x, f_n, dt, given, axis, white, drive, decay, first, hold, rows, out):  # type: ignore[no-untyped-def]
    """Propagate the covariance of each noise alone: white noise, or a process driven by white noise.

    `x`, `f_n`, `dt`, `hold`, `rows`: see `sensitivities`. `given` (m, c, 9): disturbance by a unit error in each of c
    channels. `axis` (s,) int: channel of each noise. `white`, `drive` (s,): spectral density of the noise, and of the
    driving noise. `decay`, `first` (s,): inverse correlation time [1/s], initial variance. `out` (r, s, 9, 9):
    covariances.
    """
    n = axis.shape[0]
    f, a = np.empty((NAV, NAV)), np.empty((NAV, NAV))
    b, c = np.empty((given.shape[1], NAV)), np.empty((given.shape[1], NAV))
    p, w = np.zeros((n, WIDTH, WIDTH)), np.empty((WIDTH, WIDTH))
    for s in range(n):
        p[s, NAV, NAV] = first[s]
    row = 0
    for k in range(dt.shape[0]):
        _transition(x[k], f_n[k], dt[k], hold, f, a)
        for i in range(given.shape[1]):
            _entering(f, dt[k], hold, given[k, i], b[i])
            for j in range(3):
                c[i, j], c[i, 3 + j], c[i, 6 + j] = given[k, i, 6 + j], given[k, i, 3 + j], given[k, i, j]
            if hold:
                c[i, 2] = c[i, 5] = 0.0
        for s in range(n):
            q, u = p[s], b[axis[s]]
            gone = dt[k] * decay[s]
            d = np.exp(-gone)
            g = -np.expm1(-gone) / gone if gone > 0.0 else 1.0  # mean over the step of a process that decays from 1
            _half(q, c[axis[s]], white[s], drive[s], dt[k])
            for i in range(NAV):
                for j in range(WIDTH):
                    w[i, j] = g * u[i] * q[NAV, j]
                for m in range(NAV):
                    share = a[i, m]
                    if share != 0.0:
                        for j in range(WIDTH):
                            w[i, j] += share * q[m, j]
            for j in range(WIDTH):
                w[NAV, j] = d * q[NAV, j]
            for i in range(WIDTH):
                for j in range(NAV):
                    total = w[i, NAV] * g * u[j]
                    for m in range(NAV):
                        total += w[i, m] * a[j, m]
                    q[i, j] = total
                q[i, NAV] = w[i, NAV] * d
            _half(q, c[axis[s]], white[s], drive[s], dt[k])
        if row < rows.shape[0] and k + 1 == rows[row]:
            for s in range(n):
                for i in range(NAV):
                    for j in range(NAV):
                        out[row, s, i, j] = p[s, i, j]
            row += 1


@njit(cache=True)
def corrupted_run(  # type: ignore[no-untyped-def]
    rng,
    x,
    dt,
    rate,
    force,
    coning,
    sculling,
    more,
    bias,
    matrix,
    bend,
    g_sensitivity,
    noise,
    drift,
    decay,
    walk,
    gravity,
    hold,
    height,
    v_down,
    rows,
    out,
):
    """Simulate the IMU samples of a motion with errors, and navigate with them.

    `rng`: for noise and in-run bias. `x` (10,): initial state including its errors, see `insnav.kernels.mechanization`;
    changed. `dt` (n,): sample intervals [s]. `rate`, `force` (n, 3): true means of each sample [rad/s], [m/s^2].
    `coning`, `sculling` (n, 3): of the true samples (the errors change these in second order only). `more` (n, 6):
    further given errors of gyros and accelerometers, or (0, 6). `bias` (6,): of gyros and accelerometers. `matrix` (2,
    3, 3): sensitivities, near the identity. `bend` (2, 2, 3): asymmetry and quadratic non-linearity. `g_sensitivity`
    (3, 3): rate by specific force. `noise`, `drift`, `walk` (6,): root density of white noise, standard deviation of
    the Gauss-Markov process, root density of the random walk's driving noise. `decay` (2,): inverse correlation times
    of gyros and accelerometers [1/s]. `gravity` (3,): error of the gravity model, North, East, Down [m/s^2]. `hold`:
    constrain the vertical channel to `height` (n,) [m] and `v_down` (n,) [m/s]. `rows` (r,) int: samples after which
    the state is stored, increasing. `out` (r, 10): states there.
    """
    wandering, walking = np.empty(6), np.zeros(6)  # in-run bias: Gauss-Markov process and random walk
    for i in range(6):
        wandering[i] = drift[i] * rng.standard_normal() if drift[i] > 0.0 else 0.0
    y, c = np.empty(6), np.empty(9)
    fade, kick = np.empty(2), np.empty(2)
    row, last, root = 0, 0.0, 0.0
    for k in range(dt.shape[0]):
        h = dt[k]
        if h != last:
            last, root = h, np.sqrt(h)
            for sensor in range(2):
                fade[sensor] = np.exp(-h * decay[sensor])
                kick[sensor] = np.sqrt(-np.expm1(-2.0 * h * decay[sensor]))
        for sensor in range(2):
            for i in range(3):
                m = matrix[sensor, i]
                if sensor == 0:
                    z = m[0] * rate[k, 0] + m[1] * rate[k, 1] + m[2] * rate[k, 2]
                else:
                    z = m[0] * force[k, 0] + m[1] * force[k, 1] + m[2] * force[k, 2]
                y[3 * sensor + i] = z + bend[sensor, 0, i] * abs(z) + bend[sensor, 1, i] * z * z  # non-linearity
        for i in range(3):
            g = g_sensitivity[i]
            y[i] += g[0] * force[k, 0] + g[1] * force[k, 1] + g[2] * force[k, 2]
        for i in range(6):
            if drift[i] > 0.0 and k > 0:
                sensor = i // 3
                wandering[i] = fade[sensor] * wandering[i] + kick[sensor] * drift[i] * rng.standard_normal()
            if walk[i] > 0.0:
                walking[i] += walk[i] * root * rng.standard_normal()
            y[i] += bias[i] + wandering[i] + walking[i]
            if noise[i] > 0.0:
                y[i] += noise[i] / root * rng.standard_normal()
        if more.shape[0] > 0:
            for i in range(6):
                y[i] += more[k, i]
        # add half of the gravity error before the step, and half after it
        x[3] += 0.5 * h * gravity[0]
        x[4] += 0.5 * h * gravity[1]
        if not hold:
            x[5] += 0.5 * h * gravity[2]
        for i in range(6):
            y[i] *= h  # convert rates to increments
        held, down = height[k], v_down[k]
        step(x, h, y[0], y[1], y[2], y[3], y[4], y[5], coning, sculling, k, c, 1.0, hold, held, down)
        x[3] += 0.5 * h * gravity[0]
        x[4] += 0.5 * h * gravity[1]
        if not hold:
            x[5] += 0.5 * h * gravity[2]
        if row < rows.shape[0] and k + 1 == rows[row]:
            for i in range(10):
                out[row, i] = x[i]
            row += 1


@njit(cache=True)
def first_order(drive, decay):  # type: ignore[no-untyped-def]
    """Compute a first-order process (n, 3): the previous value times `decay`, plus the next row of `drive` (n, 3)."""
    process = drive.copy()
    for k in range(1, drive.shape[0]):
        for axis in range(drive.shape[1]):
            process[k, axis] += decay * process[k - 1, axis]
    return process


@inner()
def _answer(since, rate, given, velocity, position, out):  # type: ignore[no-untyped-def]
    """Compute errors some time after a pulse of attitude, velocity and position.

    `since`: time since the pulse [s]. `rate`: Schuler rate [rad/s]. `given` (9,): the pulse. `velocity`, `position`
    (3,): first and second integral of the specific force since the pulse.
    """
    x = rate * since
    once = twice = thrice = 1.0  # short form, without the Schuler loop
    if x > 1e-4:
        once, twice, thrice = np.cos(x), np.sin(x) / x, 2.0 * (1.0 - np.cos(x)) / (x * x)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if i == 2:
            once = twice = thrice = 1.0
        tilted = velocity[j] * given[k] - velocity[k] * given[j], position[j] * given[k] - position[k] * given[j]
        out[i] = thrice * tilted[1] + twice * since * given[3 + i] + given[6 + i]
        out[3 + i] = twice * tilted[0] + once * given[3 + i]
        out[6 + i] = once * given[i]


@njit(cache=True)
def noise_variances(  # type: ignore[no-untyped-def]
    dt, velocity, position, given, rate, rows, white, drive, first, fade, gained, alone, out
):
    """Compute the variances of navigation errors by white noise, random walks and Gauss-Markov processes.

    The sum over steps runs backwards from each row. `h` is the error at the row by a pulse in the step. The sum of `h`,
    `integral`, is the response to a random walk. `correlated` is the response to a Gauss-Markov process from the next
    step on.

    `dt` (m,): steps [s]. `velocity`, `position` (m + 1, 3): first and second integral of the specific force, North,
    East, Down, at the edges of the steps. `given` (m, 9): rate of attitude, velocity and position errors per unit of
    the noise. `rate` (r,): Schuler rate at each row, zero for short forms [rad/s]. `rows` (r,) int: steps after which
    the variances are stored. `white`, `drive`, `first` (p,), per process: density of its white part, density of its
    random walk, variance of its Gauss-Markov part. `fade`, `gained`, `alone` (m, p): decay of a Gauss-Markov process
    over a step, its integral, and variance of the integrated process for unit variance. `out` (r, 9):
    variances of position [m^2], velocity [m^2/s^2] and attitude [rad^2].
    """
    h, moved, placed = np.empty(9), np.empty(3), np.empty(3)
    for r in range(rows.shape[0]):
        out[r] = 0.0
        integral, correlated = np.zeros(9), np.zeros((white.shape[0], 9))
        end, since = rows[r], 0.0
        for k in range(end - 1, -1, -1):
            since += 0.5 * dt[k]
            for i in range(3):
                middle = 0.5 * (velocity[k, i] + velocity[k + 1, i])
                # means over the step of velocity, and of position plus velocity times the remaining time
                at = 0.5 * (position[k, i] + position[k + 1, i]) - dt[k] * (velocity[k + 1, i] - velocity[k, i]) / 6.0
                moved[i] = velocity[end, i] - middle
                placed[i] = position[end, i] - at - since * middle
            _answer(since, rate[r], given[k], moved, placed, h)
            for p in range(white.shape[0]):
                for i in range(9):
                    total = white[p] * dt[k] * h[i] * h[i]
                    if drive[p] > 0.0:
                        a = integral[i] + h[i] * dt[k]
                        total += drive[p] * dt[k] * (integral[i] * integral[i] + integral[i] * a + a * a) / 3.0
                    if first[p] > 0.0:
                        total += first[p] * h[i] * (alone[k, p] * h[i] + 2.0 * gained[k, p] * correlated[p, i])
                        correlated[p, i] = fade[k, p] * correlated[p, i] + gained[k, p] * h[i]
                    out[r, i] += total
            for i in range(9):
                integral[i] += h[i] * dt[k]
            since += 0.5 * dt[k]
