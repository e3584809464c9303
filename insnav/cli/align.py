"""``insnav align``: initial attitude of a static record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, note_more, result, result_facts

SHORT_HELP = "Initial attitude from a record at rest, with its uncertainty."
HELP = """Initial attitude from a record at rest, with its uncertainty.

Roll and pitch come from gravity, heading from the Earth's rotation if the gyros are good enough (gyrocompass), else as
given. Where the heading is known the filter refines everything, told that the vehicle does not move.

\b
Examples:
  insnav align static.csv --lat 48.1
  insnav align static.csv --lat 34.246 --height 380 --imu navigation
  insnav align static.csv --lat 48.1 --static 0:300 --heading 92 --out bench1
  insnav align static.csv --lat 48.1 --json | jq .coarse.roll_deg
"""

SHORT_REST = 10.0  # so long may steady motion look like rest [s]


def align(
    imu_file: opt.ImuFile,
    lat: Annotated[float, typer.Option(metavar="DEG", help="Latitude, north positive.", rich_help_panel=opt.START)],
    height: Annotated[
        float, typer.Option(metavar="M", help="Height above the ellipsoid.", rich_help_panel=opt.START)
    ] = 0.0,
    imu: opt.ImuModel = None,
    calibration: opt.Calibration = None,
    imu_axes: opt.Axes = None,
    imu_units: opt.Units = None,
    columns: opt.Columns = None,
    imu_sampling: opt.SamplingOption = None,
    imu_stamp: opt.StampOption = None,
    static: opt.Static = None,
    heading: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Heading if known, good to 2 deg. [gyrocompass]", rich_help_panel=opt.START),
    ] = None,
    out: opt.Out = Path("alignment"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Align a static record."""
    configuration = parse.configuration(locals())
    import numpy as np

    from insnav.cli import inputs
    from insnav.exceptions import AlignmentError, ConfigError
    from insnav.output.folder import RunFolder

    if not -90.0 <= lat <= 90.0:
        raise ConfigError(f"{lat:g} is not a latitude", where="--lat", fix="give degrees, north positive")
    parse.finite(height, "--height", largest=1e5)
    course = None if heading is None else float(np.deg2rad(parse.finite(heading, "--heading")))
    span = parse.span(static, "--static") if static else None
    told = inputs.chosen_imu(imu)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("reading")
        from insnav.alignment import find_rest
        from insnav.filter.fine_alignment import fine_alignment
        from insnav.report.save import save_result
        from insnav.result import Result
        from insnav.strapdown import intervals

        reading = inputs.read_samples(imu_file, imu_axes, columns, imu_units, imu_sampling, imu_stamp, calibration)
        inputs.say_reading(reading.facts)
        samples = reading.data
        stage("aligning")
        rest = span or find_rest(intervals(samples))
        if rest is None:
            raise AlignmentError(
                "no rest was found",
                where=reading.facts.path,
                why="every half second shows turns or vibration",
                fix="give the static interval with --static FROM:TO",
            )
        if span is None and rest[1] - rest[0] < SHORT_REST:
            note(f"the stretch that looks like rest is only {rest[1] - rest[0]:.1f} s; was it? --static FROM:TO")
        spec, said = told or inputs.imu_from_rest(samples, rest)
        note(f"IMU model: {spec.name}")
        note_more(said)
        lla = np.array([np.deg2rad(lat), 0.0, height])
        found = fine_alignment(samples, spec, lla, rest, course)
        outcome = Result("alignment", found, {"imu": reading.facts}, configuration, (spec, said))
        stage("writing")
        where = save_result(outcome, folder)
    if as_json:
        result_facts(where)
    else:
        result("\n".join([*outcome.page().summary, f"{'files':<12}{out}: report.html, run.json"]))
