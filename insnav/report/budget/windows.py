"""Sentences, warnings and drawings of the recorded half of an error budget."""

from __future__ import annotations

from insnav.errors.budget.from_windows import RecordedBudget, Verdict
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis, Diagnosis
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS
from insnav.report.budget.windows_panels import causes_panels, growth_panels, regression_panel
from insnav.report.budget.windows_quantities import (
    GROWS,
    UNITS,
    explained_text,
    interval_text,
    parts_of,
    regression_text,
)
from insnav.report.numbers import number
from insnav.report.outage.quantities import INTERVALS, common_text, corrected_text
from insnav.report.page import Section, drawn
from insnav.units import UNITS as FACTORS

_MRAD = 1e-3
_ENOUGH_REPLICAS = 10  # whose band is narrow enough to prove something


def windows_drawings(budget: RecordedBudget) -> tuple[Section, ...]:
    """Growth, equivalent errors and regression of the recorded windows, calibrated and not."""
    sections = []
    for kind, part in parts_of(budget):
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
    for kind, part in parts_of(budget):
        windows = part.windows
        left_out = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items())
        lines.append(
            f"{kind.capitalize()}: {windows.count} windows of {windows.length:g} s, effective sample size "
            f"{part.growth.effective:.0f}; {f'left out: {left_out}' if left_out else 'none touches a gap'}."
        )
        lines += [_verdict(each, windows.length) for each in part.verdicts]
        lines += [_diagnosed(axis, part.diagnosis) for axis in part.diagnosis.axes]
        lines += [line for line in (common_text(part.growth), regression_text(part)) if line]
        if part.replicas is not None:
            lines.append(_against_replicas(part.replicas))
    return tuple(lines)


def windows_warnings(budget: RecordedBudget) -> tuple[str, ...]:
    """Say what the reader must not overlook."""
    lines = [note for note in budget.notes if note.startswith("Not independent")]
    for kind, part in parts_of(budget):
        wrong = [each.component for each in part.verdicts if not each.explained]
        if wrong:
            lines.append(
                f"{kind}: error {', '.join(wrong)} larger than predicted, unexplained by the stated IMU and fix errors"
            )
        if part.replicas is not None and not part.replicas.agree:
            lines.append(f"{kind}: recorded error outside the band of the simulated replicas: see the summary")
    made = budget.calibrated.replicas
    return (*lines, *(() if made is None else made.apart.doubts))


def windows_assumptions(budget: RecordedBudget) -> tuple[str, ...]:
    """Say what was taken for granted."""
    start = "the forward filter" if budget.settings.start == "forward" else "the smoothed drive"
    return (
        f"Each window starts with the state of {start} at its first epoch and goes on without fixes or other aiding, "
        "not aligned again.",
        f"Errors are against {budget.reference}; its variance is subtracted from the corrected RMS, not from "
        "RMS, quantiles and largest errors.",
        "Predicted: covariance of that first state and noise inside the window; uncalibrated: with the turn-on "
        "errors of the IMU specification instead.",
        INTERVALS,
        "Along and cross are relative to the direction of travel, interpolated across stops; at rest there is none.",
        "Curves are t, t² and t³ of a level vehicle that does not turn: accelerometer tilt and bias make the same t², "
        "and only their sum can be given.",
    )


def _verdict(each: Verdict, length: float) -> str:
    words = "explained" if each.explained else "unexplained"
    if each.cautious:
        words += "; less than predicted: the stated errors are cautious"
    elif not each.explained and each.predicted > 0.0:
        words += f", {number(each.recorded / each.predicted, 2)} times as large"
    return (
        f"{each.component.capitalize()} after {length:g} s: recorded "
        f"{corrected_text(each.recorded, each.low, each.high)}, predicted {number(each.predicted)} m: {words}."
    )


def _diagnosed(axis: AxisDiagnosis, diagnosis: Diagnosis) -> str:
    """Words such as: east error is t²: 0.42 mrad of tilt or 0.41 mg of bias."""
    name, cause = CAUSES[axis.leading], axis.causes[axis.leading]
    unit = UNITS[name]
    if cause.rms == 0.0:
        return f"{axis.axis.capitalize()} error is within sensor noise and reference error: no curve stands out."
    value = number(cause.rms / FACTORS[unit][1])
    what = {
        "velocity": f"{value} {unit} of velocity at the start",
        "acceleration": f"{number(cause.rms / diagnosis.gravity / _MRAD)} mrad of tilt or {value} {unit} of bias",
        "drift": f"{value} {unit} of drift about the {'east' if axis.axis == 'north' else 'north'} axis",
    }[name]
    line = f"{axis.axis.capitalize()} error is {GROWS[name]} ({100.0 * cause.share:.0f} %): {what}, RMS"
    if not diagnosis.steady:
        return f"{line}, over windows with turns, in which no curve is pure."
    line += f"; filter sd {number(cause.filter_sd / FACTORS[unit][1])} {unit}: {explained_text(cause)}"
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
            band = interval_text(float(made.low[-1, i]), float(made.high[-1, i]))
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
