"""All figures of a run, drawn into a folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from insnav.errors.gps_gaps import outages
from insnav.errors.metrics import TrajectoryErrors
from insnav.report.run.figures.errors import draw_distribution, draw_errors
from insnav.report.run.figures.innovations import draw_innovations
from insnav.report.run.figures.sensor_errors import draw_sensor_errors
from insnav.report.run.figures.states import draw_attitude, draw_height, draw_velocity
from insnav.report.run.figures.track import draw_track
from insnav.report.run.figures.uncertainty import draw_uncertainty
from insnav.report.style import Clock, FigureFormat, drawing, save
from insnav.types import GpsData, Run


def draw_all(
    run: Run,
    gps: GpsData | None,
    errors: TrajectoryErrors | None,
    folder: Path,
    file_format: FigureFormat = "png",
    smoothed_errors: TrajectoryErrors | None = None,
) -> list[Path]:
    """Draw every figure there is something to show in.

    Parameters
    ----------
    run : Run
        With at least one row in its solution.
    gps : GpsData or None
        The fixes, for the background of track, height and velocity.
    errors : TrajectoryErrors or None
        Errors against a reference.
    folder : Path
        Where to; it exists.
    file_format : {"png", "svg"}
    smoothed_errors : TrajectoryErrors, optional
        Errors of the smoothed solution against the same reference.

    Returns
    -------
    list of Path
        The files, in the order to show them.
    """
    figures: list[tuple[str, Callable[[], Figure | None]]] = [("track", partial(draw_track, run, gps))]
    if errors is not None:
        clock, spans = Clock.of(run.solution.time), outages(run)
        figures += [
            (f"error_{group}", partial(draw_errors, errors, group, clock, spans, smoothed_errors))
            for group in ("position", "velocity", "attitude")
        ]
        figures.append(("error_distribution", partial(draw_distribution, errors)))
    figures += [
        ("height", partial(draw_height, run, gps)),
        ("velocity", partial(draw_velocity, run, gps)),
        ("attitude", partial(draw_attitude, run)),
        ("uncertainty", partial(draw_uncertainty, run)),
        ("innovations", partial(draw_innovations, run)),
        ("biases", partial(draw_sensor_errors, run)),
    ]
    written = []
    with drawing():
        for name, draw in figures:
            figure = draw()
            if figure is not None:
                written.append(save(figure, folder / name, file_format))
    return written
