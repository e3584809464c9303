"""What the reports of all calibrations have in common: parameters, their uncertainty, impact on navigation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from insnav.imu.model import ImuErrors
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.calibration import Calibration
from insnav.lab.least_squares import Fit
from insnav.quantity import Quantity
from insnav.report.numbers import number, rounded
from insnav.report.page import Table
from insnav.report.sheet import Sheet
from insnav.units import DEG, G0

COLUMNS = ("parameter", "value", "1 sd", "95 % interval ±", "unit")


_REPORTS = {
    "gyro": "single_axis.gyro_report",
    "accel": "single_axis.accel_report",
    "imu": "rate_sweep.sweep_report",
    "nine": "nine_position.nine_report",
    "poses": "multi_position.poses_report",
    "rotor": "rotor_inertia.rotor_report",
}


def calibration_report(calibration: Calibration[Any, Any]) -> tuple[Sheet, dict[str, Any]]:
    """Page of a calibration, by whatever method, and its facts for ``run.json``."""
    module, function = _REPORTS[calibration.method].split(".")
    report = getattr(import_module(f"insnav.report.calibration.{module}"), function)
    page, facts = report(calibration)
    return page, facts


def _shown(item: Quantity) -> tuple[float, float, float]:
    """Value, standard deviation and half of the interval in the unit shown."""
    low, high = item.interval or (np.nan, np.nan)
    value, sd, half = (float(item.scaled(each)) for each in (item.value, item.sd, 0.5 * (high - low)))
    return value, sd, half


def parameter_table(title: str, items: Sequence[Quantity], note: str = "") -> Table:
    """Parameters in rows, each to the second digit of its standard deviation."""
    rows = []
    for item in items:
        value, sd, half = _shown(item)
        rows.append((item.label, rounded(value, sd), number(sd, 2), number(half, 2), item.shown_unit))
    return Table(title, COLUMNS, tuple(rows), note)


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


def impact_table(calibration: Calibration[Any, Any], note: str = "") -> Table:
    """Impact of the calibration on one minute of navigation."""
    rows = tuple(
        (
            item.motion,
            number(item.without),
            number(item.corrected, 2),
            number(item.without / item.corrected, 2) if item.corrected > 0.0 else "–",
        )
        for item in calibration.impact
    )
    columns = ("one minute, free inertial", "without [m]", "with [m]", "times smaller")
    simulated = (
        "Horizontal position error after 60 s, RMS, simulated: true errors drawn about the calibrated ones with their "
        "uncertainty, no other errors, true start, height held. "
    )
    return Table("Impact on navigation", columns, rows, (simulated + (note or _without(calibration))).rstrip())


def corrected_table(calibration: Calibration[Any, Any]) -> Table:
    """Uncertainty of corrected rates and specific forces, as far as it comes from the calibration."""
    errors, sd = calibration.sensed or calibration.errors or ImuErrors(), calibration.sd
    still, x, g = np.zeros((1, 3)), np.array([[1.0, 1.0, 1.0]]), np.array([[0.0, 0.0, -G0]])
    rows = []
    rest, up = sd.corrected(errors, still, g)
    turning, _ = sd.corrected(errors, 100.0 * DEG * x / np.sqrt(3.0), g)
    cases = [
        ("rate at rest, z down", rest / DEG, "deg/s"),
        ("rate at 100 deg/s about (1, 1, 1)", turning / DEG, "deg/s"),
        ("specific force at rest, z down", up / (1e-3 * G0), "mg"),
    ]
    for what, spread, unit in cases:
        if np.any(spread):
            rows.append((what, *(number(float(value), 2) for value in spread[0]), unit))
    note = "1 sd from the uncertainty of the calibration alone, without noise and drift after it"
    return Table("Corrected data", ("", "x", "y", "z", "unit"), tuple(rows), note)


def impact_facts(calibration: Calibration[Any, Any]) -> list[dict[str, Any]]:
    """Impact on navigation for ``run.json``."""
    return [{"motion": e.motion, "without_m": e.without, "with_m": e.corrected} for e in calibration.impact]


def base_facts(title: str, tables: Sequence[BenchTable], calibration: Calibration[Any, Any]) -> dict[str, Any]:
    """What every calibration leaves in ``run.json``: input, parameters, impact, warnings."""
    items = []
    for item in calibration.parameters:
        value, sd, half = _shown(item)
        items.append({"name": item.label, "value": value, "sd": sd, "half_width_95": half, "unit": item.shown_unit})
    return {
        "method": title,
        "input": [{"path": table.name, "sha256": table.sha256, "units": dict(table.units)} for table in tables],
        "parameters": items,
        "minute": impact_facts(calibration),
        "warnings": list(calibration.warnings),
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


def _without(calibration: Calibration[Any, Any]) -> str:
    """What "without" means where the output is in volts or counts."""
    errors, sd = calibration.errors or ImuErrors(), calibration.sd
    raw = (errors.gyro_raw and sd.gyro_bias.any()) or (errors.accel_raw and sd.accel_bias.any())
    return "Without: the zero taken for 0, the scale factor known." if raw else ""
