"""Drift of gyros before and after correction and smoothing: over time, by averaging time, and on a rate ramp."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.lab.drift.allan_before_after import DriftStudy, GyroDrift
from insnav.report.colours import AXIS_COLOURS, BLACK, GREY
from insnav.report.style import (
    blank,
    legend_above,
    line,
    logarithmic,
)
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H


def draw_drift(found: DriftStudy) -> Figure:
    """Draw one row a gyro: the part at rest, Allan deviations, and the error on a rate ramp."""
    rows = len(found.gyros)
    note = (
        "grey: as measured; black: drift model subtracted; colour: after the scalar Kalman filter; bars and band 95 %"
    )
    figure = blank(12.0, 1.4 + 3.0 * rows, f"Drift of gyros before and after: {found.record.name}", note)
    panels = figure.subplots(rows, 3, squeeze=False, sharex="col", gridspec_kw={"wspace": 0.28, "hspace": 0.22})
    for (rest, allan, ramp), each in zip(panels, found.gyros, strict=True):
        colour = AXIS_COLOURS["xyz".index(each.model.axis)]
        _rest(rest, found.record.time, each, colour)
        _allan(allan, each, colour)
        _ramp(ramp, each, colour)
        legend_above(rest)
        legend_above(allan)
        legend_above(ramp)
    for panel, label in zip(panels[-1], ("time [s]", "averaging time [s]", "time on the ramp [s]"), strict=True):
        panel.set_xlabel(label)
    return figure


def _rest(axes: Axes, time: FloatArray, each: GyroDrift, colour: str) -> None:
    at = time[each.rest] - time[0]
    measured, corrected = each.measured_rate[each.rest], each.corrected_rate[each.rest]
    line(axes, at, measured / DEG, GREY, "measured", alpha=0.6, linewidth=0.7)
    line(axes, at, corrected / DEG, BLACK, "corrected", alpha=0.6, linewidth=0.7)
    line(axes, at, each.smoothed_rate[each.rest] / DEG, colour, "smoothed", linewidth=1.6)
    axes.set_ylabel(f"gyro {each.model.axis} at rest [deg/s]")


def _allan(axes: Axes, each: GyroDrift, colour: str) -> None:
    tau, before, after = each.measured.allan.tau, each.measured, each.smoothed
    axes.set_xscale("log")
    axes.set_yscale("log")
    spread = [(before.deviation - before.low) / DEG_PER_H, (before.high - before.deviation) / DEG_PER_H]
    axes.errorbar(tau, before.deviation / DEG_PER_H, spread, fmt="o-", color=GREY, markersize=4, capsize=2)
    axes.plot(tau, each.corrected.deviation / DEG_PER_H, color=BLACK, linewidth=0.9)
    axes.fill_between(tau, after.low / DEG_PER_H, after.high / DEG_PER_H, color=colour, alpha=0.2, linewidth=0.0)
    axes.plot(tau, after.deviation / DEG_PER_H, "o-", color=colour, markersize=4)
    # an interval of one degree of freedom has no end: it would push everything else together
    largest = max(float(before.deviation.max()), float(after.deviation.max()), float(each.corrected.deviation.max()))
    axes.set_ylim(top=4.0 * largest / DEG_PER_H)
    for axis in (axes.xaxis, axes.yaxis):
        logarithmic(axis)
    axes.set_ylabel("Allan deviation [deg/h]")


def _ramp(axes: Axes, each: GyroDrift, colour: str) -> None:
    answer = each.recorded or each.computed
    kind = "of the record" if answer.measured else "computed"
    at = answer.time - answer.time[0]
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    name = f"smoothed less true rate, {kind}: lag {answer.lag:.3g} s"
    line(axes, at, (answer.smoothed - answer.rate) / DEG, colour, name)
    axes.set_ylabel("error on the ramp [deg/s]")
