"""Acceptance figures of gyros and accelerometers: scale factor, bias, bias stability, bias repeatability.

U = U0 + K w over all settings, and forward and reverse by themselves; the mean of the two senses counts where both are
there. Bias is U0 / K. Bias stability is the standard deviation of the means of equal parts of a record at rest, over K;
bias repeatability that of the biases of several power-ups, over K, each the mean of the outputs at +w and at -w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.lab.allan import AXES
from insnav.lab.allan_statistics import chi_square_interval
from insnav.lab.bench_records import SI, BenchRecord, Channel
from insnav.lab.fit import linear_fit
from insnav.lab.rate_table import FEWEST, NAMES, RateTable, calibrate_rate_table
from insnav.types import FloatArray
from insnav.units import DEG, G0, UNITS

BENCH_UNIT = {"gyro": ("deg/s", DEG), "accel": ("g", G0)}
COMPLETE = 0.9  # a part with fewer of its samples is left out
TREND = 0.7  # share of the variance of the means that a steady drift explains and that is pointed out
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Scale:
    """Scale factor and bias of one sensor.

    Attributes
    ----------
    table : RateTable
        Settings and outputs, in deg/s or g and in the unit of the output.
    k, k_sd : float
        Scale factor that counts [output unit per deg/s or g], mean of forward and reverse where both are there.
    bias, bias_sd : float
        Zero over scale factor [rad/s] or [m/s^2].
    """

    table: RateTable
    k: float
    k_sd: float
    bias: float
    bias_sd: float


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviation of a few values.

    Attributes
    ----------
    values : (n,) array
        Biases of power-ups, or means of the parts of a record [rad/s] or [m/s^2].
    sd, low, high : float
        With n - 1, and its 95 % interval, values taken as independent and normally distributed.
    """

    values: FloatArray
    sd: float
    low: float
    high: float

    @property
    def variance(self) -> float:
        """Square of the standard deviation."""
        return self.sd**2


@dataclass(frozen=True, slots=True)
class Stability:
    """Bias stability over parts of one length.

    Attributes
    ----------
    length : float
        Of a part [s].
    time : (n,) array
        Middle of each part used [s].
    spread : Spread
        Of the means of the parts.
    """

    length: float
    time: FloatArray
    spread: Spread


