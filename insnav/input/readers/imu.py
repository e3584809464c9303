"""Inertial data from a file: columns, units, axes and order found out, and said; or raw counts and volts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from insnav import spill
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.raw_outputs import RawScale
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.axes import axes_matrix
from insnav.input.interpret.clean import IMU_KINDS
from insnav.input.interpret.columns import Found, find_unit, require, understand
from insnav.input.interpret.headerless import imu_columns, is_headerless
from insnav.input.interpret.physics import check_axes, find_accel_unit, find_gyro_unit, odd_one, quiet_part, turn_ratio
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA, Quantity
from insnav.input.readers.raw_columns import SI_UNITS, from_outputs, raw_schema
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import BoolArray, FloatArray, ImuData, Sampling, Stamp

_RATES = ("gyro_x", "gyro_y", "gyro_z")
_FORCES = ("accel_x", "accel_y", "accel_z")
_ANGLES = ("dtheta_x", "dtheta_y", "dtheta_z")
_VELOCITIES = ("dvel_x", "dvel_y", "dvel_z")
_SENSIBLE = 1e12  # larger numbers are damage in any unit
_BLOCK_ROWS = 1 << 13
_SLOWEST = 0.5  # longest interval of an IMU [s]


def read_imu(
    path: str | Path | Table,
    *,
    axes: str | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | str | None = None,
    sampling: Sampling | None = None,
    stamp: Stamp | None = None,
    raw_scales: Mapping[str, RawScale] | None = None,
    any_way: bool = False,
) -> Reading[ImuData]:
    """Read inertial data.

    Parameters
    ----------
    path : str, Path or Table
        A data file of any supported format, or ``-`` for standard input.
    axes : str, optional
        Where the sensor's x, y, z point, such as ``FLU``; default ``FRD``, refused if gravity says otherwise.
    columns : mapping of str to str, optional
        Quantity, with or without unit, to header: ``{"gyro_x_dps": "Gx"}``.
    units : mapping or str, optional
        Units of ``gyro``, ``accel`` and ``time``: ``"gyro=deg/s,accel=g"`` or ``"deg/s,g"``; default:
        from the headers, else from physics.
    sampling : {"mean", "instant", "increment"}, optional
        Default ``increment`` for columns so named, else ``mean``.
    stamp : {"start", "mid", "end"}, optional
        Default ``end``.
    raw_scales : mapping of str to RawScale, optional
        For ``gyro``, ``accel`` or both: the file holds volts or counts, and how they become rates and forces.
    any_way : bool, optional
        Axes that were not given may point anywhere: a drive tells where.

    Returns
    -------
    Reading of ImuData

    Raises
    ------
    InputError
        The file cannot be used.
    ConfigError
        An option cannot be meant as given.
    """
    given = parse_units(units)
    table = open_table(path, "imu")
    by_format = not axes and table.axes
    axes = axes or table.axes or None
    matrix = axes_matrix(axes or "FRD")
    name = table.name
    scales = dict(raw_scales or {})
    schema = raw_schema(scales)
    guessed = not columns and is_headerless(table.headers)
    columns = imu_columns(table) if guessed else columns
    found, notes = understand(table.headers, table.units, schema, columns=columns, where=name)
    if guessed and columns:
        by_number = tuple(f"{key}={number}" for key, number in columns.items())
        notes = (*notes, Finding.of(Code.READ_COLUMNS_BY_VALUES, columns=by_number))
    increments = _choose(found, sampling, given, table, schema)
    gyro_keys, accel_keys = (_ANGLES, _VELOCITIES) if increments else (_RATES, _FORCES)
    stated = {
        "gyro": given.get("gyro") or _common_unit(found, gyro_keys, name),
        "accel": given.get("accel") or _common_unit(found, accel_keys, name),
    }
    extras = [key for key in ("temperature", "odometer", "baro") if key in found]
    keys = ["time", *gyro_keys, *accel_keys, *extras]
    rows = read_rows(table, found, keys, IMU_KINDS, slowest=_SLOWEST, time_unit=given.get("time"))
    raw_notes, raw_units = from_outputs(rows.columns, found, scales, given, increments=increments, where=name)
    stated |= {key: SI_UNITS[key] for key in scales}
    cleaned = rows.clean(_damaged(rows.columns, keys[:7], found, name))
    rows.columns.clear()  # a day of samples is there only once
    time = cleaned.columns["time"]
    scale = 1.0 / cleaned.interval if increments else 1.0
    one = odd_one([cleaned.columns[key] for key in gyro_keys])
    odd = "" if one is None else found[gyro_keys[one]].header
    gyro = _in_body(cleaned.columns, gyro_keys, matrix)
    accel = _in_body(cleaned.columns, accel_keys, matrix)
    quiet = quiet_part(gyro, accel, interval=cleaned.interval, scale=scale)
    accel_unit, accel_evidence = find_accel_unit(
        quiet, stated["accel"], interval=cleaned.interval, increments=increments, where=name
    )
    ratio, correlation = turn_ratio(time, gyro, accel)
    gyro_unit, gyro_evidence = find_gyro_unit(
        quiet, ratio / scale, correlation, stated["gyro"], increments=increments, where=name, odd=odd
    )
    axes_evidence = check_axes(quiet, axes, where=name, any_way=any_way, by_format=bool(by_format))
    for array, unit in ((gyro, gyro_unit), (accel, accel_unit)):
        if ALL_UNITS[unit][1] != 1.0:
            for block in spill.blocks(len(array)):
                array[block] *= ALL_UNITS[unit][1]
    temperature, temperature_note = _temperature(time, cleaned.columns.get("temperature"))
    odometer, baro = cleaned.columns.get("odometer"), cleaned.columns.get("baro")
    if baro is not None and np.fmin.reduce(baro) == np.fmax.reduce(baro):
        notes = (*notes, Finding.of(Code.READ_COLUMNS_CONSTANT, subject=found["baro"].header))
        baro = None
    data = ImuData(
        time,
        gyro,
        accel,
        "increment" if increments else sampling or "mean",
        stamp or "end",
        temperature,
        None if odometer is None else odometer * found["odometer"].factor,
        None if baro is None else baro * found["baro"].factor,
    )
    units_used = dict.fromkeys(gyro_keys, gyro_unit) | dict.fromkeys(accel_keys, accel_unit) | {"time": rows.time_unit}
    units_used |= raw_units
    return rows.reading(
        "IMU",
        data,
        cleaned,
        {found[key].quantity.name: found[key].describe(units_used.get(key)) for key in keys},
        (
            *raw_notes,
            gyro_evidence,
            accel_evidence,
            axes_evidence,
            _sampling_finding(data, sampling, stamp),
            *temperature_note,
            *notes,
        ),
        axes=(axes or "FRD").strip().upper(),
        sampling=data.sampling,
        stamp=data.stamp,
    )


def read_counts(
    path: str | Path | Table, *, axes: str | None = None, columns: Mapping[str, str] | None = None
) -> Reading[ImuData]:
    """Read counts or volts, whose sensitivity is to be found, only brought to body axes; arguments as for `read_imu`.

    Raises: InputError: the file cannot be used, or its headers state units; ConfigError: an option cannot be meant as
    given.
    """
    matrix = axes_matrix(axes or "FRD")
    table = open_table(path, "imu")
    name = table.name
    found, notes = understand(table.headers, table.units, IMU_SCHEMA, columns=columns, where=name)
    require(found, ("time", *_RATES, *_FORCES), table.headers, IMU_SCHEMA, where=name, units_row=table.units)
    stated = [found[key].describe() for key in (*_RATES, *_FORCES) if found[key].unit is not None]
    if stated:
        raise InputError("input.counts_with_units", where=name, columns=tuple(stated))
    keys = ["time", *_RATES, *_FORCES, *(key for key in ("temperature",) if key in found)]
    rows = read_rows(table, found, keys, IMU_KINDS, slowest=_SLOWEST)
    cleaned = rows.clean(_damaged(rows.columns, keys[:7], found, name))
    time = cleaned.columns["time"]
    temperature, temperature_note = _temperature(time, cleaned.columns.get("temperature"))
    data = ImuData(
        time,
        _in_body(cleaned.columns, _RATES, matrix),
        _in_body(cleaned.columns, _FORCES, matrix),
        temperature=temperature,
    )
    return rows.reading(
        "IMU",
        data,
        cleaned,
        {found[key].quantity.key: found[key].header for key in keys},
        (Finding.of(Code.READ_IMU_RAW_COUNTS), *temperature_note, *notes),
        axes=(axes or "FRD").strip().upper(),
        sampling=data.sampling,
        stamp=data.stamp,
    )


def parse_units(units: Mapping[str, str] | str | None) -> dict[str, str]:
    """Units of ``gyro``, ``accel`` and ``time`` given by the user, as far as given.

    Written as ``{"gyro": "deg/s"}``, ``"gyro=deg/s,accel=g,time=ms"``, or ``"deg/s,g"``; anything else is a
    `ConfigError`.
    """
    if units is None:
        return {}
    if isinstance(units, str):
        parts = [part.split("=", 1) for part in re.split(r"[,;]", units) if part.strip()]
        pairs = [(p[0].strip(), p[1].strip()) if len(p) > 1 else ("", p[0].strip()) for p in parts]
    else:
        pairs = list(units.items())
    found: dict[str, str] = {}
    for key, text in pairs:
        for name, dimensions in _DIMENSIONS.items():
            unit = next((u for d in dimensions if (u := find_unit(text, d)) is not None), None)
            if unit is not None and key in ("", name):
                found[name] = unit
                break
        else:
            raise ConfigError("input.unknown_imu_unit", where="imu-units", text=f"{key}={text}" if key else text)
    return found


_DIMENSIONS = {"gyro": ("rate", "angle"), "accel": ("acceleration", "velocity"), "time": ("time",)}


def _choose(
    found: dict[str, Found], sampling: Sampling | None, given: dict[str, str], table: Table, schema: Sequence[Quantity]
) -> bool:
    """Whether to read increments; makes sure that all columns are there."""
    dims = {ALL_UNITS[given[key]][0] for key in ("gyro", "accel") if key in given}
    if sampling == "increment" or dims & {"angle", "velocity"}:
        if dims & {"rate", "acceleration"} or sampling in ("mean", "instant"):
            units = tuple(f"{key}={unit}" for key, unit in given.items())
            raise ConfigError("input.units_against_sampling", where="imu-units", units=units, sampling=sampling or "")
        # Columns with the plain names and no unit hold increments because the user says so.
        for rate, increment in zip(_RATES + _FORCES, _ANGLES + _VELOCITIES, strict=True):
            old = found.get(rate)
            if old is not None and increment not in found and (old.unit is None or dims):
                quantity = next(q for q in IMU_SCHEMA if q.key == increment)
                found[increment] = Found(quantity, old.index, old.header, None)
    has_rates = all(key in found for key in _RATES + _FORCES)
    has_increments = all(key in found for key in _ANGLES + _VELOCITIES)
    increments = has_increments and (sampling == "increment" or not has_rates or bool(dims & {"angle", "velocity"}))
    names = ("dtheta_x", "dvel_x") if increments else ("gyro_x", "accel_x")
    held: dict[str, Any] = {"file": table.name, "headers": tuple(found[key].header for key in names if key in found)}
    if not increments and sampling == "increment" and has_rates:
        raise ConfigError("input.rates_as_increments", where="imu-sampling", **held)
    if increments and sampling in ("mean", "instant"):
        raise ConfigError("input.increments_as_rates", where="imu-sampling", **held)
    some_increments = any(key in found for key in _ANGLES + _VELOCITIES)
    some_rates = any(key in found for key in _RATES + _FORCES)
    if not increments and not has_rates and some_increments and some_rates:
        columns = tuple(f.describe() for key, f in found.items() if key != "time")
        raise InputError("input.rates_and_increments", where=table.name, columns=columns)
    if increments and dims & {"rate", "acceleration"}:
        raise ConfigError("input.units_of_rates", where="imu-units", **held)
    as_increments = increments or (some_increments and not some_rates)
    wanted = _ANGLES + _VELOCITIES if as_increments else _RATES + _FORCES
    hint, gives = "", None
    if not {"time", *wanted} <= found.keys() and (fitting := imu_columns(table)):
        gives = {"columns": {key: header for key, header in fitting.items() if key not in found}}
    words = {header.lower()[:3] for header in table.headers}
    if {"lat", "lon"} <= words and not some_rates:
        hint = "positions_as_imu"
    require(
        found, ("time", *wanted), table.headers, schema, where=table.name, hint=hint, gives=gives, units_row=table.units
    )
    return increments


def _common_unit(found: dict[str, Found], keys: tuple[str, ...], name: str) -> str | None:
    """Find the unit that the headers of three axes state; None if they do not."""
    stated = {found[key].unit for key in keys} - {None}
    if len(stated) > 1:
        raise InputError("input.mixed_units", where=name, columns=tuple(found[key].describe() for key in keys))
    return next(iter(stated), None)


def _damaged(
    columns: Mapping[str, FloatArray], keys: Sequence[str], found: Mapping[str, Found], name: str
) -> BoolArray:
    """Rows with a cell that is not a sensible number, or zero in all; a column without any number is refused."""
    bad = np.zeros(len(columns["time"]), dtype=np.bool_)
    for key in keys:
        column = columns[key]
        if not (len(column) and column.min() > -_SENSIBLE and column.max() < _SENSIBLE):  # NaN fails both
            bad |= ~(np.abs(column) < _SENSIBLE)
        spill.release()
    early = np.flatnonzero(columns["time"] == 0.0)  # written before there was anything
    empty = np.logical_and.reduce([columns[key][early] == 0.0 for key in keys])
    if np.count_nonzero(empty) < len(bad) / 2:
        bad[early[empty]] = True
    if len(bad) and bad.all():
        for key in keys:
            if not np.isfinite(columns[key]).any():
                values: dict[str, Any] = {
                    "column": found[key].header,
                    "count": len(bad),
                    "option": "--columns",
                    "quantity": key,
                }
                raise InputError("input.empty_column", where=name, **values)
    return bad


def _in_body(columns: dict[str, FloatArray], keys: tuple[str, ...], matrix: FloatArray) -> FloatArray:
    """Three columns as one array in body axes; they are taken away."""
    if np.count_nonzero(matrix) > 3:
        return spill.by_blocks(lambda *some: np.column_stack(some) @ matrix.T, *(columns[key] for key in keys))
    sources = [int(np.flatnonzero(row)[0]) for row in matrix]
    signs = [float(row[j]) for row, j in zip(matrix, sources, strict=True)]
    body = spill.empty((len(columns["time"]), 3))
    for block in spill.blocks(len(body)):
        for start in range(block.start, block.stop, _BLOCK_ROWS):  # these stay in the cache: six times faster
            rows = slice(start, start + _BLOCK_ROWS)
            for i in range(3):
                np.multiply(columns[keys[sources[i]]][rows], signs[i], out=body[rows, i])
    for key in keys:
        del columns[key]
    return body


def _temperature(time: FloatArray, column: FloatArray | None) -> tuple[FloatArray | None, tuple[Finding, ...]]:
    """Temperature without gaps: it changes slowly, and loggers write it less often."""
    if column is None:
        return None, ()
    known = np.isfinite(column)
    if known.all():
        return column, ()
    if not known.any():
        return None, (Finding.of(Code.READ_COLUMNS_EMPTY, subject="temperature"),)
    filled = np.interp(time, time[known], column[known])
    return filled, (Finding.of(Code.READ_IMU_TEMPERATURE, count=int(np.count_nonzero(~known)), rows=len(known)),)


def _sampling_finding(data: ImuData, sampling: Sampling | None, stamp: Stamp | None) -> Finding:
    """Make the finding of what a sample is; the names of columns tell increments."""
    options = ("--imu-sampling",) * (sampling is None and data.sampling != "increment")
    options += ("--imu-stamp",) * (stamp is None and data.sampling != "instant")
    code = Code.READ_IMU_SAMPLING_ASSUMED if options else Code.READ_IMU_SAMPLING
    stamped = "" if data.sampling == "instant" else data.stamp
    return Finding.of(code, sampling=data.sampling, stamp=stamped, options=options)
