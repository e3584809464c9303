"""Report of navigation on a north-pointing gimballed platform: track, torquing rates, errors, integrators."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from insnav.earth import ned_offset
from insnav.errors import platform_errors
from insnav.errors.metrics import TrajectoryErrors
from insnav.errors.platform_errors import Convergence, Demonstration, PlatformComparison, PlatformStudy, StaticErrors
from insnav.gimbal import INTEGRATORS, Integrator, PlatformRun, integral, torquing_rates
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat, write_events, write_run_table
from insnav.output.track_files import write_kml
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, Section, Verdict, beside, drawn, only_json, rows_frame
from insnav.report.panels import Clock, Curve, Kind, Panel, Shade, Track, over_time
from insnav.report.style import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, NED, PURPLE, VERMILLION
from insnav.report.tables import of_columns, of_section, of_table
from insnav.result import Result
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H, UNITS

_NEAR = 0.01  # simulated errors agree with their closed form if they differ by less than this share of it [-]
_ERRORS_TEXT = "heading error 1 arcmin, drifts of 0.01 deg/h, accelerometer biases of 50 µg"
_MOTION = f"circles at {platform_errors.SPEED:g} m/s, {platform_errors.ROUND / 60:g} min a turn, latitude 45°"
COLOURS: Mapping[Integrator, str] = {"forward": VERMILLION, "backward": PURPLE, "mean": BLUE, "fourth": GREEN}
_STEPS = 6  # integration steps in the figure of y = 2x: few, so that single steps are visible
_SMALLEST = 1e-9  # start of a logarithmic axis [m], [m/s]: smaller values are rounding errors
_HOUR = 3600.0


def write_files(result: Result[PlatformStudy | Demonstration], folder: RunFolder, table_format: TableFormat) -> None:
    """Write solution, torquing rates, events and track of a record. `folder`: open, inside its ``with`` block."""
    study, place = result.found, folder.directory
    if isinstance(study, PlatformStudy):
        write_run_table(place, study.run.solution, table_format)
        write_table(folder.path("torquing.csv"), _torquing_columns(study))
        write_events(place, result.findings)
        write_kml(place, study.run.solution, _name(result))


def frame(result: Result[PlatformStudy | Demonstration]) -> DataFrame:
    """Build a table of the solution of a record; for the demonstration, of integrator errors on known functions."""
    study = result.found
    return study.run.solution.to_frame() if isinstance(study, PlatformStudy) else rows_frame(_known(study.orders).rows)


def _name(result: Result[PlatformStudy | Demonstration]) -> str:
    return Path(result.inputs["force"].path).name


def _torquing_columns(study: PlatformStudy) -> dict[str, FloatArray]:
    """Return the columns of ``torquing.csv``: time, torquing rates, and the platform attitude error if simulated."""
    run = study.run
    rates, tilt = torquing_rates(run.solution) / DEG_PER_H, run.tilt / DEG
    columns = {"time_s": run.solution.time}
    columns |= {"torquing_e_deg_h": rates[:, 1], "torquing_n_deg_h": rates[:, 0], "torquing_u_deg_h": -rates[:, 2]}
    if study.errors.any:
        columns |= {f"tilt_{axis}_deg": tilt[:, i] for i, axis in enumerate("ned")}
    return {name: np.round(values, 9) + 0.0 for name, values in columns.items()}


def page(result: Result[PlatformStudy | Demonstration]) -> Page:
    """Lay out the solution of a record on a platform, or the demonstration on simulated motions."""
    study = result.found
    if isinstance(study, Demonstration):
        return _demonstration(study)
    run, theory, differences = study.run, study.theory, study.differences()
    end = run.solution
    lat, lon, height = end.lla[-1]
    return Page(
        f"North-pointing platform: {_name(result)}",
        (f"Integrator {study.chosen}, vertical channel {run.vertical}.",),
        (
            _drawn(study, theory, differences),
            only_json("", Quantity("integrator", study.chosen), Quantity("vertical", run.vertical)),
            Section("end", "At the end", rows=tuple(_state(*each) for each in study.runs.items()), keyed=True),
            _differences(differences, to_reference=study.reference is not None),
            *(_errors(study, theory) if study.errors.any else ()),
        ),
        merits=_state(study.chosen, run)[1:],
        merits_note="at the end",
        verdict=Verdict(
            "unknown",
            "no reference was given" if study.reference is None else "the reference is below, no limit is set",
            f"After {end.time[-1] - end.time[0]:.1f} s: latitude {lat / DEG:.7f} deg, longitude {lon / DEG:.7f} deg, "
            f"height {height:.2f} m, velocity east {end.v_n[-1, 1]:.4f}, north {end.v_n[-1, 0]:.4f}, up "
            f"{-end.v_n[-1, 2] + 0.0:.4f} m/s.",
        ),
    )


def _drawn(
    study: PlatformStudy, theory: StaticErrors | None, differences: Mapping[Integrator, TrajectoryErrors]
) -> Section:
    run = study.run
    against = "the reference" if study.reference is not None else "fourth order"
    sections = (
        drawn("track", "Track of a north-pointing platform", (platform_track(study),)),
        drawn("velocity", "Velocity computed on the platform", platform_velocity(run)),
        drawn("torquing", "Commanded torquing rates", torquing_panels(run)),
        drawn("integrators", "Difference between the integrators", difference_panels(differences, against)),
    )
    errors = platform_error_panels(run, theory) if study.errors.any else ()
    return beside(*sections, drawn("errors", "Impact of the platform's errors", errors))


def _state(name: Integrator, run: PlatformRun) -> tuple[Quantity, ...]:
    (lat, lon, height), (north, east, down) = run.solution.lla[-1].tolist(), run.solution.v_n[-1].tolist()
    place, velocity = {"lat": lat, "lon": lon, "height": height}, {"v_east": east, "v_north": north, "v_up": 0.0 - down}
    return of_table("platform.state", integrator=name, **place, **velocity)


def _differences(differences: Mapping[Integrator, TrajectoryErrors], *, to_reference: bool) -> Section:
    fastest = [float(np.nanmax(speed_of(each), initial=0.0)) for each in differences.values()]
    sizes = [each.horizontal for each in differences.values()]
    ends, largest = [float(each[-1]) for each in sizes], [float(each.max()) for each in sizes]
    rows = of_columns("platform.difference", integrator=differences, horizontal=largest, end=ends, velocity=fastest)
    against = "the reference" if to_reference else "fourth order"
    key = f"largest_difference_to_{'reference' if to_reference else platform_errors.AGAINST}"
    note = "on a platform without errors" if to_reference else ""
    return Section(key, f"Horizontal difference to {against}", rows=rows, note=note, keyed=True)


def _errors(study: PlatformStudy, theory: StaticErrors | None) -> tuple[Section, ...]:
    """Lay out the effect of platform errors on position and velocity, compared with the closed form if available."""
    run = study.run
    pos = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    vel = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    items = [
        *of_table("platform.errors", study.errors),
        Quantity("largest_position_error_n_e", np.abs(pos).max(axis=0), "m"),
        Quantity("position_error_at_the_end_n_e", pos[-1], "m"),
    ]
    expected = (theory.position, theory.velocity) if theory else (None, None)
    if theory is not None:
        items.append(Quantity("largest_by_closed_form_n_e", np.abs(theory.position).max(axis=0), "m"))
        largest = float(np.abs(pos - theory.position).max())
        items.append(Quantity("largest_difference_to_closed_form", largest, "m"))
    rows = []
    for quantity, values, closed, unit in (("position", pos, expected[0], "m"), ("velocity", vel, expected[1], "m/s")):
        for k, axis in enumerate(("north", "east")):
            row = [
                Quantity("error", f"{axis} {quantity}"),
                Quantity("largest", float(np.abs(values[:, k]).max()), unit),
                Quantity("end", float(values[-1, k]), unit, meaning="at the end"),
            ]
            if closed is not None:
                row.append(Quantity("closed_form", float(np.abs(closed[:, k]).max()), unit))
                row.append(Quantity("difference", float(np.abs(values - closed)[:, k].max()), unit))
            rows.append(tuple(row))
    sections = (only_json("platform_errors", *items), Section("", "Impact of the platform's errors", rows=tuple(rows)))
    lat, _, height = run.undisturbed.lla[0]
    time = run.solution.time - run.solution.time[0]
    if theory is None or time[-1] < platform_errors.SHORTEST_RECORD * 86400.0 or lat == 0.0:
        return sections
    return (*sections, _periods({"platform": pos}, time, float(lat), float(height)))


def _demonstration(found: Demonstration) -> Page:
    """Lay out integrators compared with closed forms, and a platform compared with a strapdown navigator."""
    orders, flight, rest, turning = found.orders, found.flight, found.rest, found.turning
    theory = platform_errors.static_errors(rest.time, platform_errors.LAT, 0.0, platform_errors.ERRORS)
    errors_of = {"platform": turning.platform, "strapdown": turning.strapdown}
    ends = {name: float(np.hypot(*error[-1, :2])) for name, error in errors_of.items()}
    difference = float(np.abs(rest.platform[:, :2] - theory.position).max() / np.abs(theory.position).max())
    at_rest, in_turns = "A day at rest, latitude 45°", "The same errors in a turning vehicle"
    drawings = (
        drawn("pattern", in_turns, (both_panel(turning, None, "pattern", in_turns, _MOTION),), _ERRORS_TEXT),
        drawn("day", at_rest, (both_panel(rest, theory, "day", at_rest, ""),), _ERRORS_TEXT),
        drawn("flight", "Integrators against truth on a flight", (flight_panel(flight, _MOTION),)),
        drawn("line", "Integrating y = 2x in six steps", straight_panels(), columns=2),
        drawn("sine", "Order of convergence on y = sin t", (convergence_panel(orders),)),
    )
    records = {"platform": rest.platform[:, :2], "strapdown": rest.strapdown[:, :2]}
    return Page(
        "The north-pointing platform: integrators and errors",
        (
            f"In {platform_errors.DAY / 3600:g} h at rest both have the same error growth, as in theory. "
            "In a turning vehicle they differ: the strapdown sensors turn with it, and their errors average out.",
        ),
        (
            *drawings,
            _known(orders),
            _flown(flight),
            *_day(rest, theory),
            _periods(records, rest.time, platform_errors.LAT, 0.0),
            only_json("pattern_end", *(Quantity(name, end, "m") for name, end in ends.items())),
        ),
        merits=(
            *(
                Quantity(name, end, "m", meaning=f"{name} after {platform_errors.PATTERN / 3600:g} h of circles")
                for name, end in ends.items()
            ),
            Quantity("apart", 100.0 * difference, "", meaning="difference from the closed form at rest [%]", digits=2),
            *(Quantity(each.integrator, each.order, meaning=f"order of {each.integrator}") for each in orders[1:]),
        ),
        verdict=Verdict(
            "good" if difference < _NEAR else "bad",
            f"at rest the platform is within {100.0 * difference:.2g} % of the closed form",
            f"After {platform_errors.PATTERN / 3600:g} h of circles the position error of the platform is "
            f"{ends['platform'] / 1000:.2f} km, of the strapdown navigator {ends['strapdown'] / 1000:.2f} km.",
        ),
    )


def _periods(records: Mapping[str, FloatArray], time: FloatArray, lat: float, height: float) -> Section:
    """Tabulate error oscillation periods: measured at rest in records (n, 2) North, East [m], and theoretical."""
    expected = platform_errors.periods(lat, height)
    fitted = {name: platform_errors.measured_periods(time, position, lat, height) for name, position in records.items()}
    rows = []
    for period, unit in (("Schuler", "min"), ("Foucault", "h"), ("Earth", "h")):
        theory = getattr(expected, period.lower())
        row = [Quantity("period", f"{period} [{unit}]"), Quantity("theory", theory / UNITS[unit][1], digits=6)]
        for name, each in fitted.items():
            value = getattr(each, period.lower())
            mark = "" if value is None else f"({100.0 * (value / theory - 1.0):+.3f} %)"
            row.append(Quantity(name, None if value is None else value / UNITS[unit][1], digits=6, mark=mark))
        rows.append(tuple(row))
    return of_section("platform.periods", rows)


def _known(orders: Sequence[Convergence]) -> Section:
    x = np.linspace(0.0, 3.0, 31)
    on_line = {each.integrator: float(integral(x, 2.0 * x, each.integrator)[-1] - 9.0) for each in orders}
    rows = tuple(of_table("platform.known_function", each, error_on_line=on_line[each.integrator]) for each in orders)
    return Section("known_functions", "Integrators on known functions", rows=rows, keyed=True)


def _flown(flight: Mapping[float, Sequence[TrajectoryErrors]]) -> Section:
    rows = []
    for i, name in enumerate(INTEGRATORS):
        row = [Quantity("integrator", name)]
        for rate, errors in flight.items():
            position, velocity = float(errors[i].horizontal.max()), float(np.abs(errors[i].velocity).max())
            row.append(Quantity(f"position_{rate:g}_Hz", position, "m", meaning=f"{rate:g} Hz"))
            row.append(Quantity(f"velocity_{rate:g}_Hz", velocity, "m/s", meaning=f"{rate:g} Hz"))
        rows.append(tuple(row))
    values = {"duration": platform_errors.FLIGHT / 60, "motion": _MOTION}
    return of_section("platform.flight", rows, values, keyed=True)


def _day(rest: PlatformComparison, theory: StaticErrors) -> tuple[Section, ...]:
    records = {"closed form": theory.position, "platform": rest.platform[:, :2], "strapdown": rest.strapdown[:, :2]}
    largest = (Quantity(name, np.abs(error).max(axis=0), "m") for name, error in records.items())
    rows = []
    for k, axis in enumerate(("north", "east")):
        size = float(np.ptp(theory.position[:, k]))
        row = [Quantity("error", f"{axis}, peak to peak")]
        for name, error in records.items():
            span = float(np.ptp(error[:, k]))
            mark = "" if name == "closed form" else f"({100.0 * (span / size - 1.0):+.2f} %)"
            row.append(Quantity(name, span, "m", decimals=0, mark=mark))
        difference = float(np.abs(rest.platform[:, k] - rest.strapdown[:, k]).max())
        rows.append((*row, Quantity("apart", difference, "m", meaning="largest difference")))
    table = of_section("platform.day", rows, {"duration": platform_errors.DAY / 3600})
    return table, only_json("day_largest_n_e", *largest)


def platform_track(study: PlatformStudy) -> Track:
    """Draw a map: the solution, the solution without the platform's errors, and the reference if available."""
    solution, ref = study.run.solution, study.reference
    other_tracks = [] if ref is None else [("reference", ref, GREY)]
    if study.errors.any:
        other_tracks.append(("without the platform's errors", study.run.undisturbed, GREEN))

    def on_map(lla: FloatArray) -> tuple[FloatArray, FloatArray]:
        north, east, _ = ned_offset(lla, solution.lla[0]).T
        return east, north

    behind = tuple(Curve(name, *on_map(each.lla), colour=colour) for name, each, colour in other_tracks)
    shade = Shade("speed [m/s]", np.linalg.norm(solution.v_n[:, :2], axis=1))
    east, north = on_map(solution.lla)
    time = Clock.of(solution.time)(solution.time)
    return Track("track", "Track", east, north, time, (shade,), "time", behind=behind)


