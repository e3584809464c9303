"""The report of a GNSS outage test."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from insnav.errors.outage.statistics import Growth
from insnav.errors.outage.study import OutageStudy
from insnav.quantity import Quantity
from insnav.report.frames import rows_frame
from insnav.report.outage.figures import draw_outages
from insnav.report.outage.quantities import INTERVALS, common_text, corrected
from insnav.report.page import FigureSpec, Page, Section
from insnav.result import Result

if TYPE_CHECKING:
    import pandas as pd

_COMPONENTS = {
    "horizontal": "m",
    "vertical": "m",
    "velocity": "m/s",
    "heading": "deg",
    "smoothed horizontal": "m",
    "smoothed vertical": "m",
}


def page(result: Result[OutageStudy]) -> Page:
    """Lay out an outage test."""
    study = result.found
    inside = ", ".join(f"{100.0 * each.inside_at_end:.0f} % of {each.length:g} s" for each in study.growth)
    name = Path(result.inputs["imu"].path).name if "imu" in result.inputs else "a drive"
    rows = tuple(_row(each) for each in study.growth)
    tables = tuple(_table(component, study.growth) for component in _COMPONENTS)
    draw = partial(draw_outages, study.windows, study.growth, study.reference)
    common = tuple(line for line in (common_text(each) for each in study.growth) if line)
    return Page(
        f"GNSS outage test: {name}",
        (
            f"Errors are against {study.reference}, at the end of each window; smoothed: where it is predicted to be "
            "largest.",
            f"Inside 3 sd (north, east, down): {inside}.",
            *common,
        ),
        (
            Section("outages", rows=rows, show="json"),
            *(table for table in tables if table.rows),
            Section("", figures=(FigureSpec("outages", "Error over the time without GPS", draw),), show="page"),
        ),
        assumptions=(
            "Each window starts from the filter at its first epoch, with all fixes before and none within.",
            "RMS, 95 % and max are of the difference to the reference, whose own errors are in all three; RMS "
            "corrected: its variance subtracted. Against noisy fixes the largest of many is mostly their noise.",
            "Smoothed: at the epoch of each window where the sd of the smoothed position is largest.",
            "Heading is compared with that smoothed from all fixes, so it is not independent.",
            INTERVALS,
        ),
    )


def _row(found: Growth) -> tuple[Quantity, ...]:
    """Errors at the end of the windows of one length."""
    return (
        Quantity("length", found.length, "s", meaning="without GPS"),
        Quantity("windows", found.count),
        Quantity("effective", found.effective),
        Quantity("inside_3_sd", found.inside_at_end),
        Quantity("common_to_all_windows", float(found.common[-1, found.column("horizontal")])),
        *(_component(found, name, unit) for name, unit in _COMPONENTS.items()),
    )


def _component(found: Growth, name: str, unit: str) -> Quantity:
    column = found.column(name)
    statistics = {
        "rms": found.rms,
        "p95": found.p95,
        "max": found.largest,
        "reference": found.reference,
        "rms_corrected": found.corrected,
        "rms_corrected_low": found.low,
        "rms_corrected_high": found.high,
        "predicted": found.predicted,
    }
    return Quantity(name.replace(" ", "_"), {key: float(each[-1, column]) for key, each in statistics.items()}, unit)


def _table(component: str, growth: Sequence[Growth]) -> Section:
    """Table of one component, with a row a length; without rows if nothing is known of it."""
    unit, rows = _COMPONENTS[component], []
    for found in growth:
        i = found.column(component)
        measured = (
            Quantity(key, float(values[-1, i]), unit, meaning=meaning)
            for key, meaning, values in (
                ("rms", "RMS", found.rms),
                ("p95", "95 %", found.p95),
                ("max", "max", found.largest),
                ("reference", "reference sd", found.reference),
            )
        )
        predicted = Quantity("predicted", float(found.predicted[-1, i]), unit, meaning="predicted sd")
        length = Quantity("length", found.length, "s", meaning="without GPS", digits=2)
        rows.append((length, Quantity("windows", found.count), *measured, corrected(found, i, unit), predicted))
    known = any(np.isfinite(found.rms[-1, found.column(component)]) for found in growth)
    where = "where it is predicted to be largest" if component.startswith("smoothed") else "at the end"
    title = f"{component.capitalize()} error {where} of the outage: as measured | reference variance subtracted"
    return Section("", title, rows=tuple(rows) if known else ())


def frame(result: Result[OutageStudy]) -> pd.DataFrame:
    """Give the errors at the end of the windows as a table."""
    return rows_frame(_row(each) for each in result.found.growth)
