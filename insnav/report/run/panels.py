"""Interactive drawings of a run: the track, and panels over one time axis."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.evaluated_run import EvaluatedRun, outages
from insnav.errors.metrics import MOVING_M_S, TrajectoryErrors
from insnav.findings import Code, of_code
from insnav.messages import render
from insnav.report.panels import LEAST_ERROR, Clock, Curve, Panel, Shade, Track, broken_at_gaps, wrapped
from insnav.report.style import AXIS_COLOURS, BLUE, GREEN, GREY, NED, ORANGE, VERMILLION, number
from insnav.strapdown import nearest_rows
from insnav.types import BoolArray, FloatArray, Run, SensorErrors, Trajectory
from insnav.units import DEG, DEG_PER_H, G0

LINK = "time"
CHI2_95 = 7.815 / 3.0  # 95 % point of chi-square with 3 degrees of freedom, per axis
MAP_POINTS = 2000
DRAWN = 200_000  # rows of a solution at most
T = TypeVar("T", Trajectory, TrajectoryErrors | None)
_VARIES = 1.5  # least ratio of values for a colour scale
EVENTS = 150  # largest number of marks per kind
_RPH, _XYZ = ("roll", "pitch", "heading"), ("x", "y", "z")
GROUPS = (("position", "m", 1.0, NED), ("velocity", "m/s", 1.0, NED), ("attitude", "deg", DEG, _RPH))
_FIX_TYPES = ((1.0, "fixed"), (2.0, "float"), (4.0, "DGPS"), (5.0, "single"), (0.0, "none"))
_GATES: dict[str, tuple[Code, ...]] = {
    "position": (Code.GATE_POSITION, Code.DEWEIGHTED_POSITION),
    "velocity": (Code.GATE_VELOCITY, Code.DEWEIGHTED_VELOCITY),
}
_GATES[""] = (*_GATES["position"], *_GATES["velocity"])


@dataclass(frozen=True, slots=True)
class RunAxis:
    """Common time axis of all panels of a run."""

    clock: Clock
    spans: tuple[tuple[float, float], ...]  # outages, on the axis

    @classmethod
    def of(cls, run: Run) -> RunAxis:
        """Build the axis from the start of the solution."""
        clock = Clock.of(run.solution.time)
        return cls(clock, tuple((float(clock(a)), float(clock(b))) for a, b, _ in outages(run)))

    def panel(self, key: str, title: str, y_label: str, curves: Iterable[Curve], **how: object) -> Panel:
        """Build a panel over the axis, outages shaded, with the known curves."""
        drawn = tuple(each for each in curves if np.isfinite(each.y).any())
        return Panel(key, title, y_label, self.clock.label, drawn, LINK, spans=self.spans, **how)  # type: ignore[arg-type]


def run_panels(found: EvaluatedRun) -> tuple[Track | Panel, ...]:
    """Build the map and every panel with data."""
    if len(found.run.solution.time) < 2:
        return ()
    found = _drawn(found)
    run = found.run
    axis = RunAxis.of(run)
    panels = [
        *sorted(_state_panels(found, axis), key=lambda each: each.key.endswith("_sd")),
        *error_distribution(found),
        *_innovation_panels(run, axis),
        *_bias_panels(run, axis),
        *_separation(run, axis),
        *_motion(found, axis),
        *_events(run, axis),
    ]
    return (run_track(found), *(each for each in panels if each.curves))


def _drawn(found: EvaluatedRun) -> EvaluatedRun:
    """Decimate a long run to the resolution of a screen."""
    step = -(-len(found.run.solution.time) // DRAWN)
    if step == 1:
        return found

    def some(rows: T) -> T:
        return rows if rows is None else rows.rows(slice(None, None, step))

    run, smoothed = found.run, found.run.smoothed
    smoothed = smoothed and replace(smoothed, solution=some(smoothed.solution))
    run = replace(run, solution=some(run.solution), smoothed=smoothed)
    return replace(found, run=run, errors=some(found.errors), smoothed_errors=some(found.smoothed_errors))


def _state_panels(found: EvaluatedRun, axis: RunAxis) -> Iterator[Panel]:
    """Draw errors with three standard deviations if there is a reference, and the standard deviations."""
    errors = found.known_errors
    for i, (group, unit, size, names) in enumerate(GROUPS):
        columns = slice(3 * i, 3 * i + 3)
        curves: list[Curve] = []
        if errors and any(np.isfinite(getattr(each, group)).any() for each in errors.values()):
            for mode, each in errors.items():
                sd = np.full((len(each.time), 3), np.nan) if each.sd is None else each.sd[:, columns]
                value, half = getattr(each, group) / size, 3.0 * sd / size
                curves += _banded(axis, names, each.time, value, half, mode, around=0.0)
            title, note = f"{group.capitalize()} error", "solution minus reference; band: ±3 sd as stated"
            yield axis.panel(f"{group}_error", title, f"error [{unit}]", curves, note=note)
            curves = []
        for mode, solution in found.solutions.items():
            if solution.sd is not None:
                time, sd = broken_at_gaps(axis.clock(solution.time), solution.sd[:, columns] / size)
                curves += [Curve(n, time, sd[:, k], AXIS_COLOURS[k], mode=mode) for k, n in enumerate(names)]
        title, note = f"Stated uncertainty of {group}", "one standard deviation"
        yield axis.panel(f"{group}_sd", title, f"sd [{unit}]", curves, note=note, log="y")


def error_distribution(found: EvaluatedRun) -> tuple[Panel, ...]:
    """Draw the share of horizontal errors below a given one, with CEP50 and R95; at rest and in motion, too."""
    curves, share = [], np.linspace(1.0, 100.0, 500)
    for mode, errors in found.known_errors.items():
        size, moving = np.maximum(errors.horizontal, LEAST_ERROR), errors.moving
        parts = ("all", ~np.isnan(size), BLUE), ("static", ~moving, GREEN), ("moving", moving, ORANGE)
        for name, rows, colour in parts[: 3 if moving.any() and not moving.all() else 1]:
            curves.append(Curve(name, np.percentile(size[rows], share), share, colour, mode=mode))
        circles = np.percentile(size, (50.0, 95.0))
        name = f"CEP50 {number(circles[0])} m, R95 {number(circles[1])} m"
        curves.append(Curve(name, circles, np.array([50.0, 95.0]), VERMILLION, "crosses", mode=mode))
    title, labels = "Distribution of the horizontal error", ("epochs below [%]", "horizontal error [m]")
    note = f"moving: faster than {MOVING_M_S:g} m/s"
    limits = (0.0, 101.0)
    return (Panel("error_distribution", title, *labels, tuple(curves), note=note, log="x", limits=limits),)


def _banded(
    axis: RunAxis,
    names: tuple[str, ...],
    time: FloatArray,
    value: FloatArray,
    half: FloatArray,
    mode: str = "",
    *,
    around: float | None = None,
) -> list[Curve]:
    """Draw three lines with their bands.

    `time` (n,) [s]. `value`, `half` (n, 3): middle and half width. `around`: middle of the band; None: the line.
    """
    at, columns = broken_at_gaps(axis.clock(time), np.column_stack((value, half)))
    curves = []
    for k, (name, colour) in enumerate(zip(names, AXIS_COLOURS, strict=True)):
        line, width = columns[:, k], columns[:, 3 + k]
        middle = line if around is None else around
        band = Curve(name, at, middle + width, colour, "band", middle - width, mode)
        curves += [band] if np.isfinite(width).any() else []
        curves.append(Curve(name, at, line, colour, mode=mode))
    return curves


def _innovation_panels(run: Run, axis: RunAxis) -> Iterator[Panel]:
    fixes, nis = run.innovations, []
    time = axis.clock(fixes.time)
    for i, (group, unit, _, names) in enumerate(GROUPS[:2]):
        columns = slice(3 * i, 3 * i + 3)
        used: BoolArray = getattr(fixes, f"used_{group}")
        value, sd = fixes.innovation[:, columns], fixes.sd[:, columns]
        curves = []
        for k, (name, colour) in enumerate(zip(names, AXIS_COLOURS, strict=True)):
            curves.append(Curve(name, time, 3.0 * sd[:, k], colour, "band", -3.0 * sd[:, k]))
            curves.append(Curve(name, time[used], value[used, k], colour, "points"))
            curves.append(Curve("rejected", time[~used], value[~used, k], colour, "crosses"))
        note = "measured minus predicted; band: ±3 sd as predicted"
        title = f"Innovations of GPS {group}"
        yield axis.panel(f"innovations_{group}", title, f"innovation [{unit}]", curves, note=note)
        size, colour = getattr(fixes, f"nis_{group}") / 3.0, (BLUE, ORANGE)[i]
        positive = size > 0.0
        nis += [
            Curve(group, time[used & positive], size[used & positive], colour, "points"),
            Curve("rejected", time[~used & positive], size[~used & positive], colour, "crosses"),
        ]
    note = "normalised innovation squared of each fix, per axis: 1 on average if the stated sd is right"
    yield axis.panel("nis", "NIS", "NIS per axis [-]", nis, note=note, log="y", levels=nis_levels(run))


def nis_levels(run: Run, group: str = "") -> tuple[tuple[float, str], ...]:
    """Return 95 % NIS per axis, and the reject and de-weight gates. `group`: of positions or velocities."""
    limits = sorted({each.limit / 3.0 for each in of_code(run.events, *_GATES[group]) if np.isfinite(each.limit)})
    return (CHI2_95, f"95 % ({CHI2_95:.1f})"), *((limit, f"gate ({limit:.1f})") for limit in limits)


def sensor_errors(run: Run) -> dict[str, SensorErrors]:
    """Return estimated sensor errors by solution, the better one first."""
    both = {} if run.smoothed is None else {"smoothed": run.smoothed.sensor_errors}
    return {mode: each for mode, each in (both | {"filtered": run.sensor_errors}).items() if len(each.time)}


def _bias_panels(run: Run, axis: RunAxis) -> Iterator[Panel]:
    found = sensor_errors(run)
    for key, title, unit, size, first in (
        ("gyro_bias", "Gyro bias", "deg/h", DEG_PER_H, 0),
        ("accel_bias", "Accelerometer bias", "mg", 1e-3 * G0, 3),
    ):
        own = slice(first, first + 3)
        curves: list[Curve] = []
        for mode, each in found.items():
            value, sd = each.value[:, own] / size, each.sd[:, own] / size
            curves += _banded(axis, _XYZ, each.time, value, sd, mode if len(found) > 1 else "")
        yield axis.panel(key, title, f"bias [{unit}]", curves, note="as estimated, body axes; band: ±1 sd")


def _separation(run: Run, axis: RunAxis) -> list[Panel]:
    """Draw the difference between filter and smoother, which also uses later fixes.

    For an optimal filter the covariance of the difference is the difference of the covariances (Rauch, Tung and
    Striebel 1965).
    """
    if run.smoothed is None:
        return []
    filtered, smoothed = run.solution, run.smoothed.solution
    apart = ned_offset(filtered.lla, smoothed.lla)
    expected = np.full_like(apart, np.nan)
    if filtered.sd is not None and smoothed.sd is not None:
        expected = 3.0 * np.sqrt(np.maximum(filtered.sd[:, :3] ** 2 - smoothed.sd[:, :3] ** 2, 0.0))
    curves = _banded(axis, NED, filtered.time, apart, expected, around=0.0)
    note = "filtered minus smoothed position; band: ±3 sd as expected of the difference"
    return [axis.panel("separation", "Forward-backward separation", "separation [m]", curves, note=note)]


def _motion(found: EvaluatedRun, axis: RunAxis) -> list[Panel]:
    speeds, heights, tilts, headings = [], [], [], []
    gps = found.gps
    for mode, solution in found.solutions.items():
        values = np.column_stack((np.linalg.norm(solution.v_n, axis=1), solution.lla[:, 2], solution.rph / DEG))
        time, columns = broken_at_gaps(axis.clock(solution.time), values)
        speeds.append(Curve("solution", time, columns[:, 0], BLUE, mode=mode))
        heights.append(Curve("solution", time, columns[:, 1], BLUE, mode=mode))
        tilts += [Curve(n, time, columns[:, 2 + k], AXIS_COLOURS[k], mode=mode) for k, n in enumerate(_RPH[:2])]
        headings.append(Curve("heading", time, wrapped(columns[:, 4]), BLUE, mode=mode))
    if gps is not None:
        at = axis.clock(gps.time)
        speeds.insert(0, Curve("GPS", at, np.linalg.norm(gps.v_n, axis=1), GREY, "points"))
        heights.insert(0, Curve("GPS, at the antenna", at, gps.lla[:, 2], GREY, "points"))
    return [
        axis.panel("speed", "Speed", "speed [m/s]", speeds),
        axis.panel("height", "Height", "height [m]", heights, note="of the IMU, zero as in the fixes"),
        axis.panel("tilt", "Roll and pitch", "angle [deg]", tilts, note="roll: right side down; pitch: nose up"),
        axis.panel("heading", "Heading", "heading [deg]", headings, note="from north, clockwise", limits=(-5.0, 365.0)),
    ]


def _events(run: Run, axis: RunAxis) -> list[Panel]:
    """Draw marks of findings with a time, a row per code; of many per code only some are marked."""
    timed = [each for each in run.events if each.timed]
    rows, curves = {each.code: render(each).title for each in timed}, []
    for row, code in enumerate(rows):
        own = list(of_code(timed, code))
        some = own[:: max(1, -(-len(own) // EVENTS))]
        texts = tuple(f"{axis.clock.moment(each.begin, each.end)}: {axis.clock.sentence(each)}" for each in some)
        at = axis.clock(np.array([each.begin for each in some]))
        curves.append(Curve("event", at, np.full(len(some), float(row)), VERMILLION, "points", text=texts))
    if not curves:
        return []
    height = 70 + 34 * len(rows)
    note = "point at one to read it, click to go there"
    return [axis.panel("events", "Events", "", curves, note=note, rows=tuple(rows.values()), height=height)]


def run_track(found: EvaluatedRun) -> Track:
    """Draw the track from above, with fixes, outages and rejected positions."""
    run, gps, axis = found.run, found.gps, RunAxis.of(found.run)
    solution = found.best
    rows = np.unique(np.linspace(0, len(solution.time) - 1, MAP_POINTS).round().astype(np.int64))
    origin, time = solution.lla[0], solution.time[rows]
    position = ned_offset(solution.lla[rows], origin)
    shades = [
        Shade("horizontal sd [m]", np.hypot(*each.sd[rows, :2].T), mode=mode)
        for mode, each in found.solutions.items()
        if each.sd is not None
    ]
    for mode, each in found.known_errors.items():
        shades.append(
            Shade("horizontal error [m]", np.interp(time, each.time, each.horizontal, np.nan, np.nan), mode=mode)
        )
    speed = Shade("speed [m/s]", np.linalg.norm(solution.v_n[rows], axis=1))
    first = {each.name: each for each in reversed([*shades, speed])}  # of the better solution, shown first if it varies
    shades = sorted([*shades, speed], key=lambda each: _even(first[each.name]))
    if gps is not None and gps.fix is not None and len(gps.time):
        shades.append(Shade("fix", gps.fix[nearest_rows(gps.time, time)].astype(np.float64), _FIX_TYPES))
    if np.isfinite(run.innovations.nis_position).any():
        known = np.isfinite(run.innovations.nis_position)
        at, nis = run.innovations.time[known], run.innovations.nis_position[known] / 3.0
        shades.append(Shade("NIS of position, per axis [-]", nis[nearest_rows(at, time)]))
    fixes = None if gps is None else ned_offset(gps.lla, origin)[:, [1, 0]]
    behind = _rejected(run, time, position)
    if found.backdrop is not None:
        level = np.column_stack((found.backdrop, np.full(len(found.backdrop), origin[2])))
        north, east, _ = ned_offset(level, origin).T
        behind = (Curve("backdrop", east, north, GREY, "thin"), *behind)
    lat, lon = origin[:2] / DEG
    note = f"start at latitude {lat:.5f}°, longitude {lon:.5f}°; point at the track to see the time"
    shown = position[:, 1], position[:, 0], axis.clock(time), tuple(shades)
    return Track("track", "Track", *shown, LINK, fixes, axis.spans, note, behind)


def _even(shade: Shade) -> bool:
    """Return whether a quantity is constant along the whole track."""
    low, high = np.nanpercentile(shade.values, (2.0, 98.0)) if np.isfinite(shade.values).any() else (0.0, 0.0)
    return bool(high < _VARIES * low or high == 0.0)


def _rejected(run: Run, time: FloatArray, position: FloatArray) -> tuple[Curve, ...]:
    """Mark rejected fixes at their measured position: solution plus innovation."""
    fixes = run.innovations
    refused = np.isfinite(fixes.innovation[:, :2]).all(axis=1) & ~fixes.used_position
    if not refused.any():
        return ()
    at, off = fixes.time[refused], fixes.innovation[refused]
    north, east = (np.interp(at, time, position[:, k]) + off[:, k] for k in (0, 1))
    return (Curve(f"position rejected ({len(at)})", east, north, VERMILLION, "crosses"),)
