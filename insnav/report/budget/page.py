"""Facts and page of an error budget."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.errors.budget.error_budget import BAND, Budget, Column, SimulatedColumn
from insnav.errors.budget.from_windows import RecordedBudget
from insnav.errors.budget.laws import SHORT
from insnav.output.folder import RunFolder
from insnav.report.budget.figures import draw_budget, horizontal, ranked, shares
from insnav.report.budget.terms import effect, growth, size
from insnav.report.budget.windows import (
    recorded_assumptions,
    recorded_pictures,
    recorded_sentences,
    recorded_tables,
    recorded_warnings,
)
from insnav.report.budget.windows_quantities import recorded_facts
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready, versions
from insnav.report.sheet import Picture, Sheet, write_sheet
from insnav.report.style import drawing, save
from insnav.types import FloatArray
from insnav.units import DEG

_NOTE_WIDTH = 150  # characters in a line of the page's notes
_SHORT = {"analytic": "anal.", "covar.": "cov.", "simul.": "sim.", "record.": "rec.", "filter": "filt."}
_LINEAR = 5.0 * DEG  # attitude errors up to here are small


def write_budget(
    folder: RunFolder, budget: Budget, configuration: Mapping[str, Any], windows: RecordedBudget | None = None
) -> tuple[Path, Sheet]:
    """Write page, figure (PNG and PDF) and facts into a folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    budget : Budget
    configuration : mapping
        Options in force.
    windows : RecordedBudget, optional
        Of the recorded drive.

    Returns
    -------
    Path
        The finished folder.
    Sheet
        What was written, for the terminal.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    sheet, facts = budget_sheet(budget), budget_facts(budget, configuration)
    if windows is not None:
        sheet, facts["recorded_windows"] = beside_windows(sheet, windows), recorded_facts(windows)
    with drawing():
        save(sheet.pictures[0].figure, folder.path("budget"), "pdf")
    return write_sheet(folder, sheet, facts), sheet


def beside_windows(sheet: Sheet, windows: RecordedBudget) -> Sheet:
    """Add all about the windows of a recorded drive to the page.

    Parameters
    ----------
    sheet : Sheet
        From `budget_sheet`.
    windows : RecordedBudget
    """
    with drawing():
        pictures = recorded_pictures(windows)
    return replace(
        sheet,
        summary=(*sheet.summary, *recorded_sentences(windows)),
        tables=(*sheet.tables[:2], *recorded_tables(windows), *sheet.tables[2:]),
        pictures=(*sheet.pictures, *pictures),
        assumptions=(*sheet.assumptions, *recorded_assumptions(windows)),
        warnings=(*sheet.warnings, *recorded_warnings(windows)),
    )


def budget_sheet(budget: Budget) -> Sheet:
    """Put everything on one page.

    Parameters
    ----------
    budget : Budget
    """
    columns, sources = columns_table(budget), sources_table(budget)
    title = f"Error budget of {budget.imu}: {budget.time[budget.chosen[-1]]:g} s of free-inertial navigation"
    note = textwrap.fill(f"Motion: {budget.motion}. Errors are one standard deviation (1 sd) unless said.", 125)
    said = [*(f"Mind: {text}" for text in warnings(budget)), *assumptions(budget)]
    notes = [line for text in said for line in textwrap.wrap(text, _NOTE_WIDTH, subsequent_indent="   ")]
    with drawing():
        figure = draw_budget(budget, title, note, columns, sources, notes)
    return Sheet(
        title,
        summary(budget),
        (columns, sources, _state_table(budget), _effects_table(budget)),
        (Picture("budget", figure, "The budget on one page; also in budget.pdf"),),
        assumptions(budget),
        warnings(budget),
    )


