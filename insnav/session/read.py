"""Conversion of input data (files, tables, arrays, or types of insnav) to a recording."""

from __future__ import annotations

import hashlib
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, cast, get_args

import numpy as np

from insnav import imu as sensors  # the package imports its calibration module on use, which saves 10 ms
from insnav.exceptions import KEYWORDS, ConfigError, InputError, InsnavError
from insnav.input import Reading, ReadingFacts, read_gps, read_imu, read_reference
from insnav.input.formats.conventions import ACCEL, GYRO
from insnav.input.formats.registry import choose_table, open_table
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.interpret.clean import GPS_KINDS, IMU_KINDS, REFERENCE_KINDS, find_gaps
from insnav.input.interpret.columns import key_of, understand
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA
from insnav.input.readers.imu import Use, unit_pairs
from insnav.input.readers.kinds import open_parts
from insnav.input.readers.rows import read_sensor_log
from insnav.plain_text import plain_text
from insnav.steps import Recording
from insnav.steps.given import checked, one_of
from insnav.steps.inputs import LOGS, Inputs
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Stamp, Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from typing_extensions import TypeIs

    from insnav.imu.specification import ImuSpec

    Given: TypeAlias = "str | Path | pd.DataFrame | Sequence[FloatArray]"


class NamedInputs(Inputs, total=False):
    """Inputs of a recording, with ``imu`` as the IMU error specification: `Inputs` has an older name."""

    imu: str | Path | ImuSpec | None


KEYWORDS["--imu"] = "imu"
T = TypeVar("T", ImuData, GpsData, Trajectory)
_KINDS = {"IMU": IMU_KINDS, "GPS": GPS_KINDS, "reference": REFERENCE_KINDS}
MOST_FIXES = 0.5  # largest share of rows with a new fix: with more, the file is a solution
_DESCRIBING = ("axes", "units", "columns", "sampling", "stamp")


def by_name(inputs: NamedInputs) -> Inputs:
    """Rename ``imu`` to ``imu_model``, as in `Inputs`; warn if ``imu_model``, deprecated until 0.5, was used."""
    renamed: dict[str, Any] = {**inputs}
    if renamed.get("imu_model") is not None:
        warnings.warn("imu_model is deprecated and ends with version 0.5: use imu", DeprecationWarning, stacklevel=3)
    if (specification := renamed.pop("imu", None)) is not None:
        renamed["imu_model"] = specification
    return cast(Inputs, renamed)


def read(
    imu: Given | ImuData, gps: Given | GpsData | None, ref: Given | Trajectory | None, inputs: Inputs, run: bool = False
) -> Recording:
    """Read a drive, small files first, to report their errors early.

    `run`: the recording will be navigated, so a lack of any position, reported later, has priority over unknown axes.

    Raises: ConfigError, InputError: invalid inputs or data; `where` names the input.
    """
    inputs = checked(inputs)
    given_logs = inputs.get("logs") or {}
    options = {LOGS[name].option: source for name, source in given_logs.items()}
    one_from_stdin({"IMU_FILE": imu, "--gps": gps, "--ref": ref, **options})
    sources = _parts({"imu": imu, "gps": gps, "reference": ref}, inputs)
    if gps is None and sources["gps"] is sources["imu"]:
        fixes = _fixes_beside(sources["imu"], inputs)
    else:
        fixes = None if sources["gps"] is None else _read_gps(sources["gps"], inputs)
    reference = None if sources["reference"] is None else read_ref(sources["reference"], inputs)
    logs = {name: read_sensor_log(_table(log), name) for name, log in given_logs.items()}
    nowhere = run and reference is None and inputs.get("lat") is None
    samples = read_samples(sources["imu"], inputs, "drive" if fixes is not None or nowhere else None)
    return Recording(samples, fixes, reference, logs, inputs)


