"""Report of the acceptance figures of gyros and accelerometers: scale factor, bias stability and repeatability."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from insnav.lab.acceptance import BENCH_UNIT, Acceptance, Accepted, Spread, Stability
from insnav.lab.bench_data import SI
from insnav.lab.calibration import Fit
from insnav.lab.single_axis.rate_table import Dropped
from insnav.messages import phrase, sentence
from insnav.quantity import Quantity
from insnav.report.calibration.methods import Series, bench_input, quality_section, residual_panels
from insnav.report.page import DataFrame, Page, Section, by_warnings, cell, drawn, only_json, rows_frame
from insnav.report.panels import Clock, Curve, Kind, Panel
from insnav.report.style import AXIS_COLOURS, BLACK, GREY
from insnav.result import Result
from insnav.units import DEG, G0, UNITS

FINE = 0.01 * DEG  # gyro figures are shown in deg/h if all of them are smaller, otherwise in deg/s [rad/s]
_SENSORS = {"gyro": "gyros", "accel": "accelerometers"}
_JSON_UNIT = {"gyro": "deg/s", "accel": "ug"}  # units in run.json, independent of the size of the figures


def page(result: Result[Acceptance]) -> Page:
    """Lay out the acceptance figures of all sensors."""
    found = result.found
    steps = [item for item in found.sensors if item.scale is not None]
    left_out = [(item, drop) for item in steps if item.scale is not None for drop in item.scale.table.dropped]
    lines = (
        f"{item.axis} leaves out {drop.rate:+g} {_bench(item)}: {sentence(drop.reason)}" for item, drop in left_out
    )
    units = _units(found.sensors)
    at_rest = f", {found.length:.6g} s at rest" if found.length else ""
    names = ", ".join(item.axis for item in found.sensors)
    merits = tuple(_merits(found.sensors, units))
    largest = "; ".join(f"{each.label} {cell(each)} {each.shown_unit}" for each in merits)
    return Page(
        "Acceptance of gyros and accelerometers",
        (f"{names}{at_rest}; {', '.join(each.name for each in found.files)}", *lines),
        (
            only_json("", Quantity("command", "acceptance"), Quantity("input", bench_input(found.files))),
            *_drawn(found, units),
            Section(
                "sensors",
                parts=tuple(part for item in found.sensors for part in _sensor(item, units[item.axis.split()[0]])),
            ),
            quality_section(*map(_quality, steps)),
            Section("left_out", rows=tuple(_left_out(*each) for each in left_out), show="json"),
        ),
        result.findings,
        tuple(phrase("method.acceptance").splitlines()),
        merits=merits,
        merits_note="the largest of the axes",
        verdict=by_warnings(
            f"Largest of the axes: {largest}." if merits else f"Figures of {names}{at_rest}.",
            result.findings,
            ("unknown", "measured; no limit was given"),
        ),
    )


def frame(result: Result[Acceptance]) -> DataFrame:
    """Build a table of the acceptance figures, one row per sensor."""
    return rows_frame(_figures(item) for item in result.found.sensors)


def _figures(item: Accepted) -> Iterator[Quantity]:
    unit = _JSON_UNIT[item.axis.split()[0]]
    yield Quantity("sensor", item.axis)
    yield from _scale(item, unit)
    for each in item.stability:
        yield Quantity(f"stability_{each.length:g}_s", each.spread.sd, unit)
    if item.repeatability is not None:
        yield Quantity("repeatability", item.repeatability.sd, unit)


def _left_out(item: Accepted, drop: Dropped) -> tuple[Quantity, ...]:
    setting, code = Quantity("setting", drop.rate), Quantity("code", drop.reason.code.value)
    return Quantity("sensor", item.axis), setting, Quantity("unit", _bench(item)), code


def _bench(item: Accepted) -> str:
    return BENCH_UNIT[item.axis.split()[0]][0]


def _output_unit(item: Accepted) -> str:
    return _bench(item) if item.unit in SI.values() else item.unit


def _quality(item: Accepted) -> tuple[dict[str, Fit], str, dict[str, list[str]]]:
    assert item.scale is not None
    table = item.scale.table
    settings = [f"{value:+g} {_bench(item)}" for value in table.rate[table.used]]
    # the residuals are shown in the unit of the output, not of the bench
    return {item.axis: table.fit}, _output_unit(item), {item.axis: settings}


def _sensor(item: Accepted, shown: str) -> tuple[Section, ...]:
    """Lay out one sensor in the unit `shown`, which suits the size of its figures; JSON also has a fixed unit."""
    key, fixed = item.axis.replace(" ", "_"), _JSON_UNIT[item.axis.split()[0]]
    title = f"{item.axis[0].upper()}{item.axis[1:]}"
    sections = (
        only_json(key, Quantity("output_unit", _output_unit(item))),
        Section(key, title, tuple(_scale(item, shown)), parts=tuple(_spreads(item, shown)), note="± 1 sd"),
    )
    if shown == fixed:
        return sections
    return (*sections, only_json(key, *_scale(item, fixed), parts=tuple(_spreads(item, fixed))))


def _scale(item: Accepted, unit: str) -> Iterator[Quantity]:
    if item.scale is None:
        return
    table, bench = item.scale.table, UNITS[_bench(item)][1]
    k_unit = "" if item.unit in SI.values() else f"{item.unit}/({_bench(item)})"
    senses = {"forward": table.forward, "reverse": table.reverse} if table.average is not None else {}
    senses_measured = {sense: fit for sense, fit in senses.items() if fit is not None}
    yield Quantity("scale_factor", item.scale.k, k_unit, item.scale.k_sd, meaning="scale factor K")
    for sense, fit in senses_measured.items():
        yield Quantity(f"scale_factor_{sense}", float(fit.value[1]), k_unit, float(fit.sd[1]), meaning=f"K {sense}")
    if table.asymmetry is not None:
        yield Quantity("asymmetry", table.asymmetry, "ppm", meaning="asymmetry of K")
    yield Quantity("bias", item.scale.bias, unit, item.scale.bias_sd)
    for sense, fit in senses_measured.items():
        (zero, k), zero_sd = fit.value, float(fit.sd[0])
        yield Quantity(f"bias_{sense}", float(zero / k) * bench, unit, float(zero_sd / abs(k)) * bench)


def _spreads(item: Accepted, unit: str) -> Iterator[Section]:
    if item.stability:
        rows = tuple(
            (
                Quantity("length", each.length, "s", meaning="parts of"),
                *_spread(each.spread, unit),
                Quantity("sliding_sd", each.sliding, unit, meaning="moving average"),
            )
            for each in item.stability
        )
        yield Section("bias_stability", f"Bias stability of {item.axis}", rows=rows, note="in brackets 95 %")
    if item.repeatability is not None:
        values = item.repeatability.values
        items = (*_spread(item.repeatability, unit), Quantity("mean_bias", float(values.mean()), unit))
        if unit == "deg/h":  # figures in deg/h are repeated in deg/s, the unit of bench records
            items = (*items, *_spread(item.repeatability, _JSON_UNIT["gyro"])[:2])
        title = f"Bias repeatability of {item.axis}"
        yield Section("bias_repeatability", title, items, note="in brackets 95 %")
        yield only_json("bias_repeatability", Quantity("powerup_biases", np.asarray(values), unit))


def _spread(spread: Spread, unit: str) -> tuple[Quantity, ...]:
    # `UNITS` has no squares of units: the variance is converted here, not by `Quantity`
    factor = UNITS[unit][1]
    return (
        Quantity("sd", spread.sd, unit, interval=(spread.low, spread.high), meaning="standard deviation"),
        Quantity("variance", spread.variance / factor**2, f"({unit})^2"),
        Quantity("n", spread.values.size, meaning="values"),
    )


def _merits(items: Sequence[Accepted], units: Mapping[str, str]) -> Iterator[Quantity]:
    """Yield the largest bias, stability and repeatability of all gyros, and of all accelerometers."""
    for sensor, unit in units.items():
        axes = [item for item in items if item.axis.startswith(sensor)]
        sizes = {
            "bias": [abs(item.scale.bias) for item in axes if item.scale is not None],
            "bias stability": [x.spread.sd for item in axes for x in item.stability[1:2] if x.spread.values.size > 1],
            "bias repeatability": [item.repeatability.sd for item in axes if item.repeatability is not None],
        }
        for name, values in sizes.items():
            if values:
                yield Quantity(f"{sensor}_{name}", max(values), unit, meaning=f"{sensor}, {name}")


def _units(items: Sequence[Accepted]) -> dict[str, str]:
    """Choose one unit for the figures of all gyros and one for all accelerometers, by the largest figure."""
    largest = dict.fromkeys(_SENSORS, 0.0)
    for item in items:
        sensor = item.axis.split()[0]
        sizes = [abs(item.scale.bias)] if item.scale is not None else []
        sizes += [each.sliding for each in item.stability]
        sizes += [item.repeatability.sd] if item.repeatability is not None else []
        largest[sensor] = max(largest[sensor], *sizes, 0.0)
    gyro = "deg/h" if largest["gyro"] < FINE else "deg/s"
    return {"gyro": gyro, "accel": "ug" if largest["accel"] < 0.01 * G0 else "mg"}


def _drawn(found: Acceptance, units: Mapping[str, str]) -> Iterator[Section]:
    at_rest = [(item.axis, item.stability, units[item.axis.split()[0]]) for item in found.sensors if item.stability]
    if at_rest:
        yield drawn("stability", "Acceptance: bias at rest", stability_panels(at_rest))
    for sensor, title in _SENSORS.items():
        series = [
            Series.of(item.axis, _output_unit(item), item.scale.table)
            for item in found.sensors
            if item.scale is not None and item.axis.startswith(sensor)
        ]
        if series:
            label = f"{'rate' if sensor == 'gyro' else 'specific force'} set [{BENCH_UNIT[sensor][0]}]"
            panels = residual_panels(series, label, f"residuals_{sensor}")
            yield drawn(f"residuals_{sensor}", f"Output of the {title} minus the straight line", panels)


def stability_panels(sensors: Sequence[tuple[str, Sequence[Stability], str]]) -> Iterator[Panel]:
    """Draw the mean output over parts of a stationary record, minus the overall mean, for several part lengths.

    `sensors`: for each sensor its name, its stabilities from the shortest parts to the longest, and the unit.
    """
    clock = Clock.of(sensors[0][1][0].time)
    note = "minus the mean of the whole record; the scatter of the means is the bias stability"
    for name, stabilities, unit in sensors:
        mean = stabilities[0].spread.values.mean()
        curves = []
        for order, each in enumerate(stabilities):
            at, values = clock(each.time), (each.spread.values - mean) / UNITS[unit][1]
            shade = (GREY, AXIS_COLOURS["xyz".index(name[-1])], BLACK)[min(order, 2)]
            kinds: tuple[Kind, ...] = ("line", "points") if order and values.size <= 200 else ("line",)
            curves += [Curve(f"means over {each.length:g} s", at, values, shade, kind) for kind in kinds]
        key, title = f"stability_{name.replace(' ', '_')}", f"Bias of {name} at rest"
        yield Panel(key, title, f"{name} [{unit}]", clock.label, tuple(curves), "rest", note)
