"""``insnav acceptance``: acceptance figures of gyros and accelerometers, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.calibrate import command as common
from insnav.cli.console import Stages, note, result_page

SHORT_HELP = "Acceptance figures from the bench: scale factor, bias, stability, repeatability."
HELP = """Acceptance figures from the bench: scale factor, bias, stability, repeatability.

Each file holds as many of gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z as were measured: rates and specific
forces (gyro_x_deg_s, accel_x_g), volts or counts (gyro_x_v, accel_x_lsb).

\b
  --rates      rate_x_deg_s, rate_y_deg_s, … and outputs: one row a dwell, or its samples in successive rows
  --positions  force_x_g, force_y_g, … and outputs, likewise
  --static     time_s and outputs, at rest
  --powerups   powerup (its number), rate_x_deg_s or force_x_g …, and outputs at +w and -w;
               or biases already computed: powerup, gyro_x_bias_deg_s
\b
Examples:
  insnav acceptance --rates rates.csv --static static.csv --powerups powerups.csv
  insnav acceptance --rates r.csv --positions p.csv --static s.csv --powerups pg.csv --powerups pa.csv
  insnav acceptance --rates r.csv --static s.csv --lengths 1,10,100,1000
  insnav acceptance --static s.csv --json | jq .sensors.gyro_x
"""

METHOD = "Method"
Steps = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="Rate table of the gyros; may be given again.", rich_help_panel=opt.FILES),
]


def acceptance(
    rates: Steps = None,
    positions: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Positions of the accelerometers in gravity; again too.", rich_help_panel=opt.FILES
        ),
    ] = None,
    static: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Record at rest.", rich_help_panel=opt.FILES)
    ] = None,
    powerups: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Outputs at +w and -w after each power-up.", rich_help_panel=opt.FILES),
    ] = None,
    columns: common.Columns = None,
    lengths: Annotated[
        str, typer.Option(metavar="S,S,…", help="Averaging times of the bias stability, s.", rich_help_panel=METHOD)
    ] = "1,10,100",
    spike_limit: common.SpikeLimit = None,
    out: opt.Out = Path("acceptance"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Work out acceptance figures."""
    from insnav.exceptions import ConfigError
    from insnav.output.folder import RunFolder

    if not (rates or positions or static or powerups):
        raise ConfigError(
            "there is nothing to accept",
            where="insnav acceptance",
            fix="give one or more of --rates, --positions, --static, --powerups",
        )
    times = sorted(set(parse.positive_numbers(lengths, "--lengths", "1,10,100")))
    named = parse.columns(columns, "--columns")
    with RunFolder(out, force=force) as folder, Stages() as stage:
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
