"""Standard deviations that hold what a record cannot decide: fixes before or after a lasting jump may be false."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from insnav.findings import Code, of_code
from insnav.types import FloatArray, Run, Trajectory

LEAST = 0.2  # probability of either explanation, at least: half of three standard deviations hold it


class Jump(NamedTuple):
    """A change of place of the fixes that lasts."""

    begin: float  # [s]
    end: float  # when it is over; the same as `begin` of what is no drift [s]
    moved: FloatArray  # (3,) North, East, Down [m]


def widened(run: Run, off: Callable[[Trajectory], FloatArray], share: float) -> Run:
    """Standard deviations that hold positions that are `off` (n, 3) [m] with a probability of `share`."""
    part = float(np.clip(share, LEAST, 1.0 - LEAST))

    def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
        sd[:, :3] = np.sqrt(sd[:, :3] ** 2 + part * off(solution) ** 2)
        return sd

    return with_wider_sd(run, wider)


def widen_by_jumps(run: Run, jumps: Sequence[Jump]) -> Run:
    """Standard deviations that hold both: fixes before the first jump are true, or fixes after the last."""
    assert run.smoothed is not None
    time, begin, end = run.smoothed.solution.time, min(each.begin for each in jumps), max(each.end for each in jumps)
    early = (begin - time[0]) / (begin - time[0] + time[-1] - end)
    run = widened(run, lambda solution: _moved(jumps, solution.time), early)
    last = _moved(jumps, time[-1:])
    return widened(run, lambda solution: last - _moved(jumps, solution.time), 1.0 - early)


def _moved(jumps: Sequence[Jump], time: FloatArray) -> FloatArray:
    """By how much the fixes are off against those at the begin, (n, 3) [m]."""
    off = np.zeros((time.size, 3))
    for begin, end, moved in jumps:
        part = (time >= begin).astype(float) if end <= begin else np.clip((time - begin) / (end - begin), 0.0, 1.0)
        off += part[:, None] * moved
    return off


def resets_of(run: Run) -> tuple[Jump, ...]:
    """Resets as jumps of the fixes from the first of those that were rejected on."""
    found, jumps = run.innovations, list[Jump]()
    for reset in of_code(run.events, Code.FILTER_RESET):
        row = int(np.searchsorted(found.time, reset.begin - 1e-6))
        first = int(np.flatnonzero(found.used_position[:row]).max(initial=-1)) + 1
        begin = float(found.time[first])
        jumps.append(Jump(begin, begin, found.innovation[row, :3]))
    return tuple(jumps)


def with_wider_sd(run: Run, wider: Callable[[Trajectory, FloatArray], FloatArray]) -> Run:
    """A run with other standard deviations, filtered and smoothed."""

    def changed(solution: Trajectory) -> Trajectory:
        assert solution.sd is not None
        return replace(solution, sd=wider(solution, solution.sd.copy()))

    smoothed = run.smoothed and replace(run.smoothed, solution=changed(run.smoothed.solution))
    return replace(run, solution=changed(run.solution), smoothed=smoothed)
