"""Step 10: run the filter, with available aiding, and the smoother over the drive."""

from __future__ import annotations

from dataclasses import replace

from insnav import spill
from insnav.filter.filter_input import Output
from insnav.filter.navigate import navigate_prepared
from insnav.filter.noise_identification import with_rest
from insnav.findings import Finding, added
from insnav.steps import Model, Recording


def navigate(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Run filter and smoother over the aligned recording.

    Raises: DivergenceError: the filter lost consistency.
    """
    assert model.ready is not None
    assert model.imu is not None
    task, explanation = model.task, model.explanation
    ready = replace(with_rest(model.ready, model.noise, model.imu[0]), output=task.output or Output())
    spill.trim()  # free the memory of the searches
    widen = None if explanation is None else explanation.widen
    source = "specification" if model.noise is None else "innovations"
    solved = navigate_prepared(
        ready, model.filter_imu, aiding=task.aiding, noise_source=source, widen=widen, progress=task.progress
    )
    run = replace(solved.run, gps_delay=solved.run.gps_delay + model.clock.value)
    navigated = replace(solved, run=run).report(model.findings)
    return recording, replace(model, ready=ready, solved=navigated), added(model.findings, solved.findings)
