"""Tables, figures and sentences of the recorded half of an error budget."""

from __future__ import annotations

import math

import numpy as np

from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart, Verdict
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis, Cause, Diagnosis
from insnav.errors.diagnosis.equivalent_sensor_errors import SensorFit
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS, Growth
from insnav.report.budget.windows_figures import draw_causes, draw_growth, draw_regression
from insnav.report.budget.windows_quantities import GROWS, MG, UNITS
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG_PER_H

CALIBRATED, RAW = "calibrated", "sensors as turned on"
_MRAD = 1e-3

_ENOUGH_TWINS = 10  # whose band is narrow enough to prove something


def recorded_tables(budget: RecordedBudget) -> tuple[Table, ...]:
    """Tables of both kinds of windows.

    Parameters
    ----------
    budget : RecordedBudget
    """
    return tuple(table for kind, part in _parts(budget) for table in _tables(kind, part))


def recorded_pictures(budget: RecordedBudget) -> tuple[Picture, ...]:
    """Growth, causes and regression of both kinds of windows, drawn.

    Parameters
    ----------
    budget : RecordedBudget
    """
    pictures = []
    with drawing():
        for kind, part in _parts(budget):
            name = "raw" if part.windows.uncalibrated else "recorded"
            pictures += [
                Picture(
                    f"{name}_growth", draw_growth(part, kind, budget.reference), f"Recorded error without GPS, {kind}"
                ),
                Picture(f"{name}_causes", draw_causes(part, kind), f"What each window errs by, {kind}"),
                Picture(f"{name}_regression", draw_regression(part, kind), f"Recorded over predicted error, {kind}"),
            ]
    return tuple(pictures)


def recorded_sentences(budget: RecordedBudget) -> tuple[str, ...]:
    """The result in sentences: explained or not, by what, and what the twins say.

    Parameters
    ----------
    budget : RecordedBudget
    """
    lines = []
    for kind, part in _parts(budget):
        windows = part.windows
        left_out = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items())
        lines.append(
            f"{kind[0].upper()}{kind[1:]}: {windows.count} windows of {windows.length:g} s, as good as "
            f"{part.growth.effective:.0f} that do not overlap"
            + (f"; left out: {left_out}" if left_out else "; none touches a gap")
            + "."
        )
        lines += [_verdict(each, windows.length) for each in part.verdicts]
        lines += [_diagnosed(axis, part.diagnosis) for axis in part.diagnosis.axes]
        lines.append(_regressed(part))
        if part.replicas is not None:
            lines.append(_against_twins(part.replicas))
    return tuple(lines)


def recorded_warnings(budget: RecordedBudget) -> tuple[str, ...]:
    """What the reader must not overlook.

    Parameters
    ----------
    budget : RecordedBudget
    """
    lines = [note for note in budget.notes if note.startswith("Not independent")]
    for kind, part in _parts(budget):
        wrong = [each.component for each in part.verdicts if not each.explained]
        if wrong:
            lines.append(
                f"{kind}: the error {', '.join(wrong)} is larger than predicted, and not explained by what is stated "
                "of IMU and fixes"
            )
        if part.replicas is not None and not part.replicas.agree:
            lines.append(f"{kind}: recorded error outside the band of the simulated twins: see the summary")
    made = budget.calibrated.replicas
    if made is not None:
        lines += made.apart.doubts
    return tuple(lines)


def recorded_assumptions(budget: RecordedBudget) -> tuple[str, ...]:
    """What was taken for granted.

    Parameters
    ----------
    budget : RecordedBudget
    """
    begin = "the forward filter" if budget.settings.start == "forward" else "the smoothed drive"
    lines = [
        f"Each window begins with the state of {begin} at its first epoch and goes on without fixes, wheels or rest; "
        "it is not aligned again to anything.",
        f"Errors are against {budget.reference}; from the RMS the variance that these state themselves is taken off, "
        "quantiles and largest errors are as they are.",
        "Predicted is the covariance of that first state and the noise inside the window; with sensors as turned on, "
        "the turn-on figures of the IMU stand for the sensor errors in it.",
        "Intervals hold with 95 %: blocks of windows as long as the overlap, drawn anew.",
        "Along and cross are by the direction of travel of the whole drive, straight across stops; at rest there is "
        "none.",
        "Curves are t, t² and t³ of a level vehicle that does not turn: tilt and bias of the accelerometers make the "
        "same t² there, and only their sum can be given.",
    ]
    return (*lines, *(note for note in budget.notes if not note.startswith("Not independent")))


