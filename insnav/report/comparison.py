"""Runs against one reference as a table of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from insnav.report.numbers import number

# heading -> quantity and statistic
_COLUMNS = (
    ("N m", "north_m", "rms"),
    ("E m", "east_m", "rms"),
    ("D m", "down_m", "rms"),
    ("2D m", "horizontal_m", "rms"),
    ("95 % m", "horizontal_m", "p95"),
    ("max m", "horizontal_m", "max"),
    ("v m/s", "velocity_horizontal_m_s", "rms"),
    ("roll °", "roll_deg", "rms"),
    ("pitch °", "pitch_deg", "rms"),
    ("head °", "heading_deg", "rms"),
)


def comparison_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Lay out the rows of `compare` as text.

    Parameters
    ----------
    rows : sequence of dict

    Returns
    -------
    list of str
        A heading, one line a run, and what the columns are; what the reference does not know is left out.
    """
    columns = [column for column in _COLUMNS if rows[0]["accuracy"][column[1]] is not None]
    names = ["  smoothed" if row["solution"] == "smoothed" else row["run"] for row in rows]
    name = max(len("run"), *map(len, names))
    lines = [f"{'run':<{name}}" + "".join(f"{heading:>9}" for heading, _, _ in columns) + f"{'in 3 sd':>10}"]
    for text, row in zip(names, rows, strict=True):
        cells = "".join(f"{number(row['accuracy'][quantity][figure]):>9}" for _, quantity, figure in columns)
        lines.append(f"{text:<{name}}{cells}{_inside(row['consistency']):>10}")
    return [
        *lines,
        f"{rows[0]['accuracy']['n']} epochs of the reference that every run covers; RMS, and of the",
        "horizontal error also 95 % and largest; in 3 sd: share of position errors inside three stated sd",
    ]


def _inside(consistency: dict[str, Any] | None) -> str:
    """Share of position errors inside 3 sd."""
    position = None if consistency is None else consistency["position"]
    return "–" if position is None else f"{100.0 * position['inside_3_sd']:.1f} %"
