"""Acceptance test of a sensor: scale factor, bias, bias stability and bias repeatability.

U = U0 + K w is fitted over all settings, and over forward and reverse settings separately. If both exist, the mean of
forward and reverse counts. Bias is U0 / K. Bias stability is the standard deviation of the means of equal parts of a
record at rest, over K. Bias repeatability is the standard deviation of the biases of several power-ups, over K. The
bias of a power-up is the mean of the outputs at +w and at -w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.lab.bench_data import SI, BenchFile, BenchRecord, Channel
from insnav.lab.calibration import about, few, linear_fit
from insnav.lab.noise.allan import AXES, chi_square_interval
from insnav.lab.single_axis.rate_table import FEWEST, NAMES, RateTable, calibrate_rate_table
from insnav.types import FloatArray
from insnav.units import DEG, G0, UNITS

BENCH_UNIT = {"gyro": ("deg/s", DEG), "accel": ("g", G0)}
COMPLETE = 0.9  # a part with a smaller share of the expected samples is omitted
CONFIDENCE = 0.95
ONE_PART = 1.05  # least record length for a moving average, relative to its window
LARGEST_K = 2.0  # largest plausible scale factor of a sensor whose output has the unit of its input


@dataclass(frozen=True, slots=True)
class Scale:
    """Scale factor and bias of one sensor."""

    table: RateTable  # settings in deg/s or g, outputs in the unit of the output
    k: float  # scale factor [output unit per deg/s or g]; mean of forward and reverse if both exist
    k_sd: float
    bias: float  # zero U0 over scale factor K [rad/s] or [m/s^2]
    bias_sd: float


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviation of a few values."""

    values: FloatArray  # (n,) biases of power-ups, or means of the parts of a record [rad/s] or [m/s^2]
    sd: float  # standard deviation with n - 1
    low: float  # ends of its 95 % interval, for independent and normally distributed values
    high: float

    @property
    def variance(self) -> float:
        """Square of the standard deviation."""
        return self.sd**2


@dataclass(frozen=True, slots=True)
class Stability:
    """Bias stability over parts of one length."""

    length: float  # length of a part [s]
    time: FloatArray  # (n,) middle of each part used [s]
    spread: Spread  # standard deviation of the means of the parts; NaN if the record has only one part
    sliding: float  # standard deviation of the moving average over the same length [rad/s] or [m/s^2]
    parts: float  # length of the record in parts of this length


def spread_of(values: FloatArray, *, where: str = "") -> Spread:
    """Compute the standard deviation with n - 1, and its 95 % interval.

    `values` (n,): at least two. Raises: InputError: fewer than two values.
    """
    if values.size < 2:
        raise InputError("lab.no_scatter", where=where, count=values.size)
    sd = float(np.std(values, ddof=1))
    low, high = chi_square_interval(sd, values.size - 1.0, CONFIDENCE)
    return Spread(values, sd, float(low), float(high))


def scale_of(channel: Channel, *, where: str = "") -> Scale:
    """Compute scale factor and bias of one sensor.

    `channel`: one row per dwell. Raises: InputError: too few settings, or a sensor that does not follow them.
    """
    factor = BENCH_UNIT[channel.axis.split()[0]][1]
    setting = np.round(channel.setting / factor, 9)  # commanded settings are round numbers
    output = channel.output / factor if channel.unit in SI.values() else channel.output
    where = f"{where}, {channel.axis}"
    if np.unique(setting).size >= FEWEST:
        table = calibrate_rate_table(setting, output, where=where)
    else:  # in six positions an accelerometer has only the settings -1, 0 and 1 g
        if np.unique(setting).size < 2 or setting.size < 3 or not setting.min() < 0.0 < setting.max():
            distinct = tuple(np.unique(setting).tolist())
            raise InputError("lab.few_settings", where=where, count=setting.size, settings=distinct)
        fit = linear_fit(np.column_stack((np.ones_like(setting), setting)), output, NAMES, where=where)
        table = RateTable(setting, output, np.ones(setting.size, dtype=np.bool_), fit, None, None, ())
    average = table.average
    (zero, k), (zero_sd, k_sd) = (table.fit.value, table.fit.sd) if average is None else average
    if channel.unit in SI.values() and not 1.0 / LARGEST_K < k < LARGEST_K:
        raise InputError("lab.scale_implausible", where=where, scale=k)
    bias = zero / k
    # errors of zero and scale factor are treated as independent; the scale factor matters only for large biases
    bias_sd = float(np.hypot(zero_sd, bias * k_sd)) / abs(k)
    return Scale(table, float(k), float(k_sd), float(bias * factor), bias_sd * factor)


