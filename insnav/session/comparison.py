"""Comparison of runs, in memory or in folders, with one reference."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from insnav.errors.evaluated_run import EvaluatedRun, fixed_epochs, same_positions
from insnav.errors.metrics import Comparison, Solution, compare_solutions
from insnav.errors.reference_check import check_reference
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.output.folder import FACTS_FILE, read_facts
from insnav.output.solution_tables import has_smoothed, read_run_table, read_solution
from insnav.plain_text import plain_text
from insnav.result import Result
from insnav.session.read import read_ref
from insnav.steps.given import checked, options_of, reference_point
from insnav.steps.inputs import Inputs
from insnav.types import GpsData, Trajectory

if TYPE_CHECKING:
    from insnav.session.read import Given


def compare(
    *runs: Result[EvaluatedRun] | str | Path, ref: Given | Trajectory, **inputs: Unpack[Inputs]
) -> Result[Comparison]:
    """Compare runs with one reference, at their common epochs.

    Parameters
    ----------
    *runs : Result, str or Path
        Results of `insnav.session.drive.Drive.navigate`, or folders of saved runs.
    ref : path, data frame, arrays or Trajectory
        Reference, as for `insnav.load`.
    **inputs
        ``ref_columns``: columns of the reference. ``ref_lever_arm``: point of the reference seen from the IMU; by
        default the IMU, or the antenna for positions without attitude.

    Returns
    -------
    Result of Comparison

    Raises
    ------
    InputError
        A folder without a solution, or no epoch common to all runs and the reference.
    """
    inputs = checked(inputs)
    reference = read_ref(ref, inputs)
    solutions = [each for number, run in enumerate(runs, start=1) for each in _solutions(run, number)]
    fixed, notes = fixed_epochs(reference)
    point, chosen, gps = reference_point(inputs, reference.data), solutions[0], _fixes(runs[0])
    chosen = next((each for each in solutions if (each.run, each.solution) == (chosen.run, "smoothed")), chosen)
    if gps is not None and same_positions(gps, fixed):
        notes = (*notes, Finding.of(Code.REF_SAME_AS_GPS, subject="ref"))
    else:
        with suppress(InputError):  # without a common time, `compare_solutions` raises the error
            fixed, doubts = check_reference(fixed, chosen.trajectory, gps, chosen.lever_b if point is None else point)
            notes = (*notes, *doubts)
    found = compare_solutions(solutions, fixed, point)
    names = [str(run) for run in runs if not isinstance(run, Result)]
    return Result("comparison", found, {"reference": reference.facts}, options_of(inputs, runs=names), findings=notes)


def _fixes(run: Result[EvaluatedRun] | str | Path) -> GpsData | None:
    """Read the fixes of a run, if any."""
    if isinstance(run, Result):
        return run.found.gps
    return read_run_table(Path(run), GpsData) if any(Path(run).glob("fixes.*")) else None


def _solutions(run: Result[EvaluatedRun] | str | Path, number: int) -> Iterator[Solution]:
    """Yield the filtered and, if present, the smoothed solution of a run."""
    if isinstance(run, Result):
        name, navigated = f"run {number}", run.found.run
        yield Solution(name, "filtered", navigated.solution, navigated.lever_b)
        if navigated.smoothed is not None:
            yield Solution(name, "smoothed", navigated.smoothed.solution, navigated.lever_b)
        return
    folder = Path(run)
    name = plain_text(folder.resolve().name)
    filtered = read_solution(folder)
    facts = read_facts(folder) if (folder / FACTS_FILE).is_file() else {}
    lever_b = np.array(facts.get("fixes", {}).get("lever_arm_m") or np.zeros(3))
    yield Solution(name, "filtered", filtered, lever_b)
    if has_smoothed(folder):
        yield Solution(name, "smoothed", read_solution(folder, "smoothed"), lever_b)