def _fixes_beside(imu: Any, inputs: Inputs) -> Reading[GpsData] | None:
    """Read fixes in the rows of the samples; None for a solution, with new fixes in most rows (usable with --gps)."""
    clock = {key: header for key, header in (inputs.get("columns") or {}).items() if key == "time"}
    inputs = {**inputs, "gps_columns": inputs.get("gps_columns") or clock}
    with suppress(InputError):  # without fixes there is no error, as none were specified
        fixes = _read_gps(imu, inputs)
        return fixes if fixes.facts.n_used < MOST_FIXES * fixes.facts.n_rows else None
    return None


def _parts(sources: Mapping[str, Any], inputs: Inputs) -> dict[str, Any]:
    """Return the table of each part: ``imu``, ``gps``, ``reference``; a log with samples and fixes gives two tables.

    A reference is used only from a separate file of a folder: in a log, it comes from the logging device itself.
    """
    logs = {str(each): open_parts(each) for each in sources.values() if isinstance(each, str | Path)}
    if not logs:
        return dict(sources)
    topics = _topics(inputs, [key for tables in logs.values() for key in tables])
    given = dict(sources)
    if given.get("gps", "") is None and any(
        key.startswith("gps") or (key == "" and _has_positions(table))
        for key, table in logs.get(str(given["imu"]), {}).items()
    ):
        given["gps"] = given["imu"]
    parts = logs.get(str(given["imu"]), {})
    has_reference = {"imu", "reference"} <= parts.keys() and parts["reference"].name != parts["imu"].name
    if given.get("reference", "") is None and has_reference:
        given["reference"] = given["imu"]
    for part, each in given.items():
        if isinstance(each, str | Path):
            given[part] = choose_table(logs[str(each)], part, topics, plain_text(each))
    return given


def _has_positions(table: Table) -> bool:
    """Return whether a table of samples also has fixes in its rows."""
    with suppress(InputError):
        return {"lat", "lon"} <= understand(table.headers, table.units, GPS_SCHEMA)[0].keys()
    return False


def _topics(inputs: Inputs, parts: Sequence[str]) -> list[str]:
    """Return the requested topics, all required; see `insnav.input.formats.registry.Format.read`."""
    topics = [each.strip() for each in (inputs.get("topic") or "").split(",") if each.strip()]
    known = sorted({part.partition(":")[2] for part in parts} - {""})
    unknown = [each for each in topics if each not in known]
    if unknown:
        raise ConfigError("session.no_topic", where="topic", value=unknown[0], known=tuple(known))
    return topics


def one_from_stdin(sources: Mapping[str, object]) -> None:
    """Refuse two files from standard input, which can be read only once."""
    names = [name for name, source in sources.items() if isinstance(source, str | Path) and str(source) == "-"]
    if len(names) > 1:
        raise ConfigError("session.one_from_stdin", where=", ".join(names))


def read_samples(imu: Given | Table | ImuData, inputs: Inputs, use: Use | None = None) -> Reading[ImuData]:
    """Read the samples and correct known errors.

    A calibration file also converts volts and counts to rates and specific forces. `use`: see `read_imu`.
    """
    calibration = inputs.get("calibration")
    errors = None if calibration is None else sensors.load_calibration(Path(calibration))
    if isinstance(imu, ImuData):
        described = [key for key in _DESCRIBING if inputs.get(key) is not None]
        if described:
            raise ConfigError("session.described_twice", where=described[0])
        reading = in_memory(imu, "IMU")
    else:
        raw = [] if errors is None else [("gyro", errors.gyro_raw), ("accel", errors.accel_raw)]
        attrs = getattr(imu, "attrs", {})
        reading = _tried(
            read_imu,
            samples_source(_parts({"imu": imu}, inputs)["imu"], inputs.get("rate")),
            "columns",
            inputs,
            axes=inputs.get("axes"),
            units=[*unit_pairs(inputs.get("units")), *((triad, scale) for triad, scale in raw if scale is not None)],
            **{key: inputs.get(key, attrs.get(key)) for key in ("sampling", "stamp", "accel_sign")},
            use=use,
        )
    return reading if errors is None else replace(reading, data=sensors.correct(reading.data, errors))


def _read_gps(gps: Given | GpsData, inputs: Inputs) -> Reading[GpsData]:
    if isinstance(gps, GpsData):
        return in_memory(gps, "GPS")
    return _tried(read_gps, _table(gps), "gps_columns", inputs, height=inputs.get("gps_height"))


