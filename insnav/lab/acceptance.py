"""Acceptance test of a sensor: scale factor, bias, bias stability and bias repeatability.

U = U0 + K w over all settings, and over forward and reverse separately; if both exist, their mean counts. Bias is U0 /
K. Bias stability is the standard deviation of the means of equal parts of a record at rest, over K. Bias repeatability
is the standard deviation of the biases of several power-ups, over K. Each of these is the mean of the outputs at +w and
at -w.
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
COMPLETE = 0.9  # a part with a smaller share of its samples is omitted
CONFIDENCE = 0.95
ONE_PART = 1.05  # least record length for a moving average, relative to its window
LARGEST_K = 2.0  # of a sensor whose output has the unit of its input


@dataclass(frozen=True, slots=True)
class Scale:
    """Scale factor and bias of one sensor."""

    table: RateTable  # settings and outputs, in deg/s or g and in the unit of the output
    k: float  # scale factor that counts [output unit per deg/s or g], mean of forward and reverse where both are there
    k_sd: float
    bias: float  # zero over scale factor [rad/s] or [m/s^2]
    bias_sd: float


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviation of a few values."""

    values: FloatArray  # (n,) biases of power-ups, or means of the parts of a record [rad/s] or [m/s^2]
    sd: float  # with n - 1, and its 95 % interval, values taken as independent and normally distributed
    low: float
    high: float

    @property
    def variance(self) -> float:
        """Square of the standard deviation."""
        return self.sd**2


@dataclass(frozen=True, slots=True)
class Stability:
    """Bias stability over parts of one length."""

    length: float  # of a part [s]
    time: FloatArray  # (n,) middle of each part used [s]
    spread: Spread  # of the means of the parts; NaN where the record holds one part only
    sliding: float  # standard deviation of the moving average over the same length [rad/s] or [m/s^2]
    parts: float  # so many parts of this length the record holds


def spread_of(values: FloatArray, *, where: str = "") -> Spread:
    """Standard deviation with n - 1, and its interval.

    `values` (n,): at least two. Raises: InputError: fewer than two values.
    """
    if values.size < 2:
        raise InputError("lab.no_scatter", where=where, count=values.size)
    sd = float(np.std(values, ddof=1))
    low, high = chi_square_interval(sd, values.size - 1.0, CONFIDENCE)
    return Spread(values, sd, float(low), float(high))


def scale_of(channel: Channel, *, where: str = "") -> Scale:
    """Scale factor and bias of one sensor.

    `channel`: one row a dwell. Raises: InputError: too few settings, or a sensor that does not follow them.
    """
    factor = BENCH_UNIT[channel.axis.split()[0]][1]
    setting = np.round(channel.setting / factor, 9)  # round numbers, as they were set
    output = channel.output / factor if channel.unit in SI.values() else channel.output
    where = f"{where}, {channel.axis}"
    if np.unique(setting).size >= FEWEST:
        table = calibrate_rate_table(setting, output, where=where)
    else:  # six positions set an accelerometer to -1, 0 and 1 g only
        if np.unique(setting).size < 2 or setting.size < 3 or not setting.min() < 0.0 < setting.max():
            few = tuple(np.unique(setting).tolist())
            raise InputError("lab.few_settings", where=where, count=setting.size, settings=few)
        fit = linear_fit(np.column_stack((np.ones_like(setting), setting)), output, NAMES, where=where)
        table = RateTable(setting, output, np.ones(setting.size, dtype=np.bool_), fit, None, None, ())
    average = table.average
    (zero, k), (zero_sd, k_sd) = (table.fit.value, table.fit.sd) if average is None else average
    if channel.unit in SI.values() and not 1.0 / LARGEST_K < k < LARGEST_K:
        raise InputError("lab.scale_implausible", where=where, scale=k)
    bias = zero / k
    # the zero is measured about as well as the line; how the scale factor errs matters for large biases only
    bias_sd = float(np.hypot(zero_sd, bias * k_sd)) / abs(k)
    return Scale(table, float(k), float(k_sd), float(bias * factor), bias_sd * factor)


