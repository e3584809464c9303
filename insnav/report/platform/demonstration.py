"""The demonstration of the platform: integrators on known functions and a known flight, a day of its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from insnav.errors.metrics import TrajectoryErrors
from insnav.errors.platform_errors import (
    DAY,
    ERRORS,
    FLIGHT,
    LAT,
    PATTERN,
    ROUND,
    SPEED,
    Convergence,
    Demonstration,
    PlatformComparison,
)
from insnav.errors.schuler import StaticErrors, measured_periods, periods, static_errors
from insnav.gimbal import INTEGRATORS, integral
from insnav.quantity import Quantity
from insnav.report.page import Page, Section, Verdict, drawn, only_json
from insnav.report.platform.panels import both_panels, convergence_panel, flight_panels, straight_panels
from insnav.types import FloatArray
from insnav.units import UNITS

_NEAR = 0.01  # of the closed form
_ERRORS_TEXT = "heading error 1 arcmin, drifts of 0.01 deg/h, accelerometer biases of 50 ug"
_MOTION = f"circles at {SPEED:g} m/s, {ROUND / 60:g} min a turn, latitude 45°"


def demonstration_page(found: Demonstration) -> Page:
    """Report the integrators against closed forms, and a platform against a strapdown navigator."""
    orders, flight, rest, turning = found.orders, found.flight, found.rest, found.turning
    theory = static_errors(rest.time, LAT, 0.0, ERRORS)
    ends = {
        name: float(np.hypot(*error[-1, :2]))
        for name, error in (("platform", turning.platform), ("strapdown", turning.strapdown))
    }
    apart = float(np.abs(rest.platform[:, :2] - theory.position).max() / np.abs(theory.position).max())
    at_rest, in_turns = "A day at rest, latitude 45°", "The same errors in a turning vehicle"
    drawings = (
        drawn("pattern", in_turns, both_panels(turning, None, "pattern", _MOTION), _ERRORS_TEXT),
        drawn("day", at_rest, both_panels(rest, theory, "day", "a day at rest"), _ERRORS_TEXT),
        drawn("flight", "Integrators against truth on a flight", flight_panels(flight, _MOTION)),
        drawn("line", "Integrating y = 2x in six steps", straight_panels(), columns=2),
        drawn("sine", "Order of convergence on y = sin t", (convergence_panel(orders),)),
    )
    records = {"platform": rest.platform[:, :2], "strapdown": rest.strapdown[:, :2]}
    return Page(
        "The north-pointing platform: integrators and errors",
        (
            f"In {DAY / 3600:g} h at rest both with the same errors come to the same, as theory says. In a turning "
            "vehicle they do not: the strapdown sensors turn with it, and their errors average out.",
        ),
        (
            *drawings,
            known(orders),
            _flown(flight),
            *_day(rest, theory),
            periods_section(records, rest.time, LAT, 0.0),
            only_json("pattern_end", *(Quantity(name, end, "m") for name, end in ends.items())),
        ),
        merits=(
            *(
                Quantity(name, end, "m", meaning=f"{name} after {PATTERN / 3600:g} h of circles")
                for name, end in ends.items()
            ),
            Quantity("apart", 100.0 * apart, "", meaning="platform and closed form at rest apart [%]", digits=2),
            *(Quantity(each.integrator, each.order, meaning=f"order of {each.integrator}") for each in orders[1:]),
        ),
        verdict=Verdict(
            "good" if apart < _NEAR else "bad",
            f"at rest the platform is within {100.0 * apart:.2g} % of the closed form",
            f"After {PATTERN / 3600:g} h of circles the position error of the platform is "
            f"{ends['platform'] / 1000:.2f} km, that of the strapdown navigator {ends['strapdown'] / 1000:.2f} km.",
        ),
    )


def periods_section(records: Mapping[str, FloatArray], time: FloatArray, lat: float, height: float) -> Section:
    """Periods found in records of position errors at rest, and those of theory.

    `records` (n, 2): errors North, East [m] by name; `time` (n,): since the start [s]; `lat`, `height`: latitude [rad]
    and height [m].
    """
    expected = periods(lat, height)
    found = {name: measured_periods(time, position, lat, height) for name, position in records.items()}
    rows = []
    for period, unit in (("Schuler", "min"), ("Foucault", "h"), ("Earth", "h")):
        theory = getattr(expected, period.lower())
        row = [Quantity("period", f"{period} [{unit}]"), Quantity("theory", theory / UNITS[unit][1], digits=6)]
        for name, each in found.items():
            value = getattr(each, period.lower())
            mark = "" if value is None else f"({100.0 * (value / theory - 1.0):+.3f} %)"
            row.append(Quantity(name, None if value is None else value / UNITS[unit][1], digits=6, mark=mark))
        rows.append(tuple(row))
    note = "found in the position error by least squares, amplitudes free; –: not observable"
    return Section("periods", "Periods of the error", rows=tuple(rows), note=note)


def known(orders: Sequence[Convergence]) -> Section:
    """Errors of the integrators on y = 2x, and their orders on y = sin t."""
    x = np.linspace(0.0, 3.0, 31)
    on_line = {each.integrator: float(integral(x, 2.0 * x, each.integrator)[-1] - 9.0) for each in orders}
    rows = tuple(
        (
            Quantity("integrator", each.integrator),
            Quantity("error_on_line", on_line[each.integrator], meaning="y = 2x, 30 steps, error at 3"),
            Quantity("order_on_sine", each.order, meaning="y = sin t, measured order", decimals=3),
        )
        for each in orders
    )
    return Section("known_functions", "Integrators on known functions", rows=rows, keyed=True)


def _flown(flight: Mapping[float, Sequence[TrajectoryErrors]]) -> Section:
    rows = []
    for i, name in enumerate(INTEGRATORS):
        row = [Quantity("integrator", name)]
        for rate, found in flight.items():
            position, velocity = float(found[i].horizontal.max()), float(np.abs(found[i].velocity).max())
            row.append(Quantity(f"position_{rate:g}_Hz", position, "m", meaning=f"{rate:g} Hz"))
            row.append(Quantity(f"velocity_{rate:g}_Hz", velocity, "m/s", meaning=f"{rate:g} Hz"))
        rows.append(tuple(row))
    title = f"Largest error against truth in {FLIGHT / 60:g} min of {_MOTION}"
    note = "position, and velocity; the motion has a closed form, the sensors are without error"
    return Section("flight_largest_error", title, rows=tuple(rows), note=note, keyed=True)


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
        apart = float(np.abs(rest.platform[:, k] - rest.strapdown[:, k]).max())
        rows.append((*row, Quantity("apart", apart, "m", meaning="largest difference")))
    note = "vertical channel off, height held"
    return (
        Section("", f"{DAY / 3600:g} h at rest", rows=tuple(rows), note=note),
        only_json("day_largest_n_e", *largest),
    )
