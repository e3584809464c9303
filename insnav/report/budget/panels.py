"""Interactive drawings of an error budget: growth, contributions, sources, recorded windows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.errors.budget.error_budget import Budget
from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart, Verdict
from insnav.errors.diagnosis.causes import CAUSES
from insnav.errors.outage.gnss_outage import COMPONENTS, components
from insnav.report.budget.quantities import horizontal, ranked, saved, shares, source_texts
from insnav.report.budget.windows import CAUSE_UNITS, GROWS, parts_of
from insnav.report.outage.page import below_noise, power_lines, spread
from insnav.report.page import Section, drawn
from insnav.report.panels import Curve, Panel, bars
from insnav.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, number
from insnav.units import UNITS

_SHOWN = 10  # sources with a separate bar
_LEAST = 1e-3  # least share of the variance for a separate bar
_GROUPS = {
    "initial": ("start", ORANGE),
    "gyro": ("gyros", BLUE),
    "accel": ("accelerometers", VERMILLION),
    "gravity": ("gravity", GREEN),
    "timing": ("timing", PURPLE),
}
_MOTIONS = {"static": GREEN, "straight": BLUE, "turning": VERMILLION}
_LINES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)


def budget_panels(budget: Budget, windows: RecordedBudget | None, origin: str) -> tuple[Panel, ...]:
    """Draw all panels of the first screens."""
    part = None if windows is None else windows.shown
    panels = [_growth(budget, part), _contributions(budget, origin)]
    if part is not None:
        panels.append(_explained(part))
    return (*panels, _sources(budget))


def _growth(budget: Budget, part: RecordedPart | None) -> Panel:
    """Draw the horizontal error over time by all methods, with the spread of recorded windows."""
    time, whole, zero = budget.time, budget.covariance, np.zeros(len(budget.time))
    note = "grey: recorded windows, errors of the reference in them; purple: 95 % interval of their RMS"
    curves = [] if part is None else _recorded(part)
    curves += [
        Curve("up to the worst-case sum", time, budget.worst[:, 3], SKY, "band", zero),
        Curve("covariance, 1 sd", time, horizontal(whole.total), BLACK),
        Curve("analytic", time, horizontal(budget.analytic.total), BLUE, "dashed"),
    ]
    if budget.simulated is not None:
        at, (low, high) = budget.chosen, budget.simulated.band
        value = horizontal(budget.simulated.total[at])
        texts = tuple(
            f"simulated, {budget.simulated.runs} runs: {number(float(v))} m ({number(float(v / high))} … "
            f"{number(float(v / low))} m) after {t:g} s"
            for t, v in zip(time[at], value, strict=True)
        )
        name = f"simulated, {budget.simulated.runs} runs"
        curves.append(Curve(name, time[at], value, VERMILLION, "crosses", text=texts))
    if part is None and budget.recorded is not None:
        found = budget.recorded
        curves.append(Curve(f"recorded, {found.windows} windows", found.time, found.corrected[:, 3], PURPLE, "crosses"))
    return Panel(
        "growth",
        "Growth of the horizontal error",
        "horizontal error [m]",
        "time without GPS [s]",
        tuple(curves),
        link="growth",
        note="" if part is None else note,
        height=300,
    )


def _recorded(part: RecordedPart) -> list[Curve]:
    """Draw the spread of the windows, their RMS with interval, and their predicted error."""
    i, windows, curve = COMPONENTS.index("horizontal"), part.windows, part.curve
    error = components(windows)[0][:, :, i]
    found = spread(np.median(windows.elapsed, axis=0), error)
    if np.isfinite(curve.low[:, i]).any():
        found.append(Curve("recorded RMS, corrected", curve.times, curve.high[:, i], PURPLE, "band", curve.low[:, i]))
    found.append(Curve("recorded RMS, corrected", curve.times, curve.corrected[:, i], PURPLE))
    return [*found, Curve("predicted by the filter, all windows", curve.times, curve.predicted[:, i], GREEN, "dashed")]


def _contributions(budget: Budget, origin: str) -> Panel:
    """Draw a waterfall of the variance: each family begins at the end of the previous one."""
    order, part = ranked(budget), shares(budget)
    shown = [k for k in order[:_SHOWN] if part[k] > _LEAST] or order[:1]
    end = 100.0 * np.cumsum(part[shown])
    texts = source_texts(budget, shown, origin)
    rows = [f"{budget.families[k]}" for k in shown]
    kinds = [_GROUPS[name.partition(" ")[0]][0] for name in rows]
    curves = bars(kinds, dict(_GROUPS.values()), end - 100.0 * part[shown], end, texts)
    left = len(order) - len(shown)
    if left:
        rows.append(f"{left} more")
        rest = f"{left} more sources, {100.0 - float(end[-1]):.2g} % of the variance together"
        place = np.array([float(len(shown))])
        curves.append(Curve("others", np.array([100.0]), place, GREY, "bars", end[-1:], text=(rest,)))
    gain = saved(budget)[shown[0]]
    return Panel(
        "contributions",
        "Contributions to the error",
        "",
        f"share of the variance of the horizontal error after {budget.time[budget.chosen[-1]]:g} s [%]",
        tuple(curves),
        note=f"point at a source: size, law, origin, decrease by halving it ({budget.families[shown[0]]}: "
        f"{number(float(gain))} m)",
        rows=tuple(rows),
        height=80 + 24 * len(rows),
    )


def _explained(part: RecordedPart) -> Panel:
    """Draw recorded over predicted error at the end, coloured by agreement."""
    rows = [each for each in part.verdicts if each.predicted > 0.0]
    kinds = [_kind(each) for each in rows]
    colours = {"explained": GREEN, "less than predicted": SKY, "not explained": VERMILLION}
    low, high = np.array([_ratios(each) for each in rows]).reshape(-1, 2).T
    texts = [_reason(each, part) for each in rows]
    curves = bars(kinds, {kind: colours[kind] for kind in kinds}, low, high, texts)
    dots = [(row, each.recorded / each.predicted) for row, each in enumerate(rows) if np.isfinite(each.recorded)]
    if dots:
        at, value = np.array(dots).T
        curves.append(Curve("recorded / predicted", value, at, BLACK, "points"))
    return Panel(
        "explained",
        f"Explained or not, after {part.growth.length:g} s",
        "",
        "recorded RMS, corrected, over predicted sd [-]",
        tuple(curves),
        note="bar: 95 % interval; explained if it reaches down to 1 (shaded), or if as few windows may err so much",
        spans=((0.97, 1.03),),
        rows=tuple(each.component for each in rows),
        height=80 + 24 * len(rows),
    )


def _kind(each: Verdict) -> str:
    if not each.explained:
        return "not explained"
    return "less than predicted" if each.cautious else "explained"


def _ratios(each: Verdict) -> tuple[float, float]:
    """Return the interval of recorded over predicted error; the value itself without an interval."""
    low, high = (each.low, each.high) if np.isfinite(each.low) else (each.recorded, each.recorded)
    low, high = (0.0 if not np.isfinite(value) else value / each.predicted for value in (low, high))
    return low, max(high, low + 0.02)


def _reason(each: Verdict, part: RecordedPart) -> str:
    """Return the reason why an error counts as explained or not."""
    value = f"{number(each.recorded)} m" if np.isfinite(each.recorded) else below_noise(each.high, " m")
    known = np.isfinite(each.low) and np.isfinite(each.recorded)
    interval = f" ({number(each.low)} … {number(each.high)} m)" if known else ""
    head = f"{each.component}: recorded {value}{interval}, predicted {number(each.predicted)} m: {_kind(each)}"
    if not each.explained:
        return f"{head}: the stated errors of IMU and fixes do not make it; see the causes below"
    if each.cautious:
        return f"{head}: the stated errors are cautious"
    windows = part.growth.effective
    return f"{head}: {number(windows, 2)} independent windows show no significant difference from the prediction"


def _sources(budget: Budget) -> Panel:
    """Draw the growth of the largest families alone, on logarithmic axes."""
    time, shown = budget.time, ranked(budget)[: len(_LINES)]
    total = horizontal(budget.covariance.total)
    curves = []
    for colour, k in zip(_LINES, shown, strict=False):
        value = horizontal(budget.covariance.parts[:, k])
        curves.append(Curve(budget.families[k], time, np.where(value > 0.0, value, np.nan), colour))
    limits = max(1e-4 * float(total[-1]), 0.5 * float(total[0])), 2.0 * float(total[-1])
    curves += power_lines(time, max(0.06 * float(total[-1]), 4.0 * limits[0]), GREY, limits[0])
    return Panel(
        "sources",
        "Each source alone",
        "horizontal error [m]",
        "time without GPS [s]",
        (*curves, Curve("all", time, total, BLACK)),
        link="sources",
        note="covariance, 1 sd; grey: growth with t, t², t³",
        log="xy",
        limits=limits,
        height=280,
    )


def windows_drawings(budget: RecordedBudget) -> tuple[Section, ...]:
    """Lay out growth, equivalent errors and regression of the recorded windows, calibrated and uncalibrated."""
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
    """Draw North and East error over the time without fixes, and the horizontal one on logarithmic axes."""
    windows, curve = part.windows, part.curve
    error = components(windows)[0]
    for name in ("north", "east", "horizontal"):
        i, both = COMPONENTS.index(name), name != "horizontal"
        curves = spread(np.median(windows.elapsed, axis=0), error[:, :, i])
        for sign in (1.0, -1.0) if both else (1.0,):
            curves += _sums(part, i, sign)
        largest = 1.1 * float(np.nanmax([np.nanmax(np.abs(error[:, :, i])), np.nanmax(curve.predicted[:, i])]))
        limits = -largest, largest  # the band of few replicas is wide
        if not both:
            rms = curve.corrected[:, i]
            first = max(1, len(curve.times) // 6)
            curves += power_lines(curve.times[first:], float(rms[-1]), GREEN) if rms[-1] > 0.0 else []
            positive = rms[rms > 0.0]
            limits = max(0.2 * float(positive.min(initial=largest)), 1e-4 * largest), largest
        yield Panel(
            f"{key}_growth_{name}",
            f"{name.capitalize()} error of {windows.count} windows",
            f"{name} error [m]",
            "time without GPS [s]",
            tuple(curves),
            f"{key}_growth" if both else "",
            "bands: 95 %, of the windows by block bootstrap",
            log="" if both else "xy",
            limits=limits,
            height=260,
        )


def _sums(part: RecordedPart, i: int, sign: float) -> list[Curve]:
    """Draw RMS with interval, predicted sd, and replica band, on one side of zero."""
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
    """Draw velocity, effective acceleration and drift of each fitted window, with the filter's sd."""
    diagnosis = part.diagnosis
    windows = diagnosis.windows
    since = windows.start - windows.start[0]
    ends = np.array([since.min(), since.max()])
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
                at, y, reach = since[chosen], value[chosen], sd[chosen]
                bars = np.column_stack((y - reach, y + reach, np.full(len(at), np.nan))).ravel()
                curves.append(Curve(motion, at, y, colour, "points"))
                curves.append(Curve("", np.repeat(at, 3), bars, colour, "thin"))
            yield Panel(
                f"{key}_{axis.axis}_{name}".replace(" ", "_"),
                f"{axis.axis.capitalize()} {name}: error grows with {GROWS[name]}",
                f"{name} [{CAUSE_UNITS[name]}]",
                across,
                tuple(each for each in curves if len(each.x)),
                f"{key}_causes",
                note,
            )


def _regression_panel(part: RecordedPart, key: str) -> Panel:
    """Draw the size of North and East errors over their predicted sd."""
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
    return Panel(
        f"{key}_regression",
        "Recorded over predicted error",
        "recorded |error| / 0.80 [m]",
        "predicted sd, reference included [m]",
        tuple(curves),
        note=f"north and east: {line.slope:.2f} times as large{interval}, R² {line.r_squared:.2f}",
        log="xy",
        height=320,
    )
