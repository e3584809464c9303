"""``insnav budget``: how much error an IMU makes in a minute, and from what."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, note_more, result

if TYPE_CHECKING:
    from insnav.errors.budget import SampledMotion

SHORT_HELP = "How much error an IMU makes in a minute, from what: analytic, covariance, simulated."
HELP = """How much error an IMU makes in a minute without aid, and from what.

Every source of error in the IMU file (and of the start, in its table [initial]) is followed to position, velocity and
attitude: by closed formulas on paper, by the whole linear error model along the motion, and with --runs by simulated
free-inertial runs. All of it on one page: report.html, figures/budget.png, budget.pdf.

\b
Examples:
  insnav budget --imu mems.toml
  insnav budget --imu tactical --times 10,60,300
  insnav budget --imu mems.toml --profile city --runs 500
  insnav budget --imu mems.toml --profile drive.toml --begin 120 --height held
  insnav budget --imu mems.toml --json | jq '.budget[-1].covariance.horizontal_m'

Without a profile the IMU is at rest, level, heading north, at a latitude of 45 deg: what turns and accelerations make
of heading, scale factors and misalignment shows with a profile. What the IMU file does not give counts as zero, and is
said.
"""
MOTION = "Motion"
LONGEST_FREE = 300.0  # up to here the instability of the vertical channel does no harm [s]


class Vertical(StrEnum):
    """What becomes of the vertical channel."""

    free = "free"
    held = "held"


def budget(
    drive: Annotated[
        Path | None,
        typer.Argument(metavar="DRIVE", help="Recorded IMU data, for the recorded column.", rich_help_panel=opt.FILES),
    ] = None,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="How good the IMU is: consumer, automotive, industrial, tactical, navigation, or an imu.toml.",
            rich_help_panel=opt.IMU,
        ),
    ] = None,
    deflection: Annotated[
        float,
        typer.Option(
            metavar="ARCSEC",
            help="Deflection of the vertical (1 sd, each axis) that the gravity model does not have.",
            rich_help_panel=opt.IMU,
        ),
    ] = 0.0,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="PROFILE",
            help="Motion: name of a profile (insnav simulate --list), or a .toml. [at rest]",
            rich_help_panel=MOTION,
        ),
    ] = None,
    begin: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Start, s after that of the profile. [1 s before it sets off]", rich_help_panel=MOTION
        ),
    ] = None,
    times: Annotated[
        str, typer.Option(metavar="S,S,…", help="When the errors are told, s.", rich_help_panel=MOTION)
    ] = "10,20,30,40,50,60",
    height: Annotated[
        Vertical | None,
        typer.Option(
            metavar="HOW",
            help="The vertical channel is free, or held to the reference: free, held. [free up to 300 s, else held]",
            rich_help_panel=MOTION,
        ),
    ] = None,
    runs: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, help="Simulate so many runs, and so many of each source.", rich_help_panel=opt.RESULT
        ),
    ] = 0,
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Of everything random.", rich_help_panel=opt.RESULT)
    ] = 1,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder to make.", rich_help_panel=opt.RESULT)] = Path(
        "budget"
    ),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Draw up a budget."""
    configuration = {
        "imu": imu,
        "deflection_arcsec": deflection,
        "profile": profile,
        "begin_s": begin,
        "times_s": times,
        "height": height,
        "runs": runs,
        "seed": seed,
    }
    from insnav.exceptions import ConfigError
    from insnav.io.folder import FACTS_FILE, RunFolder
    from insnav.units import UNITS

    if drive is not None:
        raise ConfigError("recorded drives have no column yet", where="DRIVE", fix="leave it out, or give --profile")
    if imu is None:
        raise ConfigError("a budget is of an IMU", where="--imu", fix="give an imu.toml, or a preset such as tactical")
    if runs == 1:
        raise ConfigError("one run has no spread", where="--runs", fix="give 2 or more, better 500")
    wanted = parse.positive_numbers(times, "--times", "10,60")
    hold = max(wanted) > LONGEST_FREE if height is None else height is Vertical.held
    slope = parse.not_negative(deflection, "--deflection", largest=3600.0) * UNITS["arcsec"][1]
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("motion")
        from insnav.errors.budget import budget as drawn_up
        from insnav.errors.budget import check_times
        from insnav.imu import load_imu

        check_times(wanted)
        spec = load_imu(imu)
        motion = _motion(profile, begin, max(wanted), seed)
        note(f"motion: {motion.words}")
        stage("computing")
        found = drawn_up(
            spec,
            motion,
            wanted,
            runs=runs,
            seed=seed,
            deflection=slope,
            hold=hold,
            progress=lambda fraction: stage("simulating", fraction),
        )
        for text in (f"not given, taken as zero: {', '.join(found.absent)}",) if found.absent else ():
            note(f"IMU model: {spec.name}")
            note_more(text)
        stage("writing")
        from insnav.report.budget import write_budget
        from insnav.report.sheet import sheet_text

        where, sheet = write_budget(folder, found, configuration)
    if as_json:
        result((where / FACTS_FILE).read_text(encoding="utf-8").rstrip("\n"))
    else:
        shown = replace(sheet, tables=sheet.tables[:2])
        result(f"{sheet_text(shown)}\n\nfiles       {out}: report.html, budget.pdf, figures/budget.png, run.json")


def _motion(profile: str | None, begin: float | None, duration: float, seed: int) -> SampledMotion:
    """Motion of the budget."""
    from insnav.errors.budget import at_rest, first_movement, sampled
    from insnav.exceptions import ConfigError

    if begin is not None:
        parse.not_negative(begin, "--begin", largest=1e6)
    if profile is None:
        if begin is not None:
            raise ConfigError("there is no motion to begin in", where="--begin", fix="it goes with --profile")
        return at_rest(duration)
    from insnav.simulate.motion import load_profile
    from insnav.simulate.recording import MOTION_STREAM

    chosen = load_profile(profile)
    truth = chosen.truth((seed, MOTION_STREAM))
    start = first_movement(truth) if begin is None else begin
    words = f"{chosen.name}, from {start:g} s on ({chosen.purpose.rstrip('.')})"
    return sampled(truth, start, duration, words)
