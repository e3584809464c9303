"""Three gyros in rate sweeps about each axis: full matrix and bias, then the remaining error as a function of rate.

There is one file per axis, or one file with the rates about all axes. First, least squares fit ``gyro = B w + b``, with
nine coefficients and three biases; the rate is ``inverse(B) (gyro - b)``. Then straight pieces ``err = k rate + b`` fit
the error of this rate, and are subtracted. The pieces meet, so the correction is continuous. Every k is far below 1, so
the correction is invertible.

Each new border between pieces is placed where it lowers the sum of squares most; then all borders are moved in turn
until convergence. This is the forward selection of hinges by J. H. Friedman, Multivariate Adaptive Regression Splines,
Annals of Statistics 19 (1991), section 3. An information criterion decides their number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.model import AxisMap, DynamicMap, ImuErrors, RawScale
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import schema
from insnav.lab import calibration
from insnav.lab.bench_data import BenchTable, Dwells, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, Fit, measured
from insnav.lab.single_axis.rate_table import FEWEST, Dropped
from insnav.quantity import Quantity
from insnav.types import BoolArray, FloatArray, IntArray
from insnav.units import DEG, UNITS

AXES = ("x", "y", "z")
USUAL_SAMPLES = 500  # usual number of samples in a dwell
SCHEMA = schema("rate_sweep")
MOST = 12  # largest number of pieces
FEWEST_POINTS = 3  # least number of points in a piece
PENALTY = 3.0  # penalty of a border in units of log n: in pure noise fewer than 1 in 100 records get a border
_ROUNDS = 20  # largest number of rounds of moving borders
_EXACT = 1e-9  # a misfit below this share of the spread of the points counts as zero
ROUNDING = 1e-9  # errors below this share of the largest rate are rounding


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """Sweeps reduced to one output per dwell."""

    tables: tuple[BenchTable, ...]  # tables of the files, as read
    dwells: Dwells  # of all tables: setting is the rate about x, y, z [rad/s], value the outputs of gyros x, y, z
    unit: str  # unit of the outputs in the file; volts and counts are kept, other values are converted to rad/s
    warnings: tuple[Finding, ...]

    @property
    def raw(self) -> bool:
        """True if the outputs are in volts or counts."""
        return UNITS[self.unit][0] == "signal"

    @property
    def name(self) -> str:
        """Names of the files."""
        return ", ".join(table.name for table in self.tables)


def read_sweeps(paths: Sequence[str | Path | Table], how: BenchOptions = calibration.STANDARD) -> SweepRecord:
    """Read rate sweeps of three gyros.

    `paths`: three files with ``rate_deg_s``, for rotation about x, y and z; or one file with ``rate_x_deg_s``,
    ``rate_y_deg_s``, ``rate_z_deg_s``. Each has ``gyro_x_deg_s`` to ``gyro_z_deg_s``, or outputs in volts or counts.
    Successive rows of one rate are the samples of a dwell. `how`: columns and limit of spikes. Raises: InputError: the
    files cannot be used, or are neither one nor three.
    """
    if len(paths) not in (1, 3):
        raise InputError("lab.not_three_sweeps", count=len(paths))
    settings = ("rate",) if len(paths) == 3 else tuple(f"rate_{a}" for a in AXES)
    needed = (*settings, *(f"gyro_{a}" for a in AXES))
    raw_too = {f"gyro_{a}": f"raw_{a}" for a in AXES}
    tables = tuple(read_bench(path, SCHEMA, needed, columns=how.columns, alternatives=raw_too) for path in paths)
    unit = calibration.common_unit(
        [
            (key.replace("raw", "gyro").replace("_", " "), table.units[key])
            for table in tables
            for key in table.columns
            if key.startswith(("raw_", "gyro_"))
        ]
    )
    limit = how.spike_limit if how.spike_limit is not None else default_limit(unit)
    raw = UNITS[unit][0] == "signal"
    dwells: list[Dwells] = []
    warnings: list[Finding] = []
    for axis, table in enumerate(tables):
        if len(tables) == 3:
            rate = np.zeros((table.columns["rate"].size, 3))
            rate[:, axis] = table.columns["rate"]
        else:
            rate = table.stack(*settings)
        outputs = table.stack(*(f"{'raw' if raw else 'gyro'}_{a}" for a in AXES))
        si_limit = limit if raw else limit * UNITS[unit][1]
        reduced = reduce_dwells(rate, outputs, si_limit, table.get("time"), where=table.name)
        gyros = tuple(f"gyro {a}" for a in AXES)
        warnings += calibration.about(table.name, dwell_warnings(reduced, gyros, table.get("temperature")))
        if reduced.raw:
            warnings += calibration.few("samples of a dwell", int(reduced.count.min()), USUAL_SAMPLES, table.name)
        dwells.append(reduced)
    joined = (np.concatenate([getattr(dwell_set, part.name) for dwell_set in dwells]) for part in fields(Dwells))
    return SweepRecord(tables, Dwells(*joined), unit, tuple(warnings))


USUAL = 31  # usual number of rates about an axis; with fewer, pieces are hardly distinguishable from noise
FEWEST_FOR_MAP = 12  # with fewer rates about an axis, no pieces are fitted
MOST_CROSSED = 0.3  # largest sensitivity to another axis, relative to the own axis
FLAT = 0.5  # a gyro is saturated where its slope is below this share of the median slope
_SURE = 4.0  # least significant difference, in standard deviations
_AT_STOP = 0.05  # an output that grows by less than this share of its usual growth is at its limit


def check_rates(rate: FloatArray, own: Sequence[IntArray], where: str) -> tuple[Finding, ...]:
    """Refuse sweeps without an axis, and report unusual rates.

    `rate` (n, 3): rates of the table [rad/s]. `own`: for each axis, the rows (k,) with rotation about no other axis.
    """
    warnings: list[Finding] = []
    for axis, rows in zip("xyz", own, strict=True):
        distinct, gyro = np.unique(rate[rows, "xyz".index(axis)]), f"gyro {axis}"
        if distinct.size < FEWEST:
            values: dict[str, Any] = {"axis": axis, "count": distinct.size, "limit": FEWEST}
            raise InputError("lab.no_sweep" if distinct.size < 2 else "lab.short_sweep", where=where, **values)
        if distinct[0] >= 0.0 or distinct[-1] <= 0.0:
            raise InputError(
                "lab.one_sided_sweep", where=where, axis=axis, low_rad_s=distinct[0], high_rad_s=distinct[-1]
            )
        if distinct.size < FEWEST_FOR_MAP:
            count, limit = distinct.size, FEWEST_FOR_MAP
            warnings.append(Finding.of(Code.BENCH_NO_MAP, subject=gyro, count=count, limit_count=limit))
        else:
            warnings += calibration.few("rates", distinct.size, USUAL, gyro)
        if -distinct[0] < 0.5 * distinct[-1] or distinct[-1] < -0.5 * distinct[0]:
            low, high = distinct[0], distinct[-1]
            warnings.append(Finding.of(Code.BENCH_ONE_SIDED, subject=gyro, low_rad_s=low, high_rad_s=high))
    return tuple(warnings)


def saturated(rate: FloatArray, output: FloatArray, sd: FloatArray) -> tuple[BoolArray, tuple[Dropped, ...]]:
    """Find the ends of a sweep where the output hardly grows with the rate.

    A non-linear gyro leaves a straight line long before its range ends. It is saturated from the rate on at which
    its slope falls below half of the median slope.

    `rate` (n,): about the gyro's own axis [deg/s]. `output` (n,): mean outputs. `sd` (n,): their standard deviations.
    Returns (n,): True if saturated; and a `Dropped` for each saturated rate.
    """
    distinct, index = np.unique(rate, return_inverse=True)
    count = np.bincount(index)
    mean = np.bincount(index, output) / count
    noise = np.sqrt(np.bincount(index, sd**2)) / count
    slope = np.diff(mean) / np.diff(distinct)
    median_slope = float(np.median(slope))
    if median_slope == 0.0:
        return np.zeros(rate.size, dtype=np.bool_), ()
    share = slope / median_slope
    share_sd = np.hypot(noise[1:], noise[:-1]) / (np.diff(distinct) * abs(median_slope))
    flat = share + _SURE * share_sd < FLAT
    saturated_rows = np.zeros(rate.size, dtype=np.bool_)
    dropped = []
    for sense in (1.0, -1.0):
        outer = distinct[1:] if sense > 0.0 else -distinct[:-1]  # outer end of each step
        ends = outer[flat & (outer > 0.0)]
        if ends.size == 0:
            continue
        first = float(ends.min())
        # the previous rate may already be at the limit, though the output still grew up to it
        row = int(np.flatnonzero(distinct == sense * first)[0])
        inner_row = row - int(sense)
        if abs(mean[row] - mean[inner_row]) < max(
            _AT_STOP * abs(median_slope * (distinct[row] - distinct[inner_row])),
            _SURE * float(np.hypot(noise[row], noise[inner_row])),
        ):
            first = sense * float(distinct[inner_row])
        saturated_rows |= sense * rate >= first
        for value in distinct[sense * distinct >= first]:
            excess = float(mean[distinct == value][0] - _extended(distinct, mean, sense * first, sense, float(value)))
            reason = Finding.of(Code.BENCH_RATE_FLAT, limit_share=FLAT)
            dropped.append(Dropped(float(value), excess, float("nan"), reason))
    return saturated_rows, tuple(sorted(dropped, key=lambda item: item.rate))


def _extended(rate: FloatArray, output: FloatArray, first: float, sense: float, at: float) -> float:
    """Extrapolate the straight line through the rates within `first` to an outer rate `at`."""
    inside = sense * rate < sense * first
    if np.count_nonzero(inside) < 2:
        return float("nan")
    return float(np.polyval(np.polyfit(rate[inside], output[inside], 1), at))


def refuse_crossed(fits: Sequence[Fit], raw: bool, where: str) -> None:
    """Refuse gyros that mainly respond to another axis, or whose outputs have another unit.

    `fits`: sensitivities to x, y, z and bias of each gyro. `raw`: whether the outputs are in volts or counts.
    """
    for i, (axis, fit) in enumerate(zip("xyz", fits, strict=True)):
        own, others = float(fit.value[i]), np.delete(fit.value[:3], i)
        if np.abs(others).max() > MOST_CROSSED * abs(own):
            raise InputError("lab.gyro_crossed", where=where, axis=axis, values=tuple(fit.value[:3].tolist()))
        if abs(own) < 5.0 * fit.sd[i]:
            raise InputError("lab.rate_ignored", where=where, sensor=f"gyro {axis}", scale=own, scale_sd=fit.sd[i])
        if not raw and abs(own - 1.0) > calibration.WRONG_UNIT:
            raise InputError(
                "lab.output_reversed" if own < 0.0 else "lab.output_unit", where=where, sensor=f"gyro {axis}", scale=own
            )


def shifted_zeros(error: FloatArray, own: Sequence[IntArray]) -> tuple[Finding, ...]:
    """Find gyros whose zero differs between the sweeps about the other two axes.

    `error` (n, 3): of the corrected rates [rad/s]; NaN if unknown. `own`: for each axis, the rows (k,) with rotation
    about no other axis.
    """
    warnings = []
    for i, axis in enumerate("xyz"):
        j, k = (a for a in range(3) if a != i)
        sides = [values[np.isfinite(values)] for values in (error[own[j], i], error[own[k], i])]
        if min(side.size for side in sides) < FEWEST:
            continue
        shift = float(sides[1].mean() - sides[0].mean())
        sd = float(np.hypot(*(side.std(ddof=1) / np.sqrt(side.size) for side in sides)))
        if abs(shift) > 5.0 * sd + 1e-9 * float(np.abs(error[np.isfinite(error)]).max()):
            size, first, second = abs(shift), "xyz"[j], "xyz"[k]
            warnings.append(
                Finding.of(Code.BENCH_ZERO_SHIFT, subject=f"gyro {axis}", shift_rad_s=size, first=first, second=second)
            )
    return tuple(warnings)


@dataclass(frozen=True, slots=True)
class Pieces:
    """Continuous function of straight pieces, fitted to points."""

    knot: FloatArray  # (k,) x of both ends and of the borders between pieces, increasing
    value: FloatArray  # (k,) values of the function at the knots
    covariance: FloatArray  # (k, k) covariance of these values, for given borders
    residual: FloatArray  # (n,) points minus function
    left_out: FloatArray  # (n,) residual of each point from a function fitted without this point, with the same borders
    sigma: float  # standard deviation of a point of weight 1

    @property
    def straight(self) -> bool:
        """True if there is only one piece."""
        return self.knot.size == 2

    @property
    def slope_sd(self) -> FloatArray:
        """Standard deviations of the slopes, (k - 1,)."""
        c = self.covariance
        variance = np.diag(c)[1:] + np.diag(c)[:-1] - 2.0 * np.diag(c, 1)
        return np.asarray(np.sqrt(variance) / np.diff(self.knot))

    @property
    def slope(self) -> FloatArray:
        """Slope of each piece, (k - 1,)."""
        return np.diff(self.value) / np.diff(self.knot)

    @property
    def intercept(self) -> FloatArray:
        """Intercept of each piece, (k - 1,)."""
        return np.asarray(self.value[:-1] - self.slope * self.knot[:-1])

    def room(self, piece: int) -> tuple[float, float]:
        """Return the range of intercepts of a piece, counted from 0, for which all borders stay in order."""
        move = np.zeros(self.knot.size)  # shift of each border per unit of the intercept
        for border, neighbour in ((piece, piece - 1), (piece + 1, piece + 1)):
            if 0 < border < self.knot.size - 1:
                move[border] = -1.0 / (self.slope[piece] - self.slope[neighbour])
        with np.errstate(divide="ignore"):
            limit = -np.diff(self.knot) / np.diff(move)
        room = limit[np.isfinite(limit)]
        intercept = float(self.intercept[piece])
        return intercept + max(room[room < 0.0], default=-np.inf), intercept + min(room[room > 0.0], default=np.inf)

    def with_intercept(self, piece: int, intercept: float, x: FloatArray) -> Pieces:
        """Move one piece up or down; its neighbours keep their lines and meet it at other borders.

        `piece`: counted from 0. `intercept`: new intercept. `x` (n,): positions of the points. Raises: ConfigError: the
        borders would not stay in order.
        """
        shift = intercept - self.intercept[piece]
        last = self.knot.size - 1
        knot, weights = self.knot.copy(), np.zeros((last + 1, last + 1))
        for border in range(last + 1):
            # the border lies on the line of an adjacent piece, `still`, which does not move unless it is at an end
            still = border - 1 if border > 0 and (border - 1 != piece or border == last) else min(border, last - 1)
            if border in (piece, piece + 1) and 0 < border < last:
                with np.errstate(divide="ignore"):
                    knot[border] -= shift / (self.slope[piece] - self.slope[still])
            share = (knot[border] - self.knot[still]) / (self.knot[still + 1] - self.knot[still])
            weights[border, still : still + 2] = 1.0 - share, share
        if not (np.isfinite(knot).all() and (np.diff(knot) > 0.0).all()):
            low, high = self.room(piece)
            raise ConfigError(
                "lab.piece_past_neighbours", before_rad_s=self.intercept[piece], low_rad_s=low, high_rad_s=high
            )
        value = weights @ self.value
        ends = [border for border in (0, last) if border in (piece, piece + 1)]
        value[ends] += shift
        moved = Pieces(knot, value, weights @ self.covariance @ weights.T, self.residual, self.left_out, self.sigma)
        change = moved.at(x) - self.at(x)
        return replace(moved, residual=self.residual - change, left_out=self.left_out - change)

    def at(self, x: FloatArray) -> FloatArray:
        """Evaluate the function at x (n,); the outer pieces extend beyond the ends."""
        piece = np.searchsorted(self.knot[1:-1], x)
        return np.asarray(self.intercept[piece] + self.slope[piece] * x)


def fit_pieces(x: FloatArray, y: FloatArray, weight: FloatArray | None = None) -> Pieces:
    """Fit as many straight pieces as the points support.

    `x`, `y` (n,): points, in any order; at least six different x. `weight` (n,): number of measurements that each
    point represents; default one. The function ends at the outermost points.
    """
    order = np.argsort(x, kind="stable")
    root = np.ones(x.size) if weight is None else np.sqrt(weight[order])
    x, y = x[order], y[order]
    points = _Points(x, root, root * y)
    candidates = x[FEWEST_POINTS : x.size - FEWEST_POINTS]
    floor = float(np.sum((_EXACT * root * np.ptp(y)) ** 2)) + 1e-300
    borders = best = np.empty(0)
    lowest = _criterion(points, borders, floor)
    while borders.size + 1 < MOST:
        added = _best_border(points, borders, candidates)
        if added is None:
            break
        borders = _moved(points, np.sort(np.append(borders, added)), candidates)
        criterion = _criterion(points, borders, floor)
        if criterion < lowest:
            best, lowest = borders, criterion
    return _fitted(points, np.concatenate((x[:1], best, x[-1:])), np.argsort(order))


@dataclass(frozen=True, slots=True)
class _Points:
    """Points: increasing x, square roots of the weights, and y times these roots."""

    x: FloatArray
    root: FloatArray
    y: FloatArray


def _hinges(points: _Points, borders: FloatArray) -> FloatArray:
    """Build weighted hinge functions, zero up to a border and with slope 1 beyond, (n, borders)."""
    return np.asarray(np.maximum(points.x[:, None] - borders, 0.0) * points.root[:, None])


def _rest(points: _Points, borders: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis of all functions with these borders, and the weighted residual of the best one."""
    straight = np.column_stack((points.root, points.root * points.x))
    q = np.linalg.qr(np.hstack((straight, _hinges(points, borders))))[0]
    return q, np.asarray(points.y - q @ (q.T @ points.y))