def read_ref(reference: Given | Trajectory, inputs: Inputs) -> Reading[Trajectory]:
    """Read a reference trajectory, specified as for `insnav.load`."""
    if isinstance(reference, Trajectory):
        return in_memory(reference, "reference")
    return _tried(read_reference, _table(reference), "ref_columns", inputs)


def _tried(
    reader: Callable[..., Reading[T]],
    source: Any,
    columns: Literal["columns", "gps_columns", "ref_columns"],
    inputs: Inputs,
    **how: Any,
) -> Reading[T]:
    """Read a file. Errors name the input with its columns, and suggest only columns that can be read."""
    given_columns = inputs.get(columns) or {}
    try:
        return reader(source, columns=given_columns, **how)
    except InsnavError as error:
        hint = error.gives.get("columns")
        if hint and {"meant", "guess"} & error.values.keys():
            try:
                reader(source, columns={**given_columns, **hint}, **how)
            except InsnavError as other:
                if not other.gives or "columns" in other.gives:  # otherwise only another input is missing
                    error.withdraw_columns()
        error.where = re.sub(r"^columns\b", columns, error.where)
        if "option" in error.values:
            error.values["option"] = f"--{columns.replace('_', '-')}"
        error.gives = {columns if key == "columns" else key: value for key, value in error.gives.items()}
        raise


def samples_source(imu: Given | Table, rate: float | None) -> str | Path | Table:
    """Return samples as file or table; arrays are time [s], gyro [rad/s], accel [m/s^2]; no time with `rate`."""
    if isinstance(imu, str | Path | Table) or is_frame(imu):
        table = _table(imu)
        return table if rate is None else _timed(open_table(table, "imu"), rate)
    arrays = [np.asarray(each, dtype=np.float64) for each in imu]
    if len(arrays) == 2 and rate is not None:
        arrays = [np.arange(1, len(arrays[0]) + 1) / rate, *arrays]
    if len(arrays) != 3 or any(each.shape != (len(arrays[0]), 3) for each in arrays[1:]) or arrays[0].ndim != 1:
        raise ConfigError("session.not_samples", shapes=tuple(str(each.shape) for each in arrays))
    return named_columns(("time_s", *GYRO, *ACCEL), np.column_stack(arrays))


def _timed(table: Table, rate: float) -> Table:
    """Add times to samples, at a rate [Hz]."""
    if any(key_of(header, IMU_SCHEMA) == "time" for header in table.headers):
        return table
    numbers = table.cells.read(range(len(table.headers)))
    time = np.arange(1, numbers.n_rows + 1) / rate
    cells = ArrayCells((time, *(numbers.columns[i] for i in range(len(table.headers)))), table.cells.line)
    units = None if table.units is None else ("", *table.units)
    return replace(table, headers=("time_s", *table.headers), cells=cells, units=units)


def _table(given: Given | Table) -> str | Path | Table:
    """Return a file or table unchanged; convert a data frame, or time [s], lat, lon [deg], height [m], to a table."""
    if isinstance(given, str | Path | Table):
        return given
    if is_frame(given):
        numbers = np.column_stack([_numbers(str(name), given[name]) for name in given.columns])
        return named_columns(tuple(str(name) for name in given.columns), numbers)
    arrays = [np.asarray(each, dtype=np.float64) for each in given]
    if len(arrays) != 2 or arrays[1].shape != (len(arrays[0]), 3):
        raise ConfigError("session.not_positions", shapes=tuple(str(each.shape) for each in arrays))
    angles = np.abs(arrays[1][:, :2])
    if np.nanmax(angles[:, 0], initial=0.0) < 0.5 * np.pi and np.nanmax(angles[:, 1], initial=0.0) < 2.0 * np.pi:
        raise ConfigError("session.positions_in_radians")
    return named_columns(("time_s", "lat", "lon", "height_m"), np.column_stack(arrays))


