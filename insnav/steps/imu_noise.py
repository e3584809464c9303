"""Step 4: choose an unspecified IMU error specification by the noise at rest, or compare the specified one with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from insnav.findings import Code, Finding
from insnav.imu import load_imu
from insnav.imu.noise_density import mean_rate, nearest_preset, raise_to_rest, rate_excess, white_noise
from insnav.imu.specification import ImuSpec
from insnav.steps import Model, Recording
from insnav.steps.given import as_given, stationary_part
from insnav.types import ImuData

SHORTEST_REST = 5.0  # shorter intervals do not determine the noise of an IMU [s]
DENSITY_SD = 0.18  # relative sd of a noise density from a short rest; see `insnav.imu.noise_density.white_noise` [-]
UNLIKE = 3.0  # noise or bias this many sd above the specification contradicts it [-]


def imu_noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Choose the specification of the IMU, or raise a specified one if the noise at rest is larger."""
    chosen, samples, findings = model.imu, recording.imu.data, tuple[Finding, ...]()
    if chosen is None or not as_given(recording.inputs):
        rest = stationary_part(samples, recording.fixes, recording.inputs)
        if chosen is None:
            chosen = imu_from_rest(samples, rest)
        elif rest is not None and rest[1] - rest[0] >= SHORTEST_REST:
            spec, findings = raise_given(chosen[0], samples, rest)
            chosen = spec, chosen[1]
    return recording, replace(model, imu=chosen), (*chosen[1:], *findings)


def raise_given(spec: ImuSpec, imu: ImuData, rest: tuple[float, float]) -> tuple[ImuSpec, tuple[Finding, ...]]:
    """Raise a specification that the gyros at rest contradict, and report it. `rest`: stationary interval [s]."""
    gyro, accel = white_noise(imu, *rest)
    worst = int(np.argmax(gyro - (1.0 + UNLIKE * DENSITY_SD) * spec.gyro.random_walk))
    noise, given = float(gyro[worst]), float(spec.gyro.random_walk[worst])
    mean, rounded = mean_rate(imu, *rest)
    excess = rate_excess(mean)
    biased = excess > UNLIKE * np.hypot(spec.gyro.bias, rounded).max()
    if noise <= (1.0 + UNLIKE * DENSITY_SD) * given and not biased:
        return spec, ()
    values: dict[str, Any] = {"noise_rad_sqrt_s": noise, "given_rad_sqrt_s": given}
    values |= {"bias_rad_s": excess} if biased else {}
    return raise_to_rest(spec, gyro, accel, excess, rounded), (Finding.of(Code.GIVEN_IMU_MODEL, *rest, **values),)


def imu_from_rest(imu: ImuData, rest: tuple[float, float] | None) -> tuple[ImuSpec, Finding]:
    """Choose an IMU model by the noise of a stationary interval `rest` [s], and report its source."""
    if rest is None or rest[1] - rest[0] < SHORTEST_REST:
        spec = load_imu("consumer")
        return spec, Finding.of(Code.IMU_MODEL_ASSUMED, limit_s=SHORTEST_REST, preset=spec.name)
    gyro, accel = white_noise(imu, *rest)
    spec, _ = nearest_preset(gyro, accel, *mean_rate(imu, *rest))
    noise: dict[str, Any] = {"gyro_noise_rad_sqrt_s": float(gyro.max()), "accel_noise_m_s_sqrt_s": float(accel.max())}
    return spec, Finding.of(Code.IMU_MODEL_FROM_REST, *rest, **noise, preset=spec.name)
