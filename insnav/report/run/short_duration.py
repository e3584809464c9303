"""Facts, lines and table of the short-duration mechanization beside the full one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insnav.errors.short_duration_errors import ShortWindow, size_at
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.terminal import table_text
from insnav.types import FloatArray

TIMES = (10.0, 30.0, 60.0)  # since the start of a window [s]
_ROWS = (
    ("position", "position_m"),
    ("dropped", "position_by_dropped_terms_m"),
    ("rest", "position_by_euler_m"),
    ("velocity", "velocity_m_s"),
    ("untilted", "position_if_dropped_from_attitude_too_m"),
)


def short_facts(windows: Sequence[ShortWindow]) -> dict[str, Any]:
    """Gather the figures, JSON-ready: RMS and largest horizontal difference after some times.

    Parameters
    ----------
    windows : sequence of ShortWindow
    """
    facts: dict[str, Any] = {"windows": len(windows), "mean_speed_m_s": float(np.mean([w.speed for w in windows]))}
    for time in TIMES:
        at: dict[str, Any] = {}
        for name, key in _ROWS:
            size = size_at(windows, name, time)
            at[key] = {"rms": float(np.sqrt(np.mean(size**2))), "max": float(size.max())}
        facts[f"after_{time:g}_s"] = at
    ready: dict[str, Any] = json_ready(facts)
    return ready


def short_text(facts: Mapping[str, Any]) -> str:
    """Write the figures for the terminal.

    Parameters
    ----------
    facts : mapping
        From `short_facts`.
    """
    rows = []
    for time in TIMES:
        at = facts[f"after_{time:g}_s"]
        rows.append((f"{time:g}", *(f"{at[key]['rms']:.3f} / {at[key]['max']:.3f}" for _, key in _ROWS)))
    columns = (
        "after [s]",
        "position [m]",
        "by dropped terms [m]",
        "by Euler's rule [m]",
        "velocity [m/s]",
        "attitude too [m]",
    )
    return table_text(
        Table(
            f"Short-duration mechanization minus the full one, {facts['windows']} windows, horizontal, RMS / largest",
            columns,
            tuple(rows),
            "Earth and transport rate dropped from the velocity; last column: position if from the attitude as well",
        )
    )


def short_columns(windows: Sequence[ShortWindow]) -> dict[str, FloatArray]:
    """Columns of ``short.csv``: time, and every difference of every window.

    Parameters
    ----------
    windows : sequence of ShortWindow
    """
    columns = {
        "time_s": np.round(np.concatenate([w.start + w.elapsed for w in windows]), 9),
        "window_start_s": np.concatenate([np.full(len(w.elapsed), w.start) for w in windows]),
    }
    for name, unit in (("position", "m"), ("velocity", "m_s"), ("dropped", "m"), ("untilted", "m")):
        values = np.concatenate([getattr(w, name) for w in windows])
        columns |= {f"{name}_{axis}_{unit}": np.round(values[:, i], 6) + 0.0 for i, axis in enumerate("ned")}
    return columns
