"""The interactive drawings of a comparison: horizontal errors over time, and how they are distributed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.errors.comparison import Comparison
from insnav.errors.metrics import TrajectoryErrors
from insnav.report.colours import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.panels import Curve, Kind, Panel
from insnav.report.series import Clock, broken_at_gaps

_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY)


def comparison_panels(found: Comparison) -> tuple[Panel, ...]:
    """Draw the errors of every solution; smoothed ones dashed."""
    clock = Clock.of(found.compared[0].errors.time)
    over_time, shares = [], []
    for name, colour, smoothed, each in styled(found):
        kind: Kind = "dashed" if smoothed else "line"
        time, error = broken_at_gaps(clock(each.time), each.horizontal)
        over_time.append(Curve(name, time, error, colour, kind))
        known = np.sort(each.horizontal[np.isfinite(each.horizontal)])
        shares.append(Curve(name, known, 100.0 * np.arange(1, len(known) + 1) / max(len(known), 1), colour, kind))
    return (
        Panel("compared_error", "Horizontal error", "error [m]", clock.label, tuple(over_time), "time", height=260),
        Panel(
            "compared_share",
            "Distribution of the horizontal error",
            "epochs below [%]",
            "horizontal error [m]",
            tuple(shares),
            "share",
            note="further left is better",
            limits=(0.0, 101.0),
        ),
    )


def styled(found: Comparison) -> Iterator[tuple[str, str, bool, TrajectoryErrors]]:
    """Name of every solution, colour of its run, whether it is smoothed, and its errors."""
    runs = list(dict.fromkeys(each.run for each in found.compared))
    for (name, errors), each in zip(found.named().items(), found.compared, strict=True):
        yield name, _COLOURS[runs.index(each.run) % len(_COLOURS)], each.solution == "smoothed", errors
