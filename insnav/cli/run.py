"""``insnav run``: navigate a recorded drive."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, error_block, note, note_more, result, result_facts

if TYPE_CHECKING:
    from insnav.imu.specification import ImuSpec
    from insnav.input import Reading
    from insnav.types import GpsData, ImuData

SHORT_HELP = "Navigate a recorded drive: IMU and GPS to a solution, figures and a report."
HELP = """Navigate a recorded drive.

IMU and GPS in; out comes a folder with the solution, what the filter thought of every fix, figures, a report page and
all facts. How the files were understood is printed: read it.

\b
Examples:
  insnav run imu.csv --gps gps.csv
  insnav run imu.csv --gps gps.csv --lever-arm 0.8,-0.3,-1.2 --ref ref.csv
  insnav run imu.csv --gps gps.csv --imu automotive --out monday --force
  insnav run imu.csv --gps gps.csv --imu-axes FLU --imu-units deg/s,g
  insnav run imu.csv --gps gps.csv --columns time_s=stamp,gyro_x=Gx
  insnav run imu.csv.gz --gps gps.csv --rate full --format parquet
  insnav run imu.csv --gps gps.csv --ref ref.csv --fail-above 2.5
  zcat imu.csv.gz | insnav run - --gps gps.csv --json | jq .fixes