def _criterion(points: _Points, borders: FloatArray, floor: float) -> float:
    n = points.x.size
    squares = max(float(np.sum(_rest(points, borders)[1] ** 2)), floor)
    return float(n * np.log(squares / n) + PENALTY * borders.size * np.log(n))


def _best_border(points: _Points, borders: FloatArray, candidates: FloatArray) -> float | None:
    """Find the candidate that lowers the sum of squares most, with enough points between borders."""
    row = np.searchsorted(points.x, candidates)
    allowed = np.ones(candidates.size, dtype=np.bool_)
    for other in np.searchsorted(points.x, borders):
        allowed &= np.abs(row - other) >= FEWEST_POINTS
    if not allowed.any():
        return None
    q, residual = _rest(points, borders)
    hinges = _hinges(points, candidates[allowed])
    orthogonal = hinges - q @ (q.T @ hinges)
    length = np.sum(orthogonal**2, axis=0)
    distinct = length > 1e-12 * np.sum(hinges**2, axis=0)
    gain = np.where(distinct, (residual @ orthogonal) ** 2 / np.maximum(length, 1e-300), 0.0)
    return float(candidates[allowed][int(np.argmax(gain))])


def _moved(points: _Points, borders: FloatArray, candidates: FloatArray) -> FloatArray:
    """Move each border in turn to its best position given the others, until convergence."""
    for _ in range(_ROUNDS):
        previous = borders
        for i in range(borders.size):
            others = np.delete(borders, i)
            best = _best_border(points, others, candidates)
            if best is not None:
                borders = np.sort(np.append(others, best))
        if np.array_equal(previous, borders):
            break
    return borders


