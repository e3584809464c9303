"""Kind of recording in a file, by format, headers or numbers."""

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

_LOOKED_AT = 100  # files examined to suggest candidates


def kinds_of(tables: Mapping[str, Table], *, imu_known: bool = False) -> set[str]:
    """Return the content of a file, of ``imu``, ``gps`` and ``reference``: by format, headers or numbers."""
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
    files = sorted(each for each in Path(folder).iterdir() if each.is_file() and each.suffix.lower() not in NO_DATA)
    return [each for each in files if not each.name.startswith(".")]


def files_with(kind: str, folder: Path) -> list[str]:
    """List files in a folder, of the first hundred, that contain one kind of data only; see `kinds_of`."""
    return [file.name for file, _, kinds in _opened(data_files(folder)[:_LOOKED_AT]) if kinds == {kind}]


def _opened(files: Iterable[Path]) -> Iterator[tuple[Path, Mapping[str, Table], set[str]]]:
    """Yield readable files, their tables and kinds."""
    for file in files:
        with suppress(InsnavError):
            tables = open_tables(file)
            yield file, tables, kinds_of(tables)


def open_parts(path: str | Path) -> Mapping[str, Table]:
    """Return tables of a file by part; in a folder without recording names or fixes, by the content of its files.

    Of several files of a kind, the one so named is chosen; otherwise none.
    """
    folder = Path(path).is_dir() and os.access(path, os.R_OK | os.X_OK)
    try:
        named = open_tables(path)
    except InputError:
        held = _by_content(Path(path)) if folder else {}
        if not held:
            raise
        return held
    return (folder and named.keys() == {"imu"} and _by_content(Path(path))) or named


def _by_content(folder: Path) -> Mapping[str, Table]:
    """Return tables of the single files with samples and with fixes, if any."""
    held: dict[tuple[str, bool], list[Table]] = {}  # by kind, and whether the name confirms it
    for file, tables, kinds in _opened(data_files(folder)):
        by_name = NAMES.get(file.name.split(".")[0].lower())
        if len(kinds) == len(tables) == 1:
            held.setdefault((by_name or kinds.pop(), by_name is not None), []).extend(tables.values())
    chosen = {kind: held.get((kind, True)) or held[kind, False] for kind, _ in held}
    whole = {"imu", "gps"} <= chosen.keys() and all(len(own) == 1 for own in chosen.values())
    return {kind: own[0] for kind, own in chosen.items()} if whole else {}


def _known(headers: Sequence[str], schema: Sequence[Quantity], words: str) -> bool:
    count = sum(key_of(header, schema).partition("_")[0] in words.split() for header in headers)
    return count >= 3 and count > sum(key_of(header, GPS_SCHEMA) in ("lat", "lon") for header in headers)
