"""Bench tables: named columns with units in the header, and their dwells; files of acceptance and drift tests.

A dwell is many samples at one rate or one position, cleaned and reduced to one value. A polynomial over its samples
follows warm-up and drift; samples far from it are spikes.

A file of an acceptance or drift test contains any of the sensors gyro x, y, z, accelerometer x, y, z, and settings.
Outputs are rates or specific forces (``gyro_x_deg_s``, ``accel_x_g``), volts or counts (``gyro_x_v``, ``accel_x_lsb``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.schema import Quantity
from insnav.lab.calibration import warming
from insnav.lab.noise.allan import AXES
from insnav.types import BoolArray, FloatArray
from insnav.units import UNITS

TIME = Quantity("time", "time_s", "time", "s", ("time", "t", "timestamp"))
TEMPERATURE = Quantity("temperature", "temperature_c", "temperature", "degC", ("temperature", "temp"))
SI = {"gyro": "rad/s", "accel": "m/s^2"}


@dataclass(frozen=True, slots=True)
class BenchFile:
    """Source file of a result."""

    name: str  # name of the file
    sha256: str  # digest of the file
    units: Mapping[str, str]  # by key: unit in the file


@dataclass(frozen=True, slots=True)
class BenchTable(BenchFile):
    """Columns of a bench file in SI units, except raw outputs, which keep the unit of the file."""

    columns: Mapping[str, FloatArray]  # columns (n,) by key of the quantity

    @property
    def file(self) -> BenchFile:
        """Name, digest and units of the file, without the columns."""
        return BenchFile(self.name, self.sha256, self.units)

    def stack(self, *keys: str) -> FloatArray:
        """Return columns side by side, (n, k)."""
        return np.column_stack([self.columns[key] for key in keys])

    def get(self, key: str) -> FloatArray | None:
        """Return a column (n,); None if the file does not have it."""
        return self.columns.get(key)


def read_bench(
    path: str | Path | Table,
    schema: Sequence[Quantity],
    needed: Sequence[str],
    *,
    columns: Mapping[str, str] | None = None,
    alternatives: Mapping[str, str] | None = None,
) -> BenchTable:
    """Read a bench table, and convert all columns but raw outputs to SI units.

    `schema`: quantities that it may have besides time and temperature. `needed`: keys of required columns. `columns`:
    header by quantity, for unusual headers. `alternatives`: by required key, a key that may replace it.
    Raises: InputError: a column is missing or has no unit, or a cell is empty.
    """
    table = open_table(path)
    schema = (*schema, TIME, TEMPERATURE)
    cols, _ = understand(table.headers, table.units, schema, columns=columns, where=table.name)
    required = [
        other if key not in cols and (other := (alternatives or {}).get(key, key)) in cols else key for key in needed
    ]
    require(cols, required, table, schema)
    for item in cols.values():
        if item.unit is None and item.quantity.dimension:
            raise InputError("lab.no_unit", where=table.name, column=item.header, name=item.quantity.name)
    if not cols:
        known = tuple(item.name for item in schema[:4])
        raise InputError("lab.no_column", where=table.name, headers=tuple(table.headers), known=known)
    numbers = table.cells.read([item.index for item in cols.values()])
    if numbers.cut:
        raise InputError("lab.truncated", where=table.name, **dict[str, Any](numbers.cut.values))
    if numbers.n_rows == 0:
        raise InputError("lab.no_rows", where=table.name)
    values, units = {}, {}
    for key, item in cols.items():
        raw = numbers.columns[item.index]
        if not np.isfinite(raw).all():
            raise InputError("lab.value_missing", where=table.place(int(np.argmin(np.isfinite(raw))), item.index))
        values[key] = raw if item.quantity.dimension == "signal" else raw * item.factor
        units[key] = item.unit or ""
    return BenchTable(table.name, table.sha256, units, values)


ORDER = 7  # order of the polynomial through a dwell
LIMIT_V = 0.005  # samples with a larger distance from the polynomial are dropped [V]
MAX_ROUNDS = 10  # largest number of fits: spikes distort the polynomial, so the fit is repeated without them
LARGEST_LOSS = 0.5  # a dwell that loses a larger share of its samples has no value
MANY_SPIKES = 0.05  # larger shares of spikes in a dwell are reported
LARGEST_DRIFT_C = 2.0  # larger temperature changes within a calibration are reported [deg C]


@dataclass(frozen=True, slots=True)
class Dwells:
    """Dwells, each reduced to one value per sensor."""

    setting: FloatArray  # (n, k) rate or angle of each dwell, in the unit of its table
    value: FloatArray  # (n, m) mean of the samples kept, for m sensors
    # (n, m) standard deviation of `value`, for independent samples; zero for a dwell of one sample
    sd: FloatArray
    count: FloatArray  # (n,) number of samples of each dwell
    dropped: FloatArray  # (n, m) number of samples dropped as spikes

    @property
    def raw(self) -> bool:
        """True if a dwell has several samples; False if the file has one mean per dwell."""
        return bool((self.count > 1).any())


def default_limit(unit: str) -> float:
    """Return the default limit of spikes, in the unit of the samples: `LIMIT_V` for voltages, infinite for other units.

    `unit`: unit of the samples.
    """
    dimension, factor = UNITS[unit]
    return LIMIT_V / factor if dimension == "signal" and unit != "LSB" else float("inf")


def clean_mean(
    time: FloatArray, samples: FloatArray, limit: float, *, where: str = "", row: int = 0
) -> tuple[float, float, int]:
    """Compute the mean of the samples of a dwell without its spikes.

    `time` (n,): time of each sample, in any unit. `samples` (n,): samples. `limit`: largest distance from the
    polynomial, in the unit of the samples. `row`: first row of the dwell, from 0. Returns mean, sd: mean of the samples
    kept and its standard deviation; dropped: number of samples not kept. Raises: InputError: more than half of the
    samples are beyond the limit.
    """
    order = min(ORDER, max(0, samples.size // 10))  # a short dwell does not determine a polynomial of order 7
    within = np.ones(samples.size, dtype=np.bool_)
    for _ in range(MAX_ROUNDS):
        residual = samples - Polynomial.fit(time[within], samples[within], order, domain=[time[0], time[-1]])(time)
        previous, within = within, np.abs(residual) <= limit
        if np.array_equal(previous, within) or np.count_nonzero(within) <= order:
            break
    kept = samples[within]
    if kept.size < (1.0 - LARGEST_LOSS) * samples.size:
        values: dict[str, Any] = {"begin_row": row + 1, "end_row": row + samples.size}
        values |= {"count": samples.size - kept.size, "limit": limit, "order": order, "residual_sd": np.std(residual)}
        raise InputError("lab.dwell_of_spikes", where=where, **values)
    sd = float(np.std(residual[within]) / np.sqrt(kept.size)) if kept.size > 1 else 0.0
    return float(np.mean(kept)), sd, samples.size - kept.size


def reduce_dwells(
    settings: FloatArray, samples: FloatArray, limit: float, time: FloatArray | None = None, *, where: str = ""
) -> Dwells:
    """Reduce a record to one value for each interval of equal settings.

    `settings` (n, k): commanded rates or angles of each row. Rows of one dwell are successive; a setting that recurs
    later is another dwell. `samples` (n, m): outputs of m sensors. `limit`: as in `clean_mean`. `time` (n,):
    times of the rows; default their number. Raises: InputError: a value that is not a number, or a dwell of spikes.
    """
    invalid = ~(np.isfinite(settings).all(axis=1) & np.isfinite(samples).all(axis=1))
    if invalid.any():
        raise InputError("lab.value_missing", where=where, row=int(np.argmax(invalid)) + 1)
    time = np.arange(len(samples), dtype=np.float64) if time is None else time
    starts = np.flatnonzero(np.any(np.diff(settings, axis=0) != 0.0, axis=1)) + 1
    bounds = np.concatenate(([0], starts, [len(settings)]))
    n, m = len(bounds) - 1, samples.shape[1]
    value, sd, dropped = np.empty((n, m)), np.zeros((n, m)), np.zeros((n, m))
    for i in range(n):
        rows = slice(bounds[i], bounds[i + 1])
        for j in range(m):
            if bounds[i + 1] - bounds[i] == 1:
                value[i, j] = samples[bounds[i], j]
            else:
                value[i, j], sd[i, j], dropped[i, j] = clean_mean(
                    time[rows], samples[rows, j], limit, where=where, row=bounds[i]
                )
    return Dwells(settings[bounds[:-1]], value, sd, np.diff(bounds).astype(np.float64), dropped)


def dwell_warnings(dwells: Dwells, names: Sequence[str], temperature: FloatArray | None) -> tuple[Finding, ...]:
    """Report dwells with many spikes, and temperature changes.

    `dwells`: from `reduce_dwells`. `names`: names of the sensors. `temperature` (n,): temperature of the rows [deg C].
    """
    warnings = []
    for name, dropped in zip(names, dwells.dropped.T, strict=True):
        share = dropped / dwells.count
        if share.max() > MANY_SPIKES:
            worst = int(np.argmax(share))
            size, limit = share[worst], MANY_SPIKES
            warnings.append(Finding.of(Code.BENCH_SPIKES, subject=name, share=size, limit_share=limit, dwell=worst + 1))
    return (*warnings, *warming(temperature, LARGEST_DRIFT_C))


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
    """Record of one sensor in one file."""

    axis: str  # sensor and axis, such as ``gyro x``
    setting: FloatArray  # (n,) commanded rate [rad/s] or specific force [m/s^2]; empty for a record at rest
    output: FloatArray  # (n,) sensor output in `unit`
    unit: str  # rad/s or m/s^2 if convertible, else the unit of the file: V, mV, uV, LSB


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """Sensor records of one bench file."""

    table: BenchTable
    time: FloatArray | None  # (n,) time of each row [s]
    powerup: FloatArray | None  # (n,) number of the power-up of each row
    channels: Mapping[str, Channel]  # by axis, such as ``gyro x``
    warnings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True)
class DriftRecord:
    """Gyro record with possible causes of drift."""

    name: str  # name of the file
    time: FloatArray  # (n,) evenly spaced times [s]
    axes: tuple[str, ...]  # letters of the gyros present
    gyro: Mapping[str, FloatArray]  # by letter of the axis: (n,) output [rad/s]
    rate: Mapping[str, FloatArray]  # (n,) true rate about the axis, if recorded [rad/s]
    force: Mapping[str, FloatArray]  # (n,) specific force along the axis, if recorded [m/s^2]
    temperature: FloatArray | None  # (n,) temperature [deg C]

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    def true_rate(self, axis: str) -> FloatArray:
        """Return the true rate about an axis, (n,) [rad/s]; zero if it is not recorded."""
        return self.rate.get(axis, np.zeros(self.time.size))

    def at_rest(self) -> BoolArray:
        """Return whether each row is before the first rotation about any axis, (n,)."""
        turning = np.zeros(self.time.size, dtype=np.bool_)
        for rate in self.rate.values():
            turning |= rate != 0.0
        return np.asarray(np.cumsum(turning) == 0)


def read_static(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> BenchRecord:
    """Read a record at rest: ``time_s`` and outputs.

    `columns`: header by quantity, for unusual headers; other columns are ignored. Raises: InputError: no outputs, times
    that do not increase, or an error of `read_bench`.
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

    `columns`: as in `read_static`. `spike_limit`: largest distance of samples from a polynomial through their dwell, in
    the unit of the output; default 0.005 V, no limit for other units. Raises: InputError: an output without its
    setting, or an error of `read_bench`.
    """
    table = _read(path, ("setting", "raw", "sensed"), (), columns)
    channels = _channels(table, settings=True)
    # a dwell has constant settings of all axes: gyro x is not at rest during rotation about y
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
        own_setting = dwells.setting[:, keys.index(_EVERY[axis]["setting"].key)]
        used = np.ones(own_setting.size, dtype=np.bool_)
        if axis.startswith("gyro"):  # rotation about another axis shows misalignment, not scale factor
            others = [i for i, key in enumerate(keys) if key.startswith("rate") and key != _EVERY[axis]["setting"].key]
            used = np.all(dwells.setting[:, others] == 0.0, axis=1)
        reduced[axis] = Channel(axis, own_setting[used], dwells.value[used, 0], channel.unit)
    return BenchRecord(table, None, None, reduced, tuple(warnings))


def read_powerups(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> BenchRecord:
    """Read power-ups: ``powerup``, settings and outputs; or biases already computed, ``gyro_x_bias_deg_s``.

    `columns`: as in `read_static`. Raises: InputError: no column of power-ups, or an error of `read_bench`.
    """
    table = _read(path, ("setting", "raw", "sensed", "bias"), ("powerup",), columns, (POWERUP,))
    channels = {}
    for axis, quantities in _EVERY.items():
        if quantities["bias"].key in table.columns:
            channels[axis] = Channel(axis, np.empty(0), table.columns[quantities["bias"].key], SI[axis.split()[0]])
    channels |= _channels(table, settings=True)
    return BenchRecord(table, None, table.columns["powerup"], channels)


def read_drift(path: str | Path | Table, columns: Mapping[str, str] | None = None) -> tuple[DriftRecord, BenchTable]:
    """Read gyros at rest and turning: ``time_s``, ``gyro_x_deg_s`` …, and possible causes of drift.

    Causes: ``rate_x_deg_s`` … (true rates; without these columns all gyros are at rest), ``temperature_c``,
    ``accel_x_g`` …. `columns`: as in `read_static`. Raises: InputError: no gyro, outputs in volts, or an error of
    `read_bench`.
    """
    table = _read(path, ("setting", "raw", "sensed"), ("time",), columns)
    values: dict[str, dict[str, FloatArray]] = {"sensed": {}, "setting": {}}
    force: dict[str, FloatArray] = {}
    for axis, quantities in _EVERY.items():
        sensor, letter = axis.split()
        if quantities["raw"].key in table.columns:
            unit, name = table.units[quantities["raw"].key], quantities["sensed"].name
            raise InputError("lab.drift_of_raw", where=table.name, sensor=axis, unit=unit, name=name)
        for kind, into in values.items():
            if quantities[kind].key in table.columns:
                (into if sensor == "gyro" else force)[letter] = table.columns[quantities[kind].key]
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
    schema = tuple(quantities[kind] for quantities in _EVERY.values() for kind in kinds)
    headers = open_table(path).headers if columns else ()
    named = {name: header for name, header in (columns or {}).items() if header in headers}
    table = read_bench(path, (*schema, *more), needed, columns=named)
    outputs = {quantities[kind].key for quantities in _EVERY.values() for kind in ("raw", "sensed", "bias")}
    if not outputs & set(table.columns):
        raise InputError("lab.no_sensor", where=table.name)
    return table


def _channels(table: BenchTable, *, settings: bool) -> dict[str, Channel]:
    channels = {}
    for axis, quantities in _EVERY.items():
        raw, sensed = quantities["raw"].key, quantities["sensed"].key
        if raw not in table.columns and sensed not in table.columns:
            continue
        key, setting = (raw if raw in table.columns else sensed), quantities["setting"]
        if settings and setting.key not in table.columns:
            raise InputError("lab.no_setting", where=table.name, sensor=axis, name=setting.name)
        unit = table.units[raw] if key == raw else SI[axis.split()[0]]
        commanded = table.columns[setting.key] if settings else np.empty(0)
        channels[axis] = Channel(axis, commanded, table.columns[key], unit)
    return channels
