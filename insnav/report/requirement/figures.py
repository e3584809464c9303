"""Figures of a requirement."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.requirement.parts import Candidate
from insnav.errors.requirement.study import RequirementStudy
from insnav.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from insnav.report.numbers import number
from insnav.report.panels import Curve, Panel
from insnav.report.style import blank, logarithmic
from insnav.units import UNITS

GRADES = {"consumer": VERMILLION, "automotive": ORANGE, "industrial": BLUE, "tactical": GREEN, "navigation": PURPLE}
SMALLEST = 0.01  # end of the error axis [m]


def draw_allocation(study: RequirementStudy) -> Figure:
    """Draw what each error may be in the set, as a part of what it may be alone."""
    shares = [share for share in study.allocation.shares if np.isfinite(share.alone)]
    figure = blank(8.3, 1.3 + 0.28 * len(shares), f"Allocation: {study.required.text}", study.motion)
    axes = figure.subplots()
    figure.subplots_adjust(left=0.2)  # the names of the errors
    place = np.arange(len(shares))
    part = np.array([share.size / share.alone for share in shares])
    colours = [ORANGE if share.given else GREY if share.capped else BLUE for share in shares]
    axes.barh(place, np.minimum(part, 1.2), color=colours)
    for y, share, length in zip(range(len(shares)), shares, part, strict=True):
        factor = UNITS[share.unit][1]
        text = f"{number(share.size / factor)} {share.unit}  (alone {number(share.alone / factor)})"
        axes.text(min(float(length), 1.2) + 0.01, y, text, va="center", fontsize=7)
    axes.set_yticks(place, [share.family for share in shares])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.6)
    axes.axvline(1.0, color=GREY, linewidth=0.8, linestyle="--")
    axes.set_xlabel("size in the set / size that meets the limit alone (orange: given, grey: hardly acts)")
    return figure


def draw_parts(study: RequirementStudy) -> Figure:
    """Draw the error of every part over time, the IMU alone and with the NHC, with the limit."""
    required = study.required
    figure = blank(9.5, 5.2, f"Real IMUs: {required.text}", outages_text(study))
    for axes, (title, kind) in zip(figure.subplots(1, 2, sharey=True), _kinds(), strict=True):
        for each in study.candidates[::-1]:
            curve = np.maximum(getattr(each, kind).curve, SMALLEST)
            axes.plot(study.time, curve, color=GRADES[each.grade], linewidth=0.8, alpha=0.8)
        axes.axhline(required.error, color=BLACK, linewidth=1.2, linestyle="--")
        axes.axvline(required.after, color=BLACK, linewidth=0.8, linestyle=":")
        axes.plot(required.after, required.error, "o", color=BLACK, markersize=5)
        axes.set_yscale("log")
        logarithmic(axes.yaxis)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("time without GPS [s]")
        axes.set_xlim(0.0, float(study.time[-1]))
    figure.axes[0].set_ylabel(f"{required.component} error, {100 * required.probability:g} % [m]")
    present = {each.grade for each in study.candidates}
    for name, colour in GRADES.items():
        if name in present:
            figure.axes[1].plot([], [], color=colour, label=name)
    figure.axes[1].legend(fontsize=7, loc="lower right")
    return figure


def outages_text(study: RequirementStudy) -> str:
    """How much GPS there was before the outages."""
    first, last = study.begins[0], study.begins[-1]
    return (
        f"after {first} s of GPS"
        if first == last
        else f"mean of {len(study.begins)} outages after {first} to {last} s of GPS"
    )


def _kinds() -> tuple[tuple[str, str], tuple[str, str]]:
    return ("the IMU alone", "alone"), ("with non-holonomic constraint (NHC)", "nhc")


def part_panels(study: RequirementStudy) -> tuple[Panel, ...]:
    """The same, interactive: one line a part."""
    required = study.required
    return tuple(
        Panel(
            f"parts_{kind}",
            f"Error over time, {title}",
            f"{required.component} error, {100 * required.probability:g} % [m]",
            "time without GPS [s]",
            tuple(_curve(study, each, kind) for each in study.candidates),
            link="parts",
            log_y=True,
            levels=((required.error, "limit"),),
            height=330,
        )
        for title, kind in _kinds()
    )


def _curve(study: RequirementStudy, each: Candidate, kind: str) -> Curve:
    curve = np.maximum(getattr(each, kind).curve, SMALLEST)
    return Curve(f"{each.name} ({each.grade})", study.time, curve, GRADES[each.grade])
