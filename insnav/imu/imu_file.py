"""IMU file (``imu.toml``): error specification of an IMU, with a unit in every value; and calibration file.

`insnav.imu.specification.TERMS` defines the keys and units of its sensor tables. Kalibr and related programs use
another file (``imu.yaml``) with white noise and bias random walk. A calibration file (``calibration.toml``) has known
errors of one IMU, measured = matrix @ true + bias; ``docs/howto/calibration.md`` shows every key.

References
----------
Kalibr wiki, "IMU Noise Model": ``noise_density`` [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]; ``random_walk``
[rad/s^2/sqrt(Hz)], [m/s^3/sqrt(Hz)].
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tomli_w
from pydantic import PlainValidator, model_validator

from insnav.config_file import (
    Table,
    axes,
    matrix_of,
    preset_or_file,
    read_short,
    read_toml,
    scalar,
    similar,
    text,
    validate,
    with_fields,
    wrong,
)
from insnav.exceptions import ConfigError
from insnav.imu.specification import FOLDER, PRESETS, ClockSpec, ImuSpec, InitialSpec, Sensor, SensorSpec, terms_of
from insnav.units import UNITS

if TYPE_CHECKING:  # the library of parts is loaded only if the IMU is a real part
    from insnav.imu.library import Part
import datetime

from insnav.config_file import Axes, Matrix, Model, number
from insnav.imu.model import SHAPES, AxisMap, DynamicMap, ErrorTerms, ImuErrors, RawScale
from insnav.units import si_unit


class _Sensor(Table):
    """Fields and constraints of both sensor tables; `_with_terms` adds the error terms."""

    correlation_time: Annotated[float | None, scalar("time")] = None
    positions: None = None  # only accelerometers have positions

    above_zero = ("correlation_time",)

    @model_validator(mode="after")
    def _process_is_complete(self) -> _Sensor:
        instability = getattr(self, "bias_instability", None)
        if instability and any(instability) and self.correlation_time is None:
            raise wrong("imu.instability_without_time")
        return self


class _ImuFile(Table):
    name: str | None = None
    source: str = ""
    gyro: _Sensor | None = None
    accel: _Sensor | None = None
    initial: Table | None = None
    clock: Table | None = None


def _with_terms(sensor: Sensor, **more: PlainValidator) -> type[_Sensor]:
    return with_fields(_Sensor, {term.key: axes(term.dimension) for term in terms_of(sensor)} | more)


def _of_units(units: dict[str, str], signed: tuple[str, ...] = ()) -> type[Table]:
    """Build a table type from the units of its keys."""
    return with_fields(Table, {key: scalar(UNITS[unit][0], signed=key in signed) for key, unit in units.items()})


_LARGEST = 1e6  # largest accepted error in SI units; its square is still finite
_CLOCK_UNITS = {"offset": "s", "drift": "ppm", "jitter": "s", "lost_every": "s", "lost_length": "s"}
# keys written first, in this order: digests of the text depend on the order
_FIRST = ("bias", "bias_instability", "correlation_time", "random_walk", "rate_random_walk")
_INITIAL_UNITS = {"position": "m", "velocity": "m/s", "tilt": "deg", "heading": "deg"}
_TABLES = {
    "gyro": _with_terms("gyro"),
    "accel": _with_terms("accel", positions=matrix_of("length")),
    "initial": _of_units(_INITIAL_UNITS),
    "clock": _of_units(_CLOCK_UNITS, signed=("offset", "drift")),
}
_FILE = with_fields(_ImuFile, _TABLES)


_YAML_LINE = re.compile(r"(?m)^\s*(\w+)\s*:\s*([-+.\deE]+)\s*(?:#.*)?$")
# by name of a sensor in Kalibr: its name in insnav, units of noise density and of random walk
_KALIBR: dict[str, tuple[Sensor, str, str]] = {
    "accelerometer": ("accel", "m/s/sqrt(s)", "m/s^2/sqrt(s)"),
    "gyroscope": ("gyro", "rad/sqrt(s)", "rad/s/sqrt(s)"),
}


def part_of(preset_or_path: str) -> Part | None:
    """Find a real IMU by name; None for a preset, a file or an unknown name."""
    if preset_or_path in PRESETS or Path(preset_or_path).suffix in (".toml", ".yaml", ".yml"):
        return None
    from insnav.imu.library import find_part

    return find_part(preset_or_path)


def load_imu(preset_or_path: str) -> ImuSpec:
    """Read the error specification of an IMU.

    Parameters
    ----------
    preset_or_path : str
        Name of a preset, or of a real part (see `insnav.imu.library`), or path of an IMU file.

    Returns
    -------
    ImuSpec
        In SI units and radians. Missing figures are zero and listed in `ImuSpec.absent`.

    Raises
    ------
    ConfigError
        No such preset or file, invalid TOML, or wrong keys or values, all at once.
    """
    part = part_of(preset_or_path)
    if part is not None:
        return part.spec
    path = preset_or_file(preset_or_path, FOLDER, PRESETS)
    if path is None:
        from insnav.imu.library import close_names

        known = similar(preset_or_path, PRESETS) | {"parts": close_names(preset_or_path)}
        raise ConfigError("imu.unknown", where="--imu", name=preset_or_path[:200], **known)
    try:
        content = _of_kalibr(path) if path.suffix in (".yaml", ".yml") else read_toml(path)
    except ConfigError as error:
        if path.suffix in (".toml", ".yaml", ".yml") or error.code not in ("config.too_long", "config.no_toml"):
            raise
        raise ConfigError("imu.no_specification", where="--imu", file=str(path)) from error
    sensors = [table for table in (content.get("gyro"), content.get("accel")) if isinstance(table, dict)]
    if any("matrix" in table or "raw" in table for table in sensors):
        raise ConfigError("imu.calibration_for_file", where=str(path))
    file = validate(_FILE, content, str(path))
    if file.gyro is None and file.accel is None:
        raise ConfigError("imu.empty_file", where=str(path))
    absent: list[str] = []
    gyro, accel = _sensor("gyro", file.gyro, absent), _sensor("accel", file.accel, absent)
    initial = None
    if file.initial is not None:
        given = file.initial.model_dump(exclude_none=True)
        absent += [f"initial.{key}" for key in _INITIAL_UNITS if key not in given]
        initial = InitialSpec(**given)
    clock = ClockSpec() if file.clock is None else ClockSpec(**file.clock.model_dump(exclude_none=True))
    if (clock.lost_every > 0.0) != (clock.lost_length > 0.0):
        raise ConfigError("imu.lost_samples", where=f"{path}: clock")
    positions = np.array((file.accel and file.accel.positions) or np.zeros((3, 3)))
    return ImuSpec(file.name or path.stem, gyro, accel, initial, file.source.strip(), tuple(absent), clock, positions)


def _of_kalibr(path: Path) -> dict[str, Any]:
    """Convert a Kalibr file to the content of an IMU file."""
    content: dict[str, Any] = {}
    for key, value in _YAML_LINE.findall(read_short(path).decode("utf-8", errors="replace")):
        sensor, _, figure = key.partition("_")
        if sensor in _KALIBR and figure in ("noise_density", "random_walk"):
            name, *units = _KALIBR[sensor]
            term, unit = ("rate_random_walk", units[1]) if figure == "random_walk" else ("random_walk", units[0])
            content.setdefault(name, {})[term] = f"{value} {unit}"
    return content


def to_kalibr(spec: ImuSpec, rate: float) -> str:
    """Write a Kalibr file (``imu.yaml``) with root mean squares over the axes. `rate`: sampling rate [Hz].

    The bias random walk combines rate random walk and the driving noise of the in-run bias, ``sd sqrt(2 / T)``.
    """
    lines = [f"# {spec.name}"]
    for sensor, (name, *_) in _KALIBR.items():
        figures: SensorSpec = getattr(spec, name)
        walk = np.hypot(figures.rate_random_walk, figures.bias_instability * math.sqrt(2.0 / figures.correlation_time))
        for figure, axes_of in (("noise_density", figures.random_walk), ("random_walk", walk)):
            lines.append(f"{sensor}_{figure}: {float(np.sqrt(np.mean(np.square(axes_of)))):.6g}")
    return "\n".join([*lines, "rostopic: /imu/data", f"update_rate: {rate:.6g}", ""])


def _sensor(name: Sensor, table: _Sensor | None, absent: list[str]) -> SensorSpec:
    given = {} if table is None else table.model_dump(exclude_none=True, exclude={"positions"})
    usual = [*(term.key for term in terms_of(name) if term.usual), "correlation_time"]
    absent += [f"{name}.{key}" for key in usual if key not in given]
    time = given.pop("correlation_time", math.inf)
    values = {key: np.array(value) for key, value in given.items()}
    for key, value in values.items():
        if np.abs(value).max() > _LARGEST:
            raise ConfigError("imu.impossible_value", where=f"{name}.{key}", value=float(np.abs(value).max()))
    return SensorSpec(correlation_time=time, **values)


def to_toml(spec: ImuSpec) -> str:
    """Write an IMU file. Returns: its text, from which `load_imu` reads the same values within a relative 1e-14."""
    content: dict[str, Any] = {"name": spec.name} | ({"source": spec.source} if spec.source else {})
    sensors: tuple[tuple[Sensor, SensorSpec], ...] = (("gyro", spec.gyro), ("accel", spec.accel))
    for name, sensor in sensors:
        texts = (
            {"correlation_time": text(sensor.correlation_time, "s")} if math.isfinite(sensor.correlation_time) else {}
        )
        for term in terms_of(name):
            value = getattr(sensor, term.key)
            if np.any(value) or (term.usual and f"{name}.{term.key}" not in spec.absent):
                texts[term.key] = text(value, term.unit)
        content[name] = {key: texts.pop(key) for key in _FIRST if key in texts} | texts
    if np.any(spec.positions):
        content["accel"]["positions"] = text(spec.positions, "m")
    if spec.clock != ClockSpec():
        content["clock"] = {key: text(getattr(spec.clock, key), unit) for key, unit in _CLOCK_UNITS.items()}
    if spec.initial is not None:
        content["initial"] = {
            key: text(getattr(spec.initial, key), unit)
            for key, unit in _INITIAL_UNITS.items()
            if f"initial.{key}" not in spec.absent
        }
    return tomli_w.dumps(content)


def _date(value: object) -> str:
    if isinstance(value, str | datetime.date | datetime.datetime):
        return str(value)
    raise wrong("imu.no_date")


def _numbers(value: object) -> list[float]:
    if not isinstance(value, list):
        raise wrong("imu.no_list")
    return [number(item) for item in value]


Numbers = Annotated[list[float], PlainValidator(_numbers)]


class _AxisMap(Table):
    rate_rad_s: Numbers
    error_rad_s: Numbers


class _Map(Table):
    x: _AxisMap | None = None
    y: _AxisMap | None = None
    z: _AxisMap | None = None


class _Raw(Table):
    unit: str
    zero: Numbers


class _GyroRaw(_Raw):
    scale_per_rad_s: Numbers


class _AccelRaw(_Raw):
    scale_per_m_s2: Numbers


class _Calibrated(Table):
    matrix: Annotated[Matrix, matrix_of()] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class _Gyro(_Calibrated):
    bias: Annotated[Axes, axes("rate", signed=True)] = (0.0, 0.0, 0.0)
    raw: _GyroRaw | None = None
    map: _Map | None = None


class _Accel(_Calibrated):
    bias: Annotated[Axes, axes("acceleration", signed=True)] = (0.0, 0.0, 0.0)
    raw: _AccelRaw | None = None


def _dimensions(sensor: Sensor) -> dict[str, str]:
    """Return the dimensions of calibration terms beyond bias and matrix, by their name in `ErrorTerms`."""
    known = {term.key: term.dimension for term in terms_of(sensor) if term.key in SHAPES}
    return known if sensor == "gyro" else known | {"positions": "length"}


def _with_calibrated_terms(base: type[Model], sensor: Sensor) -> type[Model]:
    kinds = _dimensions(sensor).items()
    return with_fields(
        base, {key: axes(kind, signed=True) if SHAPES[key] == (3,) else matrix_of(kind) for key, kind in kinds}
    )


class _CalibrationFile(Table):
    name: str = ""
    date: Annotated[str, PlainValidator(_date)] = ""
    temperature_c: Annotated[float | None, PlainValidator(number)] = None
    gyro: _Gyro | None = None
    accel: _Accel | None = None


_CALIBRATION = with_fields(
    _CalibrationFile, {"gyro": _with_calibrated_terms(_Gyro, "gyro"), "accel": _with_calibrated_terms(_Accel, "accel")}
)


def load_calibration(path: str | Path) -> ImuErrors:
    """Read the known errors of an IMU.

    Returns: errors that `insnav.imu.correct` removes. An absent table or key means no error.
    Raises: ConfigError: no such file, invalid TOML, wrong keys or values (all at once), or a singular matrix.
    """
    path = Path(path)
    content = read_toml(path)
    sensors = [table for table in (content.get("gyro"), content.get("accel")) if isinstance(table, dict)]
    if any("random_walk" in table for table in sensors):
        raise ConfigError("imu.file_for_calibration", where=str(path))
    file = validate(_CALIBRATION, content, str(path))
    if file.gyro is None and file.accel is None:
        raise ConfigError("imu.empty_calibration", where=str(path))
    gyro, accel = file.gyro or _Gyro(), file.accel or _Accel()
    try:
        return ImuErrors(
            gyro_bias=np.array(gyro.bias),
            gyro_matrix=np.array(gyro.matrix),
            accel_bias=np.array(accel.bias),
            accel_matrix=np.array(accel.matrix),
            name=file.name,
            date=file.date,
            temperature=file.temperature_c,
            gyro_map=_gyro_map(gyro.map),
            gyro_raw=_raw(gyro.raw, "scale_per_rad_s"),
            accel_raw=_raw(accel.raw, "scale_per_m_s2"),
            gyro_terms=_terms("gyro", gyro),
            accel_terms=_terms("accel", accel),
        )
    except ConfigError as error:
        error.where = f"{path}: {error.where}"
        raise


def _raw(table: _Raw | None, scale: str) -> RawScale | None:
    return None if table is None else RawScale(table.unit, np.array(table.zero), np.array(getattr(table, scale)))


def _gyro_map(table: _Map | None) -> DynamicMap | None:
    if table is None:
        return None
    given = (table.x, table.y, table.z)
    maps = (None if a is None else AxisMap(np.array(a.rate_rad_s), np.array(a.error_rad_s)) for a in given)
    return DynamicMap(tuple(maps))


def _terms(sensor: Sensor, table: Table) -> ErrorTerms | None:
    stated = table.model_dump(include=set(_dimensions(sensor)), exclude_none=True)
    terms = {key: np.array(value) for key, value in stated.items()}
    return ErrorTerms(**terms) if any(value.any() for value in terms.values()) else None


def calibration_to_toml(errors: ImuErrors) -> str:
    """Write a calibration file. Returns: its text, from which `load_calibration` reads exactly the same values."""
    content: dict[str, Any] = {"name": errors.name, "date": errors.date, "temperature_c": errors.temperature}
    content = {key: value for key, value in content.items() if value not in ("", None)}
    units: tuple[tuple[Sensor, str, str], ...] = (("gyro", "rad/s", "rad_s"), ("accel", "m/s^2", "m_s2"))
    for sensor, unit, suffix in units:
        raw, terms = getattr(errors, f"{sensor}_raw"), getattr(errors, f"{sensor}_terms")
        # SI units keep every bit, so that writing does not change a calibration
        table: dict[str, Any] = {
            "bias": text(getattr(errors, f"{sensor}_bias"), unit),
            "matrix": getattr(errors, f"{sensor}_matrix").tolist(),
        }
        if raw is not None:
            table["raw"] = {"unit": raw.unit, "zero": raw.zero.tolist(), f"scale_per_{suffix}": raw.scale.tolist()}
        dimensions = {} if terms is None else _dimensions(sensor)
        given = {key: (getattr(terms, key), si_unit(dimension)) for key, dimension in dimensions.items()}
        content[sensor] = table | {key: text(value, unit) for key, (value, unit) in given.items() if np.any(value)}
    if errors.gyro_map is not None:
        content["gyro"]["map"] = {
            axis: {"rate_rad_s": item.rate.tolist(), "error_rad_s": item.error.tolist()}
            for axis, item in zip("xyz", errors.gyro_map.axes, strict=True)
            if item is not None
        }
    return tomli_w.dumps(content)