def _fitted(points: _Points, knot: FloatArray, back: IntArray) -> Pieces:
    """Compute values at the knots, and residuals in the original order of the points, which `back` restores."""
    interpolation = np.column_stack([np.interp(points.x, knot, row) for row in np.eye(knot.size)])
    design = interpolation * points.root[:, None]
    value = np.asarray(np.linalg.lstsq(design, points.y, rcond=None)[0], dtype=np.float64)
    residual = points.y - design @ value
    sigma = float(np.sqrt(np.sum(residual**2) / max(points.x.size - knot.size, 1)))
    inverse = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
    leverage = np.sum((design @ inverse) * design, axis=1)
    residual = residual / points.root
    left_out = residual / np.maximum(1.0 - leverage, 1e-9)
    return Pieces(knot, value, sigma**2 * inverse, residual[back], left_out[back], sigma)


@dataclass(frozen=True, slots=True)
class Adjusted:
    """Piece with a manual intercept."""

    gyro: int
    piece: int  # number of the piece, from 0
    found: float  # fitted intercept [rad/s]
    given: float  # manual intercept [rad/s]
    # RMS error of the dwells in the piece, with the fitted and with the manual intercept; NaN without a dwell [rad/s]
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class SweepCalibration:
    """Results of sweeps about three axes."""

    rate: FloatArray  # (n, 3) rate of the table in each dwell [rad/s]
    output: FloatArray  # (n, 3) mean output of each gyro [unit of the output]
    raw: bool  # True: outputs are in volts or counts; False: in rad/s
    own: tuple[IntArray, ...]  # for each axis, the rows (k,) with rotation about no other axis
    # (3, 3) B [unit of the output per rad/s]: best straight line over all rates, also where a gyro is non-linear
    matrix: FloatArray
    bias: FloatArray  # (3,) b [unit of the output]
    fits: tuple[Fit, ...]  # fit of each gyro: three sensitivities and the bias
    used: BoolArray  # (n, 3) dwells used for the fit of each gyro
    dropped: tuple[tuple[int, Dropped], ...]  # saturated dwells: number of the gyro, and rate [deg/s]
    # error of the corrected rate as a function of this rate, for each gyro [rad/s]; None if it is only noise
    pieces: tuple[Pieces | None, ...]
    # (n, 3) corrected rate minus table rate [rad/s], NaN if a gyro is saturated. Corrections: only bias and scale
    # factor; full matrix; matrix and pieces.
    error_line: FloatArray
    error_matrix: FloatArray
    error_map: FloatArray
    warnings: tuple[Finding, ...]
    adjusted: tuple[Adjusted, ...] = ()  # manual changes of intercepts


