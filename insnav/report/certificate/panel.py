"""Errors of all integrators in parts of the limit, a row for every check."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np

from insnav.certificate.check import Check
from insnav.report.colours import BLACK, BLUE, GREY, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.panels import Curve, Kind, Panel

_LEAST, _MOST = 1e-7, 1e7  # parts of the limit; beyond, figures stand at the edge
_PASSED, _FAILED = "insnav: passed", "insnav: FAILED"
_OTHERS = (ORANGE, GREY, PURPLE, SKY, BLACK)


def certificate_panel(checks: Sequence[Check]) -> Panel:
    """Draw one row for every check on a logarithmic axis: the figure that counts as a point, others as crosses."""
    others = dict.fromkeys(name for check in checks for name, _ in check.values[1:])
    found: dict[str, list[tuple[int, Check, float]]] = {name: [] for name in (*others, _PASSED, _FAILED)}
    for row, check in enumerate(checks):
        for name, value in ((_PASSED if check.passed else _FAILED, check.error), *check.values[1:]):
            found[name].append((row, check, value))
    styles: dict[str, tuple[str, Kind]] = {
        name: (each, "crosses") for name, each in zip(others, cycle(_OTHERS), strict=False)
    }
    styles |= {_PASSED: (BLUE, "points"), _FAILED: (VERMILLION, "points")}
    curves = [
        Curve(
            name,
            np.array([_part(check, value) for _, check, value in of]),
            np.array([float(row) for row, *_ in of]),
            *styles[name],
            text=tuple(f"{check.case}, {name}: {value:.3g} of {check.limit:g} {check.unit}" for _, check, value in of),
        )
        for name, of in found.items()
    ]
    return Panel(
        "certificate",
        "Error of every integrator in parts of its limit",
        "",
        f"error / limit [-]; at the edges: {_LEAST:g} or less, {_MOST:g} or more",
        tuple(each for each in curves if len(each.x)),
        note="shaded: within the limit; points: insnav as it navigates",
        log_x=True,
        spans=((_LEAST / 3.0, 1.0),),
        rows=tuple(f"{check.topic}: {check.case}" for check in checks),
        height=110 + 20 * len(checks),
    )


def _part(check: Check, value: float) -> float:
    """Error in parts of the limit, within the axis; what is no number is as bad as can be."""
    if not np.isfinite(value):
        return _MOST
    if check.limit == 0.0:
        return _LEAST if value <= 0.0 else _MOST
    return float(np.clip(value / check.limit, _LEAST, _MOST))
