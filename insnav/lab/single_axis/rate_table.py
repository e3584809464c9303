"""Bench files of one sensor at a time, and scale factor and zero of a gyro on a rate table.

The output is in volts, counts, or in the unit of the input. For volts and counts the calibration file contains a line
(`insnav.imu.model`), otherwise a bias and a scale factor.

The line through the output excludes saturated rates: U = U0 + K w + v, with output U and table rate w. A sensor leaves
the line at the ends of its range first, so the line grows from the middle outwards. A rate is included if it agrees
with the line through the previous rates. After the first disagreement, all rates beyond on that side are dropped. A
line with a corner detects a remaining bend at an end, where each rate deviates by less than its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from scipy.special import stdtr

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.model import ImuErrors, RawScale
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity, schema
from insnav.lab import calibration
from insnav.lab.bench_data import BenchTable, Dwells, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.calibration import STANDARD, BenchOptions, Calibration, CalibrationSd, Fit, coverage_factor, linear_fit
from insnav.types import BoolArray, FloatArray, IntArray
from insnav.units import DEG, UNITS

FALSE_ALARM = 0.01  # probability of dropping anything from a record without saturation
SOFT = 0.05  # the same for a bend at an end; with less, the interval of K seldom contains the truth at a bend
BENT = 3  # largest number of bent outer rates on a side
FEWEST = 5  # rates for a line with uncertainty
NAMES = ("zero U0", "scale factor K")
USUAL_RATES = 10  # ± 10, 20, 40, 60, 80 deg/s
SCHEMA = schema("rate_table")


@dataclass(frozen=True, slots=True)
class Record:
    """Bench file of one sensor, reduced to one output per dwell."""

    table: BenchTable  # as read
    dwells: Dwells  # setting [rad/s] or [rad], output in `unit`
    unit: str  # of the output
    warnings: tuple[Finding, ...]

    @property
    def setting(self) -> FloatArray:
        """Rate [rad/s] or angle [rad] of each dwell, (n,)."""
        return self.dwells.setting[:, 0]

    @property
    def output(self) -> FloatArray:
        """Output of each dwell, (n,)."""
        return self.dwells.value[:, 0]

    @property
    def raw(self) -> bool:
        """True if the output is in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def read_records(
    files: Sequence[str | Path | Table], schema: Sequence[Quantity], how: BenchOptions = STANDARD
) -> tuple[Record, ...]:
    """Read one file for each of the sensors x, y, z, or a single file for all three; see `read_record`.

    Raises: InputError: the number of files is neither one nor three, or their outputs have different units.
    """
    records = tuple(read_record(file, schema, how) for file in files)
    if len(records) not in (1, 3):
        raise InputError("lab.not_three_sensors", count=len(records))
    calibration.common_unit([(item.table.name, item.unit) for item in records])
    return records


def read_record(path: str | Path | Table, schema: Sequence[Quantity], how: BenchOptions = STANDARD) -> Record:
    """Read the file of one sensor.

    `path`: columns of setting and output; several successive rows of one setting are the samples of a dwell. `schema`:
    setting, raw output, output in the unit of the input. `how`: columns and limit of spikes. Raises: InputError: the
    file cannot be used.
    """
    setting = schema[0].key
    table = read_bench(path, schema, (setting, "output"), columns=how.columns, alternatives={"output": "sensed"})
    key = "output" if "output" in table.columns else "sensed"
    unit = table.units[key] if key == "output" else schema[2].unit
    values = table.columns[key] / (1.0 if key == "output" else UNITS[unit][1])
    limit = how.spike_limit if how.spike_limit is not None else default_limit(unit)
    dwells = reduce_dwells(table.columns[setting][:, None], values[:, None], limit, table.get("time"), where=table.name)
    return Record(table, dwells, unit, dwell_warnings(dwells, ("",), table.get("temperature")))


def refuse_unit(record: Record, scale: float) -> None:
    """Refuse a digital output that is not in the unit of its column; volts and counts may have any scale."""
    if not record.raw and abs(scale - 1.0) > calibration.WRONG_UNIT:
        values: dict[str, Any] = {"scale": scale, "unit": record.unit}
        raise InputError("lab.output_reversed" if scale < 0.0 else "lab.output_unit", where=record.table.name, **values)


class Fitted(Protocol):
    """Common part of a method's results for one sensor: zero and scale factor first."""

    @property
    def fit(self) -> Fit:
        """Fit of its parameters."""


F = TypeVar("F", bound=Fitted)


