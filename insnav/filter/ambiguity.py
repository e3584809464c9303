"""Standard deviations for ambiguous records: after a lasting jump, earlier or later fixes may be the false ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from insnav import spill
from insnav.findings import Code, of_code
from insnav.types import FloatArray, Run, Trajectory

LEAST = 0.2  # least probability of each hypothesis: the jump is then at most 2.24 standard deviations [-]


class Jump(NamedTuple):
    """Lasting jump of the fixes against the solution."""

    begin: float  # time of the first displaced fix [s]
    moved: FloatArray  # (3,) displacement of the fixes, North, East, Down [m]


def widen_by_jumps(run: Run, jumps: Sequence[Jump]) -> Run:
    """Widen position sds to cover two hypotheses: fixes before the first jump, or after the last jump, are true."""
    assert run.smoothed is not None
    time, begin = run.smoothed.solution.time, np.array([each.begin for each in jumps])
    before, after = begin.min() - time[0], time[-1] - begin.max()
    early = float(np.clip(before / (before + after), LEAST, 1.0 - LEAST))  # probability that later fixes are false

    def wider(solution: Trajectory, sd: FloatArray) -> FloatArray:
        moved = np.array([each.moved for each in jumps])
        shift = (solution.time[:, None] >= begin) @ moved  # displacement of the fixes by now
        sd[:, :3] = np.sqrt(sd[:, :3] ** 2 + early * shift**2 + (1.0 - early) * (moved.sum(axis=0) - shift) ** 2)
        return sd

    return with_wider_sd(run, wider)


def resets_of(run: Run) -> tuple[Jump, ...]:
    """Return the resets of a run as jumps of the fixes. A jump begins at the first of the rejected fixes."""
    innovations, jumps = run.innovations, list[Jump]()
    for reset in of_code(run.events, Code.FILTER_RESET):
        row = int(np.searchsorted(innovations.time, reset.begin - 1e-6))
        first = int(np.flatnonzero(innovations.used_position[:row]).max(initial=-1)) + 1
        jumps.append(Jump(float(innovations.time[first]), innovations.innovation[row, :3]))
    return tuple(jumps)


def with_wider_sd(run: Run, wider: Callable[[Trajectory, FloatArray], FloatArray]) -> Run:
    """Replace the sds of all solutions of a run by `wider`, a function of some rows of a solution and their sds."""

    def changed(solution: Trajectory) -> Trajectory:
        assert solution.sd is not None
        sd = spill.empty(solution.sd.shape)
        for block in spill.blocks(len(sd)):
            sd[block] = wider(solution.rows(block), solution.sd[block].copy())
        return replace(solution, sd=sd)

    smoothed = run.smoothed and replace(run.smoothed, solution=changed(run.smoothed.solution))
    poses = run.poses and changed(run.poses)
    return replace(run, solution=changed(run.solution), smoothed=smoothed, poses=poses)
