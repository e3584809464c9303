"""Report on the nine-position method."""

from __future__ import annotations

from typing import Any

import numpy as np

from insnav.lab.calibration import Calibration
from insnav.lab.nine_position.method import AXIS, SENSORS, NinePositions, NineRecord
from insnav.report.calibration.figures import Series, draw_residuals
from insnav.report.calibration.page import (
    base_facts,
    corrected_table,
    fit_facts,
    impact_table,
    parameter_table,
    quality_table,
)
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG, UG

_MG = 1e3 * UG


def nine_report(calibration: Calibration[NineRecord, NinePositions]) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of three dual-axis modules."""
    table, dwells = calibration.record.table, calibration.record.dwells
    found, fits = calibration.detail, calibration.fits
    # in the order of the method: six biases, three scale factors and six misalignments of the triad, six of the gyros
    biases, accel, gyro = (calibration.parameters[rows] for rows in (slice(6), slice(6, 15), slice(15, None)))
    places = [f"roll {roll:.4g}, pitch {pitch:.4g} deg" for roll, pitch in dwells.setting / DEG]
    largest = 1e3 * float(np.abs(found.gyro_matrix - np.eye(3)).max())
    left = 1e3 * float(found.half_width(found.gyro_matrix_sd, first_order=True).max())
    with drawing():
        series = [
            Series(
                f"{'xyz'[axis]} [mg]",
                np.repeat(np.arange(1.0, len(places) + 1.0), 2),
                np.column_stack([found.fits[i].residual / _MG for i in np.flatnonzero(axis == AXIS)]).ravel(),
                np.ones(2 * len(places), dtype=np.bool_),
                found.sigma / _MG,
            )
            for axis in range(3)
        ]
        figure = draw_residuals(
            series,
            "position, in the order of the file",
            "Nine positions: accelerometers minus the linear model",
            "two accelerometers an axis",
        )
    facts = base_facts("nine positions", (table,), calibration)
    facts |= {
        "fits": fit_facts(fits, "m/s^2"),
        "condition_accel": found.condition_accel,
        "condition_gyro": found.condition_gyro,
        "second_order_allowance": found.second_order,
        "gyro_diagonal_not_used": found.gyro_diagonal,
    }
    conditions = Table(
        "Pseudo-inverses",
        ("matrix", "condition", "positions"),
        (
            ("A_m, accelerometers", number(found.condition_accel), str(len(places))),
            ("Omega_m, products", number(found.condition_gyro), "all that are tilted"),
        ),
    )
    sheet = Sheet(
        "Nine positions of three dual-axis modules",
        (
            f"Gyro misalignment up to {number(largest)} mrad, known to ± {number(left, 2)} mrad (95 %); its inverse is "
            "applied by insnav.",
            f"Scatter of one accelerometer value {number(found.sigma / _MG, 2)} mg, {found.dof} degrees of freedom.",
        ),
        (
            parameter_table("Bias of each accelerometer", biases, _methods(found)),
            parameter_table("Accelerometer triad, each axis the mean of its two accelerometers", accel),
            parameter_table(
                "Gyro misalignment", gyro, "1 sd of noise; the interval adds what the first order leaves out"
            ),
            conditions,
            quality_table(fits, "m/s²", dict.fromkeys(SENSORS, places)),
            corrected_table(calibration),
            impact_table(calibration),
        ),
        (Picture("residuals", figure, "What the linear model of each accelerometer leaves."),),
        (
            "Valid to first order in the misalignments; errors of second order are up to about "
            f"{number(1e3 * found.second_order, 2)} mrad here and are in the intervals.",
            "The positions are symmetric in ± roll and ± pitch, and exact; their errors are in the residuals.",
            "Gyro and accelerometers of a module turn together.",
            f"The diagonal of M_G ({', '.join(f'{v:.5f}' for v in found.gyro_diagonal)}) carries the scale of the "
            "accelerometers, not of the gyros: each row is divided by it. Gyro bias and scale factor stay unknown.",
            "M_G is the sensitivity of the gyros: its inverse corrects, itself it would double the error.",
        ),
        calibration.warnings,
    )
    return sheet, facts


def _methods(found: NinePositions) -> str:
    pairs = sorted({"xyz"[axis] for axis, how in zip(AXIS, found.bias_methods, strict=True) if how[0] == "o"})
    if not pairs:
        return "by least squares over all positions: no two have an axis along the vertical, up and down"
    return f"{', '.join(pairs)} from the two extreme positions, others by least squares over all"
