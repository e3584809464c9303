"""Drawings of a run: map, panels over one time axis, image files with separate components; plot of the input data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.evaluated_run import EvaluatedRun, outages
from insnav.errors.metrics import MOVING_M_S, TrajectoryErrors, travelled
from insnav.findings import Code, of_code
from insnav.imu.model import per_sample
from insnav.messages import render
from insnav.report import style
from insnav.report.panels import LEAST_ERROR, Clock, Curve, Drawing, Kind, Panel, Shade, Track, broken_at_gaps, wrapped
from insnav.sample_statistics import rms
from insnav.steps import Recording
from insnav.strapdown import nearest_rows
from insnav.types import BoolArray, FloatArray, Run, SensorErrors, Trajectory
from insnav.units import DEG, DEG_PER_H, G0, PPM

LINK = "time"
CHI2_95 = 7.815 / 3.0  # 95 % quantile of chi-square with 3 degrees of freedom, per axis
MAP_POINTS = 2000  # number of points of a track on the map
DRAWN = 200_000  # largest number of epochs of a solution in panels
T = TypeVar("T", Trajectory, TrajectoryErrors | None)
_VARIES = 1.5  # a quantity varies along the track if its 98 % quantile exceeds its 2 % quantile by this factor
EVENTS = 150  # largest number of marks per event code
_RPH, _XYZ = ("roll", "pitch", "heading"), ("x", "y", "z")
GROUPS = (("position", "m", 1.0, style.NED), ("velocity", "m/s", 1.0, style.NED), ("attitude", "deg", DEG, _RPH))
_FIX_TYPES = ((1.0, "fixed"), (2.0, "float"), (4.0, "DGPS"), (5.0, "single"), (0.0, "none"))
_GATES: dict[str, tuple[Code, ...]] = {
    "position": (Code.GATE_POSITION, Code.DEWEIGHTED_POSITION),
    "velocity": (Code.GATE_VELOCITY, Code.DEWEIGHTED_VELOCITY),
}
_GATES[""] = (*_GATES["position"], *_GATES["velocity"])
_COLOURS = {"filtered": (style.BLUE, style.SKY), "smoothed": (style.VERMILLION, style.ORANGE)}  # line, band
_BEYOND = 90.0  # an unwrapped heading may exceed 0..360 deg by this angle; otherwise it is wrapped [deg]
_SETTLED = 0.2  # share of the run whose wide bands of estimates do not determine the axis limits [-]
_SENSORS = (
    ("gyro bias", "deg/h", DEG_PER_H),
    ("accelerometer bias", "mg", 1e-3 * G0),
    ("gyro scale factor", "ppm", PPM),
    ("accelerometer scale factor", "ppm", PPM),
)


@dataclass(frozen=True, slots=True)
class RunAxis:
    """Common time axis of all panels of a run."""

    clock: Clock
    spans: tuple[tuple[float, float], ...]  # start and end of outages, in the unit of the axis

    @classmethod
    def of(cls, run: Run) -> RunAxis:
        """Build the time axis of a run; its origin is the start of the solution."""
        clock = Clock.of(run.solution.time)
        return cls(clock, tuple((float(clock(a)), float(clock(b))) for a, b, _ in outages(run)))

    def panel(self, key: str, title: str, y_label: str, curves: Iterable[Curve], **how: object) -> Panel:
        """Build a panel over the time axis, with shaded outages and without curves that are all NaN."""
        drawn = tuple(each for each in curves if np.isfinite(each.y).any())
        return Panel(key, title, y_label, self.clock.label, drawn, LINK, spans=self.spans, **how)  # type: ignore[arg-type]


def run_panels(found: EvaluatedRun) -> tuple[Track | Panel, ...]:
    """Build the map and all panels of the page that have data."""
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
    """Keep every n-th epoch of a long run, so that at most `DRAWN` epochs remain."""
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
    """Draw the stated standard deviations, and with a reference also the errors with bands of 3 sd."""
    errors = found.known_errors
    for i, (group, unit, factor, names) in enumerate(GROUPS):
        columns = slice(3 * i, 3 * i + 3)
        curves: list[Curve] = []
        if errors and any(np.isfinite(getattr(each, group)).any() for each in errors.values()):
            for mode, each in errors.items():
                sd = np.full((len(each.time), 3), np.nan) if each.sd is None else each.sd[:, columns]
                value, half = getattr(each, group) / factor, 3.0 * sd / factor
                curves += _banded(axis, names, each.time, value, half, mode, around=0.0)
            title, note = f"{group.capitalize()} error", "solution minus reference; band: ±3 sd as stated"
            yield axis.panel(f"{group}_error", title, f"error [{unit}]", curves, note=note)
            curves = []
        for mode, solution in found.solutions.items():
            if solution.sd is not None:
                time, sd = broken_at_gaps(axis.clock(solution.time), solution.sd[:, columns] / factor)
                curves += [Curve(n, time, sd[:, k], style.AXIS_COLOURS[k], mode=mode) for k, n in enumerate(names)]
        title, note = f"Stated uncertainty of {group}", "one standard deviation"
        yield axis.panel(f"{group}_sd", title, f"sd [{unit}]", curves, note=note, log="y")


def error_distribution(found: EvaluatedRun) -> tuple[Panel, ...]:
    """Draw the cumulative distribution of the horizontal error, also when stationary and moving, with CEP50 and R95."""
    curves, share = [], np.linspace(1.0, 100.0, 500)
    for mode, errors in found.known_errors.items():
        size, moving = np.maximum(errors.horizontal, LEAST_ERROR), errors.moving
        parts = ("all", ~np.isnan(size), style.BLUE), ("static", ~moving, style.GREEN), ("moving", moving, style.ORANGE)
        for name, rows, colour in parts[: 3 if moving.any() and not moving.all() else 1]:
            curves.append(Curve(name, np.percentile(size[rows], share), share, colour, mode=mode))
        circles = np.percentile(size, (50.0, 95.0))
        name = f"CEP50 {style.number(circles[0])} m, R95 {style.number(circles[1])} m"
        curves.append(Curve(name, circles, np.array([50.0, 95.0]), style.VERMILLION, "crosses", mode=mode))
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
    """Draw lines over time for three axes, each with a band.

    `time` (n,) [s]. `value` (n, 3): lines. `half` (n, 3): half widths. `around`: middle of the bands; None: `value`.
    """
    x, columns = broken_at_gaps(axis.clock(time), np.column_stack((value, half)))
    curves = []
    for k, (name, colour) in enumerate(zip(names, style.AXIS_COLOURS, strict=True)):
        line, width = columns[:, k], columns[:, 3 + k]
        middle = line if around is None else around
        band = Curve(name, x, middle + width, colour, "band", middle - width, mode)
        curves += [band] if np.isfinite(width).any() else []
        curves.append(Curve(name, x, line, colour, mode=mode))
    return curves


def _innovation_panels(run: Run, axis: RunAxis) -> Iterator[Panel]:
    fixes, nis = run.innovations, []
    time = axis.clock(fixes.time)
    for i, (group, unit, _, names) in enumerate(GROUPS[:2]):
        columns = slice(3 * i, 3 * i + 3)
        used: BoolArray = getattr(fixes, f"used_{group}")
        value, sd = fixes.innovation[:, columns], fixes.sd[:, columns]
        curves = []
        for k, (name, colour) in enumerate(zip(names, style.AXIS_COLOURS, strict=True)):
            curves.append(Curve(name, time, 3.0 * sd[:, k], colour, "band", -3.0 * sd[:, k]))
            curves.append(Curve(name, time[used], value[used, k], colour, "points"))
            curves.append(Curve("rejected", time[~used], value[~used, k], colour, "crosses"))
        note = "measured minus predicted; band: ±3 sd as predicted"
        title = f"Innovations of GPS {group}"
        yield axis.panel(f"innovations_{group}", title, f"innovation [{unit}]", curves, note=note)
        size, colour = getattr(fixes, f"nis_{group}") / 3.0, (style.BLUE, style.ORANGE)[i]
        positive = size > 0.0
        nis += [
            Curve(group, time[used & positive], size[used & positive], colour, "points"),
            Curve("rejected", time[~used & positive], size[~used & positive], colour, "crosses"),
        ]
    note = "normalised innovation squared of each fix, per axis: 1 on average if the stated sd is right"
    yield axis.panel("nis", "NIS", "NIS per axis [-]", nis, note=note, log="y", levels=nis_levels(run))


def nis_levels(run: Run, group: str = "") -> tuple[tuple[float, str], ...]:
    """Return value and name of each level: 95 % of NIS per axis, and the gates. `group`: "position", "velocity"."""
    limits = sorted({each.limit / 3.0 for each in of_code(run.events, *_GATES[group]) if np.isfinite(each.limit)})
    return (CHI2_95, f"95 % ({CHI2_95:.1f})"), *((limit, f"gate ({limit:.1f})") for limit in limits)


def sensor_errors(run: Run) -> dict[str, SensorErrors]:
    """Return the estimated sensor errors of each solution, the smoothed solution first."""
    smoothed = {} if run.smoothed is None else {"smoothed": run.smoothed.sensor_errors}
    return {mode: each for mode, each in (smoothed | {"filtered": run.sensor_errors}).items() if len(each.time)}


def _bias_panels(run: Run, axis: RunAxis) -> Iterator[Panel]:
    found = sensor_errors(run)
    for key, title, unit, size, first in (
        ("gyro_bias", "Gyro bias", "deg/h", DEG_PER_H, 0),
        ("accel_bias", "Accelerometer bias", "mg", 1e-3 * G0, 3),
    ):
        axes = slice(first, first + 3)
        curves: list[Curve] = []
        for mode, each in found.items():
            value, sd = each.value[:, axes] / size, each.sd[:, axes] / size
            curves += _banded(axis, _XYZ, each.time, value, sd, mode if len(found) > 1 else "")
        yield axis.panel(key, title, f"bias [{unit}]", curves, note="as estimated, body axes; band: ±1 sd")


def _separation(run: Run, axis: RunAxis) -> list[Panel]:
    """Draw the filtered minus the smoothed position, with its expected 3 sd.

    For an optimal filter the covariance of this difference is the difference of the covariances (Rauch, Tung and
    Striebel 1965).
    """
    if run.smoothed is None:
        return []
    filtered, smoothed = run.solution, run.smoothed.solution
    difference = ned_offset(filtered.lla, smoothed.lla)
    expected = np.full_like(difference, np.nan)
    if filtered.sd is not None and smoothed.sd is not None:
        expected = 3.0 * np.sqrt(np.maximum(filtered.sd[:, :3] ** 2 - smoothed.sd[:, :3] ** 2, 0.0))
    curves = _banded(axis, style.NED, filtered.time, difference, expected, around=0.0)
    note = "filtered minus smoothed position; band: ±3 sd as expected of the difference"
    return [axis.panel("separation", "Forward-backward separation", "separation [m]", curves, note=note)]


def _motion(found: EvaluatedRun, axis: RunAxis) -> list[Panel]:
    speeds, heights, tilts, headings, seen, gps = [], [], [], [], list[Curve](), found.gps
    for mode, solution in found.solutions.items():
        values = np.column_stack((np.linalg.norm(solution.v_n, axis=1), solution.lla[:, 2], solution.rph / DEG))
        time, columns = broken_at_gaps(axis.clock(solution.time), values)
        speeds.append(Curve("solution", time, columns[:, 0], style.BLUE, mode=mode))
        heights.append(Curve("solution", time, columns[:, 1], style.BLUE, mode=mode))
        tilts += [Curve(n, time, columns[:, 2 + k], style.AXIS_COLOURS[k], mode=mode) for k, n in enumerate(_RPH[:2])]
        headings.append(Curve("heading", time, wrapped(columns[:, 4]), style.BLUE, mode=mode))
    if gps is not None:
        axis_time = axis.clock(gps.time)
        speeds.insert(0, Curve("GPS", axis_time, np.linalg.norm(gps.v_n, axis=1), style.GREY, "points"))
        heights.insert(0, Curve("GPS, at the antenna", axis_time, gps.lla[:, 2], style.GREY, "points"))
        named = ("satellites", gps.satellites, style.BLUE), ("DOP", gps.dop, style.ORANGE)
        seen = [Curve(name, axis_time, values, color, "points") for name, values, color in named if values is not None]
    return [
        axis.panel("speed", "Speed", "speed [m/s]", speeds),
        axis.panel("height", "Height", "height [m]", heights, note="height of the IMU, datum of the fixes"),
        axis.panel("tilt", "Roll and pitch", "angle [deg]", tilts, note="roll: right side down; pitch: nose up"),
        axis.panel("heading", "Heading", "heading [deg]", headings, note="from north, clockwise", limits=(-5.0, 365.0)),
        *([axis.panel("reception", "Satellites and DOP", "[-]", seen, note="from the receiver")] if seen else []),
    ]


def _events(run: Run, axis: RunAxis) -> list[Panel]:
    """Draw marks of findings that have a time, a row per code; at most `EVENTS` marks per code."""
    timed = [each for each in run.events if each.timed]
    rows, curves = {each.code: render(each).title for each in timed}, []
    for row, code in enumerate(rows):
        events = list(of_code(timed, code))
        marked = events[:: max(1, -(-len(events) // EVENTS))]
        texts = tuple(f"{axis.clock.moment(each.begin, each.end)}: {axis.clock.sentence(each)}" for each in marked)
        x = axis.clock(np.array([each.begin for each in marked]))
        curves.append(Curve("event", x, np.full(len(marked), float(row)), style.VERMILLION, "points", text=texts))
    if not curves:
        return []
    height = 70 + 34 * len(rows)
    note = "hover over an event to read it, click to go there"
    return [axis.panel("events", "Events", "", curves, note=note, rows=tuple(rows.values()), height=height)]


def run_track(found: EvaluatedRun) -> Track:
    """Draw a map: the track of the better solution, fixes, outages, rejected positions, reference, backdrop."""
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
    # the map shows the first quantity in this order: quantities that vary in the better solution come first
    first = {each.name: each for each in reversed([*shades, speed])}
    shades = sorted([*shades, speed], key=lambda each: _even(first[each.name]))
    if gps is not None and gps.fix is not None and len(gps.time):
        shades.append(Shade("fix", gps.fix[nearest_rows(gps.time, time)].astype(np.float64), _FIX_TYPES))
    if np.isfinite(run.innovations.nis_position).any():
        has_nis = np.isfinite(run.innovations.nis_position)
        nis_time, nis = run.innovations.time[has_nis], run.innovations.nis_position[has_nis] / 3.0
        shades.append(Shade("NIS of position, per axis [-]", nis[nearest_rows(nis_time, time)]))
    fixes = None if gps is None else ned_offset(gps.lla, origin)[:, [1, 0]]
    behind = *_reference(found, origin), *_rejected(run, time, position)
    if found.backdrop is not None:
        level = np.column_stack((found.backdrop, np.full(len(found.backdrop), origin[2])))
        north, east, _ = ned_offset(level, origin).T
        behind = (Curve("backdrop", east, north, style.GREY, "thin"), *behind)
    lat, lon = origin[:2] / DEG
    note = f"start at latitude {lat:.5f}°, longitude {lon:.5f}°; point at the track to see the time"
    shown = position[:, 1], position[:, 0], axis.clock(time), tuple(shades)
    return Track("track", "Track", *shown, LINK, fixes, axis.spans, note, behind)


def _even(shade: Shade) -> bool:
    """Return whether a quantity hardly varies along the track, so that its colours would show nothing."""
    low, high = np.nanpercentile(shade.values, (2.0, 98.0)) if np.isfinite(shade.values).any() else (0.0, 0.0)
    return bool(high < _VARIES * low or high == 0.0)


def _reference(found: EvaluatedRun, origin: FloatArray) -> Iterator[Curve]:
    """Draw the track of the reference, computed as the better solution minus its errors."""
    for mode, errors in [*found.known_errors.items()][:1]:
        time, track = found.solutions[mode].time, ned_offset(found.solutions[mode].lla, origin)
        rows = np.unique(np.linspace(0, len(errors.time) - 1, MAP_POINTS).round().astype(np.int64))
        north, east = (np.interp(errors.time, time, track[:, k]) - errors.position[:, k] for k in (0, 1))
        yield Curve("reference", east[rows], north[rows], style.PURPLE)


def _rejected(run: Run, time: FloatArray, position: FloatArray) -> tuple[Curve, ...]:
    """Draw crosses at the measured positions of rejected fixes, computed as solution plus innovation."""
    fixes = run.innovations
    refused = np.isfinite(fixes.innovation[:, :2]).all(axis=1) & ~fixes.used_position
    if not refused.any():
        return ()
    fix_time, innovation = fixes.time[refused], fixes.innovation[refused]
    north, east = (np.interp(fix_time, time, position[:, k]) + innovation[:, k] for k in (0, 1))
    return (Curve(f"position rejected ({len(fix_time)})", east, north, style.VERMILLION, "crosses"),)


def figure_drawings(name: str, found: EvaluatedRun) -> tuple[str, str, tuple[Drawing, ...], int]:
    """Build one figure of a run by name; figures of a single solution show the better one.

    Returns: title, explanation, drawings, number of columns.
    """
    solution, fixes = found.run.solution, found.run.innovations
    if name.endswith("_error"):
        group = name.removesuffix("_error")
        return f"{group.capitalize()} error: solution minus reference", "band: ±3 sd", _errors(found, group), 1
    if name == "track":
        title = (
            f"Track of {style.distance_text(travelled(solution)[0])} in {style.duration_text(np.ptp(solution.time))}"
        )
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
    figures = {
        "error_distribution": (f"Distribution of the horizontal error, {best}", "", error_distribution),
        "height": ("Height, with the datum of the fixes", "band: ±3 sd; fixes at the antenna", _height),
        "velocity": ("Velocity of the solution", "band: ±3 sd; fixes at the antenna", _velocity),
        "attitude": ("Attitude of the solution", "band: ±3 sd", _attitude),
        "uncertainty": ("Standard deviation of the solution", "smoothed (RTS): from all fixes", _uncertainty),
        "biases": (f"Estimated sensor errors, {best}", "line: estimate; band: ±3 sd", _sensor_errors),
    }
    title, note, make = figures[name]
    return title, note, make(found), 1


def _panel(found: EvaluatedRun, label: str, curves: Sequence[Curve], *, title: str = "", **how: object) -> Panel:
    return RunAxis.of(found.run).panel("figure", title, label, curves, **how)


def _lines(
    found: EvaluatedRun, time: FloatArray, value: FloatArray, half: FloatArray, mode: str, name: str = ""
) -> list[Curve]:
    """Draw a line (n,) with a band of half width (n,) around it, or around zero if it has no `name`: an error."""
    colour, shade = _COLOURS[mode]
    x, columns = broken_at_gaps(Clock.of(found.run.solution.time)(time), np.column_stack((value, half)))
    middle = columns[:, 0] if name else 0.0
    band = Curve(f"±3 sd, {mode}", x, middle + columns[:, 1], shade, "band", middle - columns[:, 1])
    return [band, Curve(name or mode, x, columns[:, 0], colour)]


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
            sizes.append(f"{style.number(rms(value))} {unit} {mode}")
        panels.append(_panel(found, f"{name} [{unit}]", curves, title=f"RMS {', '.join(sizes)}"))
    return tuple(panels)


def _state(
    found: EvaluatedRun, label: str, value: FloatArray, column: int, fixes: FloatArray | None = None, **how: Any
) -> Panel:
    """Draw a state (n,) of the better solution with its 3 sd, and fixes (m,). `column`: column of the state's sd."""
    (mode, solution), gps = next(iter(found.solutions.items())), found.gps
    size = 1.0 / DEG if label.endswith("[deg]") else 1.0
    half = np.full_like(value, np.nan) if solution.sd is None else 3.0 * size * solution.sd[:, column]
    curves = _lines(found, solution.time, value, half, mode, mode)
    if gps is not None and fixes is not None:
        curves.insert(0, Curve("GPS fix", Clock.of(solution.time)(gps.time), fixes, style.GREY, "points"))
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
    """Convert a heading (n,) [rad] to [deg]: unwrapped and True if within `_BEYOND` of 0..360; else wrapped, False."""
    smooth = np.degrees(np.unwrap(heading))
    if smooth.min() > -_BEYOND and smooth.max() < 360.0 + _BEYOND:
        return smooth, True
    return wrapped(np.degrees(heading)), False


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
    return tuple(_panel(found, label, lines, log="y") for label, lines in zip(labels, curves, strict=True))


