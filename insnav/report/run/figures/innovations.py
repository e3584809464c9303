"""Innovations of the fixes against what the filter expected, and the test that decided on each."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from insnav.errors.gps_gaps import outages
from insnav.report.colours import BLACK, BLUE, SKY, VERMILLION
from insnav.report.series import Clock, thinned
from insnav.report.style import (
    band,
    legend_above,
    shade,
    stacked,
)
from insnav.types import BoolArray, EventKind, FloatArray, Run

_CHI2_95 = 7.815  # 95 % point of chi-square with 3 degrees of freedom
_POSITION_GATE = (EventKind.GATE_POSITION, EventKind.DEWEIGHTED_POSITION)
_VELOCITY_GATE = (EventKind.GATE_VELOCITY, EventKind.DEWEIGHTED_VELOCITY)


def draw_innovations(run: Run) -> Figure:
    """Draw the innovations of position and velocity in their ±3 sd, and the NIS against its gate."""
    fixes = run.innovations
    groups = [
        (first, name, unit, used, nis, gate)
        for first, name, unit, used, nis, gate in (
            (0, "position", "m", fixes.used_position, fixes.nis_position, _POSITION_GATE),
            (3, "velocity", "m/s", fixes.used_velocity, fixes.nis_velocity, _VELOCITY_GATE),
        )
        if np.isfinite(fixes.innovation[:, first : first + 3]).any()
    ]
    clock = Clock.of(run.solution.time)
    spans = outages(run)
    shares = ", ".join(f"{name} {int(used.sum())} of {_processed(run, first)}" for first, name, _, used, _, _ in groups)
    figure, panels = stacked(
        4, "Innovations: measured minus predicted", f"accepted: {shares}", columns=len(groups), height=8.2
    )
    for column, (first, name, unit, used, nis, gate) in enumerate(groups):
        for axis, direction in enumerate(("north", "east", "down")):
            axes = panels[axis][column]
            shade(axes, clock, spans)
            _innovation(axes, clock(fixes.time), fixes.innovation[:, first + axis], fixes.sd[:, first + axis], used)
            axes.set_ylabel(f"{direction} [{unit}]")
        _nis(panels[3][column], clock(fixes.time), nis, used, _gates(run, gate))
        shade(panels[3][column], clock, spans)
        panels[0][column].set_title(name, fontweight="bold")
        panels[3][column].set_xlabel(clock.label)
    legend_above(*reversed(panels[0]), *panels[1], lift=1.1)
    legend_above(*reversed(panels[3]))
    return figure


def _processed(run: Run, first: int) -> int:
    return int(np.isfinite(run.innovations.innovation[:, first : first + 3]).any(axis=1).sum())


def _gates(run: Run, kinds: tuple[EventKind, ...]) -> list[float]:
    """Limits of the gates that rejected or de-weighted."""
    return sorted({e.limit for e in run.events if e.kind in kinds and np.isfinite(e.limit)})


def _innovation(axes: Axes, time: FloatArray, value: FloatArray, sd: FloatArray, used: BoolArray) -> None:
    known = np.isfinite(value)
    used, refused = known & used, known & ~used
    expected = 3.0 * sd[used] if used.any() else 3.0 * sd[known]
    limit = 1.1 * max(
        float(np.max(np.abs(value[used]), initial=0.0)),
        float(np.percentile(expected, 98.0)) if expected.size else 0.0,
        1e-9,
    )
    band(axes, time[known], np.zeros(int(known.sum())), 3.0 * sd[known], SKY, "±3 sd")
    axes.plot(*thinned(time[used], value[used]), ".", color=BLUE, markersize=2.5, label="accepted")
    if refused.any():
        inside = refused & (np.abs(value) <= limit)
        beyond = refused & ~inside
        axes.plot(time[inside], value[inside], "x", color=VERMILLION, markersize=5.0, label="rejected")
        for sign, marker in ((1.0, "^"), (-1.0, "v")):
            rows = beyond & (sign * value > 0.0)
            if not rows.any():
                continue
            axes.plot(
                time[rows],
                np.full(int(rows.sum()), sign * limit),
                marker,
                color=VERMILLION,
                markersize=5.0,
                clip_on=False,
                label="rejected, off the scale",
            )
    axes.set_ylim(-limit, limit)


def _nis(axes: Axes, time: FloatArray, nis: FloatArray, used: BoolArray, gates: list[float]) -> None:
    known = np.isfinite(nis) & (nis > 0.0)
    kept, refused = known & used, known & ~used
    weakened = kept & (nis > min(gates, default=np.inf))
    whole = kept & ~weakened
    axes.plot(*thinned(time[whole], nis[whole]), ".", color=BLUE, markersize=2.5)
    axes.plot(time[refused], nis[refused], "x", color=VERMILLION, markersize=5.0)
    if weakened.any():
        axes.plot(
            time[weakened],
            nis[weakened],
            "o",
            markersize=4.0,
            markerfacecolor="none",
            markeredgecolor=BLUE,
            label="accepted, de-weighted",
        )
    axes.axhline(_CHI2_95, color=BLACK, linewidth=0.9, linestyle=":", label=f"95 % ({_CHI2_95:.1f})")
    for number, gate in enumerate(gates):
        axes.axhline(
            gate,
            color=VERMILLION,
            linewidth=1.0,
            linestyle="--",
            label=f"gate ({gate:.1f})" if number == 0 else None,
        )
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(1e-2, max(100.0, 2.0 * float(np.max(nis[known], initial=0.0))))
    axes.set_ylabel("NIS, 3 dof [-]")