def triad_calibration(
    sensor: Literal["gyro", "accel"],
    record: tuple[Record, ...],
    found: tuple[F, ...],
    per: float,
    per_units: Sequence[str],
    how: BenchOptions,
    by_sensor: Sequence[tuple[Finding, ...]],
) -> Calibration[tuple[Record, ...], tuple[F, ...]]:
    """Build the calibration of zero and scale factor of sensors x, y, z, or of one sensor for all.

    `found`: of each, scale factors for a setting of `per` [rad/s] or [m/s^2]. `per_units`: denominator of each
    parameter's unit after the output unit. `by_sensor`: warnings of the method.
    """
    names = ("x", "y", "z") if len(record) == 3 else ("sensor",)
    fits = {name: item.fit for name, item in zip(names, found, strict=True)}
    value, sd = (np.array([getattr(fit, key)[:2] for fit in fits.values()]) for key in ("value", "sd"))
    (zero, scale), (zero_sd, scale_sd) = (np.array(each if len(each) == 3 else [each[0]] * 3).T for each in (value, sd))
    unit, size = record[0].unit, np.abs(scale)
    known: dict[str, Any]
    if record[0].raw:
        known = {f"{sensor}_raw": RawScale(unit, zero, scale / per)}
    else:
        si = UNITS[unit][1]
        known = {f"{sensor}_bias": zero * si, f"{sensor}_matrix": np.diag(scale / (per / si))}
    spread: dict[str, Any] = {f"{sensor}_bias": zero_sd / size * per, f"{sensor}_matrix": np.diag(scale_sd / size)}
    full = {name: f"{sensor} {name}" if len(record) == 3 else sensor for name in names}
    both = zip(full.values(), record, by_sensor, strict=True)
    own = [each for name, item, more in both for each in calibration.about(name, (*item.warnings, *more))]
    one = (Finding.of(Code.BENCH_ONE_SENSOR, subject=sensor),) * (len(record) == 1)
    warnings = (*own, *calibration.badly_conditioned({full[name]: fit for name, fit in fits.items()}), *one)
    units = [f"{unit}{each}" for each in per_units]
    parameters = tuple(each for name, fit in fits.items() for each in calibration.fitted(fit, units, name))
    errors, sd_of = ImuErrors(**known, name=how.name), CalibrationSd(**spread)
    return Calibration(sensor, errors, sd_of, parameters, fits, record, found, how, warnings)


@dataclass(frozen=True, slots=True)
class Dropped:
    """Dropped rate, with the reason."""

    rate: float  # rate of the table
    residual: float  # output minus line
    limit: float  # largest residual by chance
    reason: Finding


@dataclass(frozen=True, slots=True)
class RateTable:
    """Scale factor and zero of one gyro. Rates have their input unit."""

    rate: FloatArray  # (n,) measured rates and outputs
    output: FloatArray
    used: BoolArray  # (n,) rates in the fit
    fit: Fit  # zero and scale factor over all used rates
    # fits of positive and of negative rates alone, zero in both; None with fewer than three
    forward: Fit | None
    reverse: Fit | None
    dropped: tuple[Dropped, ...]  # dropped rates

    @property
    def average(self) -> tuple[FloatArray, FloatArray] | None:
        """Mean zero and scale factor of both senses of rotation, with standard deviation, (2,) each.

        Dwells at rest belong to both senses, so that the two are not independent.
        """
        if self.forward is None or self.reverse is None:
            return None
        weights, squares, dof = np.zeros((2, self.rate.size)), 0.0, 0
        for fit, sense in ((self.forward, self.rate >= 0.0), (self.reverse, self.rate <= 0.0)):
            rows = self.used & sense
            weights[:, rows] += 0.5 * np.linalg.pinv(np.column_stack((np.ones(rows.sum()), self.rate[rows])))
            squares, dof = squares + fit.dof * fit.sigma**2, dof + fit.dof
        mean = 0.5 * (self.forward.value + self.reverse.value)
        return mean, np.asarray(np.sqrt(squares / dof) * np.linalg.norm(weights, axis=1))

    @property
    def asymmetry(self) -> float | None:
        """Scale factor forward minus reverse, as a share of their mean [-]."""
        if self.forward is None or self.reverse is None:
            return None
        ahead, back = self.forward.value[1], self.reverse.value[1]
        return float(2.0 * (ahead - back) / (ahead + back))


