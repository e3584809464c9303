"""``insnav run``: navigate a recorded drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from insnav.cli import console
from insnav.cli import options as common
from insnav.cli.console import working
from insnav.cli.data_options import Data, check_usable, takes_data
from insnav.cli.drives import with_backdrop
from insnav.cli.options import RESULT, START, Aiding, Backdrop, EpochsFile, Force, Json, Out, Point, Rate, flag, option
from insnav.exceptions import CheckError, ConfigError


@takes_data(without=("lat", "height"))
def run(
    data: Data,
    states: Annotated[int, option(START, "N", "Filter states: 21, or 15 without scale factor errors.")] = 21,
    aiding: Aiding = "auto",
    mechanization: Annotated[
        Literal["full", "short"],
        option(
            RESULT,
            "FORM",
            "full or short. short: also compare the short-duration form (no Earth and transport rate, Euler) with the "
            "full one in windows of 60 s. The filter uses the full one.",
        ),
    ] = "full",
    smooth: Annotated[
        bool,
        flag(
            RESULT, "--smooth/--no-smooth", "Also give the smoothed (RTS) solution, from all fixes, earlier and later."
        ),
    ] = True,
    out: Out = Path("run"),
    force: Force = False,
    rate: Rate = "10",
    epochs: EpochsFile = None,
    point: Point = None,
    format: Annotated[Literal["csv", "parquet"], option(RESULT, "FORMAT", "Tables as csv or parquet.")] = "csv",
    figures: Annotated[
        Literal["page", "png", "svg", "none"],
        option(
            RESULT, "FORMAT", "page: the interactive page alone; png or svg: also figures for papers; none: neither."
        ),
    ] = "page",
    backdrop: Backdrop = None,
    fail_above: Annotated[
        float | None,
        option(RESULT, "METRES", "End with exit code 1 if the horizontal RMS error against --ref is larger."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Navigate a recorded drive."""
    interval = common.interval(rate)
    if fail_above is not None and common.finite(fail_above, "--fail-above") <= 0.0:
        raise ConfigError("cli.not_a_limit", where="--fail-above", value=fail_above)
    wanted = None if point is None else common.vector(point, "--point")
    with working(out, force) as (folder, stage):
        from insnav.input.readers.rows import read_epochs

        times = () if epochs is None else read_epochs(epochs)
        drive = data.load(stage)
        if fail_above is not None and drive.reference is None:
            raise ConfigError("cli.limit_without_reference", where="--fail-above")
        outcome = drive.navigate(
            states=states,
            aiding=aiding,
            smooth=smooth,
            output_interval=interval,
            epochs=times,
            point=wanted,
            mechanization=mechanization,
            progress=stage.advance,
        )
        outcome, where = data.save(
            with_backdrop(outcome, backdrop), folder, stage, figures=figures, table_format=format
        )
    if as_json:
        console.result_facts(where)
    else:
        if console.level > 0:
            from insnav.report.terminal import page_text

            console.result(f"{page_text(outcome.page(), console.terminal_width(), ('all', 'page'))}\n")
        console.result(console.coloured(f"{console.summary_text(outcome)}\n{console.files_line(where, out)}"))
    check_usable(outcome)
    if fail_above is not None and outcome.found.errors is not None:
        from insnav.sample_statistics import rms

        if (size := rms(outcome.found.errors.horizontal)) > fail_above:
            raise CheckError("cli.worse_than_limit", where="--fail-above", rms_m=size, limit_m=fail_above)
