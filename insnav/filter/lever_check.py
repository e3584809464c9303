"""A lever arm, a heading or a delay that was given and that the drive contradicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.attitude import dcm_from_quat, quat_from_rph, wrap_pi
from insnav.exceptions import AlignmentError
from insnav.filter.changes import with_wider_sd
from insnav.filter.gps_delay import filtered
from insnav.filter.navigate import feed
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding, untyped_event
from insnav.types import FloatArray, Run, Trajectory

LOOK = 600.0  # so much of a drive tells it [s]
OPENED = 2.0  # standard deviation of each component in the pass that looks for it [m]
WRONG, SURE = 0.4, 6.0  # smallest error that is said [m], and in standard deviations of what was found
MARGIN = 3.0  # further ones by which what is surely seen exceeds that: noise found with an error in it is larger
LATE, LATE_SURE = 0.03, 10.0  # smallest error of a delay that is said [s], and in standard deviations of what was found
OPENED_DELAY = 0.5  # standard deviation of the delay in the pass that looks for it [s]
# Part of what is known of a lever arm that noise of the gyros may pretend, from which it is said; and for about how
# long noise turns the attitude before fixes show it [s]
PRETENDED, SHOWN_AFTER = 0.2, 10.0
DOUBLED = 2.0  # times the standard deviations then
NO_GYROS = 30.0  # noise that no gyros have: on hard mounts in vehicles it was up to 8 [deg/√h]
WRONG_HEADING = 3.0  # standard deviations of a heading given from which another one that the drive shows is tried


def with_right_heading(given: Prepared, alone: Callable[[], Prepared]) -> Prepared:
    """A recording as prepared with a heading that was given, or `alone`, without it, if that makes fixes likelier."""
    try:
        found = alone()
    except AlignmentError:  # the drive shows none
        return given
    said, shown = given.alignment, found.alignment
    off = abs(float(wrap_pi(shown.rph[2] - said.rph[2])))
    limit = WRONG_HEADING * float(said.sd[2])
    if off < limit:
        return given
    ready, how = found, "not used"
    if filtered(given).misfit <= filtered(found).misfit:
        ready, how = given, "used: without it fixes are no likelier"
        if off < WRONG_HEADING * np.hypot(said.sd[2], shown.sd[2]):
            return given
    was, now, sd, off, limit = np.rad2deg([said.rph[2], shown.rph[2], shown.sd[2], off, limit])
    text = f"heading given, {was:.0f} deg, contradicts the drive, which shows {now:.0f} ± {sd:.2g} deg: {how}"
    event = untyped_event(ready.initial.time, Code.CONTRADICTION, off, limit, "deg", f"the {text}")
    return replace(ready, faults=(*ready.faults, event), notes=(*ready.notes, text))


def with_right_lever(given: Prepared, alone: Callable[[], Prepared]) -> Prepared:
    """A recording as prepared with a lever arm that was given, or `alone`, without it, if the drive shows another."""
    arm, run = given.settings.lever_b, looked(given, lever_sd=OPENED)
    off, limit = np.abs(run.lever_b - arm), np.maximum(WRONG, SURE * run.lever_sd)
    if not (off > limit).any():
        seen = _three(limit + MARGIN * run.lever_sd)
        note = f"errors of the lever arm given that this drive would not show are smaller than {seen} m (x, y, z)"
        return replace(given, notes=(*given.notes, note))
    other = alone()
    if pretended(given, run) <= PRETENDED:
        return other
    run = looked(other)  # noise found with a wrong arm holds it
    hidden = min(pretended(other, run), 1.0) * np.abs(arm)
    if (np.abs(run.lever_b - arm) > limit + hidden).any():
        return other
    text = (
        f"the lever arm given is used, though fixes show {_three(run.lever_b)} m: noise of the gyros may pretend that; "
        "without --lever-arm it is found"
    )
    event = untyped_event(given.initial.time, Code.CONTRADICTION, float(off.max()), float(limit.max()), "m", text)
    return replace(given, faults=(*given.faults, event))


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
    """A run whose lever arm may be noise of its gyros, with the arm, the delay and positions as unsure as that; events.

    Standard deviations are doubled: of short parts of a recorded car by RTK arms were 3 to 4 of them off. Where noise
    tells more than the drive, the arm is short by that, too. An event as well if no gyros have such noise.
    """
    part, noise = pretended(ready, run), 60.0 * np.rad2deg(np.sqrt(ready.model.noise[:3].mean()))
    begin = float(run.solution.time[0])
    if noise > NO_GYROS:
        text = (
            f"noise of the gyros, {noise:.0f} deg/√h, is more than any have: IMU and fixes contradict each other, as "
            "those of two drives do, or with a wrong axis, scale or clock; the result is not to be relied on"
        )
        return run, (untyped_event(begin, Code.CONTRADICTION, noise, NO_GYROS, "deg/√h", text),)
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

    text = (
        f"noise of the gyros, {noise:.2g} deg/√h, hides lever arm and delay: they are stated as twice as unsure "
        "as the drive shows them, or more, and the positions with them; give --lever-arm and --gps-delay"
    )
    run = replace(with_wider_sd(run, wider), lever_sd=sd, gps_delay_sd=DOUBLED * run.gps_delay_sd)
    return run, (untyped_event(begin, Code.CONTRADICTION, part, PRETENDED, "", text),)


def lever_contradicted(arm: FloatArray, run: Run) -> Finding:
    """An arm (3,) that was given [m], and that a run without it does not have: what to give is the run's own one."""
    text = (
        f"the antenna seems to be at {_three(run.lever_b)} (± {_three(run.lever_sd)}) m from the IMU, forward, right, "
        f"down, not at {_three(arm)} as given, which is not used: --lever-arm {_three(run.lever_b)}"
    )
    off = float(np.abs(run.lever_b - arm).max())
    return untyped_event(float(run.solution.time[0]), Code.CONTRADICTION, off, WRONG, "m", text)


def _three(values: FloatArray) -> str:
    return ",".join(f"{round(float(value), 2) + 0.0:.2f}" for value in values)


def delay_contradicted(ready: Prepared) -> tuple[Finding, ...]:
    """Navigate the begin of a drive with the delay of the fixes as a state; an event if it ends far from that given.

    How far is not said: the noise was found with the error in it, and holds it back.
    """
    given, run = ready.settings.delay, looked(ready, delay_sd=OPENED_DELAY)
    off, limit = abs(run.gps_delay - given), max(LATE, LATE_SURE * run.gps_delay_sd)
    other = "larger" if run.gps_delay > given else "smaller"
    told = f"the delay of the fixes given, {given:.3f} s, contradicts the drive, which asks for a {other} one"
    said = f"{told}: without --gps-delay it is found"
    return (untyped_event(ready.initial.time, Code.CONTRADICTION, off, limit, "s", said),) * bool(off > limit)


def looked(ready: Prepared, **opened: float) -> Run:
    """The begin of a drive, navigated with other settings."""
    settings = replace(ready.settings, smooth=False, surest=0.0, **opened)  # type: ignore[arg-type]
    some = replace(ready.beginning(LOOK), settings=settings)
    return feed(some.navigator(), some.imu).finish()
