"""From filter states and variances to what a user reads: roll, pitch, heading and standard deviations."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.increments import turned


@njit(cache=True)
def _deviations(roll_pitch_heading, state, v, delay_sd, out):  # type: ignore[no-untyped-def]
    """Standard deviations from the variances of `insnav.kernels.errorstate.predicted_variance`.

    ``C_hat = (I - [phi x]) C`` turns the estimate by ``-phi`` about n; its parts along the axes of roll, pitch and
    heading follow from their rates (Groves 2013, eq. 2.58). The clock adds what `moved` says.
    """
    moved(state, delay_sd, out)
    mn, me, md = out[6], out[7], out[8]
    pitch, heading = roll_pitch_heading[1], roll_pitch_heading[2]
    sh, ch = np.sin(heading), np.cos(heading)
    sp, cp = np.sin(pitch), max(np.cos(pitch), 1e-3)
    nn, ee, dd = v[6] + mn * mn, v[7] + me * me, v[8] + md * md
    ne, nd, ed = v[9] + mn * me, v[10] + mn * md, v[11] + me * md
    for i in range(6):
        out[i] = np.sqrt(max(v[i] + out[i] * out[i], 0.0))
    a, b = ch / cp, sh / cp
    roll = a * a * nn + b * b * ee + 2.0 * a * b * ne
    out[6] = np.sqrt(max(roll, 0.0))
    out[7] = np.sqrt(max(sh * sh * nn + ch * ch * ee - 2.0 * sh * ch * ne, 0.0))
    out[8] = np.sqrt(max(dd + sp * sp * roll + 2.0 * sp * (a * nd + b * ed), 0.0))


@njit(cache=True)
def moved(state, delay_sd, out):  # type: ignore[no-untyped-def]
    """What the error of the clock makes of velocity and attitude in a state with its motion (16,): `out` (9,).

    Their own errors hardly know of it: gyros and accelerometers turn and push in the time of the samples.
    """
    q = state[6:10]
    for i in range(3):
        out[i], out[3 + i] = 0.0, -delay_sd * state[13 + i]
    x, y, z = delay_sd * state[10], delay_sd * state[11], delay_sd * state[12]
    dx, dy, dz = turned(q[0], q[1], q[2], q[3], x, y, z)
    out[6], out[7], out[8] = x + dx, y + dy, z + dz


@njit(cache=True)
def solution(time, state, known, variance, delay_sd, axes_sd, rph, sd):  # type: ignore[no-untyped-def]
    """Attitude angles and standard deviations of a solution.

    `time` (n,) [s]; `state` (n, 16), see `insnav.kernels.mechanization`; `known` (m,): rows whose `variance` (m, 12)
    was computed, in order, see `insnav.kernels.errorstate.predicted_variance`; `delay_sd`: of the clock [s];
    `axes_sd` (3,): of what all attitudes have in common [rad]. Filled: `rph` (n, 3) roll, pitch, heading [rad]; `sd`
    (n, 9) standard deviations, linear in time between the known rows.
    """
    n = time.shape[0]
    for k in range(n):
        a, b, c, d = state[k, 6], state[k, 7], state[k, 8], state[k, 9]
        x, y = a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d)
        rph[k, 0] = np.arctan2(2.0 * (a * b + c * d), a * a - b * b - c * c + d * d)
        rph[k, 1] = np.arctan2(2.0 * (a * c - b * d), np.sqrt(x * x + y * y))
        heading = np.arctan2(y, x)
        if heading < 0.0:
            heading += 2.0 * np.pi
        rph[k, 2] = 0.0 if heading >= 2.0 * np.pi else heading
    last = -1
    for m in range(known.shape[0]):
        row = known[m]
        _deviations(rph[row], state[row], variance[m], delay_sd, sd[row])
        for k in range(last + 1, row):
            share = (time[k] - time[last]) / (time[row] - time[last]) if last >= 0 else 1.0
            for j in range(9):
                before = sd[last, j] if last >= 0 else 0.0
                sd[k, j] = before + share * (sd[row, j] - before)
        last = row
    for k in range(last + 1, n):
        for j in range(9):
            sd[k, j] = sd[last, j]
    for k in range(n):
        for j in range(3):
            sd[k, 6 + j] = np.hypot(sd[k, 6 + j], axes_sd[j])