def calibrate_rate_table(
    rate: FloatArray, output: FloatArray, keep: tuple[float, float] | None = None, *, where: str = ""
) -> RateTable:
    """Fit zero and scale factor.

    `rate` (n,): rates of the table, in any unit. `output` (n,): output at each, in volts or counts. `keep`: smallest
    and largest rate to use; by default saturated rates are found and left out.
    Raises: InputError: too few rates, columns that seem to be exchanged, or a sensor that does not respond.
    """
    _refuse_nonsense(rate, output, where)
    used, dropped = _linear_part(rate, output, where) if keep is None else ((rate >= keep[0]) & (rate <= keep[1]), ())
    if (count := int(np.count_nonzero(used))) < FEWEST:
        option = "" if keep is None else "--range"
        raise InputError("lab.few_rates", where=where, count=count, total=rate.size, limit=FEWEST, option=option)
    fit = _line(rate[used], output[used], where)
    if abs(fit.value[1]) < 5.0 * fit.sd[1]:
        raise InputError(
            "lab.rate_ignored", where=where, scale=fit.value[1], scale_sd=fit.sd[1], residual=np.abs(fit.residual).max()
        )
    if keep is None:
        fit = replace(fit, covariance=_spread(rate[used], output[used], fit))
    else:
        reason = Finding.of(Code.BENCH_RATE_EXCLUDED, low_setting=keep[0], high_setting=keep[1])
        dropped = tuple(_dropped(rate[i], output[i], fit, FALSE_ALARM, reason) for i in np.flatnonzero(~used))
    forward, reverse = (
        _line(rate[rows], output[rows], where) if np.unique(rate[rows]).size >= 3 else None
        for rows in (used & (rate >= 0.0), used & (rate <= 0.0))
    )
    return RateTable(rate, output, used, fit, forward, reverse, dropped)


def prediction_limit(fit: Fit, rate: float, probability: float) -> float:
    """Compute the largest distance of a further measurement from the line by chance.

    `fit`: a line, from `calibrate_rate_table`. `rate`: rate of the measurement. `probability`: of a larger distance,
    two-sided. Seber and Lee, Linear Regression Analysis, section 5.3.1.
    """
    row = np.array([1.0, rate])
    return float(coverage_factor(fit.dof, 1.0 - probability) * np.sqrt(fit.sigma**2 + row @ fit.covariance @ row))


def _line(rate: FloatArray, output: FloatArray, where: str) -> Fit:
    return linear_fit(np.column_stack((np.ones_like(rate), rate)), output, NAMES, where=where)


