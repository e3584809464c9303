"""Reports of an error budget, from error sources to position error, and of its inverse, from final error to causes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from insnav.errors.budget.error_budget import BAND, Budget, SimulatedColumn
from insnav.errors.budget.from_windows import BudgetStudy, RecordedBudget, RecordedPart, Verdict
from insnav.errors.budget.predicted import SHORT
from insnav.errors.diagnosis.causes import CAUSES, EndAxis
from insnav.errors.outage.gnss_outage import COMPONENTS, components
from insnav.errors.requirement.study import FIELD_FACTOR
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec
from insnav.imu.imu_file import to_toml
from insnav.messages import phrase, sentence
from insnav.output.data_files import FILE as FOUND
from insnav.output.data_files import read_stored, store
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat
from insnav.quantity import Quantity
from insnav.report.budget import quantities
from insnav.report.budget import windows as recorded
from insnav.report.budget.quantities import extent, horizontal, ranked, recorded_text, saved, shares, size, source_texts
from insnav.report.budget.windows import CAUSE_UNITS, GROWS, parts_of
from insnav.report.outage.page import below_noise, power_lines, spread
from insnav.report.page import DataFrame, Light, Page, Section, beside, by_warnings, drawn, only_json, rows_frame
from insnav.report.panels import Curve, Panel, bars, row_panel
from insnav.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, number
from insnav.report.tables import of_table
from insnav.report.terminal import page_text
from insnav.result import Result
from insnav.units import DEG, DEG_PER_H, G0, UNITS

_SHOWN = 10  # largest number of error families with a separate bar
_LEAST = 1e-3  # smallest share of the variance for a separate bar [-]
_GROUPS = {
    "initial": ("start", ORANGE),
    "gyro": ("gyros", BLUE),
    "accel": ("accelerometers", VERMILLION),
    "gravity": ("gravity", GREEN),
    "timing": ("timing", PURPLE),
}
_MOTIONS = {"static": GREEN, "straight": BLUE, "turning": VERMILLION}
_LINES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)
_TIME = "time without GPS [s]"
PDF_PAGES = {"result": ("growth", "sources")}
__all__ = ["PDF_PAGES", "end_page", "frame", "page", "read_found", "write_files"]


def budget_panels(budget: Budget, windows: RecordedBudget | None, origin: str) -> tuple[Panel, ...]:
    """Draw the main panels of a budget: error growth, contributions, recorded over predicted error, sources."""
    part = None if windows is None else windows.shown
    panels = [_growth(budget, part), _contributions(budget, origin)]
    if part is not None:
        panels.append(_explained(part))
    return (*panels, _sources(budget))


def _growth(budget: Budget, part: RecordedPart | None) -> Panel:
    """Draw the horizontal error over time by all methods, with the distribution of the errors of recorded windows."""
    time, covariance, zero = budget.time, budget.covariance, np.zeros(len(budget.time))
    note = "grey: recorded windows, including reference errors; purple: 95 % interval of their RMS"
    curves = [] if part is None else _recorded(part)
    curves += [
        Curve("up to the worst-case sum", time, budget.worst[:, 3], SKY, "band", zero),
        Curve("covariance, 1 sd", time, horizontal(covariance.total), BLACK),
        Curve("analytic", time, horizontal(budget.analytic.total), BLUE, "dashed"),
    ]
    if budget.simulated is not None:
        rows, (low, high) = budget.chosen, budget.simulated.band
        value = horizontal(budget.simulated.total[rows])
        texts = tuple(
            f"simulated, {budget.simulated.runs} runs: {number(float(v))} m ({number(float(v / high))} … "
            f"{number(float(v / low))} m) after {t:g} s"
            for t, v in zip(time[rows], value, strict=True)
        )
        name = f"simulated, {budget.simulated.runs} runs"
        curves.append(Curve(name, time[rows], value, VERMILLION, "crosses", text=texts))
    if part is None and budget.recorded is not None:
        found = budget.recorded
        curves.append(Curve(f"recorded, {found.windows} windows", found.time, found.corrected[:, 3], PURPLE, "crosses"))
    labels, note = ("Growth of the horizontal error", "horizontal error [m]", _TIME), "" if part is None else note
    return Panel("growth", *labels, tuple(curves), "growth", note, height=300)


def _recorded(part: RecordedPart) -> list[Curve]:
    """Draw the distribution of the recorded windows' horizontal errors, their RMS with interval, and the prediction."""
    i, windows, curve = COMPONENTS.index("horizontal"), part.windows, part.curve
    error = components(windows)[0][:, :, i]
    curves = spread(np.median(windows.elapsed, axis=0), error)
    if np.isfinite(curve.low[:, i]).any():
        curves.append(Curve("recorded RMS, corrected", curve.times, curve.high[:, i], PURPLE, "band", curve.low[:, i]))
    curves.append(Curve("recorded RMS, corrected", curve.times, curve.corrected[:, i], PURPLE))
    return [*curves, Curve("predicted by the filter, all windows", curve.times, curve.predicted[:, i], GREEN, "dashed")]