def summary(budget: Budget) -> tuple[str, ...]:
    """Say the result in a few sentences.

    Parameters
    ----------
    budget : Budget
    """
    last = budget.chosen[-1]
    total, worst = budget.covariance.total[last], budget.covariance.worst[last]
    part, order = shares(budget), ranked(budget)
    largest = ", ".join(f"{budget.families[k]} {100.0 * part[k]:.0f} %" for k in order[:3] if part[k] >= 0.005)
    down = "held to the reference" if budget.hold else f"{number(total[2])} m"
    lines = [
        f"Motion: {budget.motion}.",
        f"After {budget.time[last]:g} s without aid the position is off by {number(total[0])} m north, "
        f"{number(total[1])} m east (1 sd), {number(float(horizontal(total)))} m horizontally; down: {down}.",
        f"If all sources came together with the worst sign: {number(float(horizontal(worst)))} m horizontally.",
        f"It comes from: {largest} of the horizontal variance." if largest else "No source acts on the level axes.",
    ]
    simulated = budget.simulated
    if simulated is not None:
        level = number(float(horizontal(simulated.total[last])))
        lines.append(
            f"Simulated, {simulated.runs} runs: {level} m horizontally; mean normalised squared error "
            f"{simulated.nees[last]:.3g}, which is 1 if the covariance is true."
        )
    recorded = budget.recorded
    if recorded is not None:
        level = number(float(np.hypot(*recorded.rms[-1, :2])))
        lines.append(f"Recorded: {level} m horizontally, RMS of {recorded.description}.")
    return tuple(lines)


def warnings(budget: Budget) -> tuple[str, ...]:
    """Say what the reader must not overlook.

    Parameters
    ----------
    budget : Budget
    """
    found = []
    if budget.absent:
        found.append(f"Not given in the IMU file, and so counted as zero: {', '.join(budget.absent)}.")
    if budget.ignored:
        found.append(f"In the IMU file, but not in this budget: {', '.join(budget.ignored)}.")
    attitude = float(budget.covariance.total[budget.chosen[-1], 6:].max())
    if attitude > _LINEAR:
        found.append(
            f"The attitude is off by {attitude / DEG:.0f} deg in the end: too much for the linear model, so that the "
            "larger figures of analytic and covariance are rough; trust those that --runs simulates."
        )
    elif budget.simulated is not None and not _true(budget, budget.simulated):
        found.append("The simulated errors are not as large as the covariance says: trust the simulated ones.")
    return tuple(found)


def _true(budget: Budget, simulated: SimulatedColumn) -> bool:
    """Whether the squared errors at the chosen times have the size that the covariance says."""
    # nine states at each time, whose errors are independent once normalised: 4 sd of their mean
    limit = 4.0 * np.sqrt(2.0 / (simulated.runs * (6.0 if budget.hold else 9.0)))
    return bool(np.all(np.abs(simulated.nees[budget.chosen] - 1.0) < limit))


def assumptions(budget: Budget) -> tuple[str, ...]:
    """Say in plain words how to read the budget and what it takes for granted.

    Parameters
    ----------
    budget : Budget
    """
    last = float(budget.time[budget.chosen[-1]])
    at = min(last, SHORT)
    bias, drift = budget.short_form_error(at)
    lines = [
        "analytic: closed forms on paper, without the turning and the curvature of the Earth; covariance: every source "
        "alone through the whole linear error model along the motion; simulated: runs with all errors drawn at random.",
        "All sources are independent, so their squares add up (RSS). The worst-case sum adds one sd of each family of "
        "sources with the worst sign: improbable, but nothing within one sd is larger.",
        f"Validity of the short forms: after {at:g} s the true error is {100.0 * bias:+.3f} % off them for biases and "
        f"tilt (t²), {100.0 * drift:+.3f} % for gyro biases (t³), as the curvature of the Earth holds it back"
        + (f"; beyond {SHORT:g} s the closed Schuler forms are used." if last > SHORT else "."),
        "The vertical channel is held to the reference: no error down."
        if budget.hold
        else "The vertical channel is free: its own instability makes errors down grow by e every 570 s. North and "
        "east hardly notice that within minutes.",
        "The biases are those of turn-on: nothing was calibrated by an alignment or a filter. After an alignment at "
        "rest the tilt hides the accelerometer bias, and a good part of both cancels; that is not counted here."
        if budget.recorded is None
        else "Start and biases of analytic, covariance and simulated are those of the window with the median "
        "prediction, as the filter knows them there (sensors as turned on: as the IMU file says). They go together: a "
        "bias brings the tilt that hides it, and initial tilt is only what is left when the biases are known. "
        "Misalignment of accelerometers shows in gravity as a bias, and is counted there.",
    ]
    if budget.recorded is not None:
        lines.append(f"recorded: {budget.recorded.description}.")
    if not any(source.sd > 0.0 for source in budget.sources if source.group == "gravity"):
        lines.append("Gravity is taken as that of the model (WGS-84 normal gravity); see --deflection.")
    if budget.simulated is not None:
        lines.append(
            f"Bars of simulated errors: {100 * BAND:.0f} % bounds of the sd by the number of runs. Each source alone "
            f"was simulated in {budget.simulated.alone} runs. Seed {budget.simulated.seed}."
        )
    return tuple(lines)


