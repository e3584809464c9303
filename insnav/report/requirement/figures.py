"""Figures of a requirement."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.errors.requirement.study import RequirementStudy
from insnav.report.colours import BLUE, GREY, ORANGE
from insnav.report.numbers import number
from insnav.report.style import blank
from insnav.units import UNITS


def draw_allocation(study: RequirementStudy) -> Figure:
    """Draw what each error may be in the set, as a part of what it may be alone."""
    shares = [share for share in study.allocation.shares if np.isfinite(share.alone)]
    figure = blank(8.3, 1.3 + 0.28 * len(shares), f"Allocation: {study.required.text}", study.motion)
    axes = figure.subplots()
    place = np.arange(len(shares))
    part = np.array([share.size / share.alone for share in shares])
    colours = [ORANGE if share.given else GREY if share.capped else BLUE for share in shares]
    axes.barh(place, np.minimum(part, 1.2), color=colours)
    for y, share, length in zip(range(len(shares)), shares, part, strict=True):
        factor = UNITS[share.unit][1]
        alone = f"> {number(share.size / factor)}" if share.capped else number(share.alone / factor)
        text = f"{number(share.size / factor)} {share.unit}  (alone {alone})"
        axes.text(min(float(length), 1.2) + 0.01, y, text, va="center", fontsize=7)
    axes.set_yticks(place, [share.family for share in shares])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.6)
    axes.axvline(1.0, color=GREY, linewidth=0.8, linestyle="--")
    axes.set_xlabel("size in the set / size that meets the limit alone (orange: given, grey: hardly acts)")
    return figure
