"""The part of ``insnav budget`` that takes a recorded drive: from its options to the recorded half of the budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insnav.cli import parse
from insnav.cli.console import note, note_more

if TYPE_CHECKING:
    from insnav.cli.options import Height, SamplingChoice, StampChoice
    from insnav.errors.budget.from_windows import RecordedBudget
    from insnav.errors.outage.window_reference import WindowReference
    from insnav.imu import ImuSpec
    from insnav.input import Reading
    from insnav.types import GpsData, ImuData, Trajectory

REST_SD = (0.01, 0.005)  # how well a place that is not left is known [m], [m/s]
REFERENCE_SD = "0.05"


class StartFrom(StrEnum):
    """What windows begin with."""

    forward = "forward"
    smoothed = "smoothed"


@dataclass(frozen=True, slots=True)
class RecordedOptions:
    """Options as they were given; those that `insnav outage` has too mean the same.

    Attributes
    ----------
    imu_file : Path
    gps, ref : Path or None
        Without `gps` the reference must say that the vehicle is at rest all the time.
    ref_sd : str
        Uncertainty of the reference: of positions, and after a comma of velocities, which count only then [m], [m/s].
    window, first, spacing : float or None
        Of the windows [s].
    start : StartFrom
    raw : bool
    twins, seed, workers : int
    """

    imu_file: Path
    gps: Path | None = None
    ref: Path | None = None
    imu: str | None = None
    calibration: Path | None = None
    imu_axes: str | None = None
    imu_units: str | None = None
    columns: str | None = None
    imu_sampling: SamplingChoice | None = None
    imu_stamp: StampChoice | None = None
    lever_arm: str | None = None
    lever_arm_sd: float = 0.0
    gps_height: Height | None = None
    gps_delay: float | None = None
    gps_columns: str | None = None
    ref_lever_arm: str | None = None
    ref_columns: str | None = None
    ref_sd: str = REFERENCE_SD
    window: float = 60.0
    first: float | None = None
    spacing: float | None = None
    start: StartFrom = StartFrom.forward
    raw: bool = False
    twins: int = 20
    seed: int = 0
    workers: int = 2


@dataclass(frozen=True, slots=True)
class RecordedResult:
    """What came of it.

    Attributes
    ----------
    budget : RecordedBudget
    spec : ImuSpec
    readings : dict
        What was understood of each file, JSON-ready.
    name : str
        Of the drive.
    """

    budget: RecordedBudget
    spec: ImuSpec
    readings: dict[str, Any]
    name: str


def recorded(options: RecordedOptions, stage: Callable[..., None]) -> RecordedResult:
    """Read the files, align, navigate, cut into windows.

    Parameters
    ----------
    options : RecordedOptions
    stage : callable
        Told the name of each stage, and the fraction of it that is done.

    Raises
    ------
    ConfigError, InputError, AlignmentError
        What cannot be meant, or used.
    """
    import numpy as np

    from insnav.cli import inputs
    from insnav.filter import FilterSettings
    from insnav.filter.prepare import DELAY_SD

    lever_b = parse.vector(options.lever_arm, "--lever-arm") if options.lever_arm else np.zeros(3)
    delay = None if options.gps_delay is None else parse.finite(options.gps_delay, "--gps-delay", largest=10.0)
    for value, name in ((options.window, "--window"), (options.first, "--first"), (options.spacing, "--spacing")):
        if value is not None:
            parse.finite(value, name, largest=1e5)
    parse.at_least_one(options.workers, "--workers", "processes")
    known_sd = parse.positive_numbers(options.ref_sd, "--ref-sd", "0.05,0.02")
    inputs.one_standard_input(imu_file=options.imu_file, gps=options.gps, ref=options.ref)
    told = inputs.chosen_imu(options.imu)
    stage("reading")
    from insnav.errors.budget.from_windows import WindowSettings, recorded_budget
    from insnav.filter.gps_noise import with_sd
    from insnav.filter.prepare import first_rest, prepare
    from insnav.input import check_overlap

    fixes = inputs.read_fixes(options.gps, options.gps_columns, options.gps_height) if options.gps else None
    reference = inputs.read_truth(options.ref, options.ref_columns) if options.ref else None
    reading = inputs.read_samples(
        options.imu_file,
        options.imu_axes,
        options.columns,
        options.imu_units,
        options.imu_sampling,
        options.imu_stamp,
        options.calibration,
    )
    facts = {
        name: each.facts
        for name, each in (("imu", reading), ("gps", fixes), ("reference", reference))
        if each is not None
    }
    for each in facts.values():
        inputs.say_reading(each)
    samples = reading.data
    if fixes is not None:
        check_overlap(reading.data, fixes.data)
        complete, assumed = with_sd(fixes.data)
    else:
        complete, assumed = _fixes_at_rest(samples, reference), ("No GPS: the reference says the vehicle never moves",)
    stage("aligning")
    spec, said = told or inputs.imu_from_rest(samples, first_rest(samples, complete))
    note(f"IMU model: {spec.name}")
    note_more(said)
    settings = FilterSettings(
        lever_b=lever_b,
        lever_sd=parse.not_negative(options.lever_arm_sd, "--lever-arm-sd", largest=10.0),
        delay=delay or 0.0,
        delay_sd=DELAY_SD if delay is None and fixes is not None else 0.0,
    )
    ready = prepare(samples, complete, spec, settings)
    stage("navigating")
    budget = recorded_budget(
        ready,
        spec,
        _judge(options, reference, known_sd) if fixes is not None and reference is not None else None,
        WindowSettings(
            options.window,
            options.first,
            options.spacing,
            options.start.value,
            options.raw,
            options.twins,
            options.seed,
            options.workers,
        ),
        lambda fraction: stage("navigating", fraction),
    )
    said_of_imu = () if told else (f"IMU file: none was given; {spec.name}: {said}",)
    return RecordedResult(
        replace(budget, notes=(*assumed, *said_of_imu, *budget.notes)),
        spec,
        {name: each.as_dict() for name, each in facts.items()},
        Path(reading.facts.path).name,
    )


def _fixes_at_rest(samples: ImuData, reference: Reading[Trajectory] | None) -> GpsData:
    """Fixes of the one place of a bench."""
    from insnav.errors.outage.window_reference import is_stationary, stationary_fixes
    from insnav.exceptions import ConfigError

    begin, end = float(samples.time[0]), float(samples.time[-1])
    if reference is None or not is_stationary(reference.data, begin, end):
        raise ConfigError(
            "nothing tells where the vehicle was",
            where="--gps",
            why="there are no fixes"
            + (", and no reference" if reference is None else ", and by the reference it moves"),
            fix="give fixes with --gps; for a bench, --ref with its place at the begin and the end, velocity zero",
        )
    return stationary_fixes(reference.data.lla[0], begin, end, *REST_SD)


def _judge(options: RecordedOptions, reference: Reading[Trajectory], known_sd: list[float]) -> WindowReference:
    """The reference, where its ambiguities are fixed if the file tells."""
    import numpy as np

    from insnav.errors.outage.window_reference import reference_from_trajectory

    data, fix = reference.data, reference.fix
    keep = np.ones(len(data.time), dtype=np.bool_) if fix is None or not (fix == 1).any() else np.asarray(fix == 1)
    with_velocity = len(known_sd) > 1
    data = data.rows(keep)
    if not with_velocity:
        data = replace(data, v_n=np.full_like(data.v_n, np.nan))
    lever = options.ref_lever_arm or options.lever_arm
    return reference_from_trajectory(
        data,
        f"the positions of {Path(reference.facts.path).name}",
        position_sd=known_sd[0],
        velocity_sd=known_sd[1] if with_velocity else 1.0,
        lever_b=parse.vector(lever, "--ref-lever-arm") if lever else None,
    )
