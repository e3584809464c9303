"""Bench files of one sensor at a time, and scale factor and zero of a gyro on a rate table.

The output is in volts, counts, or in the unit of the input. For volts and counts the calibration file contains zero and
scale (`insnav.imu.model.RawScale`), otherwise a bias and a scale factor.

A line fits output U over table rate w, U = U0 + K w + v with noise v, without saturated rates. A sensor leaves the line
at the ends of its range first, so the fit begins with the inner rates and grows outwards. A rate is included if it
agrees with the line through the previous rates. After the first disagreement, all larger rates on that side are
dropped. A line with a corner then detects a bend at an end in which each rate deviates by less than its noise.
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

FALSE_ALARM = 0.01  # probability of dropping a rate from a record without saturation
SOFT = 0.05  # the same for a bend at an end; with less, missed bends would make the interval of K too narrow
BENT = 3  # largest number of outer rates on a side that may be bent
FEWEST = 5  # least number of rates for a line with uncertainty
NAMES = ("zero U0", "scale factor K")
USUAL_RATES = 10  # usual number of rates: ± 10, 20, 40, 60, 80 deg/s
SCHEMA = schema("rate_table")


@dataclass(frozen=True, slots=True)
class Record:
    """Bench file of one sensor, reduced to one output per dwell."""

    table: BenchTable  # table of the file, as read
    dwells: Dwells  # setting [rad/s] or [rad], output in `unit`
    unit: str  # unit of the output
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

    `path`: columns of setting and output. Successive rows with the same setting are the samples of a dwell. `schema`:
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
    """Result of a method for one sensor, of any type: its fit has zero and scale factor as first parameters."""

    @property
    def fit(self) -> Fit:
        """Fit of the parameters: zero, scale factor, and further ones of the method."""


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

    `found`: result of each sensor, with the scale factor as output per `per` [rad/s] or [m/s^2]. `per_units`: text
    after the output unit in the unit of each parameter. `by_sensor`: warnings of the method for each sensor.
    """
    names = ("x", "y", "z") if len(record) == 3 else ("sensor",)
    fits = {name: item.fit for name, item in zip(names, found, strict=True)}
    value, sd = (np.array([getattr(fit, key)[:2] for fit in fits.values()]) for key in ("value", "sd"))
    (zero, scale), (zero_sd, scale_sd) = (np.array(each if len(each) == 3 else [each[0]] * 3).T for each in (value, sd))
    unit, gain = record[0].unit, np.abs(scale)
    known_errors: dict[str, Any]
    if record[0].raw:
        known_errors = {f"{sensor}_raw": RawScale(unit, zero, scale / per)}
    else:
        si = UNITS[unit][1]
        known_errors = {f"{sensor}_bias": zero * si, f"{sensor}_matrix": np.diag(scale / (per / si))}
    spread: dict[str, Any] = {f"{sensor}_bias": zero_sd / gain * per, f"{sensor}_matrix": np.diag(scale_sd / gain)}
    labels = {name: f"{sensor} {name}" if len(record) == 3 else sensor for name in names}
    groups = zip(labels.values(), record, by_sensor, strict=True)
    items = [each for name, item, extra in groups for each in calibration.about(name, (*item.warnings, *extra))]
    single = (Finding.of(Code.BENCH_ONE_SENSOR, subject=sensor),) * (len(record) == 1)
    warnings = (*items, *calibration.badly_conditioned({labels[name]: fit for name, fit in fits.items()}), *single)
    units = [f"{unit}{each}" for each in per_units]
    parameters = tuple(each for name, fit in fits.items() for each in calibration.fitted(fit, units, name))
    errors, sd_of = ImuErrors(**known_errors, name=how.name), CalibrationSd(**spread)
    return Calibration(sensor, errors, sd_of, parameters, fits, record, found, how, warnings)


@dataclass(frozen=True, slots=True)
class Dropped:
    """Rate that is dropped from the fit, with the reason."""

    rate: float  # rate of the table
    residual: float  # output minus line
    limit: float  # largest residual that chance explains
    reason: Finding


