"""The report of a GNSS outage test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from insnav.errors.outage.gnss_outage import OutageEpochs, OutageStudy
from insnav.errors.outage.statistics import Growth, outage_growth
from insnav.findings import Code, Finding, Severity, is_shown
from insnav.output.folder import RunFolder, read_facts
from insnav.output.solution_tables import TableFormat, read_run_table, write_events, write_run_table
from insnav.quantity import Quantity
from insnav.report.numbers import number
from insnav.report.outage.windows import INTERVALS, NOTE, corrected, corrected_text, outage_panels
from insnav.report.page import STATISTICS as SHOWN
from insnav.report.page import (
    DataFrame,
    Light,
    Page,
    Section,
    Verdict,
    by_warnings,
    drawn,
    only_json,
    rows_frame,
)
from insnav.report.series import Clock
from insnav.report.terminal import page_text
from insnav.result import Result
from insnav.sample_statistics import rms
from insnav.units import UNITS

_INSIDE, _FEW_INSIDE = 0.95, 0.8  # shares inside 3 sd from which the stated sd is right, or at least not far off
_LARGER = 1.25  # times the predicted RMS error from which on it is said, whatever share is inside 3 sd
_MODES = ("", "smoothed ")
_SAME = 0.98  # of an RMS error: so much of it left without the reference is the same in words
STATISTICS = {  # of `Growth`: key and attribute
    "rms": "rms",
    "p95": "p95",
    "max": "largest",
    "reference": "reference",
    "rms_corrected": "corrected",
    "rms_corrected_low": "low",
    "rms_corrected_high": "high",
    "predicted": "predicted",
}
_COMPONENTS = {
    "horizontal": "m",
    "vertical": "m",
    "velocity": "m/s",
    "heading": "deg",
    "smoothed horizontal": "m",
    "smoothed vertical": "m",
}
_UNFOLDED = ("horizontal", "smoothed horizontal")


def page(result: Result[OutageStudy]) -> Page:
    """Lay out an outage test."""
    study = result.found
    name = str(Path(*Path(result.inputs["imu"].path).parts[-2:])) if "imu" in result.inputs else "a drive"
    rows = tuple(_row(each) for each in study.growth)
    tables = [(key, each) for key in _COMPONENTS if (each := _table(key, study.growth)).rows]
    inside = sorted({round(100.0 * each.inside_at_end) for each in study.growth})
    lengths = ", ".join(f"{each.length:g}" for each in study.growth)
    shown = tuple(each for each in result.findings if is_shown(each) and each.severity >= Severity.WARNING)
    clock = Clock.of(
        np.array([each.start for each in study.windows]) if study.run is None else study.run.run.solution.time
    )
    title = f"Error without GPS against {study.reference}"
    growing = drawn("outages", title, outage_panels(study.windows, study.growth), NOTE)
    return Page(
        f"GNSS outage test: {name}, {len(study.windows)} windows",
        (
            f"Inside 3 sd (north, east, down): {' to '.join(map(str, inside[:: max(len(inside) - 1, 1)]))} % after "
            f"{lengths} s.",
        ),
        (
            only_json("", Quantity("reference", study.reference)),
            Section("outages", rows=rows, show="json"),
            growing,
            *(each if key in _UNFOLDED else replace(each, folded=True, show="page") for key, each in tables),
        ),
        shown,
        at=clock.moment,
        starts_at=clock.start,
        verdict=_verdict(study, tuple(each for each in shown if each.code is not Code.OUTAGE_COMMON)),
        merits=_merits(study.growth[-1]),
        merits_note=f"After {study.growth[-1].length:g} s, as measured: the error of {study.reference} is in it.",
        method=(
            "Each window starts from the filter at its first epoch, with all fixes before and none within.",
            "RMS, 95 % and max: difference to the reference, whose own errors are in all three, and make most of the "
            "largest against noisy fixes; corrected: RMS with the variance of the reference subtracted.",
            "Smoothed: at the epoch of each window where the sd of the smoothed position is largest.",
            "Heading is compared with that smoothed from all fixes, so it is not independent.",
            INTERVALS,
        ),
    )


def judged(laid_out: Page) -> Page:
    """The page with its verdict among the sentences, for the terminal."""
    assert laid_out.verdict is not None
    said = laid_out.verdict.brief
    return replace(laid_out, summary=(said, *laid_out.summary))


def text(result: Result[OutageStudy]) -> str:
    """Give the report for the terminal."""
    return page_text(judged(page(result)))


def _verdict(study: OutageStudy, told: tuple[Finding, ...]) -> Verdict:
    """Say how large errors become in the longest outages, and whether the stated sd can be relied on in all."""
    found = study.growth[-1]
    i, smoothed = found.column("horizontal"), found.column("smoothed horizontal")
    both = [(each, lead) for each in study.growth for lead in _MODES]
    few, length, mode = min((_inside(each, lead), each.length, lead) for each, lead in both)
    ratio, longer, larger = max((ratio, each.length, name) for each in study.growth for ratio, name in _ratios(each))
    share = "all" if few == 1.0 else f"{100.0 * few:.0f} % or more"
    light, words = ("good", "can be relied on") if few >= _INSIDE else ("attention", "is too small")
    if few < _FEW_INSIDE:
        light, words = "bad", "is far too small"
    reason = f"{100.0 * few:.0f} % of the {mode}errors after {length:g} s are inside 3 sd: the stated sd {words}"
    if light == "good":
        reason = f"after every length {share} of the errors are inside 3 sd: the stated sd {words}"
    if light == "good" and ratio > _LARGER:
        light = "attention"
        reason = f"after {longer:g} s the {larger} errors are {ratio:.2f} times as large as predicted; "
        reason += f"{share} are inside 3 sd"
    text = (
        f"After {found.length:g} s without GPS: horizontal error {number(float(found.rms[-1, i]))} m RMS, "
        f"95 % {number(found.p95[-1, i])} m{_less_reference(found, i)}; "
        f"predicted {number(float(found.predicted[-1, i]))} m"
    )
    if np.isfinite(found.rms[-1, smoothed]):
        text += f"; smoothed {number(float(found.rms[-1, smoothed]))} m RMS{_less_reference(found, smoothed)}"
    return by_warnings(f"{text}.", told, (cast(Light, light), reason))


def _less_reference(found: Growth, column: int) -> str:
    """Say what is left of an RMS error at the end without that of the reference, if that is less."""
    left, low, high = (float(each[-1, column]) for each in (found.corrected, found.low, found.high))
    if left > _SAME * found.rms[-1, column]:
        return ""
    return f" as measured, {corrected_text(left, low, high)} without that of the reference"


def _inside(found: Growth, mode: str) -> float:
    """Share of the errors of a mode inside 3 sd, all of them where it is not known."""
    shares = [float(found.inside[-1, found.column(f"{mode}{name}")]) for name in ("horizontal", "vertical")]
    share = (2.0 * shares[0] + shares[1]) / 3.0
    return share if np.isfinite(share) else 1.0


def _ratios(found: Growth) -> list[tuple[float, str]]:
    """RMS errors at the end of windows of one length over the predicted, that of the reference in both, and of what."""
    names = [f"{mode}{name}" for mode in _MODES for name in ("horizontal", "vertical")]
    rms, predicted = found.rms[-1], np.hypot(found.predicted[-1], found.reference[-1])
    ratio = np.divide(rms, predicted, out=np.zeros_like(rms), where=np.isfinite(rms) & (predicted > 0.0))
    return [(float(ratio[found.column(name)]), name) for name in names]


def _merits(found: Growth) -> tuple[Quantity, ...]:
    """Figures of merit of the longest windows, as measured."""
    wanted = (
        ("horizontal", found.rms, "horizontal, RMS"),
        ("horizontal", found.p95, "horizontal, 95 %"),
        ("vertical", found.rms, "vertical, RMS"),
        ("heading", found.rms, "heading, RMS"),
        ("smoothed horizontal", found.rms, "smoothed horizontal, RMS"),
    )
    return (
        *(
            Quantity(text.replace(" ", "_"), float(values[-1, found.column(name)]), _COMPONENTS[name], meaning=text)
            for name, values, text in wanted
        ),
        Quantity("inside", f"{100.0 * found.inside_at_end:.0f} %", meaning=f"inside 3 sd, {found.count} windows"),
    )


def _row(found: Growth) -> tuple[Quantity, ...]:
    """Errors at the end of the windows of one length."""
    return (
        Quantity("length", found.length, "s", meaning="without GPS"),
        Quantity("windows", found.count),
        Quantity("effective", found.effective),
        Quantity("inside_3_sd", found.inside_at_end),
        Quantity("common_to_all_windows", float(found.common[-1, found.column("horizontal")])),
        *(Quantity(name.replace(" ", "_"), _statistics(found, name), unit) for name, unit in _COMPONENTS.items()),
    )


def _statistics(found: Growth, name: str) -> dict[str, float]:
    """Everything about a component at the end of the windows."""
    column = found.column(name)
    return {key: float(getattr(found, attribute)[-1, column]) for key, attribute in STATISTICS.items()}


def _table(component: str, growth: Sequence[Growth]) -> Section:
    """Table of one component, with a row a length; without rows if nothing is known of it."""
    unit, at_end = _COMPONENTS[component], [_statistics(found, component) for found in growth]
    rows = tuple(
        (
            Quantity("length", f"{found.length:g} s", meaning="after"),
            Quantity("windows", found.count),
            *(Quantity(key, each[key], unit, meaning=SHOWN[key]) for key in ("rms", "p95", "max")),
            corrected(found, found.column(component), unit),
            Quantity("predicted", each["predicted"], unit),
        )
        for found, each in zip(growth, at_end, strict=True)
    )
    reference = rms([each["reference"] for each in at_end]) / UNITS[unit][1]
    head = f"{component.capitalize()} error [{unit}]"
    if component.startswith("smoothed"):
        head += " where predicted largest"
    own = f"; reference {number(reference)} {unit}, 1 sd" if reference > 0.0 else ""
    return Section("", f"{head}{own}", rows=rows if np.isfinite([each["rms"] for each in at_end]).any() else ())


def write_files(result: Result[OutageStudy], folder: RunFolder, table_format: TableFormat) -> None:
    """Write every epoch of every window.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}.
    """
    write_run_table(folder.directory, OutageEpochs.of(result.found.windows), table_format, "windows")
    write_events(folder.directory, result.findings)


def read_found(folder: Path, findings: Sequence[Finding]) -> OutageStudy:
    """Read an outage test from its folder; sums are formed again.

    Raises: InputError: the table of windows is missing or damaged.
    """
    windows = read_run_table(folder, OutageEpochs, "windows").windows()
    return OutageStudy(windows, tuple(outage_growth(windows)), str(read_facts(folder).get("reference", "a reference")))


def frame(result: Result[OutageStudy]) -> DataFrame:
    """Give the errors at the end of the windows as a table."""
    return rows_frame(_row(each) for each in result.found.growth)
