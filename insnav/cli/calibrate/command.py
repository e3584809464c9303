"""What the calibration commands share: options, and writing the result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli.console import note, result_sheet

if TYPE_CHECKING:
    from insnav.imu.model import ImuErrors
    from insnav.output.folder import RunFolder
    from insnav.report.sheet import Sheet

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


def limit(value: float | None) -> float | None:
    """Check the limit of spikes."""
    from insnav.exceptions import ConfigError

    if value is not None and not 0.0 < value < float("inf"):
        raise ConfigError(f"{value:g} is no limit", where="--spike-limit", fix="give a number above zero")
    return value


def gravity(value: float) -> float:
    """Check gravity."""
    from insnav.exceptions import ConfigError

    if not 9.7 < value < 9.9:
        raise ConfigError(
            f"{value:g} m/s² is not gravity on the Earth", where="--gravity", fix="it is between 9.76 and 9.84 m/s²"
        )
    return value


def with_other(errors: ImuErrors, other: Path | None, kept: str) -> ImuErrors:
    """Carry over the other triad of an earlier calibration."""
    if other is None:
        return errors
    from insnav.imu import load_calibration
    from insnav.lab.single_axis.method import carried_over

    return carried_over(errors, load_calibration(other), kept)


def finish(
    folder: RunFolder,
    out: Path,
    sheet: Sheet,
    facts: Mapping[str, Any],
    errors: ImuErrors | None,
    *,
    as_json: bool,
) -> None:
    """Write calibration file and report, and print the result."""
    from insnav.imu import calibration_to_toml
    from insnav.report.run_json import json_ready
    from insnav.report.sheet import write_sheet

    texts = {} if errors is None else {"calibration.toml": calibration_to_toml(errors)}
    where = write_sheet(folder, sheet, json_ready(facts), texts)
    if as_json:
        for line in sheet.warnings:
            note(f"warning: {line}")
    result_sheet(where, sheet, out, as_json=as_json, more=texts)