def calibrate_sweeps(
    rate: FloatArray,
    output: FloatArray,
    sd: FloatArray,
    *,
    raw: bool,
    where: str = "",
    intercepts: Mapping[str, float] | None = None,
) -> SweepCalibration:
    """Calibrate three gyros by rate sweeps about three axes.

    `rate` (n, 3): rates of the table about x, y, z [rad/s]; one row per dwell. `output` (n, 3): mean outputs of gyros
    x, y, z [rad/s, or volts or counts]. `sd` (n, 3): standard deviations of these means, zero if unknown. `raw`: the
    outputs are in volts or counts. `intercepts`: manual values for pieces, ``{"x2": 0.01}`` for the second of gyro x
    [deg/s].
    Raises: ConfigError: an intercept of a missing piece, or beyond its neighbours. InputError: an axis without a sweep,
    too few rates, gyros with wrong axis or unit, or an error too steep for inversion.
    """
    # rows with rotation about one axis only; rows at rest belong to every axis
    own = tuple(np.flatnonzero(~np.delete(rate, axis, axis=1).any(axis=1)) for axis in range(3))
    warnings = check_rates(rate, own, where)
    used: BoolArray = np.ones(rate.shape, dtype=np.bool_)
    dropped: list[tuple[int, Dropped]] = []
    for axis, rows in enumerate(own):
        saturated_rows, items = saturated(np.round(rate[rows, axis] / DEG, 9), output[rows, axis], sd[rows, axis])
        used[rows[saturated_rows], axis] = False
        dropped += [(axis, item) for item in items]
        count = np.unique(rate[rows[~saturated_rows], axis]).size
        if count < FEWEST:
            raise InputError("lab.saturated_sweep", where=where, axis="xyz"[axis], count=count, limit=FEWEST)
    names = tuple(f"{where}, gyro {axis}" for axis in "xyz")
    fits = calibration.affine_fits(rate, output, names, used)
    refuse_crossed(fits, raw, where)
    pieces = _all_pieces(rate, output, used, fits, names)
    if any(item is not None for item in pieces):
        # A non-linear gyro outputs B times a bent rate. Fitted to bent rates, the matrix is free of non-linearity.
        bent_rate = np.column_stack(
            [r if p is None else AxisMap(p.knot, p.value).inverse(r) for r, p in zip(rate.T, pieces, strict=True)]
        )
        fits = calibration.affine_fits(bent_rate, output, names, used)
        pieces = _all_pieces(rate, output, used, fits, names)
    matrix, bias, matrix_error = _matrix_errors(rate, output, used, fits)
    complete = used.all(axis=1, keepdims=True)
    adjusted: list[Adjusted] = []
    for name, value in (intercepts or {}).items():
        pieces, change = _adjust(pieces, name, value * DEG, rate, np.where(complete, matrix_error, np.nan))
        adjusted.append(change)
    final = matrix_error.copy()
    for i, item in enumerate(pieces):
        if item is not None:
            final[:, i] -= AxisMap(item.knot, item.value).rate_error(rate[:, i] + matrix_error[:, i])
    return SweepCalibration(
        rate=rate,
        output=output,
        raw=raw,
        own=own,
        matrix=matrix,
        bias=bias,
        fits=fits,
        used=used,
        dropped=tuple(dropped),
        pieces=pieces,
        error_line=np.asarray(np.where(complete, output - bias, np.nan) / np.diag(matrix) - rate),
        error_matrix=matrix_error,
        error_map=final,
        warnings=(*warnings, *shifted_zeros(matrix_error, own)),
        adjusted=tuple(adjusted),
    )


