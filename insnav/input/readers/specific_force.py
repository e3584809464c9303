"""Reader of a north-pointing platform's data: specific force along level axes, and heights over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.clean import IMU_KINDS, REFERENCE_KINDS, Cleaned
from insnav.input.interpret.columns import Found, require, understand
from insnav.input.interpret.physics import stated_unit
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA, REFERENCE_SCHEMA, schema
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import FloatArray

LevelAxes = Literal["ENU", "NED"]

_SLOWEST = 10.0  # longest plausible interval between samples [s]
_SENSIBLE = 1e3  # a larger specific force is damaged data [m/s^2]
_GRAVITY = (9.0, 10.6)  # range of the median vertical specific force, also in flight [m/s^2]
SPECIFIC_FORCE_SCHEMA = schema("specific_force")
_SLOWEST_HEIGHTS = 1000.0  # longest plausible interval between heights [s]
_HEIGHTS = ("height", "baro", "height_msl")  # keys of height columns, in order of preference
_HEIGHT_SCHEMA = tuple({q.key: q for q in (*REFERENCE_SCHEMA, *IMU_SCHEMA) if q.key in ("time", *_HEIGHTS)}.values())
_ORDER = {"ENU": ("f_east", "f_north", "f_up"), "NED": ("f_north", "f_east", "f_down")}


@dataclass(frozen=True, slots=True)
class SpecificForce:
    """Specific force on a level, north-pointing platform."""

    time: FloatArray  # (n,) times of the samples [s], strictly increasing
    # (n, 3) North, East, Down at these instants [m/s^2]; Down ``NaN`` throughout if the file has no vertical axis
    f_n: FloatArray


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights over time, from a barometer or a surveyed profile."""

    time: FloatArray  # (n,) [s], strictly increasing
    height: FloatArray  # (n,) heights as in the file [m]


def read_specific_force(
    path: str | Path | Table,
    *,
    axes: LevelAxes | None = None,
    columns: Mapping[str, str] | None = None,
    sample_rate: float | None = None,
) -> Reading[SpecificForce]:
    """Read specific force along the axes of a north-pointing platform.

    `path`: a data file of any supported format, or ``-`` for standard input. `axes` {"ENU", "NED"}: directions of
    columns x, y, z; not needed for columns named by direction (``f_east_m_s2``, ``fe``). `columns`: quantity, with or
    without unit, to header. `sample_rate` [Hz]: for a file without a time column; the first sample has time 0.
    Raises: InputError: columns are missing or not along level axes, or more than five consecutive samples are missing.
    ConfigError: `columns` is invalid, or `sample_rate` is given for a file with times.
    """
    table = open_table(path)
    name = table.name
    found, notes = understand(
        table.headers, table.units, SPECIFIC_FORCE_SCHEMA, columns=columns, parts=table.parts, where=name
    )
    _check_clock(found, sample_rate, table)
    column_keys = _chosen(found, axes, table)
    columns_of = {"time": found["time"]} if sample_rate is None else {}
    columns_of |= {key: found[column] for key, column in column_keys.items()}
    rows = read_rows(table, columns_of, tuple(columns_of), IMU_KINDS, slowest=_SLOWEST)
    evidence: list[Finding] = [Finding.of(Code.READ_IMU_SAMPLING, sampling="instant", stamp="")]
    if sample_rate is not None:
        rows.columns["time"] = np.arange(rows.n_rows) / sample_rate
        evidence.append(Finding.of(Code.READ_TIME_BY_RATE, rate_hz=sample_rate))
    cleaned = rows.clean()
    _refuse_gaps(cleaned, name)
    unit, unit_evidence = _unit(cleaned, [found[column] for column in column_keys.values()], name)
    data = cleaned.columns
    down = data["f_down"] if "f_down" in data else -data.get("f_up", np.full(len(data["time"]), np.nan))
    f_n = np.asarray(ALL_UNITS[unit][1] * np.column_stack([data["f_north"], data["f_east"], down]))
    _refuse_impossible(cleaned.columns["time"], f_n, name)
    if not column_keys.keys() & {"f_up", "f_down"}:
        evidence.append(Finding.of(Code.READ_FORCE_NO_VERTICAL))
    return rows.reading(
        "specific force",
        SpecificForce(cleaned.columns["time"], f_n),
        cleaned,
        {
            "time_s" if key == "time" else f"{key}_m_s2": column.describe(rows.time_unit if key == "time" else unit)
            for key, column in columns_of.items()
        },
        (unit_evidence, *evidence, *notes),
        axes=axes or "",
    )


def _check_clock(found: Mapping[str, Found], sample_rate: float | None, table: Table) -> None:
    """Require the time of each sample: a time column, or else the sample rate. Both together are refused."""
    if sample_rate is None:
        require(found, ("time",), table, SPECIFIC_FORCE_SCHEMA, hint="without_times")
    elif "time" in found:
        values: dict[str, Any] = {"column": found["time"].header, "file": table.name}
        raise ConfigError("input.rate_beside_times", where="--sample-rate", **values)