def stability_of(time: FloatArray, output: FloatArray, length: float) -> Stability | None:
    """Compute the bias stability at one averaging time.

    `time` (n,): [s], increasing. `output` (n,): bias over time plus any constant [rad/s] or [m/s^2]. `length`: length
    of the parts [s]. None if the record is too short or its sampling interval too long for parts of this length.
    """
    expected = length / float(np.median(np.diff(time)))
    if expected < 1.0 - 1e-6:
        return None
    part_number = np.floor((time - time[0]) / length * (1.0 + 1e-9) + 1e-6).astype(np.int64)
    count = np.bincount(part_number)
    complete = count >= COMPLETE * expected
    width = round(expected)
    if not complete.any() or time.size < ONE_PART * width:
        return None
    means = np.bincount(part_number, output)[complete] / count[complete]
    middle = time[0] + length * (np.flatnonzero(complete) + 0.5)
    running_sum = np.cumsum(np.concatenate(([0.0], output - output.mean())))
    sliding = float(np.std((running_sum[width:] - running_sum[:-width]) / width, ddof=1))
    spread = spread_of(means) if means.size > 1 else Spread(means, np.nan, np.nan, np.nan)
    return Stability(length, middle, spread, sliding, time.size / expected)


def powerup_biases(channel: Channel, powerup: FloatArray, *, where: str = "") -> FloatArray:
    """Compute the bias of each power-up: the mean of the outputs at +w and at -w.

    `channel`: settings and outputs. `powerup` (n,): number of the power-up of each row. Returns (q,): in the unit of
    the output. Several w in one power-up are averaged. Raises: InputError: a power-up without rows at +w or at -w, or
    with other settings than the first.
    """
    biases, first = [], None
    size = np.round(np.abs(channel.setting), 9)
    for number in dict.fromkeys(powerup.tolist()):
        rows = powerup == number
        distinct = np.unique(size[rows & (size > 0.0)])
        pairs = []
        for level in distinct:
            ahead, back = (channel.output[rows & (size == level) & (sign * channel.setting > 0.0)] for sign in (1, -1))
            if ahead.size and back.size:
                pairs.append(0.5 * (ahead.mean() + back.mean()))
        if len(pairs) < distinct.size or not pairs or (first is not None and not np.array_equal(distinct, first)):
            raise InputError("lab.powerup_settings", where=where, powerup=number, sensor=channel.axis)
        first = distinct
        biases.append(float(np.mean(pairs)))
    return np.array(biases)


USUAL_POWERUPS = 5  # usual number of power-ups
TREND = 0.7  # a steady drift that explains a larger share of the variance of the means is reported


