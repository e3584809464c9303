"""Nine-position method: three dual-axis modules calibrated on a position table, gyros without rotation.

Each module contains one gyro and the two accelerometers across its axis: x module (y, z), y module (z, x), z module (x,
y). The product of its two accelerometers is the component along the gyro's axis of a cross product of specific forces.
The product thus determines the direction of the axis. A are specific forces and Omega such products, each ideal (L) or
measured (m), with one column per position. With the pseudo-inverse ^+,

    M_A = L_A A_m^+                  corrects the accelerometers,
    M_G = Omega_L Omega_m^+          is the sensitivity of the gyros, corrected by its inverse.

For a small rotation of a module, errors of its product and of its gyro cancel, so M_G is valid to first order. The
second-order remainder, a difference of two squares, cancels over positions symmetric in roll and pitch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.imu.model import ErrorTerms, ImuErrors
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import schema
from insnav.lab import calibration
from insnav.lab.bench_data import BenchTable, Dwells, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.calibration import LEVEL, BenchOptions, Calibration, CalibrationSd, Fit
from insnav.quantity import Quantity
from insnav.types import FloatArray, IntArray
from insnav.units import DEG, G0, UG

STANDARD = ((0, 0), (45, 0), (-45, 0), (0, 45), (0, -45), (35, 35), (35, -35), (-35, 35), (-35, -35))  # [deg]
SMALLEST, LARGEST = 20.0 * DEG, 75.0 * DEG  # range of nonzero angles of tilted positions
SAME = 0.5 * DEG  # angles closer than this are equal
OPPOSITE = 1e-3  # an axis whose specific force differs less from 1 g is vertical [g]
WORST_CONDITION = 50.0  # largest condition number of usable positions
SCHEMA = schema("nine_position")
SENSORS = ("x_ay", "x_az", "y_az", "y_ax", "z_ax", "z_ay")
GYROS = ("gyro_x", "gyro_y", "gyro_z")
AXIS = np.array([1, 2, 2, 0, 0, 1])  # sensitive axis of each of `SENSORS`
MODULES = np.array([[0, 1], [2, 3], [4, 5]])  # the two sensors of each module; their product is along its gyro
TRIAD = np.array([[3, 4], [0, 5], [1, 2]])  # the two sensors of each axis x, y, z: their mean counts
SECOND_ORDER = 2.0  # times squared misalignment: 95 % of second-order errors, in simulations of three sets of positions
WEAKEST = 0.01  # a dead accelerometer has a smaller scale factor, relative to the largest of six
_MISFIT = 0.05  # a larger RMS misfit, relative to gravity, means wrong positions: a table set to a degree leaves 0.017
MOST_SENSITIVE, MOST_CROSSED = 0.2, 0.2  # sensitivities farther from 1, or from 0, contradict the column names


def ideal_force(roll: FloatArray, pitch: FloatArray, gravity: float) -> FloatArray:
    """Compute the specific force at rest, (n, 3) [m/s^2], Forward-Right-Down axes.

    ``g [sin(pitch), -cos(pitch) sin(roll), -cos(pitch) cos(roll)]``: minus the third column of the transposed attitude
    matrix times g; Groves (2013), section 5.6.2.

    `roll`, `pitch` (n,): [rad]. `gravity`: [m/s^2].
    """
    cos = np.cos(pitch)
    return gravity * np.column_stack((np.sin(pitch), -cos * np.sin(roll), -cos * np.cos(roll)))


def products(force: FloatArray) -> FloatArray:
    """Compute the product of the two forces across each axis x, y, z, (n, 3): the ideal product of each module."""
    return np.column_stack((force[:, 1] * force[:, 2], force[:, 2] * force[:, 0], force[:, 0] * force[:, 1]))


def opposite_pairs(force: FloatArray, gravity: float) -> tuple[tuple[int, int] | None, ...]:
    """Find, for each axis x, y, z, the positions with this axis up and down: two indices, or None if one is missing.

    `force` (n, 3): ideal forces [m/s^2]. `gravity`: [m/s^2].
    """
    pairs: list[tuple[int, int] | None] = []
    for axis in range(3):
        up, down = int(np.argmax(force[:, axis])), int(np.argmin(force[:, axis]))
        along = min(force[up, axis], -force[down, axis]) > (1.0 - OPPOSITE) * gravity
        pairs.append((up, down) if along else None)
    return tuple(pairs)


def check_positions(roll: FloatArray, pitch: FloatArray, where: str) -> tuple[Finding, ...]:
    """Refuse a set of positions that is asymmetric or leaves parameters undetermined, and name positions to add.

    `roll`, `pitch` (n,): [rad]. Returns findings on unusual but usable positions.
    """
    present = {_key(r, p) for r, p in zip(roll, pitch, strict=True)}
    tilted = np.abs(ideal_force(roll, pitch, 1.0)).max(axis=1) < 1.0 - OPPOSITE
    angles = np.abs(np.concatenate((roll[tilted], pitch[tilted])))
    wrong = (angles > SAME) & ((angles < SMALLEST - SAME) | (angles > LARGEST + SAME))
    if wrong.any():
        raise InputError("lab.table_angle", where=where, angle_rad=float(angles[wrong][0]))
    signs = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
    mirrored = {_key(a * r, b * p) for r, p in zip(roll[tilted], pitch[tilted], strict=True) for a, b in signs}
    missing = sorted(mirrored - _nearby(present))
    if missing:
        raise InputError("lab.positions_asymmetric", where=where, positions=_written(missing[:4]))
    if not _determined(roll, pitch):
        accel, gyro = _conditions(roll, pitch)
        to_add = _written(_to_add(roll, pitch))
        raise InputError(
            "lab.positions_undetermined", where=where, count=len(present), accel=accel, gyro=gyro, positions=to_add
        )
    return calibration.few("positions", len(present), len(STANDARD))


def _key(roll: float, pitch: float) -> tuple[float, float]:
    return round(float(roll / DEG), 1) + 0.0, round(float(pitch / DEG), 1) + 0.0


def _nearby(keys: set[tuple[float, float]]) -> set[tuple[float, float]]:
    """Return all keys within half a degree of the given keys, in steps of 0.1 deg."""
    steps = np.arange(-5, 6) / 10.0
    return {(round(r + a, 1) + 0.0, round(p + b, 1) + 0.0) for r, p in keys for a in steps for b in steps}


def _written(keys: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    return tuple(f"{roll:g}°/{pitch:g}°" for roll, pitch in keys)


def _designs(roll: FloatArray, pitch: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Build the design matrices of an accelerometer, and of the gyros."""
    force = ideal_force(roll, pitch, 1.0)
    return np.column_stack((force, np.ones(len(force)))), products(force)


