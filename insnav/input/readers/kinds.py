"""Which kind of recording a file is, by its format, its headers, or its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from insnav.exceptions import InsnavError
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import match_header
from insnav.input.interpret.headerless import imu_columns, is_headerless, position_columns
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA, REFERENCE_SCHEMA, Quantity


def kinds_of(tables: Mapping[str, Table], *, imu_known: bool = False) -> set[str]:
    """What a file holds, of ``imu``, ``gps`` and ``reference``: as its format says, by its headers, by its numbers."""
    kinds = {key.partition(":")[0] for key in tables}
    if "" not in kinds:
        return kinds
    table = next(iter(tables.values()))
    samples = _known(table.headers, IMU_SCHEMA, "gyro accel dtheta dvel")
    attitude = _known(table.headers, REFERENCE_SCHEMA, "lat roll pitch")
    if not samples and all(_key(header, REFERENCE_SCHEMA) in ("", "time") for header in table.headers):
        if imu_columns(table):
            return {"imu"}
        if position_columns(table):
            return {"gps"}
        return set() if not is_headerless(table.headers) or imu_known else {"imu"}
    return {"imu" if samples else "reference" if attitude else "gps"}


def _known(headers: Sequence[str], schema: Sequence[Quantity], words: str) -> bool:
    count = sum(_key(header, schema).partition("_")[0] in words.split() for header in headers)
    return count >= 3 and count > sum(_key(header, GPS_SCHEMA) in ("lat", "lon") for header in headers)


def _key(header: str, schema: Sequence[Quantity]) -> str:
    """Quantity that a header means; empty for none."""
    try:
        match = match_header(header, schema)
    except InsnavError:
        return ""
    return "" if match is None else match[0].key
