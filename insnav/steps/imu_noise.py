"""Step 4: choose an unspecified IMU error specification by the noise of a stationary interval."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from insnav.alignment import find_stationary
from insnav.filter.prepare import first_stationary
from insnav.findings import Code, Finding
from insnav.imu import load_imu
from insnav.imu.noise_density import mean_rate, nearest_preset, white_noise
from insnav.imu.specification import ImuSpec
from insnav.steps import Model, Recording
from insnav.steps.inputs import Inputs
from insnav.strapdown import intervals
from insnav.types import GpsData, ImuData

SHORTEST_REST = 5.0  # shorter intervals do not determine the noise of an IMU [s]


def imu_noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Choose the specification of the IMU."""
    chosen, samples = model.imu, recording.imu.data
    if chosen is None:
        chosen = imu_from_rest(samples, stationary_part(samples, recording.fixes, recording.inputs))
    return recording, replace(model, imu=chosen), chosen[1:]


def imu_from_rest(imu: ImuData, rest: tuple[float, float] | None) -> tuple[ImuSpec, Finding]:
    """Choose an IMU model by the noise of a stationary interval, and report its source.

    `rest`: its start and end [s].
    """
    if rest is None or rest[1] - rest[0] < SHORTEST_REST:
        spec = load_imu("consumer")
        return spec, Finding.of(Code.IMU_MODEL_ASSUMED, limit_s=SHORTEST_REST, preset=spec.name)
    gyro, accel = white_noise(imu, *rest)
    spec, _ = nearest_preset(gyro, accel, *mean_rate(imu, *rest))
    noise: dict[str, Any] = {"gyro_noise_rad_sqrt_s": float(gyro.max()), "accel_noise_m_s_sqrt_s": float(accel.max())}
    return spec, Finding.of(Code.IMU_MODEL_FROM_REST, *rest, **noise, preset=spec.name)


def stationary_part(imu: ImuData, fixes: GpsData | None, inputs: Inputs) -> tuple[float, float] | None:
    """Return the specified stationary interval, else the first one by IMU and GPS, or by the IMU alone [s]."""
    span = inputs.get("static")
    if span is not None:
        return span
    return find_stationary(intervals(imu)) if fixes is None else first_stationary(imu, fixes)