def _conditions(roll: FloatArray, pitch: FloatArray) -> tuple[float, float]:
    """Compute the condition numbers of `_designs`, columns scaled to length 1; infinite with a zero column."""

    def of(design: FloatArray) -> float:
        lengths = np.linalg.norm(design, axis=0)
        return float(np.linalg.cond(design / lengths)) if (lengths > 0.0).all() else float("inf")

    accel, gyro = _designs(roll, pitch)
    return of(accel), of(gyro)


def _determined(roll: FloatArray, pitch: FloatArray) -> bool:
    return roll.size > 5 and max(_conditions(roll, pitch)) < WORST_CONDITION


def _to_add(roll: FloatArray, pitch: FloatArray) -> list[tuple[float, float]]:
    """List standard positions that complete the set: groups of mirror images, the best first."""
    groups = [STANDARD[5:], STANDARD[1:3], STANDARD[3:5], STANDARD[:1]]
    added: list[tuple[float, float]] = []

    def score(group: tuple[tuple[int, int], ...]) -> float:
        angles = [
            np.concatenate((angle, extra)) for angle, extra in zip((roll, pitch), np.array(group).T * DEG, strict=True)
        ]
        # condition numbers are infinite while a design is singular: compare ranks first
        lack = 7 - sum(int(np.linalg.matrix_rank(design)) for design in _designs(*angles))
        return 1e6 * lack + sum(min(condition, 1e5) for condition in _conditions(*angles))

    while groups and not _determined(roll, pitch):
        group = groups.pop(min((score(group), index) for index, group in enumerate(groups))[1])
        added += [(float(r), float(p)) for r, p in group]
        roll, pitch = (
            np.concatenate((old, new)) for old, new in zip((roll, pitch), np.array(group).T * DEG, strict=True)
        )
    return added