def _adjust(
    pieces: tuple[Pieces | None, ...], name: str, value: float, rate: FloatArray, error: FloatArray
) -> tuple[tuple[Pieces | None, ...], Adjusted]:
    """Set the intercept of one piece, and record its effect.

    `name`: gyro and number of the piece. `value`: intercept [rad/s]. `rate` (n, 3): rate of the table.
    `error` (n, 3): error of the rate by the matrix, NaN if unused [rad/s].
    """
    match = re.fullmatch(r"([xyz])([1-9][0-9]?)", name)
    count = [0 if item is None else item.slope.size for item in pieces]
    if match is None or int(match[2]) > count["xyz".index(match[1])]:
        raise ConfigError("lab.no_piece", where="--intercept", piece=name, pieces=tuple(count))
    gyro, piece = "xyz".index(match[1]), int(match[2]) - 1
    item = pieces[gyro]
    assert item is not None
    known = np.isfinite(error[:, gyro])
    true, known_error = rate[known, gyro], error[known, gyro]
    distinct, mean, _ = _means(true, known_error)
    try:
        moved = item.with_intercept(piece, value, distinct + mean)
    except ConfigError as error:
        error.where = f"--intercept {name}"
        raise
    measured_rate = true + known_error
    inside = np.searchsorted(moved.knot[1:-1], measured_rate) == piece
    sizes = [
        float(np.sqrt(np.mean((known_error - line.at(measured_rate))[inside] ** 2))) if inside.any() else np.nan
        for line in (item, moved)
    ]
    change = Adjusted(gyro, piece, float(item.intercept[piece]), value, *sizes)
    return tuple(moved if i == gyro else other for i, other in enumerate(pieces)), change


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> SweepRecord:
    """Read three sweeps about x, y, z, or one file of all; see `read_sweeps`."""
    return read_sweeps(files, how)