def recorded_sheet(budget: RecordedBudget, name: str) -> Sheet:
    """Put everything on one page.

    Parameters
    ----------
    budget : RecordedBudget
    name : str
        The drive.
    """
    return Sheet(
        f"Recorded error without GPS: {name}",
        recorded_sentences(budget),
        recorded_tables(budget),
        recorded_pictures(budget),
        recorded_assumptions(budget),
        recorded_warnings(budget),
    )


def _parts(budget: RecordedBudget) -> list[tuple[str, RecordedPart]]:
    parts = [(CALIBRATED, budget.calibrated)]
    return parts if budget.uncalibrated is None else [*parts, (RAW, budget.uncalibrated)]


def _tables(kind: str, part: RecordedPart) -> list[Table]:
    found = part.growth
    names = [(i, name) for i, name in enumerate(COMPONENTS) if np.isfinite(found.total_rms[:, i]).any()]
    known = found.known[:, found.column("horizontal")]
    at_end = f"{found.times[-1]:g} s"
    band = [] if part.replicas is None else ["twins, 95 % band [m]"]
    return [
        Table(
            f"Recorded error, {kind}: RMS / 95 % / largest [m]",
            ("", *(f"{time:g} s" for time in found.times)),
            tuple((name, *(_three(found, k, i) for k in range(len(found.times)))) for i, name in names),
            f"windows judged at each time: {', '.join(map(str, known))}",
        ),
        Table(
            f"Recorded and predicted after {at_end}, {kind}",
            ("", "RMS [m]", "interval [m]", "predicted [m]", "recorded / predicted", "inside 3 sd", *band),
            tuple((name, *_against_predicted(found, i, part.replicas)) for i, name in names),
            _regressed(part),
        ),
        Table(
            f"By motion, horizontal error after {at_end}, {kind}",
            ("windows", "count", "not overlapping", "RMS [m]", "interval [m]", "predicted [m]", "largest [m]"),
            tuple(_motion_row(name, found) for name, found in part.motions.items()),
            "turning: the heading leaves 15 deg; static: below 0.5 m/s throughout",
        ),
        _cause_table(kind, part.diagnosis),
        _sensor_table(kind, part.sensors),
    ]


def _three(found: Growth, k: int, i: int) -> str:
    values = (found.rms[k, i], found.p95[k, i], found.largest[k, i])
    return "–" if not all(math.isfinite(v) for v in values) else " / ".join(number(float(v)) for v in values)


def _against_predicted(found: Growth, i: int, made: Replicas | None) -> tuple[str, ...]:
    rms, predicted = float(found.rms[-1, i]), float(found.predicted[-1, i])
    cells = [
        number(rms),
        _interval(float(found.low[-1, i]), float(found.high[-1, i])),
        number(predicted),
        number(rms / predicted) if predicted > 0.0 else "–",
        f"{100.0 * found.inside[-1, i]:.0f} %",
    ]
    if made is not None:
        low, high = made.band
        cells.append(_interval(float(low[-1, i]), float(high[-1, i])))
    return tuple(cells)


def _interval(low: float, high: float) -> str:
    return f"{number(low)} … {number(high)}" if math.isfinite(low) and math.isfinite(high) else "too few"


def _motion_row(name: str, found: Growth | None) -> tuple[str, ...]:
    if found is None:
        return (name, "0", *("–",) * 5)
    i = COMPONENTS.index("horizontal")
    return (
        name,
        str(found.count),
        f"{found.effective:.1f}",
        number(float(found.rms[-1, i])),
        _interval(float(found.low[-1, i]), float(found.high[-1, i])),
        number(float(found.predicted[-1, i])),
        number(float(found.largest[-1, i])),
    )


def _cause_table(kind: str, diagnosis: Diagnosis) -> Table:
    rows = []
    for axis in diagnosis.axes:
        for name, cause in zip(CAUSES, axis.causes, strict=True):
            unit, text = UNITS[name]
            rows.append(
                (
                    f"{axis.axis}, {GROWS[name]}: {name} [{text}]",
                    number(cause.rms / unit),
                    f"{number(cause.mean / unit)} ± {number(cause.mean_sd / unit, 2)}",
                    number(cause.fit_sd / unit),
                    number(cause.filter_sd / unit),
                    number(cause.spec_sd / unit) if math.isfinite(cause.spec_sd) else "–",
                    f"{100.0 * cause.share:.0f} %",
                    _explained(cause) if diagnosis.steady else "–",
                )
            )
    which = "windows at rest or straight" if diagnosis.steady else "windows, turns and all"
    note = (
        "1 mg of acceleration is what 1 mrad of tilt makes; the two cannot be told apart in a straight window"
        if diagnosis.steady
        else "too few windows are straight; in a turn a sensor's error follows no curve, so these are averages only"
    )
    if diagnosis.rough:
        note += f"; set aside: {diagnosis.rough} windows whose error is no such curve, as if what judges them jumped"
    return Table(
        f"What {diagnosis.windows.count} {which} err by, {kind}",
        ("", "RMS", "mean", "sd of one fit", "filter's sd", "IMU's figure", "share of the end", "verdict"),
        tuple(rows),
        note,
    )