@dataclass(frozen=True, slots=True)
class Accepted:
    """Figures of one sensor; None for what was not measured.

    Attributes
    ----------
    axis : str
        Such as ``gyro x``.
    unit : str
        Of its output.
    scale : Scale or None
    stability : tuple of Stability
    repeatability : Spread or None
    """

    axis: str
    unit: str
    scale: Scale | None
    stability: tuple[Stability, ...]
    repeatability: Spread | None


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Figures of all sensors.

    Attributes
    ----------
    sensors : tuple of Accepted
    length : float
        Of the record at rest [s]; zero without one.
    warnings, notes : tuple of str
    """

    sensors: tuple[Accepted, ...]
    length: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def spread_of(values: FloatArray, *, where: str = "") -> Spread:
    """Standard deviation with n - 1, and its interval.

    Parameters
    ----------
    values : (n,) array
        At least two.
    where : str
        Place to name in the error.

    Raises
    ------
    InputError
        Fewer than two values.
    """
    if values.size < 2:
        raise InputError(
            "one value has no scatter", where=where, why=f"there are {values.size}", fix="measure several times"
        )
    sd = float(np.std(values, ddof=1))
    low, high = chi_square_interval(sd, values.size - 1.0, CONFIDENCE)
    return Spread(values, sd, float(low), float(high))


def scale_of(channel: Channel, *, where: str = "") -> Scale:
    """Scale factor and bias of one sensor.

    Parameters
    ----------
    channel : Channel
        One row a dwell.
    where : str
        Place to name in errors.

    Raises
    ------
    InputError
        Too few settings, or a sensor that does not follow them.
    """
    factor = BENCH_UNIT[channel.axis.split()[0]][1]
    setting = np.round(channel.setting / factor, 9)  # round numbers, as they were set
    output = channel.output / factor if channel.unit in SI.values() else channel.output
    where = f"{where}, {channel.axis}"
    if np.unique(setting).size >= FEWEST:
        table = calibrate_rate_table(setting, output, where=where)
    else:  # six positions set an accelerometer to -1, 0 and 1 g only
        _refuse_few(setting, where)
        fit = linear_fit(np.column_stack((np.ones_like(setting), setting)), output, NAMES, where=where)
        table = RateTable(setting, output, np.ones(setting.size, dtype=np.bool_), fit, None, None, ())
    average = table.average
    zero, k = table.fit.value if average is None else average[0]
    zero_sd, k_sd = table.fit.sd if average is None else average[1]
    bias = zero / k
    # the zero is measured about as well as the line; how the scale factor errs matters for large biases only
    bias_sd = float(np.hypot(zero_sd, bias * k_sd)) / abs(k)
    return Scale(table, float(k), float(k_sd), float(bias * factor), bias_sd * factor)


def _refuse_few(setting: FloatArray, where: str) -> None:
    if np.unique(setting).size < 2 or setting.size < 3 or not setting.min() < 0.0 < setting.max():
        raise InputError(
            "these settings make no scale factor",
            where=where,
            why=f"there are {setting.size} dwells at {', '.join(f'{value:g}' for value in np.unique(setting))}",
            fix="measure on both sides of zero, three dwells at least",
        )


def stability_of(time: FloatArray, output: FloatArray, length: float) -> Stability | None:
    """Bias stability at one averaging time.

    Parameters
    ----------
    time : (n,) array
        [s], growing.
    output : (n,) array
        Bias over time [rad/s] or [m/s^2], whatever constant is in it.
    length : float
        Of the parts [s].

    Returns
    -------
    Stability or None
        None if the record does not hold two parts of that length.
    """
    expected = length / float(np.median(np.diff(time)))
    if expected < 1.0 - 1e-6:
        return None
    part = np.floor((time - time[0]) / length * (1.0 + 1e-9) + 1e-6).astype(np.int64)
    count = np.bincount(part)
    good = count >= COMPLETE * expected
    if np.count_nonzero(good) < 2:
        return None
    means = np.bincount(part, output)[good] / count[good]
    middle = time[0] + length * (np.flatnonzero(good) + 0.5)
    return Stability(length, middle, spread_of(means))


def powerup_biases(channel: Channel, powerup: FloatArray, *, where: str = "") -> FloatArray:
    """Bias of each power-up: the mean of the outputs at +w and at -w.

    Parameters
    ----------
    channel : Channel
        Settings and outputs.
    powerup : (n,) array
        Number of the power-up of each row.
    where : str
        Place to name in errors.

    Returns
    -------
    (q,) array
        In the unit of the output. Several w in one power-up are averaged.

    Raises
    ------
    InputError
        A power-up without rows at +w or at -w, or of other settings than the first.
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
            raise InputError(
                f"power-up {number:g} does not show the bias of {channel.axis}",
                where=where,
                why="rows at +w and at -w are needed, the same w in every power-up",
                fix="add the missing settings, or leave this power-up out",
            )
        first = sizes
        biases.append(float(np.mean(pairs)))
    return np.array(biases)


