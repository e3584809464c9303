"""Accelerometers in gravity: tumble test of one at a time, and means of a triad in known positions.

Tumble test: U = K0 + K1 ai + K2 ai^2 + K3 ai ao with ai = sin(theta) along and ao = cos(theta) across the input axis,
in units of local gravity. This is the model of IEEE Std 1293, section on the multipoint tumble test, without terms of
third order. Positions: ``f_measured = B f + b`` by least squares; six faces suffice (D. Titterton and J. Weston,
"Strapdown Inertial Navigation Technology", section 8.3.2; IEEE Std 1293).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.imu.model import ImuErrors, RawScale
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.interpret.columns import understand
from insnav.input.interpret.physics import UNCALIBRATED
from insnav.input.interpret.schema import schema
from insnav.lab import calibration
from insnav.lab.bench_data import BenchTable, read_bench
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, Fit, affine_fits, badly_conditioned
from insnav.lab.single_axis.rate_table import Record, read_records, refuse_unit, triad_calibration
from insnav.types import FloatArray, IntArray
from insnav.units import DEG, G0, UNITS

POSITIONS = schema("positions")
_TRUE, _OUTPUTS = (tuple(f"{name}_{axis}" for axis in "xyz") for name in ("force", "output"))
NAMES = ("bias K0", "scale factor K1", "second order K2", "cross-coupling K3")
FEWEST = 6  # least number of positions: four unknowns, and redundancy for their uncertainty
USUAL = 12  # usual number of positions
HIGHEST = 4  # highest order of the harmonics
EVEN = 0.25  # largest excess of an angle step over the median step, relative to the median step
SCHEMA = schema("tumble")


@dataclass(frozen=True, slots=True)
class Positions:
    """Mean outputs of three accelerometers in known positions."""

    table: BenchTable  # table of the file, as read
    force: FloatArray  # (n, 3) true specific force [m/s^2]
    output: FloatArray  # (n, 3) in SI units, or in volts or counts
    unit: str  # unit of the outputs in the file

    @property
    def raw(self) -> bool:
        """True if the outputs are in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def holds_positions(file: str | Path | Table) -> bool:
    """Return whether a table has positions: three outputs, or three true forces and at least one output."""
    table = open_table(file)
    columns, _ = understand(table.headers, table.units, POSITIONS, where=table.name)
    outputs = {key.replace("raw", "output") for key in columns}
    return {*_OUTPUTS} <= outputs or ({*_TRUE} <= columns.keys() and bool({*_OUTPUTS} & outputs))


def _completed(file: str | Path | Table, columns: Mapping[str, str] | None) -> Table:
    """Add units of specific forces, and true forces of six faces, if the file lacks them; gravity determines both.

    In each position one axis is vertical: of the three outputs, its output is closest to an end of its range.
    """
    table = open_table(file)
    columns_found, _ = understand(table.headers, table.units, POSITIONS, columns=columns, where=table.name)
    units, values = [*(table.units or [""] * len(table.headers))], list[FloatArray]()
    for keys in (_TRUE, _OUTPUTS):
        numbers = [columns_found[key].index for key in keys if key in columns_found]
        values.append(np.column_stack([*table.cells.read(numbers).columns.values()] or [np.empty(0)]))
        if len(numbers) == 3 and not any(columns_found[key].unit for key in keys):
            norm = float(np.median(np.linalg.norm(values[-1], axis=1)))
            candidates = [unit for unit in ("g", "m/s^2") if abs(norm * UNITS[unit][1] / G0 - 1.0) < UNCALIBRATED]
            units = [candidates[0] if candidates and i in numbers else unit for i, unit in enumerate(units)]
    true, output = values
    if true.size or len(numbers) < 3:
        return replace(table, units=tuple(units))
    deviation = output - 0.5 * (output.max(axis=0) + output.min(axis=0))
    deviation /= np.maximum(np.abs(deviation).max(axis=0), 1e-300)
    force = np.sign(deviation) * (np.abs(deviation) == np.abs(deviation).max(axis=1, keepdims=True))
    if len(np.unique(force, axis=0)) < FEWEST:
        return replace(table, units=tuple(units))
    headers = *(f"{key}_g" for key in _TRUE), *(table.headers[i] for i in numbers)
    cells = ArrayCells(tuple(np.ascontiguousarray(np.hstack([force, output]).T)), table.cells.line)
    return replace(table, headers=headers, units=("", "", "", *(units[i] for i in numbers)), cells=cells)


