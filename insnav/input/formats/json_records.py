"""JSON: a document with arrays of records (bdd100k, Sensor Logger), or one record per line (openpilot, any logger).

Records of one sensor become a table, named by their array, by their only nested structure, or by a text of the record
(``sensor``, ``topic``, ...). All tables together are read as a folder of sensors.

References
----------
BDD100K, "info" files; comma.ai, openpilot ``log.capnp`` (``logMonoTime`` in nanoseconds); Sensor Logger, "JSON".
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.source import Source, decoded, refuse_bomb
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import key_of
from insnav.input.interpret.schema import IMU_SCHEMA
from insnav.plain_text import plain_text

name = "JSON records"
suffixes = (".json", ".jsonl")

_START = re.compile(rb'\s*(\[\s*)?\{\s*"')
_DECODER, _SPACE = json.JSONDecoder(), re.compile(r"[\s,]*")
_KINDS = ("sensor", "topic", "type", "name", "kind")  # keys of the text that names the sensor of a record
_MEMORY = 10  # bytes in memory per byte of the file: a number of 8 characters takes 24 bytes, its name a reference
_LISTED, _DEEPEST = 9, 8  # longest list of numbers, such as a covariance matrix, and most levels of structures
_Record = dict[str, Any]
_key_of = functools.cache(functools.partial(key_of, schema=IMU_SCHEMA))


def recognise(source: Source) -> bool:
    return not source.members and _START.match(bytes(decoded(source.head))) is not None


def read(source: Source) -> Mapping[str, Table]:
    from insnav.input.formats.registry import tables_of

    refuse_bomb(source.name, name, len(source.data), _MEMORY * len(source.data))
    tables: dict[str, list[_Record]] = {}
    documents, cut = _documents(source)
    for kind, record in _records(documents):
        tables.setdefault(kind, []).append(record)
    files = {f"{kind}.csv": functools.partial(_as_text, source, kind, rows) for kind, rows in tables.items()}
    if not files:
        raise InputError("format.json_no_records", where=source.name)
    parts = delimited_text.read(files.popitem()[1]()) if len(files) == 1 else tables_of(replace(source, members=files))
    given = delimited_text.name  # name of a format that defines no units and no height datum
    return {p: replace(t, notes=(*t.notes, *cut), name=source.name, format=t.format or given) for p, t in parts.items()}


def _documents(source: Source) -> tuple[list[Any], list[Finding]]:
    """Parse one document, or many one after the other; the last one of many may be truncated, with a finding."""
    text, documents = bytes(decoded(source.data)).decode("utf-8", "replace").rstrip("\0 \r\n"), list[Any]()
    position = 0
    while position < len(text):
        try:
            value, position = _DECODER.raw_decode(text, position)
        except (ValueError, RecursionError) as error:
            line = text.count("\n", 0, position) + 1
            if documents and "\n" not in text[position:]:
                return documents, [Finding.of(Code.ROWS_CUT, file=source.name, line=line)]
            reason = plain_text(error)[:200]
            raise InputError("format.json_damaged", where=f"{source.name}:{line}", reason=reason) from error
        documents.append(value)
        position = _SPACE.match(text, position).end()  # type: ignore[union-attr]
    return documents, []


def _records(value: Any, kind: str = "", above: _Record | None = None, depth: int = 0) -> Iterator[tuple[str, _Record]]:
    """Yield the records of a document with the name of their sensor. `above`: times of the enclosing record."""
    if isinstance(value, list):
        for item in value:
            yield from _records(item, kind, above, depth + 1)
    if not isinstance(value, dict) or depth > _DEEPEST:
        return
    times = {**(above or {}), **{key: item for key, item in value.items() if _key_of(key) == "time"}}
    lists = [key for key, item in value.items() if isinstance(item, list) and any(isinstance(e, dict) for e in item)]
    for key in lists:
        yield from _records(value[key], key, times, depth + 1)
    if len(value) > 1 and not lists:
        inner = [key for key, item in value.items() if isinstance(item, dict)]
        only = inner[0] if len(inner) == 1 else ""
        stated = next((text for key in _KINDS if isinstance(text := value.get(key), str) and text), only)
        yield stated or kind, _flat({**times, **{k: v for k, v in value.items() if k != only}, **value.get(only, {})})


def _flat(record: _Record, above: str = "", depth: int = 0) -> _Record:
    """Return the values of a record by path, such as ``gyro.x``; a single vector is named x, y, z without path."""
    paths: _Record = {}
    for key, value in record.items():
        names = "xyz" if isinstance(value, list) and len(value) == 3 else map(str, range(_LISTED))
        nested = value if isinstance(value, dict) else None
        nested = dict(zip(names, value, strict=False)) if isinstance(value, list) else nested
        if nested is None:
            paths[above + key] = value
        elif depth < _DEEPEST:
            paths |= _flat(nested, f"{above}{key}.", depth + 1)
    vectors = [path[:-1] for path in paths if path[-2:] == ".x" and {f"{path[:-1]}y", f"{path[:-1]}z"} <= paths.keys()]
    if not above and len(vectors) == 1:
        return {path.removeprefix(vectors[0]): value for path, value in paths.items()}
    return paths


def _as_text(source: Source, kind: str, records: list[_Record]) -> Source:
    """Write the records of a sensor as delimited text."""
    names = dict.fromkeys(key for record in records for key in record)
    rows = [[_cell(key) for key in names], *([_cell(record.get(key)) for key in names] for record in records)]
    text = "".join(",".join(row) + "\n" for row in rows)
    return replace(source, name=f"{source.name}/{plain_text(kind)}", data=text.encode(), path=None)


def _cell(value: Any) -> str:
    """Return the text of a number, or of a text such as a date without delimiters; empty for other values."""
    if isinstance(value, bool | int | float):
        return str(int(value) if isinstance(value, bool) else value)
    return re.sub(r'[,"]', " ", plain_text(value))[:80] if isinstance(value, str) else ""
