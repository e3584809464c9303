"""Bench files of one sensor at a time, and common parts of their calibrations.

The output is in volts, counts, or in the unit of the input. For volts and counts the calibration file contains a line
(`insnav.imu.raw_outputs`), otherwise a bias and a scale factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.model import ImuErrors
from insnav.imu.raw_outputs import RawScale
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity
from insnav.lab.bench_data import BenchTable, Dwells, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.calibration import (
    STANDARD,
    WRONG_UNIT,
    BenchOptions,
    Calibration,
    CalibrationSd,
    about,
    badly_conditioned,
    common_unit,
    fitted,
)
from insnav.lab.least_squares import Fit
from insnav.types import FloatArray
from insnav.units import UNITS


@dataclass(frozen=True, slots=True)
class Record:
    """Bench file of one sensor, reduced to one output per dwell."""

    table: BenchTable  # as read
    dwells: Dwells  # setting [rad/s] or [rad], output in `unit`
    unit: str  # of the output
    warnings: tuple[Finding, ...]

    @property
    def setting(self) -> FloatArray:
        """Rate [rad/s] or angle [rad] of each dwell, (n,)."""
        return self.dwells.setting[:, 0]

    @property
    def output(self) -> FloatArray:
        """Output of each dwell, (n,)."""
        return self.dwells.value[:, 0]

    @property
    def raw(self) -> bool:
        """True if the output is in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def read_records(
    files: Sequence[str | Path | Table], schema: Sequence[Quantity], how: BenchOptions = STANDARD
) -> tuple[Record, ...]:
    """Read the files of x, y, z, or of one sensor that stands for all three; see `read_record`.

    Raises: InputError: there are not one or three, or their outputs have different units.
    """
    records = tuple(read_record(file, schema, how) for file in files)
    if len(records) not in (1, 3):
        raise InputError("lab.not_three_sensors", count=len(records))
    common_unit([(item.table.name, item.unit) for item in records])
    return records


def read_record(path: str | Path | Table, schema: Sequence[Quantity], how: BenchOptions = STANDARD) -> Record:
    """Read the file of one sensor.

    `path`: columns of setting and output; several successive rows of one setting are the samples of a dwell. `schema`:
    setting, raw output, output in the unit of the input. `how`: columns and limit of spikes. Raises: InputError: the
    file cannot be used.
    """
    setting = schema[0].key
    table = read_bench(path, schema, (setting, "output"), columns=how.columns, alternatives={"output": "sensed"})
    key = "output" if "output" in table.columns else "sensed"
    unit = table.units[key] if key == "output" else schema[2].unit
    values = table.columns[key] / (1.0 if key == "output" else UNITS[unit][1])
    limit = how.spike_limit if how.spike_limit is not None else default_limit(unit)
    dwells = reduce_dwells(table.columns[setting][:, None], values[:, None], limit, table.get("time"), where=table.name)
    return Record(table, dwells, unit, dwell_warnings(dwells, ("",), table.get("temperature")))


def refuse_unit(record: Record, scale: float) -> None:
    """Refuse a digital output that is not in the unit of its column; volts and counts may have any scale."""
    if not record.raw and abs(scale - 1.0) > WRONG_UNIT:
        raise InputError(
            "lab.output_reversed" if scale < 0.0 else "lab.output_unit",
            where=record.table.name,
            scale=scale,
            unit=record.unit,
        )


class Fitted(Protocol):
    """Common part of a method's results for one sensor: zero and scale factor first."""

    @property
    def fit(self) -> Fit:
        """Fit of its parameters."""


F = TypeVar("F", bound=Fitted)


def triad_calibration(
    sensor: Literal["gyro", "accel"],
    record: tuple[Record, ...],
    found: tuple[F, ...],
    per: float,
    per_units: Sequence[str],
    how: BenchOptions,
    by_sensor: Sequence[tuple[Finding, ...]],
) -> Calibration[tuple[Record, ...], tuple[F, ...]]:
    """Build the calibration of zero and scale factor of sensors x, y, z, or of one sensor for all.

    `found`: of each, scale factors for a setting of `per` [rad/s] or [m/s^2]. `per_units`: denominator of each
    parameter's unit after the output unit. `by_sensor`: warnings of the method.
    """
    names = ("x", "y", "z") if len(record) == 3 else ("sensor",)
    fits = {name: item.fit for name, item in zip(names, found, strict=True)}
    value, sd = (np.array([getattr(fit, key)[:2] for fit in fits.values()]) for key in ("value", "sd"))
    (zero, scale), (zero_sd, scale_sd) = (np.array(each if len(each) == 3 else [each[0]] * 3).T for each in (value, sd))
    unit, size = record[0].unit, np.abs(scale)
    known: dict[str, Any]
    if record[0].raw:
        known = {f"{sensor}_raw": RawScale(unit, zero, scale / per)}
    else:
        si = UNITS[unit][1]
        known = {f"{sensor}_bias": zero * si, f"{sensor}_matrix": np.diag(scale / (per / si))}
    spread: dict[str, Any] = {f"{sensor}_bias": zero_sd / size * per, f"{sensor}_matrix": np.diag(scale_sd / size)}
    full = {name: f"{sensor} {name}" if len(record) == 3 else sensor for name in names}
    both = zip(full.values(), record, by_sensor, strict=True)
    own = [each for name, item, more in both for each in about(name, (*item.warnings, *more))]
    one = (Finding.of(Code.BENCH_ONE_SENSOR, subject=sensor),) * (len(record) == 1)
    warnings = (*own, *badly_conditioned({full[name]: fit for name, fit in fits.items()}), *one)
    units = [f"{unit}{each}" for each in per_units]
    parameters = tuple(each for name, fit in fits.items() for each in fitted(fit, units, name))
    errors, sd_of = ImuErrors(**known, name=how.name), CalibrationSd(**spread)
    return Calibration(sensor, errors, sd_of, parameters, fits, record, found, how, warnings)