def read_positions(file: str | Path | Table, how: BenchOptions) -> Positions:
    """Read the positions of a triad. Raises: InputError: a column is missing, or the outputs have different units."""
    raw_too = {key: key.replace("output", "raw") for key in _OUTPUTS}
    file = _completed(file, how.columns)
    table = read_bench(file, POSITIONS, (*_TRUE, *_OUTPUTS), columns=how.columns, alternatives=raw_too)
    keys = [key if key in table.columns else raw_too[key] for key in _OUTPUTS]
    unit = calibration.common_unit([(key.replace("_", " "), table.units[key]) for key in keys])
    local = how.gravity / G0 if table.units["force_x"] == "g" else 1.0
    return Positions(table, table.stack(*_TRUE) * local, table.stack(*keys), unit)


def fit_positions(record: Positions, how: BenchOptions) -> Calibration[tuple[Positions], tuple[Fit, ...]]:
    """Fit sensitivity matrix and bias of three accelerometers to their outputs in known positions.

    Raises: InputError: too few positions, or outputs in another unit than their columns state.
    """
    where, raw = record.table.name, record.raw
    axis_fits = affine_fits(record.force, record.output, tuple(f"{where}, accelerometer {axis}" for axis in "xyz"))
    matrix, matrix_sd = (np.array([getattr(fit, key)[:3] for fit in axis_fits]) for key in ("value", "sd"))
    bias, bias_sd = (np.array([getattr(fit, key)[3] for fit in axis_fits]) for key in ("value", "sd"))
    scale = np.diag(matrix).copy()
    if not raw and (wrong := np.abs(scale - 1.0) > calibration.WRONG_UNIT).any():
        worst = float(scale[wrong][0])
        code = "lab.output_reversed" if worst < 0.0 else "lab.output_unit"
        raise InputError(code, where=where, scale=worst, unit=record.unit)
    gain = np.abs(scale) if raw else np.ones(3)
    known_errors: dict[str, Any] = {"accel_matrix": matrix / scale[:, None] if raw else matrix}
    known_errors |= {"accel_raw": RawScale(record.unit, bias, scale)} if raw else {"accel_bias": bias}
    spread = CalibrationSd(accel_bias=bias_sd / gain, accel_matrix=matrix_sd / gain[:, None])
    names = (*(f"sensitivity to {axis}" for axis in "xyz"), "bias")
    axis_fits = tuple(replace(fit, names=names) for fit in axis_fits)
    fits = {f"accelerometer {axis}": fit for axis, fit in zip("xyz", axis_fits, strict=True)}
    unit = record.unit if raw else "m/s^2"
    units = [*[f"{unit}/(m/s^2)" if raw else ""] * 3, unit]
    parameters = tuple(parameter for name, fit in fits.items() for parameter in calibration.fitted(fit, units, name))
    errors = ImuErrors(**known_errors, name=how.name)
    return Calibration("accel", errors, spread, parameters, fits, (record,), axis_fits, how, badly_conditioned(fits))


@dataclass(frozen=True, slots=True)
class Tumble:
    """Tumble test of one accelerometer, with the fitted model."""

    angle: FloatArray  # (n,) angle of the input axis above the horizontal [rad]
    output: FloatArray  # (n,) output at each position, in volts or counts
    fit: Fit  # K0, K1, K2, K3 in the unit of the output over powers of g
    suspicious: tuple[int, ...]  # rows with an improbably large residual


def calibrate_tumble(angle: FloatArray, output: FloatArray, *, where: str = "") -> Tumble:
    """Fit the tumble-test model of one accelerometer.

    `angle` (n,): angle of the input axis above the horizontal [rad], evenly spaced over the circle. `output` (n,):
    output at each angle, in volts or counts.
    Raises: InputError: a position is missing, the angles look like another unit, or the output does not follow gravity.
    """
    _refuse_uneven(angle, where)
    along, across = np.sin(angle), np.cos(angle)
    design = np.column_stack((np.ones_like(angle), along, along**2, along * across))
    fit = calibration.linear_fit(design, output, NAMES, where=where)
    if abs(fit.value[1]) < 5.0 * fit.sd[1]:
        raise InputError("lab.gravity_ignored", where=where, scale=fit.value[1], scale_sd=fit.sd[1])
    return Tumble(angle, output, fit, calibration.outliers(fit, design))


@dataclass(frozen=True, slots=True)
class Harmonics:
    """Fourier series of the output over the angle, ``a0 + sum a_n cos(n theta) + b_n sin(n theta)``."""

    order: IntArray  # (m,) orders of the harmonics: 0, 1, 2 and more if the positions suffice, up to `HIGHEST`
    cosine: FloatArray  # (m,) a_n, in the unit of the output like b_n and sd
    sine: FloatArray  # (m,) b_n; zero for order 0
    sd: float  # standard deviation of each coefficient except a0, from the residual; NaN without redundancy
    model: FloatArray  # (4,) K0, K1, K2, K3 computed from the harmonics alone

    @property
    def misalignment(self) -> float:
        """Misalignment between table zero and input axis, ``a1 / b1`` [rad]."""
        return float(self.cosine[1] / self.sine[1])