@dataclass(frozen=True, slots=True)
class NineRecord:
    """Table of positions as read, with one mean per position: roll and pitch [rad], outputs."""

    table: BenchTable
    dwells: Dwells  # outputs of accelerometers in `unit`, then of gyros, if present, in `gyro_unit`
    unit: str  # m/s^2, or the unit of raw outputs
    gyro_unit: str  # rad/s, or the unit of raw outputs; empty without gyros


@dataclass(frozen=True, slots=True)
class NinePositions:
    """Results of the nine-position method."""

    bias: FloatArray  # (6,) bias of each accelerometer, in the order of `SENSORS` [m/s^2]
    bias_opposite: tuple[bool, ...]  # for each: True if from two opposite positions; False: from all positions
    accel_bias: FloatArray  # (3,) bias of the triad, each axis the mean of its two accelerometers [m/s^2]
    accel_matrix: FloatArray  # (3, 3) sensitivity of that triad, the inverse of M_A [-]
    # (3, 3) M_G, each row divided by its diagonal element, which has scale factors of accelerometers, not of gyros [-]
    gyro_matrix: FloatArray
    gyro_diagonal: FloatArray  # (3,) diagonal of M_G before this division [-]
    bias_sd: FloatArray  # standard deviations of `bias`, `accel_bias`, `accel_matrix`, `gyro_matrix`
    accel_bias_sd: FloatArray
    accel_matrix_sd: FloatArray
    gyro_matrix_sd: FloatArray
    # allowance for second-order effects: `SECOND_ORDER` times the square of the largest accelerometer misalignment [-]
    second_order: float
    sigma: float  # standard deviation of one accelerometer output in one position [m/s^2]
    dof: int  # degrees of freedom of `sigma`
    fits: tuple[Fit, ...]  # fit of each accelerometer to the ideal forces
    condition_accel: float  # condition numbers of the two pseudo-inverses
    condition_gyro: float
    warnings: tuple[Finding, ...]

    def half_width(self, sd: FloatArray, *, first_order: bool) -> FloatArray:
        """Compute the half width of 95 % intervals.

        `sd`: one of the standard deviations. `first_order`: the estimate is valid to first order only, like the gyro
        matrix: add the allowance for second-order effects.
        """
        return sd * calibration.coverage_factor(self.dof, LEVEL) + (self.second_order if first_order else 0.0)


