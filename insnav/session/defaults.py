"""What insnav assumes about a drive where nothing was given: the same for every command and every notebook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.alignment import find_stationary
from insnav.errors.outage.window_reference import is_stationary, stationary_fixes
from insnav.exceptions import InputError
from insnav.filter import FilterSettings
from insnav.filter.gps_noise import with_sd
from insnav.filter.prepare import DELAY_SD, first_stationary
from insnav.findings import Code, untyped_event
from insnav.imu import identify, load_imu
from insnav.imu.imu_file import part_of
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


def given_imu(model: object) -> tuple[ImuSpec, str] | None:
    """IMU model as given, and how; None if it is left to the data.

    What the documents of a real part do not say is taken from its class: a filter takes zero for certain.
    """
    if model is None:
        return None
    part = None if isinstance(model, ImuSpec) else part_of(str(model))
    if part is not None:
        from insnav.imu.library import completed

        spec, taken = completed(part, load_imu(part.grade))
        said = f"; of the class {part.grade}, as its documents do not give it: {', '.join(taken)}" if taken else ""
        return spec, f"from --imu {model}{said}"
    if isinstance(model, ImuSpec):
        spec, how = model, "given"
    else:
        spec, how = load_imu(str(model)), f"from --imu {model}"
    return spec, f"{how}; not given, taken as zero: {', '.join(spec.absent)}" if spec.absent else how


def imu_from_rest(imu: ImuData, rest: tuple[float, float] | None) -> tuple[ImuSpec, str]:
    """IMU model from the noise of a stationary part, and how it was chosen.

    `rest`: its start and end [s].
    """
    if rest is None or rest[1] - rest[0] < SHORTEST_REST:
        reason = f"no static part of {SHORTEST_REST:g} s shows the noise"
        return load_imu("consumer"), f"assumed, as {reason}; choose another with --imu"
    spec, sentence = identify(imu, *rest)
    return spec, sentence.rstrip(".")


def stationary_part(imu: ImuData, fixes: GpsData | None, inputs: Inputs) -> tuple[float, float] | None:
    """Stationary interval as given, else the first one by IMU and GPS, or by the IMU alone [s]."""
    span = inputs.get("static")
    if span is not None:
        return span
    return find_stationary(intervals(imu)) if fixes is None else first_stationary(imu, fixes)


def complete_fixes(
    imu: ImuData, gps: Reading[GpsData] | None, reference: Reading[Trajectory] | None
) -> tuple[GpsData | None, tuple[str, ...]]:
    """Fixes with a standard deviation for every value, and what was assumed; None if there is no position.

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
    return stationary_fixes(reference.data.lla[0], begin, end, *BENCH_SD), (
        "No GPS: the reference says the vehicle never moves",
    )


def with_scales_told(gps: Reading[GpsData] | None) -> Reading[GpsData] | None:
    """Fixes with an event if their positions do not move as far as the velocities beside them say."""
    if gps is None or not (wrong := scales(gps.data.time, gps.data.lla, gps.data.v_n)):
        return gps
    far = " and ".join(f"{size:.2f} ± {max(sd, 0.01):.2f} times as far {name}" for name, size, sd in wrong)
    told = (
        f"positions of the fixes move {far} as the velocities beside them say: a scale of either is wrong, and the "
        "solution follows what is stated to be more precise"
    )
    largest = max(abs(size - 1.0) for _, size, _ in wrong)
    event = untyped_event(float(gps.data.time[0]), Code.CONTRADICTION, largest, float("nan"), "", told)
    return replace(gps, events=(*gps.events, event))


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
