"""Output of filter states and variances: roll, pitch, heading and standard deviations."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.increments import turned

TWO_PI = 2.0 * np.pi


@njit(cache=True)
def sides(state, opposite, adjacent):  # type: ignore[no-untyped-def]
    """Fill `opposite` and `adjacent` (n, 3), whose ``arctan2`` is roll, pitch and heading of each state (n, 10).

    Groves (2013), eq. 2.25. The caller computes all arctangents at once with numpy.
    """
    for k in range(state.shape[0]):
        a, b, c, d = state[k, 6], state[k, 7], state[k, 8], state[k, 9]
        x, y = a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d)
        opposite[k, 0], adjacent[k, 0] = 2.0 * (a * b + c * d), a * a - b * b - c * c + d * d
        opposite[k, 1], adjacent[k, 1] = 2.0 * (a * c - b * d), np.sqrt(x * x + y * y)
        opposite[k, 2], adjacent[k, 2] = y, x


@njit(cache=True)
def moved(state, motion, delay_sd, out):  # type: ignore[no-untyped-def]
    """Compute the change of velocity and attitude by the sd of the delay, in `out` (9,), at a state (10,).

    `motion` (6,): body rate [rad/s] and acceleration in n [m/s^2]. The filter's velocity and attitude errors are almost
    independent of the delay error, as they refer to IMU time.
    """
    for i in range(3):
        out[i], out[3 + i] = 0.0, -delay_sd * motion[3 + i]
    x, y, z = delay_sd * motion[0], delay_sd * motion[1], delay_sd * motion[2]
    dx, dy, dz = turned(state[6], state[7], state[8], state[9], x, y, z)
    out[6], out[7], out[8] = x + dx, y + dy, z + dz


@njit(cache=True)
def add_moved(state, rows, motion, delay_sd, variance):  # type: ignore[no-untyped-def]
    """Add the squared changes from `moved` to `variance` (m, 12) of the states at `rows` (m,); `motion` (m, 6)."""
    by = np.zeros(9)
    for m in range(rows.shape[0]):
        moved(state[rows[m]], motion[m], delay_sd, by)
        for i in range(9):
            variance[m, i] += by[i] * by[i]
        variance[m, 9] += by[6] * by[7]
        variance[m, 10] += by[6] * by[8]
        variance[m, 11] += by[7] * by[8]


@njit(cache=True)
def deviations(time, known, variance, axes_sd, rph, sd):  # type: ignore[no-untyped-def]
    """Compute standard deviations from variances; wrap headings to one turn.

    ``C_hat = (I - [phi x]) C`` rotates the estimate by ``-phi`` in axes n. Errors of roll, pitch and heading follow
    from this rotation as Euler angle rates follow from an angular rate (Groves 2013, eq. 2.58).

    `time` (n,) [s]. `known` (m,): rows with known `variance` (m, 12), in order, see
    `insnav.kernels.errorstate.variances`. `axes_sd` (3,): attitude sd common to all rows [rad]. `rph` (n, 3) roll,
    pitch, heading [rad]. Filled: `sd` (n, 9), linear in time between the known rows.
    """
    n, last = time.shape[0], -1
    now, before = np.zeros(9), np.zeros(9)
    for m in range(known.shape[0]):
        row, v = known[m], variance[m]
        pitch, heading = rph[row, 1], rph[row, 2]
        sh, ch = np.sin(heading), np.cos(heading)
        sp, cp = np.sin(pitch), max(np.cos(pitch), 1e-3)
        a, b = ch / cp, sh / cp
        for i in range(6):
            before[i], now[i] = now[i], np.sqrt(max(v[i], 0.0))
        roll = a * a * v[6] + b * b * v[7] + 2.0 * a * b * v[9]
        pitch = sh * sh * v[6] + ch * ch * v[7] - 2.0 * sh * ch * v[9]
        heading = v[8] + sp * sp * roll + 2.0 * sp * (a * v[10] + b * v[11])
        before[6], now[6] = now[6], np.sqrt(max(roll, 0.0) + axes_sd[0] * axes_sd[0])
        before[7], now[7] = now[7], np.sqrt(max(pitch, 0.0) + axes_sd[1] * axes_sd[1])
        before[8], now[8] = now[8], np.sqrt(max(heading, 0.0) + axes_sd[2] * axes_sd[2])
        for k in range(last + 1, row + 1):
            share = (time[k] - time[last]) / (time[row] - time[last]) if last >= 0 else 1.0  # sd is linear in time
            for j in range(9):
                sd[k, j] = before[j] + share * (now[j] - before[j])
        last = row
    for k in range(last + 1, n):
        for j in range(9):
            sd[k, j] = now[j]
    for k in range(n):
        if rph[k, 2] < 0.0:
            rph[k, 2] += TWO_PI
        if rph[k, 2] >= TWO_PI:  # a tiny negative angle plus one turn rounds to one turn
            rph[k, 2] = 0.0


WIDEST = 26  # largest number of bytes of a cell, including its separator
LARGEST = 1e10  # the shortest text of larger numbers, and of numbers below `SMALLEST`, has an exponent
SMALLEST = 1e-6
_EXACT = 1e15  # decimal numbers of up to 15 digits all differ as doubles
_PAIRS = np.frombuffer(b"".join(b"%02d" % i for i in range(100)), np.uint8).copy()  # digits of 00 to 99


@njit(cache=True)
def rows_as_text(values, scale, places, out):  # type: ignore[no-untyped-def]
    """Write numbers (k, n) as n rows, each column rounded to `places` (k,) decimals, into bytes `out`.

    `scale` (k,): ten to the power of `places`. A value that is not finite gives an empty cell. `out` has `WIDEST` bytes
    per number.
    Returns: number of bytes; -1 if a number needs an exponent or more digits.
    """
    at, one = np.uint64(0), np.uint64(1)  # unsigned indices need no test for negative values
    ten, hundred, myriad = np.uint64(10), np.uint32(100), np.uint64(10000)
    for row in range(values.shape[1]):
        for column in range(values.shape[0]):
            value = values[column, row]
            if np.isfinite(value):
                parts = np.rint(value * scale[column])
                size = abs(parts)
                if size >= min(_EXACT, LARGEST * scale[column]) or 0.0 < size < SMALLEST * scale[column]:
                    return -1
                if parts < 0.0:
                    out[at] = 45  # minus sign
                    at += one
                number, each = np.uint64(np.int64(size)), np.uint64(np.int64(scale[column]))  # signed: one instruction
                whole = np.uint64(np.int64(size / scale[column]))  # exact, as both are integers below 2^53
                rest = number - whole * each
                count, limit = one, ten
                while whole >= limit:  # count the digits
                    count += one
                    limit *= ten
                at += count
                i = at
                while whole >= ten:  # write digits from the last
                    i -= one
                    tenth = whole // ten
                    out[i] = np.uint8(48) + np.uint8(whole - tenth * ten)
                    whole = tenth
                out[i - one] = np.uint8(48) + np.uint8(whole)
                if rest > 0:
                    out[at] = 46  # decimal point
                    odd = places[column] & one
                    if odd:
                        rest *= ten
                    i = at + places[column] - one + odd
                    while i > at + one + one:  # write four digits at a time
                        left = rest // myriad
                        four = np.uint32(rest - left * myriad)
                        two = four // hundred
                        pair, low = np.uint64(2 * two), np.uint64(2 * (four - two * hundred))
                        out[i], out[i + one] = _PAIRS[low], _PAIRS[low + one]
                        out[i - one - one], out[i - one] = _PAIRS[pair], _PAIRS[pair + one]
                        rest = left
                        i -= np.uint64(4)
                    if i > at:
                        out[i], out[i + one] = _PAIRS[rest + rest], _PAIRS[rest + rest + one]
                    at += places[column]
                    while out[at] == 48:  # drop trailing zeros
                        at -= one
                    at += one
            out[at] = 44  # comma
            at += one
        out[at - one] = 10  # line feed
    return np.int64(at)
