"""Step 10: run the filter over the drive, with available aiding, and the smoother."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav import spill
from insnav.filter.navigate import dense, navigate_prepared
from insnav.filter.noise_identification import with_careful_biases
from insnav.findings import Finding, added
from insnav.steps import Model, Recording
from insnav.steps.given import vector


def navigate(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Navigate the drive.

    Raises: DivergenceError: the filter lost consistency.
    """
    assert model.ready is not None
    assert model.imu is not None
    task = model.task
    ready = with_careful_biases(model.ready, model.imu[0])
    settings = replace(
        ready.settings,
        smooth=task.smooth,
        output_interval=dense(task.output_interval),
        epochs=np.asarray(task.epochs, dtype=np.float64),
        point_b=vector("point", task.point),
    )
    ready = replace(ready, settings=settings)
    spill.trim()  # arrays of the searches
    solved = navigate_prepared(ready, model.filter_imu, aiding=task.aiding, progress=task.progress)
    return recording, replace(model, ready=ready, solved=solved), added(ready.findings, solved.findings)
