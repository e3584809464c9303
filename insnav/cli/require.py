"""``insnav require``: the error budget backwards, which IMU do I need."""

from __future__ import annotations

import functools
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, quiet_figures, result_page
from insnav.cli.data_options import Data, takes_data

SHORT_HELP = "Which IMU do I need: the error budget backwards."
HELP = """Which IMU do I need: the error budget backwards.

How large each error may be for a limit on the position error after a time
without GPS: each alone, and all in a balanced set, verified by simulated runs.
With --imu the figures of that IMU are given and only the others are allocated.
Which real IMUs (insnav imus) meet it after minutes of GPS, alone and with the
non-holonomic constraint of a vehicle on wheels, how long each stays within 1,
10 and 100 m, and what helps instead of a better one.

\b
Examples:
  insnav require --error "5 m" --after "30 s" --profile city
  insnav require --error "1 m" --after "60 s"
  insnav require --error "10 m" --after "60 s" --imu STIM300 --probability 0.99
  insnav require --error "1 m" --after "60 s" --cost "gyro bias=8"
  insnav require imu.csv --gps gps.csv --error "5 m" --after "30 s"
"""
REQUIREMENT = "Requirement"


class Part(StrEnum):
    """Which part of the position error."""

    horizontal = "horizontal"
    vertical = "vertical"
    three = "3d"


@takes_data("DRIVE", optional=True, files={"gps": False, "ref": False}, without=("lat", "height"))
def require(
    data: Data,
    error: Annotated[
        str, typer.Option(metavar="LIMIT", help='Limit of the error, such as "5 m".', rich_help_panel=REQUIREMENT)
    ],
    after: Annotated[
        str, typer.Option(metavar="TIME", help='Time without GPS, such as "30 s".', rich_help_panel=REQUIREMENT)
    ],
    probability: Annotated[
        float, typer.Option(metavar="P", help="Of being within the limit.", rich_help_panel=REQUIREMENT)
    ] = 0.95,
    component: Annotated[
        Part,
        typer.Option(metavar="WHICH", help="Error: horizontal, vertical, 3d.", rich_help_panel=REQUIREMENT),
    ] = Part.horizontal,
    cost: Annotated[
        str | None,
        typer.Option(
            metavar="ERROR=W,…",
            help="Weights of errors in the set: with 8 one gets four times the share. [all 1]",
            rich_help_panel=REQUIREMENT,
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="PROFILE",
            help="Motion: name of a profile (insnav simulate --list), or a .toml. [at rest]",
            rich_help_panel="Motion",
        ),
    ] = None,
    begin: Annotated[
        float | None,
        typer.Option(metavar="S", help="When GPS ends, s after the start. [300]", rich_help_panel="Motion"),
    ] = None,
    runs: Annotated[
        int,
        typer.Option(metavar="N", min=0, help="Simulated runs that verify the set.", rich_help_panel=opt.RESULT),
    ] = 500,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Random seed.", rich_help_panel=opt.RESULT)] = 1,
    engine: opt.Engine = "processes",
    out: opt.Out = Path("require"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Work a requirement out."""
    from insnav.exceptions import ConfigError
    from insnav.output.folder import RunFolder

    if data.imu is not None and profile is not None:
        raise ConfigError("a drive has its own motion", where="--profile", fix="leave out the drive, or the profile")
    if data.imu is None and (data.gps is not None or data.ref is not None):
        raise ConfigError(
            "there is no drive for these fixes", where="DRIVE", fix="give the IMU file of the drive first"
        )
    if begin is not None:
        parse.finite(begin, "--begin", largest=1e6)
    options: dict[str, Any] = {
        "workers": engine,
        "probability": probability,
        "component": component.value,
        "begin": begin,
        "runs": runs,
        "seed": seed,
    }
    options |= {"cost": parse.weights(cost, "--cost")}
    with RunFolder(out, force=force) as folder, Stages() as stage:
        from insnav.session.requirement import require as required

        progress = functools.partial(stage, "simulating")
        if data.imu is not None:
            outcome = data.load(stage).require(error, after, progress=progress, **options)
        else:
            stage("motion")
            model = data.inputs.get("imu_model")
            outcome = required(
                error,
                after,
                profile=profile,
                imu=None if model is None else str(model),
                progress=progress,
                **options,
            )
        stage("writing")
        from insnav.report.save import save_result

        quiet_figures()
        outcome = replace(outcome, options=data.options)
        where = save_result(outcome, folder, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json)
