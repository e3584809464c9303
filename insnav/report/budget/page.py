"""The report of an error budget."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

from insnav.errors.budget.drive_motion import BudgetStudy
from insnav.errors.budget.error_budget import BAND, Budget
from insnav.errors.budget.from_windows import RecordedBudget
from insnav.errors.budget.laws import SHORT
from insnav.errors.requirement.study import FIELD_FACTOR
from insnav.findings import Code, Finding
from insnav.imu.imu_file import to_toml
from insnav.messages import sentence
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat
from insnav.output.stored import FILE as FOUND
from insnav.output.stored import read_stored, store
from insnav.quantity import Quantity
from insnav.report.budget import headline, quantities
from insnav.report.budget import windows as recorded
from insnav.report.budget.contributions import extent, ranked, shares
from insnav.report.budget.panels import budget_panels
from insnav.report.budget.windows_quantities import windows_sections
from insnav.report.numbers import number
from insnav.report.outage.windows import INTERVALS
from insnav.report.page import DataFrame, Figure, FigureSpec, Page, Section, only_json, rows_frame, section_tables
from insnav.result import Result

__all__ = ["frame", "page", "read_found", "write_files"]


def page(result: Result[BudgetStudy]) -> Page:
    """Lay out an error budget."""
    budget, windows = result.found.budget, result.found.windows
    wrong = warnings(budget, windows)
    taken = (*assumptions(budget), *(recorded.windows_assumptions(windows) if windows is not None else ()))
    sections = (
        *quantities.budget_sections(budget),
        headline.estimates_section(budget),
        Section(
            "",
            panels=budget_panels(budget, windows, _origin(result)),
            figures=(
                FigureSpec("budget", "The budget, first page of budget.pdf", partial(_front, result)),
                FigureSpec("budget_tables", "The budget, second page of budget.pdf", partial(_back, result)),
            ),
            show="page",
        ),
        quantities.contributions_section(budget),
        quantities.positions_section(budget),
        *(_windows(windows) if windows is not None else ()),
        quantities.states_section(budget),
        quantities.impact_section(budget),
    )
    return Page(
        _title(budget),
        summary(budget),
        sections,
        (*wrong, *taken),
        (INTERVALS,) * (windows is not None),
        verdict=headline.verdict(budget, windows, wrong),
        merits=headline.merits(budget, windows),
    )


def _windows(windows: RecordedBudget) -> tuple[Section, ...]:
    """Everything about the recorded windows, folded; their sentences stand first."""
    lines = recorded.windows_sentences(windows)
    sentences = only_json("", Quantity("recorded_summary", lines))
    rows = tuple((Quantity("finding", line, meaning=" "),) for line in lines)
    said = Section("", "Recorded windows: findings", rows=rows)
    tables = tuple(replace(each, title="Recorded windows: tables", folded=True) for each in windows_sections(windows))
    figures = Section(
        "", "Recorded windows: figures", parts=recorded.windows_drawings(windows), show="page", folded=True
    )
    return (sentences, said, *tables, figures)


def _title(budget: Budget) -> str:
    return f"Error budget of {budget.imu}: {budget.time[budget.chosen[-1]]:g} s without GPS"


def _origin(result: Result[BudgetStudy]) -> str:
    """Where the sizes of the sources come from."""
    name = result.found.budget.imu if result.imu_model is None else result.imu_model[0].name
    given = result.imu_model is None or result.imu_model[1] == Finding.of(Code.IMU_MODEL_GIVEN)
    how = "" if result.imu_model is None or given else f": {sentence(result.imu_model[1])}"
    return f"IMU model {name}{how}"


def _front(result: Result[BudgetStudy]) -> Figure:
    """Draw the first page of the PDF."""
    from insnav.report.budget.figures import draw_front  # matplotlib is imported only where a figure is asked for

    budget, windows = result.found.budget, result.found.windows
    (estimates,) = section_tables(headline.estimates_section(budget))
    panels = budget_panels(budget, windows, _origin(result))
    verdict = headline.verdict(budget, windows, warnings(budget, windows))
    return draw_front(panels, budget.motion, _title(budget), verdict, estimates)


def _back(result: Result[BudgetStudy]) -> Figure:
    """Draw the second page of the PDF."""
    from insnav.report.budget.figures import draw_back

    budget, windows = result.found.budget, result.found.windows
    (sources,), (columns,) = (
        section_tables(each(budget)) for each in (quantities.contributions_section, quantities.positions_section)
    )
    widths = ((3.2, 2.6, *(1.4,) * (len(sources.columns) - 4), 1.9, 1.8), (1.0,) + (1.15,) * (len(columns.columns) - 1))
    wrong = (f"Warning: {sentence(each)}" for each in warnings(budget, windows))
    texts = [*wrong, *map(sentence, assumptions(budget))]
    if windows is not None:
        texts = [*recorded.windows_sentences(windows), *texts]
    return draw_back(f"{_title(budget)}, 2", (sources, columns), widths, texts)


def write_files(result: Result[BudgetStudy], folder: RunFolder, table_format: TableFormat) -> None:
    """Write ``budget.pdf``, two pages, the IMU model, and everything that was found, to be read again.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}: not used: a budget has no tables of its own.
    """
    from insnav.report.style import drawing, save_pages

    store(result.found, folder.path(FOUND))
    if result.imu_model is not None:
        folder.path("imu.toml").write_text(to_toml(result.imu_model[0]), encoding="utf-8", newline="\n")
    with drawing():
        save_pages((_front(result), _back(result)), folder.path("budget.pdf"))


def read_found(folder: Path) -> BudgetStudy:
    """Read a budget from its folder; notes on its windows were texts in version 0.2."""
    found: BudgetStudy = read_stored(folder)
    if found.windows is None:
        return found
    notes = tuple(Finding.from_dict(each) if isinstance(each, str) else each for each in found.windows.notes)
    return replace(found, windows=replace(found.windows, notes=notes))


def frame(result: Result[BudgetStudy]) -> DataFrame:
    """Give the contributions to the horizontal error as a table, in numbers."""
    budget, rows = result.found.budget, []
    for row in quantities.contributions_rows(budget):
        least, most, unit = extent(budget, str(row[0].value))
        sizes = Quantity("size_least", least), Quantity("size_largest", most), Quantity("size_unit", unit)
        others = [each for each in row if each.key != "size"]
        metres = (each if each.unit or isinstance(each.value, str) else replace(each, unit="m") for each in others)
        rows.append((*metres, *sizes))
    return rows_frame(rows)


def summary(budget: Budget) -> tuple[str, ...]:
    """Say what the sentence of the verdict leaves out."""
    last = budget.chosen[-1]
    total = budget.headline[last]
    part, order = shares(budget), ranked(budget)
    largest = ", ".join(f"{budget.families[k]} {100.0 * part[k]:.0f} %" for k in order[:3] if part[k] >= 0.005)
    down = "held to the reference" if budget.hold else f"{number(total[2])} m"
    return (
        f"Motion: {budget.motion}. North {number(total[0])} m, east {number(total[1])} m, down: {down}. "
        + (f"Largest: {largest} of the horizontal variance." if largest else "No source acts on the level axes."),
    )


def warnings(budget: Budget, windows: RecordedBudget | None = None) -> tuple[Finding, ...]:
    """Give what the reader must not overlook."""
    found = []
    if not budget.linear:
        attitude = float(budget.covariance.total[budget.chosen[-1], 6:].max())
        found.append(Finding.of(Code.BUDGET_NONLINEAR, attitude_rad=attitude))
    elif budget.simulated is not None and not headline.simulated_matches(budget, budget.simulated):
        nees = max(budget.simulated.nees[budget.chosen], key=lambda each: abs(float(each) - 1.0))
        found.append(Finding.of(Code.BUDGET_SIMULATED_MISMATCH, nees=nees, runs=budget.simulated.runs))
    if budget.absent:
        found.append(Finding.of(Code.BUDGET_ABSENT, terms=budget.absent))
    if budget.ignored:
        found.append(Finding.of(Code.BUDGET_IGNORED, terms=budget.ignored))
    return (*found, *(() if windows is None else recorded.windows_warnings(windows)))


def assumptions(budget: Budget) -> tuple[Finding, ...]:
    """Give what explains the budget, and what it takes for granted."""
    last = float(budget.time[budget.chosen[-1]])
    at = min(last, SHORT)
    bias, drift = budget.short_form_error(at)
    limit = SHORT if last > SHORT else math.nan
    found = [
        Finding.of(Code.BUDGET_METHODS),
        Finding.of(Code.BUDGET_INDEPENDENT_SOURCES),
        Finding.of(Code.BUDGET_SHORT_FORMS, time_s=at, limit_s=limit, bias_share=bias, drift_share=drift),
        Finding.of(Code.BUDGET_VERTICAL_HELD if budget.hold else Code.BUDGET_VERTICAL_FREE),
    ]
    if budget.recorded is None:
        found += [Finding.of(Code.BUDGET_TURN_ON_BIASES), FIELD_FACTOR]
    else:
        found.append(Finding.of(Code.BUDGET_WINDOW_BIASES))
    if math.isfinite(budget.flicker_lowest):
        found.append(Finding.of(Code.BUDGET_FLICKER, frequency_hz=budget.flicker_lowest))
    if not any(source.sd > 0.0 for source in budget.sources if source.group == "gravity"):
        found.append(Finding.of(Code.BUDGET_NORMAL_GRAVITY))
    if budget.simulated is not None:
        runs, alone, seed = budget.simulated.runs, budget.simulated.alone, budget.simulated.seed
        found.append(Finding.of(Code.BUDGET_SIMULATED_BOUNDS, probability=BAND, runs=runs, alone=alone, seed=seed))
    return tuple(found)
