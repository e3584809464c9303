"""GPS outages of a run: when it had no position fixes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from insnav.types import Run

SHORTEST_OUTAGE_S = 2.0
MISSED_FIXES = 3.0  # median intervals without a used position fix make an outage


def outages(run: Run) -> list[tuple[float, float]]:
    """Start and end of the times without a used position fix, at the ends of the run too [s].

    Returns: longer than `MISSED_FIXES` median intervals between fixes and than `SHORTEST_OUTAGE_S`; empty if the run
    had no position fix at all.
    """
    fixes = run.innovations
    processed = fixes.time[np.isfinite(fixes.innovation[:, 0:3]).any(axis=1)]
    used = fixes.time[fixes.used_position]
    if len(processed) < 2 or len(run.solution.time) == 0:
        return []
    limit = max(MISSED_FIXES * float(np.median(np.diff(processed))), SHORTEST_OUTAGE_S)
    start, end = run.solution.time[0], run.solution.time[-1]
    inside = used[(used > start) & (used < end)]
    edges = np.concatenate(([start], inside, [end]))
    return [(float(a), float(b)) for a, b in pairwise(edges) if b - a > limit]
