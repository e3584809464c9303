"""From filter states and variances to what a user reads: roll, pitch, heading and standard deviations."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _deviations(roll_pitch_heading, v, out):  # type: ignore[no-untyped-def]
    """Standard deviations from the variances of `insnav.kernels.errorstate.predicted_variance`.

    ``C_hat = (I - [phi x]) C`` turns the estimate by ``-phi`` about n; its parts along the axes of roll, pitch and
    heading follow from their rates (Groves 2013, eq. 2.58).
    """
    pitch, heading = roll_pitch_heading[1], roll_pitch_heading[2]
    sh, ch = np.sin(heading), np.cos(heading)
    sp, cp = np.sin(pitch), max(np.cos(pitch), 1e-3)
    nn, ee, dd, ne, nd, ed = v[6], v[7], v[8], v[9], v[10], v[11]
    for i in range(6):
        out[i] = np.sqrt(max(v[i], 0.0))
    a, b = ch / cp, sh / cp
    roll = a * a * nn + b * b * ee + 2.0 * a * b * ne
    out[6] = np.sqrt(max(roll, 0.0))
    out[7] = np.sqrt(max(sh * sh * nn + ch * ch * ee - 2.0 * sh * ch * ne, 0.0))
    out[8] = np.sqrt(max(dd + sp * sp * roll + 2.0 * sp * (a * nd + b * ed), 0.0))


@njit(cache=True)
def solution(time, state, known, variance, rph, sd):  # type: ignore[no-untyped-def]
    """Attitude angles and standard deviations of a solution.

    `time` (n,) [s]; `state` (n, 16), see `insnav.kernels.mechanization`; `known` (m,): rows whose `variance` (m, 12)
    was computed, in order, see `insnav.kernels.errorstate.predicted_variance`. Filled: `rph` (n, 3) roll, pitch,
    heading [rad]; `sd` (n, 9) standard deviations, linear in time between the known rows.
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
        _deviations(rph[row], variance[m], sd[row])
        for k in range(last + 1, row):
            share = (time[k] - time[last]) / (time[row] - time[last]) if last >= 0 else 1.0
            for j in range(9):
                before = sd[last, j] if last >= 0 else 0.0
                sd[k, j] = before + share * (sd[row, j] - before)
        last = row
    for k in range(last + 1, n):
        for j in range(9):
            sd[k, j] = sd[last, j]
