"""Folders of EuRoC and TUM-VI (ASL): ``imu0/data.csv``, with times in nanoseconds.

References
----------
Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35(10), 2016.
"""

from __future__ import annotations

from collections.abc import Mapping

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.conventions import ACCEL, GYRO, text_columns
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table

name = "EuRoC folder"

_AXES = ("x", "y", "z")
_HEADERS = dict(zip(GYRO, (f"w_RS_S_{axis} [rad s^-1]" for axis in _AXES), strict=True))
_HEADERS |= dict(zip(ACCEL, (f"a_RS_S_{axis} [m s^-2]" for axis in _AXES), strict=True))


def recognise(source: Source) -> bool:
    return bool(_tables(source))


def read(source: Source) -> Mapping[str, Table]:
    tables = {}
    for folder, path in _tables(source).items():
        file = source.members[path]()
        table = delimited_text.read(file)[""]
        wanted = {"time_s": table.headers[0], **_HEADERS}
        read = text_columns(table, wanted.values())
        columns = read.named(wanted)
        if len(columns) != 7:
            raise InputError("format.euroc_columns", where=file.name, columns=table.headers)
        columns["time_s"] = columns["time_s"] * 1e-9
        notes = [Finding.of(Code.READ_REFERENCE_LOCAL)]
        tables[f"imu:{folder}"] = column_table(file, columns, notes, cut=read.cut)
    return tables


def _tables(source: Source) -> dict[str, str]:
    """Folder of each IMU, and its file."""
    parts = {path: path.split("/") for path in source.members}
    return {
        part[-2]: path
        for path, part in parts.items()
        if len(part) > 1 and part[-1] == "data.csv" and part[-2].startswith("imu")
    }
