"""``insnav align``: initial attitude of a static record."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from insnav.cli import parse
from insnav.cli import run as shared
from insnav.cli.console import note

HELP = """Initial attitude from a record at rest, with its uncertainty.

Levelling from the accelerometers; heading by gyrocompass if the gyros are good enough, else as given. Where a heading
is known the filter refines everything with zero velocity.

\b
Examples:
  insnav align static.csv --lat 48.1
  insnav align static.csv --lat 34.246 --height 380 --imu navigation --static 0:900
  insnav align static.csv --lat 48.1 --imu automotive --heading 92 --json
"""


def align(
    imu_file: shared.ImuFile,
    lat: Annotated[float, typer.Option(help="Latitude in degrees.")],
    height: Annotated[float, typer.Option(help="Height in m.")] = 0.0,
    imu: shared.ImuModel = None,
    calibration: shared.Calibration = None,
    imu_axes: shared.Axes = None,
    imu_units: shared.Units = None,
    columns: shared.Columns = None,
    imu_sampling: shared.SamplingOption = None,
    imu_stamp: shared.StampOption = None,
    static: shared.Static = None,
    heading: shared.Heading = None,
    out: Annotated[Path, typer.Option(help="Folder to make.")] = Path("alignment"),
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Align a static record."""
    import numpy as np

    from insnav.exceptions import AlignmentError, ConfigError
    from insnav.io.folder import RunFolder

    if not -90.0 <= lat <= 90.0:
        raise ConfigError(f"{lat:g} is not a latitude", where="--lat", fix="give degrees, north positive")
    span = parse.span(static, "--static") if static else None
    with RunFolder(out, force=force) as folder:
        from insnav.alignment import find_rest
        from insnav.filter.fine import fine_alignment
        from insnav.report.alignment import alignment_facts, alignment_lines
        from insnav.strapdown import intervals

        reading = shared.read_samples(imu_file, imu_axes, columns, imu_units, imu_sampling, imu_stamp)
        for line in reading.facts.lines() if not as_json else ():
            note(line)
        samples = shared.calibrated(reading.data, calibration)
        rest = span or find_rest(intervals(samples))
        if rest is None:
            raise AlignmentError(
                "no rest was found",
                where=str(imu_file),
                why="every half second shows turns or vibration",
                fix="give the static interval with --static START:END",
            )
        spec, said = shared.imu_spec(imu, samples, rest)
        note(said)
        lla = np.array([np.deg2rad(lat), 0.0, height])
        found = fine_alignment(samples, spec, lla, rest, None if heading is None else float(np.deg2rad(heading)))
        facts: dict[str, Any] = alignment_facts(found, reading.facts.as_dict(), said, lat)
        where = folder.commit(facts)
    print(json.dumps(facts, indent=1) if as_json else "\n".join([*alignment_lines(facts), f"{'files':<12}{where}"]))