def _linear_part(rate: FloatArray, output: FloatArray, where: str) -> tuple[BoolArray, tuple[Dropped, ...]]:
    """Grow the line from the inner half of the rates outwards; drop rates from the first disagreement on."""
    order = np.argsort(np.abs(rate), kind="stable")
    core = max(FEWEST, order.size // 2)
    used = np.zeros(rate.size, dtype=np.bool_)
    used[order[:core]] = True
    dropped: list[Dropped] = []
    closed: dict[bool, float] = {}  # sense of rotation: the rate of the first disagreement
    outer = order[core:]
    for i in outer:
        sense = bool(rate[i] > 0.0)
        fit = _line(rate[used], output[used], where)
        residual = float(output[i] - fit.value @ [1.0, rate[i]])
        limit = prediction_limit(fit, float(rate[i]), FALSE_ALARM / outer.size)
        if sense in closed:
            reason = Finding.of(Code.BENCH_RATE_BEYOND, setting=closed[sense])
        elif abs(residual) > limit:
            closed[sense] = float(rate[i])
            weaker = residual * rate[i] * fit.value[1] < 0.0
            code = Code.BENCH_RATE_SATURATED if weaker else Code.BENCH_RATE_NONLINEAR
            reason = Finding.of(code, residual_sigma=abs(residual) / fit.sigma)
        else:
            used[i] = True
            continue
        dropped.append(Dropped(float(rate[i]), residual, limit, reason))
    for i in _bent(rate, output, used):
        used[i] = False
        line = _line(rate[used], output[used], where)
        dropped.append(_dropped(rate[i], output[i], line, SOFT, Finding.of(Code.BENCH_RATE_BENDING)))
    return used, tuple(sorted(dropped, key=lambda item: item.rate))


def _bent(rate: FloatArray, output: FloatArray, used: BoolArray) -> IntArray:
    """Find outermost rates of one side at which the output falls short of the line; none if by chance.

    A corner at the last rate before them is fitted, and its slope tested by Student's t, one-sided. The least probable
    of both sides and of 1 to `BENT` rates counts (Seber and Lee, section 4.3; about four independent tests).
    """
    rows = np.flatnonzero(used)
    r, u = rate[rows], output[rows]
    least, found = SOFT / 4.0, rows[:0]
    for side in (1.0, -1.0):
        places = np.unique(side * r)[::-1]
        for count in range(1, min(BENT, places.size - FEWEST) + 1):
            beyond = np.maximum(side * r - places[count], 0.0)
            try:
                fit = linear_fit(np.column_stack((np.ones_like(r), r, beyond)), u, (*NAMES, "corner"))
            except InputError:
                continue
            weaker = side * np.sign(fit.value[1]) * fit.value[2] / max(fit.sd[2], 1e-300)
            if fit.dof >= FEWEST and (p := float(stdtr(fit.dof, weaker))) < least:
                least, found = p, rows[beyond > 0.0]
    return found


def _spread(rate: FloatArray, output: FloatArray, fit: Fit) -> FloatArray:
    """Compute the covariance of a line, with the doubt how many of the outer rates are bent.

    Each hypothesis has 0 to `BENT` rates a side that fall short by any amount. A side is straight with prior one half.
    A line has the weight of Akaike's criterion, and its second moment about `fit` counts: Burnham and Anderson, Sociol.
    Methods Res. 33 (2004) 261-304.
    """
    places, design = np.unique(rate), np.column_stack((np.ones_like(rate), rate))
    floor = np.finfo(np.float64).eps ** 2 * float(output @ output)
    criteria, moments = [], []
    for low, high in product(range(BENT + 1), repeat=2):
        bent = [*places[:low], *places[places.size - high :]]
        if bent and places.size - len(bent) < FEWEST:
            continue
        straight = ~np.isin(rate, bent)
        line = _line(rate[straight], output[straight], "")
        excess = (output - design @ line.value) * np.sign(rate * line.value[1])
        rest = [line.residual, *(excess[rate == p] - min(excess[rate == p].mean(), 0.0) for p in bent)]
        squares = max(float(np.sum(np.concatenate(rest) ** 2)), floor)
        prior = np.log(BENT) * ((low == 0) + (high == 0))
        criteria.append((rate.size - 2) * np.log(squares) + 2.0 * (len(bent) - prior))
        own = np.linalg.inv(design[straight].T @ design[straight]) * squares / (rate.size - 2 - len(bent))
        moments.append(own + np.outer(line.value - fit.value, line.value - fit.value))
    weight = np.exp(-0.5 * (np.array(criteria) - min(criteria)))
    return np.asarray(np.average(moments, axis=0, weights=weight))


def _dropped(rate: float, output: float, fit: Fit, probability: float, reason: Finding) -> Dropped:
    residual = float(output - fit.value @ [1.0, rate])
    return Dropped(float(rate), residual, prediction_limit(fit, float(rate), probability), reason)


def _refuse_nonsense(rate: FloatArray, output: FloatArray, where: str) -> None:
    if not (np.isfinite(rate).all() and np.isfinite(output).all()):
        bad = int(np.argmin(np.isfinite(rate) & np.isfinite(output)))
        raise InputError("lab.value_missing", where=where, row=bad + 1)
    if np.unique(rate).size < FEWEST:
        raise InputError("lab.few_rates", where=where, count=np.unique(rate).size, limit=FEWEST)
    if _commanded(output) and not _commanded(rate):
        raise InputError("lab.columns_exchanged", where=where)


def _commanded(values: FloatArray) -> bool:
    """Return whether all values are multiples of a hundredth of a degree, as commanded rates are."""
    return bool(np.allclose(np.round(values, 2), values, rtol=0.0, atol=1e-9))


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> tuple[Record, ...]:
    """Read the rate tables of gyros x, y, z, or of one; see `read_records`."""
    return read_records(files, SCHEMA, how)


def fit(record: tuple[Record, ...], how: BenchOptions) -> Calibration[tuple[Record, ...], tuple[RateTable, ...]]:
    """Fit zero and scale factor of gyros x, y, z, or of one for all."""
    found = tuple(calibrate_gyro(item, how.keep) for item in record)
    warnings = [rate_table_warnings(item) for item in found]
    return triad_calibration("gyro", record, found, DEG, ("", "/(deg/s)"), how, warnings)


def calibrate_gyro(record: Record, keep: tuple[float, float] | None = None) -> RateTable:
    """Fit zero and scale factor of a gyro, with rates in deg/s as rate tables display them.

    `keep`: smallest and largest rate to use [deg/s]. Raises: InputError: see `calibrate_rate_table`; or a digital
    output in another unit than its column states.
    """
    # the table's rates are round numbers in deg/s
    found = calibrate_rate_table(np.round(record.setting / DEG, 9), record.output, keep, where=record.table.name)
    refuse_unit(record, float(found.fit.value[1]))
    return found


def rate_table_warnings(found: RateTable) -> tuple[Finding, ...]:
    """Report problems of a usable rate table."""
    used = np.unique(found.rate[found.used])
    left = sum(np.isfinite(item.limit) and item.reason.code != Code.BENCH_RATE_EXCLUDED for item in found.dropped)
    one_sense = bool(used[0] >= 0.0 or used[-1] <= 0.0)
    return (
        *(Finding.of(Code.BENCH_LEFT_OUT, count=left, total=found.rate.size),) * bool(left),
        *calibration.few("rates", used.size, USUAL_RATES),
        *(Finding.of(Code.BENCH_ONE_SENSE),) * one_sense,
    )
