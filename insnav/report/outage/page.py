"""Report of a GNSS outage test; its quantities and curves of windows without GPS also serve budget reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from insnav.errors.outage.free_inertial import Outage
from insnav.errors.outage.gnss_outage import Growth, OutageEpochs, OutageStudy, outage_growth
from insnav.findings import Code, Finding, Severity, is_shown
from insnav.messages import phrase
from insnav.output.folder import RunFolder, read_facts
from insnav.output.solution_tables import TableFormat, read_run_table, write_events, write_run_table
from insnav.quantity import Quantity
from insnav.report import page as layout
from insnav.report.page import DataFrame, Light, Page, Section, Verdict
from insnav.report.panels import Clock, Curve, Panel
from insnav.report.style import BLACK, BLUE, GREY, VERMILLION, number
from insnav.report.tables import of_table
from insnav.result import Result
from insnav.sample_statistics import rms
from insnav.types import FloatArray
from insnav.units import UNITS

# Share of the errors inside 3 sd: from the first limit the stated sd holds; below the second it is far too small.
_INSIDE, _FEW_INSIDE = 0.95, 0.8
_LARGER = 1.25  # the verdict mentions a larger ratio of RMS to predicted error, also if enough errors are inside 3 sd
_MODES = ("", "smoothed ")
_SAME = 0.98  # the RMS error without reference variance is mentioned up to this share of the measured RMS error
STATISTICS = {  # key in JSON, and attribute of `Growth`
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
_POINTS = 24  # number of times in the panels
NOTE = "all lines include errors of the reference"
BELOW = "below reference noise"


def page(result: Result[OutageStudy]) -> Page:
    """Lay out a GNSS outage test: verdict, error growth without GPS, and a table per error component."""
    study = result.found
    name = str(Path(*Path(result.inputs["imu"].path).parts[-2:])) if "imu" in result.inputs else "a drive"
    rows = tuple(_row(each) for each in study.growth)
    tables = [(key, each) for key in _COMPONENTS if (each := _table(key, study.growth)).rows]
    inside = sorted({round(100.0 * each.inside_at_end) for each in study.growth})
    bounds = " to ".join(map(str, inside[:: max(len(inside) - 1, 1)]))
    lengths = ", ".join(f"{each.length:g}" for each in study.growth)
    aids = [each.code.split(".")[0].upper() for each in result.findings if each.code in (Code.NHC_USED, Code.ZUPT_USED)]
    shown = tuple(each for each in result.findings if is_shown(each) and each.severity >= Severity.WARNING)
    clock = Clock.of(
        np.array([each.start for each in study.windows]) if study.run is None else study.run.run.solution.time
    )
    title = f"Error without GPS against {study.reference}"
    longest_length, panels = max(each.length for each in study.windows), (("horizontal", (0, 1)), ("vertical", (2,)))
    longest = [each for each in study.windows if each.length == longest_length]
    growing = layout.drawn("outages", title, (_panel(longest, study.growth, *part) for part in panels), NOTE)
    return Page(
        f"GNSS outage test: {name}, {len(study.windows)} windows",
        (
            *((f"Inside 3 sd (north, east, down): {bounds} % after {lengths} s.",) if bounds != "100" else ()),
            *((f"Without GPS, {' and '.join(aids)} continue{'s' * (len(aids) == 1)} to aid.",) if aids else ()),
        ),
        (
            layout.only_json("", Quantity("reference", study.reference)),
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
        method=(*phrase("method.outage").splitlines(), phrase("method.intervals")),
    )


def _verdict(study: OutageStudy, notes: tuple[Finding, ...]) -> Verdict:
    """Rate an outage test: errors in the longest outages, and whether the stated sd holds for all lengths."""
    growth = study.growth[-1]
    column, smoothed = growth.column("horizontal"), growth.column("smoothed horizontal")
    solutions = [(each, lead) for each in study.growth for lead in _MODES]
    lowest, length, mode = min((_inside(each, lead), each.length, lead) for each, lead in solutions)
    ratio, longer, larger = max((ratio, each.length, name) for each in study.growth for ratio, name in _ratios(each))
    share, errors = ("all", "errors") if lowest == 1.0 else (f"{100.0 * lowest:.0f} % or more", "of the errors")
    light, holds = ("good", "holds") if lowest >= _INSIDE else ("attention", "is too small")
    if lowest < _FEW_INSIDE:
        light, holds = "bad", "is far too small"
    reason = f"{100.0 * lowest:.0f} % of the {mode}errors after {length:g} s are inside 3 sd: the stated sd {holds}"
    if light == "good":
        reason = f"{share} {errors} are inside 3 sd after every length: the stated sd {holds}"
    if light == "good" and ratio > _LARGER:
        light = "attention"
        reason = f"after {longer:g} s the {larger} errors are {ratio:.2f} times as large as predicted; "
        reason += f"{share} are inside 3 sd"
    text = (
        f"After {growth.length:g} s without GPS, the horizontal error is {number(float(growth.rms[-1, column]))} m RMS."
        f"{_less_reference(growth, column)} The filter predicts {number(float(growth.predicted[-1, column]))} m."
    )
    if np.isfinite(growth.rms[-1, smoothed]):
        text += f" Smoothing leaves {number(float(growth.rms[-1, smoothed]))} m.{_less_reference(growth, smoothed)}"
    return layout.by_warnings(text, notes, (cast(Light, light), reason))


def _less_reference(found: Growth, column: int) -> str:
    """Write the RMS error at the end without the variance of the reference; empty if that hardly changes it."""
    corrected_rms, high = (float(each[-1, column]) for each in (found.corrected, found.high))
    if corrected_rms > _SAME * found.rms[-1, column]:
        return ""
    return f" Without the error of the reference, it is {corrected_text(corrected_rms, np.nan, high)}."


def _inside(found: Growth, mode: str) -> float:
    """Return the share of North, East, Down errors at the end inside 3 sd; 1 if unknown. `mode`: of ``_MODES``."""
    shares = [float(found.inside[-1, found.column(f"{mode}{name}")]) for name in ("horizontal", "vertical")]
    share = (2.0 * shares[0] + shares[1]) / 3.0
    return share if np.isfinite(share) else 1.0


def _ratios(found: Growth) -> list[tuple[float, str]]:
    """Return ratio and name of each error at the end: RMS over predicted error, both with reference errors."""
    names = [f"{mode}{name}" for mode in _MODES for name in ("horizontal", "vertical")]
    rms, predicted = found.rms[-1], np.hypot(found.predicted[-1], found.reference[-1])
    ratio = np.divide(rms, predicted, out=np.zeros_like(rms), where=np.isfinite(rms) & (predicted > 0.0))
    return [(float(ratio[found.column(name)]), name) for name in names]


def _merits(found: Growth) -> tuple[Quantity, ...]:
    """Build the figures of merit from the errors at the end of the longest windows, with reference errors."""
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
    """Build the table row with the errors at the end of all windows of one length."""
    return (
        *of_table("outage.window", found, common_to_all_windows=float(found.common[-1, found.column("horizontal")])),
        *(Quantity(name.replace(" ", "_"), _statistics(found, name), unit) for name, unit in _COMPONENTS.items()),
    )


def _statistics(found: Growth, name: str) -> dict[str, float]:
    """Return all statistics of an error component at the end of the windows, by key."""
    column = found.column(name)
    return {key: float(getattr(found, attribute)[-1, column]) for key, attribute in STATISTICS.items()}


def _table(component: str, growth: Sequence[Growth]) -> Section:
    """Build the table of an error component with a row per window length; without rows if the error is unknown."""
    unit, at_end = _COMPONENTS[component], [_statistics(found, component) for found in growth]
    rows = tuple(
        (
            Quantity("length", f"{found.length:g} s", meaning="after"),
            Quantity("windows", found.count),
            *(Quantity(key, each[key], unit, meaning=layout.STATISTICS[key]) for key in ("rms", "p95", "max")),
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
    """Write a table with all epochs of all windows, and the events. `folder`: open, inside its ``with`` block."""
    write_run_table(folder.directory, OutageEpochs.of(result.found.windows), table_format, "windows")
    write_events(folder.directory, result.findings)


def read_found(folder: Path, findings: Sequence[Finding]) -> OutageStudy:
    """Read an outage test and recompute its statistics. Raises: InputError: its table is missing or damaged."""
    windows = read_run_table(folder, OutageEpochs, "windows").windows()
    return OutageStudy(windows, tuple(outage_growth(windows)), str(read_facts(folder).get("reference", "a reference")))


def frame(result: Result[OutageStudy]) -> DataFrame:
    """Build a table of the errors at the end of the windows, with a row per window length."""
    return layout.rows_frame(_row(each) for each in result.found.growth)


def spread(time: FloatArray, errors: FloatArray) -> list[Curve]:
    """Draw the distribution of errors ``(windows, n)`` over time: median, and bands with the middle 50 and 90 %."""
    low, first, middle, third, high = np.nanquantile(errors, (0.05, 0.25, 0.5, 0.75, 0.95), axis=0)
    wide, narrow = (f"middle {share} % of {len(errors)} windows" for share in (90, 50))
    bands = Curve(wide, time, high, GREY, "band", low), Curve(narrow, time, third, GREY, "band", first)
    return [*bands, Curve("median", time, middle, GREY)]


def power_lines(time: FloatArray, end: float, colour: str, least: float = 0.0) -> list[Curve]:
    """Draw guide lines that grow with t, t² and t³ to the error `end`, where they exceed 1.2 times `least`."""
    lines = []
    for label, power in (("t", 1.0), ("t²", 2.0), ("t³", 3.0)):
        line = end * (time / time[-1]) ** power
        visible = line >= 1.2 * least
        if visible.sum() > 1:
            lines.append(Curve("", time[visible], line[visible], colour, "thin", text=(label,) * int(visible.sum())))
    return lines


def _panel(chosen: Sequence[Outage], sums: Sequence[Growth], name: str, columns: tuple[int, ...]) -> Panel:
    time, size, predicted = over_time(chosen, columns)
    rms = np.sqrt(np.mean(size**2, axis=0))
    curves = [
        *spread(time, size),
        Curve("RMS", time, rms, BLUE),
        Curve("predicted sd, solution and reference", time, predicted, BLACK, "dashed"),
    ]
    smoothed = [(each.length, float(each.rms[-1, each.column(f"smoothed {name}")])) for each in sums]
    points = np.array([pair for pair in smoothed if np.isfinite(pair[1])])
    if len(points):
        texts = tuple(f"smoothed, {length:g} s: {number(value)} m RMS" for length, value in points)
        curves.append(Curve("smoothed, RMS", points[:, 0], points[:, 1], VERMILLION, "crosses", text=texts))
    labels = f"{name.capitalize()} error without GPS", f"{name} error [m]", "time without GPS [s]"
    return Panel(f"outage_{name}", *labels, tuple(curves), "outage", NOTE, log="xy", height=280)


def over_time(windows: Sequence[Outage], columns: tuple[int, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute n log-spaced times (n,) [s], error norms there (windows, n), and their predicted RMS sd (n,).

    The predicted sd includes the sd of the reference.
    """
    first = max(float(window.elapsed[0]) for window in windows)
    time = np.geomspace(max(first, 0.2), windows[0].length, _POINTS)
    size, sd = np.empty((len(windows), _POINTS)), np.empty((len(windows), _POINTS))
    for row, window in enumerate(windows):
        size[row] = np.interp(time, window.elapsed, np.linalg.norm(window.error[:, columns], axis=1))
        sd[row] = np.interp(
            time, window.elapsed, np.linalg.norm(np.hypot(window.sd, window.reference_sd)[:, columns], axis=1)
        )
    return time, size, np.sqrt(np.mean(sd**2, axis=0))


def corrected(found: Growth, i: int, unit: str = "m") -> Quantity:
    """Build the RMS error at the end without reference variance, with interval; in words if below reference noise."""
    low, high, meaning = float(found.low[-1, i]), float(found.high[-1, i]), "corrected (95 %)"
    if found.below_noise[-1, i]:
        text = below_noise(high / UNITS[unit][1]).replace(" reference", "")  # short, as the table has 80 characters
        return Quantity("rms_corrected", text, unit, meaning=meaning)
    return Quantity("rms_corrected", float(found.corrected[-1, i]), unit, interval=(low, high), meaning=meaning)


def below_noise(high: float, unit: str = "") -> str:
    """Write that an error is below the noise of the reference, with the upper limit `high` of the error."""
    return f"{BELOW} (< {number(high)}{unit})" if np.isfinite(high) and high > 0.0 else BELOW


def corrected_text(value: float, low: float, high: float) -> str:
    """Write an RMS error without reference variance and its interval [m]; in words if below the reference noise."""
    if not np.isfinite(value):
        return below_noise(high, " m")
    return f"{number(value)} m RMS" + (f" ({number(low)} … {number(high)} m)" if np.isfinite(low) else "")
