"""Sentences, warnings and panels of the recorded half of an error budget."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart, Verdict
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis, Diagnosis
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS, components
from insnav.findings import Code, Finding, of_code
from insnav.report.budget import windows_quantities
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from insnav.report.numbers import number
from insnav.report.outage.windows import common_text, corrected_text, power_lines, thin_lines
from insnav.report.page import Section, drawn
from insnav.report.panels import Curve, Panel
from insnav.units import UNITS as FACTORS

_MRAD = 1e-3
_ENOUGH_REPLICAS = 10  # whose band is narrow enough to prove something
_WINDOWS, _POINTS = 40, 60  # drawn one by one, and points of each
_MOTIONS = {"static": GREEN, "straight": BLUE, "turning": VERMILLION}


def windows_drawings(budget: RecordedBudget) -> tuple[Section, ...]:
    """Growth, equivalent errors and regression of the recorded windows, calibrated and not."""
    sections = []
    for kind, part in windows_quantities.parts_of(budget):
        name = "uncalibrated" if part.windows.uncalibrated else "recorded"
        against = f"{kind}, against {budget.reference}"
        sections += [
            drawn(f"{name}_growth", f"Recorded error without GPS, {against}", growth_panels(part, name), columns=2),
            drawn(f"{name}_causes", f"Equivalent errors of each window, {kind}", causes_panels(part, name), columns=2),
            drawn(f"{name}_regression", f"Recorded over predicted error, {kind}", (regression_panel(part, name),)),
        ]
    return tuple(sections)


def windows_sentences(budget: RecordedBudget) -> tuple[str, ...]:
    """Say the result: explained or not, by what, and what the simulated replicas say."""
    lines = []
    for kind, part in windows_quantities.parts_of(budget):
        windows = part.windows
        left_out = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items())
        lines.append(
            f"{kind.capitalize()}: {windows.count} windows of {windows.length:g} s, effective sample size "
            f"{part.growth.effective:.0f}; {f'left out: {left_out}' if left_out else 'none touches a gap'}."
        )
        lines += [_verdict(each, windows.length) for each in part.verdicts]
        lines += [_diagnosed(axis, part.diagnosis) for axis in part.diagnosis.axes]
        lines += [line for line in (common_text(part.growth), windows_quantities.regression_text(part)) if line]
        if part.replicas is not None:
            lines.append(_against_replicas(part.replicas))
    return tuple(lines)


def windows_warnings(budget: RecordedBudget) -> tuple[Finding, ...]:
    """Give what the reader must not overlook."""
    found = list(of_code(budget.notes, Code.BUDGET_SMOOTHED_START))
    for kind, part in windows_quantities.parts_of(budget):
        wrong = [each for each in part.verdicts if not each.explained]
        if wrong:
            names = tuple(each.component for each in wrong)
            largest, length = max(each.recorded for each in wrong), part.windows.length
            unexplained = Code.BUDGET_UNEXPLAINED
            found.append(Finding.of(unexplained, subject=kind, recorded_m=largest, length_s=length, components=names))
        if part.replicas is not None and not part.replicas.agree:
            count = len(part.replicas.rms)
            found.append(Finding.of(Code.BUDGET_OUTSIDE_REPLICAS, subject=kind, replicas=count))
    made = budget.calibrated.replicas
    return (*found, *(() if made is None else made.apart.doubts))


def windows_assumptions(budget: RecordedBudget) -> tuple[Finding, ...]:
    """Give what was taken for granted."""
    return (
        Finding.of(Code.WINDOWS_START, state="filtered" if budget.settings.start == "forward" else "smoothed"),
        Finding.of(Code.WINDOWS_REFERENCE, reference=budget.reference),
        Finding.of(Code.WINDOWS_PREDICTED),
        Finding.of(Code.WINDOWS_ALONG_CROSS),
        Finding.of(Code.WINDOWS_LEVEL),
    )


def _verdict(each: Verdict, length: float) -> str:
    words = "explained" if each.explained else "unexplained"
    if each.cautious:
        words += "; less than predicted: the stated errors are cautious"
    elif not each.explained and each.predicted > 0.0:
        words += f", {number(each.recorded / each.predicted, 2)} times as large"
    return (
        f"{each.component.capitalize()} after {length:g} s: recorded "
        f"{corrected_text(each.recorded, each.low, each.high)}, predicted {number(each.predicted)} m by the filter for "
        f"all windows: {words}."
    )


def _diagnosed(axis: AxisDiagnosis, diagnosis: Diagnosis) -> str:
    """Words such as: east error is t²: 0.42 mrad of tilt or 0.41 mg of bias."""
    name, cause = CAUSES[axis.leading], axis.causes[axis.leading]
    unit = windows_quantities.UNITS[name]
    if cause.rms == 0.0:
        return f"{axis.axis.capitalize()} error is within sensor noise and reference error: no curve stands out."
    value = number(cause.rms / FACTORS[unit][1])
    what = {
        "velocity": f"{value} {unit} of velocity at the start",
        "acceleration": f"{number(cause.rms / diagnosis.gravity / _MRAD)} mrad of tilt or {value} {unit} of bias",
        "drift": f"{value} {unit} of drift about the {'east' if axis.axis == 'north' else 'north'} axis",
    }[name]
    line = (
        f"{axis.axis.capitalize()} error is {windows_quantities.GROWS[name]} ({100.0 * cause.share:.0f} %): {what}, RMS"
    )
    if not diagnosis.steady:
        return f"{line}, over windows with turns, in which no curve is pure."
    line += (
        f"; filter sd {number(cause.filter_sd / FACTORS[unit][1])} {unit}: {windows_quantities.explained_text(cause)}"
    )
    if name == "acceleration":
        line += "; in a straight window only the sum of bias and tilt is observable"
    return f"{line}."


def _against_replicas(made: Replicas) -> str:
    count, last = len(made.rms), made.times[-1]
    if made.agree:
        return (
            f"Recorded error after {last:g} s lies in the 95 % band of {count} simulated replicas: the stated IMU and "
            "fix errors describe this recording."
            if count >= _ENOUGH_REPLICAS
            else f"Recorded error after {last:g} s lies in the band of {count} simulated replicas, too few to prove "
            f"much: {_ENOUGH_REPLICAS} or more are needed."
        )
    outside, larger = [], False
    for i, name in enumerate(COMPONENTS[:3]):
        if not made.inside[-1, i]:
            larger |= bool(made.recorded[-1, i] > made.high[-1, i])
            band = windows_quantities.interval_text(float(made.low[-1, i]), float(made.high[-1, i]))
            outside.append(f"{name} {number(float(made.recorded[-1, i]))} m, band {band} m")
    why = (
        "this recording is worse than the stated IMU and fix errors; vibration and mounting, for two, are not stated"
        if larger
        else "this recording is better than the stated IMU and fix errors"
    )
    return (
        f"Recorded error after {last:g} s lies outside the 95 % band of {count} simulated replicas: "
        f"{'; '.join(outside)}: {why}."
    )


def growth_panels(part: RecordedPart, key: str) -> Iterator[Panel]:
    """Draw North and East error over the time without fixes, and the horizontal one on logarithmic axes."""
    windows, curve = part.windows, part.curve
    error = components(windows)[0]
    for name in ("north", "east", "horizontal"):
        i, both = COMPONENTS.index(name), name != "horizontal"
        curves = thin_lines("each window", list(zip(windows.elapsed, error[:, :, i], strict=True)), _WINDOWS, _POINTS)
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
            log_x=not both,
            log_y=not both,
            limits=limits,
            height=260,
        )


def _sums(part: RecordedPart, i: int, sign: float) -> list[Curve]:
    """RMS with its interval, predicted sd, and the band of the replicas, to one side of zero."""
    curve, curves = part.curve, []
    if part.replicas is not None:
        low, high = (sign * each[:, i] for each in part.replicas.band)
        curves.append(Curve("simulated replicas", part.replicas.times, high, ORANGE, "band", low))
    if np.isfinite(curve.low[:, i]).any():
        low, high = sign * curve.low[:, i], sign * curve.high[:, i]
        curves.append(Curve("recorded RMS", curve.times, high, BLUE, "band", low))
    curves.append(Curve("recorded RMS", curve.times, sign * curve.corrected[:, i], BLUE))
    return [*curves, Curve("predicted sd", curve.times, sign * curve.predicted[:, i], BLACK, "dashed")]


def causes_panels(part: RecordedPart, key: str) -> Iterator[Panel]:
    """Draw velocity, effective acceleration and drift of each window that was fitted, with the filter's sd."""
    diagnosis = part.diagnosis
    windows = diagnosis.windows
    since = windows.start - windows.start[0]
    ends = np.array([since.min(), since.max()])
    across = f"start of the window, since {windows.start[0]:.1f} s [s]"
    note = "at rest or straight" if diagnosis.steady else "turns included, in which no curve is pure"
    for row, name in enumerate(CAUSES):
        for axis in diagnosis.axes:
            unit = FACTORS[windows_quantities.UNITS[name]][1]
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
                f"{axis.axis.capitalize()} {name}: error grows with {windows_quantities.GROWS[name]}",
                f"{name} [{windows_quantities.UNITS[name]}]",
                across,
                tuple(each for each in curves if len(each.x)),
                f"{key}_causes",
                note,
            )


def regression_panel(part: RecordedPart, key: str) -> Panel:
    """Draw the size of North and East errors over what was predicted for them."""
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
        log_x=True,
        log_y=True,
        height=320,
    )
