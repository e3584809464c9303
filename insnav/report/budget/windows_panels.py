"""Errors of free-inertial windows: growth and prediction, equivalent errors, recorded over predicted."""

from __future__ import annotations

import numpy as np

from insnav.errors.budget.from_windows import RecordedPart
from insnav.errors.diagnosis.causes import CAUSES
from insnav.errors.outage.statistics import COMPONENTS, components
from insnav.report.budget.windows_quantities import GROWS, UNITS
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from insnav.report.panels import Curve, Panel
from insnav.types import FloatArray
from insnav.units import UNITS as FACTORS

_WINDOWS, _POINTS = 40, 60  # drawn one by one, and points of each
_MOTIONS = {"static": GREEN, "straight": BLUE, "turning": VERMILLION}
_GUIDES = (("t", 1.0), ("t²", 2.0), ("t³", 3.0))
_ACROSS = "time without GPS [s]"


def growth_panels(part: RecordedPart, key: str) -> tuple[Panel, ...]:
    """Draw North and East error over the time without fixes, and the horizontal one on logarithmic axes."""
    windows, curve = part.windows, part.curve
    error = components(windows)[0]
    shown = np.linspace(0, windows.count - 1, min(_WINDOWS, windows.count)).astype(int)
    step = max(1, error.shape[1] // _POINTS)
    panels = []
    for name in ("north", "east", "horizontal"):
        i, both = COMPONENTS.index(name), name != "horizontal"
        curves = [
            Curve("each window", windows.elapsed[row][::step], error[row, ::step, i], GREY, "thin") for row in shown
        ]
        for sign in (1.0, -1.0) if both else (1.0,):
            curves += _sums(part, i, sign)
        largest = 1.1 * float(np.nanmax([np.nanmax(np.abs(error[:, :, i])), np.nanmax(curve.predicted[:, i])]))
        limits = -largest, largest  # the band of few replicas is wide
        if not both:
            rms = curve.corrected[:, i]
            curves += _guides(curve.times, rms)
            positive = rms[rms > 0.0]
            limits = max(0.2 * float(positive.min(initial=largest)), 1e-4 * largest), largest
        panels.append(
            Panel(
                f"{key}_growth_{name}",
                f"{name.capitalize()} error of {windows.count} windows",
                f"{name} error [m]",
                _ACROSS,
                tuple(curves),
                f"{key}_growth" if both else "",
                "bands: 95 %, of the windows by block bootstrap",
                log_x=not both,
                log_y=not both,
                limits=limits,
                height=260,
            )
        )
    return tuple(panels)


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


def _guides(times: FloatArray, rms: FloatArray) -> list[Curve]:
    """Lines of pure t, t² and t³ that end where the error does."""
    end, first = float(rms[-1]), max(1, len(times) // 6)
    if not end > 0.0:
        return []
    t = times[first:]
    return [
        Curve("", t, end * (t / times[-1]) ** power, GREEN, "thin", text=(label,) * len(t)) for label, power in _GUIDES
    ]


def causes_panels(part: RecordedPart, key: str) -> tuple[Panel, ...]:
    """Draw velocity, effective acceleration and drift of each window that was fitted, with the filter's sd."""
    diagnosis = part.diagnosis
    windows = diagnosis.windows
    since, panels = windows.start - windows.start[0], []
    for row, name in enumerate(CAUSES):
        for axis in diagnosis.axes:
            unit = FACTORS[UNITS[name]][1]
            factor = 1.0 / unit if name != "drift" else 1.0 / unit / diagnosis.gravity
            value = np.array([curve.value[row] for curve in axis.curves]) * factor
            sd = np.array([curve.sd[row] for curve in axis.curves]) * factor
            half = np.full(2, axis.causes[row].filter_sd / unit)
            ends = np.array([since.min(), since.max()])
            curves = [Curve("1 sd of the filter", ends, half, GREY, "band", -half)]
            for motion, colour in _MOTIONS.items():
                chosen = windows.motion == motion
                at, y, reach = since[chosen], value[chosen], sd[chosen]
                gap = np.full(len(at), np.nan)
                bars = np.column_stack((y - reach, y + reach, gap)).ravel()
                curves += [
                    Curve(motion, at, y, colour, "points"),
                    Curve("", np.repeat(at, 3), bars, colour, "thin"),
                ]
            panels.append(
                Panel(
                    f"{key}_{axis.axis}_{name}".replace(" ", "_"),
                    f"{axis.axis.capitalize()} {name}: error grows with {GROWS[name]}",
                    f"{name} [{UNITS[name]}]",
                    f"start of the window, since {windows.start[0]:.1f} s [s]",
                    tuple(each for each in curves if len(each.x)),
                    f"{key}_causes",
                    "at rest or straight" if diagnosis.steady else "turns included, in which no curve is pure",
                )
            )
    return tuple(panels)


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
