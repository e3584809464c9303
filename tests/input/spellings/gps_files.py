"""Spellings of files of fixes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymap3d

from tests.input.spellings.imu_files import digits, iso, parts_of_time
from tests.input.spellings.recorded import DEG, GPS_HEADERS, UNIX, drive, fixes, table, text

SHORT = "time,lat,lon,alt,vn,ve,vd,sdn,sde,sdu"
PLAIN = "time,lat,lon,height"


def _csv(headers: str = SHORT, time: Callable[[np.ndarray], list[str]] | None = None, **changed: list[str]):
    return lambda folder: table(folder / "gps.csv", fixes(headers, time, **changed))


def _with(headers: str, *more: tuple[str, Callable[[], list[str]]], **changed: Callable[[], list[str]]):
    def write(folder: Path) -> Path:
        made = {key: make() for key, make in changed.items()}
        return table(folder / "gps.csv", [*fixes(headers, None, **made), *((name, make()) for name, make in more)])

    return write


def _column(k: int, factor: float = 1.0, decimals: int = 6) -> Callable[[], list[str]]:
    """Velocity north, east, down times a factor."""
    return lambda: text(drive().v[:, k] * factor, decimals)


def _scaled(headers: str, factor: float) -> Callable[[Path], Path]:
    return _with(headers, vn=_column(0, factor), ve=_column(1, factor), vd=_column(2, factor))


def _angle(k: int, factor: float = 1.0, decimals: int = 12) -> Callable[[], list[str]]:
    return lambda: text(drive().lla[:, k] * factor, decimals)


def _minutes(k: int, sign: str = "") -> Callable[[], list[str]]:
    def make() -> list[str]:
        degrees = drive().lla[:, k]
        return [f"{sign}{int(each) * 100 + (each % 1.0) * 60.0:.8f}" for each in degrees]

    return make


def _lettered(k: int, letter: str) -> Callable[[], list[str]]:
    return lambda: [each + letter for each in _minutes(k)()]


def _sexagesimal(k: int, letter: str) -> Callable[[], list[str]]:
    def make() -> list[str]:
        parts = ((int(each), (each % 1.0) * 60.0) for each in drive().lla[:, k])
        return [f"{degrees}°{int(minutes):02d}'{(minutes % 1.0) * 60.0:08.5f}''{letter}" for degrees, minutes in parts]

    return make


def _same(value: str) -> Callable[[], list[str]]:
    return lambda: [value] * len(drive().gps_t)


def _speed(factor: float = 1.0) -> Callable[[], list[str]]:
    return lambda: text(np.hypot(drive().v[:, 0], drive().v[:, 1]) * factor, 6)


def _course() -> list[str]:
    return text(np.arctan2(drive().v[:, 1], drive().v[:, 0]) / DEG % 360.0, 6)


def _integers(k: int) -> Callable[[], list[str]]:
    factor = 1e7 if k < 2 else 1e3
    return lambda: [str(round(each * factor)) for each in drive().lla[:, k]]


def _rows(change: Callable[[list[str]], list[str]], headers: str = SHORT) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = table(folder / "gps.csv", fixes(headers))
        head, *lines = path.read_text().splitlines()
        path.write_text("\n".join([head, *change(lines)]) + "\n")
        return path

    return write


def _zeros(lines: list[str]) -> list[str]:
    return [f"{408647 + i}.0,0,0,0,0,0,0,1,1,1" for i in range(1)] + lines


def _each(k: int, cell: str, row: int) -> Callable[[list[str]], list[str]]:
    def change(lines: list[str]) -> list[str]:
        cells = lines[row].split(",")
        return [*lines[:row], ",".join([*cells[:k], cell, *cells[k + 1 :]]), *lines[row + 1 :]]

    return change


def _navsatfix(folder: Path) -> Path:
    made = drive()
    stamps = [str(round((UNIX + each) * 1e4) * 100_000) for each in made.gps_t]
    n = len(stamps)
    columns = [
        ("%time", stamps),
        ("field.header.seq", [str(i) for i in range(n)]),
        ("field.header.frame_id", ["gps"] * n),
    ]
    columns += [("field.status.status", ["0"] * n), ("field.status.service", ["1"] * n)]
    columns += [
        (f"field.{name}", text(made.lla[:, k], 10)) for k, name in enumerate(("latitude", "longitude", "altitude"))
    ]
    variances = {0: made.sd[:, 1] ** 2, 4: made.sd[:, 0] ** 2, 8: made.sd[:, 2] ** 2}
    columns += [(f"field.position_covariance{i}", text(variances.get(i, np.zeros(n)), 9)) for i in range(9)]
    columns += [("field.position_covariance_type", ["2"] * n)]
    return table(folder / "gps.csv", columns)


def _earth_fixed(headers: str, unit: float = 1.0) -> Callable[[Path], Path]:
    """Positions and velocities as another package turns them."""

    def write(folder: Path) -> Path:
        made = drive()
        place = np.array(pymap3d.geodetic2ecef(*made.lla.T))
        speed = np.array(pymap3d.enu2uvw(made.v[:, 1], made.v[:, 0], -made.v[:, 2], *made.lla[:, :2].T))
        cells = [text(made.gps_t, 3), *(text(each / unit, 6) for each in (*place, *speed))]
        return table(folder / "gps.csv", list(zip(headers.split(","), cells, strict=False)))

    return write


def _calendar(folder: Path) -> Path:
    return table(folder / "gps.csv", [*parts_of_time(drive().gps_t), *fixes(SHORT)[1:]])


def _phone(folder: Path) -> Path:
    made = drive()
    stamps = [str(round((UNIX + each) * 1e3) * 1_000_000) for each in made.gps_t]
    n = len(stamps)
    columns = [("time", stamps), ("bearingAccuracy", ["2.0"] * n), ("speedAccuracy", ["0.2"] * n)]
    columns += [("verticalAccuracy", ["4.0"] * n), ("horizontalAccuracy", ["3.0"] * n)]
    columns += [("speed", _speed()()), ("bearing", _course())]
    columns += [(name, text(made.lla[:, k], 10)) for k, name in ((2, "altitude"), (1, "longitude"), (0, "latitude"))]
    return table(folder / "gps.csv", columns)


def _frame(radians: bool) -> Callable[[Path], object]:
    def make(folder: Path) -> object:
        import pandas as pd

        made = drive()
        lla = made.lla * ([DEG, DEG, 1.0] if radians else 1.0)
        return pd.DataFrame(
            np.column_stack([made.gps_t, lla, made.v]), columns=["t", "lat", "lon", "h", "vn", "ve", "vd"]
        )

    return make


def _arrays(folder: Path) -> object:
    made = drive()
    return made.gps_t, made.lla * [DEG, DEG, 1.0]


KEYS = ["position", "velocity", "position_sd", "velocity_sd"]
# name -> writer, and what of position, velocity and their deviations is there
UNDERSTOOD: dict[str, tuple[Callable[[Path], object], str]] = {
    "canonical": (_csv(GPS_HEADERS), "pvsw"),
    "short": (_csv(), "pvs"),
    "in words": (
        _csv("Time (s),Latitude (°),Longitude (°),Altitude (m),Vel North (m/s),Vel East (m/s),Vel Down (m/s)"),
        "pv",
    ),
    "lng": (_csv("timestamp,lat,lng,elevation"), "p"),
    "gps before each": (_csv("gps_time,gps_lat,gps_lon,gps_alt,gps_vn,gps_ve,gps_vd"), "pv"),
    "with dots": (_csv("gps.time,gps.latitude,gps.longitude,gps.altitude"), "p"),
    "capital letters": (_csv("TIME,LATITUDE_DEG,LONGITUDE_DEG,HEIGHT_M,VN_MPS,VE_MPS,VD_MPS"), "pv"),
    "units in brackets": (
        _csv("t [s],lat [deg],lon [deg],h [m],vn [m/s],ve [m/s],vd [m/s],sdn [m],sde [m],sdd [m]"),
        "pvs",
    ),
    "millimetres of deviation": (
        _with(
            "t,lat,lon,h,vn,ve,vd,sdn (mm),sde (mm),sdd (mm)",
            **{key: (lambda k=k: text(drive().sd[:, k] * 1e3, 6)) for k, key in enumerate(("sd_n", "sd_e", "sd_d"))},
        ),
        "pvs",
    ),
    "PX4": (_csv("timestamp,lat,lon,alt,vel_n_m_s,vel_e_m_s,vel_d_m_s", time=lambda t: text(t * 1e6, 0)), "pv"),
    "location": (_csv("locationTime,locationLatitude(WGS84),locationLongitude(WGS84),locationAltitude(m)"), "p"),
    "ellipsoidal height": (_csv("tow,lat,lon,ellipsoidal height (m)"), "p"),
    "speed north": (_csv("t,lat,lon,h,speed_north,speed_east,speed_down"), "pv"),
    "ground speed and track": (_with(PLAIN, ("ground speed (km/h)", _speed(3.6)), ("track (deg)", _course)), "pv"),
    "phyphox": (
        _with(
            "Time (s),Latitude (°),Longitude (°),Altitude (m)",
            ("Velocity (m/s)", _speed()),
            ("Direction (°)", _course),
            ("Horizontal Accuracy (m)", _same("3.0")),
            ("Vertical Accuracy (°)", _same("4.0")),
        ),
        "pv",
    ),
    "quoted": (
        lambda folder: table(folder / "gps.csv", fixes(SHORT), change=lambda row: '"' + row.replace(",", '","') + '"'),
        "pvs",
    ),
    "carriage returns": (lambda folder: table(folder / "gps.csv", fixes(SHORT), end="\r\n"), "pvs"),
    "comments before": (lambda folder: table(folder / "gps.csv", fixes(SHORT), before="% receiver\n% 5 Hz\n"), "pvs"),
    "longitude first": (lambda folder: table(folder / "gps.csv", [fixes(SHORT)[k] for k in (0, 2, 1, 3)]), "p"),
    "time last": (lambda folder: table(folder / "gps.csv", fixes(SHORT)[::-1]), "pvs"),
    "deviations in words": (_csv("t,lat,lon,h,vn,ve,vd,std_north,std_east,std_down"), "pvs"),
    "velocity in words": (_csv("t,lat,lon,h,north_velocity,east_velocity,down_velocity"), "pv"),
    "semicolons": (lambda folder: table(folder / "gps.csv", fixes(SHORT), delimiter=";"), "pvs"),
    "decimal comma": (
        lambda folder: table(folder / "gps.csv", fixes(SHORT), delimiter=";", change=lambda row: row.replace(".", ",")),
        "pvs",
    ),
    "blanks": (lambda folder: table(folder / "gps.csv", fixes(SHORT), delimiter=" "), "pvs"),
    "header as comment": (_csv("# " + SHORT), "pvs"),
    "week and tow": (_with(PLAIN.replace("time", "tow"), ("week", _same("2381"))), "p"),
    "degrees and decimal minutes with letters": (
        _with(
            PLAIN,
            lat=lambda: [f"{each}N" for each in _minutes(0)()],
            lon=lambda: [f"{each}E" for each in _minutes(1)()],
        ),
        "p",
    ),
    "sigma": (_csv("t,lat,lon,h,v_n,v_e,v_d,sigma_n,sigma_e,sigma_d"), "pvs"),
    "std_lat": (_csv("t,lat,lon,h,vel_n,vel_e,vel_d,std_lat,std_lon,std_alt"), "pvs"),
    "velocity up": (_with("t,lat,lon,h,vn,ve,vu", vd=_column(2, -1.0)), "pv"),
    "cm/s": (_scaled("t,lat,lon,h,vn (cm/s),ve (cm/s),vd (cm/s)", 100.0), "pv"),
    "km/h, not said": (_scaled("t,lat,lon,h,vn,ve,vd", 3.6), "pv"),
    "mm/s, not said": (_scaled("t,lat,lon,h,velN,velE,velD", 1e3), "pv"),
    "knots, not said": (_scaled("t,lat,lon,h,vn,ve,vd", 3600.0 / 1852.0), "pv"),
    "radians by name": (_with("t,lat_rad,lon_rad,h,vn,ve,vd", lat=_angle(0, DEG), lon=_angle(1, DEG)), "pv"),
    "radians, not said": (_with("t,lat,lon,h,vn,ve,vd", lat=_angle(0, DEG), lon=_angle(1, DEG)), "pv"),
    "degrees and minutes, letters": (
        _with(PLAIN, ("N/S", _same("N")), ("E/W", _same("E")), lat=_minutes(0), lon=_minutes(1)),
        "p",
    ),
    "degrees and minutes": (_with(PLAIN, lat=_minutes(0), lon=_minutes(1)), "p"),
    "letter behind": (
        _with(
            PLAIN,
            lat=lambda: [f"{each:.10f}N" for each in drive().lla[:, 0]],
            lon=lambda: [f"{each:.10f} E" for each in drive().lla[:, 1]],
        ),
        "p",
    ),
    "degrees, minutes, seconds": (_with(PLAIN, lat=_sexagesimal(0, "N"), lon=_sexagesimal(1, "E")), "p"),
    "integers of PX4 and u-blox": (
        _with("t,lat,lon,alt,vn,ve,vd", lat=_integers(0), lon=_integers(1), height=_integers(2)),
        "pv",
    ),
    "speed and course": (_with(PLAIN, ("speed", _speed()), ("course", _course)), "pv"),
    "knots and course": (_with(PLAIN, ("SOG (kn)", _speed(3600.0 / 1852.0)), ("COG (deg)", _course)), "pv"),
    "km/h and course, not said": (
        _with(PLAIN, ("speed", _speed(3.6)), ("heading_motion", _same("")), ("course", _course)),
        "pv",
    ),
    "accuracies of u-blox": (
        _with(
            "iTOW,lat,lon,hMSL,velN,velE,velD", ("hAcc", _same("1.5")), ("vAcc", _same("2.5")), ("sAcc", _same("0.1"))
        ),
        "pv",
    ),
    "phone": (_phone, "pv"),
    "rostopic": (_navsatfix, "ps"),
    "one deviation is zero": (_rows(_each(7, "0.0", 5)), "pv"),
    "a fix without a position": (_rows(_each(1, "", 5)), "-"),
    "nan": (_rows(_each(1, "nan", 5)), "-"),
    "zeros before the first fix": (_rows(_zeros), "-"),
    "a row twice": (_rows(lambda lines: [*lines[:5], lines[4], *lines[5:]]), "pvs"),
    "two rows exchanged": (_rows(lambda lines: [*lines[:5], lines[6], lines[5], *lines[7:]]), "pvs"),
    "milliseconds of the week": (_csv("iTOW,lat,lon,height", time=lambda t: text(t * 1e3, 0)), "p"),
    "date and clock in columns": (_calendar, "pv"),
    "Earth-fixed": (_earth_fixed("time,ecef_x,ecef_y,ecef_z,ecef_vx,ecef_vy,ecef_vz"), "pv"),
    "Earth-fixed, kilometres": (_earth_fixed("time,X (km),Y (km),Z (km)", 1e3), "p"),
    "Earth-fixed, not said": (_earth_fixed("t,x,y,z,vx,vy,vz"), "pv"),
    "ISO": (_csv("time,lat,lon,height", time=iso("%Y-%m-%dT%H:%M:%S.%fZ")), "p"),
    "ISO, local": (
        _csv("time,lat,lon,height", time=iso("%Y-%m-%d %H:%M:%S.%f+02:00", 2.0)),
        "p",
    ),
    "Unix beside weeks": (_csv(time=lambda t: text(t + UNIX, 3)), "pvs"),
    "data frame": (_frame(radians=False), "pv"),
    "data frame in radians": (_frame(radians=True), "pv"),
    "height above the sea": (_csv("t,lat,lon,msl"), "p"),
    "velocity of the antenna and fix": (_with("t,lat,lon,h,vn,ve,vd", ("fix", _same("1"))), "pv"),
}
REFUSED: dict[str, tuple[Callable[[Path], object], str, dict[str, object], dict[str, object] | None]] = {
    "velocities exchanged": (
        _with("t,lat,lon,h,vn,ve,vd", vn=_column(1), ve=_column(0)),
        "input.velocities_exchanged",
        {"columns": "vn=ve,ve=vn"},
        {"gps_columns": {"vn": "ve", "ve": "vn"}},
    ),
    "velocity up named down": (
        _with("t,lat,lon,h,vn,ve,vd", vd=_column(2, -1.0)),
        "input.velocity_up",
        {"columns": "vu=vd"},
        {"gps_columns": {"vu": "vd"}},
    ),
    "velocity south": (
        _with("t,lat,lon,h,vn,ve,vd", vn=_column(0, -1.0)),
        "input.velocities_mirrored",
        {"velocities": ("vn",)},
        None,
    ),
    "km/h named m/s": (_scaled("t,lat,lon,h,vn_m_s,ve_m_s,vd_m_s", 3.6), "input.velocity_unit", {"unit": "km/h"}, None),
    "latitude and longitude exchanged": (
        _with("t,lat,lon,h,vn,ve,vd", lat=_angle(1), lon=_angle(0)),
        "input.exchanged_by_velocity",
        {"columns": "lat=lon,lon=lat"},
        {"gps_columns": {"lat": "lon", "lon": "lat"}},
    ),
    "no header, with velocities": (
        lambda folder: table(folder / "gps.csv", fixes("time,lat,lon,height,vn,ve,vd"), header=False),
        "columns.no_header",
        {"guess": "time=1,lat=2,lon=3,height=4,vn=5,ve=6", "option": "--gps-columns"},
        {"gps_columns": {"time": "1", "lat": "2", "lon": "3", "height": "4", "vn": "5", "ve": "6"}},
    ),
    "arrays in radians": (_arrays, "session.positions_in_radians", {}, None),
    "radians without velocities": (
        _with(PLAIN, lat=_angle(0, DEG), lon=_angle(1, DEG)),
        "input.angle_unit_unclear",
        {},
        None,
    ),
    "radians named degrees": (
        _with("t,lat_deg,lon_deg,h,vn,ve,vd", lat=_angle(0, DEG), lon=_angle(1, DEG)),
        "input.positions_in_radians",
        {},
        None,
    ),
    "all deviations zero": (
        _with("t,lat,lon,h,vn,ve,vd,sd_n,sd_e,sd_d", sd_n=_same("0"), sd_e=_same("0"), sd_d=_same("0")),
        "input.zero_sd",
        {"column": "sd_n"},
        None,
    ),
    "local plane": (_csv("time,x,y,z"), "columns.missing", {"guess": "lat=x,lon=y,height=z"}, None),
    "a map in the north": (
        lambda folder: table(
            folder / "gps.csv",
            [
                ("time", text(drive().gps_t, 3)),
                ("x", text(3.2e5 + 1e5 * drive().lla[:, 1] % 1e3, 3)),
                ("y", text(6.398e6 + 1e5 * drive().lla[:, 0] % 1e3, 3)),
                ("z", text(drive().lla[:, 2], 3)),
            ],
        ),
        "columns.missing",
        {"guess": "", "example": "lat"},
        None,
    ),
    "UTC seconds of the week": (
        _csv(time=lambda t: text(t - 18.0, 3)),
        "clock.differ",
        {"offset_s": -18.0},
        {"time_offset": -18.0},
    ),
    "digits of a UTC clock": (_csv(time=digits), "clock.no_common_time", {"offset_s": -345618.0}, None),
    "a day off": (
        _csv(time=lambda t: text(t + 86400.0, 3)),
        "clock.no_common_time",
        {"offset_s": 86400.0},
        {"time_offset": 86400.0},
    ),
    "boot milliseconds beside weeks": (
        _csv(time=lambda t: text(t - 408123.45, 3)),
        "clock.no_common_time",
        {"offset_s": -408123.452},
        {"time_offset": -408123.45},
    ),
}
