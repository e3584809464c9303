"""Folders and archives with one file per part of a recording, named ``imu``, ``gps`` and ``ref``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import PurePosixPath

from insnav.findings import Code, Finding
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table

name = "folder of a recording"

NAMES = {"imu": "imu", "gps": "gps", "gnss": "gps", "ref": "reference", "reference": "reference"}
# words in a file name that suggest its part of the recording
ROLE = re.compile(r"(^|[-_. ])(imu|gps|gnss|gnns|ref|reference|truth|fixes|samples)\d*(?=$|[-_. ])", re.IGNORECASE)
# endings of file names that contain no measurements
NO_DATA = {".toml", ".json", ".md", ".yaml", ".html", ".pdf", ".png", ".svg", ".jpg", ".kml", ".tag", ".py", ".ipynb"}


def recognise(source: Source) -> bool:
    return "imu" in _files(source.members)


def read(source: Source) -> Mapping[str, Table]:
    from insnav.input.formats.registry import tables_of

    tables: dict[str, Table] = {}
    files, more = _files(source.members), unused(source.members)
    note = (
        [Finding.of(Code.READ_FILES_BY_NAME, files=tuple(sorted(files.values())), unused=tuple(more))] if more else []
    )
    for part, path in files.items():
        member_tables = tables_of(source.members[path]())
        table = member_tables.get(part, member_tables.get("gps", member_tables.get("")))
        if table is not None:
            tables[part] = replace(table, notes=(*table.notes, *note)) if part == "imu" else table
    return tables


def unused(paths: Iterable[str]) -> list[str]:
    """List unused files of a recording folder whose names suggest a part of the recording."""
    taken = _files(paths)
    return [path for path in paths if "imu" in taken and path not in taken.values() and ROLE.search(_stem(path))]


def _files(paths: Iterable[str]) -> dict[str, str]:
    """Find the file of each part; a part with several files in the folder is left out."""
    found: dict[str, list[str]] = {}
    for path in paths:
        part = NAMES.get(_stem(path).lower())
        if part is not None:
            found.setdefault(part, []).append(path)
    return {part: paths[0] for part, paths in found.items() if len(paths) == 1}


def _stem(path: str) -> str:
    """Return the name of a data file without endings; empty for other files and for files in subfolders."""
    return "" if "/" in path or PurePosixPath(path).suffix.lower() in NO_DATA else path.split(".")[0]
