"""Reader of inertial data: it detects columns, units, axes and row order, and converts raw counts and volts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any, Literal

import numpy as np

from insnav import spill
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.model import RawScale
from insnav.input.formats.conventions import number_in
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret import physics
from insnav.input.interpret.clean import IMU_KINDS
from insnav.input.interpret.columns import Found, agrees, find_unit, imu_columns, is_headerless, require, understand
from insnav.input.interpret.schema import ALL_UNITS, GPS_SCHEMA, IMU_SCHEMA, Quantity
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import BoolArray, FloatArray, ImuData, Sampling, Stamp

AccelSign = Literal["force", "minus-force"]
Use = Literal["drive", "noise", "counts"]
# units of ``gyro``, ``accel`` and ``time``, or the conversion of their volts or counts
Units = Mapping[str, str | RawScale] | Sequence[tuple[str, str | RawScale]] | str | None

_RATES = ("gyro_x", "gyro_y", "gyro_z")
_FORCES = ("accel_x", "accel_y", "accel_z")
_ANGLES = ("dtheta_x", "dtheta_y", "dtheta_z")
_VELOCITIES = ("dvel_x", "dvel_y", "dvel_z")
_SI_UNITS = {"gyro": "rad/s", "accel": "m/s^2"}
_SENSIBLE = 1e12  # a larger number is damaged data, in any unit
_BLOCK_ROWS = 1 << 13  # number of rows that are rotated together, to fit in the cache
_SLOWEST = 0.5  # longest plausible sample interval of an IMU [s]
SLOWEST_ALONE = 45.0  # longest plausible sample interval of a single sensor on the bench [s]


def read_imu(
    path: str | Path | Table,
    *,
    axes: str | None = None,
    columns: Mapping[str, str] | None = None,
    units: Units = None,
    sampling: Sampling | None = None,
    stamp: Stamp | None = None,
    accel_sign: AccelSign | None = None,
    use: Use | None = None,
) -> Reading[ImuData]:
    """Read inertial data.

    Parameters
    ----------
    path : str, Path or Table
        A data file of any supported format, or ``-`` for standard input.
    axes : str, optional
        Directions of the sensor's x, y, z, such as ``FLU``; the default ``FRD`` is refused if gravity contradicts it.
    columns : mapping of str to str, optional
        Quantity, with or without unit, to header: ``{"gyro_x_dps": "Gx"}``.
    units : mapping or str, optional
        Units of ``gyro``, ``accel`` and ``time``: ``"gyro=deg/s,accel=g"`` or ``"deg/s,g"``; default:
        from the headers, else from physics. Counts: ``"counts/(deg/s)=131,counts/g=16384"``. A `RawScale` as the unit
        of ``gyro`` or ``accel`` converts volts or counts to rates or forces.
    sampling : {"mean", "instant", "increment"}, optional
        Type of the samples; default ``increment`` for columns named as increments, else ``mean``.
    stamp : {"start", "mid", "end"}, optional
        Instant of the sample interval that the timestamp marks; default ``end``.
    accel_sign : {"force", "minus-force"}, optional
        Sign of the accelerometers: of the specific force (default), or opposite, as in apps for iOS.
    use : {"drive", "noise", "counts"}, optional
        ``drive`` and ``noise`` accept any direction of unspecified axes. ``noise`` also accepts missing sensors, with
        NaN in their columns. ``counts``: counts or volts of unknown sensitivity are only rotated to body axes.

    Returns
    -------
    Reading of ImuData

    Raises
    ------
    InputError
        The file cannot be used.
    ConfigError
        An option is invalid.
    """
    incomplete_ok, counts, any_way = use == "noise", use == "counts", use in ("drive", "noise")
    user_units = parse_units(units)
    table = open_table(path, "imu")
    by_format = not axes and bool(table.axes)
    axes = axes or table.axes or None
    matrix = physics.axes_matrix(axes or "FRD")
    name = table.name
    scales = _raw_scales(units)
    schema = _raw_schema(scales)
    guessed = not columns and is_headerless(table.headers)
    columns = imu_columns(table) if guessed else columns
    found, notes = understand(table.headers, table.units, schema, columns=columns, parts=table.parts, where=name)
    if guessed and columns:
        by_number = tuple(f"{key}={number}" for key, number in columns.items())
        notes = (*notes, Finding.of(Code.READ_COLUMNS_BY_VALUES, columns=by_number))
    increments = _choose(found, sampling, user_units, table, schema, some=incomplete_ok)
    gyro_keys, accel_keys = (_ANGLES, _VELOCITIES) if increments else (_RATES, _FORCES)
    present = [key for key in (*gyro_keys, *accel_keys) if key in found]
    stated = {
        "gyro": user_units.get("gyro") or _common_unit(found, gyro_keys, name),
        "accel": user_units.get("accel") or _common_unit(found, accel_keys, name),
    }
    if counts and any(found[key].unit for key in present):
        columns_stated = tuple(found[key].describe() for key in present if found[key].unit)
        raise InputError("input.counts_with_units", where=name, columns=columns_stated)
    extras = [key for key in ("temperature", "odometer", "baro") if key in found]
    keys = ["time", *present, *extras]
    slowest = _SLOWEST if len(present) == 6 else SLOWEST_ALONE
    rows = read_rows(table, found, keys, IMU_KINDS, slowest=slowest, time_unit=user_units.get("time"))
    raw_notes, raw_units = _from_outputs(rows.columns, found, scales, user_units, increments=increments, where=name)
    stated |= {key: _SI_UNITS[key] for key in scales}
    cleaned = rows.clean(_damaged(rows.columns, ["time", *present], found, name))
    rows.columns.clear()  # frees the memory of the uncleaned samples
    time = cleaned.columns["time"]
    for key in {*gyro_keys, *accel_keys} - {*present}:
        cleaned.columns[key] = np.full(len(time), np.nan)
    scale = 1.0 / cleaned.interval if increments else 1.0
    odd_axis = physics.odd_one([cleaned.columns[key] for key in gyro_keys])
    odd_header = "" if odd_axis is None else found[gyro_keys[odd_axis]].header
    gyro = _in_body(cleaned.columns, gyro_keys, matrix)
    accel = _in_body(cleaned.columns, accel_keys, matrix if accel_sign != "minus-force" else -matrix)
    units_evidence: tuple[Finding, ...]
    if counts:
        gyro_unit, accel_unit, units_evidence = "rad/s", "m/s^2", (Finding.of(Code.READ_IMU_RAW_COUNTS),)
    elif len(present) < 6:
        gyro_unit, accel_unit, units_evidence = _units_of_some(gyro, accel, stated, cleaned.interval, increments, name)
    else:
        quiet = physics.quiet_part(gyro, accel, interval=cleaned.interval, scale=scale)
        accel_unit, accel_evidence = physics.find_accel_unit(
            quiet, stated["accel"], interval=cleaned.interval, increments=increments, where=name
        )
        ratio, correlation = physics.turn_ratio(time, gyro, accel)
        gyro_unit, gyro_evidence = physics.find_gyro_unit(
            quiet, ratio / scale, correlation, stated["gyro"], increments=increments, where=name, odd=odd_header
        )
        axes_evidence = physics.check_axes(quiet, axes, where=name, any_way=any_way, by_format=by_format)
        units_evidence = (gyro_evidence, accel_evidence, axes_evidence)
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
    described = {found[key].quantity.name: found[key].describe(units_used.get(key)) for key in keys}
    return rows.reading(
        "IMU",
        data,
        cleaned,
        {found[key].quantity.key: found[key].header for key in keys} if counts else described,
        (*raw_notes, *units_evidence, _sampling_finding(data, sampling, stamp), *temperature_note, *notes),
        axes=(axes or "FRD").strip().upper(),
        sampling=data.sampling,
        stamp=data.stamp,
    )


def parse_units(units: Units) -> dict[str, str]:
    """Parse the user's units of ``gyro``, ``accel`` and ``time``.

    Written as ``{"gyro": "deg/s"}``, ``"gyro=deg/s,accel=g,time=ms"``, or ``"deg/s,g"``. Returns keys of `ALL_UNITS`,
    without counts and `RawScale` (see `_raw_scales`). Raises: ConfigError: unknown text, or two units for one quantity.
    """
    parsed: dict[str, str] = {}
    for key, text in unit_pairs(units):
        if isinstance(text, RawScale) or _COUNTS_PER.fullmatch(key):
            continue
        for name, dimensions in _DIMENSIONS.items():
            unit = next((u for d in dimensions if (u := find_unit(text, d)) is not None), None)
            if unit is not None and key in ("", name) and name not in parsed:
                parsed[name] = unit
                break
        else:
            raise ConfigError("input.unknown_imu_unit", where="imu-units", text=f"{key}={text}" if key else text)
    return parsed


def unit_pairs(units: Units) -> list[tuple[str, str | RawScale]]:
    """Split the user's units into pairs of quantity and unit; the quantity is empty if the text has only a unit."""
    if not isinstance(units, str):
        return [*(units.items() if isinstance(units, Mapping) else units or ())]
    parts = [part.split("=", 1) for part in re.split(r"[,;]", units) if part.strip()]
    return [(pair[0].strip(), pair[1].strip()) if len(pair) > 1 else ("", pair[0].strip()) for pair in parts]


