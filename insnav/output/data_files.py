"""Simulated data as files that every command reads: IMU, GPS and reference in the canonical columns.

The same data give the same bytes: numbers are rounded to fixed decimals and written as short as they go, and
compressed files carry no time of writing.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from insnav.exceptions import OutputError
from insnav.types import FloatArray, GpsData, ImuData, IntArray, Trajectory
from insnav.units import DEG

# Far below what any sensor resolves or any test looks at.
_TIME, _RATE, _INCREMENT, _ANGLE, _METRE = 9, 9, 13, 11, 6

_IMU_COLUMNS = {
    False: (*(f"gyro_{axis}_rad_s" for axis in "xyz"), *(f"accel_{axis}_m_s2" for axis in "xyz")),
    True: (*(f"dtheta_{axis}_rad" for axis in "xyz"), *(f"dvel_{axis}_m_s" for axis in "xyz")),
}
_POSITION = (("lat_deg", _ANGLE), ("lon_deg", _ANGLE), ("height_m", _METRE))
_VELOCITY = tuple((f"v{axis}_m_s", _METRE) for axis in "ned")
_ATTITUDE = tuple((f"{angle}_deg", 8) for angle in ("roll", "pitch", "heading"))


def write_imu(path: Path, imu: ImuData) -> None:
    """Write rates or increments as csv, compressed if the name ends in ``.gz``.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    imu : ImuData
        Samples, and temperature and wheel speed if there are any. Sampling and stamp are not in the file: they are
        options of whoever reads it.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    increments = imu.sampling == "increment"
    names = _IMU_COLUMNS[increments]
    values = np.column_stack([imu.gyro, imu.accel])
    columns = rounded(names, values, _INCREMENT if increments else _RATE)
    for name, extra, decimals in (("temperature_c", imu.temperature, 3), ("odometer_m_s", imu.odometer, _METRE)):
        if extra is not None:
            columns |= known(((name, decimals),), extra[:, None])
    write_table(path, {"time_s": np.round(imu.time, _TIME), **columns})


def write_gps(path: Path, gps: GpsData) -> None:
    """Write fixes as csv; columns of which nothing is known are left out.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    gps : GpsData
        Fixes.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    columns = position_columns(gps.lla) | known(_VELOCITY, gps.v_n)
    columns |= known(tuple((f"sd_{axis}_m", _METRE) for axis in "ned"), gps.position_sd)
    columns |= known(tuple((f"sd_v{axis}_m_s", _METRE) for axis in "ned"), gps.velocity_sd)
    if gps.heading is not None:
        columns |= known((("heading_deg", 8),), gps.heading[:, None] / DEG)
    fix = {} if gps.fix is None else {"fix": gps.fix}
    write_table(path, {"time_s": np.round(gps.time, _TIME), **columns, **fix})


def write_reference(path: Path, reference: Trajectory) -> None:
    """Write a reference trajectory as csv.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    reference : Trajectory
        Position, velocity and attitude, all known.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    columns = position_columns(reference.lla) | known(_VELOCITY, reference.v_n)
    columns |= known(_ATTITUDE, reference.rph / DEG)
    columns["heading_deg"] %= 360.0  # rounding may have made it 360
    write_table(path, {"time_s": np.round(reference.time, _TIME), **columns})


def position_columns(lla: FloatArray) -> dict[str, FloatArray]:
    """Columns of latitude, longitude [deg] and height [m]."""
    return known(_POSITION, lla / np.array([DEG, DEG, 1.0]))


def known(columns: tuple[tuple[str, int], ...], values: FloatArray) -> dict[str, FloatArray]:
    """Columns rounded to their decimals, without those that are all NaN."""
    return {
        name: np.round(values[:, i], decimals) + 0.0  # no negative zero
        for i, (name, decimals) in enumerate(columns)
        if not np.all(np.isnan(values[:, i]))
    }


def rounded(names: tuple[str, ...], values: FloatArray, decimals: int) -> dict[str, FloatArray]:
    """Columns rounded to the same decimals."""
    return known(tuple((name, decimals) for name in names), values)


def csv_text(columns: Mapping[str, FloatArray], digits: int) -> str:
    """Write columns as text of a csv table, each number in so many significant digits.

    Parameters
    ----------
    columns : mapping of str to (n,) array
    digits : int
    """
    lines = (",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(list(columns.values())))
    return "\n".join([",".join(columns), *lines]) + "\n"


def write_table(path: Path, columns: Mapping[str, FloatArray | IntArray]) -> None:
    """Write columns as csv, compressed if the name ends in ``.gz``; a NaN becomes an empty cell.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    columns : mapping of str to (n,) array
        Already rounded.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})
    text = io.BytesIO()
    text.write((",".join(table.column_names) + "\n").encode())
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=False))
    content = text.getvalue()
    if path.suffix == ".gz":
        content = gzip.compress(content, compresslevel=9, mtime=0)
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError(
            f"{path.name} cannot be written",
            where=str(path),
            why=error.strerror or str(error),
            fix="choose a folder that exists and that you may write to",
        ) from error
