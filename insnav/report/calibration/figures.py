"""Residuals of a calibration: what the fitted model leaves, over what was set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from insnav.report.colours import AXIS_COLOURS, GREY
from insnav.report.style import (
    blank,
    legend_above,
    stacked,
)
from insnav.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Series:
    """Points of one panel."""

    label: str  # of the vertical axis, unit in brackets
    # (n,) where, and how far from the model
    setting: FloatArray
    residual: FloatArray
    used: BoolArray  # (n,) whether the fit used it; others are drawn as crosses
    sd: float = 0.0  # standard deviation to draw as a band, zero for none


def draw_residuals(series: Sequence[Series], setting: str, title: str, note: str = "") -> Figure:
    """Draw residuals over what was set, one panel a sensor."""
    figure, panels = stacked(len(series), title, note, height=2.6 + 1.6 * len(series))
    for row, (axes,), item in zip(range(len(series)), panels, series, strict=True):
        colour = AXIS_COLOURS[row % 3]
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        if item.sd > 0.0:
            axes.axhspan(-item.sd, item.sd, color=colour, alpha=0.12, linewidth=0.0, label="± 1 sd of the fit")
        axes.plot(item.setting[item.used], item.residual[item.used], "o", color=colour, markersize=4, label="used")
        if not item.used.all():
            axes.plot(item.setting[~item.used], item.residual[~item.used], "x", color="black", label="left out")
            _keep_used_readable(axes, item)
        axes.set_ylabel(item.label)
        axes.margins(x=0.04)
    legend_above(panels[0][0])
    panels[-1][0].set_xlabel(setting)
    return figure


def _keep_used_readable(axes: Axes, item: Series) -> None:
    """Saturated points may lie a hundred sd off: a symmetric logarithmic scale shows both."""
    inner = float(np.abs(item.residual[item.used]).max())
    outer = float(np.abs(item.residual[~item.used]).max())
    if outer > 5.0 * inner > 0.0:
        axes.set_yscale("symlog", linthresh=2.0 * inner)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def draw_line(
    panels: Sequence[tuple[str, FloatArray, FloatArray, float]], across: Sequence[str], title: str, note: str
) -> Figure:
    """Draw points and the lines through the origin fitted to them, residuals below.

    `panels` (n,): label of the vertical axis, abscissa, ordinate, and slope.
    """
    figure = blank(9.6, 5.2, title, note)
    grid = {"wspace": 0.3, "hspace": 0.12, "height_ratios": (2.2, 1.0)}
    every = figure.subplots(2, len(panels), squeeze=False, sharex="col", gridspec_kw=grid)
    for column, (name, x, y, slope) in enumerate(panels):
        upper, lower = every[0, column], every[1, column]
        ends = np.array([0.0, 1.05 * float(np.max(x))])
        colour = AXIS_COLOURS[column % 3]
        upper.plot(ends, slope * ends, color=GREY, label="fitted")
        upper.plot(x, y, "o", color=colour, markersize=5, label="measured")
        upper.set_ylabel(name)
        upper.legend(loc="upper left")
        lower.axhline(0.0, color=GREY, linewidth=0.8)
        lower.plot(x, y - slope * x, "o", color=colour, markersize=5)
        lower.set_ylabel(f"residual {name[name.index('[') :]}")
        lower.set_xlabel(across[column])
        lower.margins(y=0.2)
    return figure
