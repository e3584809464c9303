"""``insnav calibrate imu``: three gyros swept over rates about three axes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common

SHORT_HELP = "Gyro matrix and bias from rate sweeps, then compensation of what is left over the rate."
HELP = """Full matrix and bias of three gyros from rate sweeps about three axes, then a piecewise-linear compensation.

Three files, the table turned about x, about y, about z, each with rate_deg_s and the outputs of all three gyros,
gyro_x_deg_s, gyro_y_deg_s, gyro_z_deg_s (or gyro_x_v, gyro_x_lsb …); or one file with rate_x_deg_s, rate_y_deg_s,
rate_z_deg_s. One row a dwell, or all its samples in successive rows, for example -300 to 300 deg/s in steps of 10.
Saturated rates are found and left out, and the borders of the pieces are found. Where a piece still misses what is
required, --intercept moves it, its neighbours stay, and the report has the error before and after.

\b
Examples:
  insnav calibrate imu about_x.csv about_y.csv about_z.csv
  insnav calibrate imu sweeps.csv --add accels/calibration.toml --out imu7
  insnav calibrate imu sweeps.csv --intercept x2=-0.012 --out adjusted
  insnav run drive.csv --gps gps.csv --calibration calibration/calibration.toml
"""


def imu(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Sweeps about x, y, z, or one.", rich_help_panel=opt.FILES)
    ],
    columns: common.Columns = None,
    spike_limit: common.SpikeLimit = None,
    intercept: Annotated[
        str | None,
        typer.Option(
            metavar="PIECE=DEG/S,…",
            help="Intercepts b' set by hand; x2 is the second piece of gyro x.",
            rich_help_panel=common.METHOD,
        ),
    ] = None,
    add: common.Add = None,
    name: common.Name = "",
    out: opt.Out = common.OUT,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate three gyros by sweeps."""
    common.run(
        "imu",
        files,
        out,
        force,
        as_json,
        columns=columns,
        spike_limit=spike_limit,
        add=add,
        name=name,
        intercepts=parse.named_numbers(intercept, "--intercept", "-0.01"),
    )
