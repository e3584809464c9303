"""``insnav budget``: how much error an IMU makes in a minute, and from what."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.budget_recorded import REFERENCE_SD, RecordedOptions, StartFrom, recorded
from insnav.cli.console import Stages, note, note_more, result, result_facts

if TYPE_CHECKING:
    from insnav.errors.budget.sampled_motion import SampledMotion
    from insnav.errors.budget.sources import Source

SHORT_HELP = "How much error an IMU makes in a minute, from what: analytic, simulated, recorded."
HELP = """How much error an IMU makes in a minute without aid, and from what.

Every source of error in the IMU file (and of the start, in its table [initial]) is followed to position, velocity and
attitude: by closed formulas on paper, by the whole linear error model along the motion, and with --runs by simulated
free-inertial runs. All of it on one page: report.html, figures/budget.png, budget.pdf.

\b
Examples:
  insnav budget --imu mems.toml
  insnav budget --imu tactical --times 10,60,300
  insnav budget --imu mems.toml --profile city --runs 500
  insnav budget --imu mems.toml --profile drive.toml --begin 120 --height held
  insnav budget imu.csv --gps gps.csv --imu mems.toml --raw
  insnav budget imu.csv --gps gps.csv --lever-arm 0.8,-0.3,-1.2 --ref ref.csv --ref-sd 0.05,0.02
  insnav budget --imu mems.toml --json | jq '.budget[-1].covariance.horizontal_m'

With a recorded drive, windows without GPS are slid along it, each begun with the state of the filter; their errors
stand beside the three others, are taken apart (t, t², t³: which tilt, bias, drift), and compared with simulated twins
of the drive. Windows are as long as the last of --times.

