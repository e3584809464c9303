"""CSV files of VectorNav units, with the names of their binary outputs, as INSTINCT writes them.

References
----------
VectorNav VN-310 Interface Control Document, binary output groups Time, IMU, GNSS1, Attitude, INS.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from insnav.input.formats import delimited_text
from insnav.input.formats.conventions import ACCEL, GYRO, TextColumns, deviations, text_columns
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK_DAYS, seconds_of_week
from insnav.types import FloatArray

name = "VectorNav CSV"
suffixes = ()
extra = ""

_AXES, _NED = ("X", "Y", "Z"), ("N", "E", "D")
_TIMES = {"tow": "Time::GpsTow [ns]", "week": "Time::GpsWeek", "tow_s": "GpsTow [s]", "boot": "Time::TimeStartup [ns]"}
_SAMPLES = (
    ("IMU::UncompGyro::{} [rad/s]", "IMU::UncompAccel::{} [m/s^2]"),
    ("IMU::AngularRate::{} [rad/s]", "IMU::Accel::{} [m/s^2]"),
    ("IMU::AngularRate::{}", "IMU::Accel::{}"),
)
_TEMPERATURE = {"temperature_c": "IMU::Temp [Celsius]"}
_PLACE = {
    "lat_deg": "GNSS1::PosLla::latitude [deg]",
    "lon_deg": "GNSS1::PosLla::longitude [deg]",
    "height_m": "GNSS1::PosLla::altitude [m]",
}
_OTHERS = {
    **{f"v{axis.lower()}_m_s": f"GNSS1::VelNed::{axis} [m/s]" for axis in _NED},
    **{f"sd_{axis.lower()}": f"GNSS1::PosU::{axis} [m]" for axis in _NED},
    "sd_v": "GNSS1::VelU [m/s]",
    "kind": "GNSS1::Fix",
    "fix_tow": "GNSS1::Tow [ns]",
    "fix_week": "GNSS1::Week",
}
_INS = {
    "lat_deg": "INS::PosLla::latitude [deg]",
    "lon_deg": "INS::PosLla::longitude [deg]",
    "height_m": "INS::PosLla::altitude [m]",
    **{f"v{axis.lower()}_m_s": f"INS::VelNed::{axis} [m/s]" for axis in _NED},
    "heading_deg": "Att::YawPitchRoll::Y [deg]",
    "pitch_deg": "Att::YawPitchRoll::P [deg]",
    "roll_deg": "Att::YawPitchRoll::R [deg]",
}
_FIXES = {2: 5.0, 3: 5.0, 4: 4.0, 7: 2.0, 8: 1.0}  # 2D, 3D, SBAS, RTK float, RTK fixed


def recognise(source: Source) -> bool:
    """See `insnav.input.formats.registry.Format`."""
    first = source.head.split(b"\n", 1)[0]
    return b"," in first and any(word in first for word in (b"IMU::", b"GNSS1::PosLla", b"Time::TimeStartup"))


def read(source: Source) -> Mapping[str, Table]:
    """See `insnav.input.formats.registry.Format`."""
    table = delimited_text.read(source)[""]
    samples = [
        dict(zip(GYRO + ACCEL, [each.format(axis) for each in pair for axis in _AXES], strict=True))
        for pair in _SAMPLES
    ]
    kinds = (_TIMES, _TEMPERATURE, _PLACE, _OTHERS, _INS, *samples)
    text = text_columns(table, (header for kind in kinds for header in kind.values()))
    time, notes = _time(text.named(_TIMES))
    tables: dict[str, Table] = {}
    columns = next((found for kind in samples if len(found := text.named(kind)) == 6), None)
    if columns is not None:
        columns = {"time_s": time, **columns, **text.named(_TEMPERATURE)}
        tables["imu"] = column_table(source, columns, notes, cut=text.cut, axes="FRD")
    place = text.named(_PLACE)
    if len(place) == len(_PLACE):
        tables["gps"] = _fixes(source, place, text, (time, notes))
    solution = text.named(_INS)
    if len(solution) == len(_INS) and (solution["lat_deg"] != 0.0).any():
        solution["heading_deg"] = solution["heading_deg"] % 360.0
        notes = (*notes, "the unit's own solution")
        tables["reference"] = column_table(source, {"time_s": time, **solution}, notes, cut=text.cut)
    return tables or {"": table}


def _time(clock: Mapping[str, FloatArray]) -> tuple[FloatArray, tuple[str, ...]]:
    """Seconds of the GPS week, else since the start of the unit."""
    if "tow" in clock and "week" in clock and np.nanmax(clock["week"], initial=0.0) > 0.0:
        return _of_week(clock["week"], clock["tow"])
    if "tow_s" in clock and np.isfinite(clock["tow_s"]).any():
        return clock["tow_s"], ("times are seconds of the GPS week",)
    if "boot" in clock:
        return clock["boot"] * 1e-9, ("times are seconds since the unit was switched on: it had no GPS time",)
    return np.full(len(next(iter(clock.values()), ())), np.nan), ()


def _of_week(week: FloatArray, tow: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    known = np.isfinite(week) & (week > 0.0) & np.isfinite(tow)
    first = float(week[known][0]) if known.any() else 0.0
    time, note = seconds_of_week(WEEK_DAYS * np.where(known, week, first), tow * 1e-9, week=first)
    return np.where(known, time, np.nan), (note,)


def _fixes(
    source: Source, place: dict[str, FloatArray], text: TextColumns, clock: tuple[FloatArray, tuple[str, ...]]
) -> Table:
    """Fixes at their own times; rows without a fix are left out, as are those that repeat one."""
    others = text.named(_OTHERS)
    week, tow = others.get("fix_week"), others.get("fix_tow")
    time, notes = _of_week(week, tow) if week is not None and tow is not None else clock
    columns = {"time_s": time, **place}
    columns |= {key: others[key] for key in ("vn_m_s", "ve_m_s", "vd_m_s") if key in others}
    if all(f"sd_{axis}" in others for axis in "ned"):
        columns |= deviations(np.column_stack([others[f"sd_{axis}"] for axis in "ned"]), "sd_{}_m")
    if "sd_v" in others:
        columns |= deviations(np.column_stack([others["sd_v"]] * 3), "sd_v{}_m_s")
    kind = others.get("kind", np.full(len(time), 3.0))
    good = np.isin(kind, list(_FIXES)) & np.isfinite(time)
    columns["fix"] = np.array([_FIXES.get(int(each), 0.0) if each == each else 0.0 for each in kind])
    fresh = np.concatenate(([True], np.diff(time) != 0.0)) if len(time) else good
    if not good.all():
        notes = (*notes, f"{int((~good).sum())} of {len(good)} rows have no fix: left out")
    return column_table(source, {key: column[good & fresh] for key, column in columns.items()}, notes, cut=text.cut)
