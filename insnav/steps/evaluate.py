"""Step 12: compare the solution with the reference, if there is one."""

from __future__ import annotations

from dataclasses import replace

from insnav.errors.evaluated_run import evaluate_run
from insnav.findings import Finding, added
from insnav.steps import Model, Recording
from insnav.steps.given import reference_point


def evaluate(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Compute the errors of the solution against the reference.

    Raises: InputError: solution and reference have no common time.
    """
    assert model.solved is not None
    reference, run = recording.reference, model.solved.run
    point = None if reference is None else reference_point(recording.inputs, reference.data)
    result, notes = evaluate_run(model.solved, reference, run.lever_b if point is None else point)
    evaluated = replace(result, noise=model.noise)
    return recording, replace(model, evaluated=evaluated), (*notes, *added(run.events, result.run.events))
