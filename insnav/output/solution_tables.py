"""Tables of a run folder: solution, innovations, sensor errors, events as csv or parquet; the track as KML.

What is not known is an empty cell (csv) or null (parquet), never NaN. Text is rounded well below what the
numbers can mean, which keeps the files short and the same on every machine; parquet holds states as computed
and standard deviations in single precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from insnav.exceptions import InputError
from insnav.plain_text import cell_text, plain_text
from insnav.types import Event, FloatArray, Innovations, SensorErrors, Trajectory
from insnav.units import DEG, DEG_PER_H, G0, PPM

TableFormat = Literal["csv", "parquet"]
KML_POINTS = 5000  # more makes map programs slow and shows nothing new

_AXES = ("x", "y", "z")
_NED = ("n", "e", "d")


@dataclass(frozen=True, slots=True)
class _Column:
    """One column: its name with unit, the SI value of that unit, and the decimals worth writing."""

    name: str
    unit: float
    decimals: int

    @property
    def is_sd(self) -> bool:
        return self.name.startswith("sd_")


_TIME = _Column("time_s", 1.0, 6)
_SOLUTION = (
    _Column("lat_deg", DEG, 10),
    _Column("lon_deg", DEG, 10),
    _Column("height_m", 1.0, 5),
    *(_Column(f"v{axis}_m_s", 1.0, 6) for axis in _NED),
    _Column("roll_deg", DEG, 6),
    _Column("pitch_deg", DEG, 6),
    _Column("heading_deg", DEG, 6),
)
_SOLUTION_SD = (
    *(_Column(f"sd_{axis}_m", 1.0, 5) for axis in _NED),
    *(_Column(f"sd_v{axis}_m_s", 1.0, 6) for axis in _NED),
    *(_Column(f"sd_{angle}_deg", DEG, 6) for angle in ("roll", "pitch", "heading")),
)
_INNOVATION = (
    *(_Column(f"innovation_{axis}_m", 1.0, 5) for axis in _NED),
    *(_Column(f"innovation_v{axis}_m_s", 1.0, 6) for axis in _NED),
)
_INNOVATION_SD = tuple(
    _Column(column.name.replace("innovation", "sd"), column.unit, column.decimals) for column in _INNOVATION
)
_SENSOR_ERRORS = (
    *(_Column(f"gyro_bias_{axis}_deg_h", DEG_PER_H, 6) for axis in _AXES),
    *(_Column(f"accel_bias_{axis}_mg", 1e-3 * G0, 6) for axis in _AXES),
    *(_Column(f"gyro_scale_{axis}_ppm", PPM, 3) for axis in _AXES),
    *(_Column(f"accel_scale_{axis}_ppm", PPM, 3) for axis in _AXES),
)
_SENSOR_ERRORS_SD = tuple(_Column(f"sd_{c.name}", c.unit, c.decimals) for c in _SENSOR_ERRORS)
_NIS = (_Column("nis_position", 1.0, 4), _Column("nis_velocity", 1.0, 4))
_EVENT_NUMBERS = (_Column("value", 1.0, 9), _Column("limit", 1.0, 9))

_Cells = tuple[Any, _Column | None]  # values, and what they are if they are numbers with a unit


def write_solution(
    folder: Path, solution: Trajectory, file_format: TableFormat = "csv", name: str = "solution"
) -> Path:
    """Write ``solution.csv`` or ``solution.parquet``.

    Parameters
    ----------
    folder : Path
        Where to.
    solution : Trajectory
        Every row of it is written; without `sd` the file has no sd columns.
    file_format : {"csv", "parquet"}
    name : str
        Of the file, without suffix.

    Returns
    -------
    Path
        The file written.
    """
    table = {
        **_columns((_TIME,), solution.time[:, None]),
        **_columns(_SOLUTION[0:3], solution.lla),
        **_columns(_SOLUTION[3:6], solution.v_n),
        **_columns(_SOLUTION[6:9], solution.rph),
    }
    if solution.sd is not None:
        table |= _columns(_SOLUTION_SD, solution.sd)
    return _write(folder, name, table, file_format)


def write_innovations(folder: Path, innovations: Innovations, file_format: TableFormat = "csv") -> Path:
    """Write ``innovations.csv`` or ``.parquet``: every fix, its innovation, sd, NIS, and whether it was used.

    Parameters
    ----------
    folder : Path
        Where to.
    innovations : Innovations
    file_format : {"csv", "parquet"}

    Returns
    -------
    Path
        The file written.
    """
    nis = np.column_stack((innovations.nis_position, innovations.nis_velocity))
    table = {
        **_columns((_TIME,), innovations.time[:, None]),
        **_columns(_INNOVATION, innovations.innovation),
        **_columns(_INNOVATION_SD, innovations.sd),
        **_columns(_NIS, nis),
        **{
            name: (used.astype(np.int64), None)
            for name, used in (
                ("used_position", innovations.used_position),
                ("used_velocity", innovations.used_velocity),
            )
        },
    }
    return _write(folder, "innovations", table, file_format)


def write_biases(folder: Path, sensor_errors: SensorErrors, file_format: TableFormat = "csv") -> Path:
    """Write ``biases.csv`` or ``.parquet``: estimated biases and scale factor errors with their sd.

    Parameters
    ----------
    folder : Path
        Where to.
    sensor_errors : SensorErrors
    file_format : {"csv", "parquet"}

    Returns
    -------
    Path
        The file written.
    """
    table = {
        **_columns((_TIME,), sensor_errors.time[:, None]),
        **_columns(_SENSOR_ERRORS, sensor_errors.value),
        **_columns(_SENSOR_ERRORS_SD, sensor_errors.sd),
    }
    return _write(folder, "biases", table, file_format)


def write_events(folder: Path, events: Sequence[Event]) -> Path:
    """Write ``events.csv``: every rejection, gap and reset, one a row; text is safe to open in a spreadsheet.

    Parameters
    ----------
    folder : Path
        Where to.
    events : sequence of Event

    Returns
    -------
    Path
        The file written.
    """
    numbers = np.array([(e.time, e.value, e.limit) for e in events], dtype=np.float64).reshape(-1, 3)
    time, value, limit = _columns((_TIME, *_EVENT_NUMBERS), numbers).items()
    # A dimensionless value has no unit to write; a lone "-" would look like the start of a formula.
    events = [replace(event, unit="") if event.unit == "-" else event for event in events]
    texts = [
        (name, ([cell_text(getattr(event, name)) for event in events], None))
        for name in ("kind", "unit", "action", "hint")
    ]
    return _write(folder, "events", dict([time, texts[0], value, limit, *texts[1:]]), "csv")


def write_kml(folder: Path, solution: Trajectory, name: str) -> Path:
    """Write ``track.kml``: the track on the ground, thinned to `KML_POINTS`, with its start and end.

    The height written is ellipsoidal, which map programs would take for height above sea level; so the track
    is clamped to the ground.

    Parameters
    ----------
    folder : Path
        Where to.
    solution : Trajectory
    name : str
        Title of the track; any text.

    Returns
    -------
    Path
        The file written.
    """
    count = len(solution.time)
    rows = np.unique(np.linspace(0, count - 1, min(count, KML_POINTS)).round().astype(np.int64))
    lat, lon = np.degrees(solution.lla[rows, 0]), np.degrees(solution.lla[rows, 1])
    points = [
        f"{x:.8f},{y:.8f},{z:.3f}"
        for x, y, z in zip((lon + 180.0) % 360.0 - 180.0, lat, solution.lla[rows, 2], strict=True)
    ]
    parts = np.split(np.array(points), np.flatnonzero(np.abs(np.diff(lon)) > 180.0) + 1)  # at the date line
    lines = "".join(
        f"<LineString><tessellate>1</tessellate><coordinates>{' '.join(part)}</coordinates></LineString>\n"
        for part in parts
        if len(part) > 1
    )
    marks = "".join(
        f"<Placemark><name>{label} {time:.1f} s</name><Point><coordinates>{point}</coordinates></Point></Placemark>\n"
        for label, time, point in (
            ("start", solution.time[0], points[0]),
            ("end", solution.time[-1], points[-1]),
        )
    )
    title = escape(plain_text(name))
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{title}</name>\n"
        '<Style id="track"><LineStyle><color>ffb27200</color><width>3</width></LineStyle></Style>\n'
        f"<Placemark><name>{title}</name><styleUrl>#track</styleUrl><MultiGeometry>\n{lines}"
        f"</MultiGeometry></Placemark>\n{marks}</Document></kml>\n"
    )
    path = folder / "track.kml"
    path.write_text(text, encoding="utf-8", newline="\n")
    return path


def has_smoothed(folder: Path) -> bool:
    """Whether a run folder holds a smoothed solution."""
    return any((folder / f"smoothed.{kind}").is_file() for kind in ("parquet", "csv"))


def read_solution(folder: Path, name: str = "solution") -> Trajectory:
    """Read the solution of a run folder, csv or parquet.

    Parameters
    ----------
    folder : Path
        The folder.
    name : {"solution", "smoothed"}
        Which of its solutions.

    Returns
    -------
    Trajectory

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
        time = table["time_s"].to_numpy().astype(np.float64)
        state = _matrix(table, _SOLUTION)
        sd = _matrix(table, _SOLUTION_SD) if _SOLUTION_SD[0].name in table.column_names else None
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            "the solution cannot be read", where=str(path), why=plain_text(error), fix="make the run again"
        ) from error
    return Trajectory(time=time, lla=state[:, 0:3], v_n=state[:, 3:6], rph=state[:, 6:9], sd=sd)


