"""Facts, page and tables of a north-pointing platform."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.metrics import TrajectoryErrors, position_errors
from insnav.errors.schuler import SHORTEST_RECORD, StaticErrors, measured_periods, periods, static_errors
from insnav.gimbal import DAMPING_TIME, Integrator, PlatformErrors, PlatformRun, torquing_rates
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.platform.figures import (
    draw_platform_errors,
    draw_platform_track,
    draw_platform_velocity,
    draw_torquing,
)
from insnav.report.platform.integrator_figures import draw_differences
from insnav.report.run_json import json_ready, versions
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG, DEG_PER_H, UG

REST_M_S = 0.1  # a platform that says less without its errors is at rest
_AGAINST: Integrator = "fourth"


@dataclass(frozen=True, slots=True)
class PlatformStudy:
    """One record integrated in every way.

    Attributes
    ----------
    chosen : {"forward", "backward", "mean", "fourth"}
        Whose solution is wanted.
    runs : mapping of str to PlatformRun
        By integrator; with the errors of the platform.
    errors : PlatformErrors
    reference : Trajectory or None
        What to judge by.
    name : str
        The file.
    notes : tuple of str
        What was understood and assumed.
    """

    chosen: Integrator
    runs: Mapping[Integrator, PlatformRun]
    errors: PlatformErrors
    reference: Trajectory | None
    name: str
    notes: tuple[str, ...]

    @property
    def run(self) -> PlatformRun:
        """The run that was asked for."""
        return self.runs[self.chosen]

    @property
    def theory(self) -> StaticErrors | None:
        """Closed form of the errors, where the vehicle is at rest and the vertical channel off."""
        run = self.run
        still = float(np.abs(run.undisturbed.v_n).max()) < REST_M_S
        if not self.errors.any or run.vertical != "off" or not still:
            return None
        start = run.undisturbed.lla[0]
        return static_errors(run.solution.time - run.solution.time[0], start[0], start[2], self.errors)

    def differences(self) -> dict[Integrator, TrajectoryErrors]:
        """Each integrator, on a platform without errors, against the reference; else the others against the fourth."""
        if self.reference is not None:
            return {name: position_errors(run.undisturbed, self.reference) for name, run in self.runs.items()}
        judge = self.runs[_AGAINST].solution
        return {name: position_errors(run.solution, judge) for name, run in self.runs.items() if name != _AGAINST}


def torquing_columns(run: PlatformRun) -> dict[str, FloatArray]:
    """Columns of the time, the torquing rates and the platform's attitude error, by name with unit.

    Parameters
    ----------
    run : PlatformRun
    """
    rates, tilt = torquing_rates(run.solution) / DEG_PER_H, run.tilt / DEG
    named = {"time_s": run.solution.time}
    named |= {"torquing_e_deg_h": rates[:, 1], "torquing_n_deg_h": rates[:, 0], "torquing_u_deg_h": -rates[:, 2]}
    if run.undisturbed is not run.solution:
        named |= {f"tilt_{axis}_deg": tilt[:, i] for i, axis in enumerate("ned")}
    return {name: np.round(values, 9) + 0.0 for name, values in named.items()}


def platform_facts(
    study: PlatformStudy, reading: Mapping[str, Any], configuration: Mapping[str, Any]
) -> dict[str, Any]:
    """Gather the facts of a platform, JSON-ready, units in the keys.

    Parameters
    ----------
    study : PlatformStudy
    reading : mapping
        What was understood of each file.
    configuration : mapping
        Options in force.
    """
    judged = "reference" if study.reference is not None else _AGAINST
    facts = {
        "versions": versions(),
        "configuration": configuration,
        "input": reading,
        "integrator": study.chosen,
        "vertical": study.run.vertical,
        "end": {name: _state(run) for name, run in study.runs.items()},
        f"largest_difference_to_{judged}": {
            name: {
                "horizontal_m": float(each.horizontal.max()),
                "velocity_m_s": float(np.nanmax(np.abs(each.velocity), initial=0.0)),
            }
            for name, each in study.differences().items()
        },
        "platform_errors": _error_facts(study),
        "notes": list(study.notes),
    }
    ready: dict[str, Any] = json_ready(facts)
    return ready


def platform_sheet(study: PlatformStudy) -> Sheet:
    """Put tables and figures of a platform on one page.

    Parameters
    ----------
    study : PlatformStudy
    """
    run, theory = study.run, study.theory
    differences = study.differences()
    tables = [_end_table(study.runs), _difference_table(differences, study.reference is not None)]
    if study.errors.any:
        tables += _error_tables(study, theory)
    judge = "the reference" if study.reference is not None else "fourth order"
    time = next(iter(differences.values())).time
    sizes = {name: each.horizontal for name, each in differences.items()}
    speeds = {name: np.hypot(each.velocity[:, 0], each.velocity[:, 1]) for name, each in differences.items()}
    with drawing():
        pictures = [
            Picture("track", draw_platform_track(run, study.reference), "Track"),
            Picture("velocity", draw_platform_velocity(run), "Velocity"),
            Picture("torquing", draw_torquing(run), "Torquing rates"),
            Picture("integrators", draw_differences(time, sizes, speeds, judge), "Difference between the integrators"),
        ]
        if study.errors.any:
            pictures.append(Picture("errors", draw_platform_errors(run, theory), "What the platform's errors do"))
    end = run.solution
    lat, lon, height = end.lla[-1]
    duration = end.time[-1] - end.time[0]
    return Sheet(
        f"North-pointing platform: {study.name}",
        (
            f"After {duration:.1f} s, integrator {study.chosen}, vertical channel {run.vertical}: latitude "
            f"{lat / DEG:.7f} deg, longitude {lon / DEG:.7f} deg, height {height:.2f} m, velocity east "
            f"{end.v_n[-1, 1]:.4f}, north {end.v_n[-1, 0]:.4f}, up {-end.v_n[-1, 2] + 0.0:.4f} m/s.",
        ),
        tuple(tables),
        tuple(pictures),
        (*_assumptions(study), *study.notes),
    )


def _state(run: PlatformRun) -> dict[str, float]:
    lla, v_n = run.solution.lla[-1], run.solution.v_n[-1]
    return {
        "lat_deg": lla[0] / DEG,
        "lon_deg": lla[1] / DEG,
        "height_m": lla[2],
        "v_east_m_s": v_n[1],
        "v_north_m_s": v_n[0],
        "v_up_m_s": -v_n[2] + 0.0,
    }


def _end_table(runs: Mapping[Integrator, PlatformRun]) -> Table:
    rows = []
    for name, run in runs.items():
        state = _state(run)
        speeds = tuple(f"{round(state[key], 5) + 0.0:.5f}" for key in ("v_east_m_s", "v_north_m_s", "v_up_m_s"))
        rows.append((name, f"{state['lat_deg']:.8f}", f"{state['lon_deg']:.8f}", f"{state['height_m']:.3f}", *speeds))
    columns = ("integrator", "lat [deg]", "lon [deg]", "height [m]", "east [m/s]", "north [m/s]", "up [m/s]")
    return Table("At the end", columns, tuple(rows))


def _difference_table(differences: Mapping[Integrator, TrajectoryErrors], judged: bool) -> Table:
    rows = tuple(
        (
            name,
            number(float(each.horizontal.max())),
            number(float(each.horizontal[-1])),
            number(float(np.nanmax(np.hypot(each.velocity[:, 0], each.velocity[:, 1]), initial=0.0))),
        )
        for name, each in differences.items()
    )
    columns = ("integrator", "largest [m]", "at the end [m]", "velocity, largest [m/s]")
    note = "on a platform without errors" if judged else ""
    return Table(f"Horizontal difference to {'the reference' if judged else 'fourth order'}", columns, rows, note)


def _error_facts(study: PlatformStudy) -> dict[str, Any] | None:
    if not study.errors.any:
        return None
    run, theory = study.run, study.theory
    off = ned_offset(run.solution.lla, run.undisturbed.lla)
    facts: dict[str, Any] = {
        "tilt_n_e_d_deg": study.errors.tilt / DEG,
        "drift_n_e_d_deg_h": study.errors.drift / DEG_PER_H,
        "bias_n_e_d_ug": study.errors.bias / UG,
        "largest_position_error_n_e_m": np.abs(off[:, :2]).max(axis=0),
        "position_error_at_the_end_n_e_m": off[-1, :2],
    }
    if theory is not None:
        facts["largest_by_closed_form_n_e_m"] = np.abs(theory.position).max(axis=0)
        facts["largest_difference_to_closed_form_m"] = float(np.abs(off[:, :2] - theory.position).max())
    return facts


def _error_tables(study: PlatformStudy, theory: StaticErrors | None) -> list[Table]:
    run = study.run
    off = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    speed = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    rows = []
    expected = (theory.position, theory.velocity) if theory else (None, None)
    for label, values, closed in (("position [m]", off, expected[0]), ("velocity [m/s]", speed, expected[1])):
        for column, axis in enumerate(("north", "east")):
            row = [
                f"{axis} {label}",
                number(float(np.abs(values[:, column]).max())),
                number(float(values[-1, column])),
            ]
            if closed is not None:
                row.append(number(float(np.abs(closed[:, column]).max())))
                row.append(number(float(np.abs(values - closed)[:, column].max())))
            rows.append(tuple(row))
    columns = ("error", "largest", "at the end", *(("closed form", "off it by") if theory else ()))
    tables = [Table("What the platform's errors do", columns, tuple(rows))]
    lat, _, height = run.undisturbed.lla[0]
    time = run.solution.time - run.solution.time[0]
    if theory is not None and time[-1] >= SHORTEST_RECORD * 86400.0 and lat != 0.0:
        tables.append(periods_table({"platform": off}, time, float(lat), float(height)))
    return tables


def periods_table(records: Mapping[str, FloatArray], time: FloatArray, lat: float, height: float) -> Table:
    """Periods found in records of position errors at rest beside those of theory.

    Parameters
    ----------
    records : mapping of str to (n, 2) array
        Errors North, East [m] by name.
    time : (n,) array
        Since the start [s].
    lat, height : float
        Latitude [rad] and height [m].
    """
    expected = periods(lat, height)
    found = {name: measured_periods(time, position, lat, height) for name, position in records.items()}
    rows = []
    for label, key, unit in (
        ("Schuler [min]", "schuler", 60.0),
        ("Foucault [h]", "foucault", 3600.0),
        ("Earth [h]", "earth", 3600.0),
    ):
        theory = getattr(expected, key)
        row = [label, f"{theory / unit:.4f}"]
        for each in found.values():
            value = getattr(each, key)
            row.append("not seen" if value is None else f"{value / unit:.4f} ({100.0 * (value / theory - 1.0):+.3f} %)")
        rows.append(tuple(row))
    note = "found in the position error by least squares, amplitudes free"
    return Table("Periods of the error", ("period", "theory", *found), tuple(rows), note)


def _assumptions(study: PlatformStudy) -> Sequence[str]:
    vertical = {
        "off": "The height is held at that of the start, the vertical velocity at zero.",
        "free": "The vertical channel is free: its error grows by e every 570 s.",
        "damped": f"The vertical channel is drawn to the height input with three time constants of {DAMPING_TIME:g} s.",
    }
    lines = [
        "forward and backward take the rates of each step's start and end, mean their mean; fourth is Runge-Kutta of "
        "fourth order, the specific force half-way from a polynomial through the six samples around it.",
        "Each step is as long as the times of the samples say.",
        vertical[study.run.vertical],
    ]
    if study.errors.any:
        lines.append("The samples are taken for those of a platform without errors; tilted, it senses them rotated.")
    return lines
