"""Step 7: find the faults of fixes, clock and IMU in the record, so that noise and solution are those of the rest."""

from __future__ import annotations

from dataclasses import replace

from insnav.explain.explanation import explain_faults
from insnav.explain.kinds import KINDS
from insnav.findings import Finding
from insnav.steps import Model, Recording


def explain(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Find the faults of a recording."""
    assert model.ready is not None
    ready, explanation = explain_faults(model.ready, KINDS)
    ready = replace(ready, faults=(*ready.faults, *explanation.findings))
    return recording, replace(model, ready=ready), explanation.findings
