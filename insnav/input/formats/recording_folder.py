"""Folders and archives with one file a part of a recording, by their names: ``imu``, ``gps`` and ``ref``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from insnav.input.formats.source import Source
from insnav.input.formats.table import Table

name = "folder of a recording"

NAMES = {"imu": "imu", "gps": "gps", "gnss": "gps", "ref": "reference", "reference": "reference"}
# endings of files that are no data
NO_DATA = {".toml", ".json", ".md", ".yaml", ".html", ".pdf", ".png", ".svg", ".jpg", ".kml", ".tag", ".py", ".ipynb"}


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
        file = PurePosixPath(path)
        part = NAMES.get(file.name.split(".")[0].lower())
        if part is not None and "/" not in path and file.suffix.lower() not in NO_DATA:
            found.setdefault(part, []).append(path)
    return {part: paths[0] for part, paths in found.items() if len(paths) == 1}
