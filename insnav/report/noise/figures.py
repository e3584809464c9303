"""Allan deviations on double logarithmic axes, with the lines their slopes are read from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from insnav.lab.noise.allan import AllanDeviation
from insnav.lab.noise.noise_model import NoiseModel
from insnav.report.colours import AXIS_COLOURS, GREY
from insnav.report.style import (
    blank,
    legend_above,
)
from insnav.types import FloatArray
from insnav.units import DEG_PER_H, UG

_GUIDES = ((-1.0, "Q  −1"), (-0.5, "N  −½"), (0.0, "B  0"), (0.5, "K  +½"), (1.0, "R  +1"))
_TALL = 2.4  # the lines reach up and down by this factor at most
_SENSORS = (("Allan deviation of the gyros [deg/h]", DEG_PER_H), ("Allan deviation of the accelerometers [ug]", UG))


def draw_allan(allan: AllanDeviation, models: Sequence[NoiseModel | None], title: str) -> Figure:
    """Draw the deviations of six axes with 95 % intervals, their models, and guides of every slope.

    `models`: one for each; None is not drawn.
    """
    note = "points: overlapping Allan deviation with 95 % intervals; lines: fitted model; grey: slopes of Q, N, B, K, R"
    figure = blank(8.4, 9.4, title, note)
    panels = figure.subplots(2, 1, sharex=True, gridspec_kw={"hspace": 0.12})
    for panel, (label, unit), first in zip(panels, _SENSORS, (0, 3), strict=True):
        seen = [i for i in range(first, first + 3) if models[i] is not None]
        for i in seen:
            model = models[i]
            assert model is not None
            _one(panel, allan.tau, allan.deviation[:, i] / unit, model, unit, AXIS_COLOURS[i - first], "xyz"[i - first])
        _finish(panel, label)
        if seen:
            _guides(panel, allan.tau, allan.deviation[:, seen] / unit)
    panels[-1].set_xlabel("averaging time [s]")
    legend_above(panels[0])
    return figure


def _one(
    panel: Axes, tau: FloatArray, deviation: FloatArray, model: NoiseModel, unit: float, colour: str, name: str
) -> None:
    panel.fill_between(tau, model.low / unit, model.high / unit, color=colour, alpha=0.18, linewidth=0.0)
    panel.plot(tau, deviation, ".", markersize=3.5, color=colour, label=name)
    panel.plot(tau, np.sqrt(model.variance) / unit, color=colour, linewidth=1.0)


def _finish(panel: Axes, label: str) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(LogLocator(numticks=20))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0), numticks=20))
        axis.set_minor_formatter(NullFormatter())
    panel.grid(which="minor", linewidth=0.3)
    panel.set_ylabel(label)


def _guides(panel: Axes, tau: FloatArray, deviation: FloatArray) -> None:
    """Short lines of every slope through one point, in the corner that the curves leave free."""
    good = deviation[deviation > 0.0]
    low, high = float(good.min()), float(good.max())
    panel.set_ylim(0.4 * low, 5.0 * high)
    half = (float(tau[-1]) / float(tau[0])) ** 0.1
    x, y = float(tau[-1]) / half, 1.8 * high
    for slope, text in _GUIDES:
        reach = half if slope == 0.0 else min(half, _TALL ** (1.0 / abs(slope)))
        ends = np.array([1.0 / reach, reach])
        panel.plot(x * ends, y * ends**slope, color=GREY, linewidth=0.8)
        panel.annotate(text, (x / reach, y * reach**-slope), fontsize=7, color=GREY, ha="right", va="center")
    panel.xaxis.set_minor_locator(NullLocator())