def _raw_scales(units: Units) -> dict[str, RawScale]:
    """Collect the scale of each triad in counts or volts: a `RawScale`, or a text such as ``counts/(deg/s)=131``."""
    scales = dict[str, RawScale]()
    for key, text in unit_pairs(units):
        if isinstance(text, RawScale):
            scales.setdefault(key, text)
            continue
        if (per := _COUNTS_PER.fullmatch(key)) is None:
            continue
        triads = {"gyro": find_unit(per["unit"], "rate"), "accel": find_unit(per["unit"], "acceleration")}
        triad, unit = next(((triad, unit) for triad, unit in triads.items() if unit), ("", ""))
        if not triad or not 0.0 < number_in(text) < _SENSIBLE:
            raise ConfigError("input.unknown_imu_unit", where="imu-units", text=f"{key}={text}")
        scales[triad] = RawScale("LSB", np.zeros(3), np.full(3, number_in(text) / ALL_UNITS[unit][1]))
    return scales


def _raw_schema(scales: Mapping[str, RawScale]) -> tuple[Quantity, ...]:
    """Return the IMU schema, with volts or counts as the unit of triads that have a scale."""
    if not scales:
        return IMU_SCHEMA
    schema = []
    for quantity in IMU_SCHEMA:
        triad, _, axis = quantity.key.rpartition("_")
        if triad in scales:
            unit = scales[triad].unit
            quantity = replace(quantity, name=f"{triad}_{axis}_{unit.lower()}", dimension="signal", unit=unit)
        schema.append(quantity)
    return tuple(schema)


