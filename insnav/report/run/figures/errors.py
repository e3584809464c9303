"""Errors against a reference: over time with their ±3 sd, and how the horizontal ones are distributed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.errors.metrics import MOVING_M_S, TrajectoryErrors
from insnav.report.colours import BLACK, BLUE, GREEN, ORANGE, SKY, VERMILLION
from insnav.report.series import Clock, broken_at_gaps
from insnav.report.style import (
    band,
    legend_above,
    line,
    shade,
    stacked,
)
from insnav.sample_statistics import rms
from insnav.types import BoolArray, FloatArray

_AXES = {
    "position": ("north [m]", "east [m]", "down [m]"),
    "velocity": ("north [m/s]", "east [m/s]", "down [m/s]"),
    "attitude": ("roll [deg]", "pitch [deg]", "heading [deg]"),
}


def sample_errors(
    errors: TrajectoryErrors,
    group: str,
    clock: Clock,
    spans: Sequence[tuple[float, float]],
    smoothed: TrajectoryErrors | None = None,
) -> Figure:
    """Draw three errors over time, and the ±3 sd that the solution states.

    `group` {"position", "velocity", "attitude"}; `spans`: times without fixes, to shade [s]; `smoothed`: errors of the
    smoothed solution, drawn over those of the filter.
    """
    unit = 180.0 / np.pi if group == "attitude" else 1.0
    value: FloatArray = unit * getattr(errors, group)
    first = 3 * list(_AXES).index(group)
    half = np.full_like(value, np.nan) if errors.sd is None else 3.0 * unit * errors.sd[:, first : first + 3]
    figure, panels = stacked(3, f"{group.capitalize()} error: solution minus reference", _inside(value, half))
    time, columns = broken_at_gaps(clock(errors.time), np.column_stack((value, half)))
    for axis, ((axes,), label) in enumerate(zip(panels, _AXES[group], strict=True)):
        shade(axes, clock, spans)
        zero = np.where(np.isfinite(columns[:, axis]), 0.0, np.nan)
        band(axes, time, zero, columns[:, 3 + axis], SKY, "±3 sd")
        line(axes, time, columns[:, axis], BLUE, "error" if smoothed is None else "filtered")
        if smoothed is not None:
            _smoothed(axes, clock, smoothed, unit * getattr(smoothed, group)[:, axis], first + axis, unit)
        known = value[np.isfinite(value[:, axis]), axis]
        promised = half[np.isfinite(half[:, axis]), axis]
        limit = 1.15 * max(
            float(np.max(np.abs(known), initial=0.0)),
            float(np.percentile(promised, 95.0)) if promised.size else 0.0,
        )
        axes.set_ylim(-(limit or 1.0), limit or 1.0)
        axes.set_ylabel(label)
        if known.size:
            mean, unit_name = float(np.mean(known)), label[label.index("[") + 1 : -1]
            after = "" if smoothed is None else f"; smoothed RMS {rms(unit * getattr(smoothed, group)[:, axis]):.3g}"
            axes.set_title(
                f"mean {mean:.3g}, RMS {rms(known):.3g}{after} {unit_name}",
                fontsize=8.0,
                color="#444444",
            )
    legend_above(panels[0][0], lift=1.0 if smoothed is None else 1.09)  # more entries than fit beside the title
    panels[-1][0].set_xlabel(clock.label)
    return figure


def _smoothed(
    axes: Axes, clock: Clock, smoothed: TrajectoryErrors, value: FloatArray, column: int, unit: float
) -> None:
    half = np.full_like(value, np.nan) if smoothed.sd is None else 3.0 * unit * smoothed.sd[:, column]
    time, columns = broken_at_gaps(clock(smoothed.time), np.column_stack((value, half)))
    line(axes, time, columns[:, 0], VERMILLION, "smoothed", linewidth=0.9)
    for sign, label in ((1.0, "±3 sd, smoothed"), (-1.0, "")):
        line(axes, time, sign * columns[:, 1], VERMILLION, label, linewidth=0.8, linestyle=":")


def draw_distribution(errors: TrajectoryErrors) -> Figure:
    """Draw the share of horizontal errors below a given one, with CEP50 and R95."""
    horizontal = errors.horizontal
    figure, ((axes,),) = stacked(
        1,
        "Distribution of the horizontal error",
        f"{len(horizontal)} epochs of the reference, largest {np.max(horizontal):.3g} m; "
        f"moving: faster than {MOVING_M_S:g} m/s",
        height=4.2,
    )
    every = np.ones(len(horizontal), dtype=np.bool_)
    parts: list[tuple[str, BoolArray, str, float]] = [("all", every, BLUE, 2.0)]
    if errors.moving.any() and not errors.moving.all():
        parts += [("static", ~errors.moving, GREEN, 1.1), ("moving", errors.moving, ORANGE, 1.1)]
    for name, rows, colour, width in parts:
        ordered = np.quantile(horizontal[rows], np.linspace(0.0, 1.0, 501))
        axes.plot(ordered, np.linspace(0.0, 100.0, 501), color=colour, linewidth=width, label=name)
    largest, r95 = float(np.max(horizontal)), float(np.percentile(horizontal, 95.0))
    for name, share in (("CEP50", 50.0), ("R95", 95.0)):
        radius = float(np.percentile(horizontal, share))
        axes.plot([0.0, radius, radius], [share, share, 0.0], color=BLACK, linewidth=0.9, linestyle="--")
        axes.plot(radius, share, "o", color=BLACK, markersize=4.0)
        axes.annotate(
            f"{name} {radius:.3g} m",
            (radius, share),
            xytext=(9.0, -6.0),
            textcoords="offset points",
            ha="left",
            va="top",
            fontsize=9.0,
            fontweight="bold",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
        )
    axes.set_xlim(0.0, min(1.04 * largest, 3.0 * r95) or 1.0)  # a few outliers must not hide the rest
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("horizontal error [m]")
    axes.set_ylabel("share of epochs below [%]")
    axes.legend(loc="lower right")
    return figure


def _inside(value: FloatArray, half: FloatArray) -> str:
    known = np.isfinite(value) & np.isfinite(half)
    if not known.any():
        return "the solution states no standard deviation"
    share = 100.0 * float(np.mean(np.abs(value[known]) <= half[known]))
    return f"inside ±3 sd: {share:.1f} % (99.7 % if normal)"
