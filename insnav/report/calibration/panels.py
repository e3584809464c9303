"""Calibrations: what the fitted models leave, over what was set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from insnav.lab.multi_position.many_positions import PosesCalibration
from insnav.lab.multi_position.six_positions import POSITIONS, SixPositions
from insnav.lab.rate_sweep.method import SweepCalibration
from insnav.lab.single_axis.rate_table import RateTable
from insnav.report.colours import AXIS_COLOURS, BLACK, BLUE, GREY, ORANGE, VERMILLION
from insnav.report.panels import Curve, Kind, Panel
from insnav.types import BoolArray, FloatArray
from insnav.units import DEG, G0

_MG = 1e-3 * G0


@dataclass(frozen=True, slots=True)
class Series:
    """Points of one panel."""

    name: str  # of the sensor
    unit: str
    # (n,) where, and how far from the model
    setting: FloatArray
    residual: FloatArray
    used: BoolArray  # (n,) whether the fit used it; others are drawn as crosses
    sd: float = 0.0  # standard deviation to draw as a band, zero for none

    @classmethod
    def of(cls, name: str, unit: str, table: RateTable) -> Series:
        """Outputs of a rate table minus its line; output in `unit`."""
        zero, slope = table.fit.value[:2]
        residual = table.output - (zero + slope * table.rate)
        return cls(name, unit, table.rate, residual, table.used, table.fit.sigma)


def residual_panels(series: Iterable[Series], setting: str, key: str = "residuals") -> Iterator[Panel]:
    """Draw residuals over what was set, one panel a sensor; those left out may lie beyond the limits."""
    for row, item in enumerate(series):
        colour, ends = AXIS_COLOURS[row % 3], np.array([item.setting.min(), item.setting.max()])
        largest = 1.2 * max(float(np.abs(item.residual[item.used]).max()), 1.5 * item.sd) or 1.0
        curves = [Curve("", ends, np.zeros(2), GREY)]
        if item.sd > 0.0:
            curves.append(Curve("± 1 sd of the fit", ends, np.full(2, item.sd), colour, "band", np.full(2, -item.sd)))
        curves.append(Curve("used", item.setting[item.used], item.residual[item.used], colour, "points"))
        if not item.used.all():
            rest = ~item.used
            curves.append(Curve("left out", item.setting[rest], item.residual[rest], BLACK, "crosses"))
        title, label, note = f"Residuals of {item.name}", f"residual [{item.unit}]", "measured minus fitted"
        yield Panel(f"{key}_{row}", title, label, setting, tuple(curves), key, note, limits=(-largest, largest))


def line_panels(
    panels: Sequence[tuple[str, FloatArray, FloatArray, float]], across: Sequence[str]
) -> tuple[Panel, ...]:
    """Draw points and the lines through the origin fitted to them, then residuals.

    `panels` (n,): label of the vertical axis, abscissa, ordinate, and slope.
    """
    upper, lower = [], []
    for i, ((name, x, y, slope), label, colour) in enumerate(zip(panels, across, AXIS_COLOURS, strict=False)):
        ends = np.array([0.0, 1.05 * float(np.max(x))])
        title, unit = name[: name.index(" [")], name[name.index("[") :]
        line, points = Curve("fitted", ends, slope * ends, GREY), Curve("measured", x, y, colour, "points")
        upper.append(Panel(f"line_{i}", title.capitalize(), name, label, (line, points), f"line_{i}", height=260))
        left = (Curve("", ends, np.zeros(2), GREY), Curve("residual", x, y - slope * x, colour, "points"))
        lower.append(Panel(f"rest_{i}", f"Residual of {title}", f"residual {unit}", label, left, f"line_{i}"))
    return *upper, *lower


def poses_panels(found: PosesCalibration) -> tuple[Panel, ...]:
    """Draw the error of gravity in each pose and of each turn to the next."""
    number = np.arange(1.0, len(found.poses) + 1.0)
    first = "one scale for all axes" if found.counts else "as recorded"
    used = found.turn_used
    gravity = [
        _size(first, number, found.norm_before / _MG, GREY),
        _size("calibrated", number, found.norm_after / _MG, BLUE),
        _size("left out", number, found.norm_left_out / _MG, ORANGE, "crosses"),
    ]
    between = number[:-1][used] + 0.5
    turns = [
        _size(first, between, found.turn_before[used] / DEG, GREY),
        _size("without g-sensitivity", between, found.turn_plain[used] / DEG, VERMILLION),
        _size("calibrated", between, found.turn_after[used] / DEG, BLUE),
        _size("left out", between, found.turn_left_out[used] / DEG, ORANGE, "crosses"),
    ]
    note = "left out: by a calibration that has not seen it"
    across = "number of the pose; turns between"
    return (
        Panel("gravity", "Error of gravity", "| |f| - g | [mg]", across, tuple(gravity), "pose", note, log_y=True),
        Panel("turns", "Error of the turn to the next pose", "error [deg]", across, tuple(turns), "pose", log_y=True),
    )


def _size(name: str, x: FloatArray, y: FloatArray, colour: str, kind: Kind = "points") -> Curve:
    """Points of a logarithmic axis; a simulated error may be exactly zero."""
    return Curve(name, x, np.maximum(np.abs(y), 1e-4), colour, kind)


def positions_panels(found: SixPositions) -> tuple[Panel, ...]:
    """Draw the error of gravity in the six positions, and what is left across."""
    row = np.arange(len(POSITIONS), dtype=np.float64)
    names = tuple(f"{name[0]} {'up' if name.endswith('p') else 'down'}" for name in POSITIONS)
    first = "one scale for all axes" if found.counts else "as recorded"
    before = (
        Curve(first, found.norm_before / _MG, row, GREY, "points"),
        Curve("calibrated", found.norm_after / _MG, row, BLUE, "crosses"),
    )
    across = tuple(
        Curve("xyz"[axis], found.force_after[:, axis] / _MG, row, colour, "points")
        for axis, colour in enumerate(AXIS_COLOURS)
    )
    note = "tilt of the positions as measured by the level axes; opposite positions share it"
    return (
        Panel("gravity", "Error of gravity in each position", "", "|f| - g [mg]", before, rows=names),
        Panel("across", "Left after the calibration", "", "f - ideal [mg]", across, note=note, rows=names),
    )


def sweep_panels(found: SweepCalibration) -> Iterator[Panel]:
    """Draw the error of each gyro over the rate about its axis: left by the matrix, and by the pieces too."""
    for axis, (rows, item) in enumerate(zip(found.own, found.pieces, strict=True)):
        colour, rate, name = AXIS_COLOURS[axis], found.rate[rows, axis] / DEG, "xyz"[axis]
        ends = np.array([rate.min(), rate.max()])
        for stage, words, error in (
            ("matrix", "matrix", found.error_matrix),
            ("pieces", "piecewise compensation", found.error_map),
        ):
            curves = [Curve("", ends, np.zeros(2), GREY)]
            curves.append(Curve("dwells", rate, error[rows, axis] / DEG, colour, "points"))
            if item is not None and stage == "matrix":
                knots, values = item.knot / DEG, item.value / DEG
                curves.append(Curve("pieces", knots, values, BLACK))
                curves.append(Curve("borders", knots[1:-1], values[1:-1], BLACK, "crosses"))
            none = "; nothing to compensate" if item is None and stage == "pieces" else ""
            key, title = f"rate_error_{name}_{stage}", f"Gyro {name} after the {words}"
            note = f"corrected rate minus rate of the table{none}"
            yield Panel(key, title, "error [deg/s]", "rate of the table [deg/s]", tuple(curves), "rate", note)
