"""Folders and archives with one file a part of a recording, by their names: ``imu``, ``gps`` and ``ref``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from insnav.input.formats.source import Source
from insnav.input.formats.table import Table

name = "folder of a recording"

_NAMES = {"imu": "imu", "gps": "gps", "gnss": "gps", "ref": "reference", "reference": "reference"}
_BESIDE = (".toml", ".json", ".md", ".png", ".html")  # what says something of the data


def recognise(source: Source) -> bool:
    return "imu" in _files(source)


def read(source: Source) -> Mapping[str, Table]:
    from insnav.input.formats.registry import tables_of

    tables: dict[str, Table] = {}
    for part, path in _files(source).items():
        found = tables_of(source.members[path]())
        table = found.get(part, found.get("gps", found.get("")))
        if table is not None:
            tables[part] = table
    return tables


def _files(source: Source) -> dict[str, str]:
    """File of each part, as far as one stands alone in the folder itself."""
    found: dict[str, list[str]] = {}
    for path in source.members:
        part = _NAMES.get(PurePosixPath(path).name.split(".")[0].lower())
        if part is not None and "/" not in path and not path.lower().endswith(_BESIDE):
            found.setdefault(part, []).append(path)
    return {part: paths[0] for part, paths in found.items() if len(paths) == 1}