def fit(record: SweepRecord, how: BenchOptions) -> Calibration[SweepRecord, SweepCalibration]:
    """Fit matrix, bias and the error as a function of rate; see `calibrate_sweeps`."""
    rate, output, sd_of_output = record.dwells.setting, record.dwells.value, record.dwells.sd
    result = calibrate_sweeps(rate, output, sd_of_output, raw=record.raw, where=record.name, intercepts=how.intercepts)
    errors, sd = sweep_errors(result, record.unit, how.name)
    fits = {f"gyro {axis}": gyro_fit for axis, gyro_fit in zip("xyz", result.fits, strict=True)}
    left_out = (Finding.of(Code.BENCH_LEFT_OUT, count=len(result.dropped)),) * bool(result.dropped)
    worse = (
        Finding.of(Code.BENCH_INTERCEPT, subject=f"{'xyz'[g]}{i + 1}", after_rad_s=rms_after, before_rad_s=rms_before)
        for g, i, _, _, rms_before, rms_after in map(astuple, result.adjusted)
        if rms_after > rms_before
    )
    warnings = (*left_out, *record.warnings, *result.warnings, *worse, *calibration.badly_conditioned(fits))
    parameters = _parameters(result, record.unit if record.raw else "deg/s")
    return Calibration("imu", errors, sd, parameters, fits, record, result, how, warnings)


