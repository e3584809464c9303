"""The data formats: found as modules of this package, chosen by the content of a file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Protocol, cast

from insnav.exceptions import ConfigError, InputError, reason_of
from insnav.input.formats import delimited_text, nmea
from insnav.input.formats.source import Source, open_source
from insnav.input.formats.table import Table
from insnav.input.formats.unsupported import refusal
from insnav.input.interpret.composed import composed
from insnav.plain_text import plain_text


class Format(Protocol):
    """What a module of this package is if it reads a format: a new format is one file."""

    name: str  # of the format, for people
    # where it has them: usual endings of file names, for help and messages, as content decides; and the optional
    # dependencies it needs, as in ``pip install insnav[extra]``
    suffixes: tuple[str, ...]
    extra: str

    def recognise(self, source: Source) -> bool:
        """Whether a file is of this format, by its first 16 KiB (`head`); a folder, by the names of its `members`."""
        ...

    def read(self, source: Source) -> Mapping[str, Table]:
        """Tables of a file: ``{"": table}``, or ``imu``, ``gps``, ``reference`` where it says which it holds.

        Of several sensors of a kind each has its own: ``imu:/camera/imu``, which ``--topic`` chooses by that name.
        """
        ...


_LAST: dict[object, int] = {nmea: 1, delimited_text: 2}


@cache
def formats() -> tuple[Format, ...]:
    """Formats in the order in which they are asked: NMEA stands within others, and delimited text takes any text."""
    package = importlib.import_module("insnav.input.formats")
    names = [found.name for found in pkgutil.iter_modules(package.__path__)]
    modules = [importlib.import_module(f"{package.__name__}.{name}") for name in names]
    readers = [module for module in modules if hasattr(module, "recognise")]
    return tuple(cast(Format, module) for module in sorted(readers, key=lambda module: _LAST.get(module, 0)))


def open_table(path: str | Path | Table, part: str = "") -> Table:
    """Open a data file of any format, or standard input (``-``), and read its header.

    `part` {"", "imu", "gps", "reference"}: which table is wanted if the file holds several.
    Raises: InputError: the file cannot be read, is of no supported format, or does not hold that part.
    """
    return composed(path) if isinstance(path, Table) else choose_table(open_tables(path), part, (), plain_text(path))


def open_tables(path: str | Path) -> Mapping[str, Table]:
    """Tables of a data file of any format, by part; see `Format.read` and `choose_table`."""
    return tables_of(open_source(path))


def tables_of(source: Source) -> Mapping[str, Table]:
    """Tables of a file that was opened."""
    chosen = next((each for each in formats() if each.recognise(source)), None)
    if chosen is None:
        if source.members or not source.data:
            raise _folder(source)
        raise refusal(source.head, source.name, suffixes())
    try:
        tables = chosen.read(source)
        return {part: composed(replace(each, format=each.format or chosen.name)) for part, each in tables.items()}
    except ImportError as error:
        extra = getattr(chosen, "extra", "")
        if not extra:
            raise
        raise ConfigError(
            "format.no_package", where=source.name, format=chosen.name, reason=plain_text(reason_of(error)), extra=extra
        ) from error


def choose_table(tables: Mapping[str, Table], part: str, topics: Collection[str], where: str) -> Table:
    """Table of a part: the only one of its kind, or that of the sensor that was named.

    Raises: InputError: there is none; ConfigError: there are several, and none was named.
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
            found = tuple(there)
            raise ConfigError(
                "format.several_sensors", where=where, part=part, count=len(found), topics=found, topic=found[0]
            )
    found = tuple(sorted({key.partition(":")[0] for key in tables}))
    format_name = next((table.format for table in tables.values()), "")
    if part == "imu":
        raise InputError(
            "format.fixes_for_samples" if "gps" in tables else "format.no_samples",
            where=where,
            format=format_name,
            found=found,
            unusable=next((table.unusable for table in tables.values() if table.unusable), ()),
        )
    is_reference = part == "gps" and "reference" in tables
    raise InputError(
        "format.reference_for_fixes" if is_reference else "format.lacks_part",
        where=where,
        part=part,
        format=format_name,
        found=found,
    )


def suffixes() -> tuple[str, ...]:
    """Usual endings of the names of the files that can be read, without compression."""
    return tuple(sorted(suffix for each in formats() for suffix in getattr(each, "suffixes", ())))


def _folder(folder: Source) -> InputError:
    """Error of a folder or an archive that is no recording."""
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
