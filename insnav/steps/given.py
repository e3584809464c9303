"""The estimates before any data are looked at: what the user gave, and priors for the rest."""

from __future__ import annotations

import numpy as np

from insnav.filter.prepare import DELAY_SD
from insnav.findings import Code, Finding
from insnav.imu import load_imu
from insnav.imu.imu_file import part_of
from insnav.imu.presets import PRESETS
from insnav.imu.specification import ImuSpec
from insnav.steps import Estimate, Model, Recording
from insnav.steps.checked_inputs import vector
from insnav.steps.inputs import Inputs

LEVER_SD = 1.0  # of each component of a lever arm that was not given: antenna and IMU are on one vehicle [m]


def given_model(recording: Recording) -> Model:
    """Return what the user gave; the filter estimates lever arm and delay unless they are given."""
    inputs, fixes = recording.inputs, recording.gps is not None
    lever_b, lever_sd, delay = vector(inputs, "lever_arm"), inputs.get("lever_arm_sd"), inputs.get("gps_delay")
    if lever_sd is None:
        lever_sd = LEVER_SD if lever_b is None and fixes else 0.0
    return Model(
        free_lever_arm(lever_sd) if lever_b is None else Estimate(lever_b, lever_sd, "given"),
        Estimate(0.0, DELAY_SD * fixes, "prior") if delay is None else Estimate(delay, 0.0, "given"),
        given_imu(inputs.get("imu_model")),
    )


def free_lever_arm(sd: float = LEVER_SD) -> Estimate[np.ndarray]:
    """Return the prior of a lever arm, `sd` [m]."""
    return Estimate(np.zeros(3), sd, "prior")


def given_imu(model: object) -> tuple[ImuSpec, Finding] | None:
    """Return the IMU model as given, and its source; None if it is left to the data.

    What the documents of a real part do not state is taken from its class: a filter takes zero for certain.
    """
    if model is None:
        return None
    part = None if isinstance(model, ImuSpec) else part_of(str(model))
    if part is not None:
        from insnav.imu.library import completed

        spec, taken = completed(part, load_imu(part.grade))
        return spec, Finding.of(Code.IMU_MODEL_PART, model=str(model), grade=part.grade, taken=taken)
    if isinstance(model, ImuSpec):
        return model, Finding.of(Code.IMU_MODEL_GIVEN, absent=model.absent)
    spec = load_imu(str(model))
    return spec, Finding.of(Code.IMU_MODEL_FILE, model=str(model), absent=spec.absent)


def better_kinds(inputs: Inputs, chosen: ImuSpec) -> tuple[ImuSpec, ...]:
    """Return the better grades that the IMU may be if none was given; the noise of a poorer one would hold faults."""
    if inputs.get("imu_model") is not None:
        return ()
    return tuple(map(load_imu, PRESETS[PRESETS.index(chosen.name) + 1 :]))
