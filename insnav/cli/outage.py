"""``insnav outage``: how the error grows without GPS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, note_more, result_sheet

SHORT_HELP = "How the error grows without GPS: fixes withheld in windows all over a drive."
HELP = """How the error grows without GPS.

Fixes are withheld in windows of several lengths all over a recorded drive. The filter goes on without them; what it
and the smoother make of these windows is compared with the withheld fixes, or with a better reference, and with the
uncertainty they predicted.

\b
Examples:
  insnav outage imu.csv --gps gps.csv
  insnav outage imu.csv --gps gps.csv --lengths 10,60 --spacing 20
  insnav outage imu.csv --gps gps.csv --lever-arm 0.8,-0.3,-1.2 --ref rtk.csv
  insnav outage imu.csv --gps gps.csv --aiding off --out plain
  insnav outage imu.csv --gps gps.csv --json | jq .outages
"""


def outage(
    imu_file: opt.ImuFile,
    gps: opt.GpsFile,
    ref: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Better positions of the same antenna, in the columns of a GPS file. [the withheld fixes]",
            rich_help_panel=opt.FILES,
        ),
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
    gps_columns: opt.GpsColumns = None,
    ref_columns: opt.RefColumns = None,
    aiding: Annotated[
        opt.AidingWhen,
        typer.Option(
            metavar="WHEN",
            help="Use wheels, wheel speed and rest, as far as the data support it: auto and on do, off does not.",
            rich_help_panel=opt.GPS,
        ),
    ] = opt.AidingWhen.auto,
    lengths: Annotated[
        str, typer.Option(metavar="S,S,…", help="Lengths of the windows, s.", rich_help_panel=opt.START)
    ] = "5,10,15,30,60,120",
    first: Annotated[
        float | None,
        typer.Option(metavar="S", help="First window, s after the start. [60, or less]", rich_help_panel=opt.START),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(metavar="S", help="From one window to the next, s. [so that 60 fit]", rich_help_panel=opt.START),
    ] = None,
    workers: Annotated[int, typer.Option(metavar="N", help="Processes.", rich_help_panel=opt.RESULT)] = 2,
    out: opt.Out = Path("outage"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Withhold fixes and see."""
    configuration = parse.configuration(locals())

    import numpy as np

    from insnav.cli import inputs
    from insnav.output.folder import RunFolder

    lever_b = parse.vector(lever_arm, "--lever-arm") if lever_arm else np.zeros(3)
    delay = None if gps_delay is None else parse.finite(gps_delay, "--gps-delay", largest=10.0)
    wanted = parse.positive_numbers(lengths, "--lengths", "10,60")
    for value, option in ((first, "--first"), (spacing, "--spacing")):
        if value is not None:
            parse.finite(value, option, largest=1e5)
    parse.at_least_one(workers, "--workers", "processes")
    inputs.one_standard_input(imu_file=imu_file, gps=gps, ref=ref)
    told = inputs.chosen_imu(imu)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("reading")
        from insnav.errors.outage.gnss_outage import outages
        from insnav.errors.outage.statistics import outage_growth
        from insnav.filter import FilterSettings
        from insnav.filter.gps_noise import with_sd
        from insnav.filter.navigate import aided
        from insnav.filter.prepare import DELAY_SD, first_rest, prepare
        from insnav.input import check_overlap

        fixes = inputs.read_fixes(gps, gps_columns, gps_height)
        better = inputs.read_fixes(ref, ref_columns, gps_height) if ref else None
        reading = inputs.read_samples(imu_file, imu_axes, columns, imu_units, imu_sampling, imu_stamp, calibration)
        for each in (reading.facts, fixes.facts, better.facts if better else None):
            if each is not None:
                inputs.say_reading(each)
        check_overlap(reading.data, fixes.data)
        samples = reading.data
        stage("aligning")
        complete, assumed = with_sd(fixes.data)
        spec, said = told or inputs.imu_from_rest(samples, first_rest(samples, complete))
        note(f"IMU model: {spec.name}")
        note_more(said)
        settings = FilterSettings(
            lever_b=lever_b,
            lever_sd=parse.not_negative(lever_arm_sd, "--lever-arm-sd", largest=10.0),
            delay=delay or 0.0,
            delay_sd=DELAY_SD if delay is None else 0.0,
            output_interval=1.0,
        )
        ready = prepare(samples, complete, spec, settings)
        if aiding is not opt.AidingWhen.off:
            stage("learning")
            ready = aided(ready, spec)
        stage("navigating")
        windows = outages(
            ready,
            lengths=wanted,
            first=first,
            spacing=spacing,
            reference=_fixed(with_sd(better.data)[0]) if better else None,
            workers=workers,
            progress=lambda fraction: stage("navigating", fraction),
        )
        stage("writing")
        from insnav.report.outage.page import outage_facts, outage_sheet
        from insnav.report.sheet import write_sheet

        sums = outage_growth(windows)
        judge = f"the positions of {Path(better.facts.path).name}" if better else "the withheld fixes"
        notes = (*assumed, *ready.notes)
        sheet = outage_sheet(windows, sums, judge, Path(reading.facts.path).name, notes)
        readings = {"imu": reading.facts.as_dict(), "gps": fixes.facts.as_dict()}
        facts = outage_facts(sums, readings, configuration, notes)
        where = write_sheet(folder, sheet, facts)
    result_sheet(where, sheet, out, as_json=as_json)


def _fixed(gps: Any) -> Any:
    """Epochs with fixed ambiguities, where the file tells."""
    if gps.fix is None or not (gps.fix == 1).any():
        return gps
    return gps.rows(gps.fix == 1)
