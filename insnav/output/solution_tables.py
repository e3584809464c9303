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
from insnav.output.columns import (
    AXES,
    NED,
    Column,
    Fields,
    arrow_array,
    cells_of,
    degrees,
    labels,
    rounded,
    write_csv,
)
from insnav.plain_text import cell_text, plain_text
from insnav.types import Event, FloatArray, Innovations, SensorErrors, Trajectory
from insnav.units import DEG_PER_H, G0, PPM

TableFormat = Literal["csv", "parquet"]

_ATTITUDE = ("roll", "pitch", "heading")
_TIME = ("time", (Column("time_s", 6),))
_SOLUTION: Fields = (
    _TIME,
    ("lla", (*degrees(10, "lat", "lon"), Column("height_m", 5))),
    ("v_n", labels("v{}_m_s", NED, 6)),
    ("rph", degrees(6, *_ATTITUDE)),
    ("sd", (*labels("sd_{}_m", NED, 5), *labels("sd_v{}_m_s", NED, 6), *degrees(6, *(f"sd_{a}" for a in _ATTITUDE)))),
)
_SENSOR_ERRORS = (
    *labels("gyro_bias_{}_deg_h", AXES, 6, DEG_PER_H),
    *labels("accel_bias_{}_mg", AXES, 6, 1e-3 * G0),
    *labels("gyro_scale_{}_ppm", AXES, 3, PPM),
    *labels("accel_scale_{}_ppm", AXES, 3, PPM),
)
# what a table is called and where its columns come from
_TABLES: dict[type, tuple[str, Fields]] = {
    Trajectory: ("solution", _SOLUTION),
    Innovations: (
        "innovations",
        (
            _TIME,
            ("innovation", (*labels("innovation_{}_m", NED, 5), *labels("innovation_v{}_m_s", NED, 6))),
            ("sd", (*labels("sd_{}_m", NED, 5), *labels("sd_v{}_m_s", NED, 6))),
            ("nis_position", (Column("nis_position", 4),)),
            ("nis_velocity", (Column("nis_velocity", 4),)),
            ("used_position", (Column("used_position", 0),)),
            ("used_velocity", (Column("used_velocity", 0),)),
        ),
    ),
    SensorErrors: (
        "biases",
        (
            _TIME,
            ("value", _SENSOR_ERRORS),
            ("sd", tuple(Column(f"sd_{column.name}", column.decimals, column.unit) for column in _SENSOR_ERRORS)),
        ),
    ),
}


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
    usual, fields = _TABLES[type(data)]
    as_text = file_format == "csv"
    columns = {key: _written(*cells, as_text=as_text) for key, cells in cells_of(data, fields).items()}
    return _write(folder / f"{name or usual}.{file_format}", columns)


def _written(values: Any, column: Column, *, as_text: bool) -> Any:
    if values.dtype == np.bool_:
        return values.astype(np.int64)
    if as_text:
        return rounded(values, column)
    return values.astype(np.float32) if column.name.startswith("sd_") else values


def write_events(folder: Path, events: Sequence[Event]) -> Path:
    """Write ``events.csv``: every rejection, gap and reset, one a row; text is safe to open in a spreadsheet.

    Returns
    -------
    Path
        The file written.
    """
    numbers = {
        key: rounded(np.array([getattr(event, key.removesuffix("_s")) for event in events], dtype=np.float64), column)
        for key, column in (("time_s", _TIME[1][0]), ("value", Column("value", 9)), ("limit", Column("limit", 9)))
    }
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
        fields = {field: _matrix(table, columns) for field, columns in _SOLUTION if field != "sd"}
        sd = _matrix(table, _SOLUTION[-1][1]) if _SOLUTION[-1][1][0].name in table.column_names else None
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            "the solution cannot be read", where=str(path), why=plain_text(error), fix="make the run again"
        ) from error
    return Trajectory(time=fields["time"][:, 0], lla=fields["lla"], v_n=fields["v_n"], rph=fields["rph"], sd=sd)


def _matrix(table: Any, columns: Sequence[Column]) -> FloatArray:
    return np.column_stack([table[c.name].cast(pa.float64()).to_numpy() * c.unit for c in columns])


def _write(path: Path, columns: Mapping[str, Any]) -> Path:
    table = pa.table({name: arrow_array(values) for name, values in columns.items()})
    with path.open("wb") as stream:
        if path.suffix == ".csv":
            write_csv(table, stream)
        else:
            # Numbers that never repeat gain nothing from a dictionary or from minima and maxima.
            pa.parquet.write_table(table, stream, use_dictionary=False, write_statistics=False, compression="snappy")
    return path
