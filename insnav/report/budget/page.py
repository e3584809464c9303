"""The report of an error budget."""

from __future__ import annotations

import textwrap
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.budget.error_budget import BAND, Budget, SimulatedColumn
from insnav.errors.budget.laws import SHORT
from insnav.errors.budget.study import BudgetStudy
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat
from insnav.report.budget.figures import draw_budget, horizontal, ranked, shares
from insnav.report.budget.quantities import (
    budget_sections,
    contributions_rows,
    contributions_section,
    impact_section,
    positions_section,
    states_section,
)
from insnav.report.budget.windows import (
    windows_assumptions,
    windows_figures,
    windows_sentences,
    windows_warnings,
)
from insnav.report.budget.windows_quantities import windows_sections
from insnav.report.frames import rows_frame
from insnav.report.numbers import number
from insnav.report.outage.quantities import corrected_text
from insnav.report.page import FigureSpec, Page, Section, section_tables
from insnav.report.style import drawing, save
from insnav.result import Result
from insnav.units import DEG

if TYPE_CHECKING:
    import pandas as pd

_NOTE_WIDTH = 150  # characters in a line of the page's notes
_LINEAR = 5.0 * DEG  # attitude errors up to here are small


def page(result: Result[BudgetStudy]) -> Page:
    """Lay out an error budget."""
    budget, windows = result.found.budget, result.found.windows
    figure = FigureSpec("budget", "The budget on one page; also in budget.pdf", partial(budget_figure, budget))
    sections = (
        *budget_sections(budget),
        positions_section(budget),
        contributions_section(budget),
        Section("", figures=(figure,), show="page"),
    )
    more = (states_section(budget), impact_section(budget))
    if windows is None:
        return Page(_title(budget), summary(budget), (*sections, *more), warnings(budget), assumptions(budget))
    return Page(
        _title(budget),
        (*summary(budget), *windows_sentences(windows)),
        (*sections, *windows_sections(windows), Section("", figures=windows_figures(windows), show="page"), *more),
        warnings=(*warnings(budget), *windows_warnings(windows)),
        assumptions=(*assumptions(budget), *windows_assumptions(windows)),
    )


def _title(budget: Budget) -> str:
    return f"Error budget of {budget.imu}: {budget.time[budget.chosen[-1]]:g} s of free-inertial navigation"


def budget_figure(budget: Budget) -> Figure:
    """Draw the budget on one page."""
    note = textwrap.fill(f"Motion: {budget.motion}. Errors are one standard deviation (1 sd) unless said.", 125)
    texts = [*(f"Warning: {text}" for text in warnings(budget)), *assumptions(budget)]
    notes = [line for text in texts for line in textwrap.wrap(text, _NOTE_WIDTH, subsequent_indent="   ")]
    columns, sources = (
        section_tables(section)[0] for section in (positions_section(budget), contributions_section(budget))
    )
    return draw_budget(budget, _title(budget), note, columns, sources, notes)


def write_files(result: Result[BudgetStudy], folder: RunFolder, table_format: TableFormat) -> None:
    """Write ``budget.pdf``.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}: not used: a budget has no tables of its own.
    """
    with drawing():
        save(budget_figure(result.found.budget), folder.path("budget"), "pdf")


def frame(result: Result[BudgetStudy]) -> pd.DataFrame:
    """Give the contributions to the horizontal error as a table."""
    return rows_frame(contributions_rows(result.found.budget))


def summary(budget: Budget) -> tuple[str, ...]:
    """Say the result in a few sentences."""
    last = budget.chosen[-1]
    total = budget.covariance.total[last]
    part, order = shares(budget), ranked(budget)
    largest = ", ".join(f"{budget.families[k]} {100.0 * part[k]:.0f} %" for k in order[:3] if part[k] >= 0.005)
    down = "held to the reference" if budget.hold else f"{number(total[2])} m"
    lines = [
        f"Motion: {budget.motion}.",
        f"After {budget.time[last]:g} s without aiding the position error (1 sd) is {number(total[0])} m north, "
        f"{number(total[1])} m east, {number(float(horizontal(total)))} m horizontally; down: {down}.",
        f"All sources at once with the worst signs, 1 sd each: {number(float(budget.worst[last, 3]))} m horizontally.",
        f"Largest contributions: {largest} of the horizontal variance."
        if largest
        else "No source acts on the level axes.",
    ]
    simulated = budget.simulated
    if simulated is not None:
        level = number(float(horizontal(simulated.total[last])))
        lines.append(
            f"Simulated, {simulated.runs} runs: {level} m horizontally; mean normalised squared error "
            f"{simulated.nees[last]:.3g} (1 if the covariance is true)."
        )
    recorded = budget.recorded
    if recorded is not None:
        level = corrected_text(*(float(each[-1, 3]) for each in (recorded.corrected, recorded.low, recorded.high)))
        lines.append(f"Recorded: {level} horizontally, {recorded.description}.")
    return tuple(lines)