def _numbers(name: str, series: pd.Series[Any]) -> FloatArray:
    """Convert a column of a data frame to numbers (n,), times to seconds, and a column of texts to NaN.

    Raises: InputError: the column has both numbers and texts.
    """
    if getattr(series.dtype, "tz", None) is not None:
        series = series.dt.tz_convert(None)
    column = series.to_numpy()
    if column.dtype.kind in "mM":
        seconds = column.astype(f"{column.dtype.name.split('[')[0]}[ns]").astype(np.int64) / 1e9
        return np.asarray(np.where(np.isnat(column), np.nan, seconds))
    if column.dtype.kind in "biuf":
        return np.asarray(column, dtype=np.float64)
    numbers, text = np.full(len(column), np.nan), []
    for row, cell in enumerate(column):
        try:
            numbers[row] = float(cell)
        except (TypeError, ValueError):
            text.append(row)
    if text and np.isfinite(numbers).any():
        values: dict[str, Any] = {"value": plain_text(column[text[0]]), "count": len(text), "total": len(column)}
        raise InputError("session.not_a_number", where=f"row {text[0] + 1}, column {plain_text(name)}", **values)
    return numbers


def is_frame(given: object) -> TypeIs[pd.DataFrame]:
    """Return whether data are a pandas data frame."""
    return hasattr(given, "columns") and hasattr(given, "to_numpy")  # importing pandas takes a third of a second


def named_columns(headers: tuple[str, ...], numbers: FloatArray) -> Table:
    """Build a table of numbers in memory, with units in the headers."""
    cells = ArrayCells(tuple(np.ascontiguousarray(numbers.T)), lambda row: f"row {row + 1}")
    return Table("data in memory", hashlib.sha256(numbers.tobytes()).hexdigest(), headers, cells)


def _sound(data: ImuData | GpsData | Trajectory) -> None:
    """Reject arrays of wrong shape or unit, NaN values and unknown texts."""
    n, kind = len(data.time), type(data).__name__
    for name in ("gyro", "accel") if isinstance(data, ImuData) else ("lla", "v_n"):
        shape = np.shape(getattr(data, name))
        if shape != (n, 3):
            raise ConfigError("session.bad_shape", where=kind, name=name, shape=str(shape), wanted=str((n, 3)))
    if isinstance(data, ImuData):
        one_of("sampling", data.sampling, get_args(Sampling))
        one_of("stamp", data.stamp, get_args(Stamp))
        valid = bool(np.isfinite(data.gyro).all() and np.isfinite(data.accel).all())
    else:
        valid = bool(np.isfinite(data.lla).all()) and float(np.max(np.abs(data.lla[:, 0]), initial=0.0)) <= np.pi / 2
    if not valid:
        raise ConfigError("session.impossible_numbers", where=kind)
    if isinstance(data, GpsData):
        for name in ("position_sd", "velocity_sd"):
            if np.any(getattr(data, name) <= 0.0):
                raise ConfigError("session.bad_sd", where=name)


def in_memory(data: T, kind: str, name: str = "data in memory") -> Reading[T]:
    """Check data that need no interpretation, and wrap them as a reading.

    `kind` {"IMU", "GPS", "reference"}.
    """
    time: Any = data.time
    _sound(data)
    steps = np.diff(time)
    if len(time) < 2 or not (steps > 0.0).all():
        raise ConfigError("session.too_few_rows", where=type(data).__name__, kind=kind)
    digest = hashlib.sha256(b"".join(value.tobytes() for value in data._arrays().values())).hexdigest()
    step = float(np.median(steps))
    gaps = find_gaps(steps, step, _KINDS[kind])
    facts = ReadingFacts(
        kind=kind,
        path=name,
        sha256=digest,
        n_rows=len(time),
        n_used=len(time),
        start_s=float(time[0]),
        end_s=float(time[-1]),
        rate_hz=1.0 / step,
        n_gaps=len(gaps),
        longest_gap_s=float(steps[gaps].max(initial=0.0)),
        columns={},
    )
    if isinstance(data, ImuData):
        facts = replace(facts, axes="FRD", sampling=data.sampling, stamp=data.stamp)
    return Reading(data, (), facts)
