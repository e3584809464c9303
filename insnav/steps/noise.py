"""Step 7: estimate the noise of IMU and fixes from the innovations of the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.filter.noise_identification import identify_noise, with_known_noise, with_noise, with_usual_noise
from insnav.filter.prepare import Prepared
from insnav.findings import Code, Finding, added
from insnav.imu.specification import ImuSpec
from insnav.input import Reading
from insnav.steps import Model, Recording
from insnav.steps.given import better_kinds
from insnav.steps.inputs import Inputs, NoiseChoice
from insnav.types import GpsData


def noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Estimate the noise, as far as it was not given."""
    assert model.ready is not None
    assert model.imu is not None
    believed = believe(model.ready)
    ready = _with_estimated_noise(recording, believed, model.imu[0])
    # fixes that are left out stay in the record, with the standard deviations of the others
    gps, at = model.ready.gps, model.ready
    if believed.gps is not gps:
        scaled = at.apply_noise(ready.noise) if ready.noise is not None else at
        ready = replace(ready, gps=scaled.gps, settings=replace(ready.settings, trust=at.settings.trust))
    return recording, replace(model, ready=ready), added(model.ready.findings, ready.findings)


def _with_estimated_noise(recording: Recording, ready: Prepared, spec: ImuSpec) -> Prepared:
    wanted = noise_wanted(recording.inputs, recording.gps)
    if wanted != "estimate":
        claimed = recording.gps is None or bool(np.isfinite(recording.gps.data.position_sd).all())
        return with_known_noise(ready, spec, lasting=wanted == "fixes", sizes=not claimed)
    ready = replace(ready, kinds=better_kinds(recording.inputs, spec))
    found = identify_noise(ready, spec)
    if found is None:
        kept = Finding.of(Code.IMU_MODEL_KEPT, subject="imu", model=spec.name)
        return with_usual_noise(replace(ready, notes=(*ready.notes, kept)))
    return with_noise(ready, found)


def believe(ready: Prepared) -> Prepared:
    """The recording without the fixes that its faults concern: their noise is not that of the others."""
    settings, gps, time = ready.settings, ready.gps, ready.gps.time - ready.settings.delay
    if settings.trust is None and not settings.rough:
        return ready
    none = np.zeros((2, time.size), dtype=np.bool_)
    false = none if settings.trust is None else settings.trust.false
    rough = np.any([(time >= each.begin) & (time < each.end) for each in settings.rough] or [none[0]], axis=0)
    gps = replace(gps, v_n=np.where(false[1][:, None], np.nan, gps.v_n)).rows(np.flatnonzero(~false[0] & ~rough))
    return replace(ready, gps=gps, settings=replace(settings, trust=None))


def noise_wanted(inputs: Inputs, gps: Reading[GpsData] | None) -> NoiseChoice:
    """Return which noise is estimated: as given, else all; with an IMU model, the time-correlated errors of fixes."""
    if gps is None:
        return "model"
    return inputs.get("noise") or ("estimate" if inputs.get("imu_model") is None else "fixes")
