"""Report of a calibration by any method."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.imu import calibration_to_toml
from insnav.input.readers.reading import ReadingFacts
from insnav.lab.calibration import Calibration
from insnav.quantity import Quantity
from insnav.report.calibration.common import bench_input
from insnav.report.calibration.multi_position import multi_position_page, nine_page
from insnav.report.calibration.single_axis import accel_page, gyro_page, rotor_page, sweep_page
from insnav.report.page import DataFrame, Page, by_warnings, only_json, rows_frame
from insnav.result import Result

# page of each method, and its input
_METHODS: Mapping[str, tuple[Callable[[Calibration[Any, Any]], Page], Callable[[Any], Any]]] = {
    "gyro": (gyro_page, lambda records: bench_input([each.table for each in records])),
    "accel": (accel_page, lambda records: bench_input([each.table for each in records])),
    "imu": (sweep_page, lambda record: bench_input(record.tables)),
    "nine": (nine_page, lambda record: bench_input([record.table])),
    "poses": (multi_position_page, ReadingFacts.as_dict),
    "rotor": (rotor_page, bench_input),
}
_MERITS = 6


def page(result: Result[Calibration[Any, Any]]) -> Page:
    """Lay out a calibration."""
    found = result.found
    report, files = _METHODS[found.method]
    own = report(found)
    first, *others = own.summary
    return replace(
        own,
        summary=tuple(others),
        sections=(only_json("", Quantity("input", files(found.record))), *own.sections),
        verdict=by_warnings(first[0].upper() + first[1:], result.findings, ("good", "no warning from the fits")),
        merits=own.merits or tuple(replace(each, interval=None) for each in found.parameters[:_MERITS]),
    )


def texts(result: Result[Calibration[Any, Any]]) -> dict[str, str]:
    """Return the calibration file, if the method calibrates an IMU."""
    errors = result.found.errors
    return {} if errors is None else {"calibration.toml": calibration_to_toml(errors)}


def frame(result: Result[Calibration[Any, Any]]) -> DataFrame:
    """Build a table of the parameters: one row per number, with unit and standard deviation."""
    return rows_frame(row for each in result.found.parameters for row in _numbers(each))


def _numbers(each: Quantity) -> list[tuple[Quantity, ...]]:
    """Split a parameter into the elements of its vector or matrix."""
    values, sds = np.broadcast_arrays(each.scaled(each.value), each.scaled(each.sd))
    return [
        (
            Quantity("parameter", f"{each.label} {''.join('xyz'[k] for k in at)}".strip()),
            Quantity("unit", each.unit),
            Quantity("value", values[at]),
            Quantity("sd", sds[at]),
        )
        for at in np.ndindex(values.shape)
    ]
