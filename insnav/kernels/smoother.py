"""Fixed-interval smoother: the information of later measurements, carried backwards through the filter's epochs.

The backward pass is that of Bryson and Frazier in the discrete form of Bierman ("Fixed interval smoothing with discrete
measurements", Int. J. Control 18 (1973) 65-75): an adjoint vector and matrix instead of inverses of covariances, which
may be singular where a state is known. Errors are estimate minus truth and the loop is closed: the filter expects every
error to be zero, so the smoothed error is all that later data add.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES, at_fix_time, feed_back, less_sure
from insnav.kernels.gps_measurement import inverse

# columns of a row of the history
TIME, KIND, SOURCE, STATE, CORRECTION, ARM, RESIDUAL, NOISE = 0, 1, 2, 3, 13, 25, 37, 43
JACOBIAN = NOISE + 36
COAST, RESTART = 0, -1  # kinds; else a bit for each row of the measurement that was used
POSITION, VELOCITY = 7, 56
FIX, AIDING = 1, 2  # sources of a measurement
SHOCK = 5  # numbers of a change: see `_change`
DRAG = 60.0  # duration of the drags that are looked for [s]


def width(n: int) -> int:
    """Numbers in a row of the history of a filter with `n` states."""
    return JACOBIAN + 6 * n + NAV * STATES + (n - NAV) + n * (n + 1) // 2


@njit(cache=True)
def keep(row, time, x, correction, arm, phi, p):  # type: ignore[no-untyped-def]
    """Note a filter epoch: state (10,), sensor errors (12,) and covariance before its measurement, at `time` [s].

    `arm` (12,): see `insnav.kernels.gps_measurement.correct_with_arm`; `phi` is the transition from the epoch before;
    `row`, (width(n),), is filled.
    """
    n = p.shape[0]
    row[TIME] = time
    row[KIND] = COAST
    row[SOURCE] = 0.0
    keep_state(row, x, correction, arm)
    at = JACOBIAN + 6 * n
    for i in range(NAV):
        for j in range(STATES):
            row[at] = phi[i, j]
            at += 1
    for i in range(NAV, n):
        row[at] = phi[i, i]
        at += 1
    for i in range(n):
        for j in range(i + 1):
            row[at] = p[i, j]
            at += 1


@njit(cache=True)
def keep_state(row, x, correction, arm):  # type: ignore[no-untyped-def]
    """Note the state after the measurement."""
    for i in range(10):
        row[STATE + i] = x[i]
    for i in range(SENSOR):
        row[CORRECTION + i] = correction[i]
        row[ARM + i] = arm[i]


@njit(cache=True)
def keep_measurement(row, kind, source, z, h, r):  # type: ignore[no-untyped-def]
    """Note the measurement of an epoch: predicted minus measured, its derivative and its covariance."""
    row[KIND] = kind
    row[SOURCE] = source
    n = h.shape[1]
    for i in range(6):
        row[RESIDUAL + i] = z[i]
        for j in range(6):
            row[NOISE + 6 * i + j] = r[i, j]
        for j in range(n):
            row[JACOBIAN + n * i + j] = h[i, j]


@inner()
def _used(row, n, p, z, h, hp, chosen):  # type: ignore[no-untyped-def]
    """Measurement of an epoch by the rows that were used of it: ``z``, ``H`` and ``H P``; inverse of ``H P H' + R``.

    `row` (width(n),); `p` (n, n): covariance before it; filled from the front: `z` (6,), `h`, `hp` (6, n);
    `chosen` (6,): work space.
    Returns: inverse (m, m), of no rows at an epoch without a measurement.
    """
    m, kind = 0, int(row[KIND])
    for i in range(6):
        if kind > COAST and kind & (1 << i):
            chosen[m] = i
            m += 1
    s = np.zeros((m, m))
    for i in range(m):
        at = int(chosen[i])
        z[i] = row[RESIDUAL + at]
        for j in range(n):
            h[i, j] = row[JACOBIAN + n * at + j]
            hp[i, j] = 0.0
        for a in range(n):
            share = h[i, a]
            if share != 0.0:
                for j in range(n):
                    hp[i, j] += share * p[a, j]
        for j in range(i + 1):
            total = row[NOISE + 6 * at + int(chosen[j])]
            for a in range(n):
                total += hp[i, a] * h[j, a]
            s[i, j] = s[j, i] = total
    return inverse(s)


@inner()
def _product(a, b, rows, out):  # type: ignore[no-untyped-def]
    """First rows of the product of a matrix with a square one, of which four rows are added at a time."""
    n = b.shape[0]
    fours = n - n % 4
    for i in range(rows):
        for j in range(n):
            out[i, j] = 0.0
        for k in range(0, fours, 4):
            a0, a1, a2, a3 = a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3]
            for j in range(n):
                out[i, j] += a0 * b[k, j] + a1 * b[k + 1, j] + a2 * b[k + 2, j] + a3 * b[k + 3, j]
        for k in range(fours, n):
            for j in range(n):
                out[i, j] += a[i, k] * b[k, j]


@njit(cache=True)
def backward(  # type: ignore[no-untyped-def]
    history, n, least, adjoint, information, after, before, covariance, variance, innovations, cross, ends, shocks, late
):
    """Carry the adjoint backwards through some epochs, and find the smoothed errors there.

    `history` (m, width(n)): epochs in order of time; `least`: for `less_sure`; `adjoint` (n,), `information` (n, n):
    just after the last of these, zero at the end of the record; on return just after the epoch before the first.
    `cross` (9, n + 3), `ends` (3, 5, 3): the same of drags, zero at the end, but for the time before the first epoch in
    ``ends[0, 4, 0]`` and ``NaN`` in ``ends[1:, 4, 0]``; see `_minute`.
    Filled: `after`, `before` (m, 21): smoothed error of the filter's state after and before the measurement;
    `covariance` (m, 9, 9) of smoothed position, velocity and attitude, as in `at_fix_time`; `variance` (m, 12) of the
    smoothed sensor errors; `innovations` (m, 25): where there was a fix, predicted minus measured and the variance of
    the prediction, by the filter before it (0 to 11) and smoothed (12 to 23), and the filter's variance of the attitude
    error about Down (24); elsewhere ``NaN``; `shocks` (m, 6 * SHOCK): see `_change`, of position, velocity, attitude,
    biases of gyros and accelerometers, and a minute of drag that begins at the epoch; `late` (m, 2): twice the gain of
    a change of the delay, and the change [s], or zero without that state.
    """
    p, part, kept, lines = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((4, n))
    h, hp, weight, by = np.zeros((6, n)), np.zeros((6, n)), np.zeros((6, n)), np.zeros((6, n))
    z, pull, x, moved, rows = lines[0], lines[1], lines[2], lines[3], min(n, STATES + 1)
    for k in range(history.shape[0] - 1, -1, -1):
        row = history[k]
        at = JACOBIAN + 6 * n + NAV * STATES + n - NAV
        for i in range(n):
            for j in range(i + 1):
                p[i, j] = p[j, i] = row[at]
                at += 1
        s = _used(row, n, p, z, h, hp, pull)
        m = s.shape[0]
        # (I - K H)' on the adjoint, where K = P H' S^-1, and H' S^-1 z to it
        for i in range(m):
            pull[i] = 0.0
            for j in range(n):
                weight[i, j] = 0.0  # S^-1 H
                for a in range(m):
                    weight[i, j] += s[i, a] * h[a, j]
                pull[i] += hp[i, j] * adjoint[j]
        for j in range(n):
            for i in range(m):
                adjoint[j] -= weight[i, j] * pull[i]
        for i in range(STATES):
            total = 0.0
            for j in range(n):
                total += p[i, j] * adjoint[j]
            after[k, i] = total
        for j in range(n):
            for i in range(m):
                adjoint[j] += weight[i, j] * z[i]
        # (I - K H)' information (I - K H) + H' S^-1 H, with what is on both sides of the diagonal alike: u w' + w u',
        # where w = S^-1 H and u = (w H P information P H' + H) / 2 - H P information
        _product(hp, information, m, by)
        for a in range(m):
            for c in range(m):
                pull[c] = 0.0
                for j in range(n):
                    pull[c] += by[a, j] * hp[c, j]
            for j in range(n):
                total = h[a, j]
                for c in range(m):
                    total += pull[c] * weight[c, j]
                part[a, j] = 0.5 * total - by[a, j]
        for a in range(m):
            for i in range(n):
                left, right = part[a, i], weight[a, i]
                for j in range(n):
                    information[i, j] += left * weight[a, j] + right * part[a, j]
        for c in range(9):  # (I - K H)' on what drags have with the states
            for i in range(m):
                pull[i] = 0.0
                for j in range(n):
                    pull[i] += hp[i, j] * cross[c, j]
            for i in range(m):
                for j in range(n):
                    cross[c, j] -= weight[i, j] * pull[i]
        _product(p, information, rows, part)
        for i in range(n):
            moved[i] = 0.0  # error before the measurement
            for j in range(n):
                moved[i] += p[i, j] * adjoint[j]
        for i in range(rows):  # of what the smoother leaves, what is asked for
            for j in range(i + 1):
                if j == i or (j < NAV and not NAV <= i < STATES):
                    kept[i, j] = p[i, j]
                    for a in range(n):
                        kept[i, j] -= part[i, a] * p[j, a]
                    kept[j, i] = kept[i, j]
        for i in range(STATES):
            before[k, i] = moved[i]
        for i in range(SENSOR):
            variance[k, i] = kept[NAV + i, NAV + i]
        for i in range(10):
            x[i] = row[STATE + i]
        at_fix_time(less_sure(kept, least), x, covariance[k])
        _compare(row, n, p, information, moved, h, by, innovations[k])
        for i in range(5):
            j = 3 * i
            _change(adjoint[j : j + 3], information[j : j + 3, j : j + 3], shocks[k, SHOCK * i :])
        late[k] = 0.0
        if n > STATES and information[STATES, STATES] > 0.0:
            late[k, 1] = adjoint[STATES] / information[STATES, STATES]
            late[k, 0] = late[k, 1] * adjoint[STATES]
        _minute(row[TIME], n, cross, ends, shocks[k, SHOCK * 5 :])
        span = row[TIME] - (history[k - 1, TIME] if k > 0 else ends[0, 4, 0])
        _undragged(row, n, span, adjoint, information, cross, ends)
        _past(row, n, adjoint, information, part, moved)


@inner()
def _minute(time, n, cross, ends, out):  # type: ignore[no-untyped-def]
    """Ask for a drag that begins now and ended a minute later, if that is one of the ends, and let a new end be now.

    A drag is a state that the filter lacks: the velocity by which positions leave the track, and no velocity does.
    `cross` (9, n + 3): its information with all states and with itself; from the third and the sixth row on the
    covariance of its adjoint with that at one of two ends, half a minute apart. `ends` (3, 5, 3): its adjoint now; at
    each end adjoint, information and the time of the end.
    """
    by, block = np.zeros(3), np.zeros((3, 4))[:, :3]  # in memory as parts of `information`: one compiled function
    out[:] = np.nan
    for e in range(2):
        end, at = ends[1 + e], 3 + 3 * e
        if time <= end[4, 0] - DRAG:
            for i in range(3):
                by[i] = ends[0, 0, i] - end[0, i]
                for j in range(3):
                    block[i, j] = cross[i, n + j] + end[1 + i, j] - cross[at + i, n + j] - cross[at + j, n + i]
            _change(by, block, out)
            end[4, 0] = np.nan
        if np.isnan(end[4, 0]) and not ends[2 - e, 4, 0] < time + 0.5 * DRAG:
            end[4, 0] = time
            for i in range(3):
                end[0, i] = ends[0, 0, i]
                for j in range(3):
                    end[1 + i, j] = cross[i, n + j]
                for j in range(n + 3):
                    cross[at + i, j] = cross[i, j]


@inner()
def _undragged(row, n, span, adjoint, information, cross, ends):  # type: ignore[no-untyped-def]
    """Carry what `_minute` needs to the epoch before, a `span` in which positions are dragged [s]."""
    first, at = JACOBIAN + 6 * n, JACOBIAN + 6 * n + NAV * STATES - NAV
    for i in range(3):
        ends[0, 0, i] += span * adjoint[i]
        for j in range(3):
            cross[i, n + j] += span * (cross[i, j] + cross[j, i]) + span * span * information[i, j]
            cross[3 + i, n + j] += span * cross[3 + i, j]
            cross[6 + i, n + j] += span * cross[6 + i, j]
    moved = np.zeros(n)
    for c in range(9):
        for j in range(n if c < 3 else 0):
            cross[c, j] += span * information[c, j]
        for j in range(n):
            moved[j] = cross[c, j] * row[at + j] if j >= NAV else 0.0
        for j in range(STATES):
            for i in range(NAV):
                moved[j] += row[first + i * STATES + j] * cross[c, i]
        for j in range(n):
            cross[c, j] = moved[j]
    if int(row[KIND]) == RESTART:
        for i in range(3):
            ends[0, 0, i] = 0.0
        ends[1, 4, 0] = ends[2, 4, 0] = np.nan
        for c in range(9):
            for j in range(n + 3):
                cross[c, j] = 0.0


@inner()
def _change(by, information, out):  # type: ignore[no-untyped-def]
    """Change of three states that explains all later innovations best, and how much better.

    `by` (3,), `information` (3, 3): derivative of the log-likelihood by the change, and its variance.
    `out` (SHOCK,) or more: twice the gain of the log-likelihood, chi-square distributed with three degrees of freedom
    where nothing changed, the change, and the larger standard deviation of its first two parts; ``NaN`` where later
    measurements do not tell.
    """
    out[:SHOCK] = np.nan
    a, b, c = information[0, 0], information[1, 1], information[2, 2]
    d, e, f = information[0, 1], information[0, 2], information[1, 2]
    det = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    if not det > 1e-12 * a * b * c > 0.0:
        return
    own = (b * c - f * f) / det, (a * c - e * e) / det, (a * b - d * d) / det
    de, df, ef = (e * f - d * c) / det, (d * f - b * e) / det, (d * e - a * f) / det
    out[1] = own[0] * by[0] + de * by[1] + df * by[2]
    out[2] = de * by[0] + own[1] * by[1] + ef * by[2]
    out[3] = df * by[0] + ef * by[1] + own[2] * by[2]
    out[0] = out[1] * by[0] + out[2] * by[1] + out[3] * by[2]
    out[4] = np.sqrt(max(own[0], own[1]))


@inner()
def _past(row, n, adjoint, information, part, moved):  # type: ignore[no-untyped-def]
    """Carry adjoint and information to the epoch before; `part` (n, n), `moved` (n,): work space."""
    rest = 0.0 if int(row[KIND]) == RESTART else 1.0  # later measurements say nothing of states before a reset
    first, at = JACOBIAN + 6 * n, JACOBIAN + 6 * n + NAV * STATES - NAV
    # phi = [[A, B], [0, diag(d)]]: information phi, then phi' of that
    for i in range(n):
        for j in range(STATES):
            total = 0.0
            for k in range(NAV):
                total += information[i, k] * row[first + k * STATES + j]
            part[i, j] = total
        for j in range(NAV, n):
            part[i, j] = information[i, j] * row[at + j] + (part[i, j] if j < STATES else 0.0)
        moved[i] = adjoint[i] * row[at + i] if i >= NAV else 0.0
    for k in range(NAV):
        for j in range(STATES):
            moved[j] += row[first + k * STATES + j] * adjoint[k]
    for i in range(n):
        adjoint[i] = rest * moved[i]
        for j in range(n):
            information[i, j] = row[at + i] * part[i, j] if i >= NAV else 0.0
        for j in range(n if i < STATES else 0):
            total = information[i, j]
            for k in range(NAV):
                total += row[first + k * STATES + i] * part[k, j]
            information[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            information[i, j] *= rest
            information[j, i] = information[i, j]


@inner()
def _compare(row, n, p, information, error, hp, by, out):  # type: ignore[no-untyped-def]
    """Innovation of a fix, accepted or not, against filter and smoother; `hp`, `by` (6, n): work space."""
    if row[SOURCE] != FIX:
        for i in range(25):
            out[i] = np.nan
        return
    for i in range(6):
        for j in range(n):
            hp[i, j] = 0.0
        for a in range(n):
            share = row[JACOBIAN + n * i + a]
            if share != 0.0:
                for j in range(n):
                    hp[i, j] += share * p[a, j]
    _product(hp, information, hp.shape[0], by)  # not by a constant: for each there would be a compiled function
    for i in range(6):
        shift, before, told = 0.0, 0.0, 0.0
        for j in range(n):
            h = row[JACOBIAN + n * i + j]
            shift += h * error[j]
            before += h * hp[i, j]
            told += by[i, j] * hp[i, j]
        out[i], out[6 + i] = row[RESIDUAL + i], before
        out[12 + i], out[18 + i] = row[RESIDUAL + i] - shift, before - told
    out[24] = p[8, 8]


@njit(cache=True)
def correct(time, state, epoch, after, before):  # type: ignore[no-untyped-def]
    """Correct the filter's states by the smoothed errors, between epochs as well.

    Between two epochs the error is smooth: its position follows the cubic that its position and velocity at both ends
    determine, all else a straight line.

    `time` (n,) [s], `state` (n, 10): filter's states, after the measurement where there was one, changed in place;
    `epoch` (m,): times of the epochs [s]; `after`, `before`: from `backward`.
    """
    m, k, end = epoch.shape[0], 0, epoch.shape[0]
    while k + 1 < end:  # numpy's search takes as long to be compiled as all else here
        middle = (k + end) // 2
        if epoch[middle] < time[0]:
            k = middle
        else:
            end = middle
    error, unused = np.zeros(STATES), np.zeros(SENSOR)
    for row in range(time.shape[0]):
        t = time[row]
        while k + 1 < m and epoch[k + 1] <= t + 1e-6:
            k += 1
        if t < epoch[k] - 1e-6 or (k + 1 == m and t > epoch[k] + 1e-6):
            continue  # no epoch before or after it
        span = epoch[k + 1] - epoch[k] if t > epoch[k] + 1e-6 else 0.0
        for i in range(NAV):
            error[i] = after[k, i]
        if span > 0.0:
            share = (t - epoch[k]) / span
            rest, blend = 1.0 - share, share * share * (3.0 - 2.0 * share)
            for i in range(3):
                bend = rest * after[k, 3 + i] - share * before[k + 1, 3 + i]
                error[i] = (1.0 - blend) * after[k, i] + blend * before[k + 1, i] + span * share * rest * bend
            for i in range(3, NAV):
                error[i] = rest * after[k, i] + share * before[k + 1, i]
        feed_back(state[row], unused, error)