def platform_velocity(run: PlatformRun) -> tuple[Panel, ...]:
    """Draw velocity East, North, Up, and height; without vertical channel only East and North."""
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


def platform_error_panels(run: PlatformRun, theory: StaticErrors | None) -> Iterator[Panel]:
    """Draw the errors of position, velocity and platform attitude due to platform errors, and their closed form."""
    position = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    velocity = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    arcmin = DEG / 60.0
    blocks = (
        ("Position error", "error [m]", position, theory.position if theory else None),
        ("Velocity error", "error [m/s]", velocity, theory.velocity if theory else None),
        ("Tilt", "tilt [arcmin]", run.tilt / arcmin, theory.tilt / arcmin if theory else None),
    )
    rows = [
        (title, label, list(zip(NED, values.T, AXIS_COLOURS, strict=False)), 0.0) for title, label, values, _ in blocks
    ]
    note = f"solution minus the same without the platform's errors{'; dashed: closed form' if theory else ''}"
    for panel, (*_, expected) in zip(over_time(run.solution.time, rows, note), blocks, strict=True):
        x, closed_form = panel.curves[0].x, () if expected is None else expected.T
        dashed = (Curve("closed form", x, y, BLACK, "dashed") for y in closed_form)
        yield replace(panel, curves=(*panel.curves, *dashed))


