"""``insnav export``: a run in the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

from insnav.cli.console import result
from insnav.cli.options import RESULT, Force, argument, flag, option
from insnav.exceptions import OutputError, writing

Kind = Literal["gpx", "kml", "geojson", "tum", "euroc", "pos", "nmea", "bag", "csv"]
_OWN_NAMES = {"euroc": "track.euroc.csv"}  # other files are track.FORMAT


def export(
    run: Annotated[Path, argument("RUN", "Run folder.")],
    to: Annotated[Kind, option(RESULT, "FORMAT", ", ".join(get_args(Kind)) + ".")],
    out: Annotated[Path | None, option(RESULT, "FILE", "File to write. [track.FORMAT]")] = None,
    filtered: Annotated[
        bool, flag(RESULT, "--filtered", "The filtered solution, even if there is a smoothed one.")
    ] = False,
    week: Annotated[int | None, option(RESULT, "N", "GPS week. [as the fixes say]", min=0, max=10_000)] = None,
    force: Force = False,
) -> None:
    """Write a run in another format."""
    from insnav.report.terminal import entry
    from insnav.session.export import export as export_run

    path = out or Path(_OWN_NAMES.get(to, f"track.{to}"))
    if path.exists() and not force:
        raise OutputError("cli.file_exists", where=str(path))
    content = export_run(run, to, solution="filtered" if filtered else None, week=week)
    with writing("output.file_unwritable", path):
        path.write_bytes(content)
    result(f"{entry('files', '')}{path}")