def calibrate_nine(
    roll: FloatArray, pitch: FloatArray, measured: FloatArray, gravity: float, *, where: str = ""
) -> NinePositions:
    """Calibrate three dual-axis modules.

    `roll`, `pitch` (n,): positions of the table [rad], Forward-Right-Down axes. `measured` (n, 6): accelerometers in
    the order of `SENSORS` [m/s^2]. `gravity`: local gravity [m/s^2].
    Raises: InputError: undetermined parameters, with positions to add; or columns that contradict their names.
    """
    warnings = check_positions(roll, pitch, where)
    force = ideal_force(roll, pitch, gravity)
    fits = calibration.affine_fits(force, measured, [f"{where}, {sensor}" for sensor in SENSORS])
    _refuse_exchanged(fits, where)
    dof = sum(fit.dof for fit in fits)
    sigma = float(np.sqrt(sum(np.sum(fit.residual**2) for fit in fits) / dof))
    if sigma > _MISFIT * gravity:
        worst = int(np.argmax(np.sum([fit.residual**2 for fit in fits], axis=0)))
        raise InputError(
            "lab.positions_misfit", where=where, error_m_s2=sigma, roll_rad=roll[worst], pitch_rad=pitch[worst]
        )
    pairs = opposite_pairs(force, gravity)
    # tilted positions: with an axis vertical, every product is zero
    gyro_rows = np.flatnonzero(np.abs(force).max(axis=1) <= (1.0 - OPPOSITE) * gravity)

    def estimate(values: FloatArray) -> FloatArray:
        return _estimate(values.reshape(measured.shape), force, pairs, gyro_rows)

    estimates = estimate(measured)
    base, step = measured.ravel(), 1e-4 * gravity
    slopes = [(estimate(base + shift) - estimate(base - shift)) / (2.0 * step) for shift in step * np.eye(base.size)]
    sd = sigma * np.linalg.norm(slopes, axis=0)
    raw_gyro = estimates[18:27].reshape(3, 3)
    gyro, gyro_sd = raw_gyro / np.diag(raw_gyro)[:, None], sd[27:36].reshape(3, 3)
    unbiased = measured - estimates[:6]
    return NinePositions(
        bias=estimates[:6],
        bias_opposite=tuple(pairs[axis] is not None for axis in AXIS),
        accel_bias=estimates[6:9],
        accel_matrix=estimates[9:18].reshape(3, 3),
        gyro_matrix=gyro,
        gyro_diagonal=np.diag(raw_gyro).copy(),
        bias_sd=sd[:6],
        accel_bias_sd=sd[6:9],
        accel_matrix_sd=sd[9:18].reshape(3, 3),
        gyro_matrix_sd=gyro_sd,
        second_order=SECOND_ORDER
        * max(float(np.abs(_crossed(fit, axis)).max()) for fit, axis in zip(fits, AXIS, strict=True)) ** 2,
        sigma=sigma,
        dof=dof,
        fits=fits,
        condition_accel=float(np.linalg.cond(unbiased[:, TRIAD].mean(axis=2))),
        condition_gyro=float(np.linalg.cond(unbiased[gyro_rows][:, MODULES].prod(axis=2))),
        warnings=warnings,
    )


def _estimate(
    measured: FloatArray, force: FloatArray, pairs: tuple[tuple[int, int] | None, ...], gyro_rows: IntArray
) -> FloatArray:
    """Estimate biases, accelerometer triad, M_G, and M_G by rows of diagonal 1, in order."""
    bias = np.linalg.lstsq(np.column_stack((force, np.ones(len(force)))), measured, rcond=None)[0][3]
    for sensor, axis in enumerate(AXIS):
        pair = pairs[axis]
        if pair is not None:
            bias[sensor] = 0.5 * (measured[pair[0], sensor] + measured[pair[1], sensor])
    unbiased = measured - bias
    correction = np.linalg.lstsq(unbiased[:, TRIAD].mean(axis=2), force, rcond=None)[0].T  # M_A, L_A A_m^+
    measured_products = unbiased[gyro_rows][:, MODULES].prod(axis=2)
    gyro = np.linalg.lstsq(measured_products, products(force)[gyro_rows], rcond=None)[0].T  # Omega_L Omega_m^+
    triad, normalised = np.linalg.inv(correction), gyro / np.diag(gyro)[:, None]
    return np.concatenate((bias, bias[TRIAD].mean(axis=1), triad.ravel(), gyro.ravel(), normalised.ravel()))


def _crossed(fit: Fit, axis: int) -> FloatArray:
    """Return the cross-axis sensitivities of an accelerometer, (2,) [-]."""
    return np.delete(fit.value[:3], axis)


