"""Registry of data formats: modules of this package, selected by file content."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, Protocol, cast

from insnav.exceptions import ConfigError, InputError, reason_of
from insnav.findings import Code, of_code
from insnav.input.formats import delimited_text, nmea
from insnav.input.formats.source import Source, open_source
from insnav.input.formats.table import Table
from insnav.input.formats.unsupported import SHEETS, refusal
from insnav.input.interpret.composed import composed
from insnav.plain_text import plain_text


class Format(Protocol):
    """Interface of a format module: a new format is one file."""

    name: str  # display name of the format
    # optional attributes: usual file endings, for help and messages only, and the extra dependencies, as in
    # ``pip install insnav[extra]``
    suffixes: tuple[str, ...]
    extra: str

    def recognise(self, source: Source) -> bool:
        """Return whether a file has this format, by its first 16 KiB (`head`), or a folder by its `members`."""
        ...

    def read(self, source: Source) -> Mapping[str, Table]:
        """Return the tables of a file: ``{"": table}``, or ``imu``, ``gps``, ``reference`` if the file identifies them.

        Each of several sensors has its own table, such as ``imu:/camera/imu``, which ``--topic`` selects by that name.
        """
        ...


_LAST: dict[object, int] = {nmea: 1, delimited_text: 2}  # formats that are tried last, in this order


@cache
def formats() -> tuple[Format, ...]:
    """List the formats in the order in which they are tried; NMEA (found in other logs, too) and any text are last."""
    package = importlib.import_module("insnav.input.formats")
    names = [module.name for module in pkgutil.iter_modules(package.__path__)]
    modules = [importlib.import_module(f"{package.__name__}.{name}") for name in names]
    readers = [module for module in modules if hasattr(module, "recognise")]
    return tuple(cast(Format, module) for module in sorted(readers, key=lambda module: _LAST.get(module, 0)))


def open_table(path: str | Path | Table, part: str = "") -> Table:
    """Open a data file of any format, or standard input (``-``), and read its header.

    `part` {"", "imu", "gps", "reference"}: requested table if the file contains several.
    Raises: InputError: the file cannot be read, has no supported format, or lacks the part.
    """
    return composed(path) if isinstance(path, Table) else choose_table(open_tables(path), part, (), plain_text(path))


def open_tables(path: str | Path) -> Mapping[str, Table]:
    """Open the tables of a data file of any format, by part; see `Format.read` and `choose_table`."""
    return tables_of(open_source(path))


def tables_of(source: Source) -> Mapping[str, Table]:
    """Read the tables of an opened file."""
    chosen = next((module for module in formats() if module.recognise(source)), None)
    if chosen is None:
        if SHEETS & source.members.keys():
            raise InputError("format.other_data", where=source.name, kind="a spreadsheet")
        if source.members or not source.data:
            raise _folder(source)
        raise refusal(source.head, source.name, suffixes())
    try:
        tables = chosen.read(source)
        return {part: composed(replace(table, format=table.format or chosen.name)) for part, table in tables.items()}
    except ImportError as error:
        extra = getattr(chosen, "extra", "")
        if not extra:
            raise
        raise ConfigError(
            "format.no_package", where=source.name, format=chosen.name, reason=plain_text(reason_of(error)), extra=extra
        ) from error


def choose_table(tables: Mapping[str, Table], part: str, topics: Collection[str], where: str) -> Table:
    """Choose the table of a part: the only one of its kind, or the table of a sensor named in `topics`.

    Raises: InputError: the part is missing. ConfigError: several sensors have it, and `topics` names none of them.
    """
    kinds = (part, "") if part in ("imu", "gps") else (part, "gps", "")
    for kind in kinds:
        there = {key.partition(":")[2]: table for key, table in tables.items() if key.partition(":")[0] == kind}
        named = [table for topic, table in there.items() if topic in topics]
        if named:
            return named[0]
        if len(there) == 1:
            return next(iter(there.values()))
        if there:
            notes = of_code([note for table in there.values() for note in table.notes], Code.READ_IMU_MODEL_BY_GRAVITY)
            noise, topics = tuple(dict(note.values)["noise_rad_sqrt_s"] for note in notes), tuple(there)
            values: dict[str, Any] = {"part": part, "count": len(there), "topics": topics, "topic": topics[0]}
            if not noise:
                raise ConfigError("format.several_sensors", where=where, **values)
            raise ConfigError("format.several_scales", where=where, noise_rad_sqrt_s=noise, **values)
    parts_found = tuple(sorted({key.partition(":")[0] for key in tables}))
    format_name = next((table.format for table in tables.values()), "")
    if part == "imu":
        raise InputError(
            "format.fixes_for_samples" if "gps" in tables else "format.no_samples",
            where=where,
            format=format_name,
            found=parts_found,
            unusable=next((table.unusable for table in tables.values() if table.unusable), ()),
        )
    is_reference = part == "gps" and "reference" in tables
    shown: dict[str, Any] = {"part": part, "format": format_name, "found": parts_found}
    raise InputError("format.reference_for_fixes" if is_reference else "format.lacks_part", where=where, **shown)


def suffixes() -> tuple[str, ...]:
    """List the usual endings of supported files, without compression."""
    return tuple(sorted(suffix for module in formats() for suffix in getattr(module, "suffixes", ())))


def _folder(folder: Source) -> InputError:
    """Build the error for a folder or an archive that is no recording."""
    names = [name for name in folder.members if set(PurePosixPath(name.lower()).suffixes) & set(suffixes())]
    shown = tuple(map(plain_text, (names or [*folder.members])[:8]))
    if not shown:
        return InputError("format.empty_archive", where=folder.name)
    if "run.json" in folder.members:
        return InputError("format.result_folder", where=folder.name, folder=folder.name)
    return InputError(
        "format.folder_of_data" if names else "format.folder_without_data",
        where=folder.name,
        kind="folder" if folder.path else "archive",
        count=len(folder.members),
        shown=shown,
        folder=folder.name,
    )
