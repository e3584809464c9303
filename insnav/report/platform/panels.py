"""The platform: where it went, how fast, how its gyros are torqued, its errors, and how integrators differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.metrics import TrajectoryErrors
from insnav.errors.platform_errors import Convergence, PlatformComparison, PlatformStudy
from insnav.errors.schuler import StaticErrors
from insnav.gimbal import INTEGRATORS, Integrator, PlatformRun, integral, torquing_rates
from insnav.report.colours import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from insnav.report.panels import Curve, Panel, Shade, Track, over_time
from insnav.report.series import Clock
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H

COLOURS: Mapping[Integrator, str] = {"forward": VERMILLION, "backward": ORANGE, "mean": BLUE, "fourth": GREEN}
_NED = ("north", "east", "down")
_STEPS = 6  # of the straight line: few enough to be seen
_SMALLEST = 1e-9  # of a logarithmic axis [m]: what lies below is rounding
_HOUR = 3600.0


def platform_track(study: PlatformStudy) -> Track:
    """Draw the track of the platform, without its errors and of a reference where there are such, from above."""
    solution, ref = study.run.solution, study.reference
    others = [] if ref is None else [("reference", ref, GREY)]
    if study.errors.any:
        others.append(("without the platform's errors", study.run.undisturbed, GREEN))

    def on_map(lla: FloatArray) -> tuple[FloatArray, FloatArray]:
        north, east, _ = ned_offset(lla, solution.lla[0]).T
        return east, north

    behind = tuple(Curve(name, *on_map(each.lla), colour=colour) for name, each, colour in others)
    shade = Shade("speed [m/s]", np.linalg.norm(solution.v_n[:, :2], axis=1))
    east, north = on_map(solution.lla)
    time = Clock.of(solution.time)(solution.time)
    return Track("track", "Track", east, north, time, (shade,), "time", behind=behind)


def platform_velocity(run: PlatformRun) -> tuple[Panel, ...]:
    """Draw velocity East, North, Up, and the height if it is computed."""
    v_n, computed = run.solution.v_n, run.vertical != "off"
    lines = [("east", v_n[:, 1], AXIS_COLOURS[0]), ("north", v_n[:, 0], AXIS_COLOURS[1])]
    lines += [("up", -v_n[:, 2], AXIS_COLOURS[2])] if computed else []
    rows = [("Velocity", "velocity [m/s]", lines, 1e-3)]
    if computed:
        rows.append(("Height", "height [m]", [("height", run.solution.lla[:, 2], BLUE)], 0.01))
    return over_time(run.solution.time, rows, f"integrator {run.integrator}, vertical channel {run.vertical}")


def torquing_panels(run: PlatformRun) -> tuple[Panel, ...]:
    """Draw the rates at which the gyros are torqued, about East, North, Up."""
    rates = torquing_rates(run.solution) / DEG_PER_H
    columns = (("east", 1, 1.0), ("north", 0, 1.0), ("up", 2, -1.0))
    rows = [
        (f"Torquing about {name}", "rate [deg/h]", [(f"about {name}", sign * rates[:, column], colour)], 1e-3)
        for (name, column, sign), colour in zip(columns, AXIS_COLOURS, strict=True)
    ]
    return over_time(run.solution.time, rows, "Earth rate plus transport rate, as computed; the Earth: 15.041 deg/h")


def platform_error_panels(run: PlatformRun, theory: StaticErrors | None) -> tuple[Panel, ...]:
    """Draw what the platform's errors do to position, velocity and to its own attitude."""
    position = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    velocity = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    arcmin = DEG / 60.0
    blocks = (
        ("Position error", "error [m]", position, theory.position if theory else None),
        ("Velocity error", "error [m/s]", velocity, theory.velocity if theory else None),
        ("Tilt", "tilt [arcmin]", run.tilt / arcmin, theory.tilt / arcmin if theory else None),
    )
    rows = [
        (title, label, list(zip(_NED, values.T, AXIS_COLOURS, strict=False)), 0.0) for title, label, values, _ in blocks
    ]
    note = f"solution minus the same without the platform's errors{'; dashed: closed form' if theory else ''}"
    found = []
    for panel, (*_, expected) in zip(over_time(run.solution.time, rows, note), blocks, strict=True):
        at, closed = panel.curves[0].x, () if expected is None else expected.T
        more = (Curve("closed form", at, y, BLACK, "dashed") for y in closed)
        found.append(replace(panel, curves=(*panel.curves, *more)))
    return tuple(found)


def both_panels(found: PlatformComparison, theory: StaticErrors | None, key: str, note: str) -> tuple[Panel, ...]:
    """Draw the position error of a platform and of a strapdown navigator with the same errors."""
    hours = (found.time - found.time[0]) / _HOUR
    both = (("platform", found.platform, BLUE), ("strapdown", found.strapdown, VERMILLION))
    label, panels = "time since start [h]", []
    for column, axis in enumerate(("north", "east")):
        curves = [Curve(name, hours, error[:, column] / 1000.0, colour) for name, error, colour in both]
        if theory is not None:
            curves.append(Curve("closed form", hours, theory.position[:, column] / 1000.0, BLACK, "dashed"))
        title = f"Position error {axis}"
        panels.append(Panel(f"{key}_{axis}", title, "error [km]", label, tuple(curves), key, "" if column else note))
    if theory is not None:
        off = tuple(
            Curve(name, hours, np.hypot(*(error[:, :2] - theory.position).T), colour) for name, error, colour in both
        )
        panels.append(Panel(f"{key}_off", "Difference to the closed form", "difference [m]", label, off, key))
    return tuple(panels)


