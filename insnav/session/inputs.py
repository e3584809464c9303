"""What may be given with a recording: one list of names, meanings and limits for `insnav.load` and every command.

A new input is two entries here: its type in `Inputs`, and its meaning in `INPUTS`. Nothing heavy is imported, as the
help of the command line is made from this file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict

from insnav.exceptions import KEYWORDS
from insnav.units import UNITS

if TYPE_CHECKING:
    import pandas as pd

    from insnav.filter.prepare import Start
    from insnav.imu.specification import ImuSpec
    from insnav.input.readers.positions import Height
    from insnav.types import FloatArray, Sampling, Stamp

IMU, GPS, AIDING, START = "IMU", "GPS and reference", "Other aiding", "Start"  # groups of options

Kind = Literal["text", "file", "number", "numbers", "vector", "span", "columns"]


@dataclass(frozen=True, slots=True)
class Input:
    """How an input is given on the command line, and what makes sense."""

    option: str  # its name there; empty if it has none
    metavar: str  # what its value looks like
    meaning: str  # for the help; units of the command line, which are degrees where the library has radians
    group: str  # options it stands with
    kind: Kind = "text"  # how the text becomes a value
    unit: str = ""  # unit on the command line and in messages
    # smallest and largest sensible value [`unit`]
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()  # values there are; any if empty

    @property
    def size(self) -> float:
        """Size of its unit in SI."""
        return UNITS[self.unit][1] if self.unit else 1.0


class Inputs(TypedDict, total=False):
    """What may be given with a recording, as `INPUTS` says; None is as if it were absent.

    SI and radians. Lever arms are forward, right, down; ``rate`` is for arrays without times; ``ref_sd`` is that of
    positions [m], or of positions and velocities [m], [m/s]; ``logs`` are further sensors by name:
    ``{"speedometer": "speed.csv", "magnetometer": "imu.csv"}``.
    """

    imu_model: str | Path | ImuSpec | None
    noise: Literal["estimate", "model"] | None
    calibration: str | Path | None
    axes: str | None
    units: Mapping[str, str] | str | None
    columns: Mapping[str, str] | None
    sampling: Sampling | None
    stamp: Stamp | None
    rate: float | None
    time_offset: float | None
    topic: str | None
    lever_arm: Sequence[float] | FloatArray | None
    lever_arm_sd: float | None
    gps_height: Height | None
    gps_delay: float | None
    gps_columns: Mapping[str, str] | None
    gps_heading_sd: float | None
    ref_lever_arm: Sequence[float] | FloatArray | None
    ref_columns: Mapping[str, str] | None
    ref_sd: float | Sequence[float] | None
    fixed_height_sd: float | None
    static: tuple[float, float] | None
    heading: float | None
    initial: str | Path | Start | None
    logs: Mapping[str, str | Path | pd.DataFrame] | None
    lat: float | None
    height: float | None


INPUTS: dict[str, Input] = {
    "imu_model": Input(
        "--imu",
        "MODEL",
        "IMU error specification: consumer, automotive, industrial, tactical, navigation, or an imu.toml. "
        "[nearest to the noise at rest]",
        IMU,
    ),
    "noise": Input(
        "--noise",
        "HOW",
        "Noise of IMU and fixes: estimate it from the innovations of the drive, or take the model as it is: estimate, "
        "model. [estimate; model with --imu]",
        IMU,
        choices=("estimate", "model"),
    ),
    "calibration": Input("--calibration", "FILE", "Known IMU errors, corrected first (TOML).", IMU, "file"),
    "axes": Input(
        "--imu-axes",
        "XYZ",
        "Where the sensor's x, y, z point: three of Forward, Back, Left, Right, Up, Down, such as FLU; or roll, pitch, "
        "yaw in the vehicle, deg, such as 0,0,30. [found from gravity and the drive, else FRD]",
        IMU,
    ),
    "units": Input(
        "--imu-units", "GYRO,ACCEL", "Units of the samples, such as deg/s,g. [from header and physics]", IMU
    ),
    "columns": Input(
        "--columns",
        "NAME=HEADER,…",
        "Headers of the IMU file that are not understood by themselves: gyro_x=Gx,time_s=t.",
        IMU,
        "columns",
    ),
    "sampling": Input(
        "--imu-sampling",
        "HOW",
        "A sample is the mean over its interval, the value at an instant, or an increment: "
        "mean, instant, increment. [mean; increment if so named]",
        IMU,
        choices=("mean", "instant", "increment"),
    ),
    "stamp": Input(
        "--imu-stamp",
        "WHERE",
        "Timestamps mark start, mid or end of the interval. [end]",
        IMU,
        choices=("start", "mid", "end"),
    ),
    "time_offset": Input(
        "--imu-time-offset",
        "S",
        "Added to the IMU times to bring them to the clock of the fixes. [0; Unix time and GPS time are told apart]",
        IMU,
        "number",
        "s",
    ),
    "rate": Input("", "HZ", "Sampling rate of arrays without times.", IMU, "number", "Hz", 0.01),
    "topic": Input(
        "--topic", "NAME,…", "Sensors to take from a log that holds several of a kind, by their topics.", IMU
    ),
    "lever_arm": Input(
        "--lever-arm", "F,R,D", "Antenna seen from the IMU: forward, right, down, m. [estimated]", GPS, "vector", "m"
    ),
    "lever_arm_sd": Input(
        "--lever-arm-sd",
        "M",
        "Standard deviation of each component of that; above 0 it is estimated, which takes turns. [0; 2 without "
        "--lever-arm]",
        GPS,
        "number",
        "m",
        0.0,
        10.0,
    ),
    "gps_height": Input(
        "--gps-height",
        "FROM",
        "GPS heights are ellipsoidal or msl. [by the header, else ellipsoidal]",
        GPS,
        choices=("ellipsoidal", "msl"),
    ),
    "gps_delay": Input(
        "--gps-delay",
        "S",
        "How much older the fixes are than their timestamps. [estimated]",
        GPS,
        "number",
        "s",
        -10.0,
        10.0,
    ),
    "gps_columns": Input("--gps-columns", "NAME=HEADER,…", "The same as --columns, for the GPS file.", GPS, "columns"),
    "gps_heading_sd": Input(
        "--gps-heading-sd",
        "DEG",
        "Standard deviation of the heading of the fixes (two antennas); 0 leaves it unused. [0]",
        GPS,
        "number",
        "deg",
        0.0,
        90.0,
    ),
    "ref_lever_arm": Input(
        "--ref-lever-arm",
        "F,R,D",
        "Point of the reference seen from the IMU, body axes, m. [the IMU; of positions without attitude the antenna]",
        GPS,
        "vector",
        "m",
    ),
    "ref_columns": Input("--ref-columns", "NAME=HEADER,…", "The same as --columns, for the reference.", GPS, "columns"),
    "ref_sd": Input(
        "--ref-sd",
        "M[,M/S]",
        "Standard deviation of the reference where errors are compared with their prediction; its velocities count "
        "only if theirs is given. [0.05, or as in the file]",
        GPS,
        "numbers",
    ),
    "fixed_height_sd": Input(
        "--fixed-height",
        "M",
        "Height-constrained: the vehicle stays within so much of the height of its first fix; 0 does not assume "
        "it. [0]",
        GPS,
        "number",
        "m",
        0.0,
        1000.0,
    ),
    "static": Input("--static", "FROM:TO", "Stationary interval for the alignment, s. [found]", START, "span", "s"),
    "heading": Input(
        "--heading", "DEG", "Heading at the start, good to 2 deg. [found]", START, "number", "deg", -180.0, 360.0
    ),
    "initial": Input(
        "--initial", "FILE", "Initial state and its standard deviations (JSON) instead of an alignment.", START, "file"
    ),
    "logs": Input("", "FILE", "Logs of further sensors, by name.", AIDING),
    "lat": Input(
        "--lat",
        "DEG",
        "Latitude, north positive. [of the fixes; of a budget at rest 45]",
        START,
        "number",
        "deg",
        -90.0,
        90.0,
    ),
    "height": Input("--height", "M", "Height above the ellipsoid. [0]", START, "number", "m", -1e5, 1e5),
}
# further sensors: the key of their log, and their option
LOGS: dict[str, Input] = {
    "speedometer": Input(
        "--speed", "FILE", "Log of a speedometer, on a clock of its own: time, speed.", AIDING, "file"
    ),
    "magnetometer": Input(
        "--magnetometer", "FILE", "Log of a magnetometer: time, field x, y, z, or heading.", AIDING, "file"
    ),
}
KEYWORDS.update({each.option: key for key, each in INPUTS.items() if each.option})
