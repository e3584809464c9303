"""Files of acceptance and drift tests: settings and sensor outputs, in named columns with units.

A file contains any of the sensors gyro x, y, z, accelerometer x, y, z. Outputs are rates or specific forces
(``gyro_x_deg_s``, ``accel_x_g``), volts or counts (``gyro_x_v``, ``accel_x_lsb``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity
from insnav.lab.bench_data.bench_tables import BenchTable, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.drift.drift_model import DriftRecord
from insnav.lab.noise.allan import AXES
from insnav.types import FloatArray

SI = {"gyro": "rad/s", "accel": "m/s^2"}


def _quantities(axis: str) -> dict[str, Quantity]:
    sensor, letter = axis.split()
    setting, dimension, unit = ("rate", "rate", "deg/s") if sensor == "gyro" else ("force", "acceleration", "g")
    suffix = unit.replace("/", "_")
    key = f"{sensor}_{letter}"
    spelled = (f"{sensor}{letter}", f"{'gyr' if sensor == 'gyro' else 'acc'}{letter}")
    return {
        "setting": Quantity(
            f"{setting}_{letter}", f"{setting}_{letter}_{suffix}", dimension, unit, (f"{setting}{letter}",)
        ),
        "raw": Quantity(key, f"{key}_v", "signal", "V", spelled),
        "sensed": Quantity(f"{key}_sensed", f"{key}_{suffix}", dimension, unit, spelled),
        "bias": Quantity(f"{key}_bias", f"{key}_bias_{suffix}", dimension, unit, (f"{spelled[0]}bias",)),
    }


_EVERY = {axis: _quantities(axis) for axis in AXES}
POWERUP = Quantity("powerup", "powerup", "", "", ("powerup", "poweron", "run", "session"))


@dataclass(frozen=True, slots=True)
class Channel:
    """One sensor in one file."""

    axis: str  # such as ``gyro x``
    setting: FloatArray  # (n,) rate [rad/s] or specific force [m/s^2] that was set; empty at rest
    output: FloatArray  # (n,) in `unit`
    unit: str  # rad/s or m/s^2 if convertible, else the unit of the file: V, mV, uV, LSB


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """One file."""

    table: BenchTable
    time: FloatArray | None  # (n,) [s]
    powerup: FloatArray | None  # (n,) which power-up a row belongs to
    channels: Mapping[str, Channel]  # by axis
    warnings: tuple[Finding, ...] = ()


def read_static(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> BenchRecord:
    """Read a record at rest: ``time_s`` and outputs.

    `columns`: quantity to header, for unusual headers; others are ignored. Raises: InputError: no outputs, times that
    do not increase, or an error of `read_bench`.
    """
    table = _read(path, ("raw", "sensed"), ("time",), columns)
    time = table.columns["time"]
    if time.size < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError("lab.times_not_increasing", where=table.name)
    return BenchRecord(table, time, None, _channels(table, settings=False))


def read_steps(
    path: str | Path | Table, columns: Mapping[str, str] | None = None, spike_limit: float | None = None
) -> BenchRecord:
    """Read a rate table or positions in gravity: ``rate_x_deg_s`` or ``force_x_g`` … and outputs.

    Successive rows with the same settings are the samples of one dwell, reduced to their mean without spikes.

    `columns`: as in `read_static`. `spike_limit`: samples further from a polynomial through their dwell are dropped, in
    the unit of the output; default 0.005 V, and none in other units. Raises: InputError: an output without its setting,
    or whatever `read_bench` finds.
    """
    table = _read(path, ("setting", "raw", "sensed"), (), columns)
    channels = _channels(table, settings=True)
    # all settings of the file make a dwell: a rate about y is no dwell of the x gyro at rest
    keys = [q["setting"].key for q in _EVERY.values() if q["setting"].key in table.columns]
    settings = table.stack(*keys)
    reduced: dict[str, Channel] = {}
    warnings: list[Finding] = []
    for axis, channel in channels.items():
        limit = spike_limit if spike_limit is not None else default_limit(channel.unit)
        dwells = reduce_dwells(
            settings, channel.output[:, None], limit, table.get("time"), where=f"{table.name}, {axis}"
        )
        warnings += dwell_warnings(dwells, (axis,), None if reduced else table.get("temperature"))
        own = dwells.setting[:, keys.index(_EVERY[axis]["setting"].key)]
        used = np.ones(own.size, dtype=np.bool_)
        if axis.startswith("gyro"):  # turning about another axis shows misalignment, not scale factor
            others = [i for i, key in enumerate(keys) if key.startswith("rate") and key != _EVERY[axis]["setting"].key]
            used = np.all(dwells.setting[:, others] == 0.0, axis=1)
        reduced[axis] = Channel(axis, own[used], dwells.value[used, 0], channel.unit)
    return BenchRecord(table, None, None, reduced, tuple(warnings))


def read_powerups(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> BenchRecord:
    """Read power-ups: ``powerup``, settings and outputs; or biases already computed, ``gyro_x_bias_deg_s``.

    `columns`: as in `read_static`. Raises: InputError: no column of power-ups, or whatever `read_bench` finds.
    """
    table = _read(path, ("setting", "raw", "sensed", "bias"), ("powerup",), columns, (POWERUP,))
    channels = {}
    for axis, known in _EVERY.items():
        if known["bias"].key in table.columns:
            unit = SI[axis.split()[0]]
            channels[axis] = Channel(axis, np.empty(0), table.columns[known["bias"].key], unit)
    channels |= _channels(table, settings=True)
    return BenchRecord(table, None, table.columns["powerup"], channels)


def read_drift(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> tuple[DriftRecord, BenchTable]:
    """Read gyros at rest and turning: ``time_s``, ``gyro_x_deg_s`` …, and whatever their drift may depend on.

    That is ``rate_x_deg_s`` … (true rates; without them everything is at rest), ``temperature_c``, ``accel_x_g`` ….

    `columns`: as in `read_static`. Raises: InputError: no gyro, outputs in volts, or whatever `read_bench` finds.
    """
    table = _read(path, ("setting", "raw", "sensed"), ("time",), columns)
    values: dict[str, dict[str, FloatArray]] = {"sensed": {}, "setting": {}}
    force: dict[str, FloatArray] = {}
    for axis, known in _EVERY.items():
        sensor, letter = axis.split()
        if known["raw"].key in table.columns:
            raise InputError(
                "lab.drift_of_raw",
                where=table.name,
                sensor=axis,
                unit=table.units[known["raw"].key],
                name=known["sensed"].name,
            )
        for kind, into in values.items():
            if known[kind].key in table.columns:
                (into if sensor == "gyro" else force)[letter] = table.columns[known[kind].key]
    gyro = values["sensed"]
    if not gyro:
        raise InputError("lab.no_gyro", where=table.name)
    record = DriftRecord(
        table.name, table.columns["time"], tuple(gyro), gyro, values["setting"], force, table.get("temperature")
    )
    return record, table


def _read(
    path: str | Path | Table,
    kinds: tuple[str, ...],
    needed: tuple[str, ...],
    columns: Mapping[str, str] | None,
    more: tuple[Quantity, ...] = (),
) -> BenchTable:
    schema = tuple(known[kind] for known in _EVERY.values() for kind in kinds)
    headers = open_table(path).headers if columns else ()
    named = {name: header for name, header in (columns or {}).items() if header in headers}
    table = read_bench(path, (*schema, *more), needed, columns=named)
    outputs = {known[kind].key for known in _EVERY.values() for kind in ("raw", "sensed", "bias")}
    if not outputs & set(table.columns):
        raise InputError("lab.no_sensor", where=table.name)
    return table


def _channels(table: BenchTable, *, settings: bool) -> dict[str, Channel]:
    channels = {}
    for axis, known in _EVERY.items():
        raw, sensed = known["raw"].key, known["sensed"].key
        if raw not in table.columns and sensed not in table.columns:
            continue
        key, setting = (raw if raw in table.columns else sensed), known["setting"]
        if settings and setting.key not in table.columns:
            raise InputError("lab.no_setting", where=table.name, sensor=axis, name=setting.name)
        unit = table.units[raw] if key == raw else SI[axis.split()[0]]
        own = table.columns[setting.key] if settings else np.empty(0)
        channels[axis] = Channel(axis, own, table.columns[key], unit)
    return channels
