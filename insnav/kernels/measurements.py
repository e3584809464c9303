"""Measurements of the filter: fixes of a receiver, vehicle velocity, stops and heading."""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit
from insnav.kernels.dynamics import NAV
from insnav.kernels.earth import OMEGA, gravity_down, radii
from insnav.kernels.errorstate import STATES, feed_back
from insnav.kernels.mechanization import rotation

STILL = 4.0  # a squared velocity below this multiple of its error variance may be zero, and makes no delay observable
NOT_FINITE, NEGATIVE = 1, 2  # faults of a covariance, see `fault_of`
LARGEST_TURN = 0.35  # largest norm of the summed corrections [1]: beyond alignment errors, the sum is drift

# Everything that the filter estimates, in one array (n,) that changes in place; see
# `insnav.filter.error_model.FilterState`. A call with one array takes a tenth of the time of a call with a tuple.
STATE, CORRECTION, MOTION = slice(0, 10), slice(10, 22), slice(22, 28)
CORRECTED = slice(28, 31)  # velocity corrections within `insnav.kernels.epoch.SHOWN_BY_IMU` [m/s]
ARM, SWUNG = slice(31, 43), slice(43, 46)  # lever arm and antenna motion, see `correct_with_arm`
TURNED = 46  # heading change by corrections since the last epoch [rad]
BEGAN = slice(47, 49)  # horizontal velocity at the start of the span since the last epoch [m/s]
SQUARES = slice(49, 52)  # squares for second-order noise, see `insnav.kernels.epoch.beyond_linear`
TILTED = slice(52, 56)  # sum of tilt corrections N, E [rad]; its largest square, and the squares counted [rad^2]
FURTHER = 56  # index of the first value of the further blocks
# rows of a table `places` (k, 3), one per further block: first state (-1: known), first value, number of states
DELAYED, CORRELATED, LEVER, SWINGING, LAGGED = range(5)
DELAY, LASTING = 56, slice(57, 63)  # delay [s]; time-correlated errors of fixes [m], [m/s]
SHAKEN, LAG = slice(63, 66), 66  # arm by which vibration moves the antenna [m]; lag of velocities behind positions [s]


@inner()
def crossed(matrix, vector, row, at, out):  # type: ignore[no-untyped-def]
    """Write ``matrix [vector x]``, (3, 3), into `out` at `row` and column `at`."""
    for i in range(3):
        out[row + i, at] = matrix[i, 1] * vector[2] - matrix[i, 2] * vector[1]
        out[row + i, at + 1] = matrix[i, 2] * vector[0] - matrix[i, 0] * vector[2]
        out[row + i, at + 2] = matrix[i, 0] * vector[1] - matrix[i, 1] * vector[0]


@inner()
def _before(c, turn, earlier):  # type: ignore[no-untyped-def]
    """Compute ``C_nb`` (3, 3) before a small `turn` (3,) [rad], to second order."""
    once, twice = np.zeros((3, 3)), np.zeros((3, 3))
    crossed(c, turn, 0, 0, once)
    crossed(once, turn, 0, 0, twice)
    for i in range(3):  # computed element by element: sums of arrays take long to compile
        for j in range(3):
            earlier[i, j] = c[i, j] - once[i, j] + 0.5 * twice[i, j]


