"""Raw inertial data from a file: counts or volts, whose sensitivity is what a calibration is to find."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from insnav.exceptions import InputError
from insnav.input.formats.registry import open_table
from insnav.input.interpret.axes import axes_matrix
from insnav.input.interpret.clean import IMU_KINDS, clean
from insnav.input.interpret.columns import require, understand
from insnav.input.interpret.physics import judge_time
from insnav.input.interpret.schema import ALL_UNITS, IMU_SCHEMA
from insnav.input.readers.imu import _FORCES, _RATES, _SLOWEST, _damaged, _in_body, _refuse_empty, _temperature
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.types import ImuData


def read_counts(
    path: str | Path, *, axes: str | None = None, columns: Mapping[str, str] | None = None
) -> Reading[ImuData]:
    """Read inertial data in raw units.

    Parameters
    ----------
    path : str or Path
        As for `insnav.input.read_imu`.
    axes : str, optional
        Where the sensor's x, y, z point, such as ``FLU``; default ``FRD``.
    columns : mapping of str to str, optional
        Quantity to header: ``{"gyro_x": "Gx"}``.

    Returns
    -------
    Reading of ImuData
        Gyros and accelerometers as in the file, only brought to body axes.

    Raises
    ------
    InputError
        The file cannot be used, or its headers state units.
    ConfigError
        An option cannot be meant as given.
    """
    matrix = axes_matrix(axes or "FRD")
    table = open_table(path, "imu")
    name = table.name
    found, notes = understand(table.headers, table.units, IMU_SCHEMA, columns=columns, where=name)
    require(found, ("time", *_RATES, *_FORCES), table.headers, IMU_SCHEMA, where=name)
    stated = [found[key].describe() for key in (*_RATES, *_FORCES) if found[key].unit is not None]
    if stated:
        raise InputError(
            "the file states units, so it does not hold raw counts",
            where=name,
            why=", ".join(stated),
            fix="leave out --counts",
        )
    keys = ["time", *_RATES, *_FORCES, *(key for key in ("temperature",) if key in found)]
    numbers = table.cells.read([found[key].index for key in keys])
    raw = {key: numbers.columns[found[key].index] for key in keys}
    evidence: tuple[str, ...] = ()
    if numbers.n_rows > 1:
        unit, said = judge_time(raw["time"], found["time"].unit, slowest=_SLOWEST, where=name)
        raw["time"] = raw["time"] * ALL_UNITS[unit][1]
        evidence = (said,)
    bad = _damaged([raw[key] for key in keys[:7]])
    _refuse_empty(bad, raw, keys, found, name)
    cleaned = clean(raw, bad, IMU_KINDS, place=table.place, name=name, bad_action="not a finite number")
    time = cleaned.columns["time"]
    temperature, said_of_it = _temperature(time, cleaned.columns.get("temperature"))
    data = ImuData(
        time,
        _in_body(cleaned.columns, _RATES, matrix),
        _in_body(cleaned.columns, _FORCES, matrix),
        temperature=temperature,
    )
    facts = ReadingFacts(
        kind="IMU",
        path=name,
        sha256=table.sha256,
        n_rows=numbers.n_rows,
        n_used=len(time),
        start_s=float(time[0]),
        end_s=float(time[-1]),
        rate_hz=1.0 / cleaned.interval,
        n_gaps=cleaned.n_gaps,
        longest_gap_s=cleaned.longest_gap,
        columns={found[key].quantity.key: found[key].header for key in keys},
        evidence=(*evidence, "gyros and accelerometers in raw counts", *said_of_it, *notes, *cleaned.notes),
        axes=(axes or "FRD").strip().upper(),
        sampling=data.sampling,
        stamp=data.stamp,
    )
    return Reading(data, cleaned.events, facts)
