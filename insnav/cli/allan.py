"""``insnav allan``: noise of an IMU from a record at rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast

from insnav.cli import parse
from insnav.cli.console import note_warnings, result_page, working
from insnav.cli.data_options import READING, Data, takes_data
from insnav.cli.options import IMU, RESULT, START, Force, Json, Out, option
from insnav.steps.inputs import Inputs


@takes_data(files={}, only=("calibration", *READING))
def allan(
    data: Data,
    static: Annotated[str | None, option(START, "FROM:TO", "Part to use, s. [all]")] = None,
    column: Annotated[str | None, option(IMU, "HEADER", "Analyse this column alone, in its own unit.")] = None,
    rate: Annotated[float | None, option(IMU, "HZ", "Sampling rate of a file without times.", min=1e-6)] = None,
    taus: Annotated[str, option(START, "S,S,…", "Averaging times, s; log (about 90), octave.")] = "log",
    workers: Annotated[int | None, option(RESULT, "N", "Threads. [processors]", min=1)] = None,
    out: Out = Path("allan"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Analyse the noise of a static record."""
    wanted: Any = taus if taus in ("log", "octave") else parse.positive_numbers(taus, "--taus", "0.1,1,10")
    span = parse.span(static, "--static") if static else None
    with working(out, force) as (folder, stage):
        given = replace(data, inputs=cast(Inputs, {**data.inputs, "rate": rate}))
        source: Any = data.imu if column else given.read_imu(stage, bench="noise")
        stage("noise")
        from insnav.session.bench import allan as analysed

        outcome = analysed(
            source,
            column=column,
            rate=rate if column else None,
            taus=wanted,
            static=span,
            workers=workers,
            progress=lambda fraction: stage("noise", fraction),
        )
        note_warnings(outcome)
        outcome, where = data.save(outcome, folder, stage, figures="png")
    files = ("allan.csv",) if column else ("imu.toml", "imu.yaml", "allan.csv")
    result_page(where, outcome.page(), out, as_json=as_json, more=files)
