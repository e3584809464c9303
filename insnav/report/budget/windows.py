"""Report of the recorded outage windows of an error budget: sentences, warnings, tables for page and ``run.json``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart, Replicas, Verdict
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis, Cause, Diagnosis, SensorFit
from insnav.errors.outage.gnss_outage import COMPONENTS, Growth, common_error
from insnav.findings import Code, Finding, Severity, of_code
from insnav.messages import sentence, word
from insnav.quantity import Quantity
from insnav.report.outage.page import corrected, corrected_text
from insnav.report.page import Section, one_each, only_json
from insnav.report.style import number
from insnav.report.tables import of_table
from insnav.units import UNITS

CALIBRATED, UNCALIBRATED = "calibrated", "uncalibrated"
CAUSE_UNITS = {"velocity": "mm/s", "acceleration": "mg", "drift": "deg/h"}
GROWS = {"velocity": "t", "acceleration": "t²", "drift": "t³"}
_MRAD = 1e-3
_ENOUGH_REPLICAS = 10  # smallest number of simulated replicas for a conclusive band


def windows_sentences(budget: RecordedBudget) -> tuple[str, ...]:
    """Summarise the recorded windows in sentences: explained errors, causes, agreement with simulated replicas."""
    lines = []
    for kind, part in parts_of(budget):
        windows = part.windows
        left_out = ", ".join(f"{count} {word(reason)}" for reason, count in windows.dropped.items())
        lines.append(
            f"{kind.capitalize()}: {windows.count} windows of {windows.length:g} s, effective sample size "
            f"{part.growth.effective:.0f}; {f'left out: {left_out}' if left_out else 'none touches a gap'}."
        )
        lines += [_verdict(each, windows.length) for each in part.verdicts]
        lines += [_diagnosed(axis, part.diagnosis) for axis in part.diagnosis.axes]
        lines += [*map(sentence, common_error(part.growth)), *filter(None, [regression_text(part)])]
        if part.replicas is not None:
            lines.append(_against_replicas(part.replicas))
    return tuple(lines)


def windows_warnings(budget: RecordedBudget) -> tuple[Finding, ...]:
    """Return warnings: unusable windows, smoothed start, unexplained errors, errors outside the replica band."""
    issues = [each for each in budget.notes if each.severity is Severity.UNUSABLE]
    issues += of_code(budget.notes, Code.BUDGET_SMOOTHED_START)
    for kind, part in parts_of(budget):
        unexplained_parts = [each for each in part.verdicts if not each.explained]
        if unexplained_parts:
            names = tuple(each.component for each in unexplained_parts)
            largest, length = max(each.recorded for each in unexplained_parts), part.windows.length
            unexplained = Code.BUDGET_UNEXPLAINED
            issues.append(Finding.of(unexplained, subject=kind, recorded_m=largest, length_s=length, components=names))
        if part.replicas is not None and not part.replicas.agree:
            count = len(part.replicas.rms)
            issues.append(Finding.of(Code.BUDGET_OUTSIDE_REPLICAS, subject=kind, replicas=count))
    replicas = budget.calibrated.replicas
    return (*issues, *(() if replicas is None else replicas.apart.doubts))


def windows_assumptions(budget: RecordedBudget) -> tuple[Finding, ...]:
    """Return findings on the assumptions of the evaluation of recorded windows."""
    return (
        Finding.of(Code.WINDOWS_START, state="filtered" if budget.settings.start == "forward" else "smoothed"),
        Finding.of(Code.WINDOWS_REFERENCE, reference=budget.reference),
        Finding.of(Code.WINDOWS_PREDICTED),
        Finding.of(Code.WINDOWS_ALONG_CROSS),
        Finding.of(Code.WINDOWS_LEVEL),
    )


def _verdict(each: Verdict, length: float) -> str:
    verdict = "explained" if each.explained else "unexplained"
    if each.cautious:
        verdict += "; less than predicted: the stated errors are cautious"
    elif not each.explained and each.predicted > 0.0:
        verdict += f", {number(each.recorded / each.predicted, 2)} times as large"
    return (
        f"{each.component.capitalize()} after {length:g} s: recorded "
        f"{corrected_text(each.recorded, each.low, each.high)}, predicted {number(each.predicted)} m by the filter for "
        f"all windows: {verdict}."
    )


def _diagnosed(axis: AxisDiagnosis, diagnosis: Diagnosis) -> str:
    """Describe the main cause of the error on an axis: "East error is t² (80 %): 0.42 mrad of tilt or ..."."""
    name, cause = CAUSES[axis.leading], axis.causes[axis.leading]
    unit = CAUSE_UNITS[name]
    if cause.rms == 0.0:
        return f"{axis.axis.capitalize()} error is within sensor noise and reference error: no curve stands out."
    value = number(cause.rms / UNITS[unit][1])
    equivalent = {
        "velocity": f"{value} {unit} of velocity at the start",
        "acceleration": f"{number(cause.rms / diagnosis.gravity / _MRAD)} mrad of tilt or {value} {unit} of bias",
        "drift": f"{value} {unit} of drift about the {'east' if axis.axis == 'north' else 'north'} axis",
    }[name]
    text = f"{axis.axis.capitalize()} error is {GROWS[name]} ({100.0 * cause.share:.0f} %): {equivalent}, RMS"
    if not diagnosis.steady:
        return f"{text}, over windows with turns, in which no curve is pure."
    text += f"; filter sd {number(cause.filter_sd / UNITS[unit][1])} {unit}: {explained_text(cause)}"
    if name == "acceleration":
        text += "; in a straight window only the sum of bias and tilt is observable"
    return f"{text}."


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
        "this recording is worse than the stated IMU and fix errors; these omit vibration and mounting, for example"
        if larger
        else "this recording is better than the stated IMU and fix errors"
    )
    return (
        f"Recorded error after {last:g} s lies outside the 95 % band of {count} simulated replicas: "
        f"{'; '.join(outside)}: {why}."
    )


def parts_of(budget: RecordedBudget) -> list[tuple[str, RecordedPart]]:
    """Return the names and results of calibrated windows, and of uncalibrated windows if they were requested."""
    parts = [(CALIBRATED, budget.calibrated)]
    return parts if budget.uncalibrated is None else [*parts, (UNCALIBRATED, budget.uncalibrated)]


def windows_sections(budget: RecordedBudget) -> tuple[Section, ...]:
    """Build the quantities and tables of calibrated and uncalibrated windows."""
    independent, notes = budget.settings.start == "forward", tuple(map(sentence, budget.notes))
    settings = (
        *of_table("budget.recorded_windows", budget, independent=independent, notes=notes),
        *((Quantity(UNCALIBRATED, None),) if budget.uncalibrated is None else ()),
    )
    parts = tuple(Section(kind, parts=_sections(kind, part)) for kind, part in parts_of(budget))
    return (Section("recorded_windows", parts=(only_json("", *settings), *parts)),)


def _sections(kind: str, part: RecordedPart) -> tuple[Section, ...]:
    found = part.growth
    motions = {name: () if each is None else _growth(each) for name, each in part.motions.items()}
    verdicts = {each.component: of_table("budget.verdict", each) for each in part.verdicts}
    in_json = (
        one_each("by_motion", "", motions),
        one_each("verdicts", "", verdicts),
        Section("regression", items=of_table("budget.regression", part.regression)),
    )
    return (
        only_json("", *of_table("budget.windows", part), *_growth(found), parts=in_json),
        _over_time(kind, found),
        _at_end(kind, part),
        _by_motion(kind, part),
        _causes(kind, part.diagnosis),
        _sensors(kind, part.sensors),
        _replicas(part.replicas),
    )


def _by_component(table: str, found: object) -> Iterator[Quantity]:
    """Build the quantities of a table from values per component, such as north; each becomes a mapping by name."""
    for each in of_table(table, found):
        yield replace(each, value=dict(zip(COMPONENTS, np.asarray(each.value).T, strict=False)))


def _growth(found: Growth) -> tuple[Quantity, ...]:
    about = of_table("budget.growth", found, known=[int(n) for n in found.known[:, found.column("horizontal")]])
    return *about, *_by_component("budget.growth_by_component", found)


def _components(found: Growth) -> list[tuple[int, str]]:
    """Return column and name of each component with a known error; along and cross are unknown when stationary."""
    return [(i, name) for i, name in enumerate(COMPONENTS) if np.isfinite(found.rms[:, i]).any()]


def _over_time(kind: str, found: Growth) -> Section:
    figures = np.stack([found.rms, found.p95, found.largest], axis=-1)
    rows = tuple(
        (Quantity("error", name), *(Quantity(f"{t:g} s", figures[k, i]) for k, t in enumerate(found.times)))
        for i, name in _components(found)
    )
    counts = ", ".join(map(str, found.known[:, found.column("horizontal")]))
    note = f"errors of the reference in all three; windows: {counts}"
    return Section("", f"Recorded error, {kind}: RMS, 95 %, largest [m]", rows=rows, note=note)


def _rms(found: Growth, i: int) -> tuple[Quantity, ...]:
    """Build RMS error, reference sd, RMS without reference variance, and predicted sd of component `i` at the end."""
    size, reference, predicted = (float(each[-1, i]) for each in (found.rms, found.reference, found.predicted))
    first, second, last = of_table("budget.rms", rms=size, reference=reference, predicted=predicted)
    return first, second, corrected(found, i), last


def _at_end(kind: str, part: RecordedPart) -> Section:
    growth, rows = part.growth, []
    for i, name in _components(growth):
        rms, predicted = float(growth.corrected[-1, i]), float(growth.predicted[-1, i])
        row = [
            Quantity("error", name),
            *_rms(growth, i),
            Quantity("ratio", rms / predicted if predicted > 0.0 else None, meaning="corrected / predicted"),
            Quantity("inside", f"{100.0 * growth.inside[-1, i]:.0f} %", meaning="inside 3 sd"),
        ]
        if part.replicas is not None:
            low, high = (float(each[-1, i]) for each in part.replicas.band)
            row.append(Quantity("band", interval_text(low, high), "m", meaning="simulated replicas, 95 % band"))
        rows.append(tuple(row))
    title = f"Recorded and predicted error after {growth.times[-1]:g} s, {kind}"
    return Section("", title, rows=tuple(rows), note=regression_text(part))


def interval_text(low: float, high: float) -> str:
    """Write an interval, or "too few windows" if an end is unknown."""
    return f"{number(low)} … {number(high)}" if np.isfinite(low) and np.isfinite(high) else "too few windows"


def regression_text(part: RecordedPart) -> str:
    """Write a sentence with the slope of recorded over predicted errors at all times, and its interval."""
    line = part.regression
    times = f"{number(line.slope)} times predicted ({interval_text(line.low, line.high)})"
    return f"Over all times recorded errors are {times}, R² {line.r_squared:.2f}."


def _by_motion(kind: str, part: RecordedPart) -> Section:
    i = COMPONENTS.index("horizontal")
    rows = []
    for name, growth in part.motions.items():
        if growth is not None:
            *about, largest = of_table("budget.motion", growth, windows=name, largest=float(growth.largest[-1, i]))
            rows.append((*about, *_rms(growth, i), largest))
    title = f"By motion, horizontal error after {part.growth.times[-1]:g} s, {kind}"
    note = "turning: heading changes by more than 15 deg; static: below 0.5 m/s throughout"
    return Section("", title, rows=tuple(rows), note=note)


def _causes(kind: str, diagnosis: Diagnosis) -> Section:
    summary = of_table("budget.diagnosis", diagnosis)
    motion = "windows at rest or straight" if diagnosis.steady else "windows, turns included"
    note = (
        "1 mg of acceleration is the effect of 1 mrad of tilt; in a straight window only their sum is observable"
        if diagnosis.steady
        else "too few windows are straight; in a turn no sensor error follows a single curve: averages only"
    )
    if diagnosis.rough:
        note += f"; left out: {diagnosis.rough} windows whose error is no such curve, as if the reference jumped"
    axes = tuple(only_json(axis.axis, parts=_axis(axis)) for axis in diagnosis.axes)

    def verdict(cause: Cause) -> Quantity:
        return Quantity("verdict", explained_text(cause) if diagnosis.steady else "–")

    rows = tuple(
        (Quantity("cause", f"{axis.axis}, {GROWS[name]}: {name}"), *_cause(name, cause), verdict(cause))
        for axis in diagnosis.axes
        for name, cause in zip(CAUSES, axis.causes, strict=True)
    )
    title = f"Equivalent errors of {diagnosis.windows.count} {motion}, {kind}"
    table = Section("", title, rows=rows, note=note)
    return Section("diagnosis", parts=(only_json("", *summary), *axes, table))


def _axis(axis: AxisDiagnosis) -> tuple[Section, ...]:
    about = (Quantity("terms", axis.terms), Quantity("leading", GROWS[CAUSES[axis.leading]]))
    causes = {
        name: (*_cause(name, cause), Quantity("explained", cause.explained))
        for name, cause in zip(CAUSES, axis.causes, strict=True)
    }
    return (Section("", items=about), one_each("", "", causes))


def _cause(name: str, cause: Cause) -> tuple[Quantity, ...]:
    sizes = (replace(each, unit=CAUSE_UNITS[name]) for each in of_table("budget.cause", cause))
    return *sizes, Quantity("share", cause.share, meaning="share at the end")


def explained_text(cause: Cause) -> str:
    """Write whether the predicted sd explains a cause; if not, also by which factor the cause exceeds it."""
    return "explained" if cause.explained else f"unexplained, {number(float(np.sqrt(cause.ratio)), 2)} times"


def _sensors(kind: str, fit: SensorFit) -> Section:
    note = (
        "headings differ: bias and tilt are separately observable over the drive"
        if fit.level_observable
        else "headings hardly differ: of the level accelerometers this is bias and tilt together"
    )
    if fit.spread > 2.0:
        note += f"; misfit {number(float(np.sqrt(fit.spread)), 2)} times the expectation by noise and filter"
    items = of_table("budget.sensors", fit)
    in_json = (Quantity("misfit", fit.spread), Quantity("bias_observable_from_tilt", fit.level_observable))
    title = f"Constant sensor errors left in the windows, {kind}"
    return Section("sensors", title, items, parts=(only_json("", *in_json),), note=note)


def _replicas(made: Replicas | None) -> Section:
    if made is None:
        return only_json("", Quantity("replicas", None))
    about = (Quantity("count", len(made.rms)), Quantity("inside_band", made.agree))
    apart = Quantity("track_apart", made.apart.position, "m"), Quantity("track_apart", made.apart.velocity, "m/s")
    failures = Quantity("failures", {str(each.number): each.error.code for each in made.failures})
    return only_json("replicas", *about, *_by_component("budget.replicas", made), *apart, failures)
