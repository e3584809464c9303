"""CSV files of VectorNav units, with the names of their binary outputs, as written by INSTINCT.

References
----------
VectorNav VN-310 Interface Control Document, binary output groups Time, IMU, GNSS1, Attitude, INS.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text
from insnav.input.formats.conventions import ACCEL, GYRO, VELOCITY, TextColumns, deviations, fix_table, text_columns
from insnav.input.formats.source import Source
from insnav.input.formats.table import Table, column_table
from insnav.input.formats.time_scales import WEEK_DAYS, GpsTime, seconds_of_week
from insnav.types import FloatArray

name = "VectorNav CSV"

_AXES, _NED = ("X", "Y", "Z"), ("N", "E", "D")
_TIMES = {"tow": "Time::GpsTow [ns]", "week": "Time::GpsWeek", "tow_s": "GpsTow [s]", "boot": "Time::TimeStartup [ns]"}
_SAMPLES = (
    ("IMU::UncompGyro::{} [rad/s]", "IMU::UncompAccel::{} [m/s^2]"),
    ("IMU::AngularRate::{} [rad/s]", "IMU::Accel::{} [m/s^2]"),
    ("IMU::AngularRate::{}", "IMU::Accel::{}"),
)
_TEMPERATURE = {"temperature_c": "IMU::Temp [Celsius]"}
_LLA = {"lat_deg": "latitude [deg]", "lon_deg": "longitude [deg]", "height_m": "altitude [m]"}
_PLACE = {key: f"GNSS1::PosLla::{name}" for key, name in _LLA.items()}
_OTHERS = {
    **{f"v{axis.lower()}_m_s": f"GNSS1::VelNed::{axis} [m/s]" for axis in _NED},
    **{f"sd_{axis.lower()}": f"GNSS1::PosU::{axis} [m]" for axis in _NED},
    "sd_v": "GNSS1::VelU [m/s]",
    "kind": "GNSS1::Fix",
    "fix_tow": "GNSS1::Tow [ns]",
    "fix_week": "GNSS1::Week",
}
_INS = {
    **{key: f"INS::PosLla::{name}" for key, name in _LLA.items()},
    **{f"v{axis.lower()}_m_s": f"INS::VelNed::{axis} [m/s]" for axis in _NED},
    **{f"{key}_deg": f"Att::YawPitchRoll::{key[0].upper()} [deg]" for key in ("roll", "pitch")},
    "heading_deg": "Att::YawPitchRoll::Y [deg]",
}
_FIXES = {2: 5.0, 3: 5.0, 4: 4.0, 7: 2.0, 8: 1.0}  # code of 2D, 3D, SBAS, RTK float, RTK fixed -> fix type


def recognise(source: Source) -> bool:
    first = source.head.split(b"\n", 1)[0]
    return b"," in first and any(word in first for word in (b"IMU::", b"GNSS1::PosLla", b"Time::TimeStartup"))


def read(source: Source) -> Mapping[str, Table]:
    table = delimited_text.read(source)[""]
    samples = [
        dict(zip(GYRO + ACCEL, [name.format(axis) for name in pair for axis in _AXES], strict=True))
        for pair in _SAMPLES
    ]
    kinds = (_TIMES, _TEMPERATURE, _PLACE, _OTHERS, _INS, *samples)
    text = text_columns(table, (header for kind in kinds for header in kind.values()))
    clock = _time(text.named(_TIMES))
    time, note, week = clock
    tables: dict[str, Table] = {}
    columns = next((found for kind in samples if len(found := text.named(kind)) == 6), None)
    if columns is not None:
        columns = {"time_s": time, **columns, **text.named(_TEMPERATURE)}
        tables["imu"] = column_table(source, columns, [note], cut=text.cut, axes="FRD", week=week)
    place = text.named(_PLACE)
    if len(place) == len(_PLACE):
        tables["gps"] = _fixes(source, place, text, clock)
    solution = text.named(_INS)
    if len(solution) == len(_INS) and (solution["lat_deg"] != 0.0).any():
        solution["heading_deg"] = solution["heading_deg"] % 360.0
        fused_notes = [note, Finding.of(Code.READ_FUSED)]
        tables["reference"] = column_table(source, {"time_s": time, **solution}, fused_notes, cut=text.cut, week=week)
    return tables or {"": table}


def _time(clock: Mapping[str, FloatArray]) -> GpsTime:
    """Return seconds of the GPS week; without GPS time, seconds since power-up."""
    if "tow" in clock and "week" in clock and np.nanmax(clock["week"], initial=0.0) > 0.0:
        return _of_week(clock["week"], clock["tow"])
    if "tow_s" in clock and np.isfinite(clock["tow_s"]).any():
        return GpsTime(clock["tow_s"], Finding.of(Code.READ_TIME_UNKNOWN_WEEK), None)
    if "boot" in clock:
        return GpsTime(clock["boot"] * 1e-9, Finding.of(Code.READ_TIME_SINCE_START), None)
    return GpsTime(np.full(len(next(iter(clock.values()), ())), np.nan), None, None)


def _of_week(week: FloatArray, tow: FloatArray) -> GpsTime:
    known = np.isfinite(week) & (week > 0.0) & np.isfinite(tow)
    first = float(week[known][0]) if known.any() else 0.0
    time, note, _ = seconds_of_week(WEEK_DAYS * np.where(known, week, first), tow * 1e-9, week=first)
    return GpsTime(np.where(known, time, np.nan), note, first)


def _fixes(source: Source, place: dict[str, FloatArray], text: TextColumns, clock: GpsTime) -> Table:
    """Select the fixes at their own times, without invalid rows and without repetitions of a fix."""
    others = text.named(_OTHERS)
    if "fix_week" in others and "fix_tow" in others:
        clock = _of_week(others["fix_week"], others["fix_tow"])
    columns = {"time_s": clock.time, **place}
    columns |= {key: others[key] for key in VELOCITY if key in others}
    if all(f"sd_{axis}" in others for axis in "ned"):
        columns |= deviations(np.column_stack([others[f"sd_{axis}"] for axis in "ned"]), "sd_{}_m")
    if "sd_v" in others:
        columns |= deviations(np.column_stack([others["sd_v"]] * 3), "sd_v{}_m_s")
    kind = others.get("kind", np.full(len(clock.time), 3.0))
    fresh = np.concatenate(([True], np.diff(clock.time) != 0.0))[: len(kind)]  # rows between fixes repeat the fix
    kind = np.where(np.isfinite(clock.time), kind, np.nan)[fresh]
    columns = {key: column[fresh] for key, column in columns.items()}
    return fix_table(source, columns, kind, _FIXES, [clock.note], row="rows", cut=text.cut, week=clock.week)
