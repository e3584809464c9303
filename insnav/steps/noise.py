"""Step 8: estimate the noise of IMU and fixes from the innovations of the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.filter.filter_input import FilterInput
from insnav.filter.noise_estimate import NoiseEstimate
from insnav.filter.noise_identification import identify_noise, with_known_noise, with_noise, with_usual_noise
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.steps import Model, Recording
from insnav.steps.given import as_given, better_kinds


def noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Estimate the noise that the user has not specified, and apply it to the filter input."""
    assert model.ready is not None
    assert model.imu is not None
    gps = model.ready.gps
    ready, estimate, findings = _with_estimated_noise(recording, believe(model.ready), model.imu[0])
    # restore the fixes with faults, whose standard deviations are scaled as well
    gps = replace(ready.gps, fix=gps.fix, v_n=gps.v_n)
    ready = replace(ready, gps=gps, explained=model.ready.explained)
    return recording, replace(model, ready=ready, noise=estimate), findings


def _with_estimated_noise(
    recording: Recording, ready: FilterInput, spec: ImuSpec
) -> tuple[FilterInput, NoiseEstimate | None, tuple[Finding, ...]]:
    inputs, gps = recording.inputs, recording.gps
    wanted = inputs.get("noise") or ("estimate" if inputs.get("imu_model") is None else "fixes")
    if gps is None or wanted != "estimate":
        estimate_correlated = gps is not None and wanted == "fixes"
        reported = gps is None or bool(np.isfinite(gps.data.position_sd).all())
        prepared, findings = with_known_noise(ready, spec, lasting=estimate_correlated, sizes=not reported)
        if as_given(inputs):
            return ready, None, tuple(each for each in findings if each.timed)
        return prepared, None, findings
    estimate = identify_noise(ready, spec, better_kinds(inputs, spec))
    if estimate is None:
        kept = Finding.of(Code.IMU_MODEL_KEPT, subject="imu", model=spec.name)
        ready, findings_usual = with_usual_noise(ready)
        return ready, None, (kept, *findings_usual)
    ready, findings = with_noise(ready, estimate)
    return ready, estimate, findings


def believe(ready: FilterInput) -> FilterInput:
    """Invalidate fixes with faults for the noise estimate: their noise is not typical."""
    explained, gps, time = ready.explained, ready.gps, ready.fix_time
    if explained.false is None and not explained.rough:
        return ready
    position, velocity = np.zeros((2, time.size), dtype=np.bool_) if explained.false is None else explained.false
    position = np.any([position, *((time >= each.begin) & (time < each.end) for each in explained.rough)], axis=0)
    fix = np.where(position, 0, 1 if gps.fix is None else gps.fix)
    gps = replace(gps, fix=fix, v_n=np.where(velocity[:, None], np.nan, gps.v_n))
    return replace(ready, gps=gps, explained=replace(explained, false=None))
