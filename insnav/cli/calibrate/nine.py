"""``insnav calibrate nine``: three dual-axis modules on a position table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli.calibrate import command as common

SHORT_HELP = "Three dual-axis modules in nine positions, gyro misalignment without rotation."
HELP = """Accelerometers, and the misalignment of gyros without any rotation, from nine positions of a position table.

For three modules, each one gyro and the two accelerometers across its axis. The file holds roll_deg, pitch_deg and
x_ay_g, x_az_g, y_az_g, y_ax_g, z_ax_g, z_ay_g (module, then axis; also in m/s2, mg, or the outputs in V, mV, LSB,
which give each a bias voltage and a scale factor): one row a position, or all its samples in successive rows. Gyros
recorded at rest, gyro_x_deg_s or gyro_x_v …, give their bias and g-sensitivity. Positions: level; ± about x; ± about
y; the four combinations; angles of 20 to 75 deg. Upright ones (180, ± 90 deg) may be added: biases then come from the
two extremes of each axis.

\b
Examples:
  insnav calibrate nine positions.csv
  insnav calibrate nine positions.csv --gravity 9.7957 --out imu7
"""


def nine(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Table of positions.", rich_help_panel=opt.FILES)],
    columns: common.Columns = None,
    gravity: common.Gravity = 9.80665,
    name: common.Name = "",
    out: opt.Out = common.OUT,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate dual-axis modules."""
    common.run("nine", [file], out, force, as_json, columns=columns, gravity=gravity, name=name)
