"""The demonstration of the platform: integrators on known functions and a known flight, a day of its errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from insnav.errors.platform_errors import Beside, beside_strapdown, integrator_errors, sine_convergence
from insnav.errors.schuler import StaticErrors, static_errors
from insnav.gimbal import INTEGRATORS, PlatformErrors, integral
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.platform.figures import draw_beside
from insnav.report.platform.integrator_figures import draw_convergence, draw_flight_errors, draw_line
from insnav.report.platform.page import periods_table
from insnav.report.run_json import json_ready, versions
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.simulate import circle, straight
from insnav.units import DEG, DEG_PER_H, UG

LAT = 45.0 * DEG
HEIGHT, SPEED, ROUND = 5000.0, 150.0, 600.0  # of the holding pattern [m], [m/s], [s]
FLIGHT, FLIGHT_RATES = 1800.0, (1.0, 10.0, 100.0)  # [s], [Hz]
DAY, DAY_RATE = 86400.0, 10.0
PATTERN, PATTERN_RATE = 7200.0, 50.0
ERRORS = PlatformErrors(
    tilt=np.array([0.0, 0.0, 1.0 / 60.0]) * DEG,
    drift=np.array([0.01, 0.01, 0.01]) * DEG_PER_H,
    bias=np.array([50.0, 50.0, 0.0]) * UG,
)
_ERRORS_TEXT = "heading 1 arcmin off, drifts of 0.01 deg/h, accelerometer biases of 50 ug"
_MOTION = f"circles at {SPEED:g} m/s, {ROUND / 60:g} min a turn, latitude 45°"


def demonstration() -> tuple[Sheet, dict[str, Any]]:
    """Make the page and the facts of the demonstration."""
    orders = sine_convergence()
    flight = integrator_errors(
        circle(np.array([LAT, 0.0, HEIGHT]), SPEED, 2.0 * np.pi / ROUND, FLIGHT), FLIGHT_RATES, keep=1.0
    )
    rest = beside_strapdown(straight(np.array([LAT, 0.0, 0.0]), 0.0, 0.0, DAY), ERRORS, DAY_RATE, 60.0)
    theory = static_errors(rest.time, LAT, 0.0, ERRORS)
    turning = beside_strapdown(
        circle(np.array([LAT, 0.0, HEIGHT]), SPEED, 2.0 * np.pi / ROUND, PATTERN), ERRORS, PATTERN_RATE, 10.0
    )
    x = np.linspace(0.0, 3.0, 31)
    known = Table(
        "Integrators on known functions",
        ("integrator", "y = 2x, 30 steps, error at 3", "y = sin t, measured order"),
        tuple(
            (each.integrator, f"{integral(x, 2.0 * x, each.integrator)[-1] - 9.0:+.3g}", f"{each.order:.3f}")
            for each in orders
        ),
    )
    flown = Table(
        f"Largest error against truth in {FLIGHT / 60:g} min of {_MOTION}",
        ("integrator", *(f"{rate:g} Hz [{unit}]" for rate in FLIGHT_RATES for unit in ("m", "m/s"))),
        tuple(
            (
                name,
                *(
                    text
                    for rate in FLIGHT_RATES
                    for text in (
                        _size(float(flight[rate][i].horizontal.max())),
                        _size(float(np.abs(flight[rate][i].velocity).max())),
                    )
                ),
            )
            for i, name in enumerate(INTEGRATORS)
        ),
        "position, and velocity; the motion has a closed form, the sensors are without error",
    )
    day = _day_table(rest, theory)
    found = periods_table({"platform": rest.platform[:, :2], "strapdown": rest.strapdown[:, :2]}, rest.time, LAT, 0.0)
    with drawing():
        pictures = (
            Picture("line", draw_line(), "Integrating y = 2x"),
            Picture("sine", draw_convergence(orders), "Order of convergence on y = sin t"),
            Picture("flight", draw_flight_errors(flight, _MOTION), "Integrators against truth on a flight"),
            Picture("day", draw_beside(rest, theory, "a day at rest, latitude 45°", _ERRORS_TEXT), "A day at rest"),
            Picture(
                "pattern", draw_beside(turning, None, _MOTION, _ERRORS_TEXT), "The same errors in a turning vehicle"
            ),
        )
    ends = [float(np.hypot(*errors[-1, :2])) for errors in (turning.platform, turning.strapdown)]
    sheet = Sheet(
        "The north-pointing platform: integrators and errors",
        (
            f"In {DAY / 3600:g} h at rest a platform and a strapdown navigator with the same errors come to the same, "
            "as theory says. In a turning vehicle they do not: the strapdown sensors turn with it, and their errors "
            f"average out. After {PATTERN / 3600:g} h of circles the platform is off by {ends[0] / 1000:.2f} km, the "
            f"strapdown navigator by {ends[1] / 1000:.2f} km.",
        ),
        (known, flown, day, found),
        pictures,
        (
            f"Errors: {_ERRORS_TEXT}; along north, east, down on the platform, along forward, right, down in the "
            "vehicle, which starts to the north. A drift of the platform is a gyro bias of the opposite sign.",
            "fourth is Runge-Kutta of fourth order, the specific force half-way from a polynomial through the six "
            "samples around it: on smooth motion 16 times better than steps over two samples.",
            "The closed form is exact to first order in the errors; what is left is their square.",
        ),
    )
    facts: dict[str, Any] = json_ready(
        {
            "versions": versions(),
            "order_on_sine": {each.integrator: each.order for each in orders},
            "flight_largest_error_m": {
                f"{rate:g} Hz": {
                    name: float(each.horizontal.max()) for name, each in zip(INTEGRATORS, flight[rate], strict=True)
                }
                for rate in FLIGHT_RATES
            },
            "day_largest_n_e_m": {
                "platform": np.abs(rest.platform[:, :2]).max(axis=0),
                "strapdown": np.abs(rest.strapdown[:, :2]).max(axis=0),
                "closed form": np.abs(theory.position).max(axis=0),
            },
            "periods": [dict(zip(found.columns, row, strict=True)) for row in found.rows],
            "pattern_end_m": {"platform": ends[0], "strapdown": ends[1]},
        }
    )
    return sheet, facts


def _size(value: float) -> str:
    return number(value) if value >= 1e-4 else f"{value:.1e}"


def _day_table(rest: Beside, theory: StaticErrors) -> Table:
    rows = []
    for column, axis in enumerate(("north", "east")):
        closed = theory.position[:, column]
        cells = [f"{axis} [m]", f"{np.ptp(closed):.0f}"]
        for values in (rest.platform[:, column], rest.strapdown[:, column]):
            cells.append(f"{np.ptp(values):.0f} ({100.0 * (np.ptp(values) / np.ptp(closed) - 1.0):+.2f} %)")
        cells.append(f"{np.abs(rest.platform[:, column] - rest.strapdown[:, column]).max():.1f}")
        rows.append(tuple(cells))
    columns = ("error, peak to peak", "closed form", "platform", "strapdown", "apart by at most [m]")
    return Table(f"{DAY / 3600:g} h at rest", columns, tuple(rows), "vertical channel off, height held")
