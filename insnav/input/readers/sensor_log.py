"""Logs of further sensors from a file: `insnav.input.interpret.schema.LOG_SCHEMAS` defines their content."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insnav.findings import Code
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.clean import Kinds
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.schema import LOG_SCHEMAS
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import read_rows
from insnav.types import SensorLog

_SLOWEST = 45.0  # a longer interval means another unit than seconds [s]


def read_sensor_log(path: str | Path | Table, name: str) -> Reading[SensorLog]:
    """Read the log of a further sensor.

    `path`: a data file of any supported format; the IMU file may contain columns of another sensor, too. `name`: the
    sensor, one of `LOG_SCHEMAS`, such as ``speedometer`` with columns ``time_s, speed_m_s`` and optionally ``sd_m_s``.
    Raises: InputError: the file cannot be used.
    """
    schema, alternatives = LOG_SCHEMAS[name]
    table = open_table(path, name)
    found, notes = understand(table.headers, table.units, schema, where=table.name)
    wanted = next((each for each in alternatives if set(each) <= set(found)), alternatives[-1])
    require(found, ("time", *wanted), table, schema)
    kinds = Kinds("rows", name, 0, 3, gaps=False)
    keys = ("time", *wanted, *(["sd"] if "sd" in found else []))
    rows = read_rows(table, found, keys, kinds, slowest=_SLOWEST)
    cleaned = rows.clean(~np.isfinite(rows.columns["time"]), Code.ROWS_NO_TIME)
    values = {key: cleaned.columns[key] * found[key].factor for key in keys[1:]}
    read = {found[key].quantity.name: found[key].describe(rows.time_unit if key == "time" else None) for key in keys}
    return rows.reading(name, SensorLog(name, cleaned.columns["time"], values), cleaned, read, notes)
