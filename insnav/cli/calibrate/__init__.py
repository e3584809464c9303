"""``insnav calibrate``: bench data to a calibration."""

from __future__ import annotations

import typer

from insnav.cli.calibrate import poses
from insnav.cli.help import GroupedCommand

SHORT_HELP = "Bench data to a calibration."
HELP = """Bench data to a calibration, with its uncertainty."""

app = typer.Typer(name="calibrate", help=HELP, no_args_is_help=True, add_completion=False, rich_markup_mode=None)
app.command("poses", cls=GroupedCommand, help=poses.HELP, short_help=poses.SHORT_HELP)(poses.poses)


@app.callback()
def _group() -> None:
    """Keep the name of the command even while there is only one."""
