"""Files of benches with one sensor at a time, and what the calibrations of such sensors have in common.

The output is in volts, counts, or already in the unit of what is sensed. Volts and counts become a line in the
calibration file (`insnav.imu.raw_outputs`), anything else a bias and a scale factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity
from insnav.lab.bench_data.bench_tables import BenchTable, read_bench
from insnav.lab.bench_data.dwells import Dwells, default_limit, dwell_warnings, reduce_dwells
from insnav.lab.calibration import STANDARD, WRONG_UNIT, BenchOptions, common_unit, condition_warnings
from insnav.lab.least_squares import Fit
from insnav.types import FloatArray
from insnav.units import UNITS

OUTPUT = ("output", "voltage", "volts", "u", "signal", "measured")


@dataclass(frozen=True, slots=True)
class Record:
    """One sensor's bench file, reduced to one output a dwell."""

    table: BenchTable  # as read
    dwells: Dwells  # setting [rad/s] or [rad], output in `unit`
    unit: str  # of the output
    warnings: tuple[str, ...]

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
        """Whether the output is in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def read_records(
    files: Sequence[str | Path | Table], schema: Sequence[Quantity], how: BenchOptions = STANDARD
) -> tuple[Record, ...]:
    """Read the files of x, y, z, or of one sensor that stands for all three; see `read_record`.

    Raises InputError: there are not one or three, or their outputs have different units.
    """
    records = tuple(read_record(file, schema, how) for file in files)
    if len(records) not in (1, 3):
        raise InputError(
            f"{len(records)} sensors are no triad",
            why="a calibration is of x, y and z",
            fix="give the files of x, y, z in this order, or one file that stands for all",
        )
    common_unit([(item.table.name, item.unit) for item in records])
    return records


def read_record(path: str | Path | Table, schema: Sequence[Quantity], how: BenchOptions = STANDARD) -> Record:
    """Read the file of one sensor.

    path: columns of setting and output; several successive rows of one setting are the samples of a dwell; schema:
    setting, raw output, output in the unit of what is sensed; how: columns and limit of spikes. Raises InputError:
    the file cannot be used.
    """
    setting = schema[0].key
    table = read_bench(path, schema, (setting, "output"), columns=how.columns, alternatives={"output": "sensed"})
    key = "output" if "output" in table.columns else "sensed"
    unit = table.units[key] if key == "output" else schema[2].unit
    values = table.columns[key] / (1.0 if key == "output" else UNITS[unit][1])
    limit = how.spike_limit if how.spike_limit is not None else default_limit(unit)
    dwells = reduce_dwells(table.columns[setting][:, None], values[:, None], limit, table.get("time"), where=table.name)
    warnings = dwell_warnings(dwells, ("output",), table.get("temperature"))
    return Record(table, dwells, unit, warnings)


def refuse_unit(record: Record, scale: float) -> None:
    """Refuse a digital output that is not in the unit of its column; volts and counts may have any scale."""
    if not record.raw and abs(scale - 1.0) > WRONG_UNIT:
        raise InputError(
            "the output is not in the unit of its column",
            where=record.table.name,
            why=f"its scale factor is estimated as {scale:.4g}, for {record.unit}",
            fix="turn the sign of the table or of the sensor" if scale < 0.0 else "check the units in the headers",
        )


def names_of(records: Sequence[Record]) -> tuple[str, ...]:
    """Names of the sensors: x, y, z, or ``sensor`` for one that stands for all."""
    return ("x", "y", "z") if len(records) == 3 else ("sensor",)


def three(values: Sequence[float]) -> FloatArray:
    """Values of x, y, z, (3,), where one may stand for all."""
    return np.array(values if len(values) == 3 else [values[0]] * 3)


def all_warnings(
    records: Sequence[Record], fits: dict[str, Fit], by_sensor: Sequence[tuple[str, ...]]
) -> tuple[str, ...]:
    """Warnings of the records, of their fits, and `by_sensor` of the method."""
    sensors = names_of(records)
    read = [f"{name}: {line}" for name, record in zip(sensors, records, strict=True) for line in record.warnings]
    found = [f"{name}: {line}" for name, lines in zip(sensors, by_sensor, strict=True) for line in lines]
    one = ["one sensor was measured; the calibration file uses its values for x, y and z"] * (len(records) == 1)
    return (*read, *condition_warnings(fits), *found, *one)
