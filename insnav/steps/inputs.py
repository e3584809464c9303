"""Inputs of a recording: one list of names, meanings and limits for `insnav.load` and every command.

A new input is two entries: its type in `Inputs`, and its meaning in ``inputs.toml``. The help of the command line uses
this file, so it imports nothing heavy.
"""

from __future__ import annotations

import math
import tomllib
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
    from insnav.input.readers.imu import AccelSign
    from insnav.input.readers.positions import Height
    from insnav.types import FloatArray, Sampling, Stamp

NoiseChoice = Literal["estimate", "fixes", "model"]
ExplainChoice = Literal["on", "off"]
Kind = Literal["text", "file", "number", "numbers", "vector", "span", "columns"]


@dataclass(frozen=True, slots=True)
class Input:
    """Command-line form of an input, and its limits."""

    option: str  # option name; empty without option
    metavar: str  # placeholder of the value
    meaning: str  # text for the help; in command-line units, with degrees where the library has radians
    group: str  # group of the option
    kind: Kind = "text"  # conversion of the text to a value
    unit: str = ""  # unit on the command line and in messages
    # smallest and largest plausible value [`unit`]
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()  # allowed values; any if empty

    @property
    def size(self) -> float:
        """Factor from `unit` to the SI unit."""
        return UNITS[self.unit][1] if self.unit else 1.0


class SampleInputs(TypedDict, total=False):
    """Inputs for reading the samples of an IMU; see `Inputs`."""

    calibration: str | Path | None
    axes: str | None
    units: Mapping[str, str] | str | None
    columns: Mapping[str, str] | None
    sampling: Sampling | None
    stamp: Stamp | None
    accel_sign: AccelSign | None
    topic: str | None


class Inputs(SampleInputs, total=False):
    """Inputs of a recording, see `INPUTS`; None means absent.

    Values are in SI units and radians. Lever arms are forward, right, down. ``rate``: sampling rate of arrays without
    times. ``ref_sd``: of positions [m], or of positions and velocities [m], [m/s]. ``logs``: further sensors by name:
    ``{"speedometer": "speed.csv", "magnetometer": "imu.csv"}``. ``faults``: rates and sizes of faults by kind, or a
    file of them: ``{"offset": {"rate": "0.2 1/h", "size": "30 m"}}``.
    """

    imu_model: str | Path | ImuSpec | None
    noise: NoiseChoice | None
    rate: float | None
    time_offset: float | None
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
    explain: ExplainChoice | None
    faults: str | Path | Mapping[str, Mapping[str, str]] | None
    logs: Mapping[str, str | Path | pd.DataFrame] | None
    lat: float | None
    height: float | None


_FILE = tomllib.loads(Path(__file__).with_name("inputs.toml").read_text(encoding="utf-8"))
INPUTS, LOGS = (
    {key: Input(**each | {"choices": tuple(each.get("choices", ()))}) for key, each in _FILE[table].items()}
    for table in ("inputs", "logs")
)
KEYWORDS.update({each.option: key for key, each in INPUTS.items() if each.option})
