"""Numerical certificate as a page, with a row for every check, and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle, groupby

import numpy as np

from insnav.certificate.certify import Certificate
from insnav.certificate.integrators import Check
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, Section, Verdict, cell, drawn, only_json, rows_frame
from insnav.report.panels import Curve, Kind, Panel
from insnav.report.style import BLACK, BLUE, GREY, ORANGE, PURPLE, SKY, VERMILLION
from insnav.report.tables import of_table
from insnav.result import Result

_EXCEEDS = "!"  # marks an error that exceeds its limit
_LEAST, _MOST = 1e-7, 1e7  # drawn range of the ratio of error to limit; points outside are drawn at its ends
_READ = f"shaded: within the limit; points: insnav as it navigates; at the edges {_LEAST:g} or less, {_MOST:g} or more"
_PASSED, _FAILED = "insnav: passed", "insnav: FAILED"
_DRAWN = "Error of every integrator in parts of its limit"
_OTHERS = (ORANGE, GREY, PURPLE, SKY, BLACK)


def page(result: Result[Certificate]) -> Page:
    """Lay out the numerical certificate: the result of all checks, with a table for every topic."""
    certificate = result.found
    checks, failed = certificate.checks, certificate.failed
    summary = f"{len(checks) - len(failed)} of {len(checks)} checks passed in {certificate.seconds:.1f} s"
    return Page(
        "Numerical certificate: " + ("all checks passed" if not failed else f"{len(failed)} FAILED"),
        (
            "Every figure is an error against a closed form or a published value. The limit applies to the first "
            f"figure of a row, the others are for comparison (orders of convergence: to all). {_EXCEEDS} marks a "
            "figure beyond the limit, – a missing figure.",
        ),
        (
            only_json(
                "", *of_table("certificate.run", certificate, passed=not failed, failed=[x.name for x in failed])
            ),
            Section("checks", rows=tuple(map(_facts, checks)), show="json"),
            *(_topic(topic, list(rows)) for topic, rows in groupby(checks, key=lambda check: check.topic)),
            drawn("certificate", _DRAWN, (certificate_panel(checks),), _READ),
        ),
        result.findings,
        verdict=Verdict(
            "bad" if failed else "good",
            "errors exceed their limits" if failed else "every error is within its limit",
            f"insnav {certificate.version} on {certificate.machine}: {summary}.",
        ),
    )


def frame(result: Result[Certificate]) -> DataFrame:
    """Build a table with one row per check; its errors and its limit are in the unit of the check."""
    return rows_frame(map(_facts, result.found.checks))


def _facts(check: Check) -> tuple[Quantity, ...]:
    required = [name for name, _ in check.values[: check.required]]
    return of_table("certificate.check", check, required=required, errors=dict(check.values))


def certificate_markdown(certificate: Certificate) -> str:
    """Write all checks as one Markdown table for a README, with the errors of other integrators for comparison."""
    others = [name for name in _names(certificate.checks) if name not in {c.values[0][0] for c in certificate.checks}]
    rows = [("check", "limit", "insnav", *others)]
    for check in certificate.checks:
        errors = {name: cell(_error(check, name, value)) for name, value in check.values}
        limit = f"{check.limit:g}{'' if check.unit == '1' else f' {check.unit}'}"
        rows.append((check.name, limit, errors[check.values[0][0]], *(errors.get(name, "") for name in others)))
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], f"|---|{'--:|' * (len(rows[0]) - 1)}", *lines[1:]])


def _topic(topic: str, checks: list[Check]) -> Section:
    alone = len(_names(checks)) == 1
    rows = tuple(
        (
            Quantity("case", check.case if check.unit == "1" else f"{check.case} [{check.unit}]"),
            Quantity("result", "passed" if check.passed else "FAILED"),
            Quantity("limit", f"{check.limit:g}"),
            *(_error(check, "error" if alone else name, value) for name, value in check.values),
        )
        for check in checks
    )
    return Section("", topic, rows=rows)


def _error(check: Check, name: str, value: float) -> Quantity:
    finite = math.isfinite(value)
    return Quantity(name, value if finite else None, digits=2, mark="" if value <= check.limit else _EXCEEDS)


def _names(checks: Sequence[Check]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for check in checks for name, _ in check.values))


def certificate_panel(checks: Sequence[Check]) -> Panel:
    """Draw a row per check on a logarithmic axis: a point is the error of insnav, crosses are other integrators."""
    others = dict.fromkeys(name for check in checks for name, _ in check.values[1:])
    points_of: dict[str, list[tuple[int, Check, float]]] = {name: [] for name in (*others, _PASSED, _FAILED)}
    for row, check in enumerate(checks):
        for name, value in ((_PASSED if check.passed else _FAILED, check.error), *check.values[1:]):
            points_of[name].append((row, check, value))
    styles: dict[str, tuple[str, Kind]] = {
        name: (each, "crosses") for name, each in zip(others, cycle(_OTHERS), strict=False)
    }
    styles |= {_PASSED: (BLUE, "points"), _FAILED: (VERMILLION, "points")}
    curves = [
        Curve(
            name,
            np.array([_part(check, value) for _, check, value in pts]),
            np.array([float(row) for row, *_ in pts]),
            *styles[name],
            text=tuple(f"{check.case}, {name}: {value:.3g} of {check.limit:g} {check.unit}" for _, check, value in pts),
        )
        for name, pts in points_of.items()
    ]
    labels, names = (_DRAWN, "", "error / limit [-]"), tuple(check.name for check in checks)
    shown, spans, height = tuple(each for each in curves if len(each.x)), ((_LEAST / 3.0, 1.0),), 110 + 20 * len(checks)
    return Panel("certificate", *labels, shown, note=_READ, log="x", spans=spans, rows=names, height=height)


def _part(check: Check, value: float) -> float:
    """Return the ratio of an error to its limit, clipped to the range of the axis; NaN becomes the largest ratio."""
    if not np.isfinite(value):
        return _MOST
    if check.limit == 0.0:
        return _LEAST if value <= 0.0 else _MOST
    return float(np.clip(value / check.limit, _LEAST, _MOST))