def _from_outputs(
    columns: dict[str, FloatArray],
    found: Mapping[str, Found],
    scales: Mapping[str, RawScale],
    given: Mapping[str, str],
    *,
    increments: bool,
    where: str,
) -> tuple[tuple[Finding, ...], dict[str, str]]:
    """Convert volts or counts to rates [rad/s] and specific forces [m/s^2], in place; return findings and read units.

    Raises: ConfigError: a specified unit is neither volts nor counts. InputError: the file contains increments, or
    counts instead of volts.
    """
    notes, units = [], {}
    for triad, scale in scales.items():
        if triad in given:
            values: dict[str, Any] = {"triad": triad, "unit": scale.unit, "given": given[triad]}
            raise ConfigError("input.unit_of_raw", where="imu-units", **values)
        if increments:
            raise InputError("input.increments_of_raw", where=where, triad=triad, unit=scale.unit)
        for i, axis in enumerate("xyz"):
            key = f"{triad}_{axis}"
            unit = found[key].unit or scale.unit
            try:
                columns[key] = scale.value(columns[key], i, unit)
            except ConfigError:
                where = f"{where}:{found[key].header}"
                raise InputError("input.other_raw_unit", where=where, unit=scale.unit, given=unit) from None
            units[key] = unit
        notes.append(Finding.of(Code.READ_IMU_RAW_SCALED, subject=triad, unit=scale.unit, si_unit=_SI_UNITS[triad]))
    return tuple(notes), units


