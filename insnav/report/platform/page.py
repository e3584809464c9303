"""A north-pointing platform as a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.metrics import TrajectoryErrors
from insnav.errors.platform_errors import AGAINST, Demonstration, PlatformStudy
from insnav.errors.schuler import SHORTEST_RECORD, StaticErrors
from insnav.gimbal import Integrator, PlatformRun, torquing_rates
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.output.kml import write_kml
from insnav.output.solution_tables import TableFormat, write_events, write_run_table
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, Section, Verdict, drawn, only_json, rows_frame
from insnav.report.platform import panels
from insnav.report.platform.demonstration import demonstration_page, known, periods_section
from insnav.result import Result
from insnav.types import FloatArray
from insnav.units import DEG, DEG_PER_H


def write_files(result: Result[PlatformStudy | Demonstration], folder: RunFolder, table_format: TableFormat) -> None:
    """Write solution, torquing rates, events and track of a record.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}: of the solution.
    """
    study, place = result.found, folder.directory
    if isinstance(study, PlatformStudy):
        write_run_table(place, study.run.solution, table_format)
        write_table(folder.path("torquing.csv"), _torquing_columns(study))
        write_events(place, result.findings)
        write_kml(place, study.run.solution, _name(result))


def frame(result: Result[PlatformStudy | Demonstration]) -> DataFrame:
    """Give the solution as a table; of the demonstration, the integrators on known functions."""
    found = result.found
    return found.run.solution.to_frame() if isinstance(found, PlatformStudy) else rows_frame(known(found.orders).rows)


def _name(result: Result[PlatformStudy | Demonstration]) -> str:
    return Path(result.inputs["force"].path).name


def _torquing_columns(study: PlatformStudy) -> dict[str, FloatArray]:
    """Columns of the time, the torquing rates and the platform's attitude error, by name with unit."""
    run = study.run
    rates, tilt = torquing_rates(run.solution) / DEG_PER_H, run.tilt / DEG
    named = {"time_s": run.solution.time}
    named |= {"torquing_e_deg_h": rates[:, 1], "torquing_n_deg_h": rates[:, 0], "torquing_u_deg_h": -rates[:, 2]}
    if study.errors.any:
        named |= {f"tilt_{axis}_deg": tilt[:, i] for i, axis in enumerate("ned")}
    return {name: np.round(values, 9) + 0.0 for name, values in named.items()}


def page(result: Result[PlatformStudy | Demonstration]) -> Page:
    """Lay out a record integrated on a platform, or the demonstration."""
    study = result.found
    if isinstance(study, Demonstration):
        return demonstration_page(study)
    run, theory, differences = study.run, study.theory, study.differences()
    end = run.solution
    lat, lon, height = end.lla[-1]
    return Page(
        f"North-pointing platform: {_name(result)}",
        (f"Integrator {study.chosen}, vertical channel {run.vertical}.",),
        (
            *_drawn(study, theory, differences),
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
) -> tuple[Section, ...]:
    run = study.run
    against = "the reference" if study.reference is not None else "fourth order"
    sections = (
        drawn("track", "Track of a north-pointing platform", (panels.platform_track(study),)),
        drawn("velocity", "Velocity computed on the platform", panels.platform_velocity(run)),
        drawn("torquing", "Commanded torquing rates", panels.torquing_panels(run)),
        drawn("integrators", "Difference between the integrators", panels.difference_panels(differences, against)),
    )
    if not study.errors.any:
        return sections
    return (*sections, drawn("errors", "Impact of the platform's errors", panels.platform_error_panels(run, theory)))


def _state(name: Integrator, run: PlatformRun) -> tuple[Quantity, ...]:
    lla, v_n = run.solution.lla[-1], run.solution.v_n[-1]
    return (
        Quantity("integrator", name),
        Quantity("lat", float(lla[0]), "deg", decimals=8),
        Quantity("lon", float(lla[1]), "deg", decimals=8),
        Quantity("height", float(lla[2]), "m", decimals=3),
        Quantity("v_east", float(v_n[1]), "m/s", meaning="east", decimals=5),
        Quantity("v_north", float(v_n[0]), "m/s", meaning="north", decimals=5),
        Quantity("v_up", float(-v_n[2] + 0.0), "m/s", meaning="up", decimals=5),
    )


def _differences(differences: Mapping[Integrator, TrajectoryErrors], *, to_reference: bool) -> Section:
    rows = tuple(
        (
            Quantity("integrator", name),
            Quantity("horizontal", float(each.horizontal.max()), "m", meaning="largest"),
            Quantity("end", float(each.horizontal[-1]), "m", meaning="at the end"),
            Quantity(
                "velocity", float(np.nanmax(panels.speed_of(each), initial=0.0)), "m/s", meaning="velocity, largest"
            ),
        )
        for name, each in differences.items()
    )
    which = "the reference" if to_reference else "fourth order"
    key = f"largest_difference_to_{'reference' if to_reference else AGAINST}"
    note = "on a platform without errors" if to_reference else ""
    return Section(key, f"Horizontal difference to {which}", rows=rows, note=note, keyed=True)


def _errors(study: PlatformStudy, theory: StaticErrors | None) -> tuple[Section, ...]:
    """What the errors of the platform do, and the closed form where there is one."""
    run, given = study.run, study.errors
    off = ned_offset(run.solution.lla, run.undisturbed.lla)[:, :2]
    speed = (run.solution.v_n - run.undisturbed.v_n)[:, :2]
    items = [
        Quantity("tilt_n_e_d", given.tilt, "deg"),
        Quantity("drift_n_e_d", given.drift, "deg/h"),
        Quantity("bias_n_e_d", given.bias, "ug"),
        Quantity("largest_position_error_n_e", np.abs(off).max(axis=0), "m"),
        Quantity("position_error_at_the_end_n_e", off[-1], "m"),
    ]
    expected = (theory.position, theory.velocity) if theory else (None, None)
    if theory is not None:
        items.append(Quantity("largest_by_closed_form_n_e", np.abs(theory.position).max(axis=0), "m"))
        largest = float(np.abs(off - theory.position).max())
        items.append(Quantity("largest_difference_to_closed_form", largest, "m"))
    rows = []
    for what, values, closed, unit in (("position", off, expected[0], "m"), ("velocity", speed, expected[1], "m/s")):
        for k, axis in enumerate(("north", "east")):
            row = [
                Quantity("error", f"{axis} {what}"),
                Quantity("largest", float(np.abs(values[:, k]).max()), unit),
                Quantity("end", float(values[-1, k]), unit, meaning="at the end"),
            ]
            if closed is not None:
                row.append(Quantity("closed_form", float(np.abs(closed[:, k]).max()), unit))
                row.append(Quantity("difference", float(np.abs(values - closed)[:, k].max()), unit))
            rows.append(tuple(row))
    sections = (
        only_json("platform_errors", *items),
        Section("", "Impact of the platform's errors", rows=tuple(rows)),
    )
    lat, _, height = run.undisturbed.lla[0]
    time = run.solution.time - run.solution.time[0]
    if theory is None or time[-1] < SHORTEST_RECORD * 86400.0 or lat == 0.0:
        return sections
    return (*sections, periods_section({"platform": off}, time, float(lat), float(height)))
