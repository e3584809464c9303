"""JSON: a document with arrays of records (bdd100k, Sensor Logger), or one record a line (openpilot, any logger).

Records of one sensor become a table, named by their array, by their only structure, or by ``sensor`` and the like. All
tables together are read as a folder of sensors.

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
from insnav.input.formats.source import Source, decoded
from insnav.input.formats.table import Table
from insnav.input.formats.unpack import refuse_bomb
from insnav.input.interpret.columns import match_header
from insnav.input.interpret.schema import IMU_SCHEMA
from insnav.plain_text import plain_text

name = "JSON records"
suffixes = (".json", ".jsonl")

_START = re.compile(rb'\s*(\[\s*)?\{\s*"')
_KINDS = ("sensor", "topic", "type", "name", "kind")  # text that names the sensor of a record
_MEMORY = 10  # bytes in memory per byte of the file: a number of 8 characters takes 24 bytes, its name a reference
_LISTED = 9  # longest list of numbers, such as a covariance matrix
_Record = dict[str, Any]


def recognise(source: Source) -> bool:
    return not source.members and _START.match(bytes(decoded(source.head))) is not None


def read(source: Source) -> Mapping[str, Table]:
    from insnav.input.formats.registry import tables_of

    refuse_bomb(source.name, name, len(source.data), _MEMORY * len(source.data))
    tables: dict[str, list[_Record]] = {}
    whole, cut = _documents(source)
    for kind, record in (each for document in whole for each in _records(document)):
        tables.setdefault(kind, []).append(record)
    files = {f"{kind}.csv": functools.partial(_as_text, source, kind, rows) for kind, rows in tables.items()}
    if not files:
        raise InputError("format.json_no_records", where=source.name)
    found = delimited_text.read(files.popitem()[1]()) if len(files) == 1 else tables_of(replace(source, members=files))
    given = delimited_text.name  # defines neither units nor datum
    return {p: replace(t, notes=(*t.notes, *cut), name=source.name, format=t.format or given) for p, t in found.items()}


def _documents(source: Source) -> tuple[list[Any], list[Finding]]:
    """Parse the file as one document, or as one a line; the last line may be truncated."""
    text = decoded(source.data)[:].rstrip(b"\0 \r\n")
    lines = text.splitlines()
    documents: list[Any] = []
    try:
        return [json.loads(text)], []
    except (ValueError, RecursionError):
        pass
    for number, line in enumerate(lines, 1):
        try:
            documents += [json.loads(line)] if line.strip() else []
        except (ValueError, RecursionError) as error:
            if number < len(lines) or not documents:
                where, reason = f"{source.name}:{number}", plain_text(error)[:200]
                raise InputError("format.json_damaged", where=where, reason=reason) from error
            return documents, [Finding.of(Code.ROWS_CUT, file=source.name, line=number)]
    return documents, []


def _records(value: Any, kind: str = "", above: _Record | None = None) -> Iterator[tuple[str, _Record]]:
    """Yield the records of a document with the name of their sensor. `above`: times of the enclosing record."""
    if isinstance(value, list):
        for each in value:
            if isinstance(each, dict):
                yield from _records(each, kind, above)
        return
    if not isinstance(value, dict):
        return
    stated = next((text for key in _KINDS if isinstance(text := value.get(key), str) and text), "")
    lists = {
        key: each for key, each in value.items() if isinstance(each, list) and any(isinstance(e, dict) for e in each)
    }
    inner = {key: each for key, each in value.items() if isinstance(each, dict)}
    scalars = {key: each for key, each in value.items() if not isinstance(each, dict | list)}
    times = {**(above or {}), **{key: each for key, each in scalars.items() if _is_time(key)}}
    for key, each in lists.items():
        yield from _records(each, key, times)
    if lists:
        return
    if len(inner) == 1 and len(value) > 1:
        ((key, only),) = inner.items()
        yield stated or key, {**times, **scalars, **_flat(only)}
    elif len(value) > 1:
        yield stated or kind, {**times, **_flat(value)}


@functools.cache
def _is_time(key: str) -> bool:
    match = match_header(key, IMU_SCHEMA)
    return match is not None and match[0].key == "time"


def _flat(record: _Record, above: str = "") -> _Record:
    """Return the numbers of a record by path; the only vector of three is x, y, z."""
    found: _Record = {}
    for key, value in record.items():
        path = f"{above}.{key}" if above else str(key)
        if isinstance(value, dict):
            found |= _flat(value, path)
        elif isinstance(value, list):
            names = "xyz" if len(value) == 3 else map(str, range(len(value)))
            found |= {f"{path}_{axis}": each for axis, each in zip(names, value[:_LISTED], strict=False)}
        else:
            found[path] = value
    vectors = [path for path in found if path.endswith("_x") and {f"{path[:-1]}y", f"{path[:-1]}z"} <= found.keys()]
    if not above and len(vectors) == 1:
        return {path.removeprefix(vectors[0][:-1]): value for path, value in found.items()}
    return found


def _as_text(source: Source, kind: str, records: list[_Record]) -> Source:
    """Write the records of a sensor as delimited text."""
    names = dict.fromkeys(key for record in records for key in record)
    rows = [[plain_text(key).replace(",", " ").replace('"', "") for key in names]]
    rows += [[_cell(record.get(key)) for key in names] for record in records]
    text = "\n".join(",".join(row) for row in rows) + "\n"
    return replace(source, name=f"{source.name}/{plain_text(kind)}", data=text.encode(), path=None)


def _cell(value: Any) -> str:
    """Return a cell without delimiters: a number, or a text such as a date."""
    if isinstance(value, bool | int | float):
        return repr(float(value)) if isinstance(value, bool) or value != value else repr(value)
    return plain_text(value)[:40] if isinstance(value, str) and not set(value) & set(',"\n\r') else ""
