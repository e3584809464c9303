"""Report on the nine-position method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.bench_data.dwells import Dwells, dwell_warnings
from insnav.lab.navigation_impact import Calibrated, Effect
from insnav.lab.nine_position.method import AXIS, SENSORS, NinePositions
from insnav.report.calibration.figures import Series, draw_residuals
from insnav.report.calibration.page import (
    Parameter,
    base_facts,
    condition_warnings,
    corrected_table,
    effect_table,
    fit_facts,
    parameter_table,
    quality_table,
)
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.types import FloatArray
from insnav.units import DEG, UG

_MG = 1e3 * UG


def nine_report(
    table: BenchTable, dwells: Dwells, found: NinePositions, calibrated: Calibrated, effects: Sequence[Effect]
) -> tuple[Sheet, dict[str, Any]]:
    """Report on three dual-axis modules.

    Parameters
    ----------
    table : BenchTable
        The input.
    dwells : Dwells
        One mean a position.
    found : NinePositions
        The result.
    calibrated : Calibrated
        What is written.
    effects : sequence of Effect
        What it is worth.

    Returns
    -------
    Sheet, dict
        The page, and the facts for ``run.json``.
    """
    biases, accel, gyro = _biases(found), _accel(found), _gyro(found)
    fits = dict(zip(SENSORS, found.fits, strict=True))
    places = [f"roll {roll:.4g}, pitch {pitch:.4g} deg" for roll, pitch in dwells.setting / DEG]
    warnings = (
        *found.warnings,
        *dwell_warnings(dwells, SENSORS, table.get("temperature")),
        *condition_warnings(fits),
    )
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
    facts = base_facts("nine positions", (table,), (*biases, *accel, *gyro), effects, warnings)
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
            corrected_table(calibrated),
            effect_table(effects),
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
        warnings,
    )
    return sheet, facts


def _methods(found: NinePositions) -> str:
    pairs = sorted({"xyz"[axis] for axis, how in zip(AXIS, found.bias_methods, strict=True) if how[0] == "o"})
    if not pairs:
        return "by least squares over all positions: no two have an axis along the vertical, up and down"
    return f"{', '.join(pairs)} from the two extreme positions, others by least squares over all"


def _biases(found: NinePositions) -> list[Parameter]:
    half = found.half_width(found.bias_sd, first_order=False)
    return _parameters([f"{name} bias" for name in SENSORS], found.bias, found.bias_sd, half, _MG, "mg")


def _accel(found: NinePositions) -> list[Parameter]:
    half = found.half_width(found.accel_matrix_sd, first_order=False)
    matrix = found.accel_matrix - np.eye(3)
    scale = _parameters(
        [f"{a} scale factor error" for a in "xyz"],
        np.diag(matrix),
        np.diag(found.accel_matrix_sd),
        np.diag(half),
        1e-6,
        "ppm",
    )
    return scale + _crossed(matrix, found.accel_matrix_sd, half)


def _gyro(found: NinePositions) -> list[Parameter]:
    half = found.half_width(found.gyro_matrix_sd, first_order=True)
    return _crossed(found.gyro_matrix, found.gyro_matrix_sd, half)


def _crossed(matrix: FloatArray, sd: FloatArray, half: FloatArray) -> list[Parameter]:
    off = [(i, j) for i in range(3) for j in range(3) if i != j]
    names = [f"{'xyz'[i]} senses {'xyz'[j]}" for i, j in off]
    rows, columns = np.array(off).T
    return _parameters(names, matrix[rows, columns], sd[rows, columns], half[rows, columns], 1e-3, "mrad")


def _parameters(
    names: Sequence[str], value: FloatArray, sd: FloatArray, half: FloatArray, unit: float, word: str
) -> list[Parameter]:
    rows = zip(names, value / unit, sd / unit, half / unit, strict=True)
    return [Parameter(name, float(v), float(s), float(h), word) for name, v, s, h in rows]
