"""The calibration file (``calibration.toml``): known errors of one IMU, measured = matrix @ true + bias.

name = "bench IMU 7"          # optional, as are date and temperature_c
date = 2025-03-14
temperature_c = 24.5

[gyro]
bias = ["12 deg/h", "-3 deg/h", "0.5 deg/h"]
matrix = [[1.001, 0.0002, 0.0], [0.0, 0.9995, 0.0001], [0.0, 0.0, 1.0003]]

[accel]
bias = ["1.2 mg", "-0.4 mg", "3 mg"]
matrix = [[1.0005, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.999]]

A file whose samples are volts or counts needs a line for each sensor, value = (output - zero) / scale; bias and matrix
are of what that makes:

[gyro.raw]
unit = "V"                                  # or mV, uV, LSB
zero = [0.2, 0.19, 0.21]                    # in that unit
scale_per_rad_s = [2.795, 2.8, 2.79]        # that unit per rad/s; scale_per_m_s2 in [accel.raw]

What non-linear gyros leave after that is a piecewise-linear map, error = measured - true over the measured rate:

[gyro.map.x]                                # and y, z
rate_rad_s = [-5.2, 0.0, 5.2]
error_rad_s = [-0.001, 0.0, 0.002]

What bias and matrix leave out (`insnav.imu.higher_order`) may follow in each table: asymmetry, quadratic,
bias_slope, scale_slope, one value or three; g_sensitivity, three rows of three, in [gyro]; positions, three places,
in [accel].
"""

from __future__ import annotations

import datetime
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from insnav.config_file import Axes, Table, axes, quantity, read_toml, validate
from insnav.exceptions import ConfigError
from insnav.imu.dynamic_map import AxisMap, DynamicMap
from insnav.imu.higher_order import ErrorTerms
from insnav.imu.model import ImuErrors
from insnav.imu.raw_outputs import RawScale
from insnav.types import FloatArray

Matrix = tuple[Axes, Axes, Axes]
# unit written for the gyros, for the accelerometers: SI, so that a file holds every bit
_TERM_UNITS = {
    "asymmetry": ("1", "1"),
    "quadratic": ("1/(rad/s)", "1/(m/s^2)"),
    "bias_slope": ("(rad/s)/K", "(m/s^2)/K"),
    "scale_slope": ("1/K", "1/K"),
    "g_sensitivity": ("(rad/s)/(m/s^2)", ""),
    "positions": ("", "m"),
}
_IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _number(value: object) -> float:
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise PydanticCustomError("wrong_value", "must be finite numbers without quotes")
    return number


def _matrix(value: object) -> Matrix:
    rows = value if isinstance(value, list) else []
    if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
        raise PydanticCustomError("wrong_value", "must be three rows of three numbers, [[…], […], […]]")
    (a, b, c), (d, e, f), (g, h, i) = ([_number(item) for item in row] for row in rows)
    return (a, b, c), (d, e, f), (g, h, i)


def _date(value: object) -> str:
    if isinstance(value, str | datetime.date | datetime.datetime):
        return str(value)
    raise PydanticCustomError("wrong_value", "must be a date, like 2025-03-14")


def _numbers(value: object) -> list[float]:
    if not isinstance(value, list):
        raise PydanticCustomError("wrong_value", "must be a list of numbers, […, …]")
    return [_number(item) for item in value]


class _GyroRaw(Table):
    unit: str
    zero: Annotated[list[float], PlainValidator(_numbers)]
    scale_per_rad_s: Annotated[list[float], PlainValidator(_numbers)]


class _AccelRaw(Table):
    unit: str
    zero: Annotated[list[float], PlainValidator(_numbers)]
    scale_per_m_s2: Annotated[list[float], PlainValidator(_numbers)]


class _AxisMap(Table):
    rate_rad_s: Annotated[list[float], PlainValidator(_numbers)]
    error_rad_s: Annotated[list[float], PlainValidator(_numbers)]


class _Map(Table):
    x: _AxisMap | None = None
    y: _AxisMap | None = None
    z: _AxisMap | None = None


def _rows(dimension: str) -> PlainValidator:
    """Three rows of three quantities."""

    def check(value: object) -> Matrix:
        rows = value if isinstance(value, list) else []
        if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
            raise PydanticCustomError("wrong_value", "must be three rows of three, [[…], […], […]]")
        (a, b, c), (d, e, f), (g, h, i) = ([quantity(item, dimension, signed=True) for item in row] for row in rows)
        return (a, b, c), (d, e, f), (g, h, i)

    return PlainValidator(check)


class _Sensor(Table):
    asymmetry: Annotated[Axes | None, axes("ratio", signed=True)] = None
    scale_slope: Annotated[Axes | None, axes("ratio per kelvin", signed=True)] = None


class _Gyro(_Sensor):
    quadratic: Annotated[Axes | None, axes("per rate", signed=True)] = None
    bias_slope: Annotated[Axes | None, axes("rate per kelvin", signed=True)] = None
    g_sensitivity: Annotated[Matrix | None, _rows("rate per acceleration")] = None
    bias: Annotated[Axes, axes("rate", signed=True)] = (0.0, 0.0, 0.0)
    matrix: Annotated[Matrix, PlainValidator(_matrix)] = _IDENTITY
    raw: _GyroRaw | None = None
    map: _Map | None = None