def warnings(budget: Budget) -> tuple[str, ...]:
    """Say what the reader must not overlook."""
    found = []
    attitude = float(budget.covariance.total[budget.chosen[-1], 6:].max())
    if attitude > _LINEAR:
        found.append(
            f"Attitude error {attitude / DEG:.0f} deg at the end exceeds the linear model: analytic and covariance are "
            "rough; trust the simulated errors (--runs)."
        )
    elif budget.simulated is not None and not _true(budget, budget.simulated):
        found.append("Simulated errors do not match the covariance: trust the simulated ones.")
    if budget.absent:
        found.append(f"Not given in the IMU file, counted as zero: {', '.join(budget.absent)}.")
    if budget.ignored:
        found.append(f"In the IMU file, but not in this budget: {', '.join(budget.ignored)}.")
    return tuple(found)


def _true(budget: Budget, simulated: SimulatedColumn) -> bool:
    """Whether the squared errors at the chosen times have the size that the covariance says."""
    # nine states at each time, whose errors are independent once normalised: 4 sd of their mean
    limit = 4.0 * np.sqrt(2.0 / (simulated.runs * (6.0 if budget.hold else 9.0)))
    return bool(np.all(np.abs(simulated.nees[budget.chosen] - 1.0) < limit))


def assumptions(budget: Budget) -> tuple[str, ...]:
    """Say how to read the budget and what it takes for granted."""
    last = float(budget.time[budget.chosen[-1]])
    at = min(last, SHORT)
    bias, drift = budget.short_form_error(at)
    lines = [
        "analytic: closed forms, without the rotation and curvature of the Earth; covariance: every source alone "
        "through the linear error model along the motion; simulated: runs with all errors sampled.",
        "Sources are independent, so their squares add up (RSS). The worst-case sum adds one sd of every source with "
        "the worst sign: while no source exceeds one sd, no error is larger.",
        f"Validity of the short forms after {at:g} s: true error {100.0 * bias:+.3f} % from them for biases and tilt "
        f"(t²), {100.0 * drift:+.3f} % for gyro biases (t³), by the curvature of the Earth"
        + (f"; beyond {SHORT:g} s the closed Schuler forms are used." if last > SHORT else "."),
        "The vertical channel is held to the reference: no error down."
        if budget.hold
        else "The vertical channel is free and unstable: errors down grow with an e-folding time of 570 s. North and "
        "east hardly depend on it within minutes.",
        "Biases are turn-on biases, uncalibrated. After an alignment at rest the tilt compensates the accelerometer "
        "bias; that is not counted here."
        if budget.recorded is None
        else "Start and biases of analytic, covariance and simulated are those of the window with the median "
        "prediction, as the filter knows them there (uncalibrated: as in the IMU file). They are correlated: a bias "
        "brings the tilt that compensates it, and initial tilt is what is left when the biases are known. "
        "Accelerometer misalignment shows in gravity as a bias, and is counted there.",
    ]
    if budget.recorded is not None:
        lines.append(f"recorded: {budget.recorded.description}.")
    if not any(source.sd > 0.0 for source in budget.sources if source.group == "gravity"):
        lines.append("Gravity is that of the model (WGS-84 normal gravity); see --deflection.")
    if budget.simulated is not None:
        lines.append(
            f"Bars of simulated errors: {100 * BAND:.0f} % bounds of the sd by the number of runs. Each source alone "
            f"was simulated in {budget.simulated.alone} runs. Seed {budget.simulated.seed}."
        )
    return tuple(lines)
