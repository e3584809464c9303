"""Quantities and table of the short-duration mechanization compared with the full one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from insnav.errors.short_duration_errors import LENGTH, ShortWindow, size_at
from insnav.quantity import Quantity
from insnav.report.colours import BLACK, BLUE, GREY, ORANGE, VERMILLION
from insnav.report.page import Section, drawn, one_each
from insnav.report.panels import Curve, Panel
from insnav.sample_statistics import rms
from insnav.types import FloatArray

TIMES = (10.0, 30.0, 60.0)  # since the start of a window [s]
_ROWS = (
    ("position", "position", "m", "position"),
    ("dropped", "position_by_dropped_terms", "m", "by dropped terms"),
    ("rest", "position_by_euler", "m", "by Euler's rule"),
    ("velocity", "velocity", "m/s", "velocity"),
    ("untilted", "position_if_dropped_from_attitude_too", "m", "attitude too"),
)


def short_section(windows: Sequence[ShortWindow]) -> Section:
    """Build RMS and largest horizontal difference after some times."""
    after = {}
    for time in TIMES:
        sizes = {key: size_at(windows, name, time) for name, key, _, _ in _ROWS}
        after[f"after_{time:g}_s"] = tuple(
            Quantity(key, {"rms": rms(sizes[key]), "max": float(sizes[key].max())}, unit, meaning=label)
            for _, key, unit, label in _ROWS
        )
    title = "Short-duration mechanization minus the full one, horizontal"
    shape = f"{len(windows)} windows of {LENGTH:g} s, free-inertial from the same state"
    caption = "Short-duration mechanization minus the full one"
    drawing = drawn("short_mechanization", caption, short_panels(windows), shape)
    note = "Earth and transport rate dropped from the velocity; last columns: position if from the attitude as well"
    return Section(
        "short_mechanization",
        "Short-duration mechanization",
        (Quantity("windows", len(windows)), Quantity("mean_speed", float(np.mean([w.speed for w in windows])), "m/s")),
        parts=(one_each("", title, after, "time", note), drawing),
    )


def short_panels(windows: Sequence[ShortWindow]) -> Iterator[Panel]:
    """Draw the difference of short and full form in every window, and the share of the dropped terms."""
    elapsed = windows[0].elapsed

    def sizes(name: str) -> FloatArray:
        each = (np.hypot(*getattr(window, name)[:, :2].T) for window in windows)
        return np.array([np.interp(elapsed, w.elapsed, size) for w, size in zip(windows, each, strict=True)])

    def mean(name: str) -> FloatArray:
        return np.asarray(np.sqrt(np.mean(sizes(name) ** 2, axis=0)))

    for title, name, label in (
        ("Position", "position", "horizontal [m]"),
        ("Velocity", "velocity", "horizontal [m/s]"),
        ("Position, if Earth and transport rate are dropped from the attitude too", "untilted", "horizontal [m]"),
    ):
        size = sizes(name)
        curves = [Curve("each window", elapsed, each, GREY, "thin") for each in size]
        curves += [Curve("RMS", elapsed, mean(name), BLUE), Curve("largest", elapsed, size.max(axis=0), ORANGE)]
        if name == "position":
            curves.append(Curve("RMS by the dropped terms", elapsed, mean("dropped"), BLACK, "dashed"))
            curves.append(Curve("RMS by Euler's rule", elapsed, mean("rest"), VERMILLION, "dashed"))
        across = "time since the start of the window [s]"
        yield Panel(f"short_{name}", f"{title}, short minus full", label, across, tuple(curves), "short")


def short_columns(windows: Sequence[ShortWindow]) -> dict[str, FloatArray]:
    """Return the columns of ``short.csv``: time, and every difference of every window."""
    columns = {
        "time_s": np.round(np.concatenate([w.start + w.elapsed for w in windows]), 9),
        "window_start_s": np.concatenate([np.full(len(w.elapsed), w.start) for w in windows]),
    }
    for name, unit in (("position", "m"), ("velocity", "m_s"), ("dropped", "m"), ("untilted", "m")):
        values = np.concatenate([getattr(w, name) for w in windows])
        columns |= {f"{name}_{axis}_{unit}": np.round(values[:, i], 6) + 0.0 for i, axis in enumerate("ned")}
    return columns