_COUNTS_PER = re.compile(r"(?:counts?|lsb)/\(?(?P<unit>[^()]+)\)?", re.IGNORECASE)
_DIMENSIONS = {"gyro": ("rate", "angle"), "accel": ("acceleration", "velocity"), "time": ("time",)}


def _units_of_some(
    gyro: FloatArray, accel: FloatArray, stated: Mapping[str, str | None], interval: float, increments: bool, where: str
) -> tuple[str, str, tuple[Finding, ...]]:
    """Find the units of gyros and accelerometers ``(n, 3)``, some of them missing (NaN), with findings."""
    usual, other = ("rad", "deg") if increments else ("rad/s", "deg/s")
    accel_unit, gyro_unit = stated["accel"] or ("m/s" if increments else "m/s^2"), stated["gyro"] or usual
    scale = 1.0 / interval if increments else 1.0
    if not np.isnan(accel).any():
        quiet = physics.quiet_part(np.zeros_like(accel), accel, interval=interval, scale=scale)
        unit, evidence = physics.find_accel_unit(
            quiet, stated["accel"], interval=interval, increments=increments, where=where
        )
        return gyro_unit, unit, (evidence,)
    notes = [
        physics.stated_unit(key, unit) for key, unit in (("gyros", stated["gyro"]), ("force", stated["accel"])) if unit
    ]
    if not stated["gyro"] and not np.isnan(gyro).all():
        largest = scale * float(np.nanmax(np.abs(gyro)))
        factor = ALL_UNITS[usual][1] / ALL_UNITS[other][1]
        notes.append(Finding.of(Code.UNITS_GYRO_ASSUMED, largest=largest, unit=usual, other=other, factor=factor))
    return gyro_unit, accel_unit, tuple(notes)


def _choose(
    found: dict[str, Found],
    sampling: Sampling | None,
    given: dict[str, str],
    table: Table,
    schema: Sequence[Quantity],
    *,
    some: bool = False,
) -> bool:
    """Return True for increments, which are added to `found` if named as rates. `some`: sensors may be missing."""
    dims = {ALL_UNITS[given[key]][0] for key in ("gyro", "accel") if key in given}
    if specified := sampling == "increment" or bool(dims & {"angle", "velocity"}):
        if dims & {"rate", "acceleration"} or sampling in ("mean", "instant"):
            units = tuple(f"{key}={unit}" for key, unit in given.items())
            raise ConfigError("input.units_against_sampling", where="imu-units", units=units, sampling=sampling or "")
        # By the user's units, or by `sampling` if headers lack units, columns named as rates may contain increments.
        for rate, increment in zip(_RATES + _FORCES, _ANGLES + _VELOCITIES, strict=True):
            old = found.get(rate)
            if old is not None and increment not in found and (old.unit is None or rate.partition("_")[0] in given):
                quantity = next(q for q in IMU_SCHEMA if q.key == increment)
                found[increment] = Found(quantity, old.index, old.header, None)
    has_rates = all(key in found for key in _RATES + _FORCES)
    has_increments = all(key in found for key in _ANGLES + _VELOCITIES)
    increments = has_increments and (specified or not has_rates)
    names = ("dtheta_x", "dvel_x") if increments else ("gyro_x", "accel_x")
    headers: dict[str, Any] = {"file": table.name, "headers": tuple(found[key].header for key in names if key in found)}
    if not increments and specified and has_rates:
        raise ConfigError("input.rates_as_increments", where="imu-sampling", **headers)
    if increments and sampling in ("mean", "instant"):
        raise ConfigError("input.increments_as_rates", where="imu-sampling", **headers)
    some_increments = any(key in found for key in _ANGLES + _VELOCITIES)
    some_rates = any(key in found for key in _RATES + _FORCES)
    if not increments and not has_rates and some_increments and some_rates:
        columns = tuple(f.describe() for key, f in found.items() if key != "time")
        raise InputError("input.rates_and_increments", where=table.name, columns=columns)
    if increments and dims & {"rate", "acceleration"}:
        raise ConfigError("input.units_of_rates", where="imu-units", **headers)
    as_increments = increments or (some_increments and not some_rates)
    if some and "time" in found and (some_rates or some_increments):
        return as_increments
    # for the error about missing columns: columns identified by values, or the apparent content of the file
    wanted = _ANGLES + _VELOCITIES if as_increments else _RATES + _FORCES
    hint, gives = "", None
    by_values = {} if {"time", *wanted} <= found.keys() else imu_columns(table)
    if by_values and agrees(by_values, found, GPS_SCHEMA):
        gives = {"columns": {key: header for key, header in by_values.items() if key not in found}}
    beginnings = {header.lower()[:3] for header in table.headers}
    if {"lat", "lon"} <= beginnings and not some_rates:
        hint = "positions_as_imu"
    elif some and not gives and not (some_rates or some_increments):
        column = next((h for i, h in enumerate(table.headers) if h and i not in {f.index for f in found.values()}), "")
        rate = "" if "time" in found else "--rate HZ"
        raise InputError("columns.one_signal", where=table.name, column=quote(column), rate=rate)
    elif some and "time" not in found:
        hint = "without_rate"
    require(found, ("time", *wanted), table, schema, hint=hint, gives=gives)
    return as_increments


