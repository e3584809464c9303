"""``insnav export``: a run in the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from insnav.cli import options as common
from insnav.cli.console import note, result
from insnav.exceptions import OutputError, writing

Kind = Literal["gpx", "kml", "geojson", "tum", "euroc", "pos", "nmea", "sbet", "smrmsg", "bag", "csv", "utm", "ecef"]
# names of output files; for other formats track.FORMAT
_OWN_NAMES = {
    "euroc": "track.euroc.csv",
    "sbet": "sbet_track.out",
    "smrmsg": "smrmsg_track.out",
    "utm": "track.utm.csv",
    "ecef": "track.ecef.csv",
}


def export(
    run: Path,
    to: Kind,
    out: Path | None = None,
    filtered: bool = False,
    poses: bool = False,
    rate: str = "full",
    epochs: Path | None = None,
    point: str | None = None,
    week: int | None = None,
    force: bool = False,
) -> None:
    """Write a run in the format of another program."""
    import numpy as np

    from insnav.input.readers.rows import read_epochs
    from insnav.messages import sentence
    from insnav.report.terminal import entry
    from insnav.session.export import encoded, track_of

    path = out or Path(_OWN_NAMES.get(to, f"track.{to}"))
    kinds = {path: to}
    if to == "sbet":
        kinds[path.with_name(f"smrmsg_{path.name.removeprefix('sbet_')}")] = "smrmsg"
    for file in kinds:
        if file.exists() and not force:
            raise OutputError("cli.file_exists", where=str(file))
    track, findings = track_of(
        run,
        solution="poses" if poses else "filtered" if filtered else None,
        week=week,
        interval=common.interval(rate),
        epochs=None if epochs is None else read_epochs(epochs),
        point=None if point is None else np.array(common.vector(point, "--point")),
    )
    contents = {file: encoded(track, kind) for file, kind in kinds.items()}
    for finding in findings:
        note(sentence(finding))
    for file, content in contents.items():
        with writing("output.file_unwritable", file):
            file.write_bytes(content)
    result(f"{entry('files', '')}{' '.join(map(str, kinds))}")