def stability_of(time: FloatArray, output: FloatArray, length: float) -> Stability | None:
    """Bias stability at one averaging time.

    `time` (n,): [s], growing. `output` (n,): bias over time [rad/s] or [m/s^2], whatever constant is in it. `length`:
    of the parts [s]. None if the record does not hold two parts of that length.
    """
    expected = length / float(np.median(np.diff(time)))
    if expected < 1.0 - 1e-6:
        return None
    part = np.floor((time - time[0]) / length * (1.0 + 1e-9) + 1e-6).astype(np.int64)
    count = np.bincount(part)
    good = count >= COMPLETE * expected
    width = round(expected)
    if not good.any() or time.size < ONE_PART * width:
        return None
    means = np.bincount(part, output)[good] / count[good]
    middle = time[0] + length * (np.flatnonzero(good) + 0.5)
    summed = np.cumsum(np.concatenate(([0.0], output - output.mean())))
    sliding = float(np.std((summed[width:] - summed[:-width]) / width, ddof=1))
    spread = spread_of(means) if means.size > 1 else Spread(means, np.nan, np.nan, np.nan)
    return Stability(length, middle, spread, sliding, time.size / expected)


def powerup_biases(channel: Channel, powerup: FloatArray, *, where: str = "") -> FloatArray:
    """Bias of each power-up: the mean of the outputs at +w and at -w.

    `channel`: settings and outputs. `powerup` (n,): number of the power-up of each row. Returns (q,): in the unit of
    the output. Several w in one power-up are averaged. Raises: InputError: A power-up without rows at +w or at -w, or
    of other settings than the first.
    """
    biases, first = [], None
    size = np.round(np.abs(channel.setting), 9)
    for number in dict.fromkeys(powerup.tolist()):
        here = powerup == number
        sizes = np.unique(size[here & (size > 0.0)])
        pairs = []
        for each in sizes:
            ahead, back = (channel.output[here & (size == each) & (sign * channel.setting > 0.0)] for sign in (1, -1))
            if ahead.size and back.size:
                pairs.append(0.5 * (ahead.mean() + back.mean()))
        if len(pairs) < sizes.size or not pairs or (first is not None and not np.array_equal(sizes, first)):
            raise InputError("lab.powerup_settings", where=where, powerup=number, sensor=channel.axis)
        first = sizes
        biases.append(float(np.mean(pairs)))
    return np.array(biases)


USUAL_POWERUPS = 5
TREND = 0.7  # share of the variance of the means that a steady drift explains and that is pointed out


@dataclass(frozen=True, slots=True)
class Accepted:
    """Acceptance figures of one sensor; None if not measured."""

    axis: str  # such as ``gyro x``
    unit: str  # of its output
    scale: Scale | None
    stability: tuple[Stability, ...]
    repeatability: Spread | None


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Figures of all sensors."""

    sensors: tuple[Accepted, ...]
    length: float  # of the record at rest [s]; zero without one
    warnings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    files: tuple[BenchFile, ...] = ()  # that the figures are from


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
    warnings = [each for r in (*steps, *powerups) for each in about(r.table.name, r.warnings)]
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
    files = tuple(r.table.file for r in (*steps, *([] if static is None else [static]), *powerups))
    return Acceptance(tuple(sensors), length, tuple(warnings), tuple(dict.fromkeys(notes)), files)


def _repeatability(
    channel: Channel,
    record: BenchRecord,
    scale: tuple[Scale, str] | None,
    warnings: list[Finding],
    notes: list[Finding],
) -> Spread:
    where = record.table.name
    if not channel.setting.size:  # biases as somebody else computed them
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
    found = []
    for length in lengths:
        each = stability_of(record.time, output, length)
        if each is None:
            notes.append(Finding.of(Code.ACCEPTANCE_SHORT, subject=record.table.name, length_s=length))
            continue
        found.append(each)
        if each.spread.values.size < 2:
            name = record.table.name
            warnings.append(Finding.of(Code.ACCEPTANCE_ONE_PART, subject=name, parts=each.parts, length_s=length))
    for each in found[::-1]:
        values = each.spread.values
        if values.size >= 10:  # the longest averaging time with enough values for a trend
            share = np.corrcoef(each.time, values)[0, 1] ** 2 if each.spread.sd > 0.0 else 0.0
            if share > TREND:
                axis, length = channel.axis, each.length
                warnings.append(
                    Finding.of(Code.ACCEPTANCE_TREND, subject=axis, share=share, limit_share=TREND, length_s=length)
                )
            break
    return found


def _per_si(channel: Channel, scale: tuple[Scale, str] | None, where: str, notes: list[Finding]) -> float:
    """Output for 1 rad/s or 1 m/s^2, in the unit of this channel."""
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
