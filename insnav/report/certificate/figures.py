"""Errors of all integrators in parts of the limit, a row for every check."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from insnav.certificate.check import Check
from insnav.report.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.style import (
    blank,
    legend_above,
)

_LEAST, _MOST = 1e-7, 1e7  # parts of the limit; beyond, figures stand at the edge
_ROW = 0.185  # height [inch]
_LABELS = 4.1  # width of the names of the checks [inch]
_STYLES = (
    ("s", ORANGE),
    ("^", GREEN),
    ("x", GREY),
    ("D", PURPLE),
    ("v", SKY),
    ("<", ORANGE),
    (">", GREEN),
    ("P", GREY),
)


def draw_certificate(checks: Sequence[Check]) -> Figure:
    """Draw one row for every check, the figure that counts large, on a logarithmic axis."""
    height = 1.5 + _ROW * len(checks)
    failed = sum(not check.passed for check in checks)
    figure = blank(
        10.0,
        height,
        f"Numerical certificate: {len(checks) - failed} of {len(checks)} checks passed",
        "errors against closed forms and published values, in parts of the limit; filled: insnav as it navigates",
    )
    figure.subplots_adjust(left=_LABELS / 10.0)
    axes = figure.subplots()
    rows = np.arange(len(checks))
    others = dict.fromkeys(name for check in checks for name, _ in check.values[1:])
    parts = np.array([_part(check, check.error) for check in checks])
    passed = np.array([check.passed for check in checks])
    for name, (marker, colour) in zip(others, cycle(_STYLES), strict=False):
        found = [
            (_part(check, dict(check.values)[name]), row)
            for row, check in enumerate(checks)
            if name in dict(check.values)
        ]
        axes.plot(
            *zip(*found, strict=True), marker, color=colour, markersize=6.0, fillstyle="none", label=name, zorder=3
        )
    axes.plot(parts[passed], rows[passed], "o", color=BLUE, markersize=4.5, label="insnav: passed")
    if failed:
        axes.plot(parts[~passed], rows[~passed], "o", color=VERMILLION, markersize=6.5, label="insnav: FAILED")
    axes.axvline(1.0, color=VERMILLION, linewidth=1.2)
    axes.axvspan(_LEAST / 3.0, 1.0, color=GREEN, alpha=0.06, linewidth=0.0)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlim(_LEAST / 3.0, _MOST * 3.0)
    axes.set_ylim(len(checks) - 0.4, -0.6)
    axes.set_yticks(rows, [f"{check.topic}: {check.case}" for check in checks], fontsize=7.0)
    axes.set_xlabel(f"error / limit [-]; at the edges: {_LEAST:g} or less, {_MOST:g} or more")
    legend_above(axes)
    return figure


def _part(check: Check, value: float) -> float:
    """Error in parts of the limit, within the axis; what is no number is as bad as can be."""
    if not np.isfinite(value):
        return _MOST
    if check.limit == 0.0:
        return _LEAST if value <= 0.0 else _MOST
    return float(np.clip(value / check.limit, _LEAST, _MOST))
