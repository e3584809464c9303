"""The report of a GNSS outage test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from insnav.errors.outage.statistics import Growth
from insnav.errors.outage.study import OutageStudy
from insnav.quantity import Quantity
from insnav.report.frames import rows_frame
from insnav.report.outage.figures import draw_outages
from insnav.report.page import FigureSpec, Page, Section, members
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
    tables = tuple(_table(component, study.growth, rows) for component in _COMPONENTS)
    draw = partial(draw_outages, study.windows, study.growth, study.reference)
    return Page(
        f"GNSS outage test: {name}",
        (
            f"Errors are against {study.reference}, at the end of each window; smoothed: largest in the window.",
            f"Inside 3 sd (north, east, down): {inside}.",
        ),
        (
            Section("outages", rows=rows, show="json"),
            *(table for table in tables if table.rows),
            Section("", figures=(FigureSpec("outages", "Error over the time without GPS", draw),), show="page"),
        ),
        assumptions=(
            "Each window starts from the filter at its first epoch, with all fixes before and none within.",
            "Reference variance is subtracted from the RMS, which is 0 if nothing is left; 95 % and max contain it: "
            "against noisy fixes the largest of many is mostly their noise.",
            "Heading is compared with that smoothed from all fixes, so it is not independent.",
        ),
    )


def _row(found: Growth) -> tuple[Quantity, ...]:
    """Errors at the end of the windows of one length."""
    return (
        Quantity("length", found.length, "s", meaning="without GPS"),
        Quantity("windows", found.count),
        Quantity("inside_3_sd", found.inside_at_end),
        *(_component(found, name, unit) for name, unit in _COMPONENTS.items()),
    )


def _component(found: Growth, name: str, unit: str) -> Quantity:
    column = found.column(name)
    figures = {"rms": found.rms, "p95": found.p95, "max": found.largest, "predicted": found.predicted}
    return Quantity(name.replace(" ", "_"), {key: float(each[-1, column]) for key, each in figures.items()}, unit)


def _table(component: str, growth: Sequence[Growth], rows: Sequence[tuple[Quantity, ...]]) -> Section:
    """Table of one component, with a row a length; without rows if nothing is known of it."""
    key = component.replace(" ", "_")
    chosen = []
    for length, windows, *others in rows:
        (found,) = (each for each in others if each.key == key)
        columns = (replace(each, meaning=each.label.removeprefix(f"{found.label} ")) for each in members(found))
        chosen.append((replace(length, digits=2), windows, *columns))
    known = any(np.isfinite(found.rms[-1, found.column(component)]) for found in growth)
    return Section("", component.capitalize(), rows=tuple(chosen) if known else ())


def frame(result: Result[OutageStudy]) -> pd.DataFrame:
    """Give the errors at the end of the windows as a table."""
    return rows_frame(_row(each) for each in result.found.growth)