@dataclass(frozen=True, slots=True)
class Accepted:
    """Acceptance figures of one sensor; None if not measured."""

    axis: str  # sensor and axis, such as ``gyro x``
    unit: str  # unit of its output
    scale: Scale | None
    stability: tuple[Stability, ...]
    repeatability: Spread | None


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Acceptance figures of all sensors."""

    sensors: tuple[Accepted, ...]
    length: float  # length of the record at rest [s]; zero without such a record
    warnings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    files: tuple[BenchFile, ...] = ()  # source files of the figures


def acceptance(
    steps: Sequence[BenchRecord],
    static: BenchRecord | None,
    powerups: Sequence[BenchRecord],
    lengths: Sequence[float] = (1.0, 10.0, 100.0),
) -> Acceptance:
    """Compute all acceptance figures that the files determine.

    `lengths`: averaging times of the bias stability [s].
    Raises: ConfigError: two files for one sensor, incompatible units, or volts without a scale factor. InputError:
    files with unsuitable data.
    """
    warnings = [finding for source in (*steps, *powerups) for finding in about(source.table.name, source.warnings)]
    notes: list[Finding] = []
    scales: dict[str, tuple[Scale, str]] = {}
    for record in steps:
        for axis, channel in record.channels.items():
            if axis in scales:
                raise ConfigError("lab.sensor_twice", where=record.table.name, sensor=axis)
            scales[axis] = scale_of(channel, where=record.table.name), channel.unit
    spreads: dict[str, Spread] = {}
    for record in powerups:
        assert record.powerup is not None
        for axis, channel in record.channels.items():
            if axis in spreads:
                raise ConfigError("lab.sensor_twice", where=record.table.name, sensor=axis)
            spreads[axis] = _repeatability(channel, record, scales.get(axis), warnings, notes)
    sensors = []
    for axis in AXES:
        channel_at_rest = static.channels.get(axis) if static is not None else None
        if axis not in scales and axis not in spreads and channel_at_rest is None:
            continue
        stable: list[Stability] = []
        if static is not None and channel_at_rest is not None:
            stable = _stability(channel_at_rest, static, scales.get(axis), lengths, warnings, notes)
        scale, unit = scales.get(axis, (None, SI[axis.split()[0]]))
        sensors.append(Accepted(axis, unit, scale, tuple(stable), spreads.get(axis)))
    length = float(static.time[-1] - static.time[0]) if static is not None and static.time is not None else 0.0
    files = tuple(source.table.file for source in (*steps, *([] if static is None else [static]), *powerups))
    return Acceptance(tuple(sensors), length, tuple(warnings), tuple(dict.fromkeys(notes)), files)


def _repeatability(
    channel: Channel,
    record: BenchRecord,
    scale: tuple[Scale, str] | None,
    warnings: list[Finding],
    notes: list[Finding],
) -> Spread:
    where = record.table.name
    if not channel.setting.size:  # the file contains computed biases
        warnings.append(Finding.of(Code.ACCEPTANCE_GIVEN_BIASES, subject=f"{channel.axis} ({where})"))
        return spread_of(channel.output, where=where)
    assert record.powerup is not None
    biases = powerup_biases(channel, record.powerup, where=where) / _per_si(channel, scale, where, notes)
    warnings += few("power-ups", biases.size, USUAL_POWERUPS, f"{channel.axis} ({where})")
    return spread_of(biases, where=where)


def _stability(
    channel: Channel,
    record: BenchRecord,
    scale: tuple[Scale, str] | None,
    lengths: Sequence[float],
    warnings: list[Finding],
    notes: list[Finding],
) -> list[Stability]:
    assert record.time is not None
    output = channel.output / _per_si(channel, scale, record.table.name, notes)
    stabilities = []
    for length in lengths:
        stability = stability_of(record.time, output, length)
        if stability is None:
            notes.append(Finding.of(Code.ACCEPTANCE_SHORT, subject=record.table.name, length_s=length))
            continue
        stabilities.append(stability)
        if stability.spread.values.size < 2:
            name = record.table.name
            warnings.append(Finding.of(Code.ACCEPTANCE_ONE_PART, subject=name, parts=stability.parts, length_s=length))
    for stability in stabilities[::-1]:
        values = stability.spread.values
        if values.size >= 10:  # the longest averaging time with enough values for a trend
            share = np.corrcoef(stability.time, values)[0, 1] ** 2 if stability.spread.sd > 0.0 else 0.0
            if share > TREND:
                axis, length = channel.axis, stability.length
                warnings.append(
                    Finding.of(Code.ACCEPTANCE_TREND, subject=axis, share=share, limit_share=TREND, length_s=length)
                )
            break
    return stabilities


def _per_si(channel: Channel, scale: tuple[Scale, str] | None, where: str, notes: list[Finding]) -> float:
    """Return the output for 1 rad/s or 1 m/s^2, in the unit of this channel."""
    sensed = channel.unit in SI.values()
    if scale is None:
        if not sensed:
            raise ConfigError("lab.scale_unknown", where=where, sensor=channel.axis, unit=channel.unit)
        notes.append(Finding.of(Code.ACCEPTANCE_NO_SCALE, subject=channel.axis))
        return 1.0
    k, unit = scale[0].k, scale[1]
    if (unit in SI.values()) != sensed or (unit == "LSB") != (channel.unit == "LSB"):
        raise ConfigError("lab.two_units", where=where, sensor=channel.axis, units=(unit, channel.unit))
    if sensed:
        return k
    return k / BENCH_UNIT[channel.axis.split()[0]][1] * UNITS[unit][1] / UNITS[channel.unit][1]
