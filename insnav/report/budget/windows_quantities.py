"""The quantities of free-inertial windows of a recorded drive, said once for page and ``run.json``."""

from __future__ import annotations

import numpy as np

from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis, Cause, Diagnosis
from insnav.errors.diagnosis.equivalent_sensor_errors import SensorFit
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS, Growth
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.numbers import number
from insnav.report.outage.windows import corrected
from insnav.report.page import Section, one_each, only_json
from insnav.types import FloatArray

CALIBRATED, UNCALIBRATED = "calibrated", "uncalibrated"
UNITS = {"velocity": "mm/s", "acceleration": "mg", "drift": "deg/h"}
GROWS = {"velocity": "t", "acceleration": "t²", "drift": "t³"}


def parts_of(budget: RecordedBudget) -> list[tuple[str, RecordedPart]]:
    """Windows of both kinds, with their names; uncalibrated ones only if they were asked for."""
    parts = [(CALIBRATED, budget.calibrated)]
    return parts if budget.uncalibrated is None else [*parts, (UNCALIBRATED, budget.uncalibrated)]


def windows_sections(budget: RecordedBudget) -> tuple[Section, ...]:
    """Give the quantities and tables of all windows."""
    about = (
        Quantity("reference", budget.reference),
        Quantity("start", budget.settings.start),
        Quantity("independent", budget.settings.start == "forward"),
        Quantity("duration", budget.duration, "s"),
        Quantity("imu", budget.spec.name),
        Quantity("notes", tuple(map(sentence, budget.notes))),
        *((Quantity(UNCALIBRATED, None),) if budget.uncalibrated is None else ()),
    )
    parts = tuple(Section(kind, parts=_sections(kind, part)) for kind, part in parts_of(budget))
    return (Section("recorded_windows", parts=(only_json("", *about), *parts)),)


def _sections(kind: str, part: RecordedPart) -> tuple[Section, ...]:
    windows, found, line = part.windows, part.growth, part.regression
    about = (
        Quantity("windows", windows.count),
        Quantity("length", windows.length, "s"),
        Quantity("spacing", windows.spacing, "s"),
        Quantity("dropped", windows.dropped),
        *_growth(found),
    )
    motions = {name: () if each is None else _growth(each) for name, each in part.motions.items()}
    verdicts = {
        each.component: (
            Quantity("rms_corrected", each.recorded, "m", interval=(each.low, each.high)),
            Quantity("predicted", each.predicted, "m"),
            Quantity("explained", each.explained),
            Quantity("cautious", each.cautious),
        )
        for each in part.verdicts
    }
    regression = (Quantity("slope", line.slope, interval=(line.low, line.high)), Quantity("r_squared", line.r_squared))
    in_json = (
        one_each("by_motion", "", motions),
        one_each("verdicts", "", verdicts),
        Section("regression", items=regression),
    )
    return (
        only_json("", *about, parts=in_json),
        _over_time(kind, found),
        _at_end(kind, part),
        _by_motion(kind, part),
        _causes(kind, part.diagnosis),
        _sensors(kind, part.sensors),
        _replicas(part.replicas),
    )


def _named(key: str, values: FloatArray, unit: str = "") -> Quantity:
    """A figure of every component."""
    return Quantity(key, {name: values[:, i] for i, name in enumerate(COMPONENTS)}, unit)


def _growth(found: Growth) -> tuple[Quantity, ...]:
    return (
        Quantity("times", found.times, "s"),
        Quantity("count", found.count),
        Quantity("known", [int(n) for n in found.known[:, found.column("horizontal")]]),
        Quantity("effective", found.effective),
        _named("rms", found.rms, "m"),
        _named("rms_corrected", found.corrected, "m"),
        _named("rms_corrected_low", found.low, "m"),
        _named("rms_corrected_high", found.high, "m"),
        _named("common", found.common),
        _named("p95", found.p95, "m"),
        _named("max", found.largest, "m"),
        _named("reference_sd", found.reference, "m"),
        _named("predicted", found.predicted, "m"),
        _named("inside_3_sd", found.inside),
    )


def _components(found: Growth) -> list[tuple[int, str]]:
    """Components of which something is known; along and across there is nothing at rest."""
    return [(i, name) for i, name in enumerate(COMPONENTS) if np.isfinite(found.rms[:, i]).any()]


def _over_time(kind: str, found: Growth) -> Section:
    figures = np.stack([found.rms, found.p95, found.largest], axis=-1)
    rows = tuple(
        (Quantity("error", name), *(Quantity(f"{t:g} s", figures[k, i]) for k, t in enumerate(found.times)))
        for i, name in _components(found)
    )
    known = ", ".join(map(str, found.known[:, found.column("horizontal")]))
    note = f"errors of the reference in all three; windows: {known}"
    return Section("", f"Recorded error, {kind}: RMS, 95 %, largest [m]", rows=rows, note=note)


def _rms(found: Growth, i: int) -> tuple[Quantity, ...]:
    """RMS as measured and without the reference, with its interval, and prediction, at the end of the windows."""
    return (
        Quantity("rms", float(found.rms[-1, i]), "m", meaning="RMS"),
        Quantity("reference", float(found.reference[-1, i]), "m", meaning="reference sd"),
        corrected(found, i),
        Quantity("predicted", float(found.predicted[-1, i]), "m", meaning="predicted sd"),
    )


