"""``insnav calibrate accel``: an accelerometer tumbled in gravity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli.calibrate import command as common

SHORT_HELP = "Bias, scale factor, second order and cross-coupling from a tumble test."
HELP = """Bias, scale factor, second order and cross-coupling of accelerometers from a tumble test.

A file holds angle_deg, the angle of the input axis above the horizontal, evenly spaced over the circle, and output_v
(or output_lsb, output_g, output_m_s2): one row a position, or all its samples in successive rows. Give the files of
x, y, z, or one that stands for all three.

\b
Examples:
  insnav calibrate accel tumble.csv
  insnav calibrate accel x.csv y.csv z.csv --gravity 9.7957
  insnav calibrate accel tumble.csv --add gyros/calibration.toml --out imu7
"""


def accel(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Tumble test of x, y, z, or one.", rich_help_panel=opt.FILES)
    ],
    columns: common.Columns = None,
    gravity: common.Gravity = 9.80665,
    spike_limit: common.SpikeLimit = None,
    add: common.Add = None,
    name: common.Name = "",
    out: opt.Out = common.OUT,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate accelerometers by tumbling."""
    common.run(
        "accel",
        files,
        out,
        force,
        as_json,
        columns=columns,
        gravity=gravity,
        spike_limit=spike_limit,
        add=add,
        name=name,
    )
