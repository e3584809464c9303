"""Figures of a run for papers: track, states, innovations, sensor errors, and errors against a reference."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.gps_gaps import outages
from insnav.report.run.figures.errors import draw_distribution, sample_errors
from insnav.report.run.figures.innovations import draw_innovations
from insnav.report.run.figures.sensor_errors import draw_sensor_errors
from insnav.report.run.figures.states import draw_attitude, draw_height, draw_velocity
from insnav.report.run.figures.track import draw_track
from insnav.report.run.figures.uncertainty import draw_uncertainty
from insnav.report.series import Clock


def draw_figure(name: str, found: EvaluatedRun) -> Figure:
    """Draw one figure of a run by its name."""
    run, gps = found.run, found.gps
    if name.endswith("_error") and found.errors is not None:
        group, clock = name.removesuffix("_error"), Clock.of(run.solution.time)
        return sample_errors(found.errors, group, clock, outages(run), found.smoothed_errors)
    if name == "error_distribution" and found.errors is not None:
        return draw_distribution(found.errors)
    draw: dict[str, Callable[[], Figure]] = {
        "track": lambda: draw_track(run, gps),
        "height": lambda: draw_height(run, gps),
        "velocity": lambda: draw_velocity(run, gps),
        "attitude": lambda: draw_attitude(run),
        "uncertainty": lambda: draw_uncertainty(run),
        "innovations": lambda: draw_innovations(run),
        "biases": lambda: draw_sensor_errors(run),
    }
    return draw[name]()
