"""The report of a navigated drive: accuracy, figures, tables; its files, its main table."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.gps_gaps import outages
from insnav.errors.metrics import nees
from insnav.imu.imu_file import to_toml
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.output.kml import write_kml
from insnav.output.solution_tables import TableFormat, write_events, write_run_table
from insnav.report.numbers import number
from insnav.report.page import FigureSpec, Page, Section
from insnav.report.run.figures.errors import draw_distribution, sample_errors
from insnav.report.run.figures.innovations import draw_innovations
from insnav.report.run.figures.sensor_errors import draw_sensor_errors
from insnav.report.run.figures.states import draw_attitude, draw_height, draw_velocity
from insnav.report.run.figures.track import draw_track
from insnav.report.run.figures.uncertainty import draw_uncertainty
from insnav.report.run.quantities import run_sections
from insnav.report.run.reopened import read_found as read_found
from insnav.report.run.short_duration import short_columns
from insnav.report.run.summary import summary_lines
from insnav.report.run.warnings import run_warnings
from insnav.report.run_json import page_facts
from insnav.report.series import Clock
from insnav.result import Result

if TYPE_CHECKING:
    import pandas as pd


def page(result: Result[EvaluatedRun]) -> Page:
    """Lay out a run."""
    found = result.found
    reference = result.inputs["reference"].path if "reference" in result.inputs else ""
    accuracy, *others = run_sections(found, reference)
    name = result.inputs["imu"].path if "imu" in result.inputs else "a drive"
    return Page(
        f"Navigation of {name}",
        run_summary(found, reference),
        (accuracy, Section("", figures=run_figures(found), show="page"), *others),
        warnings=run_warnings(found),
    )


def run_summary(found: EvaluatedRun, reference: str) -> tuple[str, ...]:
    """Say how accurate a run is, and how sure of itself."""
    errors, smoothed = found.errors, found.smoothed_errors
    if errors is None:
        return ("No reference was given: the accuracy is not known.",)
    size = errors.horizontal
    cep50, r95 = (number(float(np.percentile(size, share))) for share in (50.0, 95.0))
    lines = [
        f"Horizontal error {number(float(np.sqrt(np.mean(size**2))))} m RMS, CEP50 {cep50} m, R95 {r95} m, largest "
        f"{number(float(size.max()))} m: solution minus {reference}, at {len(size)} epochs."
    ]
    if smoothed is not None:
        lines.append(f"Smoothed: {number(float(np.sqrt(np.mean(smoothed.horizontal**2))))} m RMS.")
    stated = nees(errors)
    shares = {name: each["inside_3_sd"] for name, each in (stated or {}).items() if each}
    if shares:
        text = ", ".join(f"{name} {100.0 * share:.1f} %" for name, share in shares.items())
        lines.append(f"Errors inside 3 sd (99.7 % if normal): {text}.")
    return tuple(lines)


def text(page: Page) -> str:
    """Sum up a run on one screen."""
    return "\n".join(summary_lines(page_facts(page)))


def run_figures(found: EvaluatedRun) -> tuple[FigureSpec, ...]:
    """Give every figure that there is something to show in."""
    run, gps, errors = found.run, found.gps, found.errors
    if len(run.solution.time) == 0:
        return ()
    figures = [FigureSpec("track", "Track, with fixes and outages", partial(draw_track, run, gps))]
    if errors is not None:
        clock, spans = Clock.of(run.solution.time), outages(run)
        figures += [
            FigureSpec(
                f"{group}_error",
                f"{group.capitalize()} error and its ±3 sd",
                partial(sample_errors, errors, group, clock, spans, found.smoothed_errors),
            )
            for group in ("position", "velocity", "attitude")
            if np.isfinite(getattr(errors, group)).any()
        ]
        figures.append(
            FigureSpec("error_distribution", "Distribution of the horizontal error", partial(draw_distribution, errors))
        )
    figures += [
        FigureSpec("height", "Height", partial(draw_height, run, gps)),
        FigureSpec("velocity", "Velocity", partial(draw_velocity, run, gps)),
        FigureSpec("attitude", "Attitude", partial(draw_attitude, run)),
    ]
    if run.smoothed is not None and run.smoothed.solution.sd is not None and run.solution.sd is not None:
        caption = "Standard deviation of the filtered and of the smoothed solution"
        figures.append(FigureSpec("uncertainty", caption, partial(draw_uncertainty, run)))
    if np.isfinite(run.innovations.innovation).any():
        figures.append(FigureSpec("innovations", "Innovations and their gates", partial(draw_innovations, run)))
    if np.isfinite(run.sensor_errors.value).any():
        figures.append(FigureSpec("biases", "Estimated sensor errors", partial(draw_sensor_errors, run)))
    return tuple(figures)


def write_files(result: Result[EvaluatedRun], folder: RunFolder, table_format: TableFormat) -> None:
    """Write solution, fixes, innovations, errors, sensor errors, IMU model, events and track.

    `folder`: entered, not committed; `table_format` {"csv", "parquet"}.
    """
    found, run, place = result.found, result.found.run, folder.directory
    write_run_table(place, run.solution, table_format)
    if run.smoothed is not None:
        write_run_table(place, run.smoothed.solution, table_format, "smoothed")
        write_run_table(place, run.smoothed.sensor_errors, table_format, "smoothed_biases")
    write_run_table(place, run.innovations, table_format)
    write_run_table(place, run.sensor_errors, table_format)
    for name, errors in (("errors", found.errors), ("smoothed_errors", found.smoothed_errors)):
        if errors is not None:
            write_run_table(place, errors, table_format, name)
    if found.gps is not None:
        write_run_table(place, found.gps, table_format)
    if result.imu_model is not None:
        folder.path("imu.toml").write_text(to_toml(result.imu_model[0]), encoding="utf-8", newline="\n")
    write_events(place, result.events or run.events)
    write_kml(place, run.solution, Path(result.inputs["imu"].path).name if "imu" in result.inputs else "track")
    if found.short_duration:
        write_table(folder.path("short.csv"), short_columns(found.short_duration))


def frame(result: Result[EvaluatedRun]) -> pd.DataFrame:
    """Give the solution as a table.

    Returns: columns as in ``solution.csv``.
    """
    return result.found.run.solution.to_frame()
