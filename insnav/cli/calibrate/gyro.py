"""``insnav calibrate gyro``: scale factor and zero from a rate table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common

SHORT_HELP = "Zero and scale factor of gyros from a rate table."
HELP = """Zero and scale factor of gyros from a rate table.

A file holds rate_deg_s and output_v (or output_lsb, output_deg_s): one row a dwell, or all its samples in successive
rows, which are cleaned of spikes. Give the files of x, y, z, or one that stands for all three.
Rates at which the output has left the straight line are found and left out.

\b
Examples:
  insnav calibrate gyro rate_table.csv
  insnav calibrate gyro rate_table.csv --range -90:80
  insnav calibrate gyro x.csv y.csv z.csv --out gyros
  insnav calibrate gyro x.csv y.csv z.csv --add accels/calibration.toml --out imu7
"""


def gyro(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Rate table of x, y, z, or one.", rich_help_panel=opt.FILES)
    ],
    columns: common.Columns = None,
    keep: Annotated[
        str | None,
        typer.Option(
            "--range",
            metavar="FROM:TO",
            help="Rates to use, deg/s. [all that are linear]",
            rich_help_panel=common.METHOD,
        ),
    ] = None,
    spike_limit: common.SpikeLimit = None,
    add: common.Add = None,
    name: common.Name = "",
    out: opt.Out = common.OUT,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate gyros on a rate table."""
    span = parse.span(keep, "--range") if keep else None
    common.run(
        "gyro", files, out, force, as_json, columns=columns, keep=span, spike_limit=spike_limit, add=add, name=name
    )
