"""Acceptance figures of gyros and accelerometers from bench records (`insnav.lab.acceptance.figures_of_merit`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from insnav.exceptions import ConfigError
from insnav.findings import Code, Finding
from insnav.lab.acceptance.figures_of_merit import (
    BENCH_UNIT,
    Scale,
    Spread,
    Stability,
    powerup_biases,
    scale_of,
    spread_of,
    stability_of,
)
from insnav.lab.bench_data.bench_tables import BenchFile
from insnav.lab.bench_data.records import SI, BenchRecord, Channel
from insnav.lab.common_findings import about, few
from insnav.lab.noise.allan import AXES
from insnav.units import UNITS

USUAL_POWERUPS = 5
TREND = 0.7  # share of the variance of the means that a steady drift explains and that is pointed out


@dataclass(frozen=True, slots=True)
class Accepted:
    """Figures of one sensor; None for what was not measured."""

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
    """All acceptance figures that some files give.

    `lengths`: averaging times of the bias stability [s].
    Raises: ConfigError: two files for one sensor, units that do not go together, or volts without a scale factor;
    InputError: files that do not show what they should.
    """
    warnings = [each for r in (*steps, *powerups) for each in about(r.table.name, r.warnings)]
    notes: list[Finding] = []
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
    files = tuple(r.table.file for r in (*steps, *([] if static is None else [static]), *powerups))
    return Acceptance(tuple(sensors), length, tuple(warnings), tuple(dict.fromkeys(notes)), files)


def _refuse_twice(twice: bool, axis: str, record: BenchRecord) -> None:
    if twice:
        raise ConfigError("lab.sensor_twice", where=record.table.name, sensor=axis)


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
        if values.size >= 10:  # the longest that can show a trend
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