def both_panel(found: PlatformComparison, theory: StaticErrors | None, key: str, title: str, note: str) -> Panel:
    """Draw the horizontal position error of a platform and of a strapdown navigator with the same errors."""
    hours, known = (found.time - found.time[0]) / _HOUR, [] if theory is None else [theory.position]
    named = (("platform", BLUE), ("strapdown", VERMILLION), ("closed form", BLACK))
    curves = tuple(
        Curve(name, hours, np.hypot(*error[:, :2].T) / 1000.0, colour, "dashed" if colour == BLACK else "line")
        for (name, colour), error in zip(named, (found.platform, found.strapdown, *known), strict=False)
    )
    return Panel(key, title, "horizontal error [km]", "time since start [h]", curves, key, note)


def straight_panels() -> tuple[Panel, Panel]:
    """Draw the areas that forward and backward integrators sum up for y = 2x, and the integrals of all integrators."""
    x = np.linspace(0.0, 3.0, _STEPS + 1)
    y = 2.0 * x
    steps = np.repeat(x, 2)[1:-1]
    summed = (
        Curve("y = 2x", x, y, BLACK),
        Curve("summed up by backward", steps, np.repeat(y[1:], 2), COLOURS["backward"]),
        Curve("summed up by forward", steps, np.repeat(y[:-1], 2), VERMILLION),
    )
    fine = np.linspace(0.0, 3.0, 200)
    curves = [Curve("truth, x²", fine, fine**2, BLACK)]
    for name in INTEGRATORS:
        total = integral(x, y, name)
        curves.append(Curve(f"{name}: {total[-1]:.4g} at the end", x, total, COLOURS[name], "points"))
    return (
        Panel("summed", "Summed areas, y = 2x", "y", "x", summed, "line", height=260),
        Panel("sums", "Integral from 0", "integral", "x", tuple(curves), "line", "truth: 9 at the end", height=260),
    )


