"""A filter epoch around the filter's own predict and update: what leads to each, and what follows, in a call each."""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, at_fix_time, feed_back, less_sure, reset_transition, variances
from insnav.kernels.gps_measurement import Assessment, Fix, Predicted, assess, correct_with_arm, swing
from insnav.kernels.smoother import keep, keep_state

# A delay and a lever arm ahead move the antenna alike at one speed, and noise of the velocity would tell one from the
# other: for so long a velocity is carried by the accelerometers, not corrected, before it shows a delay [s]
SHOWN_BY_IMU = 20.0
MOST_CORRECTED = 0.3  # more is no noise of the velocity [m/s]


# All that the filter estimates, in one array that changes in place, see `insnav.filter.error_model.FilterState`: a call
# with one array takes a tenth of the time of one with a tuple of as many.
STATE, CORRECTION, MOTION = slice(0, 10), slice(10, 22), slice(22, 28)
CORRECTED = slice(28, 31)  # what corrections have made of the velocity within `SHOWN_BY_IMU` [m/s]
ARM, SWUNG = slice(31, 43), slice(43, 46)  # see `insnav.kernels.gps_measurement.correct_with_arm`
SHAKEN, CLOCK = slice(46, 49), slice(49, 51)  # [m]; delay, and lag of velocities behind positions [s]
LASTING = slice(51, 57)  # time-correlated errors of fixes [m], [m/s]
TURNED = 57  # by which corrections have turned the heading since the last epoch [rad]
BEGAN = slice(58, 60)  # horizontal velocity with which the span since that began [m/s]
SQUARES = slice(60, 63)  # see `beyond_linear`
TILTED = slice(63, 67)  # by all corrections so far, North, East [rad]; the largest square, and what was counted [rad^2]
TO_AND_FRO = 5.0  # so many times the square of the largest tilt by corrections count those of all: others are noise [-]
ESTIMATED = 67
# Columns of a row for each fix: time, delay [s], NIS of position and velocity, whether they were used, innovation as
# predicted minus measured [m], [m/s], its standard deviation, state and motion, sensor errors, their variances, and
# covariance (9, 9) in the time of the fixes
FIX_TIME, FIX_DELAY, FIX_NIS, FIX_USE, FIX_INNOVATION = 0, 1, slice(2, 4), slice(4, 6), slice(6, 12)
FIX_SD, FIX_STATE, FIX_SENSOR, FIX_VARIANCE = slice(12, 18), slice(18, 34), slice(34, 46), slice(46, 58)
FIX_COVARIANCE, FIX_WIDTH = slice(58, 139), 139


@njit(cache=True)
def surest(estimated, doubt):  # type: ignore[no-untyped-def]
    """Least standard deviation of the delay that is plausible [s].

    `doubt` (2,): the least by what parts of the record show, 0: as the filter has it, and the delay that a search
    found, with which the filter may not agree so well [s].
    """
    return max(doubt[0], abs(estimated[CLOCK][0] - doubt[1])) if doubt[0] > 0.0 else 0.0


@njit(cache=True)
def turn(phi, estimated):  # type: ignore[no-untyped-def]
    """Let a transition (n, n) begin with the heading that corrections have `TURNED`, which becomes zero.

    What tilts, and what changes the velocity, is in the axes of the IMU: an error of the accelerometers stands against
    both about axes that turn with the heading as it gets known. With those of the first guess, degrees off, tilt and
    error seem known, which only turns tell apart (A. Barrau and S. Bonnabel, IEEE Trans. Autom. Control 62 (2017)
    1797-1812: errors of attitude and velocity in the body). Errors of positions are those of fixes, which do not turn.
    """
    sine, cosine = np.sin(estimated[TURNED]), np.cos(estimated[TURNED])
    for first in (3, 6):
        for i in range(NAV):
            north, east = phi[i, first], phi[i, first + 1]
            phi[i, first], phi[i, first + 1] = cosine * north + sine * east, cosine * east - sine * north
    estimated[TURNED] = 0.0


@njit(cache=True)
def count_tilt(tilted, north, east):  # type: ignore[no-untyped-def]
    """Note in `tilted` (4,), see `TILTED`, a correction of the tilt [rad]; returns what of its square counts."""
    tilted[0] += north
    tilted[1] += east
    tilted[2] = max(tilted[2], tilted[0] ** 2 + tilted[1] ** 2)
    counted = min(north**2 + east**2, max(0.0, TO_AND_FRO * tilted[2] - tilted[3]))
    tilted[3] += counted
    return counted


