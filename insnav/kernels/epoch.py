"""Operations of a filter epoch before and after prediction and update, each in one kernel.

`estimated` (n,) is the state of the filter without its covariance; see `insnav.kernels.measurements`.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, at_fix_time, feed_back, less_sure, reset_transition, variances
from insnav.kernels.measurements import (
    ARM,
    BEGAN,
    CORRECTED,
    CORRECTION,
    DELAY,
    LEVER,
    MOTION,
    SQUARES,
    STATE,
    SWUNG,
    TILTED,
    TURNED,
    correct_with_arm,
    swing,
)
from insnav.kernels.smoother import keep, keep_state

# At constant speed, a delay and a forward lever arm shift the antenna alike, and velocity corrections, mostly noise,
# could separate them falsely. The velocity that makes a delay observable excludes corrections within this time [s]
SHOWN_BY_IMU = 20.0
TO_AND_FRO = 5.0  # largest ratio of the summed squares of tilt corrections to the square of their sum: beyond, noise
MOST_CORRECTED = 0.3  # largest velocity correction attributed to noise [m/s]


# Columns of a row for each fix: time, delay [s], NIS of position and velocity, use flags, innovation (predicted minus
# measured) [m], [m/s]. Then: its standard deviation, state and motion, sensor errors, their variances, and covariance
# (9, 9) at fix time
FIX_TIME, FIX_DELAY, FIX_NIS, FIX_USE, FIX_INNOVATION = 0, 1, slice(2, 4), slice(4, 6), slice(6, 12)
FIX_SD, FIX_STATE, FIX_SENSOR, FIX_VARIANCE = slice(12, 18), slice(18, 34), slice(34, 46), slice(46, 58)
FIX_COVARIANCE, FIX_WIDTH = slice(58, 139), 139


@njit(cache=True)
def least_delay_sd(estimated, doubt):  # type: ignore[no-untyped-def]
    """Return the smallest plausible standard deviation of the delay [s].

    `doubt` (2,): lower limit from the scatter of the delay between parts of the record [s]; 0: the filter's value
    applies. Then the delay by the search [s]. Its difference from the filter's delay is a lower limit, too.
    """
    return max(doubt[0], abs(estimated[DELAY] - doubt[1])) if doubt[0] > 0.0 else 0.0


@njit(cache=True)
def turn(phi, estimated):  # type: ignore[no-untyped-def]
    """Rotate the start of a transition (n, n) by the heading correction `TURNED`, then set `TURNED` to zero.

    Tilt and velocity change are fixed to the IMU axes, as are accelerometer errors. When corrections rotate the
    heading, these errors must rotate with it. Otherwise tilt and accelerometer error seem separable although only turns
    separate them (A. Barrau and S. Bonnabel, IEEE Trans. Autom. Control 62 (2017) 1797-1812: attitude and velocity
    errors in the body). Position errors come from fixes and are not rotated.
    """
    sine, cosine = np.sin(estimated[TURNED]), np.cos(estimated[TURNED])
    for first in (3, 6):
        for i in range(NAV):
            north, east = phi[i, first], phi[i, first + 1]
            phi[i, first], phi[i, first + 1] = cosine * north + sine * east, cosine * east - sine * north
    estimated[TURNED] = 0.0


@njit(cache=True)
def count_tilt(tilted, north, east):  # type: ignore[no-untyped-def]
    """Add a tilt correction [rad] to `tilted` (4,), see `TILTED`; return the part of its square that is not noise."""
    tilted[0] += north
    tilted[1] += east
    tilted[2] = max(tilted[2], tilted[0] ** 2 + tilted[1] ** 2)
    counted = min(north**2 + east**2, max(0.0, TO_AND_FRO * tilted[2] - tilted[3]))
    tilted[3] += counted
    return counted


@njit(cache=True)
def beyond_linear(squares, heading, accel):  # type: ignore[no-untyped-def]
    """Compute the variances of velocity and accelerometer bias that an extended filter neglects (second order).

    A normally distributed heading error also shortens a velocity change, by ``(1 - cos error)`` of the change. At rest,
    horizontal accelerometer bias is observed only in combination with the tilt, the vertical bias directly. When
    corrections tilt the IMU, the axis that becomes vertical falsely seems observed (A. H. Jazwinski, "Stochastic
    Processes and Filtering Theory" (1970), section 9.3).

    `squares` (3,): squared change of horizontal velocity in the span [m^2/s^2], squared tilt corrections before it
    [rad^2], and their product with squared bias corrections [m^2/s^4]. `heading`, `accel`: variances of heading and of
    all biases at the start of the span [rad^2], [m^2/s^4].
    """
    part = 0.75 * heading**2
    if heading > 1e-3:  # below this, the exact form is a small difference of large numbers
        part = 1.5 - 2.0 * np.exp(-0.5 * heading) + 0.5 * np.exp(-2.0 * heading)
    return part * squares[0], squares[1] * accel + squares[2]


@njit(cache=True)
def not_linear(q, estimated, p):  # type: ignore[no-untyped-def]
    """Add the second-order terms to the noise (n, n) of a span; `p` (n, n): covariance at its start.

    Both horizontal axes get the velocity term: across the velocity change it is small against the first-order term.
    """
    velocity, began, squares = estimated[STATE][3:5], estimated[BEGAN], estimated[SQUARES]
    squares[0] = (velocity[0] - began[0]) ** 2 + (velocity[1] - began[1]) ** 2
    known = 0.0
    for i in range(NAV + 3, NAV + 6):
        known += p[i, i]
    along, shown = beyond_linear(squares, p[8, 8], known)
    q[3, 3] += along
    q[4, 4] += along
    for i in range(NAV + 3, NAV + 6):
        q[i, i] += shown
    squares[:] = 0.0


@njit(cache=True)
def fade(estimated, fading, times, sds, phi, q, span):  # type: ignore[no-untyped-def]
    """Decay the time-correlated states over `span` (1,) [s] and apply the antenna swing, before a prediction.

    `fading` (k, 2): state and value of each time-correlated error. `times`, `sds` (k,): correlation times [s] and
    standard deviations. `phi`, `q` (n, n): transition and noise.
    """
    corrected, swung = estimated[CORRECTED], estimated[SWUNG]
    for i in range(times.shape[0]):
        kept, k = np.exp(-span[0] / times[i]), fading[i, 0]
        estimated[fading[i, 1]] *= kept
        phi[k, k], q[k, k] = kept, (1.0 - kept * kept) * sds[i] ** 2
    kept, moved = np.exp(-span[0] / SHOWN_BY_IMU), False
    for i in range(3):
        corrected[i] *= kept
        moved = moved or swung[i] != 0.0
    if moved:
        swing(phi, swung)


@njit(cache=True)
def predicted(row, time, estimated, doubt, p, phi, q, span, before):  # type: ignore[no-untyped-def]
    """Store the epoch in `row` of the history, unless `row` is empty, and begin a new span, after predicting to `time`.

    `doubt`: see `least_delay_sd`. `p` (n, n): covariance. `phi`, `q`, `span`: see `fade`. `before` (12,): filled with
    the variances, see `insnav.kernels.errorstate.variances`.
    """
    variances(less_sure(p, least_delay_sd(estimated, doubt)), estimated[STATE], before)
    if row.shape[0] > 0:
        keep(row, time, estimated[STATE], estimated[CORRECTION], estimated[ARM], phi, p)
    reset_transition(phi, q, span)
    estimated[BEGAN] = estimated[STATE][3:5]


@njit(cache=True)
def felt(estimated, rates, forces, swings, older, number, late, has_arm, stays, motion):  # type: ignore[no-untyped-def]
    """Fill `motion` (25,) of `insnav.kernels.measurements.assess` for a fix, except its noise limits.

    For each of the next k fixes, including sensor errors: `rates` (k, 3): mean body rate [rad/s]. `forces` (k, 3): mean
    specific force [m/s^2]. `swings` (k, 3): body rate at the time of the fix's velocity [rad/s]. `older` (k, 6): angle
    and velocity increment since this time [rad], [m/s]. `number`: row of the fix. `late`: age of its velocity [s].
    `has_arm`: split the body rate into its mean about the fix and an additional rate. `stays`: treat all rotation as
    noise.
    """
    correction, moving, corrected = estimated[CORRECTION], estimated[MOTION], estimated[CORRECTED]
    for i in range(3):
        bias, scale, force_scale = correction[i], 1.0 + correction[6 + i], 1.0 + correction[9 + i]
        motion[i], motion[3 + i], motion[6 + i], motion[11 + i] = moving[i], moving[3 + i], 0.0, corrected[i]
        motion[14 + i] = (forces[number, i] - correction[3 + i]) / force_scale  # corrected specific force
        motion[18 + i] = motion[21 + i] = 0.0
        if late != 0.0:  # the velocity is older than the position
            motion[i] = (swings[number, i] - bias) / scale
            motion[18 + i] = (older[number, i] - late * bias) / scale
            motion[21 + i] = (older[number, 3 + i] - late * correction[3 + i]) / force_scale
        if has_arm:
            mean = (rates[number, i] - bias) / scale
            motion[i], motion[6 + i] = mean, motion[i] - mean
        if stays:
            motion[i] = motion[6 + i] = 0.0
    motion[24] = late
    if late != 0.0:  # undo the rotation of this velocity increment by the gyro bias, on average over half of the time
        half, x, y, z = 0.5 * late, motion[21], motion[22], motion[23]
        motion[21] += half * (correction[1] * z - correction[2] * y)
        motion[22] += half * (correction[2] * x - correction[0] * z)
        motion[23] += half * (correction[0] * y - correction[1] * x)


@njit(cache=True)
def take(row, estimated, error, places, settled):  # type: ignore[no-untyped-def]
    """Subtract the estimated error (n,) from the state (closed loop) after an update, and store the state in `row`.

    `places` (k, 3): see `insnav.kernels.measurements.DELAYED`. `settled`: the delay of the fixes has been determined,
    see `insnav.kernels.measurements.correct_with_arm`.
    """
    x, correction, arm, corrected = estimated[STATE], estimated[CORRECTION], estimated[ARM], estimated[CORRECTED]
    lever = places[LEVER, 0]
    if lever >= 0 and settled:
        for i in range(3):
            corrected[i] -= x[3 + i]
        correct_with_arm(x, correction, error, lever, arm, estimated[SWUNG])
        square = 0.0
        for i in range(3):
            corrected[i] += x[3 + i]
            square += corrected[i] ** 2
        for i in range(3):
            corrected[i] *= min(1.0, MOST_CORRECTED / max(np.sqrt(square), 1e-9))
    else:
        feed_back(x, correction, error)
        for i in range(3 if lever >= 0 else 0):
            arm[i] -= error[lever + i]
    estimated[TURNED] += error[8]  # heading correction since the last epoch
    squares, tilted, accel = estimated[SQUARES], estimated[TILTED], 0.0
    for i in range(NAV + 3, NAV + 6):
        accel += error[i] ** 2
    counted = count_tilt(tilted, error[6], error[7])
    squares[1] += counted
    squares[2] += counted * accel
    for block in range(places.shape[0]):  # further states, except the lever arm, corrected above
        for i in range(places[block, 2] if block != LEVER else 0):
            estimated[places[block, 1] + i] -= error[places[block, 0] + i]
    if row.shape[0] > 0:
        keep_state(row, x, correction, arm)


@njit(cache=True)
def note_epoch(row, time, before, estimated, doubt, p):  # type: ignore[no-untyped-def]
    """Fill `row` (26,): time [s], variances before and after the measurements of an epoch, and delay [s]."""
    row[0], row[25] = time, estimated[DELAY]
    for i in range(12):
        row[1 + i] = before[i]
    variances(less_sure(p, least_delay_sd(estimated, doubt)), estimated[STATE], row[13:25])


@njit(cache=True)
def note_fix(row, time, z, sd, nis_position, nis_velocity, position, velocity, estimated, doubt, p):  # type: ignore[no-untyped-def]
    """Fill `row` (139,) of a fix: innovation (6,), its standard deviation (6,), NIS, use flags and updated state."""
    x, motion, correction = estimated[STATE], estimated[MOTION], estimated[CORRECTION]
    nis, use, state, innovation = row[FIX_NIS], row[FIX_USE], row[FIX_STATE], row[FIX_INNOVATION]
    deviation, sensor, variance = row[FIX_SD], row[FIX_SENSOR], row[FIX_VARIANCE]
    row[FIX_TIME], row[FIX_DELAY] = time, estimated[DELAY]
    nis[0], nis[1], use[0], use[1] = nis_position, nis_velocity, position, velocity
    for k in range(6):
        innovation[k], deviation[k], state[10 + k] = z[k], sd[k], motion[k]
    for k in range(10):
        state[k] = x[k]
    for k in range(SENSOR):
        sensor[k], variance[k] = correction[k], p[NAV + k, NAV + k]
    at_fix_time(less_sure(p, least_delay_sd(estimated, doubt)), x, row[FIX_COVARIANCE].reshape(NAV, NAV))
