"""Three calibrated sensors as a table in field units."""

from __future__ import annotations

import numpy as np

from insnav.lab.multi_position.triad import AXES, Triad
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.types import FloatArray
from insnav.units import DEG, G0, PPM

_MG, _MRAD = 1e-3 * G0, 1e-3


def triad_table(title: str, triad: Triad, counts: bool, *, accel: bool) -> Table:
    """Tabulate three sensors in field units: bias, scale factor, misalignment, each with its standard deviation.

    Parameters
    ----------
    title : str
    triad : Triad
    counts : bool
        The record is in raw units.
    accel : bool
        Accelerometers, else gyros.
    """
    per = G0 if accel else DEG
    bias_unit, bias = ("counts", 1.0) if counts else (("mg", _MG) if accel else ("deg/s", DEG))
    scale_unit = f"counts/{'g' if accel else '(deg/s)'}" if counts else "ppm"
    rows = []
    for i, axis in enumerate(AXES):
        rows.append((f"bias {axis} [{bias_unit}]", triad.bias[i] / bias, triad.bias_sd[i] / bias))
    for i, axis in enumerate(AXES):
        value, sd = triad.matrix[i, i], triad.matrix_sd[i, i]
        shown = (value * per, sd * per) if counts else ((value - 1.0) / PPM, sd / PPM)
        rows.append((f"scale factor {axis} [{scale_unit}]", *shown))
    for i, axis in enumerate(AXES):
        for j, other in enumerate(AXES):
            if i != j and triad.matrix_sd[i, j] > 0.0:
                own = triad.matrix[i, i] * _MRAD
                rows.append(
                    (f"{axis} feels {other} [mrad]", triad.matrix[i, j] / own, triad.matrix_sd[i, j] / abs(own))
                )
    return Table(
        title,
        ("", "value", "1 sd"),
        tuple((text, _value(value, sd), number(sd, 2)) for text, value, sd in rows),
        f"condition number {number(triad.condition)}",
    )


def _value(value: float, sd: float) -> str:
    """As many decimals as the standard deviation has, with two digits of it."""
    decimals = 1 - int(np.floor(np.log10(sd))) if sd > 0.0 else 3
    return f"{value:.{min(max(decimals, 0), 9)}f}"


def g_table(sensitivity: FloatArray, sd: FloatArray, counts: bool) -> Table:
    """Tabulate what the gyros feel of the specific force.

    Parameters
    ----------
    sensitivity, sd : (3, 3) array
        And standard deviation, unit of the record per m/s^2.
    counts : bool
        The record is in raw units.
    """
    unit, size = ("counts per g", G0) if counts else ("deg/s per g", G0 / DEG)
    rows = tuple(
        (
            f"gyro {axis}",
            *(f"{_value(float(v) * size, float(s) * size)} ± {number(float(s) * size, 2)}" for v, s in pairs),
        )
        for axis, pairs in zip(
            AXES, (zip(*rows, strict=True) for rows in zip(sensitivity, sd, strict=True)), strict=True
        )
    )
    return Table(f"Gyros: g-sensitivity, ± 1 sd [{unit}]", ("", *(f"by {axis}" for axis in AXES)), rows)