def _innovations(found: EvaluatedRun) -> tuple[tuple[Panel, ...], int]:
    """Draw the innovations of each component and the NIS; one column of panels for positions, one for velocities."""
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
            # the axis shows all accepted innovations and the usual 3 sd; rejected fixes may lie outside
            expected = sd[used] if used.any() else sd[refused]
            typical = float(np.percentile(expected, 98.0)) if expected.size else 0.0
            limit = 1.1 * max(float(np.max(np.abs(value[used]), initial=0.0)), typical, 1e-9)
            curves = [
                Curve("±3 sd", time, sd, style.SKY, "band", -sd),
                Curve("accepted", time[used], value[used], style.BLUE, "points"),
                Curve("rejected", time[refused], value[refused], style.VERMILLION, "crosses"),
            ]
            panels.append(_panel(found, f"{name} [{unit}]", curves, title=group, limits=(-limit, limit)))
    for i in groups:
        group = GROUPS[i][0]
        nis, used = getattr(fixes, f"nis_{group}") / 3.0, getattr(fixes, f"used_{group}")
        kept, refused = (nis > 0.0) & used, (nis > 0.0) & ~used
        curves = [
            Curve("accepted", time[kept], nis[kept], style.BLUE, "points"),
            Curve("rejected", time[refused], nis[refused], style.VERMILLION, "crosses"),
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
        for axis, colour in enumerate(style.AXIS_COLOURS):
            middle, wide = value[:, axis], half[:, axis]
            curves.append(Curve("", time, middle + wide, colour, "band", middle - wide))
            curves.append(Curve("xyz"[axis], time, middle, colour))
        # the axis shows the whole estimate, but its band only after the first fifth of the run
        low = min(float(np.nanmin(value)), float(np.nanmin((value - half)[later:])))
        high = max(float(np.nanmax(value)), float(np.nanmax((value + half)[later:])))
        margin = 0.05 * (high - low) or 1.0
        panels.append(_panel(found, f"[{unit}]", curves, title=name, limits=(low - margin, high + margin)))
    return tuple(panels)


def drive_figure(recording: Recording) -> Any:
    """Draw the data of a recording over time: angular rates, specific forces, fixes and velocities; gaps are shaded."""
    imu, gps = recording.imu.data, recording.gps
    clock, step = Clock.of(imu.time), per_sample(imu)
    rows: list[tuple[str, str, FloatArray, FloatArray, tuple[str, ...], Kind]] = [
        ("Angular rate", "rate [deg/s]", imu.time, imu.gyro / step / DEG, ("x", "y", "z"), "line"),
        ("Specific force", "force [m/s²]", imu.time, imu.accel / step, ("x", "y", "z"), "line"),
    ]
    if gps is not None:
        time, offset = gps.data.time, ned_offset(gps.data.lla, gps.data.lla[0])
        rows.append(("Fixes, relative to the first", "distance [m]", time, offset, style.NED, "points"))
        rows.append(("Velocity of the fixes", "velocity [m/s]", time, gps.data.v_n, style.NED, "points"))
    files = recording.given().values()
    gaps = [(each.begin, each.begin + each["gap_s"]) for file in files for each in of_code(file.events, Code.ROWS_GAP)]
    spans = tuple((float(begin), float(end)) for begin, end in clock(np.reshape(gaps, (-1, 2))))
    panels = [
        Panel(title, title, label, clock.label, tuple(curves), "time", spans=spans)
        for title, label, at, values, names, kind in rows
        if np.isfinite(values).any()
        for curves in [
            [Curve(n, clock(at), v, c, kind) for n, v, c in zip(names, values.T, style.AXIS_COLOURS, strict=True)]
        ]
    ]
    title = f"{style.duration_text(np.ptp(imu.time))} of data, {len(gaps)} gap{'s' * (len(gaps) != 1)}"
    from insnav.report.figures import draw_drawings, drawing  # imports matplotlib, needed only to draw figures

    with drawing():
        return draw_drawings(panels, title, "body axes as read; shaded: gaps in any of the files")
