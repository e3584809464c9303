"""Facts and page of the errors in GPS outages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insnav.errors.outage.gnss_outage import Outage
from insnav.errors.outage.statistics import Growth
from insnav.report.numbers import number
from insnav.report.outage.figures import draw_outages
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG

_ROWS = (
    ("horizontal", "horizontal [m]", 1.0),
    ("vertical", "vertical [m]", 1.0),
    ("velocity", "velocity [m/s]", 1.0),
    ("heading", "heading [deg]", DEG),
    ("smoothed horizontal", "smoothed, horizontal [m]", 1.0),
    ("smoothed vertical", "smoothed, vertical [m]", 1.0),
)
_KEYS = {
    "horizontal": "horizontal_m",
    "vertical": "vertical_m",
    "velocity": "velocity_m_s",
    "heading": "heading_deg",
    "smoothed horizontal": "smoothed_horizontal_m",
    "smoothed vertical": "smoothed_vertical_m",
}


def outage_facts(
    sums: Sequence[Growth], reading: Mapping[str, Any], configuration: Mapping[str, Any], notes: Sequence[str]
) -> dict[str, Any]:
    """Gather the figures, JSON-ready, units in the keys.

    Parameters
    ----------
    sums : sequence of Growth
    reading : mapping
        What was understood of each file.
    configuration : mapping
        Options in force.
    notes : sequence of str
        What was assumed and found.
    """
    windows = [
        {
            "length_s": each.length,
            "windows": each.count,
            "inside_3_sd": each.inside_at_end,
            **{
                _KEYS[name]: dict(
                    zip(("rms", "p95", "max", "predicted"), (v / unit for v in _figures(each, name)), strict=True)
                )
                for name, _, unit in _ROWS
            },
        }
        for each in sums
    ]
    ready: dict[str, Any] = json_ready(
        {"configuration": configuration, "input": reading, "outages": windows, "notes": list(notes)}
    )
    return ready


def outage_sheet(
    windows: Sequence[Outage], sums: Sequence[Growth], judge: str, name: str, notes: Sequence[str]
) -> Sheet:
    """Put tables and figure on one page.

    Parameters
    ----------
    windows : sequence of Outage
    sums : sequence of Growth
    judge : str
        What the error is against.
    name : str
        The drive.
    notes : sequence of str
        What was assumed and found.
    """
    tables = [
        Table(
            title,
            ("without GPS [s]", "windows", "RMS", "95 %", "max", "predicted sd"),
            tuple((f"{each.length:g}", str(each.count), *_cells(_figures(each, key), unit)) for each in sums),
        )
        for key, title, unit in _ROWS
        if any(np.isfinite(_figures(each, key)[0]) for each in sums)
    ]
    inside = ", ".join(f"{100.0 * each.inside_at_end:.0f} % of {each.length:g} s" for each in sums)
    with drawing():
        figure = draw_outages(windows, sums, judge)
    return Sheet(
        f"Error without GPS: {name}",
        (
            f"Errors are against {judge}, at the end of each window; the smoothed error is the largest in the window.",
            f"Inside 3 sd (north, east, down): {inside}.",
        ),
        tuple(tables),
        (Picture("outages", figure, "Error over the time without GPS"),),
        (
            "Each window starts from the filter as it was at its first epoch, with all fixes before and none within.",
            "From the RMS the variance that the judge itself states is taken off, '< judge' if nothing is left; "
            "quantiles and largest are as they are, and against noisy fixes the largest of many is mostly their noise.",
            "The heading is against that of the drive smoothed with all fixes, so it is no independent figure.",
        ),
        tuple(notes),
    )


def _figures(found: Growth, component: str) -> tuple[float, ...]:
    """RMS, 95 %, largest, predicted."""
    column = found.column(component)
    return tuple(float(each[-1, column]) for each in (found.rms, found.p95, found.largest, found.predicted))


def _cells(values: tuple[float, ...], unit: float) -> list[str]:
    """RMS, 95 %, largest, predicted."""
    return ["< judge" if values[0] == 0.0 else number(values[0] / unit), *(number(v / unit) for v in values[1:])]
