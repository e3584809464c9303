"""Tables of a run: solution, innovations, sensor errors and events, as text or parquet.

What is not known is an empty cell (csv) or null (parquet), never NaN. Text is rounded well below what the
numbers can mean, which keeps the files short and the same on every machine; parquet holds states as computed
and standard deviations in single precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from insnav.exceptions import InputError
from insnav.output.columns import Decimals, arrow_table, rounded, write_csv
from insnav.plain_text import cell_text, plain_text
from insnav.tabular import unit_of
from insnav.types import Event, FloatArray, Innovations, SensorErrors, Trajectory

TableFormat = Literal["csv", "parquet"]

_NAMES: dict[type, str] = {Trajectory: "solution", Innovations: "innovations", SensorErrors: "biases"}
_DECIMALS: Decimals = (
    ("^lat|^lon", 10),
    ("value|limit", 9),
    ("time|_m_s$|_deg|_mg", 6),
    ("_m$", 5),
    ("nis", 4),
    ("_ppm", 3),
)


def write_run_table(
    folder: Path,
    data: Trajectory | Innovations | SensorErrors,
    file_format: TableFormat = "csv",
    name: str = "",
) -> Path:
    """Write a solution, every fix with its innovation and NIS, or the estimated sensor errors.

    Parameters
    ----------
    folder : Path
        Where to.
    data : Trajectory, Innovations or SensorErrors
        Every row of it is written; a field that is None has no columns.
    file_format : {"csv", "parquet"}
    name : str, optional
        Of the file, without suffix; default ``solution``, ``innovations`` or ``biases``.

    Returns
    -------
    Path
        The file written.
    """
    columns = {key: v.astype(np.int64) if v.dtype == np.bool_ else v for key, v in data.columns().items()}
    if file_format == "csv":
        columns = {key: rounded(key, v, _DECIMALS) for key, v in columns.items()}
    else:
        columns = {key: v.astype(np.float32) if key.startswith("sd_") else v for key, v in columns.items()}
    return _write(folder / f"{name or _NAMES[type(data)]}.{file_format}", columns)


def write_events(folder: Path, events: Sequence[Event]) -> Path:
    """Write ``events.csv``: every rejection, gap and reset, one a row; text is safe to open in a spreadsheet.

    Returns
    -------
    Path
        The file written.
    """
    values = {
        key: np.array([getattr(event, key.removesuffix("_s")) for event in events], dtype=np.float64)
        for key in ("time_s", "value", "limit")
    }
    numbers = {key: rounded(key, each, _DECIMALS) for key, each in values.items()}
    texts = {key: [cell_text(getattr(event, key)) for event in events] for key in ("kind", "action", "hint")}
    # A dimensionless value has no unit to write; a lone "-" would look like the start of a formula.
    texts["unit"] = ["" if event.unit == "-" else cell_text(event.unit) for event in events]
    columns = {**numbers, **texts}
    order = ("time_s", "kind", "value", "limit", "unit", "action", "hint")
    return _write(folder / "events.csv", {key: columns[key] for key in order})


def has_smoothed(folder: Path) -> bool:
    """Whether a run folder holds a smoothed solution."""
    return any((folder / f"smoothed.{kind}").is_file() for kind in ("parquet", "csv"))


def read_solution(folder: Path, name: str = "solution") -> Trajectory:
    """Read a solution of a run folder, ``solution`` or ``smoothed``, csv or parquet.

    Raises
    ------
    InputError
        No solution in the folder, or not one written by insnav.
    """
    path = next((p for p in (folder / f"{name}.{kind}" for kind in ("parquet", "csv")) if p.is_file()), None)
    if path is None:
        raise InputError(
            f"there is no {'smoothed ' if name == 'smoothed' else ''}solution in this folder",
            where=str(folder),
            why=f"neither {name}.csv nor {name}.parquet",
            fix="give a folder that `insnav run` has written",
        )
    try:
        table = pa.csv.read_csv(path) if path.suffix == ".csv" else pa.parquet.read_table(path)
        absent = () if Trajectory.COLUMNS["sd"][0] in table.column_names else ("sd",)
        fields = {field: _matrix(table, names) for field, names in Trajectory.COLUMNS.items() if field not in absent}
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            "the solution cannot be read", where=str(path), why=plain_text(error), fix="make the run again"
        ) from error
    return Trajectory(**{**fields, "time": fields["time"][:, 0]})


def _matrix(table: Any, names: Sequence[str]) -> FloatArray:
    return np.column_stack([table[name].cast(pa.float64()).to_numpy() * unit_of(name) for name in names])


def _write(path: Path, columns: Mapping[str, Any]) -> Path:
    table = arrow_table(columns)
    with path.open("wb") as stream:
        if path.suffix == ".csv":
            write_csv(table, stream)
        else:
            # Numbers that never repeat gain nothing from a dictionary or from minima and maxima.
            pa.parquet.write_table(table, stream, use_dictionary=False, write_statistics=False, compression="snappy")
    return path