Without a profile or a drive the IMU is at rest, level, heading north, at a latitude of 45 deg: what turns and
accelerations make of heading, scale factors and misalignment shows with a profile. What the IMU file does not give
counts as zero, and is said.
"""
MOTION, WINDOWS = "Motion", "Windows of the recorded drive"
LONGEST_FREE = 300.0  # up to here the instability of the vertical channel does no harm [s]


class Vertical(StrEnum):
    """What becomes of the vertical channel."""

    free = "free"
    held = "held"


def budget(
    drive: Annotated[
        Path | None,
        typer.Argument(metavar="DRIVE", help="Recorded IMU data.", rich_help_panel=opt.FILES),
    ] = None,
    gps: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Its fixes.", rich_help_panel=opt.FILES),
    ] = None,
    ref: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Reference to judge the windows by. [the withheld fixes]", rich_help_panel=opt.FILES
        ),
    ] = None,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="How good the IMU is: consumer, automotive, industrial, tactical, navigation, or an imu.toml.",
            rich_help_panel=opt.IMU,
        ),
    ] = None,
    calibration: opt.Calibration = None,
    imu_axes: opt.Axes = None,
    imu_units: opt.Units = None,
    columns: opt.Columns = None,
    imu_sampling: opt.SamplingOption = None,
    imu_stamp: opt.StampOption = None,
    lever_arm: opt.LeverArm = None,
    lever_arm_sd: opt.LeverArmSd = 0.0,
    gps_height: opt.GpsHeight = None,
    gps_delay: opt.GpsDelay = None,
    gps_columns: opt.GpsColumns = None,
    ref_lever_arm: opt.ReferenceLeverArm = None,
    ref_columns: opt.RefColumns = None,
    ref_sd: Annotated[
        str,
        typer.Option(
            metavar="M[,M/S]",
            help="Uncertainty of the reference; its velocities count only if theirs is given.",
            rich_help_panel=opt.GPS,
        ),
    ] = REFERENCE_SD,
    raw: Annotated[
        bool,
        typer.Option(
            "--raw",
            help="Also windows with the sensors as they were turned on, beside the paper.",
            rich_help_panel=WINDOWS,
        ),
    ] = False,
    start: Annotated[
        StartFrom,
        typer.Option(
            metavar="HOW",
            help="Windows begin with the state of the forward filter, or (not independent) smoothed.",
            rich_help_panel=WINDOWS,
        ),
    ] = StartFrom.forward,
    first: Annotated[
        float | None,
        typer.Option(metavar="S", help="Where the first begins, s after the start. [60]", rich_help_panel=WINDOWS),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(metavar="S", help="From one to the next. [so that about 60 fit]", rich_help_panel=WINDOWS),
    ] = None,
    twins: Annotated[
        int, typer.Option(metavar="N", min=0, help="Simulated twins of the drive.", rich_help_panel=WINDOWS)
    ] = 20,
    workers: Annotated[int, typer.Option(metavar="N", help="Processes.", rich_help_panel=WINDOWS)] = 2,
    deflection: Annotated[
        float,
        typer.Option(
            metavar="ARCSEC",
            help="Deflection of the vertical (1 sd, each axis) that the gravity model does not have.",
            rich_help_panel=opt.IMU,
        ),
    ] = 0.0,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="PROFILE",
            help="Motion: name of a profile (insnav simulate --list), or a .toml. [at rest]",
            rich_help_panel=MOTION,
        ),
    ] = None,
    begin: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Start, s after that of the profile. [1 s before it sets off]", rich_help_panel=MOTION
        ),
    ] = None,
    times: Annotated[
        str, typer.Option(metavar="S,S,…", help="When the errors are told, s.", rich_help_panel=MOTION)
    ] = "10,20,30,40,50,60",
    height: Annotated[
        Vertical | None,
        typer.Option(
            metavar="HOW",
            help="The vertical channel is free, or held to the reference: free, held. [free up to 300 s, else held]",
            rich_help_panel=MOTION,
        ),
    ] = None,
    runs: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, help="Simulate so many runs, and so many of each source.", rich_help_panel=opt.RESULT
        ),
    ] = 0,
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Of everything random.", rich_help_panel=opt.RESULT)
    ] = 1,
    out: opt.Out = Path("budget"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Draw up a budget."""
    configuration = parse.configuration(locals())
    from insnav.exceptions import ConfigError
    from insnav.output.folder import RunFolder
    from insnav.units import UNITS

    if drive is not None and (profile is not None or begin is not None):
        raise ConfigError("a drive has its own motion", where="--profile", fix="leave out the drive, or the profile")
    if drive is None and (gps is not None or ref is not None or raw):
        raise ConfigError(
            "there is no drive for these fixes", where="DRIVE", fix="give the IMU file of the drive first"
        )
    if imu is None and drive is None:
        raise ConfigError("a budget is of an IMU", where="--imu", fix="give an imu.toml, or a preset such as tactical")
    if runs == 1:
        raise ConfigError("one run has no spread", where="--runs", fix="give 2 or more, better 500")
    wanted = parse.positive_numbers(times, "--times", "10,60")
    hold = max(wanted) > LONGEST_FREE if height is None else height is Vertical.held
    slope = parse.not_negative(deflection, "--deflection", largest=3600.0) * UNITS["arcsec"][1]
    with RunFolder(out, force=force) as folder, Stages() as stage:
        from insnav.errors.budget.error_budget import budget as drawn_up
        from insnav.errors.budget.error_budget import check_times
        from insnav.imu import load_imu

        check_times(wanted)
        windows = None
        known: tuple[Source, ...] = ()
        if drive is not None:
            from insnav.errors.budget.drive_motion import spec_in_windows, window_motion, window_start_sources

            windows = recorded(
                RecordedOptions(
                    imu_file=drive,
                    gps=gps,
                    ref=ref,
                    imu=imu,
                    calibration=calibration,
                    imu_axes=imu_axes,
                    imu_units=imu_units,
                    columns=columns,
                    imu_sampling=imu_sampling,
                    imu_stamp=imu_stamp,
                    lever_arm=lever_arm,
                    lever_arm_sd=lever_arm_sd,
                    gps_height=gps_height,
                    gps_delay=gps_delay,
                    gps_columns=gps_columns,
                    ref_lever_arm=ref_lever_arm,
                    ref_columns=ref_columns,
                    ref_sd=ref_sd,
                    window=max(wanted),
                    first=first,
                    spacing=spacing,
                    start=start,
                    raw=raw,
                    twins=twins,
                    seed=seed,
                    workers=workers,
                ),
                stage,
            )
            spec, motion = spec_in_windows(windows.budget), window_motion(windows.budget, max(wanted))
            known = window_start_sources(windows.budget)
        else:
            stage("motion")
            assert imu is not None
            spec, motion = load_imu(imu), _motion(profile, begin, max(wanted), seed)
        note(f"motion: {motion.description}")
        stage("computing")
        found = drawn_up(
            spec,
            motion,
            wanted,
            runs=runs,
            seed=seed,
            deflection=slope,
            hold=hold,
            known=known,
            progress=lambda fraction: stage("simulating", fraction),
        )
        for text in (f"not given, taken as zero: {', '.join(found.absent)}",) if found.absent else ():
            note(f"IMU model: {spec.name}")
            note_more(text)
        stage("writing")
        from insnav.report.budget.page import write_budget
        from insnav.report.sheet import sheet_text

        if windows is not None:
            from insnav.errors.budget.drive_motion import with_recorded

            found = with_recorded(found, windows.budget)
            configuration["input"] = windows.readings
        where, sheet = write_budget(folder, found, configuration, None if windows is None else windows.budget)
    if as_json:
        result_facts(where)
    else:
        shown = replace(sheet, tables=sheet.tables[: 2 if windows is None else -2])
        result(f"{sheet_text(shown)}\n\nfiles       {out}: report.html, budget.pdf, figures/budget.png, run.json")


def _motion(profile: str | None, begin: float | None, duration: float, seed: int) -> SampledMotion:
    """Motion of the budget."""
    from insnav.errors.budget.sampled_motion import at_rest, first_movement, sampled
    from insnav.exceptions import ConfigError

    if begin is not None:
        parse.not_negative(begin, "--begin", largest=1e6)
    if profile is None:
        if begin is not None:
            raise ConfigError("there is no motion to begin in", where="--begin", fix="it goes with --profile")
        return at_rest(duration)
    from insnav.simulate.motion import load_profile
    from insnav.simulate.recording import MOTION_STREAM

    chosen = load_profile(profile)
    truth = chosen.truth((seed, MOTION_STREAM))
    start = first_movement(truth) if begin is None else begin
    words = f"{chosen.name}, from {start:g} s on ({chosen.purpose.rstrip('.')})"
    return sampled(truth, start, duration, words)
