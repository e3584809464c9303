"""``insnav allan``: noise of an IMU from a record at rest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from insnav.cli import parse
from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import READING, Data, takes_data
from insnav.cli.options import RESULT, START, Force, Json, Out, option

IMU_TOML = "imu.toml"


@takes_data(files={}, only=("calibration", *READING))
def allan(
    data: Data,
    static: Annotated[str | None, option(START, "FROM:TO", "Part to use, s. [all]")] = None,
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
        reading = data.read_imu(stage)
        stage("noise")
        from insnav.imu import to_toml
        from insnav.messages import sentence
        from insnav.report.noise.page import deviations_csv, noise_page
        from insnav.report.save import write_page
        from insnav.session.bench import allan as analysed

        found = analysed(
            reading, taus=wanted, static=span, workers=workers, progress=lambda fraction: stage("noise", fraction)
        )
        for warning in found.warnings:
            note(sentence(warning))
        stage("writing")
        page = noise_page(found, Path(reading.facts.path).name)
        texts = {IMU_TOML: to_toml(found.spec), "allan.csv": deviations_csv(found)}
        where = write_page(folder, page, {"command": "allan", "imu": reading.facts.as_dict()}, texts)
    result_page(where, page, out, as_json=as_json, more=texts)
