"""The IMU file (``imu.toml``): how large the errors of an IMU are, with a unit in every value."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import model_validator
from pydantic_core import PydanticCustomError

from insnav.exceptions import ConfigError
from insnav.imu.config import Axes, Table, axes, read_toml, scalar, validate
from insnav.imu.model import ImuSpec, InitialSpec, SensorSpec
from insnav.imu.presets import PRESETS, preset_path
from insnav.units import UNITS

_PER_ROOT_HOUR = "/sqrt(h)"


class _Sensor(Table):
    """Keys that both sensor tables share, and what must hold between them."""

    correlation_time: Annotated[float | None, scalar("time")] = None
    scale_factor: Annotated[Axes | None, axes("ratio")] = None
    misalignment: Annotated[Axes | None, axes("angle")] = None

    @model_validator(mode="after")
    def _process_is_complete(self) -> _Sensor:
        instability = getattr(self, "bias_instability", None)
        if self.correlation_time == 0.0:
            raise PydanticCustomError("wrong_value", "correlation_time must be more than zero")
        if instability and any(instability) and self.correlation_time is None:
            raise PydanticCustomError(
                "wrong_value", 'bias_instability needs a correlation_time, like correlation_time = "1 h"'
            )
        return self


class _Gyro(_Sensor):
    bias: Annotated[Axes | None, axes("rate")] = None
    bias_instability: Annotated[Axes | None, axes("rate")] = None
    random_walk: Annotated[Axes | None, axes("angle random walk")] = None
    rate_random_walk: Annotated[Axes | None, axes("rate", per_root_time=True)] = None


class _Accel(_Sensor):
    bias: Annotated[Axes | None, axes("acceleration")] = None
    bias_instability: Annotated[Axes | None, axes("acceleration")] = None
    random_walk: Annotated[Axes | None, axes("velocity random walk")] = None
    rate_random_walk: Annotated[Axes | None, axes("acceleration", per_root_time=True)] = None


class _Initial(Table):
    position: Annotated[float | None, scalar("length")] = None
    velocity: Annotated[float | None, scalar("velocity")] = None
    tilt: Annotated[float | None, scalar("angle")] = None
    heading: Annotated[float | None, scalar("angle")] = None


class _ImuFile(Table):
    name: str | None = None
    source: str = ""
    gyro: _Gyro | None = None
    accel: _Accel | None = None
    initial: _Initial | None = None


# in the order of the file: key, unit written for the gyros, unit written for the accelerometers
_SENSOR_UNITS = (
    ("bias", "deg/h", "ug"),
    ("bias_instability", "deg/h", "ug"),
    ("correlation_time", "s", "s"),
    ("random_walk", "deg/sqrt(h)", "m/s/sqrt(h)"),
    ("rate_random_walk", "deg/h" + _PER_ROOT_HOUR, "ug" + _PER_ROOT_HOUR),
    ("scale_factor", "ppm", "ppm"),
    ("misalignment", "mrad", "mrad"),
)
_INITIAL_UNITS = (("position", "m"), ("velocity", "m/s"), ("tilt", "deg"), ("heading", "deg"))
_UNREPORTED = "rate_random_walk"  # few datasheets have it and few need it


def load_imu(preset_or_path: str) -> ImuSpec:
    """Read how large the errors of an IMU are.

    Parameters
    ----------
    preset_or_path : str
        Name of a preset (see `insnav.imu.presets`) or path of an IMU file.

    Returns
    -------
    ImuSpec
        In SI units and radians. What the file does not give is zero and listed in `ImuSpec.absent`.

    Raises
    ------
    ConfigError
        No such preset or file, no TOML, or wrong keys or values: all of them at once.
    """
    if preset_or_path in PRESETS:
        return _load(preset_path(preset_or_path))
    path = Path(preset_or_path)
    try:
        found = path.exists()
    except (OSError, ValueError):  # too long a name, for one
        found = False
    if not found:
        close = difflib.get_close_matches(preset_or_path, PRESETS, n=1)
        raise ConfigError(
            f"{preset_or_path[:200]!r} is neither an IMU preset nor a file",
            where="--imu",
            fix=f"did you mean {close[0]!r}?" if close else f"presets are {', '.join(PRESETS)}",
        )
    return _load(path)


def _load(path: Path) -> ImuSpec:
    file = validate(_ImuFile, read_toml(path), str(path))
    if file.gyro is None and file.accel is None:
        raise ConfigError("the file describes no IMU", where=str(path), fix="it needs the tables [gyro] and [accel]")
    absent: list[str] = []
    gyro = _sensor("gyro", file.gyro or _Gyro(), absent)
    accel = _sensor("accel", file.accel or _Accel(), absent)
    initial = None
    if file.initial is not None:
        absent += [f"initial.{key}" for key, _ in _INITIAL_UNITS if getattr(file.initial, key) is None]
        initial = InitialSpec(**{key: getattr(file.initial, key) or 0.0 for key, _ in _INITIAL_UNITS})
    return ImuSpec(file.name or path.stem, gyro, accel, initial, file.source.strip(), tuple(absent))


def _sensor(name: str, table: _Gyro | _Accel, absent: list[str]) -> SensorSpec:
    given: dict[str, Any] = {}
    for key, _, _ in _SENSOR_UNITS:
        value = getattr(table, key)
        if value is None:
            if key != _UNREPORTED:
                absent.append(f"{name}.{key}")
        else:
            given[key] = value if key == "correlation_time" else np.array(value)
    return SensorSpec(**given)


def to_toml(spec: ImuSpec) -> str:
    """Write an IMU file.

    Parameters
    ----------
    spec : ImuSpec
        What to write; what is absent in it is left out.

    Returns
    -------
    str
        Text that `load_imu` reads back to the same values within 1e-14 of each.
    """
    content: dict[str, Any] = {"name": spec.name}
    if spec.source:
        content["source"] = spec.source
    for index, (name, sensor) in enumerate((("gyro", spec.gyro), ("accel", spec.accel)), start=1):
        table: dict[str, Any] = {}
        for row in _SENSOR_UNITS:
            key, value = row[0], getattr(sensor, row[0])
            if f"{name}.{key}" in spec.absent or (key == _UNREPORTED and not np.any(value)):
                continue
            if key != "correlation_time":
                texts = [_text(float(item), row[index]) for item in value]
                table[key] = texts if len(set(texts)) > 1 else texts[0]
            elif math.isfinite(value):
                table[key] = _text(value, row[index])
        content[name] = table
    if spec.initial is not None:
        content["initial"] = {
            key: _text(getattr(spec.initial, key), unit)
            for key, unit in _INITIAL_UNITS
            if f"initial.{key}" not in spec.absent
        }
    return tomli_w.dumps(content)


def _text(value: float, unit: str) -> str:
    known = unit.removesuffix(_PER_ROOT_HOUR) if unit not in UNITS else unit
    factor = UNITS[known][1] / (1.0 if known == unit else 60.0)
    return f"{value / factor:.15g} {unit}"
