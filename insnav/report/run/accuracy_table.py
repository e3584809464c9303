"""The accuracy table of summary and page: all, static and moving epochs side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from insnav.report.numbers import label, number

PARTS = ("all", "static", "moving")
STATISTICS = (("rms", "RMS"), ("p95", "95 %"), ("max", "max"))
_ROWS = (
    "horizontal_m",
    "north_m",
    "east_m",
    "down_m",
    "velocity_horizontal_m_s",
    "velocity_down_m_s",
    "roll_deg",
    "pitch_deg",
    "heading_deg",
)


def accuracy_rows(accuracy: Mapping[str, Any]) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Lay out the accuracy facts as a table.

    Parameters
    ----------
    accuracy : mapping
        Value of ``accuracy`` in the facts of a run.

    Returns
    -------
    parts : list of str
        The parts of the run that occur, of ``all``, ``static``, ``moving``.
    rows : list of (str, list of str)
        Quantity with unit, and RMS, 95 % and largest error of each part in turn.
    """
    found = [part for part in PARTS if accuracy.get(part)]
    if len(found) == 2:  # the run is all static or all moving
        found = ["all"]
    rows = []
    for key in _ROWS:
        if accuracy["all"].get(key) is None:
            continue
        cells = []
        for part in found:
            figures = accuracy[part].get(key) or {}
            cells += [number(figures.get(name)) for name, _ in STATISTICS]
        rows.append((label(key), cells))
    return found, rows
