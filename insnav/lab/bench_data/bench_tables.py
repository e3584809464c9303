"""Tables from the bench: a few named columns, each with its unit in the header."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.schema import Quantity
from insnav.types import FloatArray

TIME = Quantity("time", "time_s", "time", "s", ("time", "t", "timestamp"))
TEMPERATURE = Quantity("temperature", "temperature_c", "temperature", "degC", ("temperature", "temp"))


@dataclass(frozen=True, slots=True)
class BenchFile:
    """Which file a result is from."""

    name: str  # the file and its digest
    sha256: str
    units: Mapping[str, str]  # units as in the file, by key


@dataclass(frozen=True, slots=True)
class BenchTable:
    """Columns of a bench file in SI units, but raw outputs in the unit of the file."""

    name: str  # the file and its digest
    sha256: str
    columns: Mapping[str, FloatArray]  # (n,) by key
    units: Mapping[str, str]  # units as in the file, by key

    @property
    def file(self) -> BenchFile:
        """Its file, without the columns."""
        return BenchFile(self.name, self.sha256, self.units)

    def stack(self, *keys: str) -> FloatArray:
        """Columns side by side, (n, k)."""
        return np.column_stack([self.columns[key] for key in keys])

    def get(self, key: str) -> FloatArray | None:
        """Column if the file has it."""
        return self.columns.get(key)


def read_bench(
    path: str | Path | Table,
    schema: Sequence[Quantity],
    needed: Sequence[str],
    *,
    columns: Mapping[str, str] | None = None,
    alternatives: Mapping[str, str] | None = None,
) -> BenchTable:
    """Read a table of the bench.

    schema: what it may hold; time and temperature always; needed: keys that it must hold; columns: quantity to
    header, for headers that are not understood by themselves; alternatives: key that does instead of a needed one.
    Raises InputError: A column is missing or has no unit, or a cell is empty.
    """
    table = open_table(path)
    schema = (*schema, TIME, TEMPERATURE)
    found, _ = understand(table.headers, table.units, schema, columns=columns, where=table.name)
    wanted = [
        other if key not in found and (other := (alternatives or {}).get(key, key)) in found else key for key in needed
    ]
    require(found, wanted, table.headers, schema, where=table.name, units_row=table.units)
    for item in found.values():
        if item.unit is None and item.quantity.dimension:
            raise InputError("lab.no_unit", where=table.name, column=item.header, name=item.quantity.name)
    if not found:
        raise InputError(
            "lab.no_column",
            where=table.name,
            headers=tuple(table.headers),
            known=tuple(item.name for item in schema[:4]),
        )
    numbers = table.cells.read([item.index for item in found.values()])
    if numbers.cut:
        raise InputError("lab.truncated", where=table.name, **dict[str, Any](numbers.cut.values))
    if numbers.n_rows == 0:
        raise InputError("lab.no_rows", where=table.name)
    values, units = {}, {}
    for key, item in found.items():
        raw = numbers.columns[item.index]
        if not np.isfinite(raw).all():
            row = int(np.argmin(np.isfinite(raw)))
            raise InputError("lab.value_missing", where=table.place(row, item.index))
        values[key] = raw if item.quantity.dimension == "signal" else raw * item.factor
        units[key] = item.unit or ""
    return BenchTable(table.name, table.sha256, values, units)
