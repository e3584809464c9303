"""Report of gyro drift: as measured, after correction by a drift model, and after smoothing by a Kalman filter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.imu import calibration_to_toml
from insnav.lab.drift import P0, POWERS, DriftModel, DriftStudy, GyroDrift
from insnav.lab.drift import Curve as Deviations
from insnav.messages import phrase
from insnav.output.data_files import csv_text
from insnav.quantity import Quantity
from insnav.report.allan.page import noise_quantity
from insnav.report.calibration.methods import bench_input, quality_section
from insnav.report.page import DataFrame, Page, Section, by_warnings, drawn, only_json, rows_frame
from insnav.report.panels import Curve, Kind, Panel
from insnav.report.style import AXIS_COLOURS, BLACK, GREY, number
from insnav.report.tables import of_section, of_table
from insnav.result import Result
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H

_TERMS = {
    "A": ("bias at 25 C, A", "deg/s"),
    "B": ("residual scale factor, B", "ppm"),
    "c_T": ("temperature, c_T", "deg/s/K"),
    "c_g": ("g-sensitivity, c_g", "deg/s/g"),
}


def page(result: Result[DriftStudy]) -> Page:
    """Lay out the drift study of gyros: conclusions, panels, and tables for each gyro."""
    found = result.found
    record, gyros, name = found.record, found.gyros, found.record.name
    fits = {f"gyro {each.model.axis}": each.model.fit for each in gyros}
    times = [f"{each:g} s" for each in record.time]
    source = () if found.file is None else (Quantity("input", bench_input([found.file])[0]),)
    return Page(
        f"Drift of the gyros of {name}",
        (
            f"{record.time.size} samples at {1.0 / record.interval:.6g} Hz, "
            f"the first {gyros[0].rest.stop * record.interval:g} s at rest",
            *[text for each in gyros for text in _conclusions(each)][1:],
        ),
        (
            only_json("", Quantity("command", "drift"), *source),
            drawn("drift", f"Drift of gyros before and after: {name}", drift_panels(found), columns=3),
            drawn("rates", f"Rates on a ramp and after it: {name}", rate_panels(found), columns=2),
            Section("gyros", parts=tuple(_gyro(each) for each in gyros)),
            quality_section((fits, "rad/s", dict.fromkeys(fits, times))),
        ),
        result.findings,
        tuple(phrase("method.drift").splitlines()),
        merits=_merits(gyros[0]),
        merits_note=f"gyro {gyros[0].model.axis}; Allan deviations at the shortest averaging time",
        verdict=by_warnings(_conclusions(gyros[0])[0], result.findings, ("good", "no warning from the fits")),
    )


def texts(result: Result[DriftStudy]) -> dict[str, str]:
    """Return the contents of text files by name: the calibration, and the corrected and smoothed rates."""
    return {"calibration.toml": calibration_to_toml(result.found.errors), "rates.csv": rates_csv(result.found)}


def frame(result: Result[DriftStudy]) -> DataFrame:
    """Build a table of the Allan deviations of every gyro: before, corrected, and smoothed."""
    return rows_frame(
        (Quantity("gyro", each.model.axis), *row) for each in result.found.gyros for row in _curves(each, "").rows
    )


def _merits(each: GyroDrift) -> tuple[Quantity, ...]:
    curves = {"measured": each.measured, "corrected": each.corrected, "smoothed": each.smoothed}
    return (
        *(Quantity(name, float(x.deviation[0]), "deg/h", meaning=f"deviation, {name}") for name, x in curves.items()),
        *of_table("drift.merits", each),
    )


def _conclusions(each: GyroDrift) -> tuple[str, ...]:
    name, corrected, smoothed = f"gyro {each.model.axis}", each.corrected, each.smoothed
    shortest, longest = float(corrected.allan.tau[0]), float(corrected.allan.tau[-1])
    gain = float(corrected.deviation[0] / smoothed.deviation[0])
    ratio = float(smoothed.deviation[-1] / corrected.deviation[-1])
    values = {"factor": number(gain, 2), "until_s": each.helped_until, "ratio": number(ratio, 2), "name": name}
    values |= {"freedom": number(float(corrected.freedom[-1]), 2), "lag": number(each.smoother.lag)}
    return tuple(phrase("method.smoothing", shortest_s=shortest, longest_s=longest, **values).splitlines())


def _gyro(each: GyroDrift) -> Section:
    name = f"gyro {each.model.axis}"
    return Section(
        f"gyro_{each.model.axis}",
        parts=(
            Section("drift", f"Drift model of {name}", tuple(_parameters(each.model))),
            only_json("left_out", *(Quantity(term, why.code.value) for term, why in each.model.left_out.items())),
            _filter(each, name),
            _curves(each, name),
            _coefficients(each, name),
            _ramps(each, name),
        ),
    )


def _parameters(model: DriftModel) -> Iterator[Quantity]:
    for term, value in model.value.items():
        label, unit = _TERMS[term]
        half = model.half_width(term)
        yield Quantity(term, value, unit, model.sd[term], (value - half, value + half), label)


def _filter(each: GyroDrift, name: str) -> Section:
    chosen = each.smoother
    items = of_table("drift.filter", chosen, q=chosen.q / DEG**2, r=chosen.r / DEG**2, p0=P0 / DEG**2)
    return Section("filter", f"Scalar Kalman filter of {name}", items, note="F = H = 1")


def _states(each: GyroDrift) -> dict[str, Deviations]:
    return {"before": each.measured, "corrected": each.corrected, "smoothed": each.smoothed}


def _curves(each: GyroDrift, name: str) -> Section:
    curves, longest = _states(each), each.corrected.allan
    rows = []
    for k, tau in enumerate(longest.tau):
        sizes, counts = [Quantity("tau", float(tau), "s")], []
        for state, c in curves.items():
            interval = float(c.low[k]), float(c.high[k])
            sizes.append(Quantity(state, float(c.deviation[k]), "deg/h", interval=interval))
            counts.append(Quantity(f"freedom_{state}", float(c.freedom[k]), meaning=f"freedom {state}", digits=2))
        rows.append((*sizes, *counts))
    freedom, length = number(float(each.corrected.freedom[-1]), 2), longest.n * longest.interval
    values = {"name": name, "tau": longest.tau[-1], "length": length, "freedom": freedom}
    return of_section("drift.allan", rows, values)


def _coefficients(each: GyroDrift, name: str) -> Section:
    rows = []
    for state, curve in _states(each).items():
        fitted = {term: curve.coefficients[term] for term in POWERS if curve.coefficients}
        if fitted:
            cells = (noise_quantity(term, one.value, interval=(one.low, one.high)) for term, one in fitted.items())
            rows.append((Quantity("rate", state, meaning="angular rate"), *cells))
    return of_section("drift.coefficients", rows, {"name": name})


def _ramps(each: GyroDrift, name: str) -> Section:
    rows = []
    for answer in filter(None, (each.computed, each.recorded)):
        ramp = "recorded" if answer.measured else "computed, 0 to 10 r/min in 100 s"
        lag = Quantity("lag", answer.lag, "s", sd=answer.lag_sd if answer.measured else None)
        slope, *others = of_table("drift.ramp", answer, slope=answer.slope / DEG, lag_by_gain=each.smoother.lag)
        rows.append((Quantity("ramp", ramp), slope, lag, *others))
    return of_section("drift.ramps", rows, {"name": name})


def rates_csv(found: DriftStudy) -> str:
    """Write the corrected and the smoothed rates of all gyros as CSV text."""
    columns = {"time_s": found.record.time}
    for each in found.gyros:
        columns[f"gyro_{each.model.axis}_corrected_deg_s"] = each.corrected_rate / DEG
        columns[f"gyro_{each.model.axis}_smoothed_deg_s"] = each.smoothed_rate / DEG
    return csv_text(columns, digits=10)


def drift_panels(found: DriftStudy) -> tuple[Panel, ...]:
    """Draw three panels for each gyro: rate at rest, Allan deviation, and error on a rate ramp."""
    return tuple(panel for each in found.gyros for panel in _panels(found.record.time, each))


def rate_panels(found: DriftStudy) -> tuple[Panel, ...]:
    """Draw the rate of each gyro on a ramp, and at constant rate afterwards, before and after the filter."""
    return tuple(panel for each in found.gyros for panel in _rates(each))


def _panels(time: FloatArray, each: GyroDrift) -> tuple[Panel, Panel, Panel]:
    axis, at = each.model.axis, time[each.rest] - time[0]
    colour = AXIS_COLOURS["xyz".index(axis)]
    rest = (
        Curve("measured", at, each.measured_rate[each.rest] / DEG, GREY, "thin"),
        Curve("corrected", at, each.corrected_rate[each.rest] / DEG, BLACK, "thin"),
        Curve("smoothed", at, each.smoothed_rate[each.rest] / DEG, colour),
    )
    allan = []
    tau = each.measured.allan.tau
    for name, curve, shade in (("measured", each.measured, GREY), ("smoothed", each.smoothed, colour)):
        value, low, high = (x / DEG_PER_H for x in (curve.deviation, curve.low, curve.high))
        line: Kind = "dashed" if curve is each.smoothed else "line"
        allan += [Curve(name, tau, high, shade, "band", low), Curve(name, tau, value, shade, line)]
        allan.append(Curve(name, tau, value, shade, "points"))
    allan.append(Curve("corrected", tau, each.corrected.deviation / DEG_PER_H, BLACK))
    # The axis limits ignore the 95 % bands: with one degree of freedom a band is too wide to plot.
    values = [x.deviation / DEG_PER_H for x in (each.measured, each.smoothed, each.corrected)]
    limits = 0.4 * min(float(x[x > 0.0].min(initial=1.0)) for x in values), 3.0 * max(float(x.max()) for x in values)
    answer = each.recorded or each.computed
    error = (answer.smoothed - answer.rate) / DEG
    ramp = Curve(f"smoothed minus true rate: lag {answer.lag:.3g} s", answer.time - answer.time[0], error, colour)
    kind = "recorded" if answer.measured else "computed"
    name = f"Gyro {axis}"
    labels = f"{name}, Allan deviation", "deviation [deg/h]", "averaging time [s]"
    note = "corrected: drift model subtracted; smoothed: after the scalar Kalman filter"
    return (
        Panel(f"rest_{axis}", f"{name} at rest", "rate [deg/s]", "time [s]", rest, "rest", note),
        Panel(f"deviation_{axis}", *labels, tuple(allan), "tau", "band: 95 %", log="xy", limits=limits, height=240),
        Panel(f"ramp_{axis}", f"{name}, {kind} ramp", "error [deg/s]", "time on the ramp [s]", (ramp,), "ramp"),
    )


def _rates(each: GyroDrift) -> Iterator[Panel]:
    answer = each.recorded or each.computed
    axis, time, colour = each.model.axis, answer.time, AXIS_COLOURS["xyz".index(each.model.axis)]
    before_end = np.flatnonzero(np.abs(answer.rate - answer.rate[-1]) > 1e-6)
    constant = slice(0 if not before_end.size else int(before_end[-1]) + 1, None)
    start = int(np.argmax(answer.rate != 0.0))
    unsmoothed = each.corrected_rate if answer.measured else answer.rate
    for key, title, rows in (("turning", "rate ramp", slice(start, None)), ("constant", "constant rate", constant)):
        shown = (
            Curve("corrected" if answer.measured else "true", time[rows], unsmoothed[rows] / DEG, BLACK, "thin"),
            Curve("smoothed", time[rows], answer.smoothed[rows] / DEG, colour),
        )
        if len(time[rows]) > 1 and answer.rate[-1] != 0.0:
            yield Panel(f"{key}_{axis}", f"Gyro {axis}, {title}", "rate [deg/s]", "time [s]", shown, key)
