"""What changes in a drive and stays so: biases that step, an IMU that is turned in its place, fixes that jump for good.

The adjoint of the smoother shows the change of the state that explains all later innovations best (see
`insnav.filter.shocks`). Where fixes and IMU contradict each other, the drive is navigated without gates, the change
that stands out most is taken off the state at its time, with its covariance opened, and the drive is navigated again,
as long as that makes it likelier (one after the other: R. S. Tsay, "Outliers, level shifts, and variance changes in
time series", Journal of Forecasting 7 (1988) 1-20). Attitude and biases change with the IMU. Position and velocity of
a vehicle do not jump: fixes that come back were false in between; of fixes that do not, those before or those after are
true, and the variance is that of the mixture of both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.earth import ned_offset
from insnav.exceptions import DivergenceError
from insnav.filter.gates import Trust
from insnav.findings import Code, Finding, of_code
from insnav.kernels.dynamics import NAV
from insnav.types import FloatArray, GpsData, Run, StateChange, Trajectory

BETTER = 30.0  # by so much likelier must a further change make the drive [-]
AT_END = 6.0  # so well are begin and end of a gyro that is off known [s]
BESIDE = 30.0  # a change that is found so little before another may be that one [s]
# a jump may be that of fixes which are false so long before and after, where gates hide them and where they do not [s]
AROUND, BRIEF = 15.0, 3.0
MOST = 8  # changes in one drive
BACK = 0.3  # part of the largest offset at which fixes are back where they were [-]
MINORITY = 0.5  # of the fixes may be false between changes
OVER = 0.6  # part of the largest change of velocity that may be left of all together after a drag [-]
FASTEST = 6.0  # drag of fixes; what changes by more, an IMU has missed: a hard start, a clipped axis [m/s]
HELD = 3.0  # standard deviations of the smoothed position hold so large a jump already
LEAST = 0.2  # probability of either explanation, at least: half of three standard deviations hold it
VELOCITY, ATTITUDE = 3, 6  # first of their error states
# what a change is of, and the name of its size, by the first of its error states
SIZES = {
    0: ("gps", "distance_m"),
    VELOCITY: ("", "speed_m_s"),
    ATTITUDE: ("imu", "angle_rad"),
    NAV: ("gyro", "rate_rad_s"),
    NAV + 3: ("accel", "acceleration_m_s2"),
}
DRIFT, SEVERAL = "drift", "several"  # instead of a first state: positions drift away, the attitude changes often
IMU_CHANGED: dict[int | str, Code] = {
    VELOCITY: Code.RECORD_VELOCITY_MISSED,
    ATTITUDE: Code.CHANGE_TURNED,
    SEVERAL: Code.CHANGE_ATTITUDE_LOST,
    NAV: Code.CHANGE_GYRO_BIAS,
    NAV + 3: Code.CHANGE_ACCEL_BIAS,
}
AMBIGUOUS: dict[int | str, Code] = {
    VELOCITY: Code.RECORD_VELOCITY_MISSED_AMBIGUOUS,
    ATTITUDE: Code.CHANGE_TURNED_AMBIGUOUS,
    SEVERAL: Code.CHANGE_ATTITUDE_LOST_AMBIGUOUS,
    NAV: Code.CHANGE_GYRO_BIAS_AMBIGUOUS,
    NAV + 3: Code.CHANGE_ACCEL_BIAS_AMBIGUOUS,
}
FIXES_CHANGED: dict[int | str, Code] = {
    0: Code.RECORD_JUMP,
    DRIFT: Code.RECORD_DRIFT,
    VELOCITY: Code.RECORD_VELOCITY_STEP,
}


def changes_of(
    run: Run,
    changes: tuple[StateChange, ...],
    again: Callable[..., Run],
    unlikely: Callable[[Run, tuple[StateChange, ...]], float],
    *,
    only_surest: bool = False,
    around: float = AROUND,
) -> tuple[Run, tuple[StateChange, ...], Run]:
    """Find changes one after the other, beside those that a run has, while they make it likelier.

    `again`: navigates with changes taken off; `around`: what passes may have begun so long before, and end so long
    after [s]. What a step of a bias explains as well is no turn of the IMU, and what lasts as well does not pass.
    Returns: the run, its changes, and the last run that was tried.
    """
    other = run
    while run.smoothed is not None and len(changes) < MOST:
        wanted = list(run.smoothed.likely[:1])
        if only_surest:
            wanted = [run.smoothed.surest] if run.smoothed.surest is not None else []
        elif wanted and wanted[0].first == ATTITUDE:
            wanted += [each for each in run.smoothed.likely[1:] if each.first > ATTITUDE]
        tried = []
        for more in (more for added in wanted for more in with_(changes, added, around)):
            with suppress(DivergenceError):  # what ends so explains nothing
                tried.append((more, again(changes=more)))
        if not tried:
            break
        bold = [sum(each.first == ATTITUDE or not each.change.any() for each in more) for more, _ in tried]
        costs = [unlikely(some, more) for more, some in tried]
        best = int(np.argmin(np.array(costs) + BETTER * np.array(bold)))
        more, other = tried[best]
        if costs[best] > unlikely(run, changes) - BETTER:
            break
        run, changes = other, more
    return run, tuple(measured(each, run) for each in changes), other


def measured(change: StateChange, run: Run) -> StateChange:
    """A drag as far as fixes are off after it, against the track without those of its time; zero if they are back."""
    if not np.isfinite(change.since) or not change.change.any():
        return change
    row = min(int(np.searchsorted(run.innovations.time, change.time - 1e-6)), run.innovations.time.size - 1)
    off = -run.innovations.innovation[row, :3]
    back = np.linalg.norm(off) < BACK * np.linalg.norm(change.change)
    return replace(change, change=np.zeros(3) if back else off)


def with_(changes: tuple[StateChange, ...], found: StateChange, around: float) -> list[tuple[StateChange, ...]]:
    """Changes with another one, and without those soon after it, or jumps about it: they may only have stood for it.

    Jumps that follow each other may be one drag: the positions while it lasts are not used. Nor are those about a jump
    of no size, after which fixes are back where they were.
    """
    same = [each for each in changes if (each.time, each.first) == (found.time, found.first)]
    near = [
        each
        for each in changes
        if each.first == found.first == 0 and max(each.begin, found.begin) - min(each.time, found.time) < BESIDE
    ]
    ways = [same]
    if len(near) > 1 or any(np.isfinite(each.since) for each in (found, *near)):
        ways.append([*same, *(each for each in near if each not in same)])
    more = []
    for joined in ways:
        every = (found, *joined)
        since, end = min(each.begin for each in every), max(each.time for each in every)
        parts = [each.change for each in every]
        drag = since < end  # of which only its size matters before it is measured
        change = max(parts, key=lambda part: float(np.linalg.norm(part))) if drag else np.sum(parts, axis=0)
        one = replace(found, change=change, since=since if drag else np.inf, time=end)
        rest = [each for each in changes if each not in joined]
        less = [each for each in rest if not one.time < each.time < one.time + BESIDE]
        both = [rest] if len(less) == len(rest) else [rest, less]
        passed = replace(one, first=0, change=np.zeros(3), since=one.begin - around, time=one.time + around)
        passes = one.first == 0 or (one.first == VELOCITY and around < AROUND)
        ones = (one, passed) if passes else (one,)
        every_way = [[*some, each] for some in both for each in ones]
        # found one fix too early, a jump is followed by another one: that false fix has pulled the track back
        instead = [each for each in rest if each not in near or np.isfinite(each.since)]
        every_way += [[*instead, one]] * (len(instead) < len(rest))
        more += [tuple(sorted(each, key=lambda change: change.time)) for each in every_way]
    return more


def unused(changes: tuple[StateChange, ...], gps: GpsData, delay: float, trust: Trust | None = None) -> Trust | None:
    """Positions that changes leave out, and those of `trust`."""
    time = gps.time - delay
    none = np.zeros((2, time.shape[0]), dtype=np.bool_)
    found = Trust(none, np.full(none.shape, np.nan)) if trust is None else replace(trust, false=trust.false.copy())
    for each in changes:
        found.false[0] |= (time >= each.since) & (time < each.time)
    return found if found.false.any() else None


def offset(changes: tuple[StateChange, ...], time: FloatArray) -> FloatArray:
    """By how much the fixes are off against those at the begin, (n, 3) [m], if they change and the vehicle does not."""
    off, rate, largest = np.zeros((time.shape[0], 3)), np.zeros(3), 0.0
    for number, each in enumerate(changes):
        if each.first == 0:
            off -= (time >= each.time)[:, None] * each.change
            continue
        rate, largest = rate - each.change, max(largest, float(np.linalg.norm(each.change)))
        if np.linalg.norm(rate) < OVER * largest:  # the drag is over, as far as it is known
            rate, largest = np.zeros(3), 0.0
        until = next((later.time for later in changes[number + 1 :] if later.first == VELOCITY), np.inf)
        off += np.clip(time - each.time, 0.0, until - each.time)[:, None] * rate
    return off


def of_the_imu(change: StateChange) -> bool:
    """Whether the IMU changes or has missed something, not the fixes."""
    return change.first >= ATTITUDE or (change.first == VELOCITY and bool(np.linalg.norm(change.change) > FASTEST))


def false_between(changes: tuple[StateChange, ...], gps: GpsData, delay: float, held: float = 0.0) -> Trust | None:
    """Fixes between changes that take each other back, but for `held` [m]; None if fixes end elsewhere than they began.

    What standard deviations hold is no other place.
    """
    dragged = unused(changes, gps, delay)
    size = np.linalg.norm(offset(changes, gps.time - delay), axis=1)
    back = max(BACK * size.max(), min(held, MINORITY * size.max()))
    if size.any() and size[-1] > back:
        return None
    away = size > back
    if dragged is not None:
        away = away | dragged.false[0]
    faster = away & any(each.first == VELOCITY for each in changes)
    return Trust(np.array([away, faster]), np.array([size, size])) if 0.0 < np.mean(away) < MINORITY else None


def widened(run: Run, off: Callable[[Trajectory], FloatArray], share: float) -> Run:
    """Standard deviations that hold positions that are `off` (n, 3) [m] with a probability of `share`."""
    part = float(np.clip(share, LEAST, 1.0 - LEAST))

    def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
        sd[:, :3] = np.sqrt(sd[:, :3] ** 2 + part * off(solution) ** 2)
        return sd

    return with_wider_sd(run, wider)


def mixed(run: Run, changes: tuple[StateChange, ...]) -> Run:
    """Standard deviations that hold both: fixes before the first change are true, or fixes after the last."""
    begin, end = min(each.begin for each in changes), changes[-1].time
    assert run.smoothed is not None
    time = run.smoothed.solution.time
    early = (begin - time[0]) / (begin - time[0] + time[-1] - end)
    last = offset(changes, time[-1:])
    run = widened(run, lambda solution: offset(changes, solution.time), early)
    return widened(run, lambda solution: last - offset(changes, solution.time), 1.0 - early)


def beyond(run: Run, changes: tuple[StateChange, ...]) -> tuple[StateChange, ...]:
    """Changes of the fixes without those that did not last, and jumps that standard deviations hold already."""
    assert run.smoothed is not None
    solution = run.smoothed.solution
    assert solution.sd is not None
    rows = np.minimum(np.searchsorted(solution.time, [each.time for each in changes]), solution.time.size - 1)
    pairs = zip(changes, HELD * solution.sd[rows, :3], strict=True)
    return tuple(each for each, held in pairs if (np.abs(each.change) > held * (each.first == 0)).any())


def resets_of(run: Run) -> tuple[StateChange, ...]:
    """Resets as jumps of the fixes from the first of those that were rejected on."""
    found, changes = run.innovations, list[StateChange]()
    for reset in of_code(run.events, Code.FILTER_RESET):
        row = int(np.searchsorted(found.time, reset.begin - 1e-6))
        first = int(np.flatnonzero(found.used_position[:row]).max(initial=-1)) + 1
        changes.append(StateChange(float(found.time[first]), 0, -found.innovation[row, :3], np.nan))
    return tuple(changes)


def either(run: Run, other: Run) -> Run:
    """Standard deviations that hold both runs, of which neither is likelier."""
    there = (other.smoothed or other).solution
    assert there.sd is not None
    values = there.lla, there.v_n, there.sd

    def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
        lla, v_n, other_sd = (
            np.column_stack([np.interp(solution.time, there.time, column) for column in each.T]) for each in values
        )
        off = np.hstack([ned_offset(solution.lla, lla), solution.v_n - v_n])
        sd[:, :6] = np.sqrt(0.5 * (sd[:, :6] ** 2 + other_sd[:, :6] ** 2 + off**2))
        return sd

    return with_wider_sd(run, wider)


def with_wider_sd(run: Run, wider: Callable[[Trajectory, FloatArray], FloatArray]) -> Run:
    """A run with other standard deviations, filtered and smoothed."""

    def changed(solution: Trajectory) -> Trajectory:
        assert solution.sd is not None
        return replace(solution, sd=wider(solution, solution.sd.copy()))

    smoothed = run.smoothed and replace(run.smoothed, solution=changed(run.smoothed.solution))
    return replace(run, solution=changed(run.solution), smoothed=smoothed)


def _axis(change: StateChange) -> int:
    """Along or about which most of it is."""
    return int(np.argmax(np.abs(change.change)))


def at_an_end(change: StateChange, known: tuple[StateChange, ...]) -> bool:
    """Whether a step of a gyro bias is begin or end of a gyro that is known to be off, which is said already."""
    ends = (each for each in known if each.first == NAV == change.first and _axis(each) == _axis(change))
    return any(abs(each.time - change.time) < AT_END for each in ends)


def report_changes(changes: tuple[StateChange, ...], codes: Mapping[int | str, Code]) -> list[Finding]:
    """Report changes, of the IMU or of the fixes, one finding each; several turns of an IMU are gyros that clip.

    `codes`: by first state, `IMU_CHANGED`, `AMBIGUOUS` or `FIXES_CHANGED`.
    """

    def report(change: StateChange) -> Finding:
        sensor, name = SIZES[change.first]
        size: dict[str, Any] = {name: np.linalg.norm(change.change)}
        subject = f"{sensor} {'xyz'[_axis(change)]}" if change.first >= NAV else sensor
        code = codes[DRIFT if np.isfinite(change.since) else change.first]
        return Finding.of(code, change.begin, change.time, subject=subject, **size)

    turns = tuple(each for each in changes if each.first == ATTITUDE)
    rest = tuple(each for each in changes if each.first != ATTITUDE)
    if len(turns) < 2:
        return [report(each) for each in changes]
    if turns[-1].time - turns[0].time < BESIDE:  # found in parts
        one = replace(turns[0], change=np.sum([each.change for each in turns], axis=0))
        return [report(one), *report_changes(rest, codes)]
    angle = max(float(np.linalg.norm(each.change)) for each in turns)
    span = turns[0].time, turns[-1].time
    lost = Finding.of(codes[SEVERAL], *span, subject="imu", angle_rad=angle, count=len(turns))
    return [lost, *report_changes(rest, codes)]