@njit(cache=True)
def antenna(x, motion, older, lever, delay, lag, lla, v_n, z, h):  # type: ignore[no-untyped-def]
    """Compute predicted minus measured antenna position and velocity, and their derivatives by the error states.

    `x` (10,): state. `motion` (6,): body rate [rad/s] and acceleration in n [m/s^2] at the time of the velocity.
    `older` (7,): rotation [rad] and velocity increment by specific force [m/s] since this time, body axes, and age of
    the velocity [s]. `lever` (3,): antenna relative to the IMU, body axes [m]. `delay`: age of the fix, beyond the
    delay already contained in its time [s]. `lag`: further age of its velocity [s]. `lla` (3,), `v_n` (3,): measured;
    velocity may be ``NaN``. Filled: `z` (6,), position N, E, D [m], velocity N, E, D [m/s]; `h` (6, n), whose column 21
    is the delay [s].
    Lever arm: Groves (2013), section 14.3.1, with errors as estimate minus truth.
    """
    c, earlier, turning = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    rotation(x, c.reshape(9))
    _before(c, older[:3], earlier)
    crossed(earlier, motion, 0, 0, turning)
    arm, swing, moved, felt, unity = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            arm[i] += c[i, j] * lever[j]
            swing[i] += turning[i, j] * lever[j]
            moved[i] -= c[i, j] * older[3 + j]
    sin_lat, cos_lat = np.sin(x[0]), np.cos(x[0])
    # subtract the Earth rate: velocity is relative to the rotating Earth
    en, ed = OMEGA * cos_lat, -OMEGA * sin_lat
    swing[0] += ed * arm[1]
    swing[1] += en * arm[2] - ed * arm[0]
    swing[2] -= en * arm[1]

    rm, rn = radii(sin_lat)
    east = x[1] - lla[1]  # longitude difference, wrapped to half a turn
    if east > np.pi:
        east -= 2.0 * np.pi
    elif east < -np.pi:
        east += 2.0 * np.pi
    z[0], z[1], z[2] = (x[0] - lla[0]) * (rm + x[2]), east * (rn + x[2]) * cos_lat, lla[2] - x[2]
    z[3], z[4], z[5] = -v_n[0], -v_n[1], -v_n[2] - older[6] * gravity_down(sin_lat, x[2])

    h[:] = 0.0
    for i in range(6):
        h[i, i] = 1.0
    for i in range(3):
        unity[i, i] = 1.0
        felt[i] = swing[i] + moved[i]
    crossed(unity, arm, 0, 6, h)  # d(C l) = (C l) x phi
    crossed(unity, felt, 3, 6, h)
    # w_hat = (w_measured - bias) / (1 + scale): d(w x l) = l x (d bias + w d scale); likewise the velocity increment
    crossed(earlier, lever, 3, 9, h)
    for i in range(3):
        velocity = x[3 + i] + swing[i]
        z[i] += arm[i] - delay * velocity
        z[3 + i] += velocity + moved[i] - (delay + lag) * motion[3 + i]
        for j in range(3):
            h[3 + i, 12 + j] = older[6] * c[i, j]
            h[3 + i, 15 + j] = h[3 + i, 9 + j] * motion[j]
            h[3 + i, 18 + j] = older[3 + j] * c[i, j]
        if h.shape[1] > STATES:
            h[i, STATES], h[3 + i, STATES] = -velocity, -motion[3 + i]


@njit(cache=True)
def correct_with_arm(x, correction, error, at, arm, swung):  # type: ignore[no-untyped-def]
    """Subtract an estimated error (n,) from the state, and from the lever arm, whose states begin at `at`.

    `arm` (12,): the lever arm [m], then the sum of the corrections of ``C_nb``. An attitude correction is not a
    rotation of the vehicle and must not make the lever arm observable. The position state therefore includes the
    lever-arm error times these corrections. Earlier position measurements then keep their information on the lever arm.
    The same holds for the antenna motion `swung` (3,) in navigation axes since the last epoch [m], and for the heading
    (observability-constrained filter: G. P. Huang, A. I. Mourikis and S. I. Roumeliotis, Int. J. Robotics Research 29
    (2010) 502-528). Exception: while the delay is unsettled, attitude corrections follow the delay, and the arm is
    observed anew.
    """
    before, after, moved, square = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(STATES), 0.0
    rotation(x, before.reshape(9))
    feed_back(x, correction, error)
    rotation(x, after.reshape(9))
    for i in range(3):
        for j in range(3):
            swung[i] += after[i, j] * (arm[j] - error[at + j]) - before[i, j] * arm[j]
            arm[3 + 3 * i + j] += after[i, j] - before[i, j]
            square += arm[3 + 3 * i + j] ** 2
    for i in range(3):
        arm[i] -= error[at + i]
        for j in range(3):
            arm[3 + 3 * i + j] *= min(1.0, LARGEST_TURN / np.sqrt(max(square, 1e-12)))
            moved[i] -= arm[3 + 3 * i + j] * error[at + j]
    feed_back(x, correction, moved)


@njit(cache=True)
def swing(phi, swung):  # type: ignore[no-untyped-def]
    """Apply the antenna swing `swung` (3,) to the start of a transition (n, n), ``-phi [swung x]``; set it to zero."""
    for i in range(NAV):
        north, east, down = phi[i, 0], phi[i, 1], phi[i, 2]
        phi[i, 6] -= east * swung[2] - down * swung[1]
        phi[i, 7] -= down * swung[0] - north * swung[2]
        phi[i, 8] -= north * swung[1] - east * swung[0]
    swung[:] = 0.0