def _refuse_exchanged(fits: tuple[Fit, ...], where: str) -> None:
    for sensor, axis, fit in zip(SENSORS, AXIS, fits, strict=True):
        own_axis, cross = float(fit.value[axis]), _crossed(fit, axis)
        if abs(own_axis - 1.0) > MOST_SENSITIVE or np.abs(cross).max() > MOST_CROSSED:
            raise InputError(
                "lab.accel_crossed", where=where, column=sensor, axis="xyz"[axis], values=tuple(fit.value[:3].tolist())
            )


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> NineRecord:
    """Read a table of nine-position data.

    `files`: one file, with ``roll_deg``, ``pitch_deg`` and ``x_ay`` to ``z_ay`` (module, then axis) in any unit of
    acceleration or in volts. Optional gyros at rest, ``gyro_x`` to ``gyro_z``. One row per position, or all its samples
    in successive rows. `how`: columns. Raises: InputError: the file cannot be used.
    """
    raw = {sensor: f"{sensor}_raw" for sensor in SENSORS}
    table = read_bench(files[0], SCHEMA, ("roll", "pitch", *SENSORS), columns=how.columns, alternatives=raw)
    unit, accel = _outputs(table, SENSORS, "m/s^2")
    has_gyros = any(f"{name}{end}" in table.columns for name in GYROS for end in ("", "_raw"))
    gyro_unit, gyro = _outputs(table, GYROS, "rad/s") if has_gyros else ("", accel[:, :0])
    settings, time = table.stack("roll", "pitch"), table.get("time")
    reduced = [
        reduce_dwells(settings, values, default_limit(output_unit), time, where=table.name)
        for values, output_unit in ((accel, unit), (gyro, gyro_unit or unit))
    ]
    value, sd, dropped = (np.hstack([getattr(part, name) for part in reduced]) for name in ("value", "sd", "dropped"))
    return NineRecord(table, replace(reduced[0], value=value, sd=sd, dropped=dropped), unit, gyro_unit)


def _outputs(table: BenchTable, names: Sequence[str], unit: str) -> tuple[str, FloatArray]:
    """Return the unit of outputs, `unit` or a raw one, and their columns, (n, k)."""
    keys = [name if name in table.columns else f"{name}_raw" for name in names]
    missing = [name for name, key in zip(names, keys, strict=True) if key not in table.columns]
    if missing:
        raise InputError("lab.gyro_column_missing", where=table.name, columns=tuple(missing))
    raw = [(key, table.units[key] if key.endswith("_raw") else unit) for key in keys]
    return calibration.common_unit(raw), table.stack(*keys)


def fit(record: NineRecord, how: BenchOptions) -> Calibration[NineRecord, NinePositions]:
    """Calibrate the modules; see `calibrate_nine`."""
    table, dwells = record.table, record.dwells
    roll, pitch = dwells.setting.T
    output, rates = dwells.value[:, :6], dwells.value[:, 6:]
    force = ideal_force(roll, pitch, how.gravity)
    scale, zero = np.ones(6), np.zeros(6)
    if record.unit != "m/s^2":  # each raw output is first converted by a fitted line, then calibrated like an SI output
        lines = calibration.affine_fits(force, output, [f"{table.name}, {sensor}" for sensor in SENSORS])
        scale = np.array([line.value[axis] for line, axis in zip(lines, AXIS, strict=True)])
        zero = np.array([line.value[3] for line in lines])
        if not np.abs(scale).min() > WEAKEST * np.abs(scale).max():
            raise InputError("lab.accel_dead", where=table.name, column=SENSORS[int(np.argmin(np.abs(scale)))])
    result = calibrate_nine(roll, pitch, (output - zero) / scale, how.gravity, where=table.name)
    fits = dict(zip(SENSORS, result.fits, strict=True))
    gyros = _gyros_at_rest(force, rates, table.name)
    bias = result.accel_bias if record.unit == "m/s^2" else np.zeros(3)
    errors = ImuErrors(gyro_matrix=result.gyro_matrix, accel_bias=bias, accel_matrix=result.accel_matrix, name=how.name)
    sd = CalibrationSd(
        gyro_matrix=result.gyro_matrix_sd, accel_bias=result.accel_bias_sd, accel_matrix=result.accel_matrix_sd
    )
    if record.gyro_unit == "rad/s":
        value, spread = (np.array([getattr(line, name) for line in gyros.values()]) for name in ("value", "sd"))
        errors = replace(errors, gyro_bias=value[:, 0], gyro_terms=ErrorTerms(g_sensitivity=value[:, 1:]))
        sd = replace(sd, gyro_bias=spread[:, 0], g_sensitivity=spread[:, 1:])
    parameters = (*_parameters(result, record.unit, zero, scale), *_gyro_parameters(gyros, record.gyro_unit))
    spiky = dwell_warnings(dwells, (*SENSORS, *GYROS)[: dwells.value.shape[1]], table.get("temperature"))
    warnings = (*result.warnings, *spiky, *calibration.badly_conditioned(fits))
    return Calibration("nine", errors, sd, parameters, fits, record, result, how, warnings)


