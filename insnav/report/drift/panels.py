"""Drift of gyros before and after correction and smoothing: over time, by averaging time, and on a rate ramp."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.lab.drift.allan_before_after import DriftStudy, GyroDrift
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.panels import Curve, Kind, Panel
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H


def drift_panels(found: DriftStudy) -> tuple[Panel, ...]:
    """Draw for each gyro the part at rest, Allan deviations, and the error on a rate ramp."""
    return tuple(panel for each in found.gyros for panel in _panels(found.record.time, each))


def rate_panels(found: DriftStudy) -> tuple[Panel, ...]:
    """Draw for each gyro the rate on a ramp and at the constant rate after it, before and after the filter."""
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
    # an interval of one degree of freedom has no end: it would push everything else together
    values = [x.deviation / DEG_PER_H for x in (each.measured, each.smoothed, each.corrected)]
    limits = 0.4 * min(float(x[x > 0.0].min(initial=1.0)) for x in values), 3.0 * max(float(x.max()) for x in values)
    answer = each.recorded or each.computed
    error = (answer.smoothed - answer.rate) / DEG
    ramp = Curve(f"smoothed less true rate: lag {answer.lag:.3g} s", answer.time - answer.time[0], error, colour)
    kind = "recorded" if answer.measured else "computed"
    name = f"Gyro {axis}"
    note = "corrected: drift model subtracted; smoothed: after the scalar Kalman filter"
    return (
        Panel(f"rest_{axis}", f"{name} at rest", "rate [deg/s]", "time [s]", rest, "rest", note),
        Panel(
            f"deviation_{axis}",
            f"{name}, Allan deviation",
            "deviation [deg/h]",
            "averaging time [s]",
            tuple(allan),
            "tau",
            "band: 95 %",
            log_x=True,
            log_y=True,
            limits=limits,
            height=240,
        ),
        Panel(f"ramp_{axis}", f"{name}, {kind} ramp", "error [deg/s]", "time on the ramp [s]", (ramp,), "ramp"),
    )


def _rates(each: GyroDrift) -> Iterator[Panel]:
    answer = each.recorded or each.computed
    axis, time, colour = each.model.axis, answer.time, AXIS_COLOURS["xyz".index(each.model.axis)]
    last = np.flatnonzero(np.abs(answer.rate - answer.rate[-1]) > 1e-6)
    constant = slice(0 if not last.size else int(last[-1]) + 1, None)
    start = int(np.argmax(answer.rate != 0.0))
    seen = each.corrected_rate if answer.measured else answer.rate
    for key, title, rows in (("turning", "rate ramp", slice(start, None)), ("constant", "constant rate", constant)):
        shown = (
            Curve("corrected" if answer.measured else "true", time[rows], seen[rows] / DEG, BLACK, "thin"),
            Curve("smoothed", time[rows], answer.smoothed[rows] / DEG, colour),
        )
        if len(time[rows]) > 1 and answer.rate[-1] != 0.0:
            yield Panel(f"{key}_{axis}", f"Gyro {axis}, {title}", "rate [deg/s]", "time [s]", shown, key)
