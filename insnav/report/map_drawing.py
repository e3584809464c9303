"""Maps in local metres: what all tracks seen from above have in common."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.report.colours import BLACK, GREEN
from insnav.report.numbers import distance_text
from insnav.report.style import blank
from insnav.types import FloatArray

_NARROWEST_M = 4.0  # a vehicle at rest needs a map too
_WIDTH = 7.35  # of the map [inch]


def map_figure(
    east: FloatArray, north: FloatArray, title: str, note: str, *, beside: float = 0.0
) -> tuple[Figure, Axes]:
    """Start a map that holds some points; `finish_map` ends it.

    `east`, `north` (n,): what it must hold [m]; `beside`: room to the right of it, as for a bar of colours [inch].
    """
    x_limits, y_limits = map_limits(east, north)
    height = _WIDTH * (y_limits[1] - y_limits[0]) / (x_limits[1] - x_limits[0])
    width = _WIDTH + 1.05 + beside
    figure = blank(width, height + 1.85, title, note)
    figure.subplots_adjust(bottom=0.95 / (height + 1.85), right=1.0 - (0.2 + beside) / width)
    axes = figure.subplots()
    axes.set_xlim(*x_limits)
    axes.set_ylim(*y_limits)
    return figure, axes


def finish_map(axes: Axes, track: FloatArray) -> None:
    """Mark start and end of a track, scale and north, name the axes and put the legend below.

    `track` (n, 2): North and east of the start [m].
    """
    # many a drive ends where it began: the start is the larger mark, so that both are seen
    (north, east), (last_north, last_east) = track[0], track[-1]
    axes.plot(east, north, "^", color=GREEN, markersize=13.0, markeredgecolor="white", label="start", zorder=4)
    axes.plot(last_east, last_north, "s", color=BLACK, markersize=5.0, markeredgecolor="white", label="end", zorder=4)
    scale_bar(axes)
    north_arrow(axes)
    axes.set_aspect("equal")
    axes.set_xlabel("East of start [m]")
    axes.set_ylabel("North of start [m]")
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    below = -0.45 / (_WIDTH * (high - low) / (right - left))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, below), ncols=6, handlelength=1.4, columnspacing=1.2)


def map_limits(east: FloatArray, north: FloatArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits east and north: the track and a margin, no narrower than fits a page."""
    width, height = (max(float(np.ptp(v)), _NARROWEST_M) for v in (east, north))
    margin = 0.07 * max(width, height)
    width, height = width + 2.0 * margin, height + 2.0 * margin
    half_east, half_north = 0.5 * max(width, 0.95 * height), 0.5 * max(height, 0.4 * width)
    middle_east, middle_north = (0.5 * (float(v.min()) + float(v.max())) for v in (east, north))
    return (
        (middle_east - half_east, middle_east + half_east),
        (middle_north - half_north, middle_north + half_north),
    )


def scale_bar(axes: Axes) -> None:
    """Draw a bar of a round length, about a fifth of the width, in the lower left corner."""
    (left, right), (low, _) = axes.get_xlim(), axes.get_ylim()
    longest = 0.25 * (right - left)
    power = 10.0 ** np.floor(np.log10(longest))
    length = float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest))
    x, y = left + 0.04 * (right - left), low + 0.03 * (right - left)
    tick = 0.008 * (right - left)
    axes.plot(
        [x, x, x, x + length, x + length, x + length],
        [y + tick, y - tick, y, y, y + tick, y - tick],
        color=BLACK,
        linewidth=1.6,
        zorder=5,
    )
    axes.text(x + 0.5 * length, y + 1.3 * tick, distance_text(length), ha="center", va="bottom", fontsize=8.5)


def north_arrow(axes: Axes) -> None:
    """Mark north in the upper right corner."""
    axes.annotate(
        "N",
        xy=(0.965, 0.985),
        xytext=(0.0, -42.0),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=11.0,
        fontweight="bold",
        arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.6},
    )
