"""Report of a navigated drive: accuracy, figures, tables; its files, main table, and reading of a saved run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insnav.deferred import library
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import TrajectoryErrors
from insnav.exceptions import InputError
from insnav.findings import OF_RESULTS, Code, Finding, Severity, by_time, is_shown
from insnav.imu.imu_file import to_toml
from insnav.output import solution_tables
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder, read_facts
from insnav.output.track_files import write_kml
from insnav.quantity import Quantity, key_suffix
from insnav.report.page import DataFrame, Figure, FigureSpec, Later, Page, Section
from insnav.report.panels import Clock
from insnav.report.run.quantities import run_sections
from insnav.report.run.verdict import brief_lines, rated, run_circles, run_line, run_merits, run_verdict
from insnav.result import Result
from insnav.types import AidingUse, Alignment, Epochs, FloatArray, GpsData, Innovations, Run, SensorErrors, Smoothed
from insnav.units import DEG, DEG_PER_H

_panels = library("insnav.report.run.panels")  # used only for a page
PDF_PAGES = {
    "summary": ("track",),
    "accuracy": ("position_error", "attitude_error", "uncertainty", "attitude"),
    "filter": ("innovations", "biases"),
}
BACKDROP = "backdrop.geojson"
MOST_POINTS = 50_000  # points on a page
_DEPTH = {"LineString": 0, "MultiLineString": 1, "Polygon": 1, "MultiPolygon": 2}  # nesting of lists of points


def page(result: Result[EvaluatedRun], *, sections: bool = True) -> Page:
    """Lay out a run, optionally without sections."""
    found = result.found
    reference = result.inputs["reference"].path if "reference" in result.inputs else ""
    name = result.inputs["imu"].path if "imu" in result.inputs else "a drive"
    best = next(iter(rated(found)), "")
    clock = Clock.of(found.run.solution.time)
    shown = tuple(each for each in result.findings if is_shown(each))
    return Page(
        str(Path(*Path(name).parts[-2:])),  # files of many drives have the same name
        (run_line(result), *run_circles(found, Path(reference).name)),
        _sections(found, reference) if sections else (),
        shown,
        at=clock.moment,
        starts_at=clock.start,
        verdict=run_verdict(found, sum(each.severity >= Severity.WARNING for each in shown)),
        merits=run_merits(found, best) if best else (),
        merits_note="Root mean square over the drive, solution:" if best else "",
        merits_by={mode: run_merits(found, mode) for mode in rated(found)},
    )


def _sections(found: EvaluatedRun, reference: str) -> tuple[Section, ...]:
    accuracy, *others = run_sections(found, reference)
    return (
        Section("", panels=Later(lambda: _panels.run_panels(found)), figures=run_figures(found), show="page"),
        Section("", "Accuracy, stationary and moving", parts=(accuracy,), folded=True),
        Section("", "All figures of the run", parts=tuple(others), folded=True),
    )


def text(result: Result[EvaluatedRun], width: int | None = None) -> str:
    """Summarise a run in a few lines."""
    return "\n".join(brief_lines(result.laid_out or page(result, sections=False), result.found, width))


def run_figures(found: EvaluatedRun) -> tuple[FigureSpec, ...]:
    """List the figures that have data."""
    run, errors = found.run, found.errors
    if len(run.solution.time) == 0:
        return ()
    names = {"track": "Track, with fixes and outages"}
    if errors is not None:
        names |= {
            f"{group}_error": f"{group.capitalize()} error and its ±3 sd"
            for group in ("position", "velocity", "attitude")
            if np.isfinite(getattr(errors, group)).any()
        }
        names["error_distribution"] = "Distribution of the horizontal error"
    names |= {"height": "Height", "velocity": "Velocity", "attitude": "Attitude"}
    if run.smoothed is not None and run.smoothed.solution.sd is not None and run.solution.sd is not None:
        names["uncertainty"] = "Standard deviation of the filtered and of the smoothed solution"
    if np.isfinite(run.innovations.innovation).any():
        names["innovations"] = "Innovations and their gates"
    if np.isfinite(run.sensor_errors.value).any():
        names["biases"] = "Estimated sensor errors"
    return tuple(FigureSpec(name, caption, partial(_draw, name, found)) for name, caption in names.items())


def _draw(name: str, found: EvaluatedRun) -> Figure:
    from insnav.report.figures import draw_drawings  # matplotlib is imported only for a requested figure
    from insnav.report.run.figures import figure_drawings

    title, note, drawings, columns = figure_drawings(name, found)
    return draw_drawings(drawings, title, note, columns=columns)


def write_files(result: Result[EvaluatedRun], folder: RunFolder, table_format: solution_tables.TableFormat) -> None:
    """Write solution, fixes, innovations, errors, sensor errors, IMU model, events and track.

    `folder`: entered, not committed. `table_format` {"csv", "parquet"}.
    """
    found, run, place = result.found, result.found.run, folder.directory
    tables = [("", run.solution), ("", run.innovations), ("", run.sensor_errors), ("", found.gps)]
    tables += [("errors", found.errors), ("smoothed_errors", found.smoothed_errors)]
    if run.smoothed is not None:
        tables += [("smoothed", run.smoothed.solution), ("smoothed_biases", run.smoothed.sensor_errors)]
    tables.append(("poses", run.poses))
    for name, table in tables:
        if table is not None:
            solution_tables.write_run_table(place, table, table_format, name)
    if result.imu_model is not None:
        folder.path("imu.toml").write_text(to_toml(result.imu_model[0]), encoding="utf-8", newline="\n")
    solution_tables.write_events(place, result.findings or run.events)
    write_kml(place, found.best, Path(result.inputs["imu"].path).name if "imu" in result.inputs else "track")
    if found.backdrop is not None:
        write_backdrop(found.backdrop, folder.path(BACKDROP))
    if found.short_duration:
        from insnav.report.run.short_duration import short_columns

        write_table(folder.path("short.csv"), short_columns(found.short_duration))


def frame(result: Result[EvaluatedRun]) -> DataFrame:
    """Build a table of the better solution, with the columns of ``solution.csv``."""
    return result.found.best.to_frame()


def accuracy(found: EvaluatedRun) -> dict[str, dict[str, float]]:
    """Return the figures of merit of each solution, unit in the name; stated values begin with ``sd_``."""
    merits = {mode: [each for each in run_merits(found, mode) if each.value is not None] for mode in rated(found)}
    lead = "" if found.known_errors else "sd_"

    def name(each: Quantity) -> str:
        return f"{lead * (each.unit != '')}{each.key.replace(' ', '_')}{key_suffix(each.unit)}"

    return {mode: {name(each): float(each.scaled(each.value)) for each in own} for mode, own in merits.items()}


def read_found(folder: Path, findings: Sequence[Finding]) -> EvaluatedRun:
    """Read a run from its folder, without covariances between epochs and short-duration windows.

    Raises: InputError: a table is missing or damaged.
    """
    facts = read_facts(folder)
    try:
        fixes, aiding = facts["fixes"], facts["aiding"]
        alignment = _alignment(facts["alignment"])
    except (KeyError, TypeError) as error:
        raise InputError("report.other_version", where=str(folder), key=str(error)) from error
    none = np.empty(0)
    epochs = Epochs(none, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 9, 9)))
    sensor_errors = solution_tables.read_run_table(folder, SensorErrors)
    smoothed = None
    if solution_tables.has_smoothed(folder):
        biases = solution_tables.read_run_table(folder, SensorErrors, "smoothed_biases")
        smoothed = Smoothed(solution_tables.read_solution(folder, "smoothed"), epochs, biases)
    run = Run(
        solution_tables.read_solution(folder),
        solution_tables.read_run_table(folder, Innovations),
        sensor_errors,
        by_time(filter(_is_event, findings)),
        alignment,
        epochs,
        fixes["delay_s"],
        fixes["delay_sd_s"],
        np.array(fixes["lever_arm_m"]),
        np.array(fixes["lever_arm_sd_m"]),
        smoothed,
        tuple(map(_aiding, aiding)),
    )
    errors, smoothed_errors = (
        solution_tables.read_run_table(folder, TrajectoryErrors, name) if any(folder.glob(f"{name}.*")) else None
        for name in ("errors", "smoothed_errors")
    )
    gps = solution_tables.read_run_table(folder, GpsData) if any(folder.glob("fixes.*")) else None
    backdrop = read_backdrop(folder / BACKDROP) if (folder / BACKDROP).is_file() else None
    same = any(each.code is Code.REF_SAME_AS_GPS for each in findings)
    return EvaluatedRun(run, gps, errors, smoothed_errors, backdrop=backdrop, reference_is_gps=same)


def _is_event(finding: Finding) -> bool:
    """Return whether a finding is an event: with a time, or a warning without, for example on a reference."""
    known = finding.severity >= Severity.WARNING and finding.get("text") is None
    return finding.code not in OF_RESULTS and (finding.timed or known)


def _alignment(facts: Mapping[str, Any]) -> Alignment:
    rph = (facts[f"{name}_deg"] for name in ("roll", "pitch", "heading"))
    sd = (facts[f"{name}_sd_deg"] for name in ("tilt_north", "tilt_east", "heading"))
    level, heading = (
        Code(name) if name in set(Code) else name for name in (facts["level_method"], facts["heading_method"])
    )
    bias, bias_sd = (_array(facts[f"gyro_bias{name}_deg_h"]) * DEG_PER_H for name in ("", "_sd"))
    return Alignment(
        facts["time_s"],
        _array(rph) * DEG,
        _array(sd) * DEG,
        bias,
        np.where(np.isnan(bias_sd), np.inf, bias_sd),
        None if facts["static_s"] is None else tuple(facts["static_s"]),
        level,
        heading,
    )


def _array(values: Any) -> FloatArray:
    return np.array(list(values), dtype=np.float64)


def _aiding(facts: Mapping[str, Any]) -> AidingUse:
    key = next(key for key in facts if key.startswith("innovation_rms_"))
    unit = key.removeprefix("innovation_rms_").replace("_", "/")
    return AidingUse(facts["name"], facts["processed"], facts["rejected"], facts[key], facts["nis"], unit)


def read_backdrop(file: Path) -> FloatArray:
    """Read the lines of a GeoJSON file (RFC 7946) on WGS-84.

    Returns: (n, 2) latitude and longitude [rad], with a row of NaN after each line.
    Raises: InputError: no GeoJSON, no line in it, positions off the Earth, or too many points.
    """
    try:
        lines = list(_lines(json.loads(file.read_text(encoding="utf-8"))))
        points = [np.array([each[:2] for each in line], dtype=np.float64).reshape(-1, 2)[:, ::-1] for line in lines]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("report.not_geojson", where=str(file), reason=str(error)) from error
    if not points:
        raise InputError("report.empty_backdrop", where=str(file))
    found = np.concatenate([np.vstack((each, np.full((1, 2), np.nan))) for each in points])
    if len(found) > MOST_POINTS:
        raise InputError("report.large_backdrop", where=str(file), count=len(found), limit=MOST_POINTS)
    if np.nanmax(np.abs(found[:, 0])) > 90.0 or np.nanmax(np.abs(found[:, 1])) > 180.0:
        raise InputError("report.backdrop_unit", where=str(file))
    return found * DEG


def write_backdrop(lines: FloatArray, file: Path) -> None:
    """Write such lines as GeoJSON."""
    parts = np.split(lines, np.flatnonzero(np.isnan(lines[:, 0])) + 1)
    coordinates = [np.round(each[:-1, ::-1] / DEG, 9).tolist() for each in parts if len(each) > 1]
    file.write_text(json.dumps({"type": "MultiLineString", "coordinates": coordinates}), encoding="utf-8")


def _lines(value: Any) -> Iterator[Any]:
    """Yield every line and ring of an object and its members."""
    kind = value["type"]
    own = [value["geometry"]] if value.get("geometry") else []
    for part in value.get("features") or value.get("geometries") or own:
        yield from _lines(part)
    if kind in _DEPTH:
        found = [value["coordinates"]]
        for _ in range(_DEPTH[kind]):
            found = [each for part in found for each in part]
        yield from found