def _common_unit(found: dict[str, Found], keys: tuple[str, ...], name: str) -> str | None:
    """Find the unit in the headers of three axes; None if they state no unit. Different units are refused."""
    present = [key for key in keys if key in found]
    stated = {found[key].unit for key in present} - {None}
    if len(stated) > 1:
        raise InputError("input.mixed_units", where=name, columns=tuple(found[key].describe() for key in present))
    return next(iter(stated), None)


def _damaged(
    columns: Mapping[str, FloatArray], keys: Sequence[str], found: Mapping[str, Found], name: str
) -> BoolArray:
    """Find damaged rows ``(n,)``: an implausible cell, or only zeros; refuse a column without numbers."""
    bad = np.zeros(len(columns["time"]), dtype=np.bool_)
    for key in keys:
        column = columns[key]
        if not (len(column) and column.min() > -_SENSIBLE and column.max() < _SENSIBLE):  # NaN fails both comparisons
            bad |= ~(np.abs(column) < _SENSIBLE)
        spill.release()
    early_rows = np.flatnonzero(columns["time"] == 0.0)  # loggers may write zeros before the first sample
    all_zero = np.logical_and.reduce([columns[key][early_rows] == 0.0 for key in keys])
    if np.count_nonzero(all_zero) < len(bad) / 2:
        bad[early_rows[all_zero]] = True
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
    """Rotate three columns to body axes ``(n, 3)``; if axes are only exchanged or reversed, remove the columns."""
    if np.count_nonzero(matrix) > 3:
        return spill.by_blocks(lambda *some: np.column_stack(some) @ matrix.T, *(columns[key] for key in keys))
    sources = [int(np.flatnonzero(row)[0]) for row in matrix]
    signs = [float(row[j]) for row, j in zip(matrix, sources, strict=True)]
    body = spill.empty((len(columns["time"]), 3))
    for block in spill.blocks(len(body)):
        for start in range(block.start, block.stop, _BLOCK_ROWS):  # blocks that fit in the cache: six times faster
            rows = slice(start, start + _BLOCK_ROWS)
            for i in range(3):
                np.multiply(columns[keys[sources[i]]][rows], signs[i], out=body[rows, i])
    for key in keys:
        del columns[key]
    return body


def _temperature(time: FloatArray, column: FloatArray | None) -> tuple[FloatArray | None, tuple[Finding, ...]]:
    """Fill rows without temperature by interpolation, with a finding; many loggers write temperatures less often."""
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
    """Report sample type and timestamp; the finding names the options to change assumed values."""
    options = ("--imu-sampling",) * (sampling is None and data.sampling != "increment")
    options += ("--imu-stamp",) * (stamp is None and data.sampling != "instant")
    code = Code.READ_IMU_SAMPLING_ASSUMED if options else Code.READ_IMU_SAMPLING
    stamped = "" if data.sampling == "instant" else data.stamp
    return Finding.of(code, sampling=data.sampling, stamp=stamped, options=options)
