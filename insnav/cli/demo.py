"""``insnav demo``: navigation of the included sample drive."""

from __future__ import annotations

import shlex
from pathlib import Path

import typer

from insnav.cli.options import Force, Out


def demo(context: typer.Context, out: Out = Path("demo"), force: Force = False) -> None:
    """Navigate the sample drive."""
    from insnav.cli import commands
    from insnav.library import sample_drive

    imu, gps, reference = (str(path) for path in sample_drive())
    arguments = [imu, "--gps", gps, "--ref", reference, "--lever-arm", "0.8,-0.3,-1.2", "--out", str(out)]
    typer.echo("$ " + shlex.join(["insnav", "run", *arguments]), err=True)  # not wrapped, for copying
    run = commands("run").commands["run"]
    with run.make_context("run", arguments, parent=context.find_root()) as inner:
        inner.params["force"] = force
        run.invoke(inner)