def sweep_errors(found: SweepCalibration, unit: str, name: str = "") -> tuple[ImuErrors, CalibrationSd]:
    """Build errors for the calibration file, and their uncertainty. `unit`: unit of the outputs."""
    maps = tuple(None if item is None else AxisMap(item.knot, item.value) for item in found.pieces)
    gyro_map = DynamicMap(maps) if any(item is not None for item in maps) else None
    bias_sd = np.array([fit.sd[3] for fit in found.fits])
    matrix_sd = np.array([fit.sd[:3] for fit in found.fits])
    spread = tuple(None if item is None else item.covariance for item in found.pieces)
    if not found.raw:
        return ImuErrors(found.bias, found.matrix, name=name, gyro_map=gyro_map), CalibrationSd(
            gyro_bias=bias_sd, gyro_matrix=matrix_sd, gyro_map=spread
        )
    scale = np.diag(found.matrix).copy()
    raw = RawScale(unit, found.bias, scale)
    errors = ImuErrors(gyro_matrix=found.matrix / scale[:, None], gyro_raw=raw, gyro_map=gyro_map, name=name)
    gain = np.abs(scale)
    return errors, CalibrationSd(gyro_bias=bias_sd / gain, gyro_matrix=matrix_sd / gain[:, None], gyro_map=spread)


