"""``insnav export``: a run in the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

from insnav.cli import options as common
from insnav.cli.console import note, result
from insnav.cli.options import RESULT, EpochsFile, Force, Point, argument, flag, option
from insnav.exceptions import OutputError, writing

Kind = Literal["gpx", "kml", "geojson", "tum", "euroc", "pos", "nmea", "sbet", "smrmsg", "bag", "csv", "utm", "ecef"]
# other files are track.FORMAT
_OWN_NAMES = {
    "euroc": "track.euroc.csv",
    "sbet": "sbet_track.out",
    "smrmsg": "smrmsg_track.out",
    "utm": "track.utm.csv",
    "ecef": "track.ecef.csv",
}


def export(
    run: Annotated[Path, argument("RUN", "Run folder.")],
    to: Annotated[Kind, option(RESULT, "FORMAT", ", ".join(get_args(Kind)) + ".")],
    out: Annotated[Path | None, option(RESULT, "FILE", "File to write. [track.FORMAT]")] = None,
    filtered: Annotated[
        bool, flag(RESULT, "--filtered", "The filtered solution, even if there is a smoothed one.")
    ] = False,
    poses: Annotated[bool, flag(RESULT, "--poses", "The poses of run --epochs or --point.")] = False,
    rate: Annotated[str, option(RESULT, "HZ", "Rows per second, interpolated, or full: the rows of the run.")] = "full",
    epochs: EpochsFile = None,
    point: Point = None,
    week: Annotated[int | None, option(RESULT, "N", "GPS week. [as the fixes say]", min=0, max=10_000)] = None,
    force: Force = False,
) -> None:
    """Write a run in another format."""
    import numpy as np

    from insnav.input.readers.rows import read_epochs
    from insnav.messages import sentence
    from insnav.report.terminal import entry
    from insnav.session.export import encoded, track_of

    path = out or Path(_OWN_NAMES.get(to, f"track.{to}"))
    kinds = {path: to}
    if to == "sbet":
        kinds[path.with_name(f"smrmsg_{path.name.removeprefix('sbet_')}")] = "smrmsg"
    for each in kinds:
        if each.exists() and not force:
            raise OutputError("cli.file_exists", where=str(each))
    track, found = track_of(
        run,
        solution="poses" if poses else "filtered" if filtered else None,
        week=week,
        interval=common.interval(rate),
        epochs=None if epochs is None else read_epochs(epochs),
        point=None if point is None else np.array(common.vector(point, "--point")),
    )
    contents = {each: encoded(track, kind) for each, kind in kinds.items()}
    for finding in found:
        note(sentence(finding))
    for each, content in contents.items():
        with writing("output.file_unwritable", each):
            each.write_bytes(content)
    result(f"{entry('files', '')}{' '.join(map(str, kinds))}")