def _matrix(table: Any, columns: Sequence[_Column]) -> FloatArray:
    parts = [table[c.name].cast(pa.float64()).to_numpy() * c.unit for c in columns]
    return np.column_stack(parts)


def _columns(columns: Sequence[_Column], values: FloatArray) -> dict[str, _Cells]:
    return {c.name: (values[:, i] if c.unit == 1.0 else values[:, i] / c.unit, c) for i, c in enumerate(columns)}


def _write(folder: Path, stem: str, columns: Mapping[str, _Cells], file_format: TableFormat) -> Path:
    as_text = file_format == "csv"
    table = pa.table({name: _arrow(values, column, as_text) for name, (values, column) in columns.items()})
    path = folder / f"{stem}.{file_format}"
    with path.open("wb") as stream:
        if as_text:
            stream.write((",".join(columns) + "\n").encode())
            pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False, quoting_style="needed"))
        else:
            # Numbers that never repeat gain nothing from a dictionary or from minima and maxima.
            pa.parquet.write_table(table, stream, use_dictionary=False, write_statistics=False, compression="snappy")
    return path


def _arrow(values: Any, column: _Column | None, as_text: bool) -> Any:
    if column is None:
        return pa.array(values.tolist() if isinstance(values, np.ndarray) else values, type=None)
    if as_text:
        values = np.round(values, column.decimals) + 0.0  # the zero makes -0.0 an ordinary zero
        if column.name == "heading_deg":
            values = np.where(values == 360.0, 0.0, values)
    elif column.is_sd:
        values = values.astype(np.float32)
    # from the buffer: pyarrow's way from an array imports pandas, which takes longer than writing the file
    values = np.ascontiguousarray(values)
    known = np.isfinite(values)
    bitmap = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [bitmap, pa.py_buffer(values)])
