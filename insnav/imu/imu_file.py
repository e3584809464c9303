"""The IMU file (``imu.toml``): how large the errors of an IMU are, with a unit in every value."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from insnav.config_file import Axes, Table, axes, quantity, read_toml, scalar, signed_scalar, validate
from insnav.exceptions import ConfigError
from insnav.imu.model import ClockSpec, ImuSpec, InitialSpec, SensorSpec
from insnav.imu.presets import PRESETS, preset_path
from insnav.units import UNITS

_PER_ROOT_HOUR = "/sqrt(h)"


def _positions(value: object) -> tuple[Axes, Axes, Axes]:
    rows = value if isinstance(value, list) else []
    if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
        raise PydanticCustomError("wrong_value", "must be three places of three lengths, the x accelerometer first")
    x, y, z = ([quantity(item, "length", signed=True) for item in row] for row in rows)
    return (x[0], x[1], x[2]), (y[0], y[1], y[2]), (z[0], z[1], z[2])


class _Sensor(Table):
    """Keys that both sensor tables share, and what must hold between them."""

    correlation_time: Annotated[float | None, scalar("time")] = None
    scale_factor: Annotated[Axes | None, axes("ratio")] = None
    misalignment: Annotated[Axes | None, axes("angle")] = None
    asymmetry: Annotated[Axes | None, axes("ratio")] = None
    scale_slope: Annotated[Axes | None, axes("ratio per kelvin")] = None

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
    flicker: Annotated[Axes | None, axes("rate")] = None
    rate_ramp: Annotated[Axes | None, axes("rate ramp")] = None
    quantisation: Annotated[Axes | None, axes("angle")] = None
    resolution: Annotated[Axes | None, axes("rate")] = None
    range: Annotated[Axes | None, axes("rate")] = None
    vibration_rectification: Annotated[Axes | None, axes("rate per acceleration squared")] = None
    quadratic: Annotated[Axes | None, axes("per rate")] = None
    bias_slope: Annotated[Axes | None, axes("rate per kelvin")] = None
    g_sensitivity: Annotated[Axes | None, axes("rate per acceleration")] = None


class _Accel(_Sensor):
    bias: Annotated[Axes | None, axes("acceleration")] = None
    bias_instability: Annotated[Axes | None, axes("acceleration")] = None
    random_walk: Annotated[Axes | None, axes("velocity random walk")] = None
    rate_random_walk: Annotated[Axes | None, axes("acceleration", per_root_time=True)] = None
    flicker: Annotated[Axes | None, axes("acceleration")] = None
    rate_ramp: Annotated[Axes | None, axes("acceleration ramp")] = None
    quantisation: Annotated[Axes | None, axes("velocity")] = None
    resolution: Annotated[Axes | None, axes("acceleration")] = None
    range: Annotated[Axes | None, axes("acceleration")] = None
    vibration_rectification: Annotated[Axes | None, axes("per acceleration")] = None
    quadratic: Annotated[Axes | None, axes("per acceleration")] = None
    bias_slope: Annotated[Axes | None, axes("acceleration per kelvin")] = None
    positions: Annotated[tuple[Axes, Axes, Axes] | None, PlainValidator(_positions)] = None


class _Clock(Table):
    offset: Annotated[float, signed_scalar("time")] = 0.0
    drift: Annotated[float, signed_scalar("ratio")] = 0.0
    jitter: Annotated[float, scalar("time")] = 0.0
    lost_every: Annotated[float, scalar("time")] = 0.0
    lost_length: Annotated[float, scalar("time")] = 0.0


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
    clock: _Clock | None = None


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
# the same of what is only simulated: few datasheets have it, and nobody misses it
_FURTHER_UNITS = (
    ("flicker", "deg/h", "ug"),
    ("rate_ramp", "deg/h/h", "ug/h"),
    ("quantisation", "arcsec", "m/s"),
    ("resolution", "deg/s", "mg"),
    ("range", "deg/s", "g"),
    ("vibration_rectification", "deg/h/g^2", "ug/g^2"),
    ("asymmetry", "ppm", "ppm"),
    ("quadratic", "ppm/(deg/s)", "ug/g^2"),
    ("bias_slope", "deg/h/K", "ug/K"),
    ("scale_slope", "ppm/K", "ppm/K"),
    ("g_sensitivity", "deg/h/g", ""),
)
_CLOCK_UNITS = (("offset", "s"), ("drift", "ppm"), ("jitter", "s"), ("lost_every", "s"), ("lost_length", "s"))
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
    content = read_toml(path)
    sensors = [table for table in (content.get("gyro"), content.get("accel")) if isinstance(table, dict)]
    if any("matrix" in table or "raw" in table for table in sensors):
        raise ConfigError(
            "this is a calibration, not an IMU file",
            where=str(path),
            why="it says which errors a sensor has, not how large they may be",
            fix="give it to --calibration; an imu.toml comes from insnav allan, or from a datasheet",
        )
    file = validate(_ImuFile, content, str(path))
    if file.gyro is None and file.accel is None:
        raise ConfigError("the file describes no IMU", where=str(path), fix="it needs the tables [gyro] and [accel]")
    absent: list[str] = []
    gyro = _sensor("gyro", file.gyro or _Gyro(), absent)
    accel = _sensor("accel", file.accel or _Accel(), absent)
    initial = None
    if file.initial is not None:
        absent += [f"initial.{key}" for key, _ in _INITIAL_UNITS if getattr(file.initial, key) is None]
        initial = InitialSpec(**{key: getattr(file.initial, key) or 0.0 for key, _ in _INITIAL_UNITS})
    clock = file.clock or _Clock()
    if (clock.lost_every > 0.0) != (clock.lost_length > 0.0):
        raise ConfigError("lost_every and lost_length go together", where=f"{path}: clock", fix="give both, above zero")
    positions = (file.accel.positions if file.accel is not None else None) or ((0.0,) * 3,) * 3
    return ImuSpec(
        file.name or path.stem,
        gyro,
        accel,
        initial,
        file.source.strip(),
        tuple(absent),
        ClockSpec(**{key: getattr(clock, key) for key, _ in _CLOCK_UNITS}),
        np.array(positions),
    )


def _sensor(name: str, table: _Gyro | _Accel, absent: list[str]) -> SensorSpec:
    given: dict[str, Any] = {}
    for key, _, _ in _SENSOR_UNITS:
        value = getattr(table, key)
        if value is None:
            if key != _UNREPORTED:
                absent.append(f"{name}.{key}")
        else:
            given[key] = value if key == "correlation_time" else np.array(value)
    for key, _, _ in _FURTHER_UNITS:
        value = getattr(table, key, None)
        if value is not None:
            given[key] = np.array(value)
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
        for row in _FURTHER_UNITS:
            value = getattr(sensor, row[0])
            if np.any(value):
                texts = [_text(float(item), row[index]) for item in value]
                table[row[0]] = texts if len(set(texts)) > 1 else texts[0]
        content[name] = table
    if np.any(spec.positions):
        content["accel"]["positions"] = [[_text(float(item), "m") for item in row] for row in spec.positions]
    if spec.clock != ClockSpec():
        content["clock"] = {key: _text(getattr(spec.clock, key), unit) for key, unit in _CLOCK_UNITS}
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
