"""Construction of table quantities from values, with units, labels and precision from ``tables.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from insnav.quantity import Quantity
from insnav.report.page import Section


@cache
def _tables() -> dict[str, dict[str, dict[str, Any]]]:
    return tomllib.loads(Path(__file__).with_name("tables.toml").read_text(encoding="utf-8"))


def of_table(name: str, found: object = None, /, **values: Any) -> tuple[Quantity, ...]:
    """Build the quantities that ``tables.toml`` lists under a name: one table row, or single quantities.

    `name`: table name, such as ``check.gps``. `found`: object with the values as attributes. `values`: values by
    key; they replace attributes.
    """
    kind, part = name.split(".")
    columns = ((key, column) for key, column in _tables()[kind][part].items() if isinstance(column, dict))
    return tuple(_of_column(key, column, found, values) for key, column in columns)


def of_section(
    name: str, rows: Iterable[tuple[Quantity, ...]], values: Mapping[str, Any] | None = None, **how: Any
) -> Section:
    """Build a report section from table rows, with key, title and note from ``tables.toml``.

    `name`: table name, such as ``drift.ramps``. `values`: inserted into title and note. `how`: other section fields.
    """
    kind, part = name.split(".")
    texts = {"key": part, "title": "", "note": ""} | _tables()[kind][part]
    title, note = (str(texts[field]).format(**(values or {})) for field in ("title", "note"))
    return Section(str(texts["key"]), title, rows=tuple(rows), note=note, **how)


def of_columns(name: str, **columns: Iterable[Any]) -> tuple[tuple[Quantity, ...], ...]:
    """Build the rows of a table from its columns; a column has one value per row. See `of_table`."""
    rows = zip(*columns.values(), strict=False)  # not strict: a column may be an endless iterator, such as a counter
    return tuple(of_table(name, **dict(zip(columns, row, strict=True))) for row in rows)


def _of_column(key: str, column: Mapping[str, Any], found: object, values: Mapping[str, Any]) -> Quantity:
    value = values[key] if key in values else attrgetter(column.get("of", key))(found)
    fields = {name: column[name] for name in ("unit", "meaning", "digits", "decimals") if name in column}
    fields |= {name: attrgetter(*column[name].split())(found) for name in ("sd", "interval") if name in column}
    fields |= {"unit": attrgetter(column["unit_of"])(found)} if "unit_of" in column else {}
    return Quantity(key, value, **fields)
