"""Raw inertial data from a file: counts or volts, whose sensitivity is what a calibration is to find."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from insnav.exceptions import InputError
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.axes import axes_matrix
from insnav.input.interpret.clean import IMU_KINDS
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.schema import IMU_SCHEMA
from insnav.input.readers.imu import _FORCES, _RATES, _SLOWEST, _damaged, _in_body, _temperature
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import ImuData


def read_counts(
    path: str | Path | Table, *, axes: str | None = None, columns: Mapping[str, str] | None = None
) -> Reading[ImuData]:
    """Read inertial data in raw units, only brought to body axes; arguments as for `insnav.input.read_imu`.

    Raises: InputError: the file cannot be used, or its headers state units; ConfigError: an option cannot be meant as
    given.
    """
    matrix = axes_matrix(axes or "FRD")
    table = open_table(path, "imu")
    name = table.name
    found, notes = understand(table.headers, table.units, IMU_SCHEMA, columns=columns, where=name)
    require(found, ("time", *_RATES, *_FORCES), table.headers, IMU_SCHEMA, where=name)
    stated = [found[key].describe() for key in (*_RATES, *_FORCES) if found[key].unit is not None]
    if stated:
        raise InputError(
            "the file states units, so it does not hold raw counts",
            where=name,
            why=", ".join(stated),
            fix="leave out --counts",
        )
    keys = ["time", *_RATES, *_FORCES, *(key for key in ("temperature",) if key in found)]
    rows = read_rows(table, found, keys, IMU_KINDS, slowest=_SLOWEST)
    cleaned = rows.clean(_damaged(rows.columns, keys[:7], found, name))
    time = cleaned.columns["time"]
    temperature, temperature_note = _temperature(time, cleaned.columns.get("temperature"))
    data = ImuData(
        time,
        _in_body(cleaned.columns, _RATES, matrix),
        _in_body(cleaned.columns, _FORCES, matrix),
        temperature=temperature,
    )
    return rows.reading(
        "IMU",
        data,
        cleaned,
        {found[key].quantity.key: found[key].header for key in keys},
        ("gyros and accelerometers in raw counts", *temperature_note, *notes),
        axes=(axes or "FRD").strip().upper(),
        sampling=data.sampling,
        stamp=data.stamp,
    )
