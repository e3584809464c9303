"""``insnav calibrate poses``: an IMU calibrated by hand, without any table."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common
from insnav.cli.console import note

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.types import ImuData

SHORT_HELP = "IMU calibrated by hand: many poses, or six positions and three turns."
HELP = """IMU calibrated by hand, without any table: many poses, or six positions and three turns.

Poses: put the IMU down in 12 to 40 different poses for 3 s each, turning it by about 90 degrees between them; poses are
found by themselves. Six: every axis up and down at rest, then a full turn about each axis while it points up.
Gravity must be known: by --gravity or --lat (and --height).

\b
Examples:
  insnav calibrate poses imu.csv --lat 48.1 --height 520
  insnav calibrate poses counts.csv --counts --gravity 9.81744 --out mti
  insnav calibrate poses imu.csv --method six --lat 49.6 --sections sections.json
  insnav run drive.csv --gps gps.csv --calibration calibration/calibration.toml
"""


class Method(StrEnum):
    """How the record was made."""

    poses = "poses"
    six = "six"


def poses(
    imu_file: opt.ImuFile,
    method: Annotated[
        Method,
        typer.Option(
            metavar="HOW", help="How it was recorded: poses, or six (Ferraris).", rich_help_panel=common.METHOD
        ),
    ] = Method.poses,
    counts: Annotated[
        bool,
        typer.Option(
            "--counts", help="The file holds raw counts or volts, not SI units.", rich_help_panel=common.METHOD
        ),
    ] = False,
    gravity: Annotated[
        float | None, typer.Option(metavar="M_S2", help="Gravity at the bench, m/s^2.", rich_help_panel=common.METHOD)
    ] = None,
    lat: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Latitude, if gravity is not given.", rich_help_panel=common.METHOD),
    ] = None,
    height: Annotated[
        float, typer.Option(metavar="M", help="Height above the ellipsoid.", rich_help_panel=common.METHOD)
    ] = 0.0,
    sections: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="First and last sample of x_p (x up), x_a (x down), …, x_rot, … for six (JSON or TOML). [found]",
            rich_help_panel=common.METHOD,
        ),
    ] = None,
    turn: Annotated[
        float, typer.Option(metavar="DEG", help="Angle of each turn of six.", rich_help_panel=common.METHOD)
    ] = 360.0,
    imu_axes: opt.Axes = None,
    imu_units: opt.Units = None,
    columns: opt.Columns = None,
    imu_sampling: opt.SamplingOption = None,
    imu_stamp: opt.StampOption = None,
    out: opt.Out = Path("calibration"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate an IMU by hand."""
    from math import radians

    from insnav.cli import inputs
    from insnav.session.bench import bench_gravity

    parse.finite(height, "--height", largest=1e5)
    g, source = bench_gravity(gravity, lat, height)

    def opened(reading: Reading[ImuData]) -> None:
        inputs.say_reading(reading.facts)
        note(f"gravity {g:.5f} m/s^2, {source}")

    common.run(
        "poses",
        [imu_file],
        out,
        columns=columns,
        counts=counts,
        six=method is Method.six,
        gravity=g,
        gravity_source=source,
        sections=sections,
        turn=radians(turn),
        axes=imu_axes,
        units=imu_units,
        sampling=imu_sampling.value if imu_sampling else None,
        stamp=imu_stamp.value if imu_stamp else None,
        opened=opened,
        force=force,
        as_json=as_json,
    )
