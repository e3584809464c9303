"""Step 7: find the faults of fixes, clock and IMU, so that noise and solution do not depend on faulty data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from insnav.explain.explanation import Explanation, Fault, explain_faults, find
from insnav.explain.kinds import with_priors
from insnav.filter.filter_input import FilterInput
from insnav.findings import Finding
from insnav.steps import ALIGN, Model, Recording, run_steps
from insnav.types import GpsData

ROUNDS = 3  # largest number of searches with fix times corrected for delay steps


def explain(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Find the faults of a recording. If the delay of the fixes changes, correct the fixes and align again."""
    if recording.inputs.get("explain") == "off":
        return recording, model, ()
    assert model.ready is not None
    assert recording.fixes is not None
    kinds = with_priors(recording.inputs.get("faults") or {})
    before, fixes, late = model.ready, recording.fixes, list[Fault]()
    rounds = list[Explanation]()
    ready, explanation = explain_faults(before, kinds)
    for _ in range(ROUNDS):
        steps = explanation.of_delay()
        if not steps:
            break
        late += steps
        rounds.append(explanation)
        fixes = put_on_one_delay(fixes, before, steps, model.clock.value)
        model = run_steps(ALIGN, replace(recording, fixes=fixes), model)[1]
        assert model.ready is not None
        before = model.ready
        ready, explanation = explain_faults(before, kinds)
    explanation = replace(explanation.after(rounds), faults=(*late, *explanation.faults))
    findings = (*(find(step, fixes) for step in late), *explanation.findings)
    # do not store the corrected fixes: a repetition with another lever arm searches their delay again
    return recording, replace(model, ready=ready, explanation=explanation), findings


def put_on_one_delay(fixes: GpsData, ready: FilterInput, steps: Sequence[Fault], clock: float) -> GpsData:
    """Correct fix times for steps of the delay: all fixes get the smallest delay, as receivers start on time, then lag.

    `clock`: mean delay of the fixes by the alignment [s].
    """
    # errors are estimate minus truth: an increase of the delay makes a negative error
    late = -np.sum([step.size[0] * step.inside(fixes.time - ready.receiver.delay.value) for step in steps], axis=0)
    delay = clock + late - late.mean()
    smallest = late[int(np.argmin(np.abs(delay)))]
    time = fixes.time - (late - smallest)
    # drop fixes whose corrected time is not after all earlier ones
    kept = time > np.maximum.accumulate(np.concatenate([[-np.inf], time[:-1]]))
    return replace(fixes, time=time).rows(np.flatnonzero(kept))
