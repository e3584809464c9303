"""Accuracy of several runs against one reference, at their common epochs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import chain, count
from typing import Any, NamedTuple

import numpy as np

from insnav.errors.metrics import TrajectoryErrors, accuracy, nees, position_errors
from insnav.exceptions import InputError
from insnav.types import FloatArray, Trajectory


class Solution(NamedTuple):
    """Solution of a run."""

    run: str  # name of the run
    solution: str  # filtered or smoothed
    trajectory: Trajectory
    lever_b: FloatArray  # (3,) its antenna seen from the IMU, body axes [m]


@dataclass(frozen=True, slots=True)
class Compared:
    """Errors of a solution of a run."""

    run: str  # name of the run
    solution: str  # filtered or smoothed
    errors: TrajectoryErrors  # at the common epochs of all runs


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of runs with one reference."""

    reference: Trajectory  # at the common epochs and possibly others
    compared: tuple[Compared, ...]  # in input order, the smoothed solution after the filtered one of a run

    def rows(self) -> list[dict[str, Any]]:
        """List the accuracy of each solution.

        Returns: ``run``, ``solution``, ``accuracy`` from `insnav.errors.metrics.accuracy`, ``consistency`` from
        `insnav.errors.metrics.nees`.
        """
        return [
            {
                "run": each.run,
                "solution": each.solution,
                "accuracy": accuracy(each.errors),
                "consistency": nees(each.errors),
            }
            for each in self.compared
        ]

    def named(self) -> dict[str, TrajectoryErrors]:
        """Return the errors of each solution under a unique name."""
        named: dict[str, TrajectoryErrors] = {}
        for each in self.compared:
            name = f"{each.run}-smoothed" if each.solution == "smoothed" else each.run
            numbered = chain([name], (f"{name}-{number}" for number in count(2)))
            named[next(free for free in numbered if free not in named and free != "reference")] = each.errors
        return named


def compare_solutions(
    solutions: Sequence[Solution], reference: Trajectory, lever_b: FloatArray | None = None
) -> Comparison:
    """Compare solutions with a reference, at their common epochs.

    `lever_b` (3,): the point of the reference seen from the IMU, body axes [m]; None for the antenna of each.
    Raises: InputError: no epoch common to all solutions and the reference.
    """
    errors = []
    for each in solutions:
        try:
            point = each.lever_b if lever_b is None else lever_b
            errors.append(position_errors(each.trajectory, reference, lever_b=point))
        except InputError as error:
            error.where = error.where or each.run
            raise
    shared = reduce(np.intersect1d, [each.time for each in errors])
    if len(shared) == 0:
        raise InputError(
            "compare.no_common_time",
            spans=tuple(
                f"{of.run}: {each.time[0]:.1f} … {each.time[-1]:.1f} s"
                for of, each in zip(solutions, errors, strict=True)
            ),
        )
    compared = (
        Compared(of.run, of.solution, each.rows(np.isin(each.time, shared)))
        for of, each in zip(solutions, errors, strict=True)
    )
    return Comparison(reference, tuple(compared))
