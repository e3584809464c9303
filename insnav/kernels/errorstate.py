"""Error-state transition and process noise, accumulated along the trajectory between filter epochs.

Error = estimate - truth. States 0-8: position N, E, D [m], velocity, attitude ``C_hat = (I - [phi x]) C``. States 9-20:
gyro bias, accelerometer bias, gyro scale factor, accelerometer scale factor. Further states are constant. States 0-8
depend on states 0-20, and states 9-20 decay exponentially. A transition matrix thus has the form ``[[A, B], [0,
diag(d)]]``, and only these blocks are multiplied.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV, second_order, system_matrix
from insnav.kernels.earth import OMEGA, radii
from insnav.kernels.mechanization import quaternion_step, rotation, step, within_turn

SENSOR = 12  # number of sensor error states
STATES = NAV + SENSOR
SAME_TIME = 1e-6  # epochs closer than this count as equal [s]
SUMS = 31  # integrals over a sub-step: time, specific force (3), C_nb, C_nb diag(w), C_nb diag(f) (9 each)


class Samples(NamedTuple):
    """Increments of intervals; see `insnav.types.Increments`."""

    time: np.ndarray  # (n,) end of each interval [s]
    dt: np.ndarray  # (n,) length of each interval [s]
    dtheta: np.ndarray  # (n, 3) integral of the angular rate [rad]
    dvel: np.ndarray  # (n, 3) integral of the specific force [m/s]
    coning: np.ndarray  # (n, 3) coning correction [rad]
    sculling: np.ndarray  # (n, 3) sculling correction [m/s]
    gap: np.ndarray  # (n,) length of the data gap that contains the interval [s]; 0: the interval was measured


class Carried(NamedTuple):
    """Navigation state and integrals that `propagate` carries from interval to interval."""

    x: np.ndarray  # (10,) navigation state, see `insnav.kernels.mechanization`
    # (12,) estimated sensor errors: gyro bias [rad/s], accelerometer bias [m/s^2], gyro, accelerometer scale factor [-]
    correction: np.ndarray
    # (6,) corrected body rate of the last interval [rad/s], acceleration in n [m/s^2] smoothed over a tenth of a second
    motion: np.ndarray
    sums: np.ndarray  # (31,) integrals over the open sub-step
    span: np.ndarray  # (1,) time since the last filter epoch [s]


class Model(NamedTuple):
    """Noise model of the sensors, and limits of time."""

    # (4,) longest sub-step, longest time without a filter epoch, begin and end of the time at rest, in which horizontal
    # specific force is noise [s]
    limit: np.ndarray
    # (20,) spectral densities: gyro, accelerometer white noise, driving noise of the twelve sensor errors. Then squared
    # misalignment of gyros and accelerometers times the length of a manoeuvre [rad^2 s]
    noise: np.ndarray
    # (4,) assumed largest time derivative of rate [rad/s^2] and specific force [m/s^3] in a data gap. Interpolation
    # over a gap of length T is wrong by about T^2 times this. Then limits of the resulting angle [rad] and velocity
    # [m/s] error: a linear filter is invalid beyond
    gap: np.ndarray
    decay: np.ndarray  # (12,) inverse correlation times of the sensor errors [1/s]
    # (k, 2) growth rate of tilt and heading variance between parts of a stationary period [rad^2/s]; empty or NaN where
    # the attitude may change
    sway: np.ndarray


class Outputs(NamedTuple):
    """Rows of the solution, and the time-ordered subset of rows for which standard deviations are computed."""

    # (3,) next grid epoch [s], grid interval [s] (0: every IMU interval; -1: also with the motion), index of the next
    # `wanted` epoch
    grid: np.ndarray
    wanted: np.ndarray  # (k,) further output epochs, increasing [s]
    used: np.ndarray  # (2,) rows filled so far: of `time`, `aim`, `state`, and of `known`, `motion`
    time: np.ndarray  # (m,) time of the row [s]
    aim: np.ndarray  # (m,) requested epoch of the row [s]; NaN: none, the row has its own time
    state: np.ndarray  # (m, 10) navigation state of the row
    known: np.ndarray  # (m,) row of the solution that has standard deviations
    motion: np.ndarray  # (m, 6) motion at these rows, as in `Carried`


@inner()
def _half_of_the_noise(sums, noise, q, stays, sway):  # type: ignore[no-untyped-def]
    """Add half of a sub-step's white and driving noise: half enters before the transition, half after it."""
    half = 0.5 / sums[0]
    for i in range(3):
        for j in range(3):
            accel, gyro = 0.0, 0.0
            for k in range(3):
                c = half * sums[4 + 3 * i + k] * sums[4 + 3 * j + k]
                gyro += c * noise[k]
                accel += c * noise[3 + k]
            q[3 + i, 3 + j] += accel
            if not stays:
                q[6 + i, 6 + j] += gyro
            elif i == j:
                q[6 + i, 6 + i] += 0.5 * sums[0] * sway[i // 2]
    for j in range(SENSOR):
        q[NAV + j, NAV + j] += 0.5 * noise[6 + j] * sums[0]


@inner()
def _substep(x, sums, noise, phi, q, work, stays, sway):  # type: ignore[no-untyped-def]
    """Close a sub-step: compute its second-order transition from `sums`, and propagate `phi` and `q` by it.

    The noise enters by the trapezoid rule, ``Q <- a (Q + q/2) a' + q/2``. `work` holds the decay of the sensor errors.
    If the attitude `stays` constant, gyro errors do not change it, and its variance grows by `sway` (2,) only.
    """
    f, a, ab, d, w, y, f_n, turned_ab = work
    dt = sums[0]
    inv = 1.0 / dt
    for i in range(3):
        f_n[i] = sums[1 + i] * inv
    system_matrix(x, f_n, f)
    second_order(f, dt, a)
    # ab = [a b], the first nine rows of the transition; b = (I + F dt / 2) G dt. G dt is the effect of gyro errors on
    # attitude and of accelerometer errors on velocity.
    for i in range(NAV):
        for j in range(NAV):
            ab[i, j] = a[i, j]
        ab[i, i] += 1.0
    for i in range(6):
        for j in range(3):
            gyro, accel, gyro_scale, accel_scale = 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                turns, pushes = 0.5 * dt * f[i, 6 + k], -0.5 * dt * f[i, 3 + k]
                gyro += turns * sums[4 + 3 * k + j]
                gyro_scale += turns * sums[13 + 3 * k + j]
                accel += pushes * sums[4 + 3 * k + j]
                accel_scale += pushes * sums[22 + 3 * k + j]
            ab[i, 9 + j], ab[i, 12 + j], ab[i, 15 + j], ab[i, 18 + j] = gyro, accel, gyro_scale, accel_scale
    for i in range(3):
        for j in range(3):
            ab[3 + i, 12 + j] -= sums[4 + 3 * i + j]
            ab[3 + i, 18 + j] -= sums[22 + 3 * i + j]
            ab[6 + i, 9 + j] = sums[4 + 3 * i + j]
            ab[6 + i, 15 + j] = sums[13 + 3 * i + j]
    if stays:
        for i in range(6, NAV):
            for j in range(STATES):
                ab[i, j] = 1.0 if i == j else 0.0
    _half_of_the_noise(sums, noise, q, stays, sway)
    # through misalignment, rotation and acceleration cause errors that persist for a manoeuvre
    turned = 0.0
    for i in range(13, 22):
        turned += sums[i] * sums[i]
    turning = noise[18] * inv * turned
    pushing = noise[19] * inv * (sums[1] ** 2 + sums[2] ** 2)
    for i in range(3):
        q[3 + i, 3 + i] += pushing
        q[6 + i, 6 + i] += turning
    # Loops over whole rows, including zeros, vectorise and take a third of the time.
    # Transition: w = [a b] phi; noise: y = [a b] q, then q = y [a b]'
    for i in range(NAV):
        for j in range(STATES):
            total = 0.0
            for k in range(NAV):
                total += ab[i, k] * phi[k, j]
            w[i, j] = total
        for j in range(NAV, STATES):
            w[i, j] += ab[i, j] * phi[j, j]
        for j in range(STATES):
            total = 0.0
            for k in range(STATES):
                total += ab[i, k] * q[k, j]
            y[i, j] = total
    for i in range(NAV):
        for j in range(STATES):
            turned_ab[j, i] = ab[i, j]
    for i in range(NAV):
        for j in range(STATES):
            phi[i, j] = w[i, j]
        for j in range(NAV):
            total = 0.0
            for k in range(STATES):
                total += y[i, k] * turned_ab[k, j]
            q[i, j] = total
        for k in range(SENSOR):
            q[i, NAV + k] = q[NAV + k, i] = y[i, NAV + k] * d[k]
    for i in range(NAV):
        for j in range(i):
            q[j, i] = q[i, j]
    for k in range(SENSOR):
        phi[NAV + k, NAV + k] *= d[k]
        q[NAV + k, NAV + k] *= d[k] * d[k]
    _half_of_the_noise(sums, noise, q, stays, sway)
    for i in range(SUMS):
        sums[i] = 0.0


@njit(cache=True)
def less_sure(p, least_delay_sd):  # type: ignore[no-untyped-def]
    """Raise the standard deviation of the delay in a covariance (n, n) to `least_delay_sd` [s], with its correlations.

    The covariance conditional on the delay is unchanged (law of total covariance):
    ``P + (s^2 - P_dd) P_d P_d' / P_dd^2``.
    """
    n = p.shape[0]
    if n <= STATES or p[STATES, STATES] >= least_delay_sd * least_delay_sd:
        return p
    out, more = p.copy(), (least_delay_sd / p[STATES, STATES]) ** 2 - 1.0 / p[STATES, STATES]
    for i in range(n):
        for j in range(n):
            out[i, j] += more * p[i, STATES] * p[STATES, j]
    return out


@njit(cache=True)
def at_fix_time(p, x, out):  # type: ignore[no-untyped-def]
    """Convert a covariance `p` (n, n) from sample time to fix time, (9, 9), at state `x` (10,).

    A delay error ``dd`` moves the position along the velocity ``v``: fixes observe ``dp - v dd``.
    """
    for i in range(NAV):  # element by element: assigning slices takes seconds to compile
        for j in range(NAV):
            out[i, j] = p[i, j]
    if p.shape[0] > STATES:
        for i in range(3):
            for j in range(NAV):
                out[i, j] -= x[3 + i] * p[STATES, j]
        for i in range(NAV):
            both = p[i, STATES] - (x[3 + i] * p[STATES, STATES] if i < 3 else 0.0)
            for j in range(3):
                out[i, j] -= both * x[3 + j]


@njit(cache=True)
def variances(p, x, out):  # type: ignore[no-untyped-def]
    """Fill `out` (12,): variances as in `at_fix_time`, and attitude covariances N-E, N-D, E-D, of `p` (n, n)."""
    n = p.shape[0]
    for i in range(NAV):
        out[i] = p[i, i]
        if i < 3 and n > STATES:
            out[i] += x[3 + i] * (x[3 + i] * p[STATES, STATES] - 2.0 * p[i, STATES])
    out[9], out[10], out[11] = p[6, 7], p[6, 8], p[7, 8]


@njit(cache=True)
def propagate(  # type: ignore[no-untyped-def]
    first, last, close, time, dt, dtheta, dvel, coning, sculling, gap, x, correction, motion, sums, span, limit, noise,
    gap_noise, decay, sway, phi, q, grid, wanted, used, out_time, out_aim, out_state, known, out_motion, *work
):  # fmt: skip
    """Propagate state, transition and noise through intervals `first` to `last` - 1.

    `close`: a filter epoch follows, so end the sub-step at `last`; else it stays open for the next call. Then follow
    the fields of `Samples`, of `Carried`, which change in place, and of `Model`, one by one: passing tuples takes ten
    times as long. `phi`, `q` (n, n): transition and noise since the last epoch, changed in place. Then the fields of
    `Outputs`, to which rows are added. `work`: from `scratch`.
    Returns: first interval not processed: `last`, or earlier if the model's limit asks for a filter epoch.
    """
    begin, rest, parts = limit[2], limit[3], sway.shape[0] + 1  # stationary period and its parts
    kept, c, none = work[3], work[6], np.zeros(2)
    ig0, ig1, ig2 = 1.0 / (1.0 + correction[6]), 1.0 / (1.0 + correction[7]), 1.0 / (1.0 + correction[8])
    ia0, ia1, ia2 = 1.0 / (1.0 + correction[9]), 1.0 / (1.0 + correction[10]), 1.0 / (1.0 + correction[11])
    for k in range(first, last):
        h = dt[k]
        if h <= 0.0:
            continue
        tx = (dtheta[k, 0] - correction[0] * h) * ig0  # increments, corrected for bias and scale factor
        ty = (dtheta[k, 1] - correction[1] * h) * ig1
        tz = (dtheta[k, 2] - correction[2] * h) * ig2
        vx = (dvel[k, 0] - correction[3] * h) * ia0
        vy = (dvel[k, 1] - correction[4] * h) * ia1
        vz = (dvel[k, 2] - correction[5] * h) * ia2
        resting = time[k] <= rest  # the vehicle is stationary
        row = max(0, min(int((time[k] - begin) / (rest - begin) * parts - 0.5), parts - 2)) if resting else 0
        stays = resting and sway.shape[0] > 0 and not np.isnan(sway[row, 0])
        if stays:  # the attitude is constant relative to the Earth: the body rotates with the Earth only
            rotation(x, c)
            north, down = OMEGA * np.cos(x[0]) * h, -OMEGA * np.sin(x[0]) * h
            tx, ty, tz = c[0] * north + c[6] * down, c[1] * north + c[7] * down, c[2] * north + c[8] * down
        vn, ve, vd = x[3], x[4], x[5]
        un, ue, ud = step(x, h, tx, ty, tz, vx, vy, vz, coning, sculling, k, c, 1.0, False, 0.0, 0.0)
        sums[0] += h  # integrals over the sub-step; see `SUMS`
        sums[1] += un
        sums[2] += ue
        sums[3] += ud
        for i in range(3):
            c0, c1, c2 = c[3 * i], c[3 * i + 1], c[3 * i + 2]
            sums[4 + 3 * i] += c0 * h
            sums[5 + 3 * i] += c1 * h
            sums[6 + 3 * i] += c2 * h
            sums[13 + 3 * i] += c0 * tx
            sums[14 + 3 * i] += c1 * ty
            sums[15 + 3 * i] += c2 * tz
            sums[22 + 3 * i] += c0 * vx
            sums[23 + 3 * i] += c1 * vy
            sums[24 + 3 * i] += c2 * vz
        span[0] += h
        rate, share = 1.0 / h, min(1.0, 10.0 * h)  # share of the new acceleration in its mean over 0.1 s
        motion[0], motion[1], motion[2] = tx * rate, ty * rate, tz * rate
        motion[3] += share * ((x[3] - vn) * rate - motion[3])
        motion[4] += share * ((x[4] - ve) * rate - motion[4])
        motion[5] += share * ((x[5] - vd) * rate - motion[5])
        if gap[k] > 0.0:  # add the error of interpolation across a data gap to the noise
            for i in range(3):
                q[3 + i, 3 + i] += min(gap_noise[1] * gap[k] ** 2, gap_noise[3]) ** 2 * h / gap[k]
                q[6 + i, 6 + i] += min(gap_noise[0] * gap[k] ** 2, gap_noise[2]) ** 2 * h / gap[k]
        full = span[0] >= limit[1] - 1e-9  # the longest time without a filter epoch has passed
        ends = full or sums[0] >= limit[0] - 1e-9 or (close and k == last - 1)
        if ends:  # the sub-step ends: propagate transition and noise
            for j in range(SENSOR):  # the estimate of a time-correlated error decays like its expectation
                u = sums[0] * decay[j]
                kept[j] = 1.0 - u * (1.0 - u * (0.5 - u * (1.0 / 6.0 - u / 24.0))) if u < 5e-4 else np.exp(-u)
                correction[j] *= kept[j]
            ig0, ig1, ig2 = 1.0 / (1.0 + correction[6]), 1.0 / (1.0 + correction[7]), 1.0 / (1.0 + correction[8])
            ia0, ia1, ia2 = 1.0 / (1.0 + correction[9]), 1.0 / (1.0 + correction[10]), 1.0 / (1.0 + correction[11])
            if resting:
                sums[1] = sums[2] = 0.0  # horizontal specific force of a stationary vehicle is noise
            _substep(x, sums, noise, phi, q, work, stays, sway[row] if stays else none)
        at_all = grid[1] <= 0.0  # every interval gives a row
        while True:  # one turn for each output epoch in this interval
            further = wanted[int(grid[2])] if grid[2] < wanted.shape[0] else np.inf
            aim = min(grid[0], further)
            due = aim <= time[k] + SAME_TIME
            if not (due or at_all):
                break
            out_time[used[0]], out_aim[used[0]] = time[k], aim if due else np.nan
            for i in range(10):  # element by element: assigning slices takes seconds to compile
                out_state[used[0], i] = x[i]
            if due or ends or grid[1] < 0.0:
                known[used[1]] = used[0]
                for i in range(3):
                    out_motion[used[1], i] = motion[i]
                # acceleration of this interval: a clock error shifts vibration, too, which the mean in `motion` lacks
                out_motion[used[1], 3] = (x[3] - vn) * rate
                out_motion[used[1], 4] = (x[4] - ve) * rate
                out_motion[used[1], 5] = (x[5] - vd) * rate
                used[1] += 1
            used[0] += 1
            if due and further <= aim + SAME_TIME:
                grid[2] += 1.0
            if not due or (at_all and aim >= time[k] - SAME_TIME):
                break
            if grid[0] <= aim + SAME_TIME:  # skip further grid epochs within this interval
                grid[0] = (
                    max(np.floor((time[k] + SAME_TIME) / grid[1]), np.floor(grid[0] / grid[1] + 0.5)) + 1.0
                ) * grid[1]
        if full and not (close and k == last - 1):  # ask for a filter epoch
            return k + 1
    return last


def scratch() -> tuple[np.ndarray, ...]:
    """Return the work space of `propagate`."""
    square, wide = (NAV, NAV), (NAV, STATES)
    return tuple(np.zeros(shape) for shape in (square, square, wide, SENSOR, wide, wide, 9, (STATES, NAV)))


@njit(cache=True)
def reset_transition(phi, q, span):  # type: ignore[no-untyped-def]
    """Set `phi` to the identity, noise `q` and time `span` to zero, after a filter epoch."""
    phi[:] = 0.0
    q[:] = 0.0
    span[0] = 0.0
    for i in range(phi.shape[0]):
        phi[i, i] = 1.0


@njit(cache=True)
def feed_back(x, correction, error):  # type: ignore[no-untyped-def]
    """Subtract the estimated `error` (n,) from state `x` (10,) and `correction` (12,) of the sensors (closed loop)."""
    sin_lat = np.sin(x[0])
    rm, rn = radii(sin_lat)
    h = x[2]
    x[1] = within_turn(x[1] - error[1] / ((rn + h) * np.cos(x[0])))
    x[0] -= error[0] / (rm + h)
    x[2] += error[2]
    x[3] -= error[3]
    x[4] -= error[4]
    x[5] -= error[5]
    # C = (I + [phi x]) C_hat: the navigation-side factor of quaternion_step is q(-r)
    angle, share = np.sqrt(error[6] ** 2 + error[7] ** 2 + error[8] ** 2), 1.0
    if angle > np.pi:  # remove whole turns; a smoother that has diverged may have 1e9 of them
        share = 1.0 - 2.0 * np.pi / angle * np.floor(angle / (2.0 * np.pi) + 0.5)
    north, east, down = share * error[6], share * error[7], share * error[8]
    parts = int(abs(share) * angle / 0.05) + 1  # rotate in parts: the half-angle series is for small angles
    for _ in range(parts):
        quaternion_step(x, -north / parts, -east / parts, -down / parts, 0.0, 0.0, 0.0)
    norm = np.sqrt(x[6] ** 2 + x[7] ** 2 + x[8] ** 2 + x[9] ** 2)
    for i in range(6, 10):
        x[i] /= norm
    for i in range(SENSOR):
        correction[i] -= error[NAV + i]


@njit(cache=True)
def move_by_motion(state, rows, motion, seconds):  # type: ignore[no-untyped-def]
    """Move `rows` (m,) of the states by `seconds` (m,) at constant rate and acceleration, `motion` (m, 6), in place."""
    for m in range(rows.shape[0]):
        s, x = seconds[m], state[rows[m]]
        if abs(s) < SAME_TIME:
            continue
        rm, rn = radii(np.sin(x[0]))
        an, ae, ad = 0.5 * s * motion[m, 3], 0.5 * s * motion[m, 4], 0.5 * s * motion[m, 5]
        east_by, north_by = 1.0 / ((rn + x[2]) * np.cos(x[0])), 1.0 / (rm + x[2])
        wn, we = x[4] / (rn + x[2]), -x[3] * north_by
        north, down = OMEGA * np.cos(x[0]) + wn, -(OMEGA + x[4] * east_by) * np.sin(x[0])
        x[1] = within_turn(x[1] + s * (x[4] + ae) * east_by)
        x[0] += s * (x[3] + an) * north_by
        x[2] -= s * (x[5] + ad)
        x[3], x[4], x[5] = x[3] + 2.0 * an, x[4] + 2.0 * ae, x[5] + 2.0 * ad
        quaternion_step(x, s * north, s * we, s * down, s * motion[m, 0], s * motion[m, 1], s * motion[m, 2])


@njit(cache=True)
def move_along(state, seconds):  # type: ignore[no-untyped-def]
    """Move the position of each state along its velocity by `seconds`, (n, 10) and (n,) arrays, in place."""
    for k in range(state.shape[0]):
        s = seconds[k]
        rm, rn = radii(np.sin(state[k, 0]))
        state[k, 1] = within_turn(state[k, 1] + s * state[k, 4] / ((rn + state[k, 2]) * np.cos(state[k, 0])))
        state[k, 0] += s * state[k, 3] / (rm + state[k, 2])
        state[k, 2] -= s * state[k, 5]
