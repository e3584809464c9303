"""Text files of KF-GINS and PSINS: numbers separated by blanks, no header.

GNSS: seconds of the week, latitude, longitude [deg], height [m], standard deviations North, East, Down [m], optionally
velocity with standard deviations. IMU: seconds of the week, increments of angle [rad] and of velocity [m/s],
Forward-Right-Down. PSINS writes the arrays of its ``.mat`` files, with time in the last column: see `matlab`. A file is
recognised only if its numbers have no other interpretation.

References
----------
KF-GINS, i2Nav, Wuhan University: README, "dataset"; Niu, X. et al. Yan, G., PSINS toolbox, imuplot.m, gpsplot.m.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from insnav.findings import Code, Finding
from insnav.input.formats.delimited_text import TextCells
from insnav.input.formats.matlab import psins_table
from insnav.input.formats.source import Source, decoded, text_of
from insnav.input.formats.table import Table
from insnav.input.formats.text_dialect import Dialect
from insnav.input.formats.time_scales import WEEK
from insnav.types import FloatArray
from insnav.units import DEG

name = "KF-GINS text file"

_POSITION = ("time_s", "lat_deg", "lon_deg", "height_m", "sd_n_m", "sd_e_m", "sd_d_m")
_VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
_IMU = ("time_s", "dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad", "dvel_x_m_s", "dvel_y_m_s", "dvel_z_m_s")
_SOLUTION = (
    "week", "time_s", "lat_deg", "lon_deg", "height_m", "vn_m_s", "ve_m_s", "vd_m_s", "roll_deg", "pitch_deg",
    "heading_deg",
)  # fmt: skip
_GRAVITY = (9.3, 10.3)  # sum of velocity increments per second [m/s^2]
_PSINS = {("avp", 10): 6, ("gps", 7): 3, ("gps", 4): 0}  # array and its width -> column of the latitude [rad]
_TO_DEG = [DEG, DEG, 1.0]
_FASTEST_FIXES = 0.04  # the shortest interval of receivers is 0.05 s; samples without a unit are faster [s]
_ROWS = 20  # rows examined


def recognise(source: Source) -> bool:
    return bool(_layout(source.head)[1])


def read(source: Source) -> Mapping[str, Table]:
    text, zeros = text_of(source)
    part, headers = _layout(source.head)
    cells = TextCells(source.name, text, Dialect(" ", ".", headers, None, 0, 1), zeros)
    if headers[0] == "1":  # unnamed: an array of PSINS
        numbers = cells.read(range(len(headers)))
        part, table = psins_table(source, part, np.column_stack([*numbers.columns.values()]), numbers.cut)
        return {part: table} if table else {}
    notes = (Finding.of(Code.READ_COLUMNS_BY_VALUES, columns=headers, format=name),)
    axes = "FRD" if part == "imu" else ""
    return {part: Table(source.name, source.sha256, headers, cells, notes=notes, axes=axes)}


def _layout(head: bytes) -> tuple[str, tuple[str, ...]]:
    """Identify a file and its columns by the first rows; no columns if unknown."""
    lines = bytes(decoded(head)).splitlines()[: _ROWS + 1]
    rows = [line.split() for line in (lines[:-1] if len(lines) > 2 else lines) if line.strip()]
    try:
        numbers = np.array([[float(word) for word in row] for row in rows])
    except ValueError:  # words, or rows of different length
        return "", ()
    if numbers.ndim != 2 or len(numbers) < 2 or not np.isfinite(numbers).all():
        return "", ()
    found = _time_first(numbers)
    return found if found[1] else _psins(numbers)


def _time_first(numbers: FloatArray) -> tuple[str, tuple[str, ...]]:
    """Identify a file of KF-GINS; no columns if unknown."""
    width = numbers.shape[1]
    time = numbers[:, 1 if width == 11 else 0]
    step = np.diff(time)
    if not (step > 0.0).all() or time[0] < 0.0 or time[-1] > WEEK:
        return "", ()
    sd = numbers[:, [4, 5, 6, *range(10, width)]] if width in (7, 13) else np.zeros(1)
    if ((sd > 0.0) & (sd < 1e3)).all() and _is_place(numbers[:, 1:4]):
        return "gps", (*_POSITION, *_VELOCITY)[:width]
    if width == 11 and _is_place(numbers[:, 2:5]) and (numbers[:, 0] == numbers[0, 0]).all():
        whole = 500.0 < numbers[0, 0] < 10_000.0 and float(numbers[0, 0]).is_integer()
        return ("reference", _SOLUTION) if whole and (np.abs(numbers[:, 8:10]) <= 180.0).all() else ("", ())
    return ("imu", _IMU) if width == 7 and _are_increments(numbers[1:, 1:], step) else ("", ())


def _psins(numbers: FloatArray) -> tuple[str, tuple[str, ...]]:
    """Identify an array of PSINS, with numbers as column names; no columns if unknown."""
    width = numbers.shape[1]
    step, headers = np.diff(numbers[:, -1]), tuple(str(i + 1) for i in range(width))
    if not (step > 0.0).all() or numbers[0, -1] < 0.0 or numbers[-1, -1] > WEEK:
        return "", ()
    if width == 7 and _are_increments(numbers[1:, :6], step):
        return "imu", headers
    for (array, columns), lat in _PSINS.items():
        place, rare = numbers[:, lat : lat + 3], array == "avp" or np.median(step) > _FASTEST_FIXES
        if (
            width == columns
            and rare
            and (np.abs(place[:, :2]) <= [0.5 * np.pi, np.pi]).all()
            and _is_place(place / _TO_DEG)
        ):
            return array, headers
    return "", ()


def _are_increments(values: FloatArray, step: FloatArray) -> bool:
    """Test for increments of angle and velocity ``(n, 6)`` over times ``(n,)``: they show gravity."""
    felt, turned = (np.median(np.linalg.norm(part, axis=1) / step) for part in (values[:, 3:], values[:, :3]))
    return bool(_GRAVITY[0] < felt < _GRAVITY[1] and turned < 10.0 and np.median(step) < 0.2)


def _is_place(lla: FloatArray) -> bool:
    """Test for nearly constant latitude, longitude [deg] and height [m], not small numbers of another kind."""
    inside = (np.abs(lla) <= [90.0, 180.0, 1e4]).all()
    return bool(inside and np.ptp(lla[:, :2], axis=0).max() < 0.1 and np.abs(lla[:, :2]).max() > 1.0)