Where a default in brackets is not right, insnav either finds it out or says that it was assumed.
"""


class Figures(StrEnum):
    """File format of the figures."""

    png = "png"
    svg = "svg"
    none = "none"


class Mechanization(StrEnum):
    """Form of the navigation equations."""

    full = "full"
    short = "short"


class TableFormat(StrEnum):
    """File format of the tables."""

    csv = "csv"
    parquet = "parquet"


def run(
    imu_file: opt.ImuFile,
    gps: opt.GpsFile,
    ref: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Reference to judge the solution by.", rich_help_panel=opt.FILES),
    ] = None,
    imu: opt.ImuModel = None,
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
    gps_heading_sd: opt.GpsHeadingSd = 0.0,
    gps_columns: opt.GpsColumns = None,
    ref_lever_arm: opt.ReferenceLeverArm = None,
    ref_columns: opt.RefColumns = None,
    static: opt.Static = None,
    heading: opt.Heading = None,
    initial: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Initial state and its standard deviations (JSON) instead of an alignment.",
            rich_help_panel=opt.START,
        ),
    ] = None,
    states: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Filter states: 21, or 15 without scale factor errors.",
            rich_help_panel=opt.START,
        ),
    ] = 21,
    fixed_height: opt.FixedHeightSd = 0.0,
    aiding: opt.AidingOption = opt.AidingWhen.auto,
    mechanization: Annotated[
        Mechanization,
        typer.Option(
            metavar="FORM",
            help="full, or short: besides, compare the short-duration form (no Earth and transport rate, Euler) with "
            "the full one in windows of 60 s; the filter keeps the full one.",
            rich_help_panel=opt.RESULT,
        ),
    ] = Mechanization.full,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth/--no-smooth",
            help="Also give the solution that knows all fixes, earlier and later ones.",
            rich_help_panel=opt.RESULT,
        ),
    ] = True,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Run folder to make.", rich_help_panel=opt.RESULT)] = Path(
        "run"
    ),
    force: opt.Force = False,
    rate: Annotated[
        str,
        typer.Option(metavar="HZ", help="Rows per second of the solution, or full.", rich_help_panel=opt.RESULT),
    ] = "10",
    format: Annotated[
        TableFormat, typer.Option(metavar="FORMAT", help="Tables as csv or parquet.", rich_help_panel=opt.RESULT)
    ] = TableFormat.csv,
    figures: Annotated[
        Figures,
        typer.Option(
            metavar="FORMAT",
            help="Figures as png or svg, or none (then no report page either).",
            rich_help_panel=opt.RESULT,
        ),
    ] = Figures.png,
    fail_above: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="End with exit code 1 if the horizontal RMS error against --ref is larger.",
            rich_help_panel=opt.RESULT,
        ),
    ] = None,
    as_json: opt.Json = False,
) -> None:
    """Navigate a recorded drive."""
    configuration = parse.configuration(locals())

    import numpy as np

    from insnav.cli import inputs
    from insnav.exceptions import ConfigError
    from insnav.output.folder import RunFolder, read_facts

    if states not in (15, 21):
        raise ConfigError(f"{states} states are not to be had", where="--states", fix="use 21 or 15")
    interval = parse.interval(rate)
    lever_b = parse.vector(lever_arm, "--lever-arm") if lever_arm else np.zeros(3)
    lever_sd = parse.not_negative(lever_arm_sd, "--lever-arm-sd", largest=10.0)
    heading_sd = float(np.deg2rad(parse.not_negative(gps_heading_sd, "--gps-heading-sd", largest=90.0)))
    fixed_height_sd = parse.not_negative(fixed_height, "--fixed-height", largest=1000.0)
    ref_lever_b = parse.vector(ref_lever_arm, "--ref-lever-arm") if ref_lever_arm else None
    static_span = parse.span(static, "--static") if static else None
    course = None if heading is None else float(np.deg2rad(parse.finite(heading, "--heading")))
    delay = None if gps_delay is None else parse.finite(gps_delay, "--gps-delay", largest=10.0)
    _check_limit(fail_above, ref)
    inputs.one_standard_input(imu_file=imu_file, gps=gps, ref=ref)
    start = parse.start(initial) if initial else None
    told = inputs.chosen_imu(imu)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("reading")
        from insnav.filter import FilterSettings
        from insnav.filter.gps_noise import with_sd
        from insnav.filter.navigate import navigate_recording
        from insnav.filter.prepare import DELAY_SD
        from insnav.input import check_overlap

        # The small files first: what is wrong with them is then known at once.
        fixes = inputs.read_fixes(gps, gps_columns, gps_height)
        reference = inputs.read_truth(ref, ref_columns) if ref else None
        reading = inputs.read_samples(imu_file, imu_axes, columns, imu_units, imu_sampling, imu_stamp, calibration)
        for each in (reading.facts, fixes.facts, reference.facts if reference else None):
            if each is not None:
                inputs.say_reading(each)
        check_overlap(reading.data, fixes.data)
        samples = reading.data
        stage("aligning")
        complete, assumed = with_sd(fixes.data)  # here and not twice below: it looks at every fix's neighbours
        spec, said = told or _from_rest(samples, complete, static_span)
        note(f"IMU model: {spec.name}")
        note_more(said)
        settings = FilterSettings(
            lever_b=lever_b,
            lever_sd=lever_sd,
            delay=delay or 0.0,
            delay_sd=DELAY_SD if delay is None else 0.0,
            output_interval=interval,
            heading_sd=heading_sd,
            fixed_height_sd=fixed_height_sd,
            smooth=smooth,
        )
        _say_if_compiling()
        done = navigate_recording(
            samples,
            complete,
            spec,
            settings,
            states=states,
            start=start,
            static_span=static_span,
            heading=course,
            aiding=aiding.value,
            progress=lambda fraction: stage("navigating", fraction),
        )
        stage("writing")
        import logging

        from insnav.errors.evaluated_run import evaluate_run
        from insnav.errors.short_duration_errors import short_windows
        from insnav.report.save import save_result
        from insnav.result import Result

        logging.getLogger("matplotlib").setLevel(logging.ERROR)  # its care for its own cache is nobody's concern

        readings: dict[str, Reading[Any]] = {"imu": reading, "gps": fixes}
        if reference is not None:
            readings["reference"] = reference
        read_events = [event for each in readings.values() for event in each.events]
        events = tuple(sorted([*read_events, *done.run.events], key=lambda event: event.time))
        done = replace(done, run=replace(done.run, events=events), notes=assumed + done.notes)
        found, notes = evaluate_run(done, reference, ref_lever_b)
        if mechanization is Mechanization.short:
            windows = short_windows(samples, done.run.solution, done.run.sensor_errors)
            found = replace(found, short_duration=tuple(windows))
        understood = {name: each.facts for name, each in readings.items()}
        outcome = Result("run", found, understood, configuration, (spec, said), (*done.notes, *notes), events)
        where = save_result(outcome, folder, figures=figures.value, table_format=format.value)
    facts = read_facts(where)
    if as_json:
        result_facts(where)
    else:
        from insnav.report.run.summary import summary_lines

        result("\n".join(summary_lines(facts, out)))
        if found.short_duration:
            from insnav.report.page import section_tables
            from insnav.report.run.short_duration import short_section
            from insnav.report.terminal import table_text

            for table in section_tables(short_section(found.short_duration)):
                result("\n" + table_text(table))
    if fail_above is not None:
        _judge(facts, fail_above)


def _check_limit(fail_above: float | None, ref: Path | None) -> None:
    """Refuse a limit that cannot be checked before the long run, not after it."""
    from insnav.exceptions import ConfigError

    if fail_above is None:
        return
    parse.finite(fail_above, "--fail-above")
    if fail_above <= 0.0:
        raise ConfigError(f"{fail_above:g} is not a limit", where="--fail-above", fix="give metres, above zero")
    if ref is None:
        raise ConfigError(
            "there is nothing to judge the solution by", where="--fail-above", fix="give a reference with --ref"
        )


def _judge(facts: dict[str, Any], limit: float) -> None:
    """End with exit code 1 if the solution is worse than asked for."""
    rms = facts["accuracy"]["all"]["horizontal_m"]["rms"]
    if rms > limit:
        error_block(
            "the solution is worse than asked for",
            (
                ("where", "--fail-above"),
                ("why", f"horizontal RMS {rms:.3f} m against the reference, limit {limit:g} m"),
            ),
        )
        raise typer.Exit(1)


def _from_rest(samples: ImuData, fixes: GpsData, static_span: tuple[float, float] | None) -> tuple[ImuSpec, str]:
    from insnav.cli.inputs import imu_from_rest
    from insnav.filter.prepare import first_rest

    return imu_from_rest(samples, static_span or first_rest(samples, fixes))


def _say_if_compiling() -> None:
    """The first run after an installation compiles the kernels; say why it takes longer."""
    from insnav.kernels import errorstate

    cache = errorstate.propagate.stats.cache_path
    if cache is None or not any(Path(cache).glob("errorstate.propagate-*.nbi")):
        note("first run on this machine: compiling the numerical kernels, about 15 s; later runs start at once")
