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


class StampChoice(StrEnum):
    """Where in its interval a sample is stamped."""

    start = "start"
    mid = "mid"
    end = "end"


class Height(StrEnum):
    """What heights are measured from."""

    ellipsoidal = "ellipsoidal"
    msl = "msl"


class AidingWhen(StrEnum):
    """When to use what helps besides fixes."""

    auto = "auto"
    on = "on"
    off = "off"


ImuFile = Annotated[
    Path,
    typer.Argument(
        metavar="IMU_FILE",
        help="IMU data file of any supported format, or - for standard input.",
        rich_help_panel=FILES,
    ),
]
ImuModel = Annotated[
    str | None,
    typer.Option(
        "--imu",
        metavar="MODEL",
        help="How good the IMU is: consumer, automotive, industrial, tactical, navigation, or an imu.toml. "
        "[nearest to the noise at rest]",
        rich_help_panel=IMU,
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Known IMU errors to take off the data first (TOML).", rich_help_panel=IMU),
]
Axes = Annotated[
    str | None,
    typer.Option(
        "--imu-axes",
        metavar="XYZ",
        help="Where the sensor's x, y, z point: three of Forward, Back, Left, Right, Up, Down, such as FLU. [FRD]",
        rich_help_panel=IMU,
    ),
]
Units = Annotated[
    str | None,
    typer.Option(
        "--imu-units",
        metavar="GYRO,ACCEL",
        help="Units of the samples, such as deg/s,g. [from header and physics]",
        rich_help_panel=IMU,
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=HEADER,…",
        help="Headers of the IMU file that are not understood by themselves: gyro_x=Gx,time_s=t.",
        rich_help_panel=IMU,
    ),
]
SamplingOption = Annotated[
    SamplingChoice | None,
    typer.Option(
        "--imu-sampling",
        metavar="HOW",
        help="A sample is the mean over its interval, the value at an instant, or an increment: "
        "mean, instant, increment. [mean; increment if so named]",
        rich_help_panel=IMU,
    ),
]
StampOption = Annotated[
    StampChoice | None,
    typer.Option(
        "--imu-stamp",
        metavar="WHERE",
        help="Time stamps mark start, mid or end of the interval. [end]",
        rich_help_panel=IMU,
    ),
]
Static = Annotated[
    str | None,
    typer.Option(metavar="FROM:TO", help="Static interval for the alignment, s. [found]", rich_help_panel=START),
]
Heading = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="Heading at the start, good to 2 deg. [found]", rich_help_panel=START),
]
ReferenceLeverArm = Annotated[
    str | None,
    typer.Option(
        metavar="F,R,D",
        help="Point of the reference seen from the IMU, body axes, m. [0,0,0]",
        rich_help_panel=GPS,
    ),
]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder to make.", rich_help_panel=RESULT)]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing result of insnav.", rich_help_panel=RESULT)]
Json = Annotated[
    bool, typer.Option("--json", help="Print the facts as JSON instead of a summary.", rich_help_panel=RESULT)
]
GpsFile = Annotated[Path, typer.Option("--gps", metavar="FILE", help="GPS fixes.", rich_help_panel=FILES)]
LeverArm = Annotated[
    str | None,
    typer.Option(
        metavar="F,R,D",
        help="Antenna seen from the IMU: forward, right, down, m. [0,0,0]",
        rich_help_panel=GPS,
    ),
]
LeverArmSd = Annotated[
    float,
    typer.Option(
        metavar="M",
        help="How uncertain each component of that is; above 0 it is estimated, which takes turns. [0]",
        rich_help_panel=GPS,
    ),
]
GpsHeight = Annotated[
    Height | None,
    typer.Option(
        metavar="FROM",
        help="GPS heights are ellipsoidal or msl. [by the header, else ellipsoidal]",
        rich_help_panel=GPS,
    ),
]
GpsDelay = Annotated[
    float | None,
    typer.Option(metavar="S", help="How much older the fixes are than their stamps. [estimated]", rich_help_panel=GPS),
]
GpsColumns = Annotated[
    str | None,
    typer.Option(metavar="NAME=HEADER,…", help="The same as --columns, for the GPS file.", rich_help_panel=GPS),
]
RefColumns = Annotated[
    str | None,
    typer.Option(metavar="NAME=HEADER,…", help="The same for the reference.", rich_help_panel=GPS),
]
GpsHeadingSd = Annotated[
    float,
    typer.Option(
        metavar="DEG",
        help="How good the heading of the fixes is (two antennas); 0 leaves it unused. [0]",
        rich_help_panel=GPS,
    ),
]
FixedHeightSd = Annotated[
    float,
    typer.Option(
        "--fixed-height",
        metavar="M",
        help="The vehicle stays within so much of the height of its first fix; 0 does not assume it. [0]",
        rich_help_panel=GPS,
    ),
]
AidingOption = Annotated[
    AidingWhen,
    typer.Option(
        "--aiding",
        metavar="WHEN",
        help="Use wheels that do not slip, wheel speed and rest, as far as the data support it: auto (where GPS "
        "leaves holes), on, off.",
        rich_help_panel=GPS,
    ),
]