@njit(cache=True)
def assess(  # type: ignore[no-untyped-def]
    estimated, p, motion, lla, v_n, position_sd, velocity_sd, row, own, late, jitter, share, places, z, h, r, s, sd
):
    """Assess row `row` of the fixes for the gates and the filter.

    `estimated` (n,), `p` (n, n): predicted state and covariance. `motion` (25,): body rate [rad/s] and acceleration in
    n [m/s^2] at the time of the velocity. Where turns determine the lever arm, this rate is the mean about the fix.
    Then: additional rate, vibration or noise [rad/s]. Noise limits of the squared mean and additional rate, below which
    no lever arm is observable [rad^2/s^2]. Recent velocity corrections [m/s], which must not make a delay observable.
    Mean specific force about the fix [m/s^2], body axes. Noise limit of squared acceleration. `older` of `antenna`.
    `own`: the states of time-correlated errors and of velocity lag apply to this fix. `late`: age of its velocity [s].
    `jitter`: standard deviation of the timestamps [s]. `share`: share of the time-correlated error in the variance of a
    fix [-]. `places`: see `DELAYED`. Filled: `z` (6,): predicted minus measured [m], [m/s]. `h` (6, n): its derivative
    by the error states. `r`, `s` (6, 6): covariances of measurement and innovation. `sd` (6,): standard deviation of
    the innovation; ``NaN`` without a measurement.

    Returns: `position`, `velocity`: NIS of each half, 3 degrees of freedom; ``NaN`` without a measurement.
    `distance`, `change`: length of the innovation of position [m] and of velocity [m/s].
    """
    x, arm, shaken, correlated = estimated[STATE], estimated[ARM], estimated[SHAKEN], estimated[LASTING]
    correlated_at, lag_at = places[CORRELATED, 0] if own else -1, places[LAGGED, 0] if own else -1
    lever_at, shaken_at, lag = places[LEVER, 0], places[SWINGING, 0], estimated[LAG] - late if own else 0.0
    whole = np.zeros(6)
    for i in range(6):  # the antenna moves with the total rate, mean plus vibration
        whole[i] = motion[i] + (motion[6 + i] if i < 3 and shaken_at < 0 else 0.0)
    rotated, earlier = np.zeros((3, 3)), np.zeros((3, 3))
    rotation(x, rotated.reshape(9))
    _before(rotated, motion[18:21], earlier)
    # Noise common to the acceleration and the velocity of this fix or the next must not determine the delay. The mean
    # about the fix correlates with both velocities equally, with opposite signs. Only acceleration beyond noise counts.
    changing = 0.0
    for i in range(3):
        whole[3 + i] = gravity_down(np.sin(x[0]), x[2]) if i == 2 else 0.0
        for j in range(3):
            whole[3 + i] += earlier[i, j] * motion[14 + j]
        changing += whole[3 + i] ** 2
    antenna(x, whole, motion[18:], arm, estimated[DELAY], lag, lla[row], v_n[row], z, h)
    moving, unsure = 0.0, 0.0
    for i in range(3 if h.shape[1] > STATES else 0):
        h[i, STATES] += motion[11 + i]
        h[3 + i, STATES] *= changing / max(changing + motion[17], 1e-30)
        moving, unsure = moving + h[i, STATES] ** 2, unsure + STILL * p[3 + i, 3 + i]
    for i in range(3 if h.shape[1] > STATES else 0):  # a velocity within its noise must not determine the delay
        h[i, STATES] *= moving**2 / max(moving**2 + unsure**2, 1e-30)
    if correlated_at >= 0:  # add the time-correlated error of the fix to its prediction
        for i in range(places[CORRELATED, 2]):
            z[i] += correlated[i]
            h[i, correlated_at + i] = 1.0
    if lever_at >= 0:  # derivatives by the lever arm
        for i in range(3):
            for j in range(3):
                h[i, lever_at + j] = rotated[i, j] - arm[3 + 3 * i + j]
        # Errors in variables: a noisy rate that both predicts and multiplies the arm biases it towards zero (W. A.
        # Fuller, Measurement Error Models, Wiley 1987, section 1.1). The mean rate about the fix contains little of
        # this noise (an instrumental variable, section 1.4). The remaining rate counts where far above noise.
        turning = motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2
        beyond = motion[6] ** 2 + motion[7] ** 2 + motion[8] ** 2
        steady = turning**2 / max(turning**2 + motion[9] ** 2, 1e-30)
        also = beyond / max(beyond + motion[10], 1e-30) if shaken_at < 0 else 0.0
        for i in range(3):  # computed element by element: products of arrays take long to compile
            whole[i] = motion[i] * steady + motion[6 + i] * also**2
        crossed(earlier, whole, 3, lever_at, h)
    if shaken_at >= 0:  # velocity by vibration of the antenna
        crossed(earlier, motion[6:], 3, shaken_at, h)
        for i in range(3):
            for j in range(3):
                z[3 + i] += h[3 + i, shaken_at + j] * shaken[j]
    if lag_at >= 0:  # a lag shifts the velocity in time like a delay
        for i in range(3, 6):
            h[i, lag_at] = h[i, STATES]
    for i in range(3):
        for j in range(3):
            r[i, j] = jitter * jitter * x[3 + i] * x[3 + j]  # timestamp jitter moves the fix along the velocity
            r[3 + i, 3 + j] = jitter * jitter * motion[3 + i] * motion[3 + j]
            r[i, 3 + j] = r[3 + i, j] = 0.0
        r[i, i] += (1.0 - share) * position_sd[row, i] ** 2
        r[3 + i, 3 + i] += velocity_sd[row, i] ** 2 if velocity_sd[row, i] > 0.0 else 1.0
    n = p.shape[0]
    hp = np.zeros((6, n))  # h P, skipping zeros: most of h is zero
    for i in range(6):
        for k in range(n):
            by = h[i, k]
            if by != 0.0:
                for j in range(n):
                    hp[i, j] += by * p[k, j]
    for i in range(6):
        for j in range(6):
            total = r[i, j]
            for k in range(n):
                total += hp[i, k] * h[j, k]
            s[i, j] = total
        sd[i] = np.sqrt(s[i, i]) if np.isfinite(z[i]) else np.nan
    distance = np.sqrt(z[0] ** 2 + z[1] ** 2 + z[2] ** 2)
    change = np.sqrt(z[3] ** 2 + z[4] ** 2 + z[5] ** 2)
    half, part = np.zeros(2), np.zeros((3, 3))
    for i in range(2):
        for j in range(3):
            for k in range(3):
                part[j, k] = s[3 * i + j, 3 * i + k]
        inv = inverse(part)
        for j in range(3):
            for k in range(3):
                half[i] += z[3 * i + j] * inv[j, k] * z[3 * i + k]
    return half[0], half[1], distance, change


