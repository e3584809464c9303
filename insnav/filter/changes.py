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

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insnav.filter.gates import Trust
from insnav.filter.shocks import clearest, settled
from insnav.filter.smoother import SmoothedErrors
from insnav.kernels.dynamics import NAV
from insnav.kernels.smoother import DRAG, VECTORS
from insnav.plain_text import moment
from insnav.types import Event, EventKind, FloatArray, GpsData, Run, StateChange, Trajectory

CLEAR = 45.0  # twice the gain of the log-likelihood from which a change is tried [-]
BETTER = 30.0  # by so much likelier must a further change make the drive [-]
BESIDE = 30.0  # a change that is found so little before another may be that one [s]
MOST = 8  # changes in one drive
BACK = 0.3  # part of the largest offset at which fixes are back where they were [-]
MINORITY = 0.5  # of the fixes may be false between changes
OVER = 0.6  # part of the largest change of velocity that may be left of all together after a drag [-]
SHOWN = 20.0, 20.0, 120.0, 120.0, 120.0, np.inf  # so near a change of each kind shows, too [s]
TOLD = {
    0: ("fixes jump by {:.2g} m", "m", 1.0),
    3: ("the velocity of the fixes changes by {:.2g} m/s", "m/s", 1.0),
    6: ("the IMU turns by {:.2g} deg in its place", "deg", float(np.rad2deg(1.0))),
    NAV: ("the gyro bias steps by {:.2g} deg/s", "deg/s", float(np.rad2deg(1.0))),
    NAV + 3: ("the accelerometer bias steps by {:.2g} m/s^2", "m/s^2", 1.0),
}


def largest_change(found: SmoothedErrors, *, velocities: bool = True) -> StateChange | None:
    """Change that later innovations ask for most clearly; without GPS `velocities` there is no drag beside them."""
    rows = np.flatnonzero(settled(found))
    best = None
    for group, first in enumerate((*TOLD, *([0] if velocities else [])) if rows.size else ()):
        vectors = found.shocks[:, VECTORS + 4 * group :]
        gains = np.nan_to_num(vectors[rows, 0])
        largest, usual = clearest(found.time[rows], gains, SHOWN[group])
        row, gain, drag = rows[largest], float(gains[largest]), group == len(TOLD)
        at = float(found.time[row])
        if gain >= usual and gain > (CLEAR if best is None else best.gain):
            change = vectors[row, 1:4] * (DRAG if drag else 1.0)
            best = StateChange(at + DRAG, first, change, gain, at) if drag else StateChange(at, first, change, gain)
    return best


def changes_of(
    again: Callable[[tuple[StateChange, ...]], Run], unlikely: Callable[[Run, tuple[StateChange, ...]], float]
) -> tuple[StateChange, ...]:
    """Find the changes one after the other; `again`: navigates without gates, with changes taken off."""
    changes: tuple[StateChange, ...] = ()
    run = again(changes)
    while run.smoothed is not None and run.smoothed.changed is not None and len(changes) < MOST:
        tried = [(added, again(added)) for added in _with(changes, run.smoothed.changed)]
        better, other = min(tried, key=lambda each: unlikely(each[1], each[0]))
        if unlikely(other, better) > unlikely(run, changes) - BETTER:
            break
        changes, run = better, other
    return tuple(_measured(each, run) for each in changes)


def _measured(change: StateChange, run: Run) -> StateChange:
    """A drag as far as fixes are off after it, against the track without those of its time; zero if they are back."""
    if not np.isfinite(change.since):
        return change
    row = min(int(np.searchsorted(run.innovations.time, change.time - 1e-6)), run.innovations.time.size - 1)
    off = -run.innovations.innovation[row, :3]
    back = np.linalg.norm(off) < BACK * np.linalg.norm(change.change)
    return replace(change, change=np.zeros(3) if back else off)


