"""The report of a GNSS outage test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from insnav.errors.outage.statistics import Growth, outage_growth
from insnav.errors.outage.study import OutageEpochs, OutageStudy
from insnav.output.folder import RunFolder, read_facts
from insnav.output.solution_tables import TableFormat, read_run_table, write_run_table
from insnav.quantity import Quantity
from insnav.report.frames import rows_frame
from insnav.report.numbers import number
from insnav.report.outage.panels import NOTE, outage_panels
from insnav.report.outage.quantities import INTERVALS, common_text, corrected, corrected_text
from insnav.report.page import Light, Page, Section, Verdict, drawn
from insnav.result import Result

if TYPE_CHECKING:
    import pandas as pd

_INSIDE, _FEW_INSIDE = 0.95, 0.8  # shares inside 3 sd from which the stated sd is right, or at least not far off
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
    name = Path(result.inputs["imu"].path).name if "imu" in result.inputs else "a drive"
    rows = tuple(_row(each) for each in study.growth)
    first, *others = (table for component in _COMPONENTS if (table := _table(component, study.growth)).rows)
    inside = ", ".join(f"{100.0 * each.inside_at_end:.0f} % of {each.length:g} s" for each in study.growth)
    common = tuple(line for line in (common_text(each) for each in study.growth) if line)
    title = f"Error without GPS against {study.reference}"
    growing = drawn("outages", title, outage_panels(study.windows, study.growth), NOTE)
    return Page(
        f"GNSS outage test: {name}, {len(study.windows)} windows",
        (f"Against {study.reference}. Inside 3 sd (north, east, down): {inside}.",),
        (
            Section("", items=(Quantity("reference", study.reference),), show="json"),
            Section("outages", rows=rows, show="json"),
            first,
            growing,
            *(replace(table, folded=not table.title.startswith("Smoothed horizontal")) for table in others),
        ),
        warnings=common,
        verdict=_verdict(study),
        merits=_merits(study.growth[-1]),
        assumptions=(
            "Each window starts from the filter at its first epoch, with all fixes before and none within.",
            "RMS, 95 % and max are of the difference to the reference, whose own errors are in all three; RMS "
            "corrected: its variance subtracted. Against noisy fixes the largest of many is mostly their noise.",
            "Smoothed: at the epoch of each window where the sd of the smoothed position is largest.",
            "Heading is compared with that smoothed from all fixes, so it is not independent.",
            INTERVALS,
        ),
    )


def _verdict(study: OutageStudy) -> Verdict:
    """Say how large errors become in the longest outages, and whether the stated sd can be relied on."""
    found = study.growth[-1]
    i, smoothed = found.column("horizontal"), found.column("smoothed horizontal")
    sizes = [
        (float(each.corrected[-1, k]), float(each.low[-1, k]), float(each.high[-1, k])) for each, k in _both(found)
    ]
    least = min(study.growth, key=lambda each: each.inside_at_end)
    share = f"{100.0 * least.inside_at_end:.0f} % of the errors after {least.length:g} s are inside 3 sd"
    light, words = (
        ("good", "the stated sd can be relied on")
        if least.inside_at_end >= _INSIDE
        else ("attention", "the stated sd is too small")
        if least.inside_at_end >= _FEW_INSIDE
        else ("bad", "the stated sd is far too small")
    )
    text = (
        f"After {found.length:g} s without GPS: horizontal error {corrected_text(*sizes[0])}, 95 % "
        f"{number(float(found.p95[-1, i]))} m, predicted {number(float(found.predicted[-1, i]))} m"
    )
    if np.isfinite(found.rms[-1, smoothed]):
        text += f"; smoothed {corrected_text(*sizes[1])}"
    return Verdict(cast(Light, light), f"{share}: {words}", f"{text}.")


def _both(found: Growth) -> list[tuple[Growth, int]]:
    """Columns of the horizontal error, filtered and smoothed."""
    return [(found, found.column(name)) for name in ("horizontal", "smoothed horizontal")]


def _merits(found: Growth) -> tuple[Quantity, ...]:
    """Figures of merit of the longest windows, as measured."""
    wanted = (
        ("horizontal", found.rms, "horizontal, RMS"),
        ("horizontal", found.p95, "horizontal, 95 %"),
        ("vertical", found.rms, "vertical, RMS"),
        ("heading", found.rms, "heading, RMS"),
        ("smoothed horizontal", found.rms, "smoothed horizontal, RMS"),
    )
    quantities = [
        Quantity(text.replace(" ", "_"), float(values[-1, found.column(name)]), _COMPONENTS[name], meaning=text)
        for name, values, text in wanted
    ]
    inside = Quantity("inside", f"{100.0 * found.inside_at_end:.0f} %", meaning=f"inside 3 sd, {found.count} windows")
    return (*quantities, inside)


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
                ("reference", "ref. sd", found.reference),
            )
        )
        predicted = Quantity("predicted", float(found.predicted[-1, i]), unit, meaning="predicted sd")
        length = Quantity("length", found.length, "s", meaning="without GPS", digits=2)
        rows.append((length, Quantity("windows", found.count), *measured, corrected(found, i, unit), predicted))
    known = any(np.isfinite(found.rms[-1, found.column(component)]) for found in growth)
    where = "where predicted largest" if component.startswith("smoothed") else "at the end of the outage"
    title = f"{component.capitalize()} error {where}: as measured | corrected for the reference"
    return Section("", title, rows=tuple(rows) if known else ())


def write_files(result: Result[OutageStudy], folder: RunFolder, table_format: TableFormat) -> None:
    """Write every epoch of every window.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}.
    """
    write_run_table(folder.directory, OutageEpochs.of(result.found.windows), table_format, "windows")


def read_found(folder: Path) -> OutageStudy:
    """Read an outage test from its folder; sums are formed again.

    Raises: InputError: the table of windows is missing or damaged.
    """
    windows = read_run_table(folder, OutageEpochs, "windows").windows()
    return OutageStudy(windows, tuple(outage_growth(windows)), str(read_facts(folder).get("reference", "a reference")))


def frame(result: Result[OutageStudy]) -> pd.DataFrame:
    """Give the errors at the end of the windows as a table."""
    return rows_frame(_row(each) for each in result.found.growth)
