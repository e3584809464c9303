"""Tables of a run: solution, innovations, sensor errors and events, as text or parquet.

Unknown values are empty cells (csv) or null (parquet), never NaN. Text is rounded far below the accuracy of the
numbers, which keeps files short and identical on every machine. Parquet files contain unrounded states, and standard
deviations in single precision.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.csv

from insnav import spill
from insnav.deferred import library
from insnav.exceptions import InputError
from insnav.findings import Finding, by_time
from insnav.messages import render
from insnav.output.data_files import TEXT_ROWS, Decimals, arrow_table, rounded, write_csv, write_numbers
from insnav.plain_text import cell_text, plain_text, text_of_cell
from insnav.quantity import quantity_of
from insnav.tabular import Tabular, unit_of
from insnav.types import GpsData, Innovations, SensorErrors, Trajectory

parquet = library("pyarrow.parquet")  # imported on first use, since the import is slow
TableFormat = Literal["csv", "parquet"]
T = TypeVar("T", bound=Tabular)

_EVENTS = ("time_s", "end_s", "code", "severity", "subject", "value", "limit", "unit", "action", "hint", "values")

_NAMES: dict[type, str] = {Trajectory: "solution", Innovations: "innovations", SensorErrors: "biases", GpsData: "fixes"}
_GROUP = 1 << 16  # rows per group of a parquet file
_OPTIONAL = ("sd", "fix", "heading", "satellites", "dop")  # fields that a table may lack
_DECIMALS: Decimals = (
    ("^lat|^lon", 10),
    ("value|limit", 9),
    ("time|^end_s$|_m_s$|_deg|_mg", 6),
    ("_m$", 5),
    ("nis", 4),
    ("_ppm|dop|satellites", 3),
)


def write_run_table(folder: Path, data: Tabular, file_format: TableFormat = "csv", name: str = "") -> Path:
    """Write one table of a run: a solution, fixes, innovations with NIS, sensor errors or errors of a solution.

    `data`: all rows are written; a None field has no columns. `file_format` {"csv", "parquet"}. `name`: of the file,
    without suffix; default ``solution``, ``innovations``, ``biases`` or ``fixes``.
    """
    path, count = folder / f"{name or _NAMES[type(data)]}.{file_format}", len(next(iter(data._arrays().values())))
    with path.open("wb") as stream, contextlib.ExitStack() as closing:
        writer = None
        for rows in spill.blocks(max(count, 1), size=TEXT_ROWS if file_format == "csv" else _GROUP):
            columns = data.rows(rows).columns().items()
            numbers = {key: v.astype(np.int64) if v.dtype == np.bool_ else v for key, v in columns}
            if file_format == "csv":
                write_numbers(numbers, _DECIMALS, stream, header=rows.start == 0)
                continue
            table = arrow_table(
                {key: v.astype(np.float32) if key.startswith("sd_") else v for key, v in numbers.items()}
            )
            if writer is None:
                # A dictionary and statistics are useless for numbers that rarely repeat. Snappy compression reduces
                # the size by 4 % and doubles the time.
                options = {"use_dictionary": False, "write_statistics": False, "compression": "none"}
                writer = closing.enter_context(parquet.ParquetWriter(stream, table.schema, **options))
            writer.write_table(table)
    return path


def write_events(folder: Path, findings: Sequence[Finding]) -> Path:
    """Write ``events.csv``: every finding with a time, one per row; English text, safe for spreadsheets.

    ``value`` and ``limit`` are the decisive number and its limit in SI, ``values`` all numbers as JSON.
    """
    timed = by_time(finding for finding in findings if finding.timed)
    numbers = {"time_s": "begin", "end_s": "end", "value": "value", "limit": "limit"}
    columns: dict[str, Any] = {
        key: rounded(key, np.array([getattr(finding, name) for finding in timed], dtype=np.float64), _DECIMALS)
        for key, name in numbers.items()
    }
    messages = [render(finding, "en") for finding in timed]
    texts = {
        "code": [finding.code.value for finding in timed],
        "severity": [finding.severity.name.lower() for finding in timed],
        "subject": [finding.subject for finding in timed],
        # without unit the cell is empty: spreadsheets would read "-" as a formula
        "unit": [quantity_of(finding.measured[0], 0.0).unit for finding in timed],
        "action": [" ".join(filter(None, (message.text, message.done))) for message in messages],
        "hint": [message.advice for message in messages],
        "values": [json.dumps(finding.as_dict().get("values", {})) for finding in timed],
    }
    columns |= {key: [cell_text(text) for text in column] for key, column in texts.items()}
    path = folder / "events.csv"
    with path.open("wb") as stream:
        write_csv(arrow_table({key: columns[key] for key in _EVENTS}), stream)
    return path


def has_smoothed(folder: Path) -> bool:
    """Return whether a run folder contains a smoothed solution."""
    return any((folder / f"smoothed.{kind}").is_file() for kind in ("parquet", "csv"))


def read_solution(folder: Path, name: str = "solution") -> Trajectory:
    """Read a solution of a run folder, ``solution`` or ``smoothed``, csv or parquet; see `read_run_table`."""
    return read_run_table(folder, Trajectory, name)


def read_run_table(folder: Path, kind: type[T], name: str = "") -> T:
    """Read a table of a run folder, csv or parquet.

    `name`: of the file, without suffix.
    Raises: InputError: the folder has no such table, or insnav did not write it.
    """
    name = name or _NAMES[kind]
    path = next((p for p in (folder / f"{name}.{suffix}" for suffix in ("parquet", "csv")) if p.is_file()), None)
    if path is None:
        raise InputError("output.no_table", where=str(folder), table=name)
    try:
        table = pa.csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)
        return kind(**{field: _field(table, field, names) for field, names in kind.COLUMNS.items()})
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError("output.unreadable_table", where=str(path), table=name, reason=plain_text(error)) from error


def _field(table: Any, field: str, names: Sequence[str]) -> Any:
    """Read one field of a data type from its columns `names`; None if the field is optional and absent."""
    if field in _OPTIONAL and names[0] not in table.column_names:
        return None
    values = np.column_stack([table[name].cast(pa.float64()).to_numpy() * unit_of(name) for name in names])
    if field.startswith("used"):
        return values[:, 0] == 1.0
    if field == "fix":
        return values[:, 0].astype(np.int64)
    return values[:, 0] if len(names) == 1 else values


def read_events(folder: Path) -> tuple[Finding, ...]:
    """Read ``events.csv`` of a run folder; version 0.2 wrote kinds and texts instead of codes and values.

    Raises: InputError: the file is damaged.
    """
    path = folder / "events.csv"
    texts = dict.fromkeys(("code", "kind", "severity", "subject", "unit", "action", "hint", "values"), pa.string())
    try:
        table = pa.csv.read_csv(path, convert_options=pa.csv.ConvertOptions(column_types=texts))
        return tuple(map(_finding_of_row, table.to_pylist()))
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            "output.unreadable_table", where=str(path), table="events", reason=plain_text(error)
        ) from error


def _finding_of_row(row: Mapping[str, Any]) -> Finding:
    times = {"from_s": row["time_s"], "to_s": row.get("end_s")}
    if "code" in row:
        texts = {name: text_of_cell(row[name]) for name in ("code", "severity", "subject")}
        return Finding.from_dict(times | texts | {"values": json.loads(row["values"])})
    # a row of version 0.2
    values = {"value": row["value"], "limit": row["limit"], "text": text_of_cell(row["action"])}
    return Finding.from_dict(times | {"code": row["kind"], "severity": "note", "values": values})