def _gyros_at_rest(force: FloatArray, rates: FloatArray, where: str) -> dict[str, Fit]:
    """Fit the output of each gyro at rest against specific force: bias and g-sensitivity."""
    design = np.column_stack((np.ones(len(force)), force))
    names = ("bias", "g-sensitivity to x", "to y", "to z")
    return {
        name: calibration.linear_fit(design, column, names, where=f"{where}, {name}")
        for name, column in zip(GYROS, rates.T, strict=False)
    }


def _gyro_parameters(gyros: Mapping[str, Fit], unit: str) -> tuple[Quantity, ...]:
    """Build bias and g-sensitivity of each gyro, in deg/s and deg/s/g, or in the unit of raw outputs, and per g."""
    shown, factor = ("deg/s", DEG) if unit == "rad/s" else (unit, 1.0)
    kinds = (("bias", shown, 1.0), *((f"feels {axis}", f"{shown}/g", G0) for axis in "xyz"))
    items = []
    for name, line in gyros.items():
        for (quantity, unit_text, per), *row in zip(kinds, line.value, line.sd, line.half_width(), strict=True):
            value, *spread = (float(figure) * per / factor for figure in row)
            items.append(calibration.measured(f"{name} {quantity}", value, unit_text, *spread))
    return tuple(items)


def _parameters(found: NinePositions, unit: str, zero: FloatArray, scale: FloatArray) -> tuple[Quantity, ...]:
    """Build bias of each accelerometer, scale factors and misalignments of the triad, gyro misalignments.

    `unit`: unit of the outputs. `zero`, `scale` (6,): of each output, [unit], [unit/(m/s^2)]. Raw outputs have their
    own scale factor with their bias.
    """
    items = []
    half = found.half_width(found.bias_sd, first_order=False)
    shown, factor = ("mg", 1e3 * UG) if unit == "m/s^2" else (unit, 1.0)
    for sensor, z, k, *values in zip(SENSORS, zero, scale, found.bias, found.bias_sd, half, strict=True):
        bias, sd, width = (abs(k) * value / factor for value in values)
        items.append(calibration.measured(f"{sensor} bias", z + np.sign(k) * bias, shown, sd, width))
    if unit != "m/s^2":
        for sensor, axis, line, k in zip(SENSORS, AXIS, found.fits, scale, strict=True):
            value, *spread = (
                G0 * float(figure) for figure in (k, *(abs(k) * e[axis] for e in (line.sd, line.half_width())))
            )
            items.append(calibration.measured(f"{sensor} scale factor", value, f"{unit}/g", *spread))
    half = found.half_width(found.accel_matrix_sd, first_order=False)
    diagonal = [("accel", i, i) for i in range(3)]
    crossed = [(sensor, i, j) for sensor in ("accel", "gyro") for i in range(3) for j in range(3) if i != j]
    gyro_half = found.half_width(found.gyro_matrix_sd, first_order=True)
    results = {
        "accel": (found.accel_matrix - np.eye(3), found.accel_matrix_sd, half),
        "gyro": (found.gyro_matrix, found.gyro_matrix_sd, gyro_half),
    }
    for sensor, i, j in (*diagonal, *crossed):
        name, per, shown = ("scale factor error", 1e6, "ppm") if i == j else (f"senses {'xyz'[j]}", 1e3, "mrad")
        value, *spread = (per * float(matrix[i, j]) for matrix in results[sensor])
        items.append(calibration.measured(f"{sensor} {'xyz'[i]} {name}", value, shown, *spread))
    return tuple(items)