def _contributions(budget: Budget, origin: str) -> Panel:
    """Draw the shares of error families in the variance as bars; each bar begins where the bar above it ends."""
    order, part = ranked(budget), shares(budget)
    shown = [k for k in order[:_SHOWN] if part[k] > _LEAST] or order[:1]
    end = 100.0 * np.cumsum(part[shown])
    texts = source_texts(budget, shown, origin)
    rows = [f"{budget.families[k]}" for k in shown]
    kinds = [_GROUPS[name.partition(" ")[0]][0] for name in rows]
    curves = bars(kinds, dict(_GROUPS.values()), end - 100.0 * part[shown], end, texts)
    remaining = len(order) - len(shown)
    if remaining:
        rows.append(f"{remaining} more")
        rest = f"{remaining} more sources, {100.0 - float(end[-1]):.2g} % of the variance together"
        place = np.array([float(len(shown))])
        curves.append(Curve("others", np.array([100.0]), place, GREY, "bars", end[-1:], text=(rest,)))
    gain = saved(budget)[shown[0]]
    label = f"share of the variance of the horizontal error after {budget.time[budget.chosen[-1]]:g} s [%]"
    note = f"point at a source: size, law, origin, decrease by halving it ({rows[0]}: {number(float(gain))} m)"
    return row_panel("contributions", "Contributions to the error", label, curves, rows, note)


def _explained(part: RecordedPart) -> Panel:
    """Draw the ratio of recorded to predicted error at the end of the windows, coloured by their agreement."""
    rows = [each for each in part.verdicts if each.predicted > 0.0]
    kinds = [_kind(each) for each in rows]
    colours = {"explained": GREEN, "less than predicted": SKY, "not explained": VERMILLION}
    low, high = np.array([_ratios(each) for each in rows]).reshape(-1, 2).T
    texts = [_reason(each, part) for each in rows]
    curves = bars(kinds, {kind: colours[kind] for kind in kinds}, low, high, texts)
    dots = [(row, each.recorded / each.predicted) for row, each in enumerate(rows) if np.isfinite(each.recorded)]
    if dots:
        dot_rows, value = np.array(dots).T
        curves.append(Curve("recorded / predicted", value, dot_rows, BLACK, "points"))
    title, label = f"Explained or not, after {part.growth.length:g} s", "recorded RMS, corrected, over predicted sd [-]"
    note = "bar: 95 % interval; explained if it reaches down to 1 (shaded), or if as few windows may err so much"
    panel = row_panel("explained", title, label, curves, [each.component for each in rows], note)
    return replace(panel, spans=((0.97, 1.03),))


def _kind(each: Verdict) -> str:
    if not each.explained:
        return "not explained"
    return "less than predicted" if each.cautious else "explained"