@dataclass(frozen=True, slots=True)
class RateTable:
    """Scale factor and zero of one gyro. Rates are in the unit of the input."""

    rate: FloatArray  # (n,) measured rates and outputs
    output: FloatArray
    used: BoolArray  # (n,) True for rates in the fit
    fit: Fit  # zero and scale factor over all used rates
    # fits of positive and of negative rates alone, zero in both; None with fewer than three
    forward: Fit | None
    reverse: Fit | None
    dropped: tuple[Dropped, ...]  # dropped rates

    @property
    def average(self) -> tuple[FloatArray, FloatArray] | None:
        """Mean zero and scale factor of both senses of rotation, with standard deviation, (2,) each.

        Dwells at rest belong to both senses, so the two fits are correlated.
        """
        if self.forward is None or self.reverse is None:
            return None
        # weights (2, n): zero and scale factor of the mean as linear functions of the outputs
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
    """Fit zero and scale factor of one gyro to its outputs on a rate table.

    `rate` (n,): rates of the table, in any unit. `output` (n,): output at each rate. `keep`: smallest and
    largest rate to use; by default saturated rates are detected and dropped.
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
    """Compute the largest distance between a line and a further measurement that chance explains.

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
    inner = max(FEWEST, order.size // 2)
    used = np.zeros(rate.size, dtype=np.bool_)
    used[order[:inner]] = True
    dropped: list[Dropped] = []
    closed: dict[bool, float] = {}  # by sense of rotation, True if positive: rate of the first disagreement
    outer = order[inner:]
    for i in outer:
        sense = bool(rate[i] > 0.0)
        fit = _line(rate[used], output[used], where)
        residual = float(output[i] - fit.value @ [1.0, rate[i]])
        limit = prediction_limit(fit, float(rate[i]), FALSE_ALARM / outer.size)
        if sense in closed:  # beyond the first disagreement on this side
            reason = Finding.of(Code.BENCH_RATE_BEYOND, setting=closed[sense])
        elif abs(residual) > limit:
            closed[sense] = float(rate[i])
            falls_short = residual * rate[i] * fit.value[1] < 0.0
            code = Code.BENCH_RATE_SATURATED if falls_short else Code.BENCH_RATE_NONLINEAR
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
    """Find outermost rates of one side at which the output falls short of the line significantly; empty if none.

    A line with a corner before these rates is fitted. One-sided Student's t tests its change of slope. The most
    significant of both sides and of 1 to `BENT` rates counts (about four independent tests; Seber and Lee, 4.3).
    """
    rows = np.flatnonzero(used)
    r, u = rate[rows], output[rows]
    smallest_p, bent = SOFT / 4.0, rows[:0]
    for side in (1.0, -1.0):
        distinct = np.unique(side * r)[::-1]
        for count in range(1, min(BENT, distinct.size - FEWEST) + 1):
            hinge = np.maximum(side * r - distinct[count], 0.0)
            try:
                fit = linear_fit(np.column_stack((np.ones_like(r), r, hinge)), u, (*NAMES, "corner"))
            except InputError:
                continue
            t = side * np.sign(fit.value[1]) * fit.value[2] / max(fit.sd[2], 1e-300)
            if fit.dof >= FEWEST and (p := float(stdtr(fit.dof, t))) < smallest_p:
                smallest_p, bent = p, rows[hinge > 0.0]
    return bent


def _spread(rate: FloatArray, output: FloatArray, fit: Fit) -> FloatArray:
    """Compute the covariance of a line, including the uncertainty of how many outer rates are bent.

    By each hypothesis, 0 to `BENT` rates of a side fall short by any amount. The prior probability of no bend on a side
    is one half. The second moments of all lines about `fit` are averaged, with weights by Akaike's criterion: Burnham
    and Anderson, Sociol. Methods Res. 33 (2004) 261-304.
    """
    distinct, design = np.unique(rate), np.column_stack((np.ones_like(rate), rate))
    floor = np.finfo(np.float64).eps ** 2 * float(output @ output)
    criteria, moments = [], []
    for low, high in product(range(BENT + 1), repeat=2):
        bent = [*distinct[:low], *distinct[distinct.size - high :]]
        if bent and distinct.size - len(bent) < FEWEST:
            continue
        straight = ~np.isin(rate, bent)
        line = _line(rate[straight], output[straight], "")
        excess = (output - design @ line.value) * np.sign(rate * line.value[1])
        # a mean shortfall of a bent rate is free; its scatter and a mean excess are residuals
        residuals = [line.residual, *(excess[rate == p] - min(excess[rate == p].mean(), 0.0) for p in bent)]
        squares = max(float(np.sum(np.concatenate(residuals) ** 2)), floor)
        prior = np.log(BENT) * ((low == 0) + (high == 0))
        criteria.append((rate.size - 2) * np.log(squares) + 2.0 * (len(bent) - prior))
        covariance = np.linalg.inv(design[straight].T @ design[straight]) * squares / (rate.size - 2 - len(bent))
        moments.append(covariance + np.outer(line.value - fit.value, line.value - fit.value))
    weight = np.exp(-0.5 * (np.array(criteria) - min(criteria)))
    return np.asarray(np.average(moments, axis=0, weights=weight))


def _dropped(rate: float, output: float, fit: Fit, probability: float, reason: Finding) -> Dropped:
    residual = float(output - fit.value @ [1.0, rate])
    return Dropped(float(rate), residual, prediction_limit(fit, float(rate), probability), reason)


def _refuse_nonsense(rate: FloatArray, output: FloatArray, where: str) -> None:
    if not (np.isfinite(rate).all() and np.isfinite(output).all()):
        row = int(np.argmin(np.isfinite(rate) & np.isfinite(output)))
        raise InputError("lab.value_missing", where=where, row=row + 1)
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
    tables = tuple(calibrate_gyro(item, how.keep) for item in record)
    warnings = [rate_table_warnings(item) for item in tables]
    return triad_calibration("gyro", record, tables, DEG, ("", "/(deg/s)"), how, warnings)


def calibrate_gyro(record: Record, keep: tuple[float, float] | None = None) -> RateTable:
    """Fit zero and scale factor of a gyro, with rates in deg/s as rate tables display them.

    `keep`: smallest and largest rate to use [deg/s]. Raises: InputError: see `calibrate_rate_table`; or a digital
    output in another unit than its column states.
    """
    # rates of a table are round numbers in deg/s: remove the rounding errors of the conversion
    table = calibrate_rate_table(np.round(record.setting / DEG, 9), record.output, keep, where=record.table.name)
    refuse_unit(record, float(table.fit.value[1]))
    return table


def rate_table_warnings(found: RateTable) -> tuple[Finding, ...]:
    """Report problems of a usable rate table."""
    used = np.unique(found.rate[found.used])
    count = sum(np.isfinite(item.limit) and item.reason.code != Code.BENCH_RATE_EXCLUDED for item in found.dropped)
    one_sense = bool(used[0] >= 0.0 or used[-1] <= 0.0)
    return (
        *(Finding.of(Code.BENCH_LEFT_OUT, count=count, total=found.rate.size),) * bool(count),
        *calibration.few("rates", used.size, USUAL_RATES),
        *(Finding.of(Code.BENCH_ONE_SENSE),) * one_sense,
    )
