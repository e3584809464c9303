"""Quantities and table of the short-duration mechanization compared with the full one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from insnav.errors.short_duration_errors import ShortWindow, size_at
from insnav.quantity import Quantity
from insnav.report.page import FigureSpec, Section, one_each
from insnav.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TIMES = (10.0, 30.0, 60.0)  # since the start of a window [s]
_ROWS = (
    ("position", "position", "m", "position"),
    ("dropped", "position_by_dropped_terms", "m", "by dropped terms"),
    ("rest", "position_by_euler", "m", "by Euler's rule"),
    ("velocity", "velocity", "m/s", "velocity"),
    ("untilted", "position_if_dropped_from_attitude_too", "m", "attitude too"),
)


def short_section(windows: Sequence[ShortWindow]) -> Section:
    """Give RMS and largest horizontal difference after some times."""
    after = {}
    for time in TIMES:
        sizes = {key: size_at(windows, name, time) for name, key, _, _ in _ROWS}
        after[f"after_{time:g}_s"] = tuple(
            Quantity(
                key,
                {"rms": float(np.sqrt(np.mean(sizes[key] ** 2))), "max": float(sizes[key].max())},
                unit,
                meaning=label,
            )
            for _, key, unit, label in _ROWS
        )
    title = "Short-duration mechanization minus the full one, horizontal"
    note = "Earth and transport rate dropped from the velocity; last columns: position if from the attitude as well"
    return Section(
        "short_mechanization",
        "Short-duration mechanization",
        (
            Quantity("windows", len(windows)),
            Quantity("mean_speed", float(np.mean([w.speed for w in windows])), "m/s"),
        ),
        parts=(one_each("", title, after, "time", note),),
        figures=(
            FigureSpec(
                "short_mechanization",
                "Short-duration mechanization against the full one",
                partial(_draw, windows),
            ),
        ),
    )


def _draw(windows: Sequence[ShortWindow]) -> Figure:
    from insnav.report.run.figures.short_duration import draw_short  # matplotlib is imported only where it draws

    return draw_short(windows)


def short_columns(windows: Sequence[ShortWindow]) -> dict[str, FloatArray]:
    """Columns of ``short.csv``: time, and every difference of every window."""
    columns = {
        "time_s": np.round(np.concatenate([w.start + w.elapsed for w in windows]), 9),
        "window_start_s": np.concatenate([np.full(len(w.elapsed), w.start) for w in windows]),
    }
    for name, unit in (("position", "m"), ("velocity", "m_s"), ("dropped", "m"), ("untilted", "m")):
        values = np.concatenate([getattr(w, name) for w in windows])
        columns |= {f"{name}_{axis}_{unit}": np.round(values[:, i], 6) + 0.0 for i, axis in enumerate("ned")}
    return columns