def convergence_panel(found: Sequence[Convergence]) -> Panel:
    """Draw the largest error of each integrator on y = sin t over the step size, to show its order of convergence."""
    curves = []
    for each in found:
        name, colour = f"{each.integrator}: order {each.order:.2f}", COLOURS[each.integrator]
        # the line of backward is dashed, as it coincides with the line of forward
        kind: Kind = "dashed" if each.integrator == "backward" else "line"
        curves += [Curve(name, each.step, each.error, colour, line_kind) for line_kind in (kind, "points")]
    labels, note = ("Order of convergence on y = sin t", "largest error", "step [s]"), "of the integral from 0 to 5 s"
    return Panel("sine", *labels, tuple(curves), note=f"{note}; the slope is the order", log="xy", height=300)


def flight_panel(found: Mapping[float, Sequence[TrajectoryErrors]], motion: str) -> Panel:
    """Draw the position error of each integrator on the simulated flight, at the middle of the sampling rates.

    `found`: errors by sampling rate [Hz], in the order of `INTEGRATORS`.
    """
    rate = sorted(found)[len(found) // 2]
    lines = {name: each.horizontal for name, each in zip(INTEGRATORS, found[rate], strict=True)}
    clock = Clock(float(found[rate][0].time[0]), _HOUR, "h", "time since start [h]")
    labels = f"Integrators sampled at {rate:g} Hz", "error [m]", clock.label
    return _differing("flight", labels, clock(found[rate][0].time), lines, motion)


def difference_panels(differences: Mapping[Integrator, TrajectoryErrors], against: str) -> Iterator[Panel]:
    """Draw differences of the integrators, in position and velocity, from a reference or from one integrator."""
    time = next(iter(differences.values())).time
    clock = Clock.of(time)
    for quantity, unit, size in (("Position", "m", lambda each: each.horizontal), ("Velocity", "m/s", speed_of)):
        lines = {name: size(each) for name, each in differences.items()}
        labels = f"{quantity} of the integrators against {against}", f"horizontal [{unit}]", clock.label
        yield _differing(f"difference_{quantity}".lower(), labels, clock(time), lines)


def speed_of(errors: TrajectoryErrors) -> FloatArray:
    """Compute the horizontal velocity error, (n,) [m/s]."""
    return np.hypot(errors.velocity[:, 0], errors.velocity[:, 1])


def _differing(
    key: str, labels: tuple[str, str, str], at: FloatArray, lines: Mapping[Integrator, FloatArray], note: str = ""
) -> Panel:
    """Build a logarithmic panel with a line per integrator; backward, which may coincide with forward, is dashed."""
    # All lines may be exactly zero, as for a stationary vehicle; then the axis starts at its smallest value.
    tops = [float(line.max()) for line in lines.values() if line.size and line.max() > 0.0] or [_SMALLEST]
    # The axis limits are powers of ten around the largest values: errors start at zero, which has no logarithm.
    low = 10.0 ** np.floor(np.log10(max(min(tops) / 100.0, _SMALLEST)))
    limits = low, max(100.0 * low, 10.0 ** np.ceil(np.log10(max(tops))))
    curves = tuple(
        Curve(name, at, np.maximum(y, low), COLOURS[name], "dashed" if name == "backward" else "line")
        for name, y in lines.items()
    )
    return Panel(key, *labels, curves, "time", note, log="y", limits=limits)
