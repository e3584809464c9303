"""Runs against one reference, side by side: results in memory, or folders."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from insnav.errors.comparison import Comparison, Solution, compare_solutions
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.output.solution_tables import has_smoothed, read_solution
from insnav.plain_text import plain_text
from insnav.result import Result
from insnav.session.checked_inputs import checked, options_of, vector
from insnav.session.inputs import Inputs
from insnav.session.read import read_ref
from insnav.types import Trajectory

if TYPE_CHECKING:
    from insnav.session.read import Given


def compare(
    *runs: Result[EvaluatedRun] | str | Path, ref: Given | Trajectory, **inputs: Unpack[Inputs]
) -> Result[Comparison]:
    """Compare runs with one reference, at the epochs that all of them cover.

    Parameters
    ----------
    *runs : Result, str or Path
        Results of `insnav.session.drive.Drive.navigate`, or folders of saved runs.
    ref : path, data frame, arrays or Trajectory
        Reference, as for `insnav.load`.
    **inputs
        ``ref_columns``, ``ref_lever_arm``: the point of the reference seen from the IMU; by default the IMU.

    Returns
    -------
    Result of Comparison

    Raises
    ------
    InputError
        A folder without a solution, or no epoch that all runs and the reference share.
    """
    inputs = checked(inputs)
    reference = read_ref(ref, inputs)
    solutions = [each for number, run in enumerate(runs, start=1) for each in _solutions(run, number)]
    found = compare_solutions(solutions, reference.data, vector(inputs, "ref_lever_arm"))
    names = [str(run) for run in runs if not isinstance(run, Result)]
    return Result("comparison", found, {"reference": reference.facts}, options_of(inputs, runs=names))


def _solutions(run: Result[EvaluatedRun] | str | Path, number: int) -> Iterator[Solution]:
    """Filtered and, if there is one, smoothed solution of a run."""
    if isinstance(run, Result):
        name, found = f"run {number}", run.found.run
        yield Solution(name, "filter", found.solution)
        if found.smoothed is not None:
            yield Solution(name, "smoothed", found.smoothed.solution)
        return
    folder = Path(run)
    name = plain_text(folder.resolve().name)
    yield Solution(name, "filter", read_solution(folder))
    if has_smoothed(folder):
        yield Solution(name, "smoothed", read_solution(folder, "smoothed"))
