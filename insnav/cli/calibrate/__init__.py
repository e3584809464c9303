"""``insnav calibrate``: from the bench to a calibration file, one command a method."""

from __future__ import annotations

import typer

from insnav.cli.calibrate import accel, gyro, imu, nine, poses, rotor
from insnav.cli.help import GroupedCommand

SHORT_HELP = "Bench data to a calibration file: gyro, accel, imu, nine, poses, rotor."
HELP = """Bench data to a calibration file, with the uncertainty of everything in it.

Every method writes a folder with report.html and, but for rotor, calibration.toml for insnav run --calibration.
"""

app = typer.Typer(
    name="calibrate",
    help=HELP,
    short_help=SHORT_HELP,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for _module, _command in (
    (gyro, gyro.gyro),
    (accel, accel.accel),
    (imu, imu.imu),
    (nine, nine.nine),
    (poses, poses.poses),
    (rotor, rotor.rotor),
):
    app.command(_command.__name__, cls=GroupedCommand, help=_module.HELP, short_help=_module.SHORT_HELP)(_command)
