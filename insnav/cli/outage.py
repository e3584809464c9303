"""``insnav outage``: how the error grows without GPS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli import parse
from insnav.cli.console import result_page, working
from insnav.cli.data_options import Data, check_usable, takes_data
from insnav.cli.options import START, Aiding, Engine, Force, Json, Out, option


@takes_data(without=("lat", "height"))
def outage(
    data: Data,
    aiding: Aiding = "auto",
    lengths: Annotated[str, option(START, "S,S,…", "Lengths of the windows, s.")] = "5,10,15,30,60,120",
    first: Annotated[float | None, option(START, "S", "First window, s after the start. [60, or less]")] = None,
    spacing: Annotated[float | None, option(START, "S", "From one window to the next, s. [so that 60 fit]")] = None,
    engine: Engine = "processes",
    out: Out = Path("outage"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate outages."""
    wanted = parse.positive_numbers(lengths, "--lengths")
    for value, name in ((first, "--first"), (spacing, "--spacing")):
        if value is not None:
            parse.finite(value, name, largest=1e5)
    from insnav.report.outage.page import judged

    with working(out, force) as (folder, stage):
        outcome = data.load(stage).outage(
            lengths=wanted, first=first, spacing=spacing, aiding=aiding, workers=engine, progress=stage.advance
        )
        outcome, where = data.save(outcome, folder, stage)
    result_page(where, judged(outcome.page()), out, as_json=as_json)
    check_usable(outcome)
