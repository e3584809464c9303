"""Figures of a run for papers, as panels: one component each, with filtered and smoothed solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import travelled
from insnav.report.panels import Clock, Curve, Drawing, Panel, broken_at_gaps
from insnav.report.run.panels import GROUPS, RunAxis, error_distribution, nis_levels, run_track, sensor_errors
from insnav.report.style import AXIS_COLOURS, BLUE, GREY, ORANGE, SKY, VERMILLION, distance_text, duration_text, number
from insnav.sample_statistics import rms
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG, DEG_PER_H, G0, PPM

_COLOURS = {"filtered": (BLUE, SKY), "smoothed": (VERMILLION, ORANGE)}  # line and band
_BEYOND = 90.0  # a heading farther beyond 0..360 deg is wrapped [deg]
_SETTLED = 0.2  # share of the run after which estimate bands are shown fully
_SENSORS = (
    ("gyro bias", "deg/h", DEG_PER_H),
    ("accelerometer bias", "mg", 1e-3 * G0),
    ("gyro scale factor", "ppm", PPM),
    ("accelerometer scale factor", "ppm", PPM),
)


def figure_drawings(name: str, found: EvaluatedRun) -> tuple[str, str, tuple[Drawing, ...], int]:
    """Build one figure of a run by name: title, explanation, drawings, columns.

    A single solution is the better one, as on the page.
    """
    solution, fixes = found.run.solution, found.run.innovations
    if name.endswith("_error"):
        group = name.removesuffix("_error")
        return f"{group.capitalize()} error: solution minus reference", "band: ±3 sd", _errors(found, group), 1
    if name == "track":
        title = f"Track of {distance_text(travelled(solution)[0])} in {duration_text(np.ptp(solution.time))}"
        track = run_track(found)
        return title, track.note.split(";")[0], (track,), 1
    if name == "innovations":
        shares = [
            f"{group} {int(used.sum())} of {int(np.isfinite(fixes.innovation[:, first]).sum())}"
            for group, first, used in (("position", 0, fixes.used_position), ("velocity", 3, fixes.used_velocity))
        ]
        panels, columns = _innovations(found)
        return "Innovations: measured minus predicted", f"accepted: {', '.join(shares)}", panels, columns
    best = next(iter(found.solutions))
    whole = {
        "error_distribution": (f"Distribution of the horizontal error, {best}", "", error_distribution),
        "height": ("Height, counted as the heights of the fixes", "band: ±3 sd; fixes at the antenna", _height),
        "velocity": ("Velocity of the solution", "band: ±3 sd; fixes at the antenna", _velocity),
        "attitude": ("Attitude of the solution", "band: ±3 sd", _attitude),
        "uncertainty": ("Standard deviation of the solution", "smoothed (RTS): from all fixes", _uncertainty),
        "biases": (f"Estimated sensor errors, {best}", "line: estimate; band: ±3 sd", _sensor_errors),
    }
    title, note, make = whole[name]
    return title, note, make(found), 1


def _panel(found: EvaluatedRun, label: str, curves: Sequence[Curve], *, title: str = "", **how: object) -> Panel:
    return RunAxis.of(found.run).panel("figure", title, label, curves, **how)


def _lines(
    found: EvaluatedRun, time: FloatArray, value: FloatArray, half: FloatArray, mode: str, name: str = ""
) -> list[Curve]:
    """Draw a line with a band around it, or around zero for an error; `value`, `half` (n,)."""
    colour, shade = _COLOURS[mode]
    at, columns = broken_at_gaps(Clock.of(found.run.solution.time)(time), np.column_stack((value, half)))
    middle = columns[:, 0] if name else 0.0
    band = Curve(f"±3 sd, {mode}", at, middle + columns[:, 1], shade, "band", middle - columns[:, 1])
    return [band, Curve(name or mode, at, columns[:, 0], colour)]


def _errors(found: EvaluatedRun, group: str) -> tuple[Panel, ...]:
    i = [each[0] for each in GROUPS].index(group)
    _, unit, size, names = GROUPS[i]
    panels = []
    for k, name in enumerate(names):
        curves, sizes = [], []
        for mode, each in reversed(found.known_errors.items()):
            value: FloatArray = getattr(each, group)[:, k] / size
            half = np.full_like(value, np.nan) if each.sd is None else 3.0 * each.sd[:, 3 * i + k] / size
            curves += _lines(found, each.time, value, half, mode)
            sizes.append(f"{number(rms(value))} {unit} {mode}")
        panels.append(_panel(found, f"{name} [{unit}]", curves, title=f"RMS {', '.join(sizes)}"))
    return tuple(panels)


def _state(
    found: EvaluatedRun, label: str, value: FloatArray, column: int, fixes: FloatArray | None = None, **how: Any
) -> Panel:
    """Draw one state of the solution with its measured fixes; `column` of its standard deviation."""
    (mode, solution), gps = next(iter(found.solutions.items())), found.gps
    size = 1.0 / DEG if label.endswith("[deg]") else 1.0
    half = np.full_like(value, np.nan) if solution.sd is None else 3.0 * size * solution.sd[:, column]
    curves = _lines(found, solution.time, value, half, mode, mode)
    if gps is not None and fixes is not None:
        curves.insert(0, Curve("GPS fix", Clock.of(solution.time)(gps.time), fixes, GREY, "points"))
    return _panel(found, label, curves, **how)


def _height(found: EvaluatedRun) -> tuple[Panel, ...]:
    fixes = None if found.gps is None else found.gps.lla[:, 2]
    return (_state(found, "height [m]", found.best.lla[:, 2], 2, fixes, height=280),)


def _velocity(found: EvaluatedRun) -> tuple[Panel, ...]:
    fixes = np.empty((0, 3)) if found.gps is None else found.gps.v_n
    return tuple(
        _state(found, f"{name} [m/s]", found.best.v_n[:, k], 3 + k, fixes[:, k])
        for k, name in enumerate(("north", "east", "down"))
    )


def _attitude(found: EvaluatedRun) -> tuple[Panel, ...]:
    heading, unwrapped = readable_heading(found.best.rph[:, 2])
    columns = (*(found.best.rph[:, :2] / DEG).T, heading)
    limits = (None, None, None if unwrapped else (-5.0, 365.0))
    return tuple(
        _state(found, f"{name} [deg]", columns[k], 6 + k, limits=limits[k])
        for k, name in enumerate(("roll", "pitch", "heading"))
    )


def readable_heading(heading: FloatArray) -> tuple[FloatArray, bool]:
    """Unwrap a heading in degrees if it turns little, else wrap to 0..360 with breaks at north."""
    smooth = np.degrees(np.unwrap(heading))
    if smooth.min() > -_BEYOND and smooth.max() < 360.0 + _BEYOND:
        return smooth, True
    wrapped = np.degrees(heading) % 360.0
    wrapped[np.flatnonzero(np.abs(np.diff(wrapped)) > 180.0)] = np.nan
    return wrapped, False


def _uncertainty(found: EvaluatedRun) -> tuple[Panel, ...]:
    labels = ("horizontal [m]", "height [m]", "horizontal velocity [m/s]", "heading [deg]")
    curves: list[list[Curve]] = [[], [], [], []]
    for mode, solution in found.solutions.items():
        sd = solution.sd
        if sd is None:
            continue
        sizes = (np.hypot(sd[:, 0], sd[:, 1]), sd[:, 2], np.hypot(sd[:, 3], sd[:, 4]), sd[:, 8] / DEG)
        time, columns = broken_at_gaps(Clock.of(found.run.solution.time)(solution.time), np.column_stack(sizes))
        for k in range(4):
            curves[k].append(Curve(mode, time, columns[:, k], _COLOURS[mode][0]))
    return tuple(_panel(found, label, own, log="y") for label, own in zip(labels, curves, strict=True))


def _innovations(found: EvaluatedRun) -> tuple[tuple[Panel, ...], int]:
    """Draw innovations of each component and NIS, with columns for measured positions and velocities."""
    fixes = found.run.innovations
    time = Clock.of(found.run.solution.time)(fixes.time)
    groups = [i for i in (0, 1) if np.isfinite(fixes.innovation[:, 3 * i : 3 * i + 3]).any()]
    panels = []
    for k, name in enumerate(("north", "east", "down")):
        for i in groups:
            group, unit = GROUPS[i][0], GROUPS[i][1]
            value, sd = fixes.innovation[:, 3 * i + k], 3.0 * fixes.sd[:, 3 * i + k]
            used: BoolArray = getattr(fixes, f"used_{group}") & np.isfinite(value)
            refused = np.isfinite(value) & ~used
            expected = sd[used] if used.any() else sd[refused]
            usual = float(np.percentile(expected, 98.0)) if expected.size else 0.0
            limit = 1.1 * max(float(np.max(np.abs(value[used]), initial=0.0)), usual, 1e-9)
            curves = [
                Curve("±3 sd", time, sd, SKY, "band", -sd),
                Curve("accepted", time[used], value[used], BLUE, "points"),
                Curve("rejected", time[refused], value[refused], VERMILLION, "crosses"),
            ]
            panels.append(_panel(found, f"{name} [{unit}]", curves, title=group, limits=(-limit, limit)))
    for i in groups:
        group = GROUPS[i][0]
        nis, used = getattr(fixes, f"nis_{group}") / 3.0, getattr(fixes, f"used_{group}")
        kept, refused = (nis > 0.0) & used, (nis > 0.0) & ~used
        curves = [
            Curve("accepted", time[kept], nis[kept], BLUE, "points"),
            Curve("rejected", time[refused], nis[refused], VERMILLION, "crosses"),
        ]
        levels = nis_levels(found.run, group)
        limits = (1e-2, max(100.0, 2.0 * float(np.max(nis[nis > 0.0], initial=0.0))))
        panels.append(_panel(found, "NIS per axis [-]", curves, title=group, log="y", limits=limits, levels=levels))
    return tuple(panels), len(groups)


def _sensor_errors(found: EvaluatedRun) -> tuple[Panel, ...]:
    estimated = next(iter(sensor_errors(found.run).values()))
    time, later = Clock.of(found.run.solution.time)(estimated.time), int(_SETTLED * len(estimated.time))
    panels = []
    for i, (name, unit, size) in enumerate(_SENSORS):
        value, half = (each[:, 3 * i : 3 * i + 3] / size for each in (estimated.value, 3.0 * estimated.sd))
        if not np.isfinite(value).any():
            continue
        curves = []
        for axis, colour in enumerate(AXIS_COLOURS):
            middle, wide = value[:, axis], half[:, axis]
            curves.append(Curve("", time, middle + wide, colour, "band", middle - wide))
            curves.append(Curve("xyz"[axis], time, middle, colour))
        low = min(float(np.nanmin(value)), float(np.nanmin((value - half)[later:])))
        high = max(float(np.nanmax(value)), float(np.nanmax((value + half)[later:])))
        margin = 0.05 * (high - low) or 1.0
        panels.append(_panel(found, f"[{unit}]", curves, title=name, limits=(low - margin, high + margin)))
    return tuple(panels)
