"""The report of a calibration, by whatever method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any, cast

from insnav.input.readers.reading import Reading
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.calibration import Calibration
from insnav.report.calibration.common import bench_input
from insnav.report.page import Page, by_warnings

_PAGES = {
    "gyro": "single_axis.gyro_page",
    "accel": "single_axis.accel_page",
    "imu": "rate_sweep.sweep_page",
    "nine": "nine_position.nine_page",
    "poses": "multi_position.multi_position_page",
    "rotor": "rotor_inertia.rotor_page",
}
_MERITS = 6
_NAMES = {
    "gyro": "gyro rate table",
    "accel": "accelerometer tumble",
    "imu": "rate sweeps",
    "nine": "nine positions",
    "poses": "poses",
    "rotor": "rotor",
}
_TABLES: Mapping[str, Callable[[Any], Sequence[BenchTable]]] = {
    "gyro": lambda records: [each.table for each in records],
    "accel": lambda records: [each.table for each in records],
    "imu": lambda record: record.tables,
    "nine": lambda record: (record.table,),
    "rotor": lambda tables: tables,
}


def calibration_page(calibration: Calibration[Any, Any]) -> Page:
    """Report a calibration."""
    module, function = _PAGES[calibration.method].split(".")
    report = getattr(import_module(f"insnav.report.calibration.{module}"), function)
    page = cast(Page, report(calibration))
    if not page.summary:
        return page
    sentence = page.summary[0][0].upper() + page.summary[0][1:]
    verdict = by_warnings(sentence, page.warnings, ("good", "no warning from the fits"))
    merits = page.merits or tuple(replace(each, interval=None) for each in calibration.parameters[:_MERITS])
    return replace(page, verdict=verdict, summary=page.summary[1:], merits=merits)


def calibration_metadata(calibration: Calibration[Any, Any]) -> dict[str, Any]:
    """Give what every calibration has first in ``run.json``: method and input; of a record, the options too."""
    record, how = calibration.record, calibration.options
    if not isinstance(record, Reading):
        return {
            "method": _NAMES[calibration.method],
            "input": bench_input(_TABLES[calibration.method](record)),
        }
    configuration = {
        "method": "six" if how.six else "poses",
        "counts": how.counts,
        "gravity_m_s2": how.gravity,
        "gravity": how.gravity_source,
    }
    name = "six positions" if how.six else "poses"
    return {"method": name, "configuration": configuration, "input": record.facts.as_dict()}
