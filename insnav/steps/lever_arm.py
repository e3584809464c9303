"""Step 9: compare the specified lever arm with the estimate of the drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from insnav.filter.delay_and_lever import PRETENDED, WRONG, looked, pretended
from insnav.filter.receiver import LEVER_SD, LeverArm
from insnav.findings import Code, Finding, added
from insnav.steps import PREPARE, Model, Recording, run_steps
from insnav.steps.given import as_given

OPENED = 2.0  # standard deviation of each component in the pass that estimates it [m]
SURE = 6.0  # smallest reported error, in standard deviations of the estimate
MARGIN = 3.0  # additional margin in sd: noise identified with a wrong arm is too large


def lever_arm(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Keep the specified lever arm, or set the filter up without it if the drive contradicts it."""
    given, arm = model.ready, model.receiver.lever_arm
    assert given is not None
    if arm.source != "given" or given.receiver.lever_arm.sd or as_given(recording.inputs):
        return recording, model, ()
    run = looked(given, lever_sd=OPENED)
    off, limit = np.abs(run.lever_b - arm.value), np.maximum(WRONG, SURE * run.lever_sd)
    if not (off > limit).any():
        checked = Finding.of(Code.ESTIMATE_LEVER_ARM_CHECKED, detectable_m=tuple(limit + MARGIN * run.lever_sd))
        return recording, model, (checked,)
    unknown = replace(model.receiver, lever_arm=LeverArm(sd=LEVER_SD, source="prior"))
    other = run_steps(PREPARE, recording, replace(model, receiver=unknown, ready=None))[1]
    assert other.ready is not None
    if pretended(given, run) > PRETENDED:
        run = looked(other.ready)  # noise identified with a wrong arm includes its error
        hidden = min(pretended(other.ready, run), 1.0) * np.abs(arm.value)
        if not (np.abs(run.lever_b - arm.value) > limit + hidden).any():
            values: dict[str, Any] = {"difference_m": off.max(), "limit_m": limit.max()}
            values |= {"given_m": tuple(arm.value), "estimate_m": tuple(run.lever_b)}
            kept = Finding.of(Code.GIVEN_LEVER_ARM_KEPT, given.initial.time, **values)
            return recording, model, (kept,)
    return recording, replace(other, receiver=model.receiver), added(model.findings, other.findings)
