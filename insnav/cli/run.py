"""``insnav run``: navigate a recorded drive."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from insnav.cli import console
from insnav.cli import options as common
from insnav.cli.console import working
from insnav.cli.data_options import Data, check_usable, takes_data
from insnav.cli.drives import with_backdrop
from insnav.exceptions import CheckError, ConfigError


@takes_data(without=("lat", "height"))
def run(
    data: Data,
    states: int = 21,
    aiding: Literal["auto", "on", "off"] = "auto",
    mechanization: Literal["full", "short"] = "full",
    smooth: bool = True,
    out: Path = Path("run"),
    force: bool = False,
    rate: str = "10",
    epochs: Path | None = None,
    point: str | None = None,
    format: Literal["csv", "parquet"] = "csv",
    figures: Literal["page", "png", "svg", "none"] = "page",
    backdrop: Path | None = None,
    fail_above: float | None = None,
    as_json: bool = False,
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
