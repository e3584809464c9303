"""Step 9: compare the specified lever arm with an estimate from the drive, after faults and noise are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from insnav.filter.delay_and_lever import PRETENDED, lever_off, looked, pretended
from insnav.findings import Code, Finding, added
from insnav.steps import PREPARE, Model, Recording, run_steps
from insnav.steps.given import as_given

MARGIN = 3.0  # added to the detectable error, in sd: noise estimated with a wrong arm is too large [-]


def lever_arm(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Keep the specified lever arm, or set the filter up without it if the drive contradicts it."""
    receiver, arm, alternative = model.receiver, model.receiver.lever_arm, model
    assert model.ready is not None
    if arm.source != "given" or arm.sd or as_given(recording.inputs):
        return recording, model, ()
    if rejected := model.ready.receiver.lever_arm.sd > 0.0:  # the alignment, without known faults, rejected the arm
        _, difference, limit = lever_off(model.ready, arm.value)
        if (difference > limit).any():
            return recording, model, ()
        given_arm = replace(model, receiver=replace(receiver, lever_arm=replace(arm, source="data")), ready=None)
        model = replace(run_steps(PREPARE, recording, given_arm)[1], receiver=receiver)
    given = model.ready
    assert given is not None
    run, difference, limit = lever_off(given, arm.value)
    if not (difference > limit).any():
        checked = Finding.of(Code.ESTIMATE_LEVER_ARM_CHECKED, detectable_m=tuple(limit + MARGIN * run.lever_sd))
        return recording, model, (checked,)
    if not rejected:
        unknown = replace(model, receiver=receiver.forget_lever_arm(), ready=None)
        alternative = run_steps(PREPARE, recording, unknown)[1]
    assert alternative.ready is not None
    if pretended(given, run) > PRETENDED:
        run = looked(alternative.ready)  # with the other noise: a wrong arm makes the noise too large
        hidden = min(pretended(alternative.ready, run), 1.0) * np.abs(arm.value)
        if not (np.abs(run.lever_b - arm.value) > limit + hidden).any():
            values: dict[str, Any] = {"difference_m": difference.max(), "limit_m": limit.max()}
            values |= {"given_m": tuple(arm.value), "estimate_m": tuple(run.lever_b)}
            kept = Finding.of(Code.GIVEN_LEVER_ARM_KEPT, given.initial.time, **values)
            return recording, model, (kept,)
    return recording, replace(alternative, receiver=receiver), added(model.findings, alternative.findings)