@njit(cache=True)
def beyond_linear(squares, heading, accel):  # type: ignore[no-untyped-def]
    """Variances of velocity and accelerometer bias by what an extended filter leaves out of second order.

    An error of the heading changes the velocity along its change, too, by ``(1 - cos error) change``: that of a
    normally distributed one. And a rest says that biases of the accelerometers stand against the tilt, and that none is
    vertical: when corrections tilt the IMU another axis is, as if it had been measured (A. H. Jazwinski, "Stochastic
    Processes and Filtering Theory" (1970), section 9.3).

    `squares` (3,): of the change of the horizontal velocity in the span [m^2/s^2], of corrections of the tilt before it
    [rad^2], as far as these count, and of these times corrections of the biases [m^2/s^4]; `heading`, `accel`:
    variances of heading and of all biases at its beginning [rad^2], [m^2/s^4].
    """
    part = 0.75 * heading**2
    if heading > 1e-3:  # below, the whole is a small difference of large numbers
        part = 1.5 - 2.0 * np.exp(-0.5 * heading) + 0.5 * np.exp(-2.0 * heading)
    return part * squares[0], squares[1] * accel + squares[2]


@njit(cache=True)
def not_linear(q, estimated, p):  # type: ignore[no-untyped-def]
    """Add to the noise (n, n) of a span what is of second order; `p` (n, n): covariance at its beginning.

    That of the velocity to both axes: across its change it is little beside what the transition has.
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
def fade(estimated, at, times, sds, phi, q, span):  # type: ignore[no-untyped-def]
    """Before a predict: what fades within `span` (1,) [s] does, and the transition begins with what has swung.

    `estimated` (67,); `at`: first state of the time-correlated errors of fixes; `times`, `sds`: their correlation times
    [s] and standard deviations, (0,) where there are none; `phi`, `q` (n, n): transition and noise.
    """
    lasting, corrected, swung = estimated[LASTING], estimated[CORRECTED], estimated[SWUNG]
    for i in range(times.shape[0]):
        kept, k = np.exp(-span[0] / times[i]), at + i
        lasting[i] *= kept
        phi[k, k], q[k, k] = kept, (1.0 - kept * kept) * sds[i] ** 2
    kept, moved = np.exp(-span[0] / SHOWN_BY_IMU), False
    for i in range(3):
        corrected[i] *= kept
        moved = moved or swung[i] != 0.0
    if moved:
        swing(phi, swung)


@njit(cache=True)
def predicted(row, time, estimated, doubt, p, phi, q, span, before):  # type: ignore[no-untyped-def]
    """After a predict to `time` [s]: note the epoch in `row` of the history, if it is not empty, and begin a new one.

    `estimated` (67,); `doubt`: see `surest`; `p` (n, n): covariance; `phi`, `q`, `span`: see `fade`; `before` (12,) is
    filled with the variances, see `insnav.kernels.errorstate.variances`.
    """
    variances(less_sure(p, surest(estimated, doubt)), estimated[STATE], before)
    if row.shape[0] > 0:
        keep(row, time, estimated[STATE], estimated[CORRECTION], estimated[ARM], phi, p)
    reset_transition(phi, q, span)
    estimated[BEGAN] = estimated[STATE][3:5]


@njit(cache=True)
def felt(estimated, rates, forces, swings, older, number, late, has_arm, stays, motion):  # type: ignore[no-untyped-def]
    """Fill `motion` (25,) of `insnav.kernels.gps_measurement.Predicted` for a fix, but for its limits of noise.

    `estimated` (67,); about each of the next fixes, sensor errors included: `rates` (k, 3) mean body rate [rad/s],
    `forces` (k, 3) mean specific force [m/s^2], `swings` (k, 3) the rate at the time of the velocity, `older` (k, 6)
    angle turned and velocity gained since then [rad], [m/s], which count where that is older; `number`: row of these;
    `late`: by how much the velocity is older [s]; `stays`: whether all turns are noise.
    """
    correction, moving, corrected = estimated[CORRECTION], estimated[MOTION], estimated[CORRECTED]
    for i in range(3):
        bias, scale, force_scale = correction[i], 1.0 + correction[6 + i], 1.0 + correction[9 + i]
        motion[i], motion[3 + i], motion[6 + i], motion[11 + i] = moving[i], moving[3 + i], 0.0, corrected[i]
        motion[14 + i] = (forces[number, i] - correction[3 + i]) / force_scale
        motion[18 + i] = motion[21 + i] = 0.0
        if late != 0.0:
            motion[i] = (swings[number, i] - bias) / scale
            motion[18 + i] = (older[number, i] - late * bias) / scale
            motion[21 + i] = (older[number, 3 + i] - late * correction[3 + i]) / force_scale
        if has_arm:
            mean = (rates[number, i] - bias) / scale
            motion[i], motion[6 + i] = mean, motion[i] - mean
        if stays:
            motion[i] = motion[6 + i] = 0.0
    motion[24] = late
    if late != 0.0:  # the gyro bias has turned the velocity gained, too
        half, x, y, z = 0.5 * late, motion[21], motion[22], motion[23]
        motion[21] += half * (correction[1] * z - correction[2] * y)
        motion[22] += half * (correction[2] * x - correction[0] * z)
        motion[23] += half * (correction[0] * y - correction[1] * x)


@njit(cache=True)
def assess_fix(  # type: ignore[no-untyped-def]
    estimated, p, motion, lla, v_n, position_sd, velocity_sd, row, own, late, jitter, share, at, z, h, r, s, sd
):
    """Assess row `row` of the fixes; see `insnav.kernels.gps_measurement.assess`, which this is with plain arrays.

    `own`: whether it has the errors of fixes; `late`: by how much its velocity is older [s]; `at` (7,):
    `insnav.filter.state_layout.Layout`, and how many time-correlated errors there are.
    """
    clock, lasting = estimated[CLOCK], estimated[LASTING][: at[6]]
    correlated, lever, shaken, lag = at[2], at[3], at[4], at[5]
    return assess(
        Predicted(estimated[STATE], motion, estimated[ARM], estimated[SHAKEN], lasting, clock[0], p),
        Fix(lla[row], v_n[row], position_sd[row], velocity_sd[row]),
        clock[1] - late if own else 0.0,
        jitter,
        share,
        correlated if own else -1,
        lever,
        shaken,
        lag if own else -1,
        Assessment(z, h, r, s, sd),
    )


@njit(cache=True)
def take(row, estimated, error, at, settled):  # type: ignore[no-untyped-def]
    """After an update: take the estimated error (n,) off the state (closed loop), and note that in `row`, see there.

    `estimated` (67,); `at`: see `assess_fix`; `settled`: how late fixes are is known, see
    `insnav.kernels.gps_measurement.correct_with_arm`.
    """
    x, correction, arm, corrected = estimated[STATE], estimated[CORRECTION], estimated[ARM], estimated[CORRECTED]
    vibrating, clock, lasting = estimated[SHAKEN], estimated[CLOCK], estimated[LASTING]
    delay, correlated, lever, shaken, lag = at[1], at[2], at[3], at[4], at[5]
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
    estimated[TURNED] += error[8]
    squares, tilted, accel = estimated[SQUARES], estimated[TILTED], 0.0
    for i in range(NAV + 3, NAV + 6):
        accel += error[i] ** 2
    counted = count_tilt(tilted, error[6], error[7])
    squares[1] += counted
    squares[2] += counted * accel
    if delay >= 0:
        clock[0] -= error[delay]
    if lag >= 0:
        clock[1] -= error[lag]
    for i in range(at[6] if correlated >= 0 else 0):
        lasting[i] -= error[correlated + i]
    for i in range(3 if shaken >= 0 else 0):
        vibrating[i] -= error[shaken + i]
    if row.shape[0] > 0:
        keep_state(row, x, correction, arm)


@njit(cache=True)
def note_epoch(row, time, before, estimated, doubt, p):  # type: ignore[no-untyped-def]
    """Fill `row` (26,): time [s], variances before and after the measurements of an epoch, delay [s]."""
    row[0], row[25] = time, estimated[CLOCK][0]
    for i in range(12):
        row[1 + i] = before[i]
    variances(less_sure(p, surest(estimated, doubt)), estimated[STATE], row[13:25])


@njit(cache=True)
def note_fix(row, time, z, sd, nis_position, nis_velocity, position, velocity, estimated, doubt, p):  # type: ignore[no-untyped-def]
    """Fill `row` (139,) of a fix: innovation (6,), its standard deviation (6,), NIS, what was used, the state after."""
    x, motion, correction = estimated[STATE], estimated[MOTION], estimated[CORRECTION]
    nis, use, state, innovation = row[FIX_NIS], row[FIX_USE], row[FIX_STATE], row[FIX_INNOVATION]
    deviation, sensor, variance = row[FIX_SD], row[FIX_SENSOR], row[FIX_VARIANCE]
    row[FIX_TIME], row[FIX_DELAY] = time, estimated[CLOCK][0]
    nis[0], nis[1], use[0], use[1] = nis_position, nis_velocity, position, velocity
    for k in range(6):
        innovation[k], deviation[k], state[10 + k] = z[k], sd[k], motion[k]
    for k in range(10):
        state[k] = x[k]
    for k in range(SENSOR):
        sensor[k], variance[k] = correction[k], p[NAV + k, NAV + k]
    at_fix_time(less_sure(p, surest(estimated, doubt)), x, row[FIX_COVARIANCE].reshape(NAV, NAV))