def columns_table(budget: Budget) -> Table:
    """Tabulate position errors at the chosen times, one group of columns a way to them.

    Parameters
    ----------
    budget : Budget
    """
    at = budget.chosen
    groups = [("analytic", budget.analytic.total[at, :3]), ("covar.", budget.covariance.total[at, :3])]
    if budget.simulated is not None:
        groups.append(("simul.", budget.simulated.total[at, :3]))
    recorded = budget.recorded
    if recorded is not None:
        errors = recorded.rms
        groups.append(("record.", _at(recorded.time, errors, budget.time[at])))
        groups.append(("filter", _at(recorded.time, recorded.predicted, budget.time[at])))
        groups = [(_SHORT[name], values) for name, values in groups]
    else:
        groups.append(("worst", budget.covariance.worst[at, :3]))
    headings = ["time [s]"] + [f"{name} {axis}" for name, _ in groups for axis in "NED"]
    rows = [
        (f"{budget.time[k]:g}", *(number(_known(value)) for _, values in groups for value in values[row]))
        for row, k in enumerate(at)
    ]
    last = (
        "1 sd [m]; worst: sum of all families"
        if recorded is None
        else "1 sd [m]: analytic, covariance, simulated; RMS recorded; predicted by the filter"
    )
    return Table(f"Position error North, East, Down, {last}", tuple(headings), tuple(rows))


