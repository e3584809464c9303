"""``insnav acceptance``: acceptance figures of gyros and accelerometers, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli import parse
from insnav.cli.console import note_warnings, result_page, working, write_result
from insnav.cli.options import FILES, METHOD, Columns, Force, Json, Out, SpikeLimit, option


def acceptance(
    rates: Annotated[list[Path] | None, option(FILES, "FILE", "Rate table of the gyros; may be given again.")] = None,
    positions: Annotated[
        list[Path] | None, option(FILES, "FILE", "Positions of the accelerometers in gravity; again too.")
    ] = None,
    static: Annotated[Path | None, option(FILES, "FILE", "Record at rest.")] = None,
    powerups: Annotated[list[Path] | None, option(FILES, "FILE", "Outputs at +w and -w after each power-up.")] = None,
    columns: Columns = None,
    lengths: Annotated[str, option(METHOD, "S,S,…", "Averaging times of the bias stability, s.")] = "1,10,100",
    spike_limit: SpikeLimit = None,
    out: Out = Path("acceptance"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute acceptance figures."""
    times = parse.positive_numbers(lengths, "--lengths", "1,10,100")
    named = parse.columns(columns, "--columns")
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import acceptance as accepted

        steps = [*(rates or ()), *(positions or ())]
        outcome = accepted(steps, static, powerups or (), lengths=times, columns=named, spike_limit=spike_limit)
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json)
