"""What all readers do: columns with time in seconds, rows cleaned, and what was understood kept beside the data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from insnav.input.formats.table import Table
from insnav.input.interpret.clean import Cleaned, Kinds, clean, cut_event
from insnav.input.interpret.columns import Found
from insnav.input.interpret.physics import find_time_unit
from insnav.input.interpret.schema import ALL_UNITS
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.types import BoolArray, FloatArray, Sampling, Stamp

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Rows:
    """Columns of a file on their way to data."""

    table: Table  # the file
    kinds: Kinds  # what sort of rows it has
    columns: dict[str, FloatArray]  # (n,) by key, as in the file, but time in seconds
    n_rows: int  # number of rows
    cut: str  # why a last row was left out; empty if none was
    # unit of the time in the file, and how it was found
    time_unit: str
    time_evidence: str

    def clean(self, bad: BoolArray | None = None, action: str = "not a finite number") -> Cleaned:
        """Rows in order without the bad ones ``(n,)``: by default those with a value that is not finite."""
        if bad is None:
            bad = np.asarray(~np.isfinite(np.column_stack(list(self.columns.values()))).all(axis=1), dtype=np.bool_)
        return clean(self.columns, bad, self.kinds, place=self.table.place, name=self.table.name, bad_action=action)

    def reading(
        self,
        kind: str,
        data: T,
        cleaned: Cleaned,
        columns: Mapping[str, str],
        evidence: Iterable[str],
        *,
        gaps: bool = True,
        axes: str = "",
        sampling: Sampling | None = None,
        stamp: Stamp | None = None,
        height: str = "",
    ) -> Reading[T]:
        """Data with what happened to the rows and what was understood; see `ReadingFacts`."""
        time = cleaned.columns["time"]
        events = cleaned.events
        if self.cut:
            events = (*events, cut_event(self.kinds, float(time[-1]), self.cut))
        facts = ReadingFacts(
            kind=kind,
            path=self.table.name,
            sha256=self.table.sha256,
            n_rows=self.n_rows + bool(self.cut),
            n_used=len(time),
            start_s=float(time[0]),
            end_s=float(time[-1]),
            rate_hz=1.0 / cleaned.interval,
            n_gaps=cleaned.n_gaps if gaps else 0,
            longest_gap_s=cleaned.longest_gap if gaps else 0.0,
            columns=columns,
            evidence=tuple(text for text in (self.time_evidence, *self.table.notes, *evidence, *cleaned.notes) if text),
            axes=axes,
            sampling=sampling,
            stamp=stamp,
            height=height,
        )
        return Reading(data, events, facts)


def read_rows(
    table: Table,
    found: Mapping[str, Found],
    keys: Sequence[str],
    kinds: Kinds,
    *,
    slowest: float,
    time_unit: str | None = None,
) -> Rows:
    """Read columns, the time in seconds.

    `slowest` is the longest step of time that such a file has [s]; the unit of the time is that of the user, else of
    the header, else found by the steps.

    Raises: InputError: a cell is not a number, or the unit of the time is unclear.
    """
    numbers = table.cells.read([found[key].index for key in keys])
    columns = {key: numbers.columns[found[key].index] for key in keys}
    unit, evidence = "s", ""
    if "time" in columns and numbers.n_rows > 1:
        stated = time_unit or found["time"].unit
        unit, evidence = find_time_unit(columns["time"], stated, slowest=slowest, where=table.name)
        columns["time"] = columns["time"] * ALL_UNITS[unit][1]
    return Rows(table, kinds, columns, numbers.n_rows, numbers.cut, unit, evidence)
