"""The data formats: found as modules of this package, chosen by the content of a file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Protocol, cast

from insnav.exceptions import InputError
from insnav.input.formats import delimited_text
from insnav.input.formats.source import HEAD_BYTES, Source, open_source
from insnav.input.formats.table import Table
from insnav.input.formats.unsupported import unsupported
from insnav.plain_text import plain_text


class Format(Protocol):
    """What a module of this package is if it reads a format: a new format is one file."""

    name: str  # of the format, for people
    suffixes: tuple[str, ...]  # usual endings of file names, for help and messages: content decides
    extra: str  # the optional dependencies it needs, as in ``pip install insnav[extra]``; empty for none

    def recognise(self, head: bytes, name: str) -> bool:
        """Whether a file is of this format, by its first 16 KiB, decompressed, or its name if no content tells."""
        ...

    def read(self, source: Source) -> Mapping[str, Table]:
        """Tables of a file: ``{"": table}``, or ``{"imu": table, "gps": table}`` where it holds several."""
        ...


@cache
def formats() -> tuple[Format, ...]:
    """Formats in the order in which they are asked; delimited text, which takes any text, is the last."""
    package = importlib.import_module("insnav.input.formats")
    names = [found.name for found in pkgutil.iter_modules(package.__path__)]
    modules = [importlib.import_module(f"{package.__name__}.{name}") for name in names]
    readers = [module for module in modules if hasattr(module, "recognise")]
    return tuple(cast(Format, module) for module in sorted(readers, key=lambda module: module is delimited_text))


def open_table(path: str | Path | Table, part: str = "") -> Table:
    """Open a data file of any format, or standard input (``-``), and read its header.

    `part` {"", "imu", "gps"}: which table is wanted if the file holds several.
    Raises: InputError: the file cannot be read, is of no supported format, or does not hold that part.
    """
    if isinstance(path, Table):
        return path
    try:
        source = open_source(path)
    except IsADirectoryError:
        raise _folder(Path(path)) from None
    head = source.data[:HEAD_BYTES]
    chosen = next((each for each in formats() if each.recognise(head, source.name)), None)
    if chosen is None:
        what, fix = unsupported(bytes(head)) or ("no table", "")
        usual = f"give one of the supported formats: {', '.join(suffixes())}, also with .gz"
        raise InputError(f"the file looks like {what}", where=source.name, why="by its first bytes", fix=fix or usual)
    tables = chosen.read(source)
    table = tables.get(part) or tables.get("")
    if table is None:
        raise InputError(f"the file holds no {part.upper()} data", where=source.name, why=f"found: {', '.join(tables)}")
    return table


def suffixes() -> tuple[str, ...]:
    """Usual endings of the names of the files that can be read, without compression."""
    return tuple(sorted(suffix for each in formats() for suffix in each.suffixes))


def _folder(folder: Path) -> InputError:
    try:
        names = sorted(path.name for path in folder.iterdir() if set(path.suffixes) & set(suffixes()))[:8]
    except OSError:
        names = []
    listing = f": {', '.join(map(plain_text, names))}" if names else ""
    return InputError("this is a folder, not a file", where=plain_text(folder), fix=f"give a file in it{listing}")