def harmonics(angle: FloatArray, output: FloatArray) -> Harmonics:
    """Compute Fourier coefficients of a tumble test by least squares; for even positions a discrete Fourier transform.

    `angle` (n,): [rad], evenly spaced over the circle; `output` (n,).

    Notes
    -----
    The model has only ``a0 = K0 + K2 / 2``, ``b1 = K1``, ``a2 = -K2 / 2``, ``b2 = K3 / 2``. A coefficient `a1` means a
    misalignment; orders from 3 on mean non-linearity and position errors (IEEE Std 1293, multipoint tumble test).
    """
    positions = np.unique(np.round(np.mod(angle, 2.0 * np.pi), 9)).size
    order = np.arange(min(HIGHEST, (positions - 1) // 2) + 1)
    phases = np.outer(angle, order[1:])
    design = np.column_stack((np.ones_like(angle), np.cos(phases), np.sin(phases)))
    coefficients, *_ = np.linalg.lstsq(design, output, rcond=None)
    residual, dof = output - design @ coefficients, angle.size - design.shape[1]
    sd = float(np.sqrt(2.0 * np.sum(residual**2) / (dof * angle.size))) if dof > 0 else float("nan")
    orders = order.size
    cosine, sine = coefficients[:orders], np.concatenate(([0.0], coefficients[orders:]))
    model = np.array([cosine[0] + cosine[2], sine[1], -2.0 * cosine[2], 2.0 * sine[2]])
    return Harmonics(order, cosine, sine, sd, model)


def _refuse_uneven(angle: FloatArray, where: str) -> None:
    if not np.isfinite(angle).all():
        raise InputError("lab.value_missing", where=where, row=int(np.argmin(np.isfinite(angle))) + 1)
    places = np.unique(np.round(np.mod(angle, 2.0 * np.pi), 9))
    if places.size < FEWEST:
        raise InputError("lab.few_angles", where=where, count=places.size, limit=FEWEST, usual=USUAL)
    if np.ptp(angle) < 10.0 * DEG:
        raise InputError("lab.angles_not_degrees", where=where, span_rad=np.ptp(angle))
    gaps = np.diff(places, append=places[0] + 2.0 * np.pi)
    step = float(np.median(gaps))
    wide = np.flatnonzero(gaps > (1.0 + EVEN) * step)
    if wide.size:
        missing = [
            float(np.mod(places[i] + step * (k + 1), 2.0 * np.pi))
            for i in wide
            for k in range(max(1, round(float(gaps[i]) / step) - 1))
        ]
        raise InputError(
            "lab.position_missing", where=where, step_rad=step, gaps=wide.size, missing_rad=tuple(missing[:8])
        )


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> tuple[Record, ...] | Positions:
    """Read the tumble tests of accelerometers x, y, z, or of one, or the positions of a triad; see `read_records`."""
    if len(files) == 1 and holds_positions(files[0]):
        return read_positions(files[0], how)
    return read_records(files, SCHEMA, how)


def fit(record: tuple[Record, ...] | Positions, how: BenchOptions) -> Calibration[Any, Any]:
    """Fit the model of accelerometers x, y, z, or of one for all; the calibration file omits K2 and K3."""
    if isinstance(record, Positions):
        return fit_positions(record, how)
    fits = tuple(calibrate_accel(item) for item in record)
    units = ("", "/g", "/g^2", "/g^2")
    return triad_calibration("accel", record, fits, how.gravity, units, how, [tumble_warnings(item) for item in fits])


def calibrate_accel(record: Record) -> Tumble:
    """Fit the tumble-test model of one accelerometer to its bench file.

    Raises: InputError: see `calibrate_tumble`; or a digital output in another unit than its column states.
    """
    tumble = calibrate_tumble(record.setting, record.output, where=record.table.name)
    refuse_unit(record, float(tumble.fit.value[1]) / G0)
    return tumble


def tumble_warnings(found: Tumble) -> tuple[Finding, ...]:
    """Report problems of a usable tumble test."""
    suspicious = (calibration.outlier(found.fit, row, angle_rad=float(found.angle[row])) for row in found.suspicious)
    return (*calibration.few("positions", found.angle.size, USUAL), *suspicious)
