"""IMU columns that hold volts or counts, brought to rates and specific forces by a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.imu.raw_outputs import RawScale
from insnav.input.interpret.columns import Found
from insnav.input.interpret.schema import IMU_SCHEMA, Quantity
from insnav.types import FloatArray

SI_UNITS = {"gyro": "rad/s", "accel": "m/s^2"}


def raw_schema(scales: Mapping[str, RawScale]) -> tuple[Quantity, ...]:
    """Columns of an IMU file, those of the named triads in volts or counts."""
    if not scales:
        return IMU_SCHEMA
    schema = []
    for quantity in IMU_SCHEMA:
        triad, _, axis = quantity.key.rpartition("_")
        if triad in scales:
            unit = scales[triad].unit
            quantity = replace(quantity, name=f"{triad}_{axis}_{unit.lower()}", dimension="signal", unit=unit)
        schema.append(quantity)
    return tuple(schema)


def from_outputs(
    columns: dict[str, FloatArray],
    found: Mapping[str, Found],
    scales: Mapping[str, RawScale],
    given: Mapping[str, str],
    *,
    increments: bool,
    where: str,
) -> tuple[tuple[Finding, ...], dict[str, str]]:
    """Replace outputs by rates [rad/s] and specific forces [m/s^2], in place.

    Raises: ConfigError: a unit that is not one of volts or counts was given; InputError: the file holds increments, or
    counts where volts are needed.
    """
    notes, units = [], {}
    for triad, scale in scales.items():
        if triad in given:
            values: dict[str, Any] = {"triad": triad, "unit": scale.unit, "given": given[triad]}
            raise ConfigError("input.unit_of_raw", where="imu-units", **values)
        if increments:
            raise InputError("input.increments_of_raw", where=where, triad=triad, unit=scale.unit)
        for i, axis in enumerate("xyz"):
            key = f"{triad}_{axis}"
            unit = found[key].unit or scale.unit
            try:
                columns[key] = scale.value(columns[key], i, unit)
            except ConfigError:
                where = f"{where}:{found[key].header}"
                raise InputError("input.other_raw_unit", where=where, unit=scale.unit, given=unit) from None
            units[key] = unit
        notes.append(Finding.of(Code.READ_IMU_RAW_SCALED, subject=triad, unit=scale.unit, si_unit=SI_UNITS[triad]))
    return tuple(notes), units
