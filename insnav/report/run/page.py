"""The report page: one self-contained HTML file with the accuracy, the figures and every fact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from insnav.report.html import data_uri, filled
from insnav.report.run.accuracy_table import STATISTICS, accuracy_rows

_SECTIONS = {
    "input": "What was read",
    "alignment": "Alignment",
    "imu_model": "IMU model",
    "solution": "Solution",
    "fixes": "Fixes",
    "aiding": "Aiding besides fixes",
    "outages": "Outages",
    "sensor_errors": "Estimated sensor errors",
    "smoothed": "Smoothed solution",
    "short_mechanization": "Short-duration mechanization",
    "events": "Events",
    "configuration": "Configuration",
    "versions": "Versions",
}
_CAPTIONS = {
    "track": "Track, with fixes and outages",
    "error_position": "Position error and its ±3 sd",
    "error_velocity": "Velocity error and its ±3 sd",
    "error_attitude": "Attitude error and its ±3 sd",
    "uncertainty": "Standard deviation of the filter and of the smoothed solution",
    "error_distribution": "Distribution of the horizontal error",
    "height": "Height",
    "velocity": "Velocity",
    "attitude": "Attitude",
    "innovations": "Innovations against their gates",
    "biases": "Estimated sensor errors",
    "short_mechanization": "Short-duration mechanization against the full one",
}


def write_page(path: Path, facts: Mapping[str, Any], figures: Sequence[Path], *, title: str) -> Path:
    """Write the report page.

    Parameters
    ----------
    path : Path
        The file, such as ``report.html``.
    facts : mapping
        As `insnav.report.run.quantities.run_facts` makes them.
    figures : sequence of Path
        PNG or SVG files, in the order to show them; they are copied into the page.
    title : str
        Any text.

    Returns
    -------
    Path
        The file written.
    """
    path.write_text(page_html(facts, figures, title=title), encoding="utf-8", newline="\n")
    return path


def page_html(facts: Mapping[str, Any], figures: Sequence[Path], *, title: str) -> str:
    """Make the report page; see `write_page`."""
    accuracy = facts["accuracy"]
    table = accuracy_rows(accuracy) if accuracy and accuracy.get("all") else None
    return filled(
        "report.html.j2",
        title=title,
        facts=facts,
        table=table,
        statistics=[name for _, name in STATISTICS],
        sections=[(heading, facts[key]) for key, heading in _SECTIONS.items() if facts.get(key)],
        figures=[(_CAPTIONS.get(file.stem, file.stem), data_uri(file)) for file in figures],
    )
