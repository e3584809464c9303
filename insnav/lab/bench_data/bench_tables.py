"""Bench tables: a few named columns with units in the header, and dwells in them.

A dwell is many samples at one rate or one position, cleaned and reduced to one value. A polynomial over its samples
follows warm-up and drift; samples far from it are spikes.
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
from insnav.types import FloatArray
from insnav.units import UNITS

TIME = Quantity("time", "time_s", "time", "s", ("time", "t", "timestamp"))
TEMPERATURE = Quantity("temperature", "temperature_c", "temperature", "degC", ("temperature", "temp"))


@dataclass(frozen=True, slots=True)
class BenchFile:
    """Source file of a result."""

    name: str  # the file and its digest
    sha256: str
    units: Mapping[str, str]  # units as in the file, by key


@dataclass(frozen=True, slots=True)
class BenchTable(BenchFile):
    """Columns of a bench file in SI units, but raw outputs in the unit of the file."""

    columns: Mapping[str, FloatArray]  # (n,) by key

    @property
    def file(self) -> BenchFile:
        """File information without the columns."""
        return BenchFile(self.name, self.sha256, self.units)

    def stack(self, *keys: str) -> FloatArray:
        """Stack columns, (n, k)."""
        return np.column_stack([self.columns[key] for key in keys])

    def get(self, key: str) -> FloatArray | None:
        """Return a column if the file has it."""
        return self.columns.get(key)


def read_bench(
    path: str | Path | Table,
    schema: Sequence[Quantity],
    needed: Sequence[str],
    *,
    columns: Mapping[str, str] | None = None,
    alternatives: Mapping[str, str] | None = None,
) -> BenchTable:
    """Read a table of the bench.

    `schema`: possible quantities; time and temperature always. `needed`: keys of required columns. `columns`: quantity
    to header, for unusual headers. `alternatives`: key that may replace a required one.
    Raises: InputError: a column is missing or has no unit, or a cell is empty.
    """
    table = open_table(path)
    schema = (*schema, TIME, TEMPERATURE)
    found, _ = understand(table.headers, table.units, schema, columns=columns, where=table.name)
    wanted = [
        other if key not in found and (other := (alternatives or {}).get(key, key)) in found else key for key in needed
    ]
    require(found, wanted, table, schema)
    for item in found.values():
        if item.unit is None and item.quantity.dimension:
            raise InputError("lab.no_unit", where=table.name, column=item.header, name=item.quantity.name)
    if not found:
        raise InputError(
            "lab.no_column",
            where=table.name,
            headers=tuple(table.headers),
            known=tuple(item.name for item in schema[:4]),
        )
    numbers = table.cells.read([item.index for item in found.values()])
    if numbers.cut:
        raise InputError("lab.truncated", where=table.name, **dict[str, Any](numbers.cut.values))
    if numbers.n_rows == 0:
        raise InputError("lab.no_rows", where=table.name)
    values, units = {}, {}
    for key, item in found.items():
        raw = numbers.columns[item.index]
        if not np.isfinite(raw).all():
            row = int(np.argmin(np.isfinite(raw)))
            raise InputError("lab.value_missing", where=table.place(row, item.index))
        values[key] = raw if item.quantity.dimension == "signal" else raw * item.factor
        units[key] = item.unit or ""
    return BenchTable(table.name, table.sha256, units, values)


ORDER = 7  # of the polynomial
LIMIT_V = 0.005  # samples further from it are dropped [V]
MAX_ROUNDS = 10  # spikes bend the polynomial: it is fitted again without them until convergence
LARGEST_LOSS = 0.5  # a dwell that loses a larger share of its samples has no value
MANY_SPIKES = 0.05  # share of spikes in a dwell that is reported
LARGEST_DRIFT_C = 2.0  # largest temperature change within a calibration [deg C]


@dataclass(frozen=True, slots=True)
class Dwells:
    """Reduced dwells, one value each."""

    setting: FloatArray  # (n, k) rate or angle of each dwell, in the unit of the table it came from
    value: FloatArray  # (n, m) mean of the samples kept, for each of m sensors
    # (n, m) standard deviation of these means, samples taken as independent; zero where one value was given
    sd: FloatArray
    count: FloatArray  # (n,) samples of each dwell
    dropped: FloatArray  # (n, m) samples dropped as spikes

    @property
    def raw(self) -> bool:
        """True if there were samples to clean, not one mean per dwell."""
        return bool((self.count > 1).any())


def default_limit(unit: str) -> float:
    """Distance from the polynomial beyond which samples are dropped, in their unit: none but of volts.

    `unit`: of the samples.
    """
    dimension, factor = UNITS[unit]
    return LIMIT_V / factor if dimension == "signal" and unit != "LSB" else float("inf")


def clean_mean(
    time: FloatArray, samples: FloatArray, limit: float, *, where: str = "", row: int = 0
) -> tuple[float, float, int]:
    """Compute the mean of the samples of a dwell without its spikes.

    `time` (n,): time of each sample, in any unit. `samples` (n,): samples. `limit`: largest distance from the
    polynomial, in the unit of the samples. `row`: first row of the dwell, from 0. Returns mean, sd: mean of the samples
    kept and its standard deviation; dropped: how many were not kept. Raises: InputError: more than half of them lie
    beyond the limit.
    """
    order = min(ORDER, max(0, samples.size // 10))  # a short dwell does not carry seven bends
    good = np.ones(samples.size, dtype=np.bool_)
    for _ in range(MAX_ROUNDS):
        residual = samples - Polynomial.fit(time[good], samples[good], order, domain=[time[0], time[-1]])(time)
        before, good = good, np.abs(residual) <= limit
        if np.array_equal(before, good) or np.count_nonzero(good) <= order:
            break
    kept = samples[good]
    if kept.size < (1.0 - LARGEST_LOSS) * samples.size:
        raise InputError(
            "lab.dwell_of_spikes",
            where=where,
            begin_row=row + 1,
            end_row=row + samples.size,
            count=samples.size - kept.size,
            limit=limit,
            order=order,
            residual_sd=np.std(residual),
        )
    sd = float(np.std(residual[good]) / np.sqrt(kept.size)) if kept.size > 1 else 0.0
    return float(np.mean(kept)), sd, samples.size - kept.size


def reduce_dwells(
    settings: FloatArray, samples: FloatArray, limit: float, time: FloatArray | None = None, *, where: str = ""
) -> Dwells:
    """Reduce a record to one value for each interval of equal settings.

    `settings` (n, k): commanded rates or angles of each row. Rows of one dwell follow one another; a setting that comes
    back later is a dwell of its own. `samples` (n, m): outputs of m sensors. `limit`: as in `clean_mean`. `time` (n,):
    times of the rows; default their number. Raises: InputError: A value that is not a number, or a dwell of spikes.
    """
    bad = ~(np.isfinite(settings).all(axis=1) & np.isfinite(samples).all(axis=1))
    if bad.any():
        raise InputError("lab.value_missing", where=where, row=int(np.argmax(bad)) + 1)
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
    """Report dwells that lost many samples, and temperature changes.

    `dwells`: from `reduce_dwells`. `names`: of the sensors. `temperature` (n,): temperature of the rows [deg C].
    """
    warnings = []
    for name, lost in zip(names, dwells.dropped.T, strict=True):
        share = lost / dwells.count
        if share.max() > MANY_SPIKES:
            worst = int(np.argmax(share))
            size, limit = share[worst], MANY_SPIKES
            warnings.append(Finding.of(Code.BENCH_SPIKES, subject=name, share=size, limit_share=limit, dwell=worst + 1))
    return (*warnings, *warming(temperature, LARGEST_DRIFT_C))
