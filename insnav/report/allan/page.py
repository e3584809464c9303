"""Report of the noise of a static IMU record, or of other signals: page with Allan deviations, and tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np

from insnav.imu import to_kalibr, to_toml
from insnav.lab.noise.allan import AXES, AllanDeviation, NoiseModel
from insnav.lab.noise.static_noise import KEYS, SignalNoise, StaticNoise
from insnav.messages import phrase
from insnav.output.data_files import csv_text
from insnav.quantity import Quantity, key_suffix
from insnav.report.page import DataFrame, Page, Section, by_warnings, cell, drawn, only_json
from insnav.report.panels import Curve, Panel
from insnav.report.style import AXIS_COLOURS, GREY
from insnav.report.tables import of_section, of_table
from insnav.result import Result
from insnav.types import FloatArray
from insnav.units import M_S_PER_SQRT_H, UG, UNITS

IMU_TOML, IMU_YAML, DEVIATIONS = "imu.toml", "imu.yaml", "allan.csv"
_TIMES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)  # averaging times in the table of Allan deviations [s]
_NEAR = 1.3  # a time of the table is omitted if the nearest computed averaging time differs by more than this factor

# noise coefficient: label, (shown unit, SI unit) of gyros, (shown unit, SI unit) of accelerometers
_TERMS = {
    "Q": ("quantisation Q", ("arcsec", "rad"), ("mm/s", "m/s")),
    "N": ("random walk N", ("deg/sqrt(h)", "rad/sqrt(s)"), ("m/s/sqrt(h)", "m/s/sqrt(s)")),
    "B": ("bias instability B", ("deg/h", "rad/s"), ("ug", "m/s^2")),
    "K": ("rate random walk K", ("deg/h/sqrt(h)", "rad/s/sqrt(s)"), ("ug/sqrt(h)", "m/s^2/sqrt(s)")),
    "GM": ("Gauss-Markov bias, sd", ("deg/h", "rad/s"), ("ug", "m/s^2")),
    "R": ("rate ramp R", ("deg/h/h", "rad/s^2"), ("ug/h", "m/s^3")),
}
_KEYS = KEYS | {"B": "bias_instability", "GM": "gauss_markov"}
_IN_FILE = ("N", "GM", "K", "Q", "R")
NOTE = "points: overlapping Allan deviation; band: 95 %; lines: fitted model; grey: slopes of Q, N, B, K, R"
_GUIDES = ((-1.0, "Q −1"), (-0.5, "N −½"), (0.0, "B 0"), (0.5, "K +½"), (1.0, "R +1"))
_TALL = 2.4  # largest ratio between the end and the middle of a guide line on the vertical axis


def noise_quantity(
    term: str,
    value: float | None,
    sd: float | None = None,
    interval: tuple[float, float] | None = None,
    *,
    gyro: bool = True,
    si: bool = False,
) -> Quantity:
    """Build the quantity of one noise coefficient of a gyro or an accelerometer.

    `term` {"Q", "N", "B", "K", "GM", "R"}: see ``_TERMS``. `si`: show SI units instead of the usual units.
    """
    label, *units = _TERMS[term]
    return Quantity(_KEYS[term], value, units[0 if gyro else 1][1 if si else 0], sd, interval, label)


def page(result: Result[StaticNoise | SignalNoise]) -> Page:
    """Lay out the noise of a static record or of signals."""
    found = result.found
    if isinstance(found, SignalNoise):
        return _signal_page(found)
    allan, facts = found.allan, result.inputs["imu"]
    name = Path(facts.path).name
    axes = [_axis(found, column) for column in range(6)]
    sensors = {
        name: tuple((Quantity("axis", AXES[k][-1]), *axes[k][0].items) for k in columns if len(axes[k]) > 1)
        for name, columns in (("gyros", range(3)), ("accelerometers", range(3, 6)))
    }
    largest_first = (_sizes(found, term, gyro=gyro) for gyro in (True, False) for term in ("N", "B", "K"))
    return Page(
        f"Noise of {name}",
        (_extent(allan),),
        (
            only_json("", Quantity("command", "allan"), Quantity("imu", facts.as_dict())),
            drawn("allan", f"Allan deviation of {name}", allan_panels(found), NOTE),
            only_json("", Quantity("length", allan.length, "s"), Quantity("interval", allan.interval, "s")),
            *(Section("", f"Noise coefficients of the {name}", rows=columns) for name, columns in sensors.items()),
            Section("axes", parts=tuple(part for parts in axes for part in parts)),
            Section("deviations", "Allan deviation", rows=_deviations(found)),
            _filter_figures(found),
        ),
        result.findings,
        tuple(phrase("method.allan").splitlines()),
        verdict=by_warnings(_sentence(found), result.findings, ("good", "noise models follow the Allan deviation")),
        merits=tuple(each for each in largest_first if each is not None),
        merits_note="medians of the three axes; N, B, K: IEEE Std 952",
    )


def _extent(allan: AllanDeviation) -> str:
    tau = allan.tau
    return (
        f"{allan.length:.6g} s at {1.0 / allan.interval:.6g} Hz, {len(tau)} averaging times from {tau[0]:.3g} to "
        f"{tau[-1]:.4g} s"
    )


def _signal_page(found: SignalNoise) -> Page:
    """Lay out the noise of signals of any unit."""
    allan, sections = found.allan, []
    for i, (model, (key, _)) in enumerate(zip(found.models, _columns(found), strict=True), start=1):
        if model is None:
            sections.append(only_json("", Quantity(key, None)))
            continue
        items = tuple(
            replace(noise_quantity(term, each.value, each.sd, (each.low, each.high)), unit="")
            for term, each in model.coefficients.items()
        )
        sections.append(Section(key, f"Noise coefficients of signal {i}", (*items, *_of_model(model, ""))))
    return Page(
        "Noise of signals",
        (_extent(allan),),
        (
            drawn("allan", "Allan deviation of signals", allan_panels(found), NOTE),
            only_json("", Quantity("length", allan.length, "s"), Quantity("interval", allan.interval, "s")),
            Section("signals", parts=tuple(sections), note="in the unit of the signal and SI"),
        ),
        method=tuple(phrase("method.allan").splitlines()),
    )


def texts(result: Result[StaticNoise | SignalNoise]) -> dict[str, str]:
    """Return the contents of text files by name: the table of deviations; for a static record also the IMU model."""
    found = result.found
    model = {}
    if isinstance(found, StaticNoise):
        model = {IMU_TOML: to_toml(found.spec), IMU_YAML: to_kalibr(found.spec, 1.0 / found.allan.interval)}
    return {DEVIATIONS: csv_text(_table(found), digits=9), **model}


def frame(result: Result[StaticNoise | SignalNoise]) -> DataFrame:
    """Build a table of Allan deviations with intervals, one row per averaging time."""
    import pandas as pd

    return pd.DataFrame(_table(result.found))


def _sizes(found: StaticNoise, term: str, *, gyro: bool) -> Quantity | None:
    """Build the median of a noise coefficient over three gyros or accelerometers; None if no axis determines it."""
    models = found.models[:3] if gyro else found.models[3:]
    values = [model.coefficients[term].value for model in models if model is not None and term in model.coefficients]
    if not values:
        return None
    quantity = noise_quantity(term, float(np.median(values)), gyro=gyro)
    sensor = "gyro" if gyro else "accel"
    return replace(quantity, key=f"{sensor}_{quantity.key}", meaning=f"{sensor}, {quantity.label}")


def _sentence(found: StaticNoise) -> str:
    """Write random walk and bias instability of gyros and accelerometers in one sentence."""
    texts = []
    for sensor, gyro in (("gyros", True), ("accelerometers", False)):
        quantities = [each for each in (_sizes(found, term, gyro=gyro) for term in ("N", "B")) if each is not None]
        words = " and ".join(f"{each.label.split(', ')[1]} {cell(each)} {each.shown_unit}" for each in quantities)
        texts += [f"{sensor}: {words}"] if quantities else []
    text = "; ".join(texts) or "no axis has an identifiable noise"
    return f"{text[0].upper()}{text[1:]}."


def _axis(found: StaticNoise, column: int) -> tuple[Section, ...]:
    """Lay out the noise coefficients of one axis: first in usual units, then in SI units."""
    model, floor, gyro = found.models[column], found.floors[column], column < 3
    unit = "deg/h" if gyro else "ug"
    key = AXES[column].replace(" ", "_")
    if model is None or floor is None:
        return (only_json("", Quantity(key, None)),)
    items = [
        noise_quantity(term, each.value, each.sd, (each.low, each.high), gyro=gyro)
        for term, each in model.coefficients.items()
    ]
    items += _of_model(model, unit)
    items.append(Quantity("floor", floor.value, unit, meaning="lowest deviation"))
    items += of_table("allan.axis", floor, misfit=model.misfit)
    si = (noise_quantity(term, each.value, gyro=gyro, si=True) for term, each in model.coefficients.items())
    return only_json(key, *items), only_json(key, *si)


def _of_model(model: NoiseModel, unit: str) -> Iterator[Quantity]:
    """Yield the other parameters of a noise model: correlation time, and sinusoids with amplitudes in `unit`."""
    if np.isfinite(model.correlation_time):
        yield Quantity("correlation_time", model.correlation_time, "s", model.correlation_time_sd)
    for i, line in enumerate(model.sinusoids, start=1):
        yield Quantity(f"sinusoid_{i}", line.amplitude, unit, line.amplitude_sd, meaning=f"sinusoid {i}, amplitude")
        yield Quantity(f"sinusoid_{i}_frequency", line.frequency, "Hz", line.frequency_sd, meaning=f"sinusoid {i} at")


def _deviations(found: StaticNoise) -> tuple[tuple[Quantity, ...], ...]:
    tau, rows = found.allan.tau, []
    for wanted in _TIMES:
        row = int(np.argmin(np.abs(np.log(tau / wanted))))
        if 1.0 / _NEAR < tau[row] / wanted < _NEAR:
            freedom = min((float(m.freedom[row]) for m in found.models if m is not None), default=None)
            columns = zip(_columns(found), found.allan.deviation[row], strict=True)
            axes = (Quantity(name, float(value), unit) for (name, unit), value in columns)
            least = Quantity("degrees_of_freedom", freedom, digits=2)
            rows.append((Quantity("tau", float(tau[row]), "s"), *axes, least))
    return tuple(rows)


def _filter_figures(found: StaticNoise) -> Section:
    rows = []
    for column, axis in enumerate(AXES):
        sensor, k = (found.spec.gyro, column) if column < 3 else (found.spec.accel, column - 3)
        n, gm, *others = (
            noise_quantity(term, float(getattr(sensor, KEYS[term])[k]) or None, gyro=column < 3) for term in _IN_FILE
        )
        time = sensor.correlation_time if np.isfinite(sensor.correlation_time) else None
        rows.append((Quantity("axis", axis), n, gm, Quantity("correlation_time", time, "s"), *others))
    return of_section("allan.imu_model", rows, {"density": M_S_PER_SQRT_H / UG})


def _columns(found: StaticNoise | SignalNoise) -> list[tuple[str, str]]:
    """List name and unit of every column of Allan deviations."""
    if isinstance(found, StaticNoise):
        return [(axis.replace(" ", "_"), "deg/h" if i < 3 else "ug") for i, axis in enumerate(AXES)]
    return [(f"signal_{i + 1}", "") for i in range(len(found.models))]


def _table(found: StaticNoise | SignalNoise) -> dict[str, FloatArray]:
    """Build the columns of the table of Allan deviations, with intervals and models; the names include the units."""
    columns = {"tau_s": found.allan.tau}
    for i, ((name, unit), model) in enumerate(zip(_columns(found), found.models, strict=True)):
        suffix, factor = key_suffix(unit), UNITS[unit][1] if unit else 1.0
        columns[f"{name}{suffix}"] = found.allan.deviation[:, i] / factor
        if model is not None:
            columns |= {
                f"{name}_low{suffix}": model.low / factor,
                f"{name}_high{suffix}": model.high / factor,
                f"{name}_model{suffix}": np.sqrt(model.variance) / factor,
                f"{name}_freedom": model.freedom,
            }
    return columns


def allan_panels(found: StaticNoise | SignalNoise) -> Iterator[Panel]:
    """Draw deviations with 95 % intervals, models, and slope guides; separate panels for gyros and accelerometers."""
    panels = {"gyros": range(3), "accelerometers": range(3, 6)}
    if isinstance(found, SignalNoise):
        panels = {"signals": range(len(found.models))}
    tau, names, note = found.allan.tau, _columns(found), NOTE
    for sensors, columns in panels.items():
        unit = names[columns[0]][1]
        size, curves, deviations = UNITS[unit][1] if unit else 1.0, [], []
        for i, colour in zip(columns, cycle(AXIS_COLOURS), strict=False):
            model, deviation = found.models[i], found.allan.deviation[:, i]
            if model is not None:
                name = names[i][0][-1] if unit else f"signal {i + 1}"
                deviations.append(deviation[deviation > 0.0] / size)
                curves += [
                    Curve(name, tau, model.high / size, colour, "band", model.low / size),
                    Curve(name, tau, deviation / size, colour, "points"),
                    Curve(name, tau, np.sqrt(model.variance) / size, colour),
                ]
        if not deviations:
            continue
        low, high = (float(limit(np.concatenate(deviations))) for limit in (np.min, np.max))
        title = f"Allan deviation of the {sensors}" if unit else "Allan deviation"
        labels = title, f"Allan deviation [{unit or 'unit of the signal'}]", "averaging time [s]"
        all_curves, limits = (*curves, *_guides(tau, high)), (0.4 * low, 5.0 * high)
        yield Panel(f"allan_{sensors}", *labels, all_curves, "tau", note, log="xy", limits=limits, height=400)
        note = ""


def _guides(tau: FloatArray, high: float) -> Iterator[Curve]:
    """Draw short lines with the slope of each noise type through a point above the largest deviation `high`."""
    half = (float(tau[-1]) / float(tau[0])) ** 0.1
    x, y = float(tau[-1]) / half, 1.8 * high
    for slope, text in _GUIDES:
        reach = half if slope == 0.0 else min(half, _TALL ** (1.0 / abs(slope)))
        ends = np.array([1.0 / reach, reach])
        yield Curve("", x * ends, y * ends**slope, GREY, "thin", text=(text, text))