def _ratios(each: Verdict) -> tuple[float, float]:
    """Return the ends of a bar: 95 % interval of recorded over predicted error; without it, the ratio itself."""
    low, high = (each.low, each.high) if np.isfinite(each.low) else (each.recorded, each.recorded)
    low, high = (0.0 if not np.isfinite(value) else value / each.predicted for value in (low, high))
    return low, max(high, low + 0.02)  # a bar of no width would be invisible


def _reason(each: Verdict, part: RecordedPart) -> str:
    """Write recorded and predicted error of a component, and why the predicted error explains it or not."""
    value = f"{number(each.recorded)} m" if np.isfinite(each.recorded) else below_noise(each.high, " m")
    has_interval = np.isfinite(each.low) and np.isfinite(each.recorded)
    interval = f" ({number(each.low)} … {number(each.high)} m)" if has_interval else ""
    head = f"{each.component}: recorded {value}{interval}, predicted {number(each.predicted)} m: {_kind(each)}"
    if not each.explained:
        return f"{head}: the stated errors of IMU and fixes do not explain it; see the causes below"
    if each.cautious:
        return f"{head}: the stated errors are cautious"
    windows = part.growth.effective
    return f"{head}: {number(windows, 2)} independent windows show no significant difference from the prediction"


def _sources(budget: Budget) -> Panel:
    """Draw the error growth by each of the largest error families alone, and by all, on logarithmic axes."""
    time, shown = budget.time, ranked(budget)[: len(_LINES)]
    total = horizontal(budget.covariance.total)
    curves = []
    for colour, k in zip(_LINES, shown, strict=False):
        value = horizontal(budget.covariance.parts[:, k])
        curves.append(Curve(budget.families[k], time, np.where(value > 0.0, value, np.nan), colour))
    limits = max(1e-4 * float(total[-1]), 0.5 * float(total[0])), 2.0 * float(total[-1])
    curves += power_lines(time, max(0.06 * float(total[-1]), 4.0 * limits[0]), GREY, limits[0])
    labels, note = ("Each source alone", "horizontal error [m]", _TIME), "covariance, 1 sd; grey: growth with t, t², t³"
    curves.append(Curve("all", time, total, BLACK))
    return Panel("sources", *labels, tuple(curves), "sources", note, log="xy", limits=limits, height=280)


def windows_drawings(budget: RecordedBudget) -> tuple[Section, ...]:
    """Lay out figures of the recorded windows, calibrated and uncalibrated: growth, equivalent errors, regression."""
    sections = []
    for kind, part in parts_of(budget):
        name = "uncalibrated" if part.windows.uncalibrated else "recorded"
        against = f"{kind}, against {budget.reference}"
        sections += [
            drawn(f"{name}_growth", f"Recorded error without GPS, {against}", _growth_panels(part, name), columns=2),
            drawn(f"{name}_causes", f"Equivalent errors of each window, {kind}", _causes_panels(part, name), columns=2),
            drawn(f"{name}_regression", f"Recorded over predicted error, {kind}", (_regression_panel(part, name),)),
        ]
    return tuple(sections)


