"""What the reports of all bench methods have in common: fitted parameters, their residuals, impact on navigation."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insnav.imu.model import ImuErrors
from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.least_squares import Fit
from insnav.lab.navigation_impact import Calibrated, Effect
from insnav.quantity import Quantity
from insnav.report.numbers import number
from insnav.report.page import Section
from insnav.types import FloatArray
from insnav.units import DEG, G0, UNITS

BADLY_CONDITIONED = 30.0  # condition number from which parameters are hardly separated


def measured(name: str, value: float, unit: str, sd: float | None = None, half_width: float | None = None) -> Quantity:
    """Quantity of what is already in the unit shown.

    Parameters
    ----------
    name : str
        In words; the key is made of it.
    value, sd, half_width : float
        Estimate, standard deviation and half its 95 % interval, in `unit`.
    unit : str
    """
    factor = UNITS[unit][1] if unit in UNITS else 1.0
    interval = None if half_width is None else ((value - half_width) * factor, (value + half_width) * factor)
    key = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_")
    return Quantity(key, value * factor, unit, None if sd is None else sd * factor, interval, name)


def fitted(fit: Fit, units: Sequence[str], sensor: str = "", factor: float = 1.0) -> list[Quantity]:
    """Parameters of a fit with standard deviation and 95 % interval.

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
    return [measured(f"{sensor} {name}".strip(), float(v), u, float(s), float(h)) for name, v, s, h, u in rows]


def quality_rows(
    fits: Mapping[str, Fit], unit: str, settings: Mapping[str, Sequence[str]], factor: float = 1.0
) -> tuple[tuple[Quantity, ...], ...]:
    """How well each fit holds: scatter, worst residual, condition.

    Parameters
    ----------
    fits : mapping of str to Fit
        By sensor.
    unit : str
        Of the residuals as shown.
    settings : mapping of str to sequence of str
        What was set in each row of each fit, in words.
    factor : float
        From the unit of the fits to that shown.
    """
    return tuple(
        (
            Quantity("name", name, meaning="fit"),
            Quantity("points", fit.residual.size),
            Quantity("degrees_of_freedom", fit.dof),
            measured("rms", fit.rms * factor, unit),
            measured("sd", fit.sigma * factor, unit),
            measured("worst", abs(float(fit.residual[fit.worst])) * factor, unit),
            Quantity("worst_at", settings[name][fit.worst]),
            Quantity("condition", fit.condition),
        )
        for name, fit in fits.items()
    )


def quality_section(
    fits: Mapping[str, Fit], unit: str, settings: Mapping[str, Sequence[str]], factor: float = 1.0
) -> Section:
    """Give `quality_rows` as a section."""
    return residuals_section(quality_rows(fits, unit, settings, factor))


def residuals_section(rows: Sequence[tuple[Quantity, ...]]) -> Section:
    """Give rows of `quality_rows`, of fits in any unit, as a section."""
    note = (
        "rms: root of the sum of squares over the number of points; sd: over the degrees of freedom. Condition: of the "
        "design with columns of equal length, 1 at best."
    )
    return Section("fits", "Residuals", rows=tuple(rows), note=note)


def condition_warnings(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say which fits hardly separate their parameters."""
    return tuple(
        f"{name}: condition number {number(fit.condition)}; these measurements hardly separate the parameters"
        for name, fit in fits.items()
        if fit.condition > BADLY_CONDITIONED
    )


def impact_section(effects: Sequence[Effect], note: str = "") -> Section:
    """Position error in one minute of navigation without and with the calibration.

    Parameters
    ----------
    effects : sequence of Effect
    note : str
    """
    rows = tuple(
        (
            Quantity("motion", item.motion, meaning="one minute, free inertial"),
            Quantity("without", item.without, "m", meaning="without calibration"),
            Quantity("with", item.corrected, "m", meaning="with calibration", digits=2),
            Quantity(
                "ratio", item.without / item.corrected if item.corrected > 0.0 else None, meaning="ratio", digits=2
            ),
        )
        for item in effects
    )
    method = (
        "Horizontal position error after 60 s, RMS, simulated: true errors sampled about the calibrated ones with "
        "their uncertainty, no other errors, exact initial state, height held. "
    )
    return Section("navigation_impact", "Impact on navigation", rows=rows, note=(method + note).rstrip())


def corrected_section(calibrated: Calibrated) -> Section:
    """Uncertainty of corrected rates and specific forces that comes from the calibration.

    Parameters
    ----------
    calibrated : Calibrated
    """
    still, diagonal, g = np.zeros((1, 3)), np.full((1, 3), 1.0 / np.sqrt(3.0)), np.array([[0.0, 0.0, -G0]])
    at_rest, up = calibrated.corrected_sd(still, g)
    turning, _ = calibrated.corrected_sd(100.0 * DEG * diagonal, g)
    cases: list[tuple[str, FloatArray, str]] = [
        ("rate at rest, z down", at_rest, "deg/s"),
        ("rate at 100 deg/s about (1, 1, 1)", turning, "deg/s"),
        ("specific force at rest, z down", up, "mg"),
    ]
    rows = tuple(
        (
            Quantity("case", what),
            *(Quantity(f"sd_{axis}", float(sd[0, k]), unit, digits=2) for k, axis in enumerate("xyz")),
        )
        for what, sd, unit in cases
        if np.any(sd)
    )
    note = "1 sd from the uncertainty of the calibration alone, without noise and drift after it."
    return Section("corrected", "Uncertainty of corrected data", rows=rows, note=note)


def bench_input(tables: Sequence[BenchTable]) -> list[dict[str, Any]]:
    """Files of the bench, for ``run.json``."""
    return [{"path": table.name, "sha256": table.sha256, "units": dict(table.units)} for table in tables]


def without_text(errors: ImuErrors) -> str:
    """What "without" means where the output is in volts or counts."""
    raw = [name for name, item in (("gyro", errors.gyro_raw), ("accel", errors.accel_raw)) if item is not None]
    return "Without: zero output taken as 0, scale factor known." if raw else ""
