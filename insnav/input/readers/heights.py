"""Heights over time, as a barometer or a surveyed profile gives them, from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.registry import open_table
from insnav.input.interpret.clean import REFERENCE_KINDS, clean, cut_event
from insnav.input.interpret.columns import understand
from insnav.input.interpret.physics import judge_time
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA, REFERENCE_SCHEMA
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.types import FloatArray

_SLOWEST = 1000.0  # longest interval between rows [s]
_KEYS = ("height", "baro", "height_msl")  # the first there is counts
_SCHEMA = tuple({q.key: q for q in (*REFERENCE_SCHEMA, *IMU_SCHEMA) if q.key in ("time", *_KEYS)}.values())


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights over time.

    Attributes
    ----------
    time : (n,) array
        [s], strictly increasing.
    height : (n,) array
        As in the file [m].
    """

    time: FloatArray
    height: FloatArray


def read_heights(path: str | Path) -> Reading[Heights]:
    """Read a time and a height; whatever else the file holds is not looked at.

    Parameters
    ----------
    path : str or Path
        ``.csv``, ``.txt`` (also with ``.gz``), ``.parquet``, or ``-`` for standard input.

    Returns
    -------
    Reading of Heights

    Raises
    ------
    InputError
        The file cannot be used.
    """
    table = open_table(path)
    name = table.name
    found, notes = understand(table.headers, table.units, _SCHEMA, where=name)
    key = next((key for key in _KEYS if key in found), None)
    if key is None or "time" not in found:
        raise InputError(
            "a time and a height are needed",
            where=name,
            why=f"found: {', '.join(header for header in table.headers if header)}",
            fix="name the columns time_s and height_m",
        )
    numbers = table.cells.read([found["time"].index, found[key].index])
    time = numbers.columns[found["time"].index]
    unit, evidence = "s", ""
    if numbers.n_rows > 1:
        unit, evidence = judge_time(time, found["time"].unit, slowest=_SLOWEST, where=name)
    raw = {"time": time * ALL_UNITS[unit][1], "height": numbers.columns[found[key].index] * found[key].factor}
    bad = np.asarray(~np.isfinite(np.column_stack(list(raw.values()))).all(axis=1), dtype=np.bool_)
    cleaned = clean(raw, bad, REFERENCE_KINDS, place=table.place, name=name, bad_action="not a finite number")
    time, height = cleaned.columns["time"], cleaned.columns["height"]
    events = cleaned.events
    if numbers.cut:
        events = (*events, cut_event(REFERENCE_KINDS, float(time[-1]), numbers.cut))
    longest = f"heights between rows are interpolated; the longest step is {np.diff(time).max():.3g} s"
    facts = ReadingFacts(
        kind="heights",
        path=name,
        sha256=table.sha256,
        n_rows=numbers.n_rows + bool(numbers.cut),
        n_used=len(time),
        start_s=float(time[0]),
        end_s=float(time[-1]),
        rate_hz=1.0 / cleaned.interval,
        n_gaps=0,
        longest_gap_s=0.0,
        columns={"time_s": found["time"].describe(unit), "height_m": found[key].describe()},
        evidence=tuple(text for text in (evidence, longest, *notes, *cleaned.notes) if text),
    )
    return Reading(Heights(time, height), events, facts)
