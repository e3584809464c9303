"""Report on rate sweeps about three axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.lab.calibration import Calibration
from insnav.lab.rate_sweep.method import SweepCalibration
from insnav.lab.rate_sweep.records import SweepRecord
from insnav.report.calibration.page import (
    base_facts,
    corrected_table,
    fit_facts,
    impact_table,
    parameter_table,
    quality_table,
)
from insnav.report.calibration.rate_sweep_figures import draw_sweeps
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.sample_statistics import rms
from insnav.types import FloatArray
from insnav.units import DEG

AXES = ("x", "y", "z")


def sweep_report(calibration: Calibration[SweepRecord, SweepCalibration]) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of three gyros swept about three axes."""
    record, found, fits = calibration.record, calibration.detail, calibration.fits
    unit = record.unit if record.raw else "deg/s"
    stages = (rms(found.error_line), rms(found.error_matrix), rms(found.error_map))
    summary = [
        f"Rate error, RMS over all dwells: {number(stages[0] / DEG)} deg/s by one line a gyro, "
        f"{number(stages[1] / DEG)} deg/s by the matrix, {_gain(found, stages)}.",
        *_dropped(found),
    ]
    with drawing():
        figure = draw_sweeps(found)
    scale = 1.0 if record.raw else 1.0 / DEG
    settings = {name: _settings(found.rate[found.used[:, i]]) for i, name in enumerate(fits)}
    quality = quality_table(fits, unit, settings, scale)
    pieces = _pieces_table(found)
    facts = base_facts("rate sweeps", record.tables, calibration)
    facts |= {
        "fits": fit_facts(fits, unit, scale),
        "condition_matrix": float(np.linalg.cond(found.matrix / np.diag(found.matrix)[:, None])),
        "rate_error_deg_s": dict(zip(("line", "matrix", "map"), (value / DEG for value in stages), strict=True)),
        "rate_error_by_gyro_deg_s": {
            axis: {"matrix": rms(found.error_matrix[:, i]) / DEG, "map": rms(found.error_map[:, i]) / DEG}
            for i, axis in enumerate(AXES)
        },
        "pieces": {
            axis: {
                "rate_deg_s": item.knot / DEG,
                "error_deg_s": item.value / DEG,
                "sd_deg_s": np.sqrt(np.diag(item.covariance)) / DEG,
            }
            for axis, item in zip(AXES, found.pieces, strict=True)
            if item is not None
        },
        "dropped": [
            {"sensor": AXES[axis], "rate_deg_s": item.rate, "reason": item.reason} for axis, item in found.dropped
        ],
    }
    sheet = Sheet(
        "Three gyros swept over rates about three axes",
        tuple(summary),
        (
            parameter_table("Output = B rate + b", calibration.parameters, _words(found)),
            _errors_table(found),
            *([pieces] if pieces.rows else []),
            quality,
            corrected_table(calibration),
            impact_table(calibration),
        ),
        (Picture("rate_errors", figure, "What matrix and bias leave, the pieces through it, and what these leave."),),
        (
            "The rate of the table is exact and about the axis named; the Earth's rotation along it is in the bias.",
            "The corrected rate is inverse(B) (output - b); from it the error is taken off, k rate + b' in each piece.",
            "Beyond the swept rates the outer pieces are continued.",
        ),
        calibration.warnings,
    )
    return sheet, facts


def _dropped(found: SweepCalibration) -> list[str]:
    """What was left out, gyro by gyro and end by end."""
    said = []
    for i, axis in enumerate(AXES):
        for sense in (-1.0, 1.0):
            rates = [item.rate for gyro, item in found.dropped if gyro == i and sense * item.rate > 0.0]
            if rates:
                first, last = min(rates, key=abs), max(rates, key=abs)
                reason = next(item.reason for gyro, item in found.dropped if gyro == i and item.rate == first)
                span = f"{first:+g}" + (f" to {last:+g}" if last != first else "")
                said.append(f"gyro {axis} leaves out {span} deg/s: {reason}")
    return said


def _gain(found: SweepCalibration, stages: Sequence[float]) -> str:
    if all(item is None for item in found.pieces):
        return "which leaves nothing that a piecewise compensation could take off"
    _, before, after = stages
    less = f", {number(before / after, 2)} times smaller" if 0.0 < after < before else ""
    return f"{number(after / DEG)} deg/s with the piecewise compensation too{less}"


def _words(found: SweepCalibration) -> str:
    if all(item is None for item in found.pieces):
        return ""
    return "given the pieces below, whose shape is not in the 1 sd"


def _settings(rate: FloatArray) -> list[str]:
    words = []
    for row in rate / DEG:
        turned = [f"{value:+.4g} deg/s about {axis}" for value, axis in zip(row, AXES, strict=True) if value != 0.0]
        words.append(", ".join(turned) or "rest")
    return words


def _errors_table(found: SweepCalibration) -> Table:
    rows = []
    for i, axis in enumerate(AXES):
        item = found.pieces[i]
        final = found.error_map[:, i]
        worst = int(np.nanargmax(np.abs(final)))
        cells = [number(rms(errors[:, i]) / DEG) for errors in (found.error_line, found.error_matrix, found.error_map)]
        left_out = None if item is None else float(np.sqrt(np.mean(item.left_out**2))) / DEG
        rows.append(
            (
                f"gyro {axis}",
                *cells,
                number(left_out),
                f"{number(abs(float(final[worst])) / DEG)} at {_settings(found.rate[worst : worst + 1])[0]}",
            )
        )
    columns = ("RMS [deg/s]", "own line", "matrix", "matrix and pieces", "left out", "worst")
    note = (
        "own line: bias and scale factor of each gyro alone; left out: in its own sweep, each rate by pieces fitted "
        "without it"
    )
    return Table("Error of the corrected rate", columns, tuple(rows), note)


def _pieces_table(found: SweepCalibration) -> Table:
    rows = []
    for axis, item in zip(AXES, found.pieces, strict=True):
        if item is None:
            continue
        for i, slope in enumerate(item.slope):
            at_zero = item.value[i] - slope * item.knot[i]
            rows.append(
                (
                    axis,
                    f"{item.knot[i] / DEG:+.2f} to {item.knot[i + 1] / DEG:+.2f}",
                    f"{1e6 * slope:.0f}",
                    number(1e6 * float(item.slope_sd[i]), 2),
                    f"{at_zero / DEG:+.4f}",
                )
            )
    return Table(
        "Pieces: error = k rate + b'",
        ("gyro", "corrected rate [deg/s]", "k [ppm]", "1 sd", "b' [deg/s]"),
        tuple(rows),
        "they meet at the borders; beyond the outer ones the last piece goes on",
    )
