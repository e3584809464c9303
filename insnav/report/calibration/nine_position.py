"""Report on the nine-position method."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insnav.lab.calibration import Calibration
from insnav.lab.nine_position.method import AXIS, SENSORS, NinePositions, NineRecord
from insnav.quantity import Quantity
from insnav.report.calibration.common import corrected_section, impact_section, quality_rows, quality_section
from insnav.report.calibration.panels import Series, residual_panels
from insnav.report.numbers import number
from insnav.report.page import Page, Section, drawn, only_json
from insnav.units import DEG, UG

_MG = 1e3 * UG
_RAW = (
    "Every output first became a specific force, by bias and scale factor as printed; calibration.toml is of these "
    "forces, each axis the mean of its two accelerometers.",
)
_INTERVALS = "1 sd of noise; the interval adds what the first order leaves out"
_PLACES = "position, in the order of the file"
_AT_REST = (
    "The gyros turn with the Earth, 15 deg/h in a direction that the positions hardly average: it is in their bias.",
)


def nine_page(calibration: Calibration[NineRecord, NinePositions]) -> Page:
    """Report three dual-axis modules."""
    found, fits = calibration.detail, calibration.fits
    # in the order of the method: each accelerometer, the triad, misalignments of the gyros, and the gyros at rest
    own = slice(6 if calibration.record.unit == "m/s^2" else 12)
    ends = (own.stop, own.stop + 9, own.stop + 15)
    each = (own, slice(ends[0], ends[1]), slice(ends[1], ends[2]), slice(ends[2], None))
    biases, accel, gyro, at_rest = (calibration.parameters[rows] for rows in each)
    raw = calibration.record.unit != "m/s^2"
    scales = " and scale factor" * raw
    panels = residual_panels(_residuals(found, len(calibration.record.dwells.setting)), _PLACES)
    places = [f"roll {roll:.4g}, pitch {pitch:.4g} deg" for roll, pitch in calibration.record.dwells.setting / DEG]
    largest = 1e3 * float(np.abs(found.gyro_matrix - np.eye(3)).max())
    left = 1e3 * float(found.half_width(found.gyro_matrix_sd, first_order=True).max())
    details = only_json(
        "",
        Quantity("condition_accel", found.condition_accel),
        Quantity("condition_gyro", found.condition_gyro),
        Quantity("second_order_allowance", found.second_order),
        Quantity("gyro_diagonal_not_used", found.gyro_diagonal),
    )
    inverses = tuple(
        (Quantity("matrix", name), Quantity("condition", condition), Quantity("positions", which))
        for name, condition, which in (
            ("A_m, accelerometers", found.condition_accel, str(len(places))),
            ("Omega_m, products", found.condition_gyro, "all that are tilted"),
        )
    )
    return Page(
        "Nine positions of three dual-axis modules",
        (
            f"Gyro misalignment up to {number(largest)} mrad, known to ± {number(left, 2)} mrad (95 %); its inverse is "
            "applied by insnav.",
            f"Scatter of one accelerometer value {number(found.sigma / _MG, 2)} mg, {found.dof} degrees of freedom.",
        ),
        (
            drawn("residuals", "Nine positions: accelerometers minus the linear model", panels),
            Section("parameters", f"Bias{scales} of each accelerometer", biases, note=_methods(found)),
            Section("parameters", "Accelerometer triad, each axis the mean of its two accelerometers", accel),
            Section("parameters", "Gyro misalignment", gyro, note=_INTERVALS),
            Section("parameters", "Gyros at rest: bias, and what they feel of the specific force", at_rest),
            Section("", "Pseudo-inverses", rows=inverses),
            quality_section(quality_rows(fits, "m/s^2", dict.fromkeys(SENSORS, places))),
            corrected_section(calibration),
            impact_section(calibration),
            details,
        ),
        calibration.warnings,
        merits_note="x_ay: the accelerometer of module x that points along y",
        method=(
            *(_RAW * raw),
            *(_AT_REST * bool(at_rest)),
            "Valid to first order in the misalignments; errors of second order are up to about "
            f"{number(1e3 * found.second_order, 2)} mrad here and are in the intervals.",
            "The positions are symmetric in ± roll and ± pitch, and exact; their errors are in the residuals.",
            "Gyro and accelerometers of a module turn together.",
            f"The diagonal of M_G ({', '.join(f'{v:.5f}' for v in found.gyro_diagonal)}) carries the scale of the "
            "accelerometers, not of the gyros: each row is divided by it. Gyro scale factors stay unknown, and biases "
            "without the outputs of the gyros.",
            "M_G is the sensitivity of the gyros: its inverse corrects, itself it would double the error.",
        ),
    )


def _residuals(found: NinePositions, places: int) -> Iterator[Series]:
    number, every = np.repeat(np.arange(1.0, places + 1.0), 2), np.ones(2 * places, dtype=np.bool_)
    for axis in range(3):
        left = np.column_stack([found.fits[i].residual / _MG for i in np.flatnonzero(axis == AXIS)]).ravel()
        yield Series(f"both accelerometers {'xyz'[axis]}", "mg", number, left, every, found.sigma / _MG)


def _methods(found: NinePositions) -> str:
    pairs = sorted({"xyz"[axis] for axis, pair in zip(AXIS, found.bias_opposite, strict=True) if pair})
    if not pairs:
        return "by least squares over all positions: no two have an axis along the vertical, up and down"
    return f"{', '.join(pairs)} from the two extreme positions, others by least squares over all"
