"""Accuracy of several runs against one reference, side by side, over the epochs that all of them cover."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from insnav.errors.metrics import TrajectoryErrors, accuracy, nees, position_errors
from insnav.exceptions import InputError
from insnav.output.solution_tables import has_smoothed, read_solution
from insnav.plain_text import plain_text
from insnav.types import FloatArray, Trajectory


class Compared(NamedTuple):
    """Errors of one solution of one run.

    Attributes
    ----------
    run : str
        Name of the folder.
    solution : {"filter", "smoothed"}
        Which of its solutions.
    errors : TrajectoryErrors
        At the epochs that all runs share.
    """

    run: str
    solution: str
    errors: TrajectoryErrors


def compare(runs: Sequence[Path], reference: Trajectory, *, lever_b: FloatArray | None = None) -> list[dict[str, Any]]:
    """Accuracy of run folders against a reference.

    Only epochs of the reference that every run covers are counted, so that the rows can be compared.

    Parameters
    ----------
    runs : sequence of Path
        Run folders.
    reference : Trajectory
        The reference.
    lever_b : (3,) array, optional
        The point of the reference seen from the IMU, body axes [m].

    Returns
    -------
    list of dict
        For each run, and again for its smoothed solution if there is one: ``run`` (name of the folder), ``solution``
        (``filter`` or ``smoothed``), ``accuracy`` as of `insnav.errors.metrics.accuracy`, and ``consistency`` as of
        `insnav.errors.metrics.nees`.

    Raises
    ------
    InputError
        A folder without a solution, or no epoch that all runs and the reference share.
    """
    return [
        {
            "run": each.run,
            "solution": each.solution,
            "accuracy": accuracy(each.errors),
            "consistency": nees(each.errors),
        }
        for each in shared_errors(runs, reference, lever_b=lever_b)
    ]


def shared_errors(runs: Sequence[Path], reference: Trajectory, *, lever_b: FloatArray | None = None) -> list[Compared]:
    """Errors of each run, all at the same epochs; see `compare`."""
    errors = []
    wanted = [(run, which) for run in runs for which in ("solution", *(("smoothed",) if has_smoothed(run) else ()))]
    for run, which in wanted:
        try:
            errors.append(position_errors(read_solution(run, which), reference, lever_b=lever_b))
        except InputError as error:
            error.where = error.where or plain_text(run)
            raise
    shared = reduce(np.intersect1d, [each.time for each in errors])
    if len(shared) == 0:
        raise InputError(
            "these runs have no time in common",
            why="; ".join(
                f"{run.name}: {each.time[0]:.1f} to {each.time[-1]:.1f} s"
                for (run, _), each in zip(wanted, errors, strict=True)
            ),
            fix="compare runs of the same recording",
        )
    return [
        Compared(
            plain_text(run.resolve().name),
            "smoothed" if which == "smoothed" else "filter",
            each.rows(np.isin(each.time, shared)),
        )
        for (run, which), each in zip(wanted, errors, strict=True)
    ]


def named_errors(
    runs: Sequence[Path], reference: Trajectory, lever_b: FloatArray | None = None
) -> dict[str, TrajectoryErrors]:
    """Errors of each run under a name of its own, all at the same epochs; see `compare`."""
    named: dict[str, TrajectoryErrors] = {}
    for run, solution, errors in shared_errors(runs, reference, lever_b=lever_b):
        name = f"{run}-smoothed" if solution == "smoothed" else run
        numbered = chain([name], (f"{name}-{number}" for number in count(2)))
        named[next(each for each in numbered if each not in named and each != "reference")] = errors
    return named