def _chosen(found: Mapping[str, Found], axes: LevelAxes | None, table: Table) -> dict[str, str]:
    """Map each direction of specific force, such as ``f_north``, to the key of its column."""
    xyz_keys = ("accel_x", "accel_y", "accel_z")
    if not any(key.startswith("f_") for key in found) and all(key in found for key in xyz_keys):
        if axes is None:
            headers = tuple(found[key].header for key in xyz_keys)
            raise InputError("input.level_axes_unclear", where=table.name, headers=headers)
        return dict(zip(_ORDER[axes], xyz_keys, strict=True))
    require(found, ("f_north", "f_east"), table, SPECIFIC_FORCE_SCHEMA)
    if "f_up" in found and "f_down" in found:
        headers = found["f_up"].header, found["f_down"].header
        raise InputError("input.two_vertical", where=table.name, headers=headers)
    return {key: key for key in ("f_north", "f_east", "f_up", "f_down") if key in found}


def _refuse_gaps(cleaned: Cleaned, name: str) -> None:
    if cleaned.n_gaps == 0:
        return
    step = np.diff(cleaned.columns["time"])
    row = int(np.flatnonzero(step > (IMU_KINDS.gap_rows + 1.5) * cleaned.interval)[0])
    where = f"{name}: after {cleaned.columns['time'][row]:.6f} s"
    raise InputError("input.gap", where=where, gap_s=float(step[row]), count=cleaned.n_gaps)


def _unit(cleaned: Cleaned, found: list[Found], name: str) -> tuple[str, Finding]:
    """Find the unit of the specific force from its headers or from gravity, with evidence."""
    stated = {column.unit for column in found} - {None}
    if len(stated) > 1:
        raise InputError("input.mixed_units", where=name, columns=tuple(column.describe() for column in found))
    medians: dict[str, Any] = {
        key: float(np.median(cleaned.columns[key])) for key in ("f_up", "f_down") if key in cleaned.columns
    }
    vertical = medians["f_up"] if "f_up" in medians else -medians["f_down"] if medians else None  # upward force
    if stated:
        unit = str(next(iter(stated)))
        evidence = stated_unit("force", unit)
    elif vertical is None:
        unit, evidence = "m/s^2", Finding.of(Code.READ_FORCE_UNIT_ASSUMED, unit="m/s^2")
    else:
        unit = next((u for u in ("m/s^2", "g", "mg") if _is_gravity(abs(vertical) * ALL_UNITS[u][1])), "")
        evidence = Finding.of(Code.READ_FORCE_UNIT_BY_GRAVITY, shown=abs(vertical), unit=unit)
        if not unit:
            raise InputError("input.force_unit_unclear", where=name, shown=vertical)
    if vertical is None or _is_gravity(vertical * ALL_UNITS[unit][1]):
        return unit, evidence
    raise InputError("input.vertical_no_gravity", where=name, up_m_s2=vertical * ALL_UNITS[unit][1])


def _is_gravity(value: float) -> bool:
    return _GRAVITY[0] < value < _GRAVITY[1]


def _refuse_impossible(time: FloatArray, f_n: FloatArray, name: str) -> None:
    wild = np.abs(f_n) > _SENSIBLE
    if wild.any():
        row = int(np.flatnonzero(wild.any(axis=1))[0])
        values: dict[str, Any] = {
            "force_m_s2": float(f_n[row][wild[row]][0]),
            "count": int(np.count_nonzero(wild.any(axis=1))),
        }
        raise InputError("input.impossible_force", where=f"{name}: at {time[row]:.6f} s", **values)


def read_heights(path: str | Path | Table) -> Reading[Heights]:
    """Read time and height from a data file, ignoring other columns. Raises: InputError: the file cannot be used."""
    table = open_table(path)
    name = table.name
    found, notes = understand(table.headers, table.units, _HEIGHT_SCHEMA, where=name)
    key = next((key for key in _HEIGHTS if key in found), None)
    if key is None or "time" not in found:
        raise InputError("input.no_heights", where=name, known=tuple(filter(None, table.headers)))
    rows = read_rows(table, found, ("time", key), REFERENCE_KINDS, slowest=_SLOWEST_HEIGHTS)
    rows.columns["height"] = rows.columns.pop(key) * found[key].factor
    cleaned = rows.clean()
    time, height = cleaned.columns["time"], cleaned.columns["height"]
    longest = Finding.of(Code.READ_HEIGHT_INTERPOLATED, step_s=np.diff(time).max())
    columns = {"time_s": found["time"].describe(rows.time_unit), "height_m": found[key].describe()}
    return rows.reading("heights", Heights(time, height), cleaned, columns, (longest, *notes))
