"""Folders of EuRoC and TUM-VI (ASL): ``imu0/data.csv``, with times in nanoseconds.

References
----------
Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35(10), 2016.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table

name = "EuRoC folder"


def recognise(source: Source) -> bool:
    return bool(_tables(source))


def read(source: Source) -> Mapping[str, Table]:
    tables = {}
    for folder, path in _tables(source).items():
        table = delimited_text.read(source.members[path]())[""]
        tables[f"imu:{folder}"] = replace(table, notes=(Finding.of(Code.READ_REFERENCE_LOCAL),))
    return tables


def _tables(source: Source) -> dict[str, str]:
    """Return the path of the data file in each IMU folder."""
    parts = {path: path.split("/") for path in source.members}
    return {
        part[-2]: path
        for path, part in parts.items()
        if len(part) > 1 and part[-1] == "data.csv" and part[-2].startswith("imu")
    }