def acceptance(
    steps: Sequence[BenchRecord],
    static: BenchRecord | None,
    powerups: Sequence[BenchRecord],
    lengths: Sequence[float] = (1.0, 10.0, 100.0),
) -> Acceptance:
    """All acceptance figures that some files give.

    Parameters
    ----------
    steps : sequence of BenchRecord
        Rate tables and positions.
    static : BenchRecord or None
        At rest.
    powerups : sequence of BenchRecord
    lengths : sequence of float
        Averaging times of the bias stability [s].

    Raises
    ------
    ConfigError
        Two files for one sensor, units that do not go together, or volts without a scale factor.
    InputError
        Files that do not show what they should.
    """
    warnings = [f"{r.table.name}: {text}" for r in (*steps, *powerups) for text in r.warnings]
    notes: list[str] = []
    scales: dict[str, tuple[Scale, str]] = {}
    for record in steps:
        for axis, channel in record.channels.items():
            _refuse_twice(axis in scales, axis, record)
            scales[axis] = scale_of(channel, where=record.table.name), channel.unit
    spreads: dict[str, Spread] = {}
    for record in powerups:
        assert record.powerup is not None
        for axis, channel in record.channels.items():
            _refuse_twice(axis in spreads, axis, record)
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
    return Acceptance(tuple(sensors), length, tuple(warnings), tuple(dict.fromkeys(notes)))


def _refuse_twice(twice: bool, axis: str, record: BenchRecord) -> None:
    if twice:
        raise ConfigError(f"{axis} is in two files of one kind", where=record.table.name, fix="give one of them")


def _repeatability(
    channel: Channel,
    record: BenchRecord,
    scale: tuple[Scale, str] | None,
    warnings: list[str],
    notes: list[str],
) -> Spread:
    where = record.table.name
    if not channel.setting.size:  # biases as somebody else computed them
        warnings.append(
            f"{where}: the biases of {channel.axis} are taken as given. Repeatability is the scatter of biases from "
            "power-up to power-up: values that are the noise within one record, as are some published ones, make none"
        )
        return spread_of(channel.output, where=where)
    assert record.powerup is not None
    biases = powerup_biases(channel, record.powerup, where=where) / _per_si(channel, scale, where, notes)
    if biases.size < 5:
        warnings.append(f"{where}: {biases.size} power-ups of {channel.axis} leave its repeatability very uncertain")
    return spread_of(biases, where=where)


def _stability(
    channel: Channel,
    record: BenchRecord,
    scale: tuple[Scale, str] | None,
    lengths: Sequence[float],
    warnings: list[str],
    notes: list[str],
) -> list[Stability]:
    assert record.time is not None
    output = channel.output / _per_si(channel, scale, record.table.name, notes)
    found = []
    for length in lengths:
        each = stability_of(record.time, output, length)
        if each is None:
            notes.append(f"{record.table.name}: the record does not hold two parts of {length:g} s")
        else:
            found.append(each)
    for each in found[::-1]:
        values = each.spread.values
        if values.size >= 10:  # the longest that can show a trend
            share = np.corrcoef(each.time, values)[0, 1] ** 2 if each.spread.sd > 0.0 else 0.0
            if share > TREND:
                warnings.append(
                    f"{channel.axis} drifts steadily: {share:.0%} of the variance of the means over {each.length:g} s "
                    "is a straight line, which the bias stability has in it (warming up?)"
                )
            break
    return found


def _per_si(channel: Channel, scale: tuple[Scale, str] | None, where: str, notes: list[str]) -> float:
    """Output for 1 rad/s or 1 m/s^2, in the unit of this channel."""
    sensed = channel.unit in SI.values()
    if scale is None:
        if not sensed:
            raise ConfigError(
                f"the output of {channel.axis} is in {channel.unit} and its scale factor is not known",
                where=where,
                fix="give the rate table with --rates, or the positions with --positions",
            )
        notes.append(f"{channel.axis}: no scale factor was measured, 1 is taken")
        return 1.0
    k, unit = scale[0].k, scale[1]
    if (unit in SI.values()) != sensed or (unit == "LSB") != (channel.unit == "LSB"):
        raise ConfigError(
            f"{channel.axis} has outputs in {unit} and in {channel.unit}", where=where, fix="give all files in one unit"
        )
    if sensed:
        return k
    return k / BENCH_UNIT[channel.axis.split()[0]][1] * UNITS[unit][1] / UNITS[channel.unit][1]
