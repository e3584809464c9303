"""What may be given with a recording: one set of names, meanings and limits for `insnav.load` and every command."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.filter.prepare import Start
from insnav.imu.specification import ImuSpec
from insnav.input.interpret.schema import LOG_SCHEMAS
from insnav.types import FloatArray, Sampling, Stamp
from insnav.units import DEG

if TYPE_CHECKING:
    import pandas as pd


class Inputs(TypedDict, total=False):
    """What may be given with a recording; None is as if it were absent.

    Attributes
    ----------
    imu_model : str, Path or ImuSpec
        IMU error specification: a preset such as ``automotive``, an ``imu.toml``, or the thing itself; by default the
        preset nearest to the noise of the stationary part.
    calibration : str or Path
        Known IMU errors, corrected first (``calibration.toml``).
    axes, units, columns, sampling, stamp
        How to understand the IMU data, as in `insnav.read_imu`.
    rate : float
        Sampling rate of plain arrays without times [Hz].
    lever_arm : three numbers
        Antenna seen from the IMU, body axes [m].
    lever_arm_sd : float
        Standard deviation of each component of that [m]; above zero it is estimated.
    gps_delay : float
        How much older the fixes are than their timestamps [s]; estimated by default.
    gps_height : {"ellipsoidal", "msl"}
        What GPS heights are; by default as the header says, else ellipsoidal.
    gps_columns : mapping of str to str
        As `columns`, for the GPS data.
    gps_heading_sd : float
        Standard deviation of the heading of the fixes (two antennas) [rad]; zero leaves it unused.
    ref_columns : mapping of str to str
        As `columns`, for the reference.
    ref_lever_arm : three numbers
        Point of the reference seen from the IMU, body axes [m]; by default the IMU where a run is evaluated, the
        antenna where fixes are replaced (outage, budget).
    ref_sd : one or two numbers
        Standard deviation of the reference position [m] and velocity [m/s]; velocities count only if theirs is given.
    heading : float
        Heading at the start, good to 2 deg [rad].
    initial : str, Path or Start
        Initial state with its standard deviations instead of an alignment.
    static : two numbers
        Stationary interval for the alignment [s].
    logs : mapping of str to path or data frame
        Further sensors that aid the filter, by name: ``{"speedometer": "speed.csv"}``, ``{"magnetometer": "imu.csv"}``.
    fixed_height_sd : float
        The vehicle stays within so much of the height of its first fix [m]; zero does not assume it.
    lat, height : float
        Place of a stationary record without GPS [rad], [m].
    """

    imu_model: str | Path | ImuSpec | None
    calibration: str | Path | None
    axes: str | None
    units: Mapping[str, str] | str | None
    columns: Mapping[str, str] | None
    sampling: Sampling | None
    stamp: Stamp | None
    rate: float | None
    lever_arm: Sequence[float] | FloatArray | None
    lever_arm_sd: float | None
    gps_delay: float | None
    gps_height: Literal["ellipsoidal", "msl"] | None
    gps_columns: Mapping[str, str] | None
    gps_heading_sd: float | None
    ref_columns: Mapping[str, str] | None
    ref_lever_arm: Sequence[float] | FloatArray | None
    ref_sd: float | Sequence[float] | None
    heading: float | None
    initial: str | Path | Start | None
    static: tuple[float, float] | None
    logs: Mapping[str, str | Path | pd.DataFrame] | None
    fixed_height_sd: float | None
    lat: float | None
    height: float | None


_LONGEST_LEVER = 100.0  # a longer one was given in another unit [m]
# smallest and largest sensible value, unit it is shown in, and its size in SI
_LIMITS: dict[str, tuple[float, float, str, float]] = {
    "lever_arm_sd": (0.0, 10.0, "m", 1.0),
    "gps_delay": (-10.0, 10.0, "s", 1.0),
    "gps_heading_sd": (0.0, 90.0, "deg", DEG),
    "fixed_height_sd": (0.0, 1000.0, "m", 1.0),
    "heading": (-720.0, 720.0, "deg", DEG),
    "lat": (-90.0, 90.0, "deg", DEG),
    "height": (-1e5, 1e5, "m", 1.0),
}


def checked(inputs: Inputs) -> Inputs:
    """Check what was given, and read the initial state if it is a file.

    Parameters
    ----------
    inputs : Inputs

    Returns
    -------
    Inputs
        `initial` as `Start`.

    Raises
    ------
    ConfigError
        An unknown name, or a value that makes no sense; `where` is the name.
    InputError
        The file of the initial state cannot be read or is incomplete.
    """
    unknown = sorted(set(inputs) - set(Inputs.__annotations__))
    if unknown:
        raise ConfigError(f"{unknown[0]!r} is unknown", fix=f"known are {', '.join(Inputs.__annotations__)}")
    values: Mapping[str, object] = inputs
    for key, (low, high, unit, size) in _LIMITS.items():
        value = values.get(key)
        if isinstance(value, int | float) and not low <= value / size <= high:  # NaN is not within either
            raise ConfigError(
                f"{value / size:g} {unit} is not a sensible value", where=key, fix=f"{low:g} to {high:g} {unit} are"
            )
    vector(inputs, "lever_arm")
    vector(inputs, "ref_lever_arm")
    span = inputs.get("static")
    if span is not None and not span[1] > span[0]:
        raise ConfigError(f"{span[0]:g} to {span[1]:g} s ends before it begins", where="static")
    reference_sd(inputs)
    for name in inputs.get("logs") or {}:
        if name not in LOG_SCHEMAS:
            raise ConfigError(f"a {name!r} is no known sensor", where="logs", fix=f"known are {', '.join(LOG_SCHEMAS)}")
    initial = inputs.get("initial")
    return {**inputs, "initial": read_start(Path(initial)) if isinstance(initial, str | Path) else initial}


def vector(inputs: Inputs, key: Literal["lever_arm", "ref_lever_arm"]) -> FloatArray | None:
    """Lever arm ``(3,)`` in body axes [m]; None if it was not given."""
    value = inputs.get(key)
    if value is None:
        return None
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ConfigError(f"{value} is not three numbers", where=key, fix="forward, right, down in metres")
    if float(np.linalg.norm(array)) > _LONGEST_LEVER:
        raise ConfigError(
            f"{', '.join(f'{each:g}' for each in array)} is longer than {_LONGEST_LEVER:g} m",
            where=key,
            fix="give it in metres, body axes",
        )
    return array


def reference_sd(inputs: Inputs) -> tuple[float, float | None] | None:
    """Standard deviation of the reference: position [m], and velocity [m/s] if it was given."""
    value = inputs.get("ref_sd")
    if value is None:
        return None
    numbers = [float(each) for each in np.atleast_1d(value)]
    if len(numbers) > 2 or not all(0.0 < each < math.inf for each in numbers):
        raise ConfigError(f"{value} is not one or two numbers above zero", where="ref_sd", fix="0.05 or 0.05,0.02")
    return numbers[0], numbers[1] if len(numbers) == 2 else None


def options_of(inputs: Inputs, **others: object) -> dict[str, object]:
    """Everything that was given, for `insnav.result.Result.options`."""
    named = {key: value.name if isinstance(value, ImuSpec) else value for key, value in inputs.items()}
    return {key: value for key, value in {**named, **others}.items() if value is not None}


_START_KEYS = {
    "time_s": 0,
    "lat_deg": 0,
    "lon_deg": 0,
    "height_m": 0,
    "v_n_m_s": 3,
    "roll_pitch_heading_deg": 3,
    "sd_position_m": 3,
    "sd_velocity_m_s": 3,
    "sd_attitude_deg": 3,
}


def read_start(path: Path) -> Start:
    """Read an initial state from a JSON file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Start

    Raises
    ------
    InputError
        It cannot be read, or is incomplete.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("cannot read the initial state", where=str(path), why=str(error)) from error
    values: dict[str, FloatArray] = {}
    wrong = []
    for key, length in _START_KEYS.items():
        try:
            value = np.asarray(content[key], dtype=float)
        except (KeyError, TypeError, ValueError):
            value = np.array(np.nan)
        good = value.shape == ((length,) if length else ()) and np.isfinite(value).all()
        if not good or (key.startswith("sd_") and not (value > 0).all()):
            wrong.append(key)
        values[key] = value
    if wrong:
        raise InputError(
            "the initial state is incomplete",
            where=f"{path}: {', '.join(wrong)}",
            why="each of time_s, lat_deg, lon_deg, height_m is a number; v_n_m_s, roll_pitch_heading_deg, "
            "sd_position_m, sd_velocity_m_s, sd_attitude_deg are lists of three, standard deviations positive",
            fix="complete the file, or leave --initial out: insnav then aligns by itself",
        )
    return Start(
        float(values["time_s"]),
        np.array([values["lat_deg"] * DEG, values["lon_deg"] * DEG, values["height_m"]]),
        values["v_n_m_s"],
        values["roll_pitch_heading_deg"] * DEG,
        values["sd_position_m"],
        values["sd_velocity_m_s"],
        values["sd_attitude_deg"] * DEG,
    )
