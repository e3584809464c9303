"""A result into a folder and back: tables, figures, page, ``run.json``.

A kind of result is a room of this package, found by its name: ``insnav.report.<kind>.page`` has ``page(result)``,
which gives its `Page`, ``write_files(result, folder, table_format)`` for its other files, ``frame(result)`` for its
main table, and, if it can be read again, ``read_found(folder)``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from insnav.errors.metrics import position_errors
from insnav.exceptions import ConfigError
from insnav.filter.navigate import Navigated
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.output.folder import RunFolder, read_facts
from insnav.output.kml import write_kml
from insnav.output.solution_tables import (
    TableFormat,
    write_events,
    write_run_table,
)
from insnav.report.html import page_html
from insnav.report.page import Page
from insnav.report.run.quantities import run_facts
from insnav.report.run_json import json_ready, page_facts, versions
from insnav.report.style import FigureFormat, drawing, save
from insnav.result import Result
from insnav.types import EventKind, FloatArray, Trajectory
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, G0, M_S_PER_SQRT_H, PPM

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def page_of(result: Result[Any]) -> Page:
    """Lay out a result."""
    return replace(cast(Page, _of_room(result.kind, "page")(result)), notes=result.notes)


def frame(result: Result[Any]) -> pd.DataFrame:
    """Give the main table of a result."""
    return cast("pd.DataFrame", _of_room(result.kind, "frame")(result))


def _of_room(kind: str, name: str) -> Callable[..., Any]:
    """Function of the report room of a kind of result."""
    room = import_module(f"insnav.report.{kind}.page")
    if not hasattr(room, name):
        raise ConfigError(f"a result of kind {kind} has no such form", where=name)
    return cast("Callable[..., Any]", getattr(room, name))


def figure(result: Result[Any], name: str) -> Figure:
    """Draw one figure of a result by its name; see `insnav.result.Result.plot`."""
    figures = {each.name: each.draw for each in page_of(result).figures}
    if name not in figures:
        raise ConfigError(f"there is no figure {name!r}", fix=f"this result has {', '.join(figures) or 'none'}")
    with drawing():
        return figures[name]()


def save_result(
    result: Result[Any],
    folder: RunFolder,
    *,
    figures: FigureFormat | Literal["none"] = "png",
    table_format: TableFormat = "csv",
) -> Path:
    """Write a result into a folder and put it in its place.

    Parameters
    ----------
    result : Result
    folder : RunFolder
        Entered, not committed.
    figures : {"png", "svg", "none"}
        File format of the figures; none leaves out the page too.
    table_format : {"csv", "parquet"}

    Returns
    -------
    Path
        The finished folder.
    """
    _of_room(result.kind, "write_files")(result, folder, table_format)
    return write_page(
        folder, page_of(result), result_facts(result), figure_format=None if figures == "none" else figures
    )


def result_facts(result: Result[Any]) -> dict[str, Any]:
    """Give what every result has for ``run.json``: kind, versions, options, inputs, IMU model."""
    return {
        "kind": result.kind,
        "versions": versions(),
        "configuration": result.options,
        "input": {name: each.as_dict() for name, each in result.inputs.items()},
        "imu_model": None if result.imu_model is None else model_facts(*result.imu_model),
    }


def open_folder(folder: Path) -> Result[Any]:
    """Read a saved result again; see `insnav.result.open_result`."""
    facts = read_facts(folder)
    kind = str(facts.get("kind", "run"))
    inputs = {name: ReadingFacts.from_dict(each) for name, each in facts.get("input", {}).items()}
    found = _of_room(kind, "read_found")(folder)
    return Result(kind, found, inputs, facts.get("configuration", {}), None, tuple(facts.get("notes", ())))


def write_run(
    folder: RunFolder,
    done: Navigated,
    *,
    readings: Mapping[str, Reading[Any] | None],
    configuration: Mapping[str, Any],
    spec: ImuSpec,
    imu_note: str,
    reference_lever_b: FloatArray | None,
    table_format: TableFormat,
    figure_format: Any,
    more_facts: Mapping[str, Any] | None = None,
    more_figures: Sequence[Path] = (),
) -> tuple[dict[str, Any], Path]:
    """Write the whole run folder and put it in place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    done : Navigated
        The run.
    readings : mapping
        ``imu``, ``gps`` and ``reference`` as read; a reference may be None.
    configuration : mapping
        Options in force.
    spec : ImuSpec
        IMU model.
    imu_note : str
        How it was chosen.
    reference_lever_b : (3,) array or None
        Point of the reference seen from the IMU [m].
    table_format : {"csv", "parquet"}
    figure_format : {"png", "svg"} or None
    more_facts : mapping, optional
        What was found besides the solution; JSON-ready.
    more_figures : sequence of Path
        Its figures, already in the folder.

    Returns
    -------
    facts : dict
        Content of ``run.json``.
    where : Path
        The finished folder.
    """
    given = {name: reading for name, reading in readings.items() if reading is not None}
    read_events = [event for reading in given.values() for event in reading.events]
    run = replace(done.run, events=tuple(sorted([*read_events, *done.run.events], key=lambda event: event.time)))
    reference = readings.get("reference")
    errors = smoothed_errors = None
    if reference is not None:
        errors = position_errors(run.solution, _fixed(reference), lever_b=reference_lever_b)
        if run.smoothed is not None:
            smoothed_errors = position_errors(run.smoothed.solution, _fixed(reference), lever_b=reference_lever_b)
    warnings = [*done.notes]
    if reference is not None and len(_fixed(reference).time) < len(reference.data.time):
        left = len(reference.data.time) - len(_fixed(reference).time)
        warnings.append(f"accuracy counts reference epochs with fix = 1 only; {left} others are left out")
    diverged = [event for event in run.events if event.kind is EventKind.DIVERGED]
    if diverged:
        warnings.append(
            f"innovations do not fit their predicted size in {len(diverged)} windows of a minute, first at "
            f"{diverged[0].time:.1f} s: {diverged[0].unit} = {diverged[0].value:.2g}; {diverged[0].hint}"
        )
    facts = run_facts(
        run,
        reading={name: reading.facts.as_dict() for name, reading in given.items()},
        configuration=configuration,
        imu_model=model_facts(spec, imu_note),
        errors=errors,
        smoothed_errors=smoothed_errors,
        reference_name=reference.facts.path if reference is not None else "",
        warnings=warnings,
    )
    facts |= more_facts or {}
    write_run_table(folder.directory, run.solution, table_format)
    if run.smoothed is not None:
        write_run_table(folder.directory, run.smoothed.solution, table_format, "smoothed")
    write_run_table(folder.directory, run.innovations, table_format)
    write_run_table(folder.directory, run.sensor_errors, table_format)
    write_events(folder.directory, run.events)
    write_kml(folder.directory, run.solution, Path(given["imu"].facts.path).name)
    if figure_format is not None:
        from insnav.report.run.figures import draw_all
        from insnav.report.run.page import write_page as write_run_page

        figures = draw_all(run, done.gps, errors, folder.path("figures/track").parent, figure_format, smoothed_errors)
        write_run_page(
            folder.path("report.html"),
            facts,
            [*figures, *more_figures],
            title=f"insnav run of {given['imu'].facts.path}",
        )
    where = folder.commit(facts)
    return facts, where


def _fixed(reference: Reading[Trajectory]) -> Trajectory:
    """Reference epochs that are good enough to judge by: ambiguities fixed, where the file tells."""
    if reference.fix is None or not (reference.fix == 1).any():
        return reference.data
    return reference.data.rows(reference.fix == 1)


def model_facts(spec: ImuSpec, how: str) -> dict[str, Any]:
    """Figures of an IMU model in field units."""

    def sensor(s: SensorSpec, unit: str, scale: float, walk: str, walk_scale: float) -> dict[str, Any]:
        return {
            f"bias_{unit}": s.bias / scale,
            f"bias_instability_{unit}": s.bias_instability / scale,
            "correlation_time_h": s.correlation_time / 3600.0,
            f"random_walk_{walk}": s.random_walk / walk_scale,
            "scale_factor_ppm": s.scale_factor / PPM,
            "misalignment_deg": s.misalignment / DEG,
        }

    return {
        "name": spec.name,
        "chosen": how,
        "source": spec.source,
        "gyro": sensor(spec.gyro, "deg_h", DEG_PER_H, "deg_sqrt_h", DEG_PER_SQRT_H),
        "accel": sensor(spec.accel, "mg", 1e-3 * G0, "m_s_sqrt_h", M_S_PER_SQRT_H),
    }


def write_page(
    folder: RunFolder,
    page: Page,
    metadata: Mapping[str, Any] | None = None,
    texts: Mapping[str, str] | None = None,
    figure_format: FigureFormat | None = "png",
) -> Path:
    """Write figures, page, JSON and text files into a folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    page : Page
        Content of ``report.html``, ``figures`` and ``run.json``.
    metadata : mapping, optional
        What stands first in ``run.json``: command, input, options.
    texts : mapping, optional
        Further files: name to content, such as ``calibration.toml``.
    figure_format : {"png", "svg"} or None
        None leaves out figures and page.

    Returns
    -------
    Path
        The finished folder.

    Raises
    ------
    ConfigError
        Two figures of one name.
    OutputError
        The folder cannot be written.
    """
    names = [figure.name for figure in page.figures]
    if len(set(names)) < len(names):
        raise ConfigError("two figures have the same name", where=", ".join(names))
    for name, text in (texts or {}).items():
        folder.path(name).write_text(text, encoding="utf-8", newline="\n")
    if figure_format is not None:
        with drawing():
            files = [save(each.draw(), folder.path(f"figures/{each.name}"), figure_format) for each in page.figures]
        folder.path("report.html").write_text(page_html(page, files), encoding="utf-8", newline="\n")
    return folder.commit({**json_ready(metadata or {}), **page_facts(page)})
