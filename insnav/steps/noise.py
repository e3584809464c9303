"""Step 8: estimate the noise of IMU and fixes from the innovations of the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.filter.filter_input import FilterInput
from insnav.filter.noise_identification import identify_noise, with_known_noise, with_noise, with_usual_noise
from insnav.findings import Code, Finding, added
from insnav.imu.specification import ImuSpec
from insnav.steps import Model, Recording
from insnav.steps.given import as_given, better_kinds


def noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Estimate unspecified noise."""
    assert model.ready is not None
    assert model.imu is not None
    gps = model.ready.gps
    ready = _with_estimated_noise(recording, believe(model.ready), model.imu[0])
    # rejected fixes stay in the record, with the standard deviations of the others
    gps = replace(ready.gps, fix=gps.fix, v_n=gps.v_n)
    ready = replace(ready, gps=gps, explained=model.ready.explained)
    return recording, replace(model, ready=ready), added(model.ready.findings, ready.findings)


def _with_estimated_noise(recording: Recording, ready: FilterInput, spec: ImuSpec) -> FilterInput:
    alone = "estimate" if recording.inputs.get("imu_model") is None else "fixes"  # fixes: their time-correlated errors
    wanted = "model" if recording.gps is None else recording.inputs.get("noise") or alone
    if wanted != "estimate":
        claimed = recording.gps is None or bool(np.isfinite(recording.gps.data.position_sd).all())
        known = with_known_noise(ready, spec, lasting=wanted == "fixes", sizes=not claimed)
        return replace(ready, faults=known.faults) if as_given(recording.inputs) else known
    found = identify_noise(ready, spec, better_kinds(recording.inputs, spec))
    if found is None:
        kept = Finding.of(Code.IMU_MODEL_KEPT, subject="imu", model=spec.name)
        return with_usual_noise(ready.add_notes(kept))
    return with_noise(ready, found)


def believe(ready: FilterInput) -> FilterInput:
    """Remove the fixes that faults concern: their noise is not typical."""
    explained, gps, time = ready.explained, ready.gps, ready.fix_time
    if explained.false is None and not explained.rough:
        return ready
    position, velocity = np.zeros((2, time.size), dtype=np.bool_) if explained.false is None else explained.false
    position = np.any([position, *((time >= each.begin) & (time < each.end) for each in explained.rough)], axis=0)
    fix = np.where(position, 0, 1 if gps.fix is None else gps.fix)
    gps = replace(gps, fix=fix, v_n=np.where(velocity[:, None], np.nan, gps.v_n))
    return replace(ready, gps=gps, explained=replace(explained, false=None))
