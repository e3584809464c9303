"""Text files of KF-GINS and PSINS: numbers separated by blanks, no header.

GNSS: seconds of the week, latitude, longitude [deg], height [m], standard deviations North, East, Down [m], optionally
velocity with standard deviations. IMU: seconds of the week, increments of angle [rad] and of velocity [m/s],
Forward-Right-Down. PSINS: time last, increments Right-Forward-Up, positions in radians, velocities East, North, Up. A
file is recognised only if its numbers have no other interpretation.

References
----------
KF-GINS, i2Nav, Wuhan University: README, "dataset"; Niu, X. et al. Yan, G., PSINS toolbox, imuplot.m, gpsplot.m.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from insnav.findings import Code, Finding
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import Table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import WEEK
from insnav.types import FloatArray
from insnav.units import DEG

name = "KF-GINS text file"

_VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
_POSITION = ("time_s", "lat_deg", "lon_deg", "height_m", "sd_n_m", "sd_e_m", "sd_d_m")
_IMU = ("dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad", "dvel_x_m_s", "dvel_y_m_s", "dvel_z_m_s")
_SOLUTION = ("week", *_POSITION[:4], *_VELOCITY[:3], "roll_deg", "pitch_deg", "heading_deg")
_PSINS = ("lat_rad", "lon_rad", "height_m", "time_s")
_LAYOUTS = (
    *(("gps", (*_POSITION, *_VELOCITY)), ("gps", _POSITION), ("reference", _SOLUTION), ("imu", ("time_s", *_IMU))),
    *(("imu", (*_IMU, "time_s")), ("gps", ("ve_m_s", "vn_m_s", "vu_m_s", *_PSINS)), ("gps", _PSINS)),
)
_GRAVITY = (9.3, 10.3)  # plausible sum of velocity increments per second, which is gravity [m/s^2]
_FASTEST_FIXES = 0.04  # fixes have intervals of 0.05 s or more, IMU samples less [s]
_ROWS = 20  # number of rows that are examined to identify the layout


def recognise(source: Source) -> bool:
    return bool(_layout(source.head)[1])


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    part, headers = _layout(source.head)
    cells = TextCells(source.name, text, Dialect(" ", ".", headers, None, 0, 1), zeros)
    notes = (Finding.of(Code.READ_COLUMNS_BY_VALUES, columns=headers, format=name),)
    axes = "" if part != "imu" else "FRD" if headers[0] == "time_s" else "RFU"
    return {part: Table(source.name, source.sha256, headers, cells, notes=notes, axes=axes)}


def _layout(head: bytes) -> tuple[str, tuple[str, ...]]:
    """Identify the part of the recording and its columns by the first rows; no columns if no layout fits."""
    lines = bytes(decoded(head)).splitlines()[: _ROWS + 1]
    rows = [line.split() for line in (lines[:-1] if len(lines) > 2 else lines) if line.strip()]
    try:
        numbers = np.array([[float(word) for word in row] for row in rows])
    except ValueError:  # the rows contain words, or have different lengths
        return "", ()
    if numbers.ndim != 2 or len(numbers) < 2 or not np.isfinite(numbers).all():
        return "", ()
    fitting = (layout for layout in _LAYOUTS if len(layout[1]) == numbers.shape[1] and _fits(numbers, layout[1]))
    return next(fitting, ("", ()))


def _fits(numbers: FloatArray, headers: tuple[str, ...]) -> bool:
    """Return True if rows ``(n, columns)`` have plausible times, increments, positions and deviations for a layout."""
    columns = {header: numbers[:, i] for i, header in enumerate(headers)}
    time, step = columns["time_s"], np.diff(columns["time_s"])
    sd = np.array([columns[header] for header in headers if header.startswith("sd_")])
    if not ((step > 0.0).all() and time[0] >= 0.0 and time[-1] <= WEEK and ((sd > 0.0) & (sd < 1e3)).all()):
        return False
    if "lat_rad" in columns and not np.median(step) > _FASTEST_FIXES:
        return False
    week = columns.get("week", np.array([1000.0]))
    valid_week = 500.0 < week[0] < 10_000.0 and float(week[0]).is_integer() and (week == week[0]).all()
    if not valid_week or ("week" in columns and np.abs(numbers[:, 8:10]).max() > 180.0):
        return False
    if "dtheta_x_rad" in columns:
        rates, forces = (np.array([columns[header][1:] for header in part]) / step for part in (_IMU[:3], _IMU[3:]))
        gravity, rate = (float(np.median(np.linalg.norm(vectors, axis=0))) for vectors in (forces, rates))
        return bool(_GRAVITY[0] < gravity < _GRAVITY[1] and rate < 10.0 and np.median(step) < 0.2)
    angles = [columns[header] / (1.0 if "deg" in header else DEG) for header in headers if header[:3] in ("lat", "lon")]
    lla = np.column_stack([*angles, columns["height_m"]])
    # latitude and longitude [deg] vary little and are not near zero, unlike other small numbers; height in [m]
    inside = (np.abs(lla) <= [90.0, 180.0, 1e4]).all()
    return bool(inside and np.ptp(lla[:, :2], axis=0).max() < 0.1 and np.abs(lla[:, :2]).max() > 1.0)
