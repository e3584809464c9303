"""Three calibrated sensors in field units."""

from __future__ import annotations

import itertools

from insnav.lab.calibration import measured
from insnav.lab.multi_position.triad import AXES, Triad
from insnav.quantity import Quantity
from insnav.report.page import Section, only_json
from insnav.types import FloatArray
from insnav.units import DEG, G0


def triad_section(key: str, title: str, triad: Triad, counts: bool) -> Section:
    """Bias, scale factor and misalignment of three sensors with their standard deviations; matrices in JSON."""
    accel = key == "accel"
    si, shown = ("m/s^2", "mg") if accel else ("rad/s", "deg/s")
    bias_unit, matrix_unit = ("counts", f"counts/({si})") if counts else (si, "")
    rows = [
        (
            f"bias {axis}",
            Quantity("value", float(triad.bias[i]), "counts" if counts else shown, float(triad.bias_sd[i])),
        )
        for i, axis in enumerate(AXES)
    ]
    for i, axis in enumerate(AXES):
        value, sd = float(triad.matrix[i, i]), float(triad.matrix_sd[i, i])
        if counts:
            per, unit = (G0, "counts/g") if accel else (DEG, "counts/(deg/s)")
            rows.append((f"scale factor {axis}", measured("value", value * per, unit, sd * per)))
        else:
            rows.append((f"scale factor error {axis}", Quantity("value", value - 1.0, "ppm", sd)))
    for i, j in itertools.permutations(range(3), 2):
        if triad.matrix_sd[i, j] > 0.0:
            own = float(triad.matrix[i, i])
            across, sd = float(triad.matrix[i, j]) / own, float(triad.matrix_sd[i, j]) / abs(own)
            rows.append((f"{AXES[i]} senses {AXES[j]}", Quantity("value", across, "mrad", sd)))
    items = (
        Quantity("bias", triad.bias, bias_unit, triad.bias_sd),
        Quantity("matrix", triad.matrix, matrix_unit, triad.matrix_sd),
        Quantity("condition", triad.condition),
    )
    named = tuple((Quantity("parameter", name), value) for name, value in rows)
    table = Section("", title, rows=named, note=f"± 1 sd; condition number {triad.condition:.3g}")
    return Section(key, parts=(table, only_json("", *items)))


def g_section(sensitivity: FloatArray, sd: FloatArray, counts: bool) -> Section:
    """g-sensitivity of the gyros.

    `sensitivity`, `sd` (3, 3): and standard deviation, unit of the record per m/s^2.
    """
    unit, per = ("counts/g", G0) if counts else ("deg/s/g", G0 / DEG)
    rows = tuple(
        (
            Quantity("gyro", axis),
            *(
                measured(f"by {other}", sensitivity[i, j] * per, unit, float(sd[i, j]) * per)
                for j, other in enumerate(AXES)
            ),
        )
        for i, axis in enumerate(AXES)
    )
    whole = Quantity("g_sensitivity", sensitivity, "counts/(m/s^2)" if counts else "(rad/s)/(m/s^2)", sd)
    table = Section("", "g-sensitivity of the gyros", rows=rows, note="± 1 sd")
    return Section("", parts=(table, only_json("gyro", whole)))