@njit(cache=True)
def inverse(s):  # type: ignore[no-untyped-def]
    """Invert a small symmetric positive definite matrix, by Cholesky's decomposition."""
    n = s.shape[0]
    low = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = s[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(total) if i == j else total / low[j, j]
    # inverse of the Cholesky factor, then the product of its transpose with it
    inv = np.zeros((n, n))
    for j in range(n):
        inv[j, j] = 1.0 / low[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= low[i, k] * inv[k, j]
            inv[i, j] = total / low[i, i]
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += inv[k, i] * inv[k, j]
            out[i, j] = out[j, i] = total
    return out


@njit(cache=True)
def measurement_fault(z, h, r):  # type: ignore[no-untyped-def]
    """Return whether a measurement has a number that is not finite or a variance that is not positive."""
    total = 0.0
    for i in range(z.shape[0]):
        total += z[i]
        if not r[i, i] > 0.0:
            return True
        for j in range(h.shape[1]):
            total += h[i, j]
        for j in range(z.shape[0]):
            total += r[i, j]
    return not np.isfinite(total)


@njit(cache=True)
def fault_of(p, error):  # type: ignore[no-untyped-def]
    """Find a non-finite covariance (n, n) or state (n,), or a negative variance; symmetrise in place."""
    n, fault, total = p.shape[0], 0, 0.0
    for i in range(n):
        total += error[i]
        if p[i, i] < 0.0:
            fault = NEGATIVE
        for j in range(i + 1):
            p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])
            total += p[i, j]
    return fault if np.isfinite(total) else NOT_FINITE


