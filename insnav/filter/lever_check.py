"""Test of a specified lever arm, heading or delay against the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.attitude import dcm_from_quat, quat_from_rph, wrap_pi
from insnav.filter.ambiguity import with_wider_sd
from insnav.filter.gps_delay import filtered
from insnav.filter.navigate import feed
from insnav.filter.noise_identification import SHORT
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding
from insnav.types import FloatArray, Run, Trajectory
from insnav.units import DEG_PER_SQRT_H

OPENED = 2.0  # standard deviation of each component in the pass that estimates it [m]
WRONG, SURE = 0.4, 6.0  # smallest reported error [m], and in standard deviations of the estimate
MARGIN = 3.0  # additional margin in sd: noise identified with a wrong arm is too large
LATE, LATE_SURE = 0.03, 10.0  # smallest reported delay error [s], and in sd of the estimate
OPENED_DELAY = 0.5  # standard deviation of the delay in the pass that estimates it [s]
# Share of the lever-arm information that may come from gyro noise before it is reported. Approximate time over which
# noise rotates the attitude before fixes correct it [s]
PRETENDED, SHOWN_AFTER = 0.2, 10.0
DOUBLED = 2.0  # factor on the standard deviations then
NO_GYROS = 30.0 * DEG_PER_SQRT_H  # no gyro has this noise; hard mounts in vehicles: up to 8 deg/√h [rad/√s]
WRONG_HEADING = 3.0  # error of a specified heading in sd, from which the heading of the drive is tried


def with_right_heading(given: Prepared, found: Prepared) -> Prepared:
    """Return a recording prepared with or without the specified heading, whichever makes the fixes more likely."""
    assumed, shown = given.alignment, found.alignment
    off = abs(float(wrap_pi(shown.rph[2] - assumed.rph[2])))
    limit = WRONG_HEADING * float(assumed.sd[2])
    if off < limit:
        return given
    ready, code = found, Code.GIVEN_HEADING_REJECTED
    if filtered(given).misfit <= filtered(found).misfit:
        ready, code = given, Code.GIVEN_HEADING_KEPT
        if off < WRONG_HEADING * np.hypot(assumed.sd[2], shown.sd[2]):
            return given
    heading = Finding.of(
        code,
        ready.initial.time,
        difference_rad=off,
        limit_rad=limit,
        given_rad=assumed.rph[2],
        estimate_rad=shown.rph[2],
        estimate_sd_rad=shown.sd[2],
    )
    return replace(ready, faults=(*ready.faults, heading))


def with_right_lever(given: Prepared, alone: Callable[[], Prepared]) -> Prepared:
    """Return a recording with the specified lever arm, or `alone` without it, if the drive contradicts it."""
    arm, run = given.settings.lever_b, looked(given, lever_sd=OPENED)
    off, limit = np.abs(run.lever_b - arm), np.maximum(WRONG, SURE * run.lever_sd)
    if not (off > limit).any():
        checked = Finding.of(Code.ESTIMATE_LEVER_ARM_CHECKED, detectable_m=tuple(limit + MARGIN * run.lever_sd))
        return replace(given, notes=(*given.notes, checked))
    other = alone()
    if pretended(given, run) <= PRETENDED:
        return other
    run = looked(other)  # noise identified with a wrong arm includes its error
    hidden = min(pretended(other, run), 1.0) * np.abs(arm)
    if (np.abs(run.lever_b - arm) > limit + hidden).any():
        return other
    kept = Finding.of(
        Code.GIVEN_LEVER_ARM_KEPT,
        given.initial.time,
        difference_m=off.max(),
        limit_m=limit.max(),
        given_m=tuple(arm),
        estimate_m=tuple(run.lever_b),
    )
    return replace(given, faults=(*given.faults, kept))


def pretended(ready: Prepared, run: Run) -> float:
    """Compute the share of the lever-arm information, on its weakest axis, that may come from gyro noise.

    Apparent rotation by gyro noise acts as evidence for a lever arm of zero length, as the antenna does not move
    (errors in variables: W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.1). Per fix and axis, this is
    twice the attitude variance by that noise over the innovation variance.
    """
    row = np.searchsorted(run.epochs.time, run.innovations.time).clip(max=run.epochs.time.size - 1)
    attitude = np.diagonal(run.epochs.covariance, axis1=1, axis2=2)[row, 6:]
    turned = np.minimum(attitude, SHOWN_AFTER * ready.model.noise[:3].mean()).mean(axis=1)
    told = 2.0 * turned / np.mean(run.innovations.sd[:, :3] ** 2, axis=1)
    return float(told[run.innovations.used_position].sum() * np.max(run.lever_sd_alone) ** 2)


def with_hidden_lever(ready: Prepared, run: Run) -> tuple[Run, tuple[Finding, ...]]:
    """Widen the standard deviations of arm, delay and positions if the lever arm may come from gyro noise.

    Standard deviations are doubled: in short parts of a recorded car with RTK, arms were wrong by 3 to 4 of them. Where
    noise outweighs the drive, its bias towards zero is added. Impossible gyro noise is reported.
    """
    part, noise = pretended(ready, run), float(np.sqrt(ready.model.noise[:3].mean()))
    begin = float(run.solution.time[0])
    if noise > NO_GYROS:
        return run, (Finding.of(Code.NOISE_GYROS, begin, noise_rad_sqrt_s=noise, limit_rad_sqrt_s=NO_GYROS),)
    if part <= PRETENDED:
        return run, ()
    of_each = part * (run.lever_sd_alone / np.max(run.lever_sd_alone)) ** 2
    short = np.where(of_each > 1.0, of_each, 0.0) * np.abs(run.lever_b)
    sd = np.hypot(DOUBLED * run.lever_sd, short)
    more = sd**2 - run.lever_sd**2

    def wider(solution: Trajectory, of: FloatArray) -> FloatArray:
        c_nb = dcm_from_quat(quat_from_rph(solution.rph))
        of[:, :3] = np.sqrt(of[:, :3] ** 2 + c_nb**2 @ more)
        return of

    hidden = Finding.of(Code.NOISE_HIDES_LEVER_ARM, begin, share=part, limit_share=PRETENDED, noise_rad_sqrt_s=noise)
    return replace(with_wider_sd(run, wider), lever_sd=sd, gps_delay_sd=DOUBLED * run.gps_delay_sd), (hidden,)


def lever_contradicted(arm: FloatArray, run: Run) -> Finding:
    """Report a specified arm (3,) [m] that a run without it contradicts, with the run's estimate to specify."""
    return Finding.of(
        Code.GIVEN_LEVER_ARM_REJECTED,
        run.solution.time[0],
        difference_m=np.abs(run.lever_b - arm).max(),
        limit_m=WRONG,
        estimate_m=tuple(run.lever_b),
        estimate_sd_m=tuple(run.lever_sd),
        given_m=tuple(arm),
    )


def delay_contradicted(ready: Prepared) -> tuple[Finding, ...]:
    """Navigate the first part of a drive with the delay as a state, and report a wrong specified delay.

    Its message shows no difference: noise identified with the error in it biases the estimate.
    """
    given, run = ready.settings.delay, looked(ready, delay_sd=OPENED_DELAY)
    off, limit = abs(run.gps_delay - given), max(LATE, LATE_SURE * run.gps_delay_sd)
    difference, begin = run.gps_delay - given, ready.initial.time
    delay = Finding.of(Code.GIVEN_DELAY, begin, difference_s=difference, limit_s=limit, given_s=given)
    return (delay,) * bool(off > limit)


def looked(ready: Prepared, **opened: float) -> Run:
    """Navigate the first part of a drive with other settings."""
    settings = replace(ready.settings, smooth=False, least_delay_sd=0.0, **opened)  # type: ignore[arg-type]
    some = replace(ready.beginning(SHORT), settings=settings)
    return feed(some.navigator(), some.imu).finish()
