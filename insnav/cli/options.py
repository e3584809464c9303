"""Declaration of options, and the options shared by several commands, with one name and help text each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from insnav.library import library

# groups of the help
FILES, IMU, GPS, START = "Files", "IMU", "GPS and reference", "Start"
METHOD, MOTION, RESULT = "Method", "Motion", "Result"
# values that may name a file in insnav folders, or a profile
_NAMED = {(IMU, "MODEL"): ("imu/grades", "imu/parts"), (IMU, "PART"): ("imu/parts",), (MOTION, "PROFILE"): ()}
_NAMED |= {("GPS", "MODEL"): ("simulate/receivers",)}


def option(group: str, value: str, meaning: str, *names: str, **more: Any) -> Any:
    """Declare an option.

    `group`: of the option in the help. `value`: placeholder of its value. `names`: if they differ from the parameter's.
    `more`: arguments of `typer.Option`.
    """
    named = _named(group, value)
    return typer.Option(*names, metavar=value, help=meaning, rich_help_panel=group, autocompletion=named, **more)


def flag(group: str, name: str, meaning: str, **more: Any) -> Any:
    """Declare an option without a value."""
    return typer.Option(name, help=meaning, rich_help_panel=group, **more)


def argument(value: str, meaning: str, group: str = FILES) -> Any:
    """Declare an argument."""
    named = _named(group, value)
    return typer.Argument(metavar=value, help=meaning, rich_help_panel=group, autocompletion=named)


def _named(group: str, value: str) -> Callable[[str], list[str]] | None:
    """Return the completion of library names, if applicable; the shell completes files itself."""
    if (folders := _NAMED.get((group, value))) is None:
        return None

    def begun(incomplete: str) -> list[str]:
        files = [each for name in folders for each in (Path(__file__).parents[1] / name).glob("*.toml")] or library()
        stems = sorted(each.stem for each in files if each.stem.startswith(incomplete.lower()))
        return [incomplete + stem[len(incomplete) :] for stem in stems]  # a part may have any spelling

    return begun


def _engine(text: str) -> str:
    from insnav.engine import engine_of

    engine_of(text)
    return text


Engine = Annotated[
    str,
    option(
        RESULT,
        "WHERE",
        "Where to compute: processes (one a processor), processes:N, dask (local workers), dask:ADDRESS of a "
        "scheduler.",
        callback=_engine,
    ),
]


def _force(context: typer.Context, value: bool) -> bool | Literal["keep"]:
    """Keep an existing result of the default folder without --force; see `insnav.output.folder.RunFolder`."""
    source = context.get_parameter_source("out")
    default = source is not None and source.name == "DEFAULT" and context.params.get("out") is not None
    return value or ("keep" if default else False)


Out = Annotated[
    Path, option(RESULT, "FOLDER", "Folder to make. An earlier result in the default folder is kept as FOLDER~1.")
]
Force = Annotated[bool, flag(RESULT, "--force", "Replace an existing result of insnav.", callback=_force)]
Json = Annotated[bool, flag(RESULT, "--json", "Print run.json instead of a summary.")]
Columns = Annotated[str | None, option(FILES, "NAME=HEADER,…", "Headers that are not understood by themselves.")]
SpikeLimit = Annotated[
    float | None,
    option(
        METHOD,
        "X",
        "Samples of a dwell further than this from a polynomial through it are dropped, in the unit of the output. "
        "[0.005 V; other units: none dropped]",
    ),
]
Rate = Annotated[str, option(RESULT, "HZ", "Rows per second of the solution, or full.")]
EpochsFile = Annotated[
    Path | None,
    option(RESULT, "FILE", "Epochs of the poses, such as camera triggers: seconds in the first column of a text."),
]
Point = Annotated[
    str | None, option(RESULT, "F,R,D", "Point of the poses: forward, right, down of the IMU, m. [the IMU]")
]
Seed = Annotated[int, option(RESULT, "N", "Random seed.", min=0)]
Backdrop = Annotated[
    Path | None, option(RESULT, "FILE", "Lines behind the track of the page: GeoJSON, such as streets.")
]
Profile = Annotated[
    str | None, option(MOTION, "PROFILE", "Motion: name of a profile (insnav simulate --list), or a .toml. [at rest]")
]
Aiding = Annotated[
    Literal["auto", "on", "off"],
    option(
        GPS,
        "WHEN",
        "Other aiding (non-holonomic constraint, odometer, ZUPT), as far as the data support it: auto (run: where "
        "GPS has gaps; outage: always), on, off.",
    ),
]
