"""What insnav assumes about a drive where nothing was given: the same for every command and every notebook."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from insnav.alignment import find_stationary
from insnav.errors.outage.window_reference import is_stationary, stationary_fixes
from insnav.exceptions import InputError
from insnav.filter import FilterSettings
from insnav.filter.gps_noise import with_sd
from insnav.filter.prepare import DELAY_SD, first_stationary
from insnav.findings import Code, Finding
from insnav.imu import identify, load_imu
from insnav.imu.imu_file import part_of
from insnav.imu.noise_density import white_noise
from insnav.imu.presets import PRESETS
from insnav.imu.specification import ImuSpec
from insnav.input import Reading
from insnav.input.interpret.velocities import fit_velocities, scales
from insnav.session.checked_inputs import vector
from insnav.session.inputs import Inputs, NoiseChoice
from insnav.strapdown import intervals
from insnav.types import GpsData, ImuData, SensorLog, Trajectory

SHORTEST_REST = 5.0  # shorter ones do not show the noise of an IMU [s]
BENCH_SD = (0.01, 0.005)  # how well a place that is not left is known [m], [m/s]
LEVER_SD = 1.0  # of each component of a lever arm that was not given: antenna and IMU are on one vehicle [m]
REFERENCE_SD = (0.05, None)  # of reference positions; velocities count only if theirs is given [m], [m/s]


def given_imu(model: object) -> tuple[ImuSpec, Finding] | None:
    """IMU model as given, and its source; None if it is left to the data.

    What the documents of a real part do not say is taken from its class: a filter takes zero for certain.
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


def imu_from_rest(imu: ImuData, rest: tuple[float, float] | None) -> tuple[ImuSpec, Finding]:
    """IMU model from the noise of a stationary part, and its source.

    `rest`: its start and end [s].
    """
    if rest is None or rest[1] - rest[0] < SHORTEST_REST:
        spec = load_imu("consumer")
        return spec, Finding.of(Code.IMU_MODEL_ASSUMED, limit_s=SHORTEST_REST, preset=spec.name)
    spec, _ = identify(imu, *rest)
    gyro, accel = (float(np.max(density)) for density in white_noise(imu, *rest))
    noise: dict[str, Any] = {"gyro_noise_rad_sqrt_s": gyro, "accel_noise_m_s_sqrt_s": accel}
    return spec, Finding.of(Code.IMU_MODEL_FROM_REST, *rest, **noise, preset=spec.name)


def stationary_part(imu: ImuData, fixes: GpsData | None, inputs: Inputs) -> tuple[float, float] | None:
    """Stationary interval as given, else the first one by IMU and GPS, or by the IMU alone [s]."""
    span = inputs.get("static")
    if span is not None:
        return span
    return find_stationary(intervals(imu)) if fixes is None else first_stationary(imu, fixes)


def complete_fixes(
    imu: ImuData, gps: Reading[GpsData] | None, reference: Reading[Trajectory] | None
) -> tuple[GpsData | None, tuple[Finding, ...]]:
    """Fixes with a standard deviation for every value, and findings; None if there is no position.

    Without GPS, a reference that never moves stands for it: the place of a bench.
    """
    if reference is not None:
        refuse_confused(reference, "--ref-columns", velocities=False)
    if gps is not None:
        refuse_confused(gps)
        return with_sd(gps.data, scatter_alone=False)
    begin, end = float(imu.time[0]), float(imu.time[-1])
    if reference is None or not is_stationary(reference.data, begin, end):
        return None, ()
    found = Finding.of(Code.GPS_FROM_REFERENCE, subject="reference")
    return stationary_fixes(reference.data.lla[0], begin, end, *BENCH_SD), (found,)


def with_scales_checked(gps: Reading[GpsData] | None) -> Reading[GpsData] | None:
    """Fixes with a finding for every axis along which positions do not move as far as their velocities imply."""
    if gps is None:
        return None
    begin = float(gps.data.time[0])
    wrong = scales(gps.data.time, gps.data.lla, gps.data.v_n)
    found = (Finding.of(Code.GPS_SCALE, begin, subject="gps", ratio=size, sd=sd, axis=axis) for axis, size, sd in wrong)
    return replace(gps, events=(*gps.events, *found))


def refuse_confused(
    read: Reading[GpsData] | Reading[Trajectory], option: str = "--gps-columns", *, velocities: bool = True
) -> None:
    """Refuse positions and velocities that contradict each other in a way that has a name.

    `velocities`: also where it is these that are wrong.
    """
    fit = fit_velocities(read.data.time, read.data.lla, read.data.v_n)
    if fit is not None and fit.confusion and (velocities or fit.misplaced):
        raise InputError(
            f"positions and velocities of the {'fixes' if velocities else 'reference'} contradict each other: it looks "
            f"as if {fit.confusion}",
            where=read.facts.path,
            why="displacements fit the velocities only so",
            fix=f"name the right columns and units with {option}, or mend the file",
        )


def better_kinds(inputs: Inputs, chosen: ImuSpec) -> tuple[ImuSpec, ...]:
    """What IMU it may be beside the one chosen, if none was given: no poorer one, whose noise would hold faults."""
    if inputs.get("imu_model") is not None:
        return ()
    return tuple(map(load_imu, PRESETS[PRESETS.index(chosen.name) + 1 :]))


def noise_wanted(inputs: Inputs, gps: Reading[GpsData] | None) -> NoiseChoice:
    """What is looked for in the innovations: as given, else all; with an IMU model what lasts of the fixes' errors."""
    if gps is None:
        return "model"
    return inputs.get("noise") or ("estimate" if inputs.get("imu_model") is None else "fixes")


def filter_settings(inputs: Inputs, logs: tuple[SensorLog, ...], gps: Reading[GpsData] | None) -> FilterSettings:
    """Settings of the filter; delay and lever arm are estimated unless given."""
    lever_b, delay = vector(inputs, "lever_arm"), inputs.get("gps_delay")
    lever_sd = inputs.get("lever_arm_sd")
    if lever_sd is None:
        lever_sd = LEVER_SD if lever_b is None and gps is not None else 0.0
    return FilterSettings(
        lever_b=np.zeros(3) if lever_b is None else lever_b,
        lever_sd=lever_sd,
        delay=delay or 0.0,
        delay_sd=DELAY_SD if delay is None and gps is not None else 0.0,
        heading_sd=inputs.get("gps_heading_sd") or 0.0,
        fixed_height_sd=inputs.get("fixed_height_sd") or 0.0,
        logs=logs,
    )
