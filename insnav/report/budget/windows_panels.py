"""Errors of free-inertial windows: growth and prediction, equivalent errors, recorded over predicted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.errors.budget.from_windows import RecordedPart
from insnav.errors.diagnosis.causes import CAUSES
from insnav.errors.outage.statistics import COMPONENTS, components
from insnav.report.budget.windows_quantities import GROWS, UNITS
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from insnav.report.outage.panels import power_lines, thin_lines
from insnav.report.panels import Curve, Panel
from insnav.units import UNITS as FACTORS

_WINDOWS, _POINTS = 40, 60  # drawn one by one, and points of each
_MOTIONS = {"static": GREEN, "straight": BLUE, "turning": VERMILLION}


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
            unit = FACTORS[UNITS[name]][1]
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
                f"{axis.axis.capitalize()} {name}: error grows with {GROWS[name]}",
                f"{name} [{UNITS[name]}]",
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
