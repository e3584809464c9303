"""Accelerometers from the mean outputs of a triad in known positions: full matrix and bias.

``f_measured = B f + b`` by least squares, with the true components of gravity along x, y, z in each position. Six faces
suffice.

References
----------
Titterton, D. and Weston, J., "Strapdown Inertial Navigation Technology", section 8.3.2. IEEE Std 1293.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.imu.model import ImuErrors, RawScale
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import understand
from insnav.input.interpret.schema import schema
from insnav.lab.bench_data import BenchTable, read_bench
from insnav.lab.calibration import (
    WRONG_UNIT,
    BenchOptions,
    Calibration,
    CalibrationSd,
    badly_conditioned,
    common_unit,
    fitted,
)
from insnav.lab.least_squares import Fit, affine_fits
from insnav.types import FloatArray
from insnav.units import G0, UNITS

SCHEMA = schema("positions")
_TRUE, _OUTPUTS = (tuple(f"{name}_{axis}" for axis in "xyz") for name in ("force", "output"))


@dataclass(frozen=True, slots=True)
class Positions:
    """Mean outputs of three accelerometers in known positions."""

    table: BenchTable  # as read
    force: FloatArray  # (n, 3) true specific force [m/s^2]
    output: FloatArray  # (n, 3) in SI units, or in volts or counts
    unit: str  # of the outputs in the file

    @property
    def raw(self) -> bool:
        """True if the outputs are in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def holds_positions(file: str | Path | Table) -> bool:
    """Return whether a table has true and measured components along x, y, z."""
    table = open_table(file)
    found, _ = understand(table.headers, table.units, SCHEMA, where=table.name)
    return {*_TRUE} <= found.keys() and any(key.startswith(("output", "raw")) for key in found)


def read_positions(file: str | Path | Table, how: BenchOptions) -> Positions:
    """Read the positions.

    Raises: InputError: a column is missing, or the outputs have different units.
    """
    raw_too = {key: key.replace("output", "raw") for key in _OUTPUTS}
    table = read_bench(file, SCHEMA, (*_TRUE, *_OUTPUTS), columns=how.columns, alternatives=raw_too)
    keys = [key if key in table.columns else raw_too[key] for key in _OUTPUTS]
    unit = common_unit([(key.replace("_", " "), table.units[key]) for key in keys])
    local = how.gravity / G0 if table.units["force_x"] == "g" else 1.0
    return Positions(table, table.stack(*_TRUE) * local, table.stack(*keys), unit)


def fit_positions(record: Positions, how: BenchOptions) -> Calibration[tuple[Positions], tuple[Fit, ...]]:
    """Fit matrix and bias.

    Raises: InputError: too few positions, or outputs in another unit than their columns state.
    """
    where, raw = record.table.name, record.raw
    found = affine_fits(record.force, record.output, tuple(f"{where}, accelerometer {axis}" for axis in "xyz"))
    matrix, matrix_sd = (np.array([getattr(fit, key)[:3] for fit in found]) for key in ("value", "sd"))
    bias, bias_sd = (np.array([getattr(fit, key)[3] for fit in found]) for key in ("value", "sd"))
    scale = np.diag(matrix).copy()
    if not raw and (wrong := np.abs(scale - 1.0) > WRONG_UNIT).any():
        worst = float(scale[wrong][0])
        code = "lab.output_reversed" if worst < 0.0 else "lab.output_unit"
        raise InputError(code, where=where, scale=worst, unit=record.unit)
    size = np.abs(scale) if raw else np.ones(3)
    given: dict[str, Any] = {"accel_matrix": matrix / scale[:, None] if raw else matrix}
    given |= {"accel_raw": RawScale(record.unit, bias, scale)} if raw else {"accel_bias": bias}
    spread = CalibrationSd(accel_bias=bias_sd / size, accel_matrix=matrix_sd / size[:, None])
    names = (*(f"sensitivity to {axis}" for axis in "xyz"), "bias")
    found = tuple(replace(fit, names=names) for fit in found)
    fits = {f"accelerometer {axis}": fit for axis, fit in zip("xyz", found, strict=True)}
    unit = record.unit if raw else "m/s^2"
    units = [*[f"{unit}/(m/s^2)" if raw else ""] * 3, unit]
    parameters = tuple(each for name, fit in fits.items() for each in fitted(fit, units, name))
    errors = ImuErrors(**given, name=how.name)
    return Calibration("accel", errors, spread, parameters, fits, (record,), found, how, badly_conditioned(fits))