def _at_end(kind: str, part: RecordedPart) -> Section:
    found, rows = part.growth, []
    for i, name in _components(found):
        rms, predicted = float(found.corrected[-1, i]), float(found.predicted[-1, i])
        row = [
            Quantity("error", name),
            *_rms(found, i),
            Quantity("ratio", rms / predicted if predicted > 0.0 else None, meaning="corrected / predicted"),
            Quantity("inside", f"{100.0 * found.inside[-1, i]:.0f} %", meaning="inside 3 sd"),
        ]
        if part.replicas is not None:
            low, high = (float(each[-1, i]) for each in part.replicas.band)
            row.append(Quantity("band", interval_text(low, high), "m", meaning="simulated replicas, 95 % band"))
        rows.append(tuple(row))
    title = f"Recorded and predicted error after {found.times[-1]:g} s, {kind}"
    return Section("", title, rows=tuple(rows), note=regression_text(part))


def interval_text(low: float, high: float) -> str:
    """Write an interval."""
    return f"{number(low)} … {number(high)}" if np.isfinite(low) and np.isfinite(high) else "too few windows"


def regression_text(part: RecordedPart) -> str:
    """Say how recorded and predicted errors compare over all times."""
    line = part.regression
    times = f"{number(line.slope)} times predicted ({interval_text(line.low, line.high)})"
    return f"Over all times recorded errors are {times}, R² {line.r_squared:.2f}."


def _by_motion(kind: str, part: RecordedPart) -> Section:
    i = COMPONENTS.index("horizontal")
    rows = [
        (
            Quantity("windows", name),
            Quantity("count", found.count),
            Quantity("effective", found.effective, meaning="effective sample size"),
            *_rms(found, i),
            Quantity("largest", float(found.largest[-1, i]), "m"),
        )
        for name, found in part.motions.items()
        if found is not None
    ]
    title = f"By motion, horizontal error after {part.growth.times[-1]:g} s, {kind}"
    note = "turning: heading changes by more than 15 deg; static: below 0.5 m/s throughout"
    return Section("", title, rows=tuple(rows), note=note)


def _causes(kind: str, diagnosis: Diagnosis) -> Section:
    about = (
        Quantity("windows", diagnosis.windows.count),
        Quantity("set_aside", diagnosis.rough),
        Quantity("steady", diagnosis.steady),
    )
    which = "windows at rest or straight" if diagnosis.steady else "windows, turns included"
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
    title = f"Equivalent errors of {diagnosis.windows.count} {which}, {kind}"
    table = Section("", title, rows=rows, note=note)
    return Section("diagnosis", parts=(only_json("", *about), *axes, table))


def _axis(axis: AxisDiagnosis) -> tuple[Section, ...]:
    about = (Quantity("terms", axis.terms), Quantity("leading", GROWS[CAUSES[axis.leading]]))
    causes = {
        name: (*_cause(name, cause), Quantity("explained", cause.explained))
        for name, cause in zip(CAUSES, axis.causes, strict=True)
    }
    return (Section("", items=about), one_each("", "", causes))


def _cause(name: str, cause: Cause) -> tuple[Quantity, ...]:
    unit = UNITS[name]
    return (
        Quantity("rms", cause.rms, unit, meaning="RMS"),
        Quantity("mean", cause.mean, unit, sd=cause.mean_sd),
        Quantity("fit_sd", cause.fit_sd, unit, meaning="sd of one fit"),
        Quantity("filter_sd", cause.filter_sd, unit, meaning="filter sd"),
        Quantity("specified", cause.spec_sd, unit, meaning="IMU specification"),
        Quantity("share", cause.share, meaning="share at the end"),
    )


def explained_text(cause: Cause) -> str:
    """Say whether a cause is explained."""
    return "explained" if cause.explained else f"unexplained, {number(float(np.sqrt(cause.ratio)), 2)} times"


def _sensors(kind: str, fit: SensorFit) -> Section:
    note = (
        "headings differ: bias and tilt are separately observable over the drive"
        if fit.level_observable
        else "headings hardly differ: of the level accelerometers this is bias and tilt together"
    )
    if fit.spread > 2.0:
        note += f"; misfit {number(float(np.sqrt(fit.spread)), 2)} times what noise and filter allow"
    items = (
        Quantity("accel_bias", fit.accel, "mg", sd=fit.accel_sd, meaning="accelerometer bias x, y, z"),
        Quantity("gyro_bias", fit.gyro, "deg/h", sd=fit.gyro_sd, meaning="gyro bias x, y, z"),
    )
    more = (Quantity("misfit", fit.spread), Quantity("bias_observable_from_tilt", fit.level_observable))
    title = f"Constant sensor errors left in the windows, {kind}"
    return Section("sensors", title, items, parts=(only_json("", *more),), note=note)


def _replicas(made: Replicas | None) -> Section:
    if made is None:
        return only_json("", Quantity("replicas", None))
    return only_json(
        "replicas",
        Quantity("count", len(made.rms)),
        Quantity("inside_band", made.agree),
        _named("low", made.low, "m"),
        _named("high", made.high, "m"),
        _named("recorded", made.recorded, "m"),
        Quantity("track_apart", made.apart.position, "m"),
        Quantity("track_apart", made.apart.velocity, "m/s"),
        Quantity("failures", made.failures),
    )
