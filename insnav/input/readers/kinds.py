"""Detection of the kind of data in a file (IMU, fixes, reference), from its format, headers or values."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from insnav.exceptions import InputError, InsnavError
from insnav.input.formats.recording_folder import NAMES, NO_DATA
from insnav.input.formats.registry import open_tables
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import agrees, imu_columns, is_headerless, key_of, position_columns
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA, REFERENCE_SCHEMA, Quantity

_LOOKED_AT = 100  # largest number of files in a folder that are examined


def kinds_of(tables: Mapping[str, Table], *, imu_known: bool = False) -> set[str]:
    """Return the kinds of data in a file (``imu``, ``gps``, ``reference``), by its format, headers or values.

    `imu_known`: another file is the IMU file. If not, an unidentified table without header counts as IMU data.
    """
    kinds = {key.partition(":")[0] for key in tables}
    if "" not in kinds:
        return kinds
    table = next(iter(tables.values()))
    samples = _known(table.headers, IMU_SCHEMA, "gyro accel dtheta dvel")
    attitude = _known(table.headers, REFERENCE_SCHEMA, "lat roll pitch")
    if not samples and all(key_of(header, REFERENCE_SCHEMA) in ("", "time") for header in table.headers):
        if imu_columns(table):
            return {"imu"}
        if (columns := position_columns(table)) and agrees(columns, {}, IMU_SCHEMA):
            return {"gps"}
        return set() if not is_headerless(table.headers) or imu_known else {"imu"}
    return {"imu" if samples else "reference" if attitude else "gps"}


def data_files(folder: str | Path) -> list[Path]:
    """List files in a folder that may contain data."""
    paths = sorted(path for path in Path(folder).iterdir() if path.is_file() and path.suffix.lower() not in NO_DATA)
    return [path for path in paths if not path.name.startswith(".")]


def files_with(kind: str, folder: Path) -> list[str]:
    """List the files of a folder with one kind of data only (see `kinds_of`), among its first hundred files."""
    return [file.name for file, _, kinds in _opened(data_files(folder)[:_LOOKED_AT]) if kinds == {kind}]


def _opened(files: Iterable[Path]) -> Iterator[tuple[Path, Mapping[str, Table], set[str]]]:
    """Yield each readable file with its tables and kinds of data."""
    for file in files:
        with suppress(InsnavError):
            tables = open_tables(file)
            yield file, tables, kinds_of(tables)


def open_parts(path: str | Path) -> Mapping[str, Table]:
    """Return the tables of a file or folder by kind; in a folder, file names show the kinds, or else the contents do.

    If several files have the same kind, the file named after the kind is chosen, such as ``imu.csv``, otherwise none.
    """
    folder = Path(path).is_dir() and os.access(path, os.R_OK | os.X_OK)
    try:
        named = open_tables(path)
    except InputError:
        by_content = _by_content(Path(path)) if folder else {}
        if not by_content:
            raise
        return by_content
    return (folder and named.keys() == {"imu"} and _by_content(Path(path))) or named


def _by_content(folder: Path) -> Mapping[str, Table]:
    """Return the tables in a folder by kind, from the contents; empty unless IMU data and fixes are unique."""
    candidates: dict[tuple[str, bool], list[Table]] = {}  # by kind, and True if the file name states the kind
    for file, tables, kinds in _opened(data_files(folder)):
        by_name = NAMES.get(file.name.split(".")[0].lower())
        if len(kinds) == len(tables) == 1:
            candidates.setdefault((by_name or kinds.pop(), by_name is not None), []).extend(tables.values())
    chosen = {kind: candidates.get((kind, True)) or candidates[kind, False] for kind, _ in candidates}
    complete = {"imu", "gps"} <= chosen.keys() and all(len(files) == 1 for files in chosen.values())
    return {kind: files[0] for kind, files in chosen.items()} if complete else {}


def _known(headers: Sequence[str], schema: Sequence[Quantity], words: str) -> bool:
    count = sum(key_of(header, schema).partition("_")[0] in words.split() for header in headers)
    return count >= 3 and count > sum(key_of(header, GPS_SCHEMA) in ("lat", "lon") for header in headers)
