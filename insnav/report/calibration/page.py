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

# name in run.json, function of the page, tables that it was read from
_METHODS: Mapping[str, tuple[str, str, Callable[[Any], Sequence[BenchTable]]]] = {
    "gyro": ("gyro rate table", "single_axis.gyro_page", lambda records: [each.table for each in records]),
    "accel": ("accelerometer tumble", "single_axis.accel_page", lambda records: [each.table for each in records]),
    "imu": ("rate sweeps", "rate_sweep.sweep_page", lambda record: record.tables),
    "nine": ("nine positions", "nine_position.nine_page", lambda record: (record.table,)),
    "poses": ("poses", "multi_position.multi_position_page", lambda record: ()),
    "rotor": ("rotor", "rotor_inertia.rotor_page", lambda tables: tables),
}
_MERITS = 6


def calibration_page(calibration: Calibration[Any, Any]) -> Page:
    """Report a calibration."""
    module, function = _METHODS[calibration.method][1].split(".")
    report = getattr(import_module(f"insnav.report.calibration.{module}"), function)
    page = cast(Page, report(calibration))
    if not page.summary:
        return page
    sentence = page.summary[0][0].upper() + page.summary[0][1:]
    verdict = by_warnings(sentence, page.findings, ("good", "no warning from the fits"))
    merits = page.merits or tuple(replace(each, interval=None) for each in calibration.parameters[:_MERITS])
    return replace(page, verdict=verdict, summary=page.summary[1:], merits=merits)


def calibration_metadata(calibration: Calibration[Any, Any]) -> dict[str, Any]:
    """Give what every calibration has first in ``run.json``: method and input; of a record, the options too."""
    record, how = calibration.record, calibration.options
    if not isinstance(record, Reading):
        name, _, tables = _METHODS[calibration.method]
        return {"method": name, "input": bench_input(tables(record))}
    configuration = {
        "method": "six" if how.six else "poses",
        "counts": how.counts,
        "gravity_m_s2": how.gravity,
        "gravity": how.gravity_source,
    }
    name = "six positions" if how.six else "poses"
    return {"method": name, "configuration": configuration, "input": record.facts.as_dict()}
