"""Calibration of gyros on a rate table, one after another: zero and scale factor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity
from insnav.lab.calibration import BenchOptions, Calibration
from insnav.lab.single_axis.rate_table import RateTable, calibrate_rate_table
from insnav.lab.single_axis.records import OUTPUT, Record, read_records, refuse_unit, triad_calibration
from insnav.units import DEG

USUAL_RATES = 10  # ± 10, 20, 40, 60, 80 deg/s
SCHEMA = (
    Quantity("rate", "rate_deg_s", "rate", "deg/s", ("rate", "tablerate", "angularrate", "omega", "w")),
    Quantity("output", "output_v", "signal", "V", OUTPUT),
    Quantity("sensed", "output_deg_s", "rate", "deg/s", (*OUTPUT, "gyro")),
)


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> tuple[Record, ...]:
    """Read the rate tables of gyros x, y, z, or of one; see `read_records`."""
    return read_records(files, SCHEMA, how)


def fit(record: tuple[Record, ...], how: BenchOptions) -> Calibration[tuple[Record, ...], tuple[RateTable, ...]]:
    """Fit zero and scale factor of gyros x, y, z, or of one for all."""
    found = tuple(calibrate_gyro(item, how.keep) for item in record)
    warnings = [rate_table_warnings(item) for item in found]
    return triad_calibration("gyro", record, found, DEG, ("", "/(deg/s)"), how, warnings)


def calibrate_gyro(record: Record, keep: tuple[float, float] | None = None) -> RateTable:
    """Zero and scale factor of a gyro; rates in deg/s as rate tables show them.

    keep: smallest and largest rate to use [deg/s]. Raises InputError: see `calibrate_rate_table`; or a digital output
    in another unit than its column states.
    """
    # the table's rates are round numbers in deg/s: keep them so
    rate = np.round(record.setting / DEG, 9)
    found = calibrate_rate_table(rate, record.output, keep, where=record.table.name)
    refuse_unit(record, float(found.fit.value[1]))
    return found


def rate_table_warnings(found: RateTable) -> tuple[str, ...]:
    """Say what is wrong with a rate table that could still be used."""
    warnings = []
    used = np.unique(found.rate[found.used])
    left = [item for item in found.dropped if np.isfinite(item.limit) and not item.reason.startswith("outside")]
    if left:
        warnings.append(
            f"{len(left)} of {found.rate.size} rates were left out: the output has left the straight line there"
        )
    if used.size < USUAL_RATES:
        warnings.append(f"only {used.size} different rates; {USUAL_RATES} or more are usual")
    if used[0] >= 0.0 or used[-1] <= 0.0:
        warnings.append("one sense of rotation only: a scale factor that differs between the senses is in the zero")
    return tuple(warnings)
