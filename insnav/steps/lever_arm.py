"""Step 9: compare the specified lever arm with the estimate of the drive."""

from __future__ import annotations

from dataclasses import replace

from insnav.filter.delay_and_lever import with_right_lever
from insnav.filter.prepare import Prepared
from insnav.findings import Finding, added
from insnav.steps import PREPARE, Model, Recording, run_steps
from insnav.steps.given import as_given, free_lever_arm


def lever_arm(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Keep the specified lever arm, or set the filter up without it if the drive contradicts it."""
    assert model.ready is not None
    if model.lever_arm.source != "given" or model.ready.settings.lever_sd or as_given(recording.inputs):
        return recording, model, ()

    def estimated() -> Prepared:
        other = run_steps(PREPARE, recording, replace(model, lever_arm=free_lever_arm(), ready=None))[1]
        assert other.ready is not None
        return other.ready

    ready = with_right_lever(model.ready, estimated)
    return recording, replace(model, ready=ready), added(model.ready.findings, ready.findings)
