"""Options that several commands share, under one name and help text each."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

FILES, IMU, GPS, START, RESULT = "Files", "IMU", "GPS and reference", "Start", "Result"


class GravityChoice(StrEnum):
    """How gravity is simulated."""

    full = "full"
    plumb = "plumb"
    linear = "linear"


class SamplingChoice(StrEnum):
    """What an IMU sample is."""

    instant = "instant"
    mean = "mean"
    increment = "increment"


class AidingWhen(StrEnum):
    """When to use other aiding than GPS."""

    auto = "auto"
    on = "on"
    off = "off"


def _engine(text: str) -> str:
    from insnav.engine import engine_of

    engine_of(text)
    return text


Engine = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="WHERE",
        callback=_engine,
        help="Where to compute: processes (one a processor), processes:N, dask (local workers), dask:ADDRESS of a "
        "scheduler.",
        rich_help_panel=RESULT,
    ),
]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder to make.", rich_help_panel=RESULT)]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing result of insnav.", rich_help_panel=RESULT)]
Backdrop = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Lines behind the track of the page: GeoJSON, such as streets.", rich_help_panel=RESULT
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print run.json instead of a summary.", rich_help_panel=RESULT)]
AidingOption = Annotated[
    AidingWhen,
    typer.Option(
        "--aiding",
        metavar="WHEN",
        help="Other aiding (non-holonomic constraint, odometer, ZUPT), as far as the data support it: auto (run: where "
        "GPS has gaps; outage: always), on, off.",
        rich_help_panel=GPS,
    ),
]