def _with(changes: tuple[StateChange, ...], found: StateChange) -> list[tuple[StateChange, ...]]:
    """Changes with another one, and the same without those soon after it: they may only have stood for it.

    Jumps that follow each other are one drag: the positions while it lasts are not used.
    """
    same = [each for each in changes if (each.time, each.first) == (found.time, found.first)]
    rest = [each for each in changes if each not in same]
    if found.first == 0:
        near = [
            each
            for each in rest
            if each.first == 0 and max(each.begin, found.begin) - min(each.time, found.time) < BESIDE
        ]
        if len(near) > 1 or any(np.isfinite(each.since) for each in (found, *near)):
            same, rest = [*same, *near], [each for each in rest if each not in near]
    if same:
        every = (found, *same)
        since, end = min(each.begin for each in every), max(each.time for each in every)
        parts = [each.change for each in every]
        drag = since < end  # of which only its size matters before it is measured
        change = max(parts, key=lambda part: float(np.linalg.norm(part))) if drag else np.sum(parts, axis=0)
        found = replace(found, change=change, since=since if drag else np.inf, time=end)
    less = [each for each in rest if not found.time < each.time < found.time + BESIDE]
    both = [rest] if len(less) == len(rest) else [rest, less]
    return [tuple(sorted([*some, found], key=lambda each: each.time)) for some in both]


def unused(changes: tuple[StateChange, ...], gps: GpsData, delay: float) -> Trust | None:
    """Positions that changes leave out."""
    time, false = gps.time - delay, np.zeros((2, gps.time.shape[0]), dtype=np.bool_)
    for each in changes:
        false[0] |= (time >= each.since) & (time < each.time)
    return Trust(false, np.full(false.shape, np.nan)) if false.any() else None


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
        until = next((later.time for later in changes[number + 1 :] if later.first == 3), np.inf)
        off += np.clip(time - each.time, 0.0, until - each.time)[:, None] * rate
    return off


def false_between(changes: tuple[StateChange, ...], gps: GpsData, delay: float) -> Trust | None:
    """Fixes between changes that take each other back; None if fixes end elsewhere than they began."""
    dragged = unused(changes, gps, delay)
    size = np.linalg.norm(offset(changes, gps.time - delay), axis=1)
    if size.any() and size[-1] > BACK * size.max():
        return None
    away = size > BACK * size.max()
    if dragged is not None:
        away = away | dragged.false[0]
    faster = away & any(each.first == 3 for each in changes)
    return Trust(np.array([away, faster]), np.array([size, size])) if 0.0 < np.mean(away) < MINORITY else None


def mixed(run: Run, changes: tuple[StateChange, ...]) -> Run:
    """Standard deviations that hold both: fixes before the first change are true, or fixes after the last."""
    begin, end = min(each.begin for each in changes), changes[-1].time
    assert run.smoothed is not None
    time = run.smoothed.solution.time
    early = (begin - time[0]) / (begin - time[0] + time[-1] - end)

    def wider(solution: Trajectory) -> Trajectory:
        off, last = offset(changes, solution.time), offset(changes, time[-1:])
        assert solution.sd is not None
        sd = solution.sd.copy()
        sd[:, :3] = np.sqrt(sd[:, :3] ** 2 + early * off**2 + (1.0 - early) * (last - off) ** 2)
        return replace(solution, sd=sd)

    smoothed = replace(run.smoothed, solution=wider(run.smoothed.solution))
    return replace(run, solution=wider(run.solution), smoothed=smoothed)


def told(changes: tuple[StateChange, ...], why: str) -> list[Event]:
    """An event for each change, and what was made of it."""

    def event(time: float, change: FloatArray, text: str, unit: str, scale: float) -> Event:
        size = scale * float(np.linalg.norm(change))
        return Event(time, EventKind.CONTRADICTION, size, np.nan, unit, f"{text.format(size)} at {moment(time)}: {why}")

    return [event(each.time, each.change, *TOLD[each.first]) for each in changes]