def _growth_panels(part: RecordedPart, key: str) -> Iterator[Panel]:
    """Draw North, East and horizontal errors of windows over time; the horizontal error has logarithmic axes."""
    windows, curve = part.windows, part.curve
    error = components(windows)[0]
    for name in ("north", "east", "horizontal"):
        i, signed = COMPONENTS.index(name), name != "horizontal"
        curves = spread(np.median(windows.elapsed, axis=0), error[:, :, i])
        for sign in (1.0, -1.0) if signed else (1.0,):
            curves += _sums(part, i, sign)
        largest = 1.1 * float(np.nanmax([np.nanmax(np.abs(error[:, :, i])), np.nanmax(curve.predicted[:, i])]))
        limits = -largest, largest  # not from the band of simulated replicas, which is very wide for few replicas
        if not signed:
            rms = curve.corrected[:, i]
            first = max(1, len(curve.times) // 6)
            curves += power_lines(curve.times[first:], float(rms[-1]), GREEN) if rms[-1] > 0.0 else []
            positive = rms[rms > 0.0]
            limits = max(0.2 * float(positive.min(initial=largest)), 1e-4 * largest), largest
        labels = f"{name.capitalize()} error of {windows.count} windows", f"{name} error [m]", _TIME
        note = "bands: 95 %, of the windows by block bootstrap"
        panel = Panel(f"{key}_growth_{name}", *labels, tuple(curves), note=note, limits=limits, height=260)
        yield replace(panel, link=f"{key}_growth") if signed else replace(panel, log="xy")


def _sums(part: RecordedPart, i: int, sign: float) -> list[Curve]:
    """Draw recorded RMS with interval, predicted sd and replica band of component `i`. `sign`: side of zero."""
    curve, curves = part.curve, []
    if part.replicas is not None:
        low, high = (sign * each[:, i] for each in part.replicas.band)
        curves.append(Curve("simulated replicas", part.replicas.times, high, ORANGE, "band", low))
    if np.isfinite(curve.low[:, i]).any():
        low, high = sign * curve.low[:, i], sign * curve.high[:, i]
        curves.append(Curve("recorded RMS", curve.times, high, BLUE, "band", low))
    curves.append(Curve("recorded RMS", curve.times, sign * curve.corrected[:, i], BLUE))
    return [*curves, Curve("predicted sd", curve.times, sign * curve.predicted[:, i], BLACK, "dashed")]


def _causes_panels(part: RecordedPart, key: str) -> Iterator[Panel]:
    """Draw the equivalent velocity, acceleration and drift error of each window, with the sd of the filter."""
    diagnosis = part.diagnosis
    windows = diagnosis.windows
    start = windows.start - windows.start[0]
    ends = np.array([start.min(), start.max()])
    across = f"start of the window, since {windows.start[0]:.1f} s [s]"
    note = "at rest or straight" if diagnosis.steady else "turns included, in which no curve is pure"
    for row, name in enumerate(CAUSES):
        for axis in diagnosis.axes:
            unit = UNITS[CAUSE_UNITS[name]][1]
            factor = 1.0 / unit if name != "drift" else 1.0 / unit / diagnosis.gravity
            value = np.array([curve.value[row] for curve in axis.curves]) * factor
            sd = np.array([curve.sd[row] for curve in axis.curves]) * factor
            half = np.full(2, axis.causes[row].filter_sd / unit)
            curves = [Curve("1 sd of the filter", ends, half, GREY, "band", -half)]
            for motion, colour in _MOTIONS.items():
                chosen = windows.motion == motion
                x, y, reach = start[chosen], value[chosen], sd[chosen]
                # vertical lines: lower end, upper end, NaN to interrupt
                error_bars = np.column_stack((y - reach, y + reach, np.full(len(x), np.nan))).ravel()
                curves.append(Curve(motion, x, y, colour, "points"))
                curves.append(Curve("", np.repeat(x, 3), error_bars, colour, "thin"))
            labels = f"{axis.axis.capitalize()} {name}: error grows with {GROWS[name]}", f"{name} [{CAUSE_UNITS[name]}]"
            nonempty = tuple(each for each in curves if len(each.x))
            yield Panel(f"{key}_{axis.axis}_{name}".replace(" ", "_"), *labels, across, nonempty, f"{key}_causes", note)


def _regression_panel(part: RecordedPart, key: str) -> Panel:
    """Draw absolute North and East errors of windows over their predicted sd, with the regression line."""
    line = part.regression
    interval = f" ({line.low:.2f} to {line.high:.2f})" if np.isfinite(line.low) else ""
    small = 1e-2 * float(np.median(line.recorded)) if len(line.recorded) else 1e-3
    size = np.maximum(line.recorded, small)
    order = np.argsort(line.predicted)
    ends = np.array([float(line.predicted.min()), float(line.predicted.max())])
    curves = [
        Curve("a window at one time", line.predicted[order], size[order], BLUE, "points"),
        Curve("as predicted", ends, ends, BLACK, "dashed"),
        Curve("regression", ends, line.slope * ends, VERMILLION),
    ]
    if np.isfinite(line.low):
        curves.append(Curve("regression", ends, line.high * ends, VERMILLION, "band", line.low * ends))
    labels = "Recorded over predicted error", "recorded |error| / 0.80 [m]", "predicted sd, reference included [m]"
    note = f"north and east: {line.slope:.2f} times as large{interval}, R² {line.r_squared:.2f}"
    return Panel(f"{key}_regression", *labels, tuple(curves), note=note, log="xy", height=320)


def page(result: Result[BudgetStudy]) -> Page:
    """Lay out an error budget: errors by all methods, contributions of the sources, recorded windows, impact."""
    budget, windows = result.found.budget, result.found.windows
    problems = warnings(budget, windows)
    basis = (*assumptions(budget), *(recorded.windows_assumptions(windows) if windows is not None else ()))
    total = str(result.options.get("total") or "rss")
    axes = quantities.axes_section(budget, total)
    sections = (
        *quantities.budget_sections(budget),
        *((axes,) if total == "worst" else ()),
        quantities.estimates_section(budget),
        beside(*(drawn(each.key, each.title, (each,)) for each in budget_panels(budget, windows, _origin(result)))),
        quantities.contributions_section(budget),
        *(() if total == "worst" else (axes,)),
        quantities.positions_section(budget),
        *(_windows(windows) if windows is not None else ()),
        quantities.states_section(budget),
        quantities.impact_section(budget),
    )
    return Page(
        f"Error budget of {budget.imu}: {budget.time[budget.chosen[-1]]:g} s without GPS",
        summary(budget),
        sections,
        (*problems, *basis),
        (phrase("method.intervals"),) * (windows is not None),
        verdict=by_warnings(headline(budget), problems, _light(budget, windows)),
        merits=quantities.merits(budget, windows),
    )


def _windows(windows: RecordedBudget) -> tuple[Section, ...]:
    """Lay out the recorded windows: findings as sentences, then tables and figures, both folded."""
    lines = recorded.windows_sentences(windows)
    sentences = only_json("", Quantity("recorded_summary", lines))
    rows = tuple((Quantity("finding", line, meaning=" "),) for line in lines)
    section = Section("", "Recorded windows: findings", rows=rows)
    tables = tuple(
        replace(each, title="Recorded windows: tables", folded=True) for each in recorded.windows_sections(windows)
    )
    figures = Section("", "Recorded windows: figures", parts=windows_drawings(windows), show="page", folded=True)
    return (sentences, section, *tables, figures)


def _origin(result: Result[BudgetStudy]) -> str:
    """Describe where the sizes of the error sources come from: name of the IMU model, and how it was chosen."""
    name = result.found.budget.imu if result.imu_model is None else result.imu_model[0].name
    given = result.imu_model is None or result.imu_model[1] == Finding.of(Code.IMU_MODEL_GIVEN)
    choice = "" if result.imu_model is None or given else f": {sentence(result.imu_model[1])}"
    return f"IMU model {name}{choice}"


def write_files(result: Result[BudgetStudy], folder: RunFolder, table_format: TableFormat) -> None:
    """Write ``budget.pdf``, the IMU model, and the complete result for `read_found`; `table_format` has no effect."""
    from insnav.report.figures import drawing  # imports matplotlib, needed only to draw figures
    from insnav.report.pdf import write_pdf

    store(result.found, folder.path(FOUND))
    if result.imu_model is not None:
        folder.path("imu.toml").write_text(to_toml(result.imu_model[0]), encoding="utf-8", newline="\n")
    with drawing():
        laid_out = page(result)
        lines = page_text(replace(laid_out, summary=()), 108).splitlines()
        write_pdf(laid_out, folder.path("budget.pdf"), PDF_PAGES, lines)


def read_found(folder: Path, findings: Sequence[Finding]) -> BudgetStudy:
    """Read a budget from its folder, and convert notes on windows from version 0.2, where they were plain text."""
    study: BudgetStudy = read_stored(folder)
    if study.windows is None:
        return study
    notes = tuple(Finding.from_dict(each) if isinstance(each, str) else each for each in study.windows.notes)
    return replace(study, windows=replace(study.windows, notes=notes))


def frame(result: Result[BudgetStudy]) -> DataFrame:
    """Build a table of the contributions to the horizontal error, with the source sizes as numbers."""
    budget, rows = result.found.budget, []
    for row in quantities.contributions_rows(budget):
        smallest, largest, unit = extent(budget, str(row[0].value))
        sizes = Quantity("size_least", smallest), Quantity("size_largest", largest), Quantity("size_unit", unit)
        others = [each for each in row if each.key != "size"]
        metres = (each if each.unit or isinstance(each.value, str) else replace(each, unit="m") for each in others)
        rows.append((*metres, *sizes))
    return rows_frame(rows)


def summary(budget: Budget) -> tuple[str, ...]:
    """Summarise a budget in one sentence in addition to the verdict: motion, and errors along each axis."""
    errors = budget.valid.total[budget.chosen[-1]]
    down = "held to the reference" if budget.hold else f"{number(errors[2])} m"
    return (f"Motion: {budget.motion}. North {number(errors[0])} m, east {number(errors[1])} m, down: {down}.",)


def warnings(budget: Budget, windows: RecordedBudget | None = None) -> tuple[Finding, ...]:
    """Return warnings: nonlinear errors, simulation mismatch, missing and ignored error terms, recorded windows."""
    found = []
    if not budget.linear:
        attitude = float(budget.covariance.total[budget.chosen[-1], 6:].max())
        found.append(Finding.of(Code.BUDGET_NONLINEAR, attitude_rad=attitude))
    elif budget.simulated is not None and not simulated_matches(budget, budget.simulated):
        nees = max(budget.simulated.nees[budget.chosen], key=lambda each: abs(float(each) - 1.0))
        found.append(Finding.of(Code.BUDGET_SIMULATED_MISMATCH, nees=nees, runs=budget.simulated.runs))
    if budget.absent:
        found.append(Finding.of(Code.BUDGET_ABSENT, terms=budget.absent))
    if budget.ignored:
        found.append(Finding.of(Code.BUDGET_IGNORED, terms=budget.ignored))
    return (*found, *(() if windows is None else recorded.windows_warnings(windows)))


def assumptions(budget: Budget) -> Iterator[Finding]:
    """Yield findings that explain the method of the budget and its assumptions."""
    last = float(budget.time[budget.chosen[-1]])
    time = min(last, SHORT)
    bias, drift = budget.short_form_error(time)
    limit = SHORT if last > SHORT else math.nan
    yield Finding.of(Code.BUDGET_METHODS)
    yield Finding.of(Code.BUDGET_INDEPENDENT_SOURCES)
    yield Finding.of(Code.BUDGET_SHORT_FORMS, time_s=time, limit_s=limit, bias_share=bias, drift_share=drift)
    yield Finding.of(Code.BUDGET_VERTICAL_HELD if budget.hold else Code.BUDGET_VERTICAL_FREE)
    if budget.recorded is None:
        yield Finding.of(Code.BUDGET_TURN_ON_BIASES)
        yield FIELD_FACTOR
    else:
        yield Finding.of(Code.BUDGET_WINDOW_BIASES)
    if math.isfinite(budget.flicker_lowest):
        yield Finding.of(Code.BUDGET_FLICKER, frequency_hz=budget.flicker_lowest)
    if not any(source.sd > 0.0 for source in budget.sources if source.group == "gravity"):
        yield Finding.of(Code.BUDGET_NORMAL_GRAVITY)
    if budget.simulated is not None:
        runs, alone, seed = budget.simulated.runs, budget.simulated.alone, budget.simulated.seed
        yield Finding.of(Code.BUDGET_SIMULATED_BOUNDS, probability=BAND, runs=runs, alone=alone, seed=seed)


def simulated_matches(budget: Budget, simulated: SimulatedColumn) -> bool:
    """Return whether normalised squared errors of the simulation agree with the covariance at the chosen times."""
    # The mean of n squared normalised errors has sd sqrt(2 / n): limit 4 sd; n is 9 per run, or 6 if height is held.
    limit = 4.0 * np.sqrt(2.0 / (simulated.runs * (6.0 if budget.hold else 9.0)))
    return bool(np.all(np.abs(simulated.nees[budget.chosen] - 1.0) < limit))


def _light(budget: Budget, windows: RecordedBudget | None) -> tuple[Light, str]:
    simulated = budget.simulated
    if not budget.linear:
        if simulated is None:
            return "bad", "attitude errors exceed the linear model"
        return "attention", "attitude errors exceed the linear model: only the simulated figure holds"
    if simulated is not None and not simulated_matches(budget, simulated):
        return "bad", "simulated errors do not match the covariance"
    if windows is None:
        if simulated is None:
            return "unknown", "predicted only: neither simulated (--runs) nor compared with a recorded drive"
        return "good", f"{simulated.runs} simulated runs agree with the covariance"
    if windows.settings.start != "forward":
        return "attention", "windows start from the smoothed state, which uses the fixes in them"
    wrong = [each for each in windows.shown.verdicts if not each.explained]
    if wrong:
        worst = max(wrong, key=lambda each: each.recorded / max(each.predicted, 1e-300))
        names = " and ".join(each.component for each in wrong if each.component != "horizontal") or "horizontal"
        times = number(worst.recorded / worst.predicted, 2) if worst.predicted > 0.0 else "many"
        return "attention", f"recorded errors {names} are not explained: up to {times} times as large as predicted"
    replicas = windows.shown.replicas
    if replicas is not None and not replicas.agree:
        return "attention", "recorded errors lie outside the band of the simulated replicas"
    less = " and ".join(each.component for each in windows.shown.verdicts if each.cautious)
    if less:
        return "good", f"no recorded error is larger than predicted, {less} smaller: the stated errors are cautious"
    return "good", "recorded errors are explained by the stated errors of IMU and fixes"


def headline(budget: Budget) -> str:
    """Write the horizontal error at the last time, by all methods, and its largest source in one sentence."""
    last = budget.chosen[-1]
    beyond = "" if budget.linear else " (beyond the linear model)"
    linear_methods = {"analytic": budget.analytic, "covariance": budget.covariance}
    estimates = [f"{name} {number(float(horizontal(way.total[last])))}{beyond}" for name, way in linear_methods.items()]
    if budget.simulated is not None:
        estimates.append(f"simulated {number(float(horizontal(budget.simulated.total[last])))}")
    if budget.recorded is not None:
        estimates.append(f"recorded {recorded_text(budget, len(budget.chosen) - 1)}")
    total = number(float(horizontal(budget.valid.total[last])))
    first = ranked(budget)[0]
    share, name = 100.0 * float(shares(budget)[first]), budget.families[first]
    largest = f"; {share:.0f} % of the variance is {size(budget, name)} of {name}" if share >= 1.0 else ""
    return f"After {budget.time[last]:g} s without GPS: {total} m horizontal (1 sd) — {', '.join(estimates)}{largest}."


def end_page(
    axes: Sequence[EndAxis], time: float, gravity: float, sd: tuple[float, float], spec: ImuSpec | None
) -> Page:
    """Lay out the causes of the error at the end of a run on each axis, compared with the IMU specification.

    `time`: length of the run [s]. `gravity` [m/s^2]. `sd`: of position [m] and velocity [m/s] of the reference.
    """
    given = _specified(spec)
    rows = []
    for axis in axes:
        # tilt and accelerometer bias cause the same acceleration error: both rows use the same fit
        for term, name, value, deviation, unit, k in (
            ("t", "velocity at the start", axis.alone[0], axis.sd[0], "m/s", 0),
            ("t²", "tilt", axis.alone[1] / gravity, axis.sd[1] / gravity, "mrad", 1),
            ("t²", "accelerometer bias", axis.alone[1], axis.sd[1], "mg", 1),
            ("t³", "gyro drift", axis.alone[2] / gravity, axis.sd[2] / gravity, "deg/h", 2),
        ):
            assumed, factor = given.get(name, 0.0), UNITS[unit][1]
            text = f"{number(value / factor)} ± {number(deviation / factor, 2)} {unit}"
            row = {"cause": name, "grows_with": term, "value": text, "value_si": float(value), "explains": axis.fits[k]}
            row |= {"left_sd": float(axis.left[k]), "by_specification": abs(value) / assumed if assumed > 0.0 else None}
            rows.append(of_table("budget.end_cause", axis, **row))
    powers = {axis.axis: axis.power for axis in axes}
    return Page(
        f"Error at the end of {time:g} s of free-inertial navigation",
        tuple(_end_sentence(axis, gravity, given) for axis in axes),
        (
            Section("causes", "Each cause alone", rows=tuple(rows), note="by specification: in 1 sd of the IMU file"),
            only_json("", Quantity("power_of_time", powers), Quantity("gravity", gravity, "m/s^2")),
        ),
        findings=(
            Finding.of(Code.END_OF_RUN_LEVEL),
            Finding.of(Code.END_OF_RUN_REFERENCE_SD, position_m=sd[0], velocity_m_s=sd[1]),
            Finding.of(Code.END_OF_RUN_TILT_OR_BIAS),
        ),
    )


def _specified(spec: ImuSpec | None) -> dict[str, float]:
    """Return the specified standard deviation of each cause by name, of the largest axis; SI units."""
    if spec is None:
        return {}
    sd_of = {"accelerometer bias": float(np.max(spec.accel.bias)), "gyro drift": float(np.max(spec.gyro.bias))}
    if spec.initial is not None:
        sd_of |= {"tilt": spec.initial.tilt, "velocity at the start": spec.initial.velocity}
    return sd_of


def _end_sentence(axis: EndAxis, gravity: float, given: dict[str, float]) -> str:
    head = f"{axis.axis.capitalize()}, {number(axis.position)} m and {number(axis.velocity)} m/s"
    if len(axis.terms) > 1:
        return f"{head}: no single cause explains both; any two of t, t² and t³ do."
    head += f", growing with t to the power of {axis.power:.2f}" if np.isfinite(axis.power) else ""
    (term,) = axis.terms
    if term == "t":
        return f"{head}: a velocity error of {number(axis.alone[0])} m/s at the start."
    if term == "t³":
        return f"{head}: a gyro drift of {number(axis.alone[2] / gravity / DEG_PER_H)} deg/h."
    tilt = axis.alone[1] / gravity
    text = (
        f"{head}: {number(abs(tilt) * 1e3)} mrad ({number(abs(tilt) / DEG)} deg) of tilt, or "
        f"{number(abs(axis.alone[1]) / G0 * 1e3)} mg of accelerometer bias"
    )
    assumed = given.get("tilt", 0.0)
    return text + (f"; {number(abs(tilt) / assumed, 2)} times the tilt specified." if assumed > 0.0 else ".")