def _at(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    """Rows of values at wanted times, NaN where there is none."""
    found = np.full((len(wanted), values.shape[1]), np.nan)
    for row, moment in enumerate(wanted):
        match = np.flatnonzero(np.abs(time - moment) < 1e-3)
        if match.size:
            found[row] = values[match[0]]
    return found


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def sources_table(budget: Budget) -> Table:
    """Tabulate what each family makes of the position in the end, the largest first, and their sums.

    Parameters
    ----------
    budget : Budget
    """
    last, part = budget.chosen[-1], shares(budget)
    ways: list[Column | SimulatedColumn] = [budget.analytic, budget.covariance]
    names = ["analytic", "covariance"]
    if budget.simulated is not None:
        ways.append(budget.simulated)
        names.append("simulated")
    rows = []
    for k in ranked(budget):
        family = budget.families[k]
        level = (number(float(horizontal(way.parts[last, k]))) for way in ways)
        down = number(float(budget.covariance.parts[last, k, 2]))
        rows.append((family, size(budget, family), growth(budget, family), *level, down, f"{100.0 * part[k]:.1f} %"))
    sums = (
        ("together (RSS)", [way.total[last] for way in ways]),
        ("worst-case sum", [way.worst[last] for way in ways if isinstance(way, Column)]),
    )
    for name, values in sums:
        cells = [number(float(horizontal(value))) for value in values] + [""] * (len(ways) - len(values))
        rows.append((name, "", "", *cells, number(float(values[1][2])), ""))
    title = f"What comes from where: horizontal error √(N² + E²) after {budget.time[last]:g} s [m]"
    return Table(title, ("source", "size, 1 sd", "grows with", *names, "down", "share of the variance"), tuple(rows))


def _state_table(budget: Budget) -> Table:
    """Velocity and attitude by family."""
    last = budget.chosen[-1]
    rows = []
    for k in [*ranked(budget), -1]:
        sd = budget.covariance.total[last] if k < 0 else budget.covariance.parts[last, k]
        name = "together (RSS)" if k < 0 else budget.families[k]
        rows.append((name, *(number(float(v)) for v in sd[3:6]), *(number(float(v) / DEG) for v in sd[6:9])))
    headings = ("source", "v north [m/s]", "v east", "v down", "tilt north [deg]", "tilt east", "heading")
    return Table(f"Velocity and attitude after {budget.time[last]:g} s, covariance, 1 sd", headings, tuple(rows))


def _effects_table(budget: Budget) -> Table:
    rows = tuple((budget.families[k], effect(budget.families[k])) for k in ranked(budget))
    return Table("What the sources do", ("source", "in words"), rows)


def budget_facts(budget: Budget, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Gather the figures, JSON-ready, units in the keys.

    Parameters
    ----------
    budget : Budget
    configuration : mapping
        Options in force.
    """
    last = float(budget.time[budget.chosen[-1]])
    bias, drift = budget.short_form_error(last)
    ways: dict[str, Column | SimulatedColumn] = {"analytic": budget.analytic, "covariance": budget.covariance}
    if budget.simulated is not None:
        ways["simulated"] = budget.simulated
    times = []
    for k in budget.chosen:
        entry: dict[str, Any] = {"time_s": budget.time[k]}
        for name, way in ways.items():
            entry[name] = _states(way.total[k])
            if isinstance(way, Column):
                entry[name]["worst_position_m"] = way.worst[k, :3]
            entry[name]["sources"] = {
                family: _states(way.parts[k, number]) for number, family in enumerate(budget.families)
            }
        if budget.simulated is not None:
            entry["simulated"]["nees"] = budget.simulated.nees[k]
        times.append(entry)
    simulated = budget.simulated
    recorded = budget.recorded
    facts = {
        "versions": versions(),
        "configuration": configuration,
        "imu": budget.imu,
        "motion": budget.motion,
        "vertical_held": budget.hold,
        "gravity_m_s2": budget.gravity,
        "schuler_period_s": 2.0 * np.pi / budget.schuler_rate,
        "short_form_error": {"time_s": last, "bias_and_tilt": bias, "gyro_bias": drift},
        "sources": [
            {"name": each.name, "kind": each.kind, "sd_si": each.sd, "correlation_time_s": each.correlation_time}
            for each in budget.sources
        ],
        "share_of_horizontal_variance": dict(zip(budget.families, shares(budget), strict=True)),
        "not_given": budget.absent,
        "left_out": budget.ignored,
        "budget": times,
        "runs": None
        if simulated is None
        else {
            "count": simulated.runs,
            "of_each_source": simulated.alone,
            "seed": simulated.seed,
            "rms_by_sd_95": simulated.band,
        },
        "recorded": None
        if recorded is None
        else {
            "windows": recorded.windows,
            "words": recorded.description,
            "time_s": recorded.time,
            "rms_north_m": recorded.rms[:, 0],
            "rms_east_m": recorded.rms[:, 1],
            "rms_down_m": recorded.rms[:, 2],
            "predicted_m": recorded.predicted,
        },
    }
    ready: dict[str, Any] = json_ready(facts)
    return ready


def _states(sd: FloatArray) -> dict[str, Any]:
    return {
        "position_m": sd[:3],
        "horizontal_m": float(horizontal(sd)),
        "velocity_m_s": sd[3:6],
        "attitude_deg": sd[6:9] / DEG,
    }