@njit(cache=True)
def vehicle_velocity(x, rate, to_vehicle, lever, speed, z, h):  # type: ignore[no-untyped-def]
    """Compute a point's velocity in vehicle axes minus its measurement.

    `x`: state. `rate`: body rate [rad/s]. `to_vehicle`: rotation from IMU to vehicle axes. `lever`: point relative to
    the IMU, body axes [m]. `speed`: measured forward speed [m/s]. ``z[:3]`` is predicted minus measured velocity:
    forward, right (measured as zero), down (likewise) [m/s]. ``h[:3]`` is its derivative by the error states.

    ``z = C_vb (C_bn v + w x lever)``; with ``C_hat = (I - [phi x]) C`` the derivative by velocity is ``C_vb C_bn``, by
    attitude ``-C_vb C_bn [v x]``, by gyro bias ``C_vb [lever x]``.
    """
    c, seen = np.zeros((3, 3)), np.zeros((3, 3))
    rotation(x, c.reshape(9))
    h[:3] = 0.0
    crossed(to_vehicle, lever, 0, 9, h)
    for i in range(3):
        z[i] = 0.0
        for j in range(3):
            for k in range(3):
                seen[i, j] += to_vehicle[i, k] * c[j, k]
            h[i, 3 + j] = seen[i, j]
            z[i] += seen[i, j] * x[3 + j] - h[i, 9 + j] * rate[j]
    crossed(seen, -x[3:6], 0, 6, h)
    z[0] -= speed


@njit(cache=True)
def zero_velocity(x, bias, rate, z, h):  # type: ignore[no-untyped-def]
    """Compute velocity N, E, D [m/s] and gyro rate against the Earth [rad/s], both zero for a stationary vehicle.

    `bias` is the estimated gyro bias, `rate` the mean gyro output including the bias [rad/s]. ``z``, (6,), is predicted
    minus measured. ``h``, (6, n), is its derivative by the error states.
    """
    c = np.zeros((3, 3))
    rotation(x, c.reshape(9))
    earth = OMEGA * np.array([np.cos(x[0]), 0.0, -np.sin(x[0])])
    h[:] = 0.0
    crossed(c.T.copy(), -earth, 3, 6, h)  # derivative of the Earth rate by attitude: -C_bn [w_ie x]
    for i in range(3):
        z[i] = x[3 + i]
        h[i, 3 + i] = 1.0
        z[3 + i] = bias[i] + c[0, i] * earth[0] + c[2, i] * earth[2] - rate[i]
        h[3 + i, 9 + i] = 1.0


@njit(cache=True)
def body_heading(x, heading, z, h):  # type: ignore[no-untyped-def]
    """Compute heading of the body minus a measured heading [rad], within +-pi, in ``z[0]``; its derivative in ``h[0]``.

    ``C_hat = (I - [phi x]) C`` turns the body by ``-phi``; the derivative of ``atan2(C_hat_10, C_hat_00)`` follows.
    """
    c = np.zeros((3, 3))
    rotation(x, c.reshape(9))
    for j in range(h.shape[1]):
        h[0, j] = 0.0
    level2 = c[0, 0] * c[0, 0] + c[1, 0] * c[1, 0]  # squared cosine of the pitch
    difference = np.arctan2(c[1, 0], c[0, 0]) - heading
    z[0] = difference - 2.0 * np.pi * np.floor(difference / (2.0 * np.pi) + 0.5)
    # d atan2(c10, c00) with dc = -[phi x] c
    h[0, 6] = c[2, 0] * c[0, 0] / level2
    h[0, 7] = c[2, 0] * c[1, 0] / level2
    h[0, 8] = -1.0


@njit(cache=True)
def innovation(p, z, h, r, first, last, s):  # type: ignore[no-untyped-def]
    """Compute covariance `s` and NIS of the rows `first` to `last` - 1 of an innovation, with noise variances `r`."""
    n = p.shape[0]
    m = last - first
    for i in range(m):
        for j in range(m):
            total = r[first + i] if i == j else 0.0
            for k in range(n):
                share = h[first + i, k]
                if share != 0.0:
                    for a in range(n):
                        total += share * p[k, a] * h[first + j, a]
            s[i, j] = total
    inv, nis = inverse(s), 0.0
    for i in range(m):
        for j in range(m):
            nis += z[first + i] * inv[i, j] * z[first + j]
    return nis
