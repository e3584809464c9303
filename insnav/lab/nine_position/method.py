"""Nine positions: three dual-axis modules calibrated on a position table, gyros without any rotation.

Each module holds one gyro and the two accelerometers across its axis: x module (y, z), y module (z, x), z module
(x, y). The product of its two accelerometers is the component along the gyro's axis of a cross product of specific
forces, and so shows where that axis points. With ideal values L and measured m, one column a position,

    M_A = L_A A_m^+                  corrects the accelerometers,
    M_G = Omega_L Omega_m^+          is the sensitivity of the gyros, corrected by its inverse.

For a small turn of a module its product loses exactly what its gyro gains, so M_G holds to first order; what is left of
that order, the difference of two squares, cancels over positions that are symmetric in roll and pitch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.imu.model import ImuErrors
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity as Column
from insnav.lab.bench_data.bench_tables import BenchTable, read_bench
from insnav.lab.bench_data.dwells import Dwells, dwell_warnings, reduce_dwells
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, condition_warnings, measured
from insnav.lab.least_squares import LEVEL, Fit, coverage_factor, linear_fit
from insnav.lab.nine_position.table_positions import OPPOSITE, check_positions, ideal_force, opposite_pairs
from insnav.quantity import Quantity
from insnav.types import FloatArray, IntArray
from insnav.units import UG

SCHEMA = (
    Column("roll", "roll_deg", "angle", "deg", ("roll", "gamma", "rotationx")),
    Column("pitch", "pitch_deg", "angle", "deg", ("pitch", "theta", "rotationy")),
    *(
        Column(f"{m}_a{a}", f"{m}_a{a}_m_s2", "acceleration", "m/s^2", (f"{m}a{a}", f"{m}accel{a}", f"{m}modulea{a}"))
        for m, a in ("xy", "xz", "yz", "yx", "zx", "zy")
    ),
)
SENSORS = ("x_ay", "x_az", "y_az", "y_ax", "z_ax", "z_ay")
AXIS = np.array([1, 2, 2, 0, 0, 1])  # of each sensor
PRODUCTS = ((0, 1), (2, 3), (4, 5))  # the two sensors of each module
TRIAD = ((3, 4), (0, 5), (1, 2))  # the two sensors of each axis
SECOND_ORDER = 2.0  # covers 95 % of the errors of second order in simulations of three common sets of positions
MOST_SENSITIVE, MOST_CROSSED = 0.2, 0.2  # farther from 1, or from 0, the columns are not what they are stated to be


@dataclass(frozen=True, slots=True)
class NineRecord:
    """The table of positions as read, and one mean a position: roll and pitch [rad], accelerometers [m/s^2]."""

    table: BenchTable
    dwells: Dwells


@dataclass(frozen=True, slots=True)
class NinePositions:
    """What nine positions show."""

    bias: FloatArray  # (6,) of each accelerometer, in the order of `SENSORS` [m/s^2]
    bias_methods: tuple[str, ...]  # how each was found
    accel_bias: FloatArray  # (3,) of the triad, each axis the mean of its two accelerometers [m/s^2]
    accel_matrix: FloatArray  # (3, 3) sensitivity of that triad, the inverse of M_A [-]
    # (3, 3) M_G, each row divided by its diagonal, which holds scale of accelerometers and not of gyros [-]
    gyro_matrix: FloatArray
    gyro_diagonal: FloatArray  # (3,) diagonal of M_G before that [-]
    bias_sd: FloatArray  # standard deviations of the same
    accel_bias_sd: FloatArray
    accel_matrix_sd: FloatArray
    gyro_matrix_sd: FloatArray
    # allowance for what the first order leaves out: `SECOND_ORDER` times the square of the largest misalignment of
    # any accelerometer [-]
    second_order: float
    sigma: float  # standard deviation of one value of one accelerometer [m/s^2]
    dof: int  # its degrees of freedom
    fits: tuple[Fit, ...]  # each accelerometer against the ideal forces
    condition_accel: float  # condition numbers of the two pseudo-inverses
    condition_gyro: float
    warnings: tuple[str, ...]

    def half_width(self, sd: FloatArray, *, first_order: bool) -> FloatArray:
        """Half width of 95 % intervals.

        sd: one of the standard deviations; first_order: whether to allow for what the first order leaves out, as for
        the gyros.
        """
        return sd * coverage_factor(self.dof, LEVEL) + (self.second_order if first_order else 0.0)


def calibrate_nine(
    roll: FloatArray, pitch: FloatArray, measured: FloatArray, gravity: float, *, where: str = ""
) -> NinePositions:
    """Calibrate three dual-axis modules.

    `roll`, `pitch` (n,): positions of the table [rad], Forward-Right-Down axes; `measured` (n, 6): accelerometers in
    the order of `SENSORS` [m/s^2]; `gravity`: local gravity [m/s^2].
    Raises: InputError: positions that leave something undetermined, with the one to add; or columns that do not belong
    to their names.
    """
    warnings = check_positions(roll, pitch, where)
    force = ideal_force(roll, pitch, gravity)
    fits = _affine(force, measured, where)
    _refuse_exchanged(fits, where)
    dof = sum(fit.dof for fit in fits)
    sigma = float(np.sqrt(sum(np.sum(fit.residual**2) for fit in fits) / dof))
    pairs = opposite_pairs(force, gravity)
    gyro_rows = _tilted(force, gravity)

    def estimate(values: FloatArray) -> FloatArray:
        return _estimate(values.reshape(measured.shape), force, pairs, gyro_rows)

    found = estimate(measured.ravel())
    sd = sigma * np.linalg.norm(_jacobian(estimate, measured.ravel(), 1e-4 * gravity), axis=1)
    raw_gyro = found[18:27].reshape(3, 3)
    gyro, gyro_sd = raw_gyro / np.diag(raw_gyro)[:, None], sd[27:36].reshape(3, 3)
    free = measured - found[:6]
    methods = tuple("opposite positions" if pairs[axis] is not None else "least squares" for axis in AXIS)
    return NinePositions(
        bias=found[:6],
        bias_methods=methods,
        accel_bias=found[6:9],
        accel_matrix=found[9:18].reshape(3, 3),
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
        condition_accel=float(np.linalg.cond(_triad(free))),
        condition_gyro=float(np.linalg.cond(_products(free[gyro_rows]))),
        warnings=warnings,
    )


def _estimate(
    measured: FloatArray, force: FloatArray, pairs: tuple[tuple[int, int] | None, ...], gyro_rows: IntArray
) -> FloatArray:
    """Biases, accelerometer triad, M_G and M_G by rows of diagonal 1, one after another."""
    design = np.column_stack((force, np.ones(len(force))))
    bias = np.linalg.lstsq(design, measured, rcond=None)[0][3]
    for sensor, axis in enumerate(AXIS):
        pair = pairs[axis]
        if pair is not None:
            bias[sensor] = 0.5 * (measured[pair[0], sensor] + measured[pair[1], sensor])
    free = measured - bias
    correction = np.linalg.lstsq(_triad(free), force, rcond=None)[0].T  # M_A, L_A A_m^+
    ideal = np.column_stack((force[:, 1] * force[:, 2], force[:, 2] * force[:, 0], force[:, 0] * force[:, 1]))
    gyro = np.linalg.lstsq(_products(free[gyro_rows]), ideal[gyro_rows], rcond=None)[0].T  # Omega_L Omega_m^+
    return np.concatenate(
        (
            bias,
            [0.5 * (bias[a] + bias[b]) for a, b in TRIAD],
            np.linalg.inv(correction).ravel(),
            gyro.ravel(),
            (gyro / np.diag(gyro)[:, None]).ravel(),
        )
    )


def _triad(free: FloatArray) -> FloatArray:
    """Mean of the two accelerometers of each axis, (n, 3)."""
    return np.column_stack([0.5 * (free[:, a] + free[:, b]) for a, b in TRIAD])


def _products(free: FloatArray) -> FloatArray:
    """Product of the two accelerometers of each module, (n, 3)."""
    return np.column_stack([free[:, a] * free[:, b] for a, b in PRODUCTS])


def _tilted(force: FloatArray, gravity: float) -> IntArray:
    """Positions 2 to 9: neither level nor upright, where every product is zero."""
    level = np.abs(force).max(axis=1) > (1.0 - OPPOSITE) * gravity
    return np.flatnonzero(~level)


def _affine(force: FloatArray, measured: FloatArray, where: str) -> tuple[Fit, ...]:
    design = np.column_stack((force, np.ones(len(force))))
    names = ("sensitivity to x", "to y", "to z", "bias")
    return tuple(
        linear_fit(design, column, names, where=f"{where}, {sensor}")
        for sensor, column in zip(SENSORS, measured.T, strict=True)
    )


def _crossed(fit: Fit, axis: int) -> FloatArray:
    """What an accelerometer senses of the other two axes, (2,) [-]."""
    return np.delete(fit.value[:3], axis)


def _refuse_exchanged(fits: tuple[Fit, ...], where: str) -> None:
    for sensor, axis, fit in zip(SENSORS, AXIS, fits, strict=True):
        own, cross = float(fit.value[axis]), _crossed(fit, axis)
        if abs(own - 1.0) > MOST_SENSITIVE or np.abs(cross).max() > MOST_CROSSED:
            raise InputError(
                f"column {sensor} does not show the specific force along {'xyz'[axis]}",
                where=where,
                why=f"it follows x, y, z by {', '.join(f'{value:.3g}' for value in fit.value[:3])}; "
                f"{'xyz'[axis]} by 1 and the others by 0 is right",
                fix="check units, signs (level and at rest z is -9.8 m/s^2), whether columns or angles are exchanged, "
                "and that roll and pitch turn about the axes as named",
            )


def _jacobian(function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float) -> FloatArray:
    """Central differences, (outputs, inputs)."""
    columns = []
    for i in range(at.size):
        shift = np.zeros(at.size)
        shift[i] = step
        columns.append((function(at + shift) - function(at - shift)) / (2.0 * step))
    return np.column_stack(columns)


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> NineRecord:
    """Read the table of positions.

    files: one, with ``roll_deg``, ``pitch_deg`` and, in any unit of acceleration, ``x_ay`` to ``z_ay``: module,
    then axis. One row a position, or all its samples in successive rows; how: columns. Raises InputError: the file
    cannot be used.
    """
    table = read_bench(files[0], SCHEMA, ("roll", "pitch", *SENSORS), columns=how.columns)
    settings, samples = table.stack("roll", "pitch"), table.stack(*SENSORS)
    return NineRecord(table, reduce_dwells(settings, samples, np.inf, table.get("time"), where=table.name))


def fit(record: NineRecord, how: BenchOptions) -> Calibration[NineRecord, NinePositions]:
    """Calibrate the modules; see `calibrate_nine`."""
    table, dwells = record.table, record.dwells
    roll, pitch = dwells.setting.T
    found = calibrate_nine(roll, pitch, dwells.value, how.gravity, where=table.name)
    fits = dict(zip(SENSORS, found.fits, strict=True))
    return Calibration(
        "nine",
        ImuErrors(
            gyro_matrix=found.gyro_matrix,
            accel_bias=found.accel_bias,
            accel_matrix=found.accel_matrix,
            name=how.name,
        ),
        CalibrationSd(
            gyro_matrix=found.gyro_matrix_sd, accel_bias=found.accel_bias_sd, accel_matrix=found.accel_matrix_sd
        ),
        _parameters(found),
        fits,
        record,
        found,
        how,
        (
            *found.warnings,
            *dwell_warnings(dwells, SENSORS, table.get("temperature")),
            *condition_warnings(fits),
        ),
    )


def _parameters(found: NinePositions) -> tuple[Quantity, ...]:
    """Bias of each accelerometer, scale factors and misalignments of their triad, misalignments of the gyros."""
    items = []
    half = found.half_width(found.bias_sd, first_order=False)
    for sensor, *values in zip(SENSORS, found.bias, found.bias_sd, half, strict=True):
        bias, sd, width = (value / (1e3 * UG) for value in values)
        items.append(measured(f"{sensor} bias", bias, "mg", sd, width))
    half = found.half_width(found.accel_matrix_sd, first_order=False)
    own = [("accel", i, i) for i in range(3)]
    crossed = [(sensor, i, j) for sensor in ("accel", "gyro") for i in range(3) for j in range(3) if i != j]
    gyro_half = found.half_width(found.gyro_matrix_sd, first_order=True)
    of = {
        "accel": (found.accel_matrix - np.eye(3), found.accel_matrix_sd, half),
        "gyro": (found.gyro_matrix, found.gyro_matrix_sd, gyro_half),
    }
    for sensor, i, j in (*own, *crossed):
        name, scale, unit = ("scale factor error", 1e6, "ppm") if i == j else (f"senses {'xyz'[j]}", 1e3, "mrad")
        value, sd, width = (scale * float(matrix[i, j]) for matrix in of[sensor])
        items.append(measured(f"{sensor} {'xyz'[i]} {name}", value, unit, sd, width))
    return tuple(items)
