"""Common parts of the calibration pages: fits, residuals, impact on navigation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.imu.model import ImuErrors
from insnav.lab.bench_data import BenchFile, BenchTable
from insnav.lab.calibration import Calibration, Fit, measured
from insnav.lab.single_axis.rate_table import RateTable
from insnav.quantity import Quantity
from insnav.report.page import Section, of_table
from insnav.report.panels import Curve, Panel
from insnav.report.style import AXIS_COLOURS, BLACK, GREY
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG, G0


def quality_section(*sets: tuple[Mapping[str, Fit], str, Mapping[str, Sequence[str]]], factor: float = 1.0) -> Section:
    """Tabulate the quality of each fit: scatter, worst residual, condition; fits, their unit and settings."""
    rows = tuple(
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
        for fits, unit, settings in sets
        for name, fit in fits.items()
    )
    note = (
        "rms: root of the sum of squares over the number of points; sd: over the degrees of freedom. Condition: of the "
        "design with columns of equal length, 1 at best."
    )
    return Section("fits", "Residuals", rows=rows, note=note)


def impact_section(calibration: Calibration[Any, Any], note: str = "") -> Section:
    """Tabulate the position error in a minute of navigation without and with the calibration."""
    rows = tuple(
        of_table("calibration.impact", item, ratio=item.without / item.corrected if item.corrected > 0.0 else None)
        for item in calibration.impact
    )
    method = (
        "Simulated horizontal position error after 60 s, RMS. True errors are sampled about the calibrated ones by "
        "their uncertainty. No other errors, exact initial state, constant height. "
    )
    # without calibration, if the output is in volts or counts
    errors, sd = calibration.errors or ImuErrors(), calibration.sd
    raw = (errors.gyro_raw and sd.gyro_bias.any()) or (errors.accel_raw and sd.accel_bias.any())
    note = note or "Without: zero output taken as 0, scale factor known." * bool(raw)
    return Section("navigation_impact", "Impact on navigation", rows=rows, note=(method + note).rstrip())


def corrected_section(calibration: Calibration[Any, Any]) -> Section:
    """Tabulate the uncertainty of corrected rates and specific forces by the calibration."""
    errors, spread = calibration.sensed or calibration.errors or ImuErrors(), calibration.sd
    still, diagonal, g = np.zeros((1, 3)), np.full((1, 3), 1.0 / np.sqrt(3.0)), np.array([[0.0, 0.0, -G0]])
    at_rest, up = spread.corrected(errors, still, g)
    turning, _ = spread.corrected(errors, 100.0 * DEG * diagonal, g)
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


def bench_input(tables: Sequence[BenchTable | BenchFile]) -> Any:
    """Return the bench files, for ``run.json``."""
    return [{"path": table.name, "sha256": table.sha256, "units": dict(table.units)} for table in tables]


@dataclass(frozen=True, slots=True)
class Series:
    """Points of one panel."""

    name: str  # of the sensor
    unit: str
    # (n,) settings, and deviations from the model
    setting: FloatArray
    residual: FloatArray
    used: BoolArray  # (n,) used in the fit; unused points are drawn as crosses
    sd: float = 0.0  # standard deviation drawn as a band; zero: none
    output: FloatArray | None = None  # (n,) drawn above with the fitted model

    @classmethod
    def of(cls, name: str, unit: str, table: RateTable) -> Series:
        """Build the series of outputs minus the line of a rate table; output in `unit`."""
        zero, slope = table.fit.value[:2]
        residual = table.output - (zero + slope * table.rate)
        return cls(name, unit, table.rate, residual, table.used, table.fit.sigma, table.output)

    def points(self, values: FloatArray, colour: str) -> list[Curve]:
        """Draw values of the points, those left out as crosses."""
        rest = ~self.used
        left_out = [Curve("left out", self.setting[rest], values[rest], BLACK, "crosses")] if rest.any() else []
        return [Curve("used", self.setting[self.used], values[self.used], colour, "points"), *left_out]


def residual_panels(series: Iterable[Series], setting: str, key: str = "residuals") -> Iterator[Panel]:
    """Draw outputs with the fitted model, and residuals, over the settings; unused points may exceed the limits."""
    for row, item in enumerate(series):
        order = np.argsort(item.setting)
        colour, ends = AXIS_COLOURS[row % 3], np.array([item.setting.min(), item.setting.max()])
        largest = 1.2 * max(float(np.abs(item.residual[item.used]).max()), 1.5 * item.sd) or 1.0
        output, curves = item.output, [Curve("", ends, np.zeros(2), GREY)]
        if item.sd > 0.0:
            curves.append(Curve("± 1 sd of the fit", ends, np.full(2, item.sd), colour, "band", np.full(2, -item.sd)))
        curves += item.points(item.residual, colour)
        if output is not None:
            line = Curve("fitted", item.setting[order], (output - item.residual)[order], GREY)
            labels = f"Output of {item.name}", f"output [{item.unit}]", setting
            yield Panel(f"{key}_output_{row}", *labels, (line, *item.points(output, colour)), key, height=240)
        title, label, note = f"Residuals of {item.name}", f"residual [{item.unit}]", "measured minus fitted"
        yield Panel(f"{key}_{row}", title, label, setting, tuple(curves), key, note, limits=(-largest, largest))
