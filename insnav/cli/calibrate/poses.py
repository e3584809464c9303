"""``insnav calibrate poses``: multi-position calibration of an IMU, without a table."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common
from insnav.cli.console import note
from insnav.cli.data_options import READING, Data, say_reading, takes_data

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.types import ImuData

SHORT_HELP = "Multi-position calibration: many poses, or six positions and three turns."
HELP = """Multi-position calibration without a table: many poses, or six positions and three turns.

Poses: put the IMU down in 12 to 40 different poses for 3 s each, turning it by about 90 degrees between them; poses are
found automatically. Six: every axis up and down at rest, then a full turn about each axis while it points up.
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


@takes_data(files={}, only=READING)
def poses(
    data: Data,
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
    out: opt.Out = Path("calibration"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate an IMU in many positions."""
    from math import radians

    from insnav.session.bench import bench_gravity

    assert data.imu is not None
    parse.finite(height, "--height", largest=1e5)
    g, source = bench_gravity(gravity, lat, height)

    def opened(reading: Reading[ImuData]) -> None:
        say_reading(reading.facts)
        note(f"gravity {g:.5f} m/s^2, {source}")

    reading: dict[str, Any] = {key: data.inputs.get(key) for key in ("columns", "axes", "units", "sampling", "stamp")}
    common.run(
        "poses",
        [data.imu],
        out,
        force,
        as_json,
        counts=counts,
        six=method is Method.six,
        gravity=g,
        gravity_source=source,
        sections=sections,
        turn=radians(turn),
        opened=opened,
        **reading,
    )