def _parameters(found: SweepCalibration, unit: str) -> tuple[Quantity, ...]:
    """Build bias, own scale factor and misalignments of each gyro."""
    items = []
    for i, (axis, line) in enumerate(zip("xyz", found.fits, strict=True)):
        half, gain = line.half_width(), float(line.value[i])
        rate = 1.0 if found.raw else DEG
        items.append(measured(f"gyro {axis} bias", line.value[3] / rate, unit, line.sd[3] / rate, half[3] / rate))
        if found.raw:
            scale = (gain * DEG, f"{unit}/(deg/s)", line.sd[i] * DEG, half[i] * DEG)
            items.append(measured(f"gyro {axis} scale factor", *scale))
        else:
            error = (1e6 * (gain - 1.0), "ppm", 1e6 * line.sd[i], 1e6 * half[i])
            items.append(measured(f"gyro {axis} scale factor error", *error))
        for j, other in enumerate("xyz"):
            if j != i:
                crossed = (1e3 * line.value[j] / gain, "mrad", 1e3 * line.sd[j] / abs(gain), 1e3 * half[j] / abs(gain))
                items.append(measured(f"gyro {axis} senses {other}", *crossed))
    return tuple(items)


def _matrix_errors(
    rate: FloatArray, output: FloatArray, used: BoolArray, fits: Sequence[Fit]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return matrix, bias, and error of the rate that they give, (n, 3), NaN if a gyro is saturated."""
    matrix, bias = np.array([fit.value[:3] for fit in fits]), np.array([fit.value[3] for fit in fits])
    unbiased = np.where(used.all(axis=1, keepdims=True), output - bias, np.nan)
    return matrix, bias, np.asarray(np.linalg.solve(matrix, unbiased.T).T - rate)


def _all_pieces(
    rate: FloatArray, output: FloatArray, used: BoolArray, fits: Sequence[Fit], names: Sequence[str]
) -> tuple[Pieces | None, ...]:
    errors = _matrix_errors(rate, output, used, fits)[2]
    in_range = used.all(axis=1)  # rows in which no gyro is saturated
    return tuple(_pieces(rate[in_range, i], errors[in_range, i], name) for i, name in enumerate(names))


def _pieces(rate: FloatArray, error: FloatArray, where: str) -> Pieces | None:
    """Fit straight pieces through the mean error at each rate, if significantly better than a straight line.

    In the sweeps about other axes the rate is zero, so the error at rest has most weight.
    """
    distinct, mean, count = _means(rate, error)
    if distinct.size < FEWEST_FOR_MAP or np.abs(error).max() < ROUNDING * np.abs(rate).max():
        return None
    pieces = fit_pieces(distinct + mean, mean, count)
    if pieces.straight:
        return None
    try:
        AxisMap(pieces.knot, pieces.value)
    except ConfigError as problem:
        raise InputError("lab.map_not_invertible", where=where, cause=problem) from None
    return pieces


def _means(rate: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distinct rates, the mean error and the number of dwells at each. `rate`, `error` (n,): [rad/s]."""
    distinct, index = np.unique(rate, return_inverse=True)
    count = np.bincount(index).astype(np.float64)
    return distinct, np.bincount(index, error) / count, count
