"""Standard deviations for ambiguous records: either the fixes before or those after a lasting jump may be false."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from insnav import spill
from insnav.findings import Code, of_code
from insnav.types import FloatArray, Run, Trajectory

LEAST = 0.2  # least probability of either explanation: the jump is then at most 2.24 standard deviations [-]


class Jump(NamedTuple):
    """Lasting jump of the fixes."""

    begin: float  # [s]
    moved: FloatArray  # (3,) North, East, Down [m]


def widen_by_jumps(run: Run, jumps: Sequence[Jump]) -> Run:
    """Widen standard deviations to cover two hypotheses: fixes before the first, or after the last jump are true."""
    assert run.smoothed is not None
    time, begin = run.smoothed.solution.time, np.array([each.begin for each in jumps])
    before, after = begin.min() - time[0], time[-1] - begin.max()
    early = float(np.clip(before / (before + after), LEAST, 1.0 - LEAST))  # probability that the fixes after are false

    def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
        moved = np.array([each.moved for each in jumps])
        off = (solution.time[:, None] >= begin) @ moved  # relative to the start
        sd[:, :3] = np.sqrt(sd[:, :3] ** 2 + early * off**2 + (1.0 - early) * (moved.sum(axis=0) - off) ** 2)
        return sd

    return with_wider_sd(run, wider)


def resets_of(run: Run) -> tuple[Jump, ...]:
    """Return resets as jumps of the fixes, from the first rejected fix on."""
    found, jumps = run.innovations, list[Jump]()
    for reset in of_code(run.events, Code.FILTER_RESET):
        row = int(np.searchsorted(found.time, reset.begin - 1e-6))
        first = int(np.flatnonzero(found.used_position[:row]).max(initial=-1)) + 1
        jumps.append(Jump(float(found.time[first]), found.innovation[row, :3]))
    return tuple(jumps)


def with_wider_sd(run: Run, wider: Callable[[Trajectory, FloatArray], FloatArray]) -> Run:
    """Replace the standard deviations of a run, filtered and smoothed, by a row-wise function."""

    def changed(solution: Trajectory) -> Trajectory:
        assert solution.sd is not None
        sd = spill.empty(solution.sd.shape)
        for block in spill.blocks(len(sd)):
            sd[block] = wider(solution.rows(block), solution.sd[block].copy())
        return replace(solution, sd=sd)

    smoothed = run.smoothed and replace(run.smoothed, solution=changed(run.smoothed.solution))
    poses = run.poses and changed(run.poses)
    return replace(run, solution=changed(run.solution), smoothed=smoothed, poses=poses)
