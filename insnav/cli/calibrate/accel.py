"""``insnav calibrate accel``: an accelerometer tumbled in gravity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common
from insnav.cli.console import Stages

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
    from insnav.cli import inputs
    from insnav.output.folder import RunFolder

    common.gravity(gravity)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("reading")
        from insnav.lab.single_axis import method as single

        with inputs.named_options():
            records = [
                single.read_record(
                    file,
                    single.TUMBLE,
                    columns=parse.columns(columns, "--columns"),
                    spike_limit=common.limit(spike_limit),
                )
                for file in files
            ]
        stage("fitting")
        found = [single.calibrate_accel(record) for record in records]
        errors = single.accel_errors(records, found, gravity, name)
        calibrated = single.single_uncertainty(errors, found, gravity)
        stage("navigating")
        from insnav.lab.navigation_impact import minute_effect

        effects = minute_effect(calibrated)
        stage("writing")
        from insnav.report.calibration.single_axis import accel_report

        sheet, facts = accel_report(records, found, calibrated, effects, gravity)
        common.finish(folder, out, sheet, facts, common.with_other(errors, add, "gyro"), as_json=as_json)
