"""``insnav export``: a run in the format of another program."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli.console import result

SHORT_HELP = "A run as GPX, KML, GeoJSON, TUM, EuRoC, RTKLIB .pos, NMEA, ROS bag or CSV."
HELP = """A run in the format of another program.

Writes the smoothed solution if the run has one. GPX, .pos, NMEA and bags need dates: they are known where the fixes had
a GPS week (NMEA, u-blox, RTKLIB …) or the times are Unix time; else give --week.

\b
Examples:
  insnav export run --to gpx
  insnav export run --to pos --out drive.pos --filtered
  insnav export run --to nmea --week 2381
"""


class Kind(StrEnum):
    """Format of the file."""

    gpx = "gpx"
    kml = "kml"
    geojson = "geojson"
    tum = "tum"
    euroc = "euroc"
    pos = "pos"
    nmea = "nmea"
    bag = "bag"
    csv = "csv"


_SUFFIXES = {Kind.euroc: "csv"}


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", rich_help_panel=opt.FILES)],
    to: Annotated[Kind, typer.Option("--to", metavar="FORMAT", help=", ".join(Kind) + ".", rich_help_panel=opt.RESULT)],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write. [track.FORMAT]", rich_help_panel=opt.RESULT),
    ] = None,
    filtered: Annotated[
        bool,
        typer.Option(
            "--filtered", help="The filtered solution, even if there is a smoothed one.", rich_help_panel=opt.RESULT
        ),
    ] = False,
    week: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, max=10_000, help="GPS week. [as the fixes say]", rich_help_panel=opt.RESULT),
    ] = None,
    force: opt.Force = False,
) -> None:
    """Write a run in another format."""
    from insnav.exceptions import OutputError
    from insnav.session.export import export as export_run

    path = out or Path(f"track.{_SUFFIXES.get(to, to.value)}")
    if path.exists() and not force:
        raise OutputError("the file exists already", where=str(path), fix="give another name with --out, or --force")
    content = export_run(run, to.value, solution="filtered" if filtered else None, week=week)
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError("the file cannot be written", where=str(path), why=error.strerror or str(error)) from error
    result(f"files       {path}")
