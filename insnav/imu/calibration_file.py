"""Calibration file (``calibration.toml``): known errors of one IMU, measured = matrix @ true + bias.

An example with every key is in ``docs/howto/calibration.md``.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import PlainValidator

from insnav.config_file import (
    Axes,
    Matrix,
    Model,
    Table,
    axes,
    matrix_of,
    number,
    read_toml,
    text,
    validate,
    with_fields,
    wrong,
)
from insnav.exceptions import ConfigError
from insnav.imu.error_terms import Sensor, terms_of
from insnav.imu.model import SHAPES, AxisMap, DynamicMap, ErrorTerms, ImuErrors, RawScale
from insnav.units import si_unit


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


class _Sensor(Table):
    matrix: Annotated[Matrix, matrix_of()] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class _Gyro(_Sensor):
    bias: Annotated[Axes, axes("rate", signed=True)] = (0.0, 0.0, 0.0)
    raw: _GyroRaw | None = None
    map: _Map | None = None


class _Accel(_Sensor):
    bias: Annotated[Axes, axes("acceleration", signed=True)] = (0.0, 0.0, 0.0)
    raw: _AccelRaw | None = None


def _dimensions(sensor: Sensor) -> dict[str, str]:
    """Return the dimensions of calibration terms beyond bias and matrix, by their name in `ErrorTerms`."""
    known = {term.key: term.dimension for term in terms_of(sensor) if term.key in SHAPES}
    return known if sensor == "gyro" else known | {"positions": "length"}


def _with_terms(base: type[Model], sensor: Sensor) -> type[Model]:
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


_FILE = with_fields(_CalibrationFile, {"gyro": _with_terms(_Gyro, "gyro"), "accel": _with_terms(_Accel, "accel")})


def load_calibration(path: str | Path) -> ImuErrors:
    """Read the known errors of an IMU.

    Returns: errors for `insnav.imu.correct`. An absent table or key means no error.
    Raises: ConfigError: no such file, invalid TOML, wrong keys or values (all at once), or a singular matrix.
    """
    path = Path(path)
    content = read_toml(path)
    sensors = [table for table in (content.get("gyro"), content.get("accel")) if isinstance(table, dict)]
    if any("random_walk" in table for table in sensors):
        raise ConfigError("imu.file_for_calibration", where=str(path))
    file = validate(_FILE, content, str(path))
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
    given = table.model_dump(include=set(_dimensions(sensor)), exclude_none=True)
    found = {key: np.array(value) for key, value in given.items()}
    return ErrorTerms(**found) if any(value.any() for value in found.values()) else None


def calibration_to_toml(errors: ImuErrors) -> str:
    """Write a calibration file.

    Returns: text that `load_calibration` reads as exactly the same values.
    """
    content: dict[str, Any] = {"name": errors.name, "date": errors.date, "temperature_c": errors.temperature}
    content = {key: value for key, value in content.items() if value not in ("", None)}
    units: tuple[tuple[Sensor, str, str], ...] = (("gyro", "rad/s", "rad_s"), ("accel", "m/s^2", "m_s2"))
    for sensor, unit, suffix in units:
        raw, terms = getattr(errors, f"{sensor}_raw"), getattr(errors, f"{sensor}_terms")
        # SI units, which keep every bit: writing must not change a calibration
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
