"""``insnav calibrate rotor``: moment of inertia of a gyroscope's rotor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli.calibrate import command as common

SHORT_HELP = "Moment of inertia of a rotor by a falling weight and by precession."
HELP = """Moment of inertia of a gyroscope's rotor two ways, and whether they agree.

FALL holds height_m and fall_time_s of a weight that spins the rotor up by a cord; PRECESSION holds
precession_period_s and rotor_rate_rad_s (or rotor_rate_rpm) under a weight on an arm, and mass_kg where there were
several weights: one regression over spin and torque.

\b
Examples:
  insnav calibrate rotor fall.csv precession.csv --fall-mass 0.06 --radius 0.0225 --mass 0.05 --arm 0.25
"""


def rotor(
    fall: Annotated[Path, typer.Argument(metavar="FALL", help="Heights and times of fall.", rich_help_panel=opt.FILES)],
    precession: Annotated[
        Path, typer.Argument(metavar="PRECESSION", help="Periods and rotor rates.", rich_help_panel=opt.FILES)
    ],
    fall_mass: Annotated[
        float, typer.Option(metavar="KG", help="Mass of the falling weight.", rich_help_panel=common.METHOD)
    ],
    radius: Annotated[
        float, typer.Option(metavar="M", help="Radius the cord is wound on.", rich_help_panel=common.METHOD)
    ],
    arm: Annotated[
        float,
        typer.Option(metavar="M", help="Distance of the weight from the support.", rich_help_panel=common.METHOD),
    ],
    mass: Annotated[
        float,
        typer.Option(
            metavar="KG", help="Mass of the weight on the arm. [column mass_kg]", rich_help_panel=common.METHOD
        ),
    ] = 0.0,
    gravity: common.Gravity = 9.80665,
    out: opt.Out = common.OUT,
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Measure a rotor."""
    weights: dict[str, Any] = {"fall_mass": fall_mass, "mass": mass, "radius": radius, "arm": arm}
    common.run("rotor", [fall, precession], out, force, as_json, gravity=gravity, **weights)
