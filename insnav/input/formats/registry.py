"""The data formats: found as modules of this package, chosen by the content of a file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Protocol, cast

from insnav.exceptions import ConfigError, InputError
from insnav.input.formats import delimited_text, nmea
from insnav.input.formats.source import Source, open_source
from insnav.input.formats.table import Table
from insnav.input.formats.unsupported import unsupported
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
        what, fix = unsupported(source.head) or ("no table", "")
        usual = f"give one of the supported formats: {', '.join(suffixes())}, also with .gz, .zip"
        raise InputError(f"the file looks like {what}", where=source.name, why="by its first bytes", fix=fix or usual)
    try:
        tables = chosen.read(source)
        return {part: composed(replace(each, format=each.format or chosen.name)) for part, each in tables.items()}
    except ImportError as error:
        extra = getattr(chosen, "extra", "")
        if not extra:
            raise
        raise ConfigError(
            f"reading a {chosen.name} needs a package that is not installed",
            where=source.name,
            why=plain_text(error),
            fix=f"pip install 'insnav[{extra}]'",
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
            raise ConfigError(
                f"the file holds {len(there)} sensors for {part.upper()}",
                where=where,
                why=f"found: {', '.join(there)}",
                fix=f"say which one: --topic {next(iter(there))}",
            )
    kind = part.upper() if part in ("imu", "gps") else part
    found = " and ".join(sorted({key.partition(":")[0].upper() for key in tables}))
    format_name = next((table.format for table in tables.values()), "file")
    fix = "give the file with IMU data first, and this one with --gps" if part == "imu" and "gps" in tables else ""
    if part == "gps" and "reference" in tables:
        fix = "give the fixes with --gps, and this file with --ref"
    lacking = [table.lacking for table in tables.values() if table.lacking]
    why = "; ".join([f"{format_name}: it has {found}", *lacking[:1]])
    raise InputError(f"the file holds no {kind} data", where=where, why=why, fix=fix)


def suffixes() -> tuple[str, ...]:
    """Usual endings of the names of the files that can be read, without compression."""
    return tuple(sorted(suffix for each in formats() for suffix in getattr(each, "suffixes", ())))


def _folder(folder: Source) -> InputError:
    names = [name for name in folder.members if set(PurePosixPath(name.lower()).suffixes) & set(suffixes())]
    shown = ", ".join(map(plain_text, (names or [*folder.members])[:8]))
    kind = "folder" if folder.path else "archive"
    return InputError(
        f"this {kind} holds no recording of a kind that is known",
        where=folder.name,
        why=f"{len(folder.members)} file{'s' * (len(folder.members) > 1)}: {shown}" if shown else "it is empty",
        fix=f"give a file in it: {shown}; insnav check {folder.name} says what each is"
        if names
        else "give a file in it",
    )
