"""What the reports of all calibrations have in common: parameters with their uncertainty, and what they are worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.imu.model import ImuErrors
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.least_squares import Fit
from insnav.lab.navigation_impact import Calibrated, Effect
from insnav.report.numbers import number, rounded
from insnav.report.page import Table
from insnav.units import DEG, G0

COLUMNS = ("parameter", "value", "1 sd", "95 % interval ±", "unit")
BADLY_CONDITIONED = 30.0  # beyond it the parameters are hardly told apart


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a result.

    Attributes
    ----------
    name : str
    value, sd, half_width : float
        Estimate, its standard deviation and half its 95 % interval.
    unit : str
    """

    name: str
    value: float
    sd: float
    half_width: float
    unit: str


def parameters(fit: Fit, units: Sequence[str], sensor: str = "", factor: float = 1.0) -> list[Parameter]:
    """Parameters of a fit.

    Parameters
    ----------
    fit : Fit
    units : sequence of str
        One a parameter.
    sensor : str
        Put before the names.
    factor : float
        From the unit of the fit to that shown.
    """
    rows = zip(fit.names, fit.value * factor, fit.sd * factor, fit.half_width() * factor, units, strict=True)
    return [Parameter(f"{sensor} {name}".strip(), float(v), float(s), float(h), u) for name, v, s, h, u in rows]


def parameter_table(title: str, items: Sequence[Parameter], note: str = "") -> Table:
    """Parameters in rows, each to the second digit of its standard deviation.

    Parameters
    ----------
    title : str
    items : sequence of Parameter
    note : str
    """
    rows = tuple(
        (item.name, rounded(item.value, item.sd), number(item.sd, 2), number(item.half_width, 2), item.unit)
        for item in items
    )
    return Table(title, COLUMNS, rows, note)


def quality_table(
    fits: Mapping[str, Fit], unit: str, settings: Mapping[str, Sequence[str]], factor: float = 1.0
) -> Table:
    """How well each fit holds: scatter, worst residual, condition.

    Parameters
    ----------
    fits : mapping of str to Fit
        By sensor.
    unit : str
        Of the residuals.
    settings : mapping of str to sequence of str
        What was set in each row of each fit, in words.
    factor : float
        From the unit of the fits to that shown.
    """
    rows = tuple(
        (
            name,
            str(fit.residual.size),
            str(fit.dof),
            number(fit.rms * factor),
            number(fit.sigma * factor),
            f"{number(abs(float(fit.residual[fit.worst])) * factor)} at {settings[name][fit.worst]}",
            number(fit.condition),
        )
        for name, fit in fits.items()
    )
    columns = ("fit", "points", "degrees of freedom", f"RMS [{unit}]", f"sd [{unit}]", f"worst [{unit}]", "condition")
    note = (
        "RMS: root of the sum of squares over the number of points; sd: over the degrees of freedom. Condition: of the "
        "design with columns of equal length, 1 at best."
    )
    return Table("Residuals", columns, rows, note)


def condition_warnings(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say which fits hardly tell their parameters apart."""
    return tuple(
        f"{name}: condition number {number(fit.condition)}; the parameters are hardly told apart by these measurements"
        for name, fit in fits.items()
        if fit.condition > BADLY_CONDITIONED
    )


def effect_table(effects: Sequence[Effect], note: str = "") -> Table:
    """What the calibration is worth in one minute of navigation.

    Parameters
    ----------
    effects : sequence of Effect
    note : str
    """
    rows = tuple(
        (
            item.motion,
            number(item.without),
            number(item.corrected, 2),
            number(item.without / item.corrected, 2) if item.corrected > 0.0 else "–",
        )
        for item in effects
    )
    columns = ("one minute, free inertial", "without [m]", "with [m]", "times smaller")
    told = (
        "Horizontal position error after 60 s, RMS, simulated: true errors drawn about the calibrated ones with their "
        "uncertainty, no other errors, true start, height held. "
    )
    return Table("Effect of the calibration on navigation", columns, rows, (told + note).rstrip())


def corrected_table(calibrated: Calibrated) -> Table:
    """How sure corrected rates and specific forces are, as far as the calibration goes.

    Parameters
    ----------
    calibrated : Calibrated
    """
    still, x, g = np.zeros((1, 3)), np.array([[1.0, 1.0, 1.0]]), np.array([[0.0, 0.0, -G0]])
    rows = []
    rest, up = calibrated.corrected_sd(still, g)
    turning, _ = calibrated.corrected_sd(100.0 * DEG * x / np.sqrt(3.0), g)
    cases = [
        ("rate at rest, z down", rest / DEG, "deg/s"),
        ("rate at 100 deg/s about (1, 1, 1)", turning / DEG, "deg/s"),
        ("specific force at rest, z down", up / (1e-3 * G0), "mg"),
    ]
    for what, sd, unit in cases:
        if np.any(sd):
            rows.append((what, *(number(float(value), 2) for value in sd[0]), unit))
    note = "1 sd from the uncertainty of the calibration alone, without noise and drift after it"
    return Table("Corrected data", ("", "x", "y", "z", "unit"), tuple(rows), note)


def minute_facts(effects: Sequence[Effect]) -> list[dict[str, Any]]:
    """What the calibration is worth, for ``run.json``.

    Parameters
    ----------
    effects : sequence of Effect
    """
    return [{"motion": e.motion, "without_m": e.without, "with_m": e.corrected} for e in effects]


def base_facts(
    method: str,
    tables: Sequence[BenchTable],
    items: Sequence[Parameter],
    effects: Sequence[Effect],
    warnings: Sequence[str],
) -> dict[str, Any]:
    """Gather what every calibration leaves in ``run.json``, JSON-ready.

    Parameters
    ----------
    method : str
    tables : sequence of BenchTable
        The input.
    items : sequence of Parameter
    effects : sequence of Effect
    warnings : sequence of str
    """
    return {
        "method": method,
        "input": [{"path": table.name, "sha256": table.sha256, "units": dict(table.units)} for table in tables],
        "parameters": [
            {"name": p.name, "value": p.value, "sd": p.sd, "half_width_95": p.half_width, "unit": p.unit} for p in items
        ],
        "minute": minute_facts(effects),
        "warnings": list(warnings),
    }


def fit_facts(fits: Mapping[str, Fit], unit: str, factor: float = 1.0) -> list[dict[str, Any]]:
    """Scatter and condition of fits for ``run.json``.

    Parameters
    ----------
    fits : mapping of str to Fit
    unit : str
        Of the residuals.
    factor : float
        From the unit of the fits to that shown.
    """
    return [
        {
            "name": name,
            "points": fit.residual.size,
            "degrees_of_freedom": fit.dof,
            "rms": fit.rms * factor,
            "sd": fit.sigma * factor,
            "worst": float(np.abs(fit.residual).max()) * factor,
            "unit": unit,
            "condition": fit.condition,
        }
        for name, fit in fits.items()
    ]


def without_words(errors: ImuErrors) -> str:
    """What "without" means where the output is in volts or counts."""
    raw = [name for name, item in (("gyro", errors.gyro_raw), ("accel", errors.accel_raw)) if item is not None]
    return "Without: the zero taken for 0, the scale factor known." if raw else ""
