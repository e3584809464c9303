"""``insnav acceptance``: acceptance figures of gyros and accelerometers, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli import parse
from insnav.cli.console import note, result_page, working
from insnav.cli.options import FILES, METHOD, Columns, Force, Json, Out, SpikeLimit, option
from insnav.exceptions import ConfigError


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
    """Work out acceptance figures."""
    if not (rates or positions or static or powerups):
        raise ConfigError(
            "there is nothing to accept",
            where="insnav acceptance",
            fix="give one or more of --rates, --positions, --static, --powerups",
        )
    times = sorted(set(parse.positive_numbers(lengths, "--lengths", "1,10,100")))
    named = parse.columns(columns, "--columns")
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import acceptance as accepted

        found, files = accepted(
            [*(rates or ()), *(positions or ())],
            static,
            powerups or (),
            lengths=times,
            columns=named,
            spike_limit=spike_limit,
        )
        stage("writing")
        from insnav.report.acceptance.page import acceptance_page
        from insnav.report.calibration.common import bench_input
        from insnav.report.save import write_page

        page = acceptance_page(found, files)
        for text in page.warnings:
            note(text)
        metadata = {"command": "acceptance", "input": bench_input([each.table for each in files])}
        where = write_page(folder, page, metadata)
    result_page(where, page, out, as_json=as_json)
