"""What the calibration commands share: options, and writing the result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, result_page

METHOD = "Method"

Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=HEADER,…", help="Headers that are not understood by themselves.", rich_help_panel=opt.FILES
    ),
]
SpikeLimit = Annotated[
    float | None,
    typer.Option(
        metavar="X",
        help="Samples of a dwell further than this from a polynomial through it are dropped, in the unit of the "
        "output. [0.005 V; other units: none dropped]",
        rich_help_panel=METHOD,
    ),
]
Add = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="A calibration.toml whose other triad is carried over into the new file.",
        rich_help_panel=opt.RESULT,
    ),
]
Gravity = Annotated[float, typer.Option(metavar="M/S2", help="Local gravity.", rich_help_panel=METHOD)]
Name = Annotated[str, typer.Option(metavar="TEXT", help="What was calibrated.", rich_help_panel=opt.RESULT)]
OUT = Path("calibration")


def run(
    method: str,
    files: Sequence[Path],
    out: Path,
    force: bool,
    as_json: bool,
    *,
    columns: str | Mapping[str, str] | None = None,
    opened: Callable[[Any], None] | None = None,
    **options: Any,
) -> None:
    """Calibrate, write the folder with calibration file and report, and print the result."""
    from insnav.output.folder import RunFolder

    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("loading")
        from insnav.imu import calibration_to_toml
        from insnav.report.calibration.page import calibration_metadata, calibration_page
        from insnav.report.save import write_page
        from insnav.session.bench import calibrate

        named = parse.columns(columns, "--columns") if isinstance(columns, str) else columns
        found = calibrate(method, files, columns=named, stage=stage, opened=opened, **options)
        stage("writing")
        page = calibration_page(found)
        texts = {} if found.errors is None else {"calibration.toml": calibration_to_toml(found.errors)}
        where = write_page(folder, page, calibration_metadata(found), texts)
    if as_json:
        for line in page.warnings:
            note(f"warning: {line}")
    result_page(where, page, out, as_json=as_json, more=texts)
