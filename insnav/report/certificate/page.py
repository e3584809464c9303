"""Facts, page and Markdown of the numerical certificate."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from insnav.certificate.certify import Certificate
from insnav.certificate.check import Check
from insnav.report.certificate.figures import draw_certificate
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready, versions
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing

_BEYOND = "!"  # behind a figure that misses the bar


def certificate_facts(certificate: Certificate) -> dict[str, Any]:
    """Gather the figures, JSON-ready; an error that is no number is None.

    Parameters
    ----------
    certificate : Certificate
    """
    ready: dict[str, Any] = json_ready(
        {
            "versions": versions(),
            "machine": _machine(),
            "duration_s": certificate.seconds,
            "passed": not certificate.failed,
            "failed": [f"{check.topic}: {check.case}" for check in certificate.failed],
            "checks": [
                {
                    "topic": check.topic,
                    "case": check.case,
                    "unit": check.unit,
                    "bar": check.bar,
                    "judged": [name for name, _ in check.values[: check.judged]],
                    "errors": dict(check.values),
                    "passed": check.passed,
                }
                for check in certificate.checks
            ],
        }
    )
    return ready


def certificate_sheet(certificate: Certificate) -> Sheet:
    """Put a table for every topic and a figure of all on one page.

    Parameters
    ----------
    certificate : Certificate
    """
    checks, failed = certificate.checks, certificate.failed
    tables = [_table(topic, list(rows)) for topic, rows in groupby(checks, key=lambda check: check.topic)]
    names = _names(checks)
    with drawing():
        figure = draw_certificate(checks)
    return Sheet(
        "Numerical certificate: " + ("all checks passed" if not failed else f"{len(failed)} FAILED"),
        (
            f"insnav {versions()['insnav']} on {_machine()}: {len(checks) - len(failed)} of {len(checks)} checks "
            f"passed in {certificate.seconds:.1f} s.",
            "Every figure is an error against a closed form or a published value. The first column is judged, the "
            f"others are there to compare (orders of convergence are judged in all); {_BEYOND} marks what misses the "
            "bar, – what is no number.",
        ),
        tuple(tables),
        (Picture("certificate", figure, "Error of every integrator in parts of the bar"),),
        (
            "Samples are exact increments at 100 Hz, at 50 Hz for an hour or longer motions, at 20 to 1 Hz at rest.",
            "polynomial is the integrator insnav navigates with; rk4 is Runge-Kutta on straight lines between samples, "
            "rotvec takes each increment for a rotation vector, euler goes straight on from sample to sample.",
            "20 Hz coning at 100 Hz is five samples a cycle, on which no algorithm knows the motion.",
            *(_NOTES[name] for name in names if name in _NOTES),
        ),
        tuple(f"FAILED: {check.topic}: {check.case}" for check in failed),
    )


_NOTES = {  # by the name of an integrator
    "fourth": "fourth, mean, forward and backward integrate a north-pointing platform, from instantaneous samples at "
    "10 Hz, at 0.1 Hz for the day, with the vertical channel off where it is not named.",
    "pyins": "pyins holds its height to the first, and its normal gravity has no component to the north, which alone "
    "is metres after an hour; its longitude goes on beyond 180 deg, and at a pole it divides by zero.",
}


def certificate_markdown(certificate: Certificate) -> str:
    """Write all checks as one Markdown table, as for a README.

    Parameters
    ----------
    certificate : Certificate
    """
    others = [name for name in _names(certificate.checks) if name not in {c.values[0][0] for c in certificate.checks}]
    rows = [("check", "bar", "insnav", *others)]
    for check in certificate.checks:
        values = dict(check.values)
        cells = [_cell(check, values[name]) if name in values else "" for name in others]
        bar = f"{check.bar:g}{'' if check.unit == '1' else f' {check.unit}'}"
        rows.append((f"{check.topic}: {check.case}", bar, _cell(check, check.values[0][1]), *cells))
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], f"|{'---|' * 1}{'--:|' * (len(rows[0]) - 1)}", *lines[1:]])


def _table(topic: str, checks: list[Check]) -> Table:
    names = _names(checks)
    columns = ("", *(names if len(names) > 1 else ("error",)), "bar", "")
    rows = tuple(
        (
            check.case if check.unit == "1" else f"{check.case} [{check.unit}]",
            *(_cell(check, dict(check.values).get(name)) for name in names),
            f"{check.bar:g}",
            "passed" if check.passed else "FAILED",
        )
        for check in checks
    )
    return Table(topic, columns, rows)


def _names(checks: Sequence[Check]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for check in checks for name, _ in check.values))


def _cell(check: Check, value: float | None) -> str:
    if value is None:
        return ""
    text = "0" if value == 0.0 else number(value, 2) if math.isfinite(value) else number(None)
    return text if value <= check.bar else f"{text} {_BEYOND}"


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"
