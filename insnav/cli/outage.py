"""``insnav outage``: how the error grows without GPS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, quiet_figures, result_page
from insnav.cli.data_options import Data, takes_data

SHORT_HELP = "How the error grows without GPS: simulated outages all over a drive."
HELP = """How the error grows without GPS.

GNSS outages of several lengths are simulated all over a recorded drive. The error of the filtered and of the smoothed
solution in them, against the fixes left out or a better reference, is compared with the standard deviation they state.

\b
Examples:
  insnav outage imu.csv --gps gps.csv
  insnav outage imu.csv --gps gps.csv --lengths 10,60 --spacing 20
  insnav outage imu.csv --gps gps.csv --lever-arm 0.8,-0.3,-1.2 --ref rtk.csv
  insnav outage imu.csv --gps gps.csv --aiding off --out plain
  insnav outage imu.csv --gps gps.csv --json | jq .outages
"""


@takes_data(without=("lat", "height"))
def outage(
    data: Data,
    aiding: opt.AidingOption = opt.AidingWhen.auto,
    lengths: Annotated[
        str, typer.Option(metavar="S,S,…", help="Lengths of the windows, s.", rich_help_panel=opt.START)
    ] = "5,10,15,30,60,120",
    first: Annotated[
        float | None,
        typer.Option(metavar="S", help="First window, s after the start. [60, or less]", rich_help_panel=opt.START),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(metavar="S", help="From one window to the next, s. [so that 60 fit]", rich_help_panel=opt.START),
    ] = None,
    engine: opt.Engine = "processes",
    out: opt.Out = Path("outage"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Simulate outages."""
    from dataclasses import replace

    from insnav.output.folder import RunFolder

    wanted = parse.positive_numbers(lengths, "--lengths")
    for value, option in ((first, "--first"), (spacing, "--spacing")):
        if value is not None:
            parse.finite(value, option, largest=1e5)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        outcome = data.load(stage).outage(
            lengths=wanted,
            first=first,
            spacing=spacing,
            aiding=aiding.value,
            workers=engine,
            progress=lambda fraction: stage("navigating", fraction),
        )
        stage("writing")
        from insnav.report.save import save_result

        quiet_figures()
        outcome = replace(outcome, options=data.options)
        where = save_result(outcome, folder)
    result_page(where, outcome.page(), out, as_json=as_json)