def _sensor_table(kind: str, fit: SensorFit) -> Table:
    rows = []
    for i, axis in enumerate("xyz"):
        rows.append(
            (
                axis,
                f"{number(float(fit.accel[i]) / MG)} ± {number(float(fit.accel_sd[i]) / MG, 2)}",
                f"{number(float(fit.gyro[i]) / DEG_PER_H)} ± {number(float(fit.gyro_sd[i]) / DEG_PER_H, 2)}",
            )
        )
    note = (
        "headings differ: bias and tilt are told apart over the drive"
        if fit.level_observable
        else "headings hardly differ: of the level accelerometers this is bias and tilt together"
    )
    if fit.spread > 2.0:
        note += f"; the fit leaves {number(math.sqrt(fit.spread), 2)} times what noise and filter allow"
    return Table(
        f"Constant sensor errors left in the windows, {kind}",
        ("body axis", "accelerometer [mg]", "gyro [deg/h]"),
        tuple(rows),
        note,
    )


def _explained(cause: Cause) -> str:
    return "explained" if cause.explained else f"unexplained, {number(math.sqrt(cause.ratio), 2)} times"


def _verdict(each: Verdict, length: float) -> str:
    interval = _interval(each.low, each.high)
    words = "explained" if each.explained else "unexplained"
    if each.cautious:
        words += "; less than predicted: the stated figures are cautious"
    elif not each.explained and each.predicted > 0.0:
        words += f", {number(each.recorded / each.predicted, 2)} times as large"
    return (
        f"{each.component.capitalize()} after {length:g} s: recorded {number(each.recorded)} m RMS ({interval} m), "
        f"predicted {number(each.predicted)} m: {words}."
    )


def _diagnosed(axis: AxisDiagnosis, diagnosis: Diagnosis) -> str:
    """Words such as: east error is t²: 0.42 mrad of tilt or 0.41 mg of bias."""
    name, cause = CAUSES[axis.leading], axis.causes[axis.leading]
    unit, text = UNITS[name]
    if cause.rms == 0.0:
        return f"{axis.axis.capitalize()} error is within the noise of sensors and judge: no curve stands out."
    value = number(cause.rms / unit)
    what = {
        "velocity": f"{value} {text} of velocity at the start",
        "acceleration": f"{number(cause.rms / diagnosis.gravity / _MRAD)} mrad of tilt or {value} {text} of bias",
        "drift": f"{value} {text} of drift about the {'east' if axis.axis == 'north' else 'north'} axis",
    }[name]
    line = f"{axis.axis.capitalize()} error is {GROWS[name]} ({100.0 * cause.share:.0f} %): {what}, RMS"
    if not diagnosis.steady:
        return f"{line}, of windows with turns, in which no curve is pure."
    line += f"; the filter stated {number(cause.filter_sd / unit)} {text}: {_explained(cause)}"
    if name == "acceleration":
        line += "; bias and tilt cannot be told apart in a straight window"
    return f"{line}."


def _regressed(part: RecordedPart) -> str:
    line = part.regression
    return (
        f"Over all times, the mean size of the error is {number(line.slope)} times that of the prediction "
        f"({_interval(line.low, line.high)}), "
        f"R² {line.r_squared:.2f}."
    )


def _against_twins(made: Replicas) -> str:
    count, last = len(made.rms), made.times[-1]
    if made.agree:
        return (
            f"Recorded error after {last:g} s lies in the 95 % band of {count} simulated twins: what is stated of "
            "IMU and fixes describes this recording."
            if count >= _ENOUGH_TWINS
            else f"Recorded error after {last:g} s lies in the band of {count} simulated twins, but so few make a band "
            f"so wide that it proves little: {_ENOUGH_TWINS} or more are needed."
        )
    outside, larger = [], False
    for i, name in enumerate(COMPONENTS[:3]):
        if not made.inside[-1, i]:
            larger |= bool(made.recorded[-1, i] > made.high[-1, i])
            band = _interval(float(made.low[-1, i]), float(made.high[-1, i]))
            outside.append(f"{name} {number(float(made.recorded[-1, i]))} m, band {band} m")
    why = (
        "this recording is worse than what is stated of IMU and fixes; vibration and mounting, for two, are in no file"
        if larger
        else "this recording is better than what is stated of IMU and fixes"
    )
    return (
        f"Recorded error after {last:g} s lies outside the 95 % band of {count} simulated twins: {'; '.join(outside)}: "
        f"{why}."
    )