class _Accel(_Sensor):
    quadratic: Annotated[Axes | None, axes("per acceleration", signed=True)] = None
    bias_slope: Annotated[Axes | None, axes("acceleration per kelvin", signed=True)] = None
    positions: Annotated[Matrix | None, _rows("length")] = None
    bias: Annotated[Axes, axes("acceleration", signed=True)] = (0.0, 0.0, 0.0)
    matrix: Annotated[Matrix, PlainValidator(_matrix)] = _IDENTITY
    raw: _AccelRaw | None = None


class _CalibrationFile(Table):
    name: str = ""
    date: Annotated[str, PlainValidator(_date)] = ""
    temperature_c: Annotated[float | None, PlainValidator(_number)] = None
    gyro: _Gyro | None = None
    accel: _Accel | None = None


def load_calibration(path: str | Path) -> ImuErrors:
    """Read the known errors of an IMU.

    Parameters
    ----------
    path : str or Path
        Calibration file.

    Returns
    -------
    ImuErrors
        For `insnav.imu.correct`. A table or key that is absent means no error there.

    Raises
    ------
    ConfigError
        No such file, no TOML, wrong keys or values (all at once), or a matrix that cannot be inverted.
    """
    path = Path(path)
    content = read_toml(path)
    sensors = [table for table in (content.get("gyro"), content.get("accel")) if isinstance(table, dict)]
    if any("random_walk" in table for table in sensors):
        raise ConfigError(
            "this is an IMU file, not a calibration",
            where=str(path),
            why="it says how large errors are, not which",
            fix="give it to --imu; a calibration.toml comes from insnav calibrate",
        )
    file = validate(_CalibrationFile, content, str(path))
    if file.gyro is None and file.accel is None:
        raise ConfigError(
            "the file holds no calibration",
            where=str(path),
            fix="it needs a table [gyro] or [accel], or both",
        )
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
            gyro_raw=_raw(gyro.raw.unit, gyro.raw.zero, gyro.raw.scale_per_rad_s) if gyro.raw else None,
            accel_raw=_raw(accel.raw.unit, accel.raw.zero, accel.raw.scale_per_m_s2) if accel.raw else None,
            gyro_terms=_terms(gyro),
            accel_terms=_terms(accel),
        )
    except ConfigError as error:
        raise ConfigError(error.what, where=f"{path}: {error.where}", why=error.why, fix=error.fix) from None


def _raw(unit: str, zero: list[float], scale: list[float]) -> RawScale:
    return RawScale(unit, np.array(zero), np.array(scale))


def _gyro_map(table: _Map | None) -> DynamicMap | None:
    if table is None:
        return None
    axes_of = (table.x, table.y, table.z)
    x, y, z = (None if a is None else AxisMap(np.array(a.rate_rad_s), np.array(a.error_rad_s)) for a in axes_of)
    return DynamicMap(x, y, z)


def _terms(table: _Sensor) -> ErrorTerms | None:
    given = {name: np.array(value) for name in _TERM_UNITS if (value := getattr(table, name, None)) is not None}
    return ErrorTerms(**given) if any(np.any(value) for value in given.values()) else None


def calibration_to_toml(errors: ImuErrors) -> str:
    """Write a calibration file.

    Parameters
    ----------
    errors : ImuErrors
        What to write.

    Returns
    -------
    str
        Text that `load_calibration` reads back to exactly the same values.
    """
    content: dict[str, Any] = {"name": errors.name, "date": errors.date, "temperature_c": errors.temperature}
    content = {key: value for key, value in content.items() if value not in ("", None)}
    for name, unit, bias, matrix in (
        ("gyro", "rad/s", errors.gyro_bias, errors.gyro_matrix),
        ("accel", "m/s^2", errors.accel_bias, errors.accel_matrix),
    ):
        # SI units and the shortest text that is exact: a calibration must not change by being written
        content[name] = {"bias": [f"{float(item)!r} {unit}" for item in bias], "matrix": matrix.tolist()}
    for name, key, raw in (
        ("gyro", "scale_per_rad_s", errors.gyro_raw),
        ("accel", "scale_per_m_s2", errors.accel_raw),
    ):
        if raw is not None:
            content[name]["raw"] = {"unit": raw.unit, "zero": raw.zero.tolist(), key: raw.scale.tolist()}
    if errors.gyro_map is not None:
        content["gyro"]["map"] = {
            axis: {"rate_rad_s": item.rate.tolist(), "error_rad_s": item.error.tolist()}
            for axis, item in zip("xyz", errors.gyro_map.axes, strict=True)
            if item is not None
        }
    for index, (name, terms) in enumerate((("gyro", errors.gyro_terms), ("accel", errors.accel_terms))):
        for key, units in _TERM_UNITS.items():
            value = None if terms is None else getattr(terms, key)
            if value is not None and np.any(value):
                content[name][key] = _texts(value, units[index])
    return tomli_w.dumps(content)


def _texts(value: FloatArray, unit: str) -> list[Any]:
    return [_texts(item, unit) if np.ndim(item) else f"{float(item)!r} {unit}" for item in value]
