"""A lever arm, a heading or a delay that was given and that the drive contradicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.attitude import dcm_from_quat, quat_from_rph, wrap_pi
from insnav.filter.ambiguity import with_wider_sd
from insnav.filter.gps_delay import filtered
from insnav.filter.navigate import feed
from insnav.filter.noise_search import SHORT
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding
from insnav.types import FloatArray, Run, Trajectory
from insnav.units import DEG_PER_SQRT_H

OPENED = 2.0  # standard deviation of each component in the pass that looks for it [m]
WRONG, SURE = 0.4, 6.0  # smallest error that is said [m], and in standard deviations of what was found
MARGIN = 3.0  # further ones by which what is surely seen exceeds that: noise found with an error in it is larger
LATE, LATE_SURE = 0.03, 10.0  # smallest error of a delay that is said [s], and in standard deviations of what was found
OPENED_DELAY = 0.5  # standard deviation of the delay in the pass that looks for it [s]
# Part of what is known of a lever arm that noise of the gyros may pretend, from which it is said; and for about how
# long noise turns the attitude before fixes show it [s]
PRETENDED, SHOWN_AFTER = 0.2, 10.0
DOUBLED = 2.0  # times the standard deviations then
NO_GYROS = 30.0 * DEG_PER_SQRT_H  # noise that no gyros have; hard mounts in vehicles: up to 8 deg/√h [rad/√s]
WRONG_HEADING = 3.0  # standard deviations of a heading given from which another one that the drive shows is tried


def with_right_heading(given: Prepared, found: Prepared) -> Prepared:
    """Return a recording as prepared with the heading that was given, or without it, if that makes fixes likelier."""
    said, shown = given.alignment, found.alignment
    off = abs(float(wrap_pi(shown.rph[2] - said.rph[2])))
    limit = WRONG_HEADING * float(said.sd[2])
    if off < limit:
        return given
    ready, code = found, Code.GIVEN_HEADING_REJECTED
    if filtered(given).misfit <= filtered(found).misfit:
        ready, code = given, Code.GIVEN_HEADING_KEPT
        if off < WRONG_HEADING * np.hypot(said.sd[2], shown.sd[2]):
            return given
    heading = Finding.of(
        code,
        ready.initial.time,
        difference_rad=off,
        limit_rad=limit,
        given_rad=said.rph[2],
        estimate_rad=shown.rph[2],
        estimate_sd_rad=shown.sd[2],
    )
    return replace(ready, faults=(*ready.faults, heading))


def with_right_lever(given: Prepared, alone: Callable[[], Prepared]) -> Prepared:
    """A recording as prepared with a lever arm that was given, or `alone`, without it, if the drive shows another."""
    arm, run = given.settings.lever_b, looked(given, lever_sd=OPENED)
    off, limit = np.abs(run.lever_b - arm), np.maximum(WRONG, SURE * run.lever_sd)
    if not (off > limit).any():
        checked = Finding.of(Code.ESTIMATE_LEVER_ARM_CHECKED, detectable_m=tuple(limit + MARGIN * run.lever_sd))
        return replace(given, notes=(*given.notes, checked))
    other = alone()
    if pretended(given, run) <= PRETENDED:
        return other
    run = looked(other)  # noise found with a wrong arm holds it
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
    """Part of what a run knows of its lever arm, where it knows least, that noise of the gyros may pretend.

    What the gyros' noise turns is no turn, but shows an arm as one does: like that of no length, as the antenna does
    not move (errors in variables: W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.1). Of each fix that
    is twice the variance of the attitude by that noise over that of the innovation, for each axis.
    """
    row = np.searchsorted(run.epochs.time, run.innovations.time).clip(max=run.epochs.time.size - 1)
    attitude = np.diagonal(run.epochs.covariance, axis1=1, axis2=2)[row, 6:]
    turned = np.minimum(attitude, SHOWN_AFTER * ready.model.noise[:3].mean()).mean(axis=1)
    told = 2.0 * turned / np.mean(run.innovations.sd[:, :3] ** 2, axis=1)
    return float(told[run.innovations.used_position].sum() * np.max(run.lever_sd_alone) ** 2)


def with_hidden_lever(ready: Prepared, run: Run) -> tuple[Run, tuple[Finding, ...]]:
    """A run whose lever arm may be noise of its gyros, with arm, delay and positions as uncertain as that.

    Standard deviations are doubled: of short parts of a recorded car by RTK arms were 3 to 4 of them off. Where noise
    tells more than the drive, the arm is short by that, too. Noise that no gyros have is reported.
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
    """An arm (3,) that was given [m], and that a run without it does not have: what to give is the run's own one."""
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
    """Navigate the begin of a drive with the delay of the fixes as a state, and report one far from that given.

    The words have no difference: the noise was found with the error in it, and holds it back.
    """
    given, run = ready.settings.delay, looked(ready, delay_sd=OPENED_DELAY)
    off, limit = abs(run.gps_delay - given), max(LATE, LATE_SURE * run.gps_delay_sd)
    difference, begin = run.gps_delay - given, ready.initial.time
    delay = Finding.of(Code.GIVEN_DELAY, begin, difference_s=difference, limit_s=limit, given_s=given)
    return (delay,) * bool(off > limit)


def looked(ready: Prepared, **opened: float) -> Run:
    """The begin of a drive, navigated with other settings."""
    settings = replace(ready.settings, smooth=False, surest=0.0, **opened)  # type: ignore[arg-type]
    some = replace(ready.beginning(SHORT), settings=settings)
    return feed(some.navigator(), some.imu).finish()