def straight_panels() -> tuple[Panel, Panel]:
    """Draw how forward, backward and mean integrate y = 2x, and what each makes of it."""
    x = np.linspace(0.0, 3.0, _STEPS + 1)
    y = 2.0 * x
    steps = np.repeat(x, 2)[1:-1]
    summed = (
        Curve("y = 2x", x, y, BLACK),
        Curve("summed up by backward", steps, np.repeat(y[1:], 2), ORANGE),
        Curve("summed up by forward", steps, np.repeat(y[:-1], 2), VERMILLION),
    )
    fine = np.linspace(0.0, 3.0, 200)
    curves = [Curve("truth, x²", fine, fine**2, BLACK)]
    for name in INTEGRATORS:
        total = integral(x, y, name)
        curves.append(Curve(f"{name}: {total[-1]:.4g} at the end", x, total, COLOURS[name], "points"))
    return (
        Panel("summed", "What is summed up, y = 2x", "y", "x", summed, "line", height=260),
        Panel("sums", "Integral from 0", "integral", "x", tuple(curves), "line", "truth: 9 at the end", height=260),
    )


def convergence_panel(found: Sequence[Convergence]) -> Panel:
    """Draw the error of each integrator on y = sin t over the length of its steps."""
    curves = []
    for each in found:
        name, colour = f"{each.integrator}: order {each.order:.2f}", COLOURS[each.integrator]
        curves += [Curve(name, each.step, each.error, colour), Curve(name, each.step, each.error, colour, "points")]
    return Panel(
        "sine",
        "Order of convergence on y = sin t",
        "largest error",
        "step [s]",
        tuple(curves),
        note="of the integral from 0 to 5 s; the slope is the order",
        log_x=True,
        log_y=True,
        height=300,
    )


def flight_panels(found: Mapping[float, Sequence[TrajectoryErrors]], motion: str) -> tuple[Panel, ...]:
    """Draw the position error of each integrator against truth, a panel for each sampling rate.

    `found`: by sampling rate [Hz], in the order of `INTEGRATORS`.
    """
    limits = _decades([each.horizontal for errors in found.values() for each in errors])
    panels = []
    for rate, errors in found.items():
        lines = {name: each.horizontal for name, each in zip(INTEGRATORS, errors, strict=True)}
        title = f"Sampled at {rate:g} Hz"
        panels.append(_differing(f"flight_{rate:g}", title, "error [m]", errors[0].time, lines, limits, motion))
    return tuple(panels)


def difference_panels(differences: Mapping[Integrator, TrajectoryErrors], against: str) -> tuple[Panel, ...]:
    """Draw how far the integrators are from one of them, or from a reference."""
    time = next(iter(differences.values())).time
    panels = []
    for what, unit, size in (("Position", "m", lambda each: each.horizontal), ("Velocity", "m/s", speed_of)):
        lines = {name: size(each) for name, each in differences.items()}
        title = f"{what} of the integrators against {against}"
        limits = _decades(list(lines.values()))
        panels.append(_differing(f"difference_{what}".lower(), title, f"horizontal [{unit}]", time, lines, limits))
    return tuple(panels)


def speed_of(errors: TrajectoryErrors) -> FloatArray:
    """Size of the horizontal velocity error, (n,) [m/s]."""
    return np.hypot(errors.velocity[:, 0], errors.velocity[:, 1])


def _differing(
    key: str,
    title: str,
    label: str,
    time: FloatArray,
    lines: Mapping[Integrator, FloatArray],
    limits: tuple[float, float],
    note: str = "",
) -> Panel:
    """One logarithmic panel with a line for each integrator; backward, which may lie on forward, is dashed."""
    clock = Clock.of(time)
    curves = tuple(
        Curve(name, clock(time), np.maximum(y, limits[0]), COLOURS[name], "dashed" if name == "backward" else "line")
        for name, y in lines.items()
    )
    return Panel(key, title, label, clock.label, curves, "time", note, log_y=True, limits=limits)


def _decades(lines: Sequence[FloatArray]) -> tuple[float, float]:
    """Whole powers of ten that hold what the lines come to, not the zero they start from."""
    tops = [float(line.max()) for line in lines if line.size and line.max() > 0.0]
    if not tops:
        tops = [_SMALLEST]  # they do the same to the last bit, as at rest
    low = 10.0 ** np.floor(np.log10(max(min(tops) / 100.0, _SMALLEST)))
    return low, max(100.0 * low, 10.0 ** np.ceil(np.log10(max(tops))))
