"""Trajectory in the formats of other programs: GPX, KML, GeoJSON, TUM, EuRoC, .pos, NMEA, SBET, ROS bag, CSV.

Times follow the format: UTC in GPX, GeoJSON, NMEA, bags and CSV, GPS time in .pos and SBET, nanoseconds in EuRoC.

TUM files (``time x y z qx qy qz qw``) contain positions East, North, Up in the tangent plane at the first epoch. Their
rotation is from body axes (Forward, Right, Down) to these axes. Poses of compared runs are the reference plus their
errors North, East, Down in metres. The distances between two files thus equal insnav's errors, to rounding.

References
----------
ROS sensor_msgs, geometry_msgs and nav_msgs, noetic: message encoding. REP-103, REP-105 (axes: East, North, Up; Forward,
Left, Up). Applanix POSPac: SBET of 17 and smrmsg of 10 doubles a record. UTM: C. F. F. Karney, "Transverse Mercator
with an accuracy of a few nanometers", J. Geodesy 85 (2011) 475-485. Zones of UTM: NGA.STND.0037 (2014).
"""

from __future__ import annotations

import json
import math
import struct
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
from numpy.typing import NDArray

from insnav.attitude import dcm_from_quat, dcm_from_rph, quat_conjugate, quat_from_dcm, quat_from_rph, quat_multiply
from insnav.earth import earth_from_lla, level_from_earth, quat_earth_from_level, transport_rate_n
from insnav.exceptions import ConfigError
from insnav.kernels.earth import E2, A
from insnav.plain_text import plain_text
from insnav.spline import Spline
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG

_GAP = 2.0  # longest step of a spline, in median steps [-]: across longer gaps it would oscillate
_FEWEST = 4  # fewest rows for a spline


def body_motion(track: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Compute angular rate and acceleration relative to the Earth, by cubic splines of attitude and velocity.

    Returns: rate ``w_eb_b`` (n, 3) [rad/s] and acceleration without gravity (n, 3) [m/s^2], in body axes. Derivatives
    are zero in parts of fewer than four rows between gaps; NaN where the trajectory is unknown.
    """
    q = quat_from_rph(track.rph)  # signs are arbitrary; made continuous below, for the splines
    sign = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    q *= np.concatenate([[1.0], np.cumprod(sign)])[:, None]
    slope = np.zeros((len(q), 7))
    step = np.diff(track.time)
    for rows in np.split(np.arange(len(q)), np.flatnonzero(step > _GAP * np.median(step)) + 1):
        if len(rows) >= _FEWEST:
            time = track.time[rows]
            slope[rows] = Spline(time, np.hstack([q, track.v_n])[rows]).changes(time)[0]
    to_body = np.swapaxes(dcm_from_rph(track.rph), 1, 2)
    w_en = transport_rate_n(track.lla[:, 0], track.lla[:, 2], track.v_n)
    acceleration = slope[:, 4:] + np.cross(w_en, track.v_n)
    rate = 2.0 * quat_multiply(quat_conjugate(q), slope[:, :4])[:, 1:] + np.einsum("nij,nj->ni", to_body, w_en)
    return rate, np.einsum("nij,nj->ni", to_body, acceleration)


UTM_SCALE = 0.9996
_E = math.sqrt(E2)
_N = (1.0 - math.sqrt(1.0 - E2)) / (1.0 + math.sqrt(1.0 - E2))  # third flattening [-]
_RADIUS = A / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0 + _N**6 / 256.0)  # eq. 14 [m]
_ALPHA = (  # eq. 35: row j has the coefficients of n^j, n^(j+1), …
    (1 / 2, -2 / 3, 5 / 16, 41 / 180, -127 / 288, 7891 / 37800),
    (13 / 48, -3 / 5, 557 / 1440, 281 / 630, -1983433 / 1935360),
    (61 / 240, -103 / 140, 15061 / 26880, 167603 / 181440),
    (49561 / 161280, -179 / 168, 6601661 / 7257600),
    (34729 / 80640, -3418889 / 1995840),
    (212378941 / 319334400,),
)


def utm_zone(lat: float, lon: float) -> tuple[int, bool]:
    """Return the UTM zone of a position [rad], including the exceptions in Norway, and True south of the equator."""
    north, east = lat / DEG, (lon / DEG + 180.0) % 360.0 - 180.0
    zone = int((east + 180.0) // 6.0) + 1
    if 56.0 <= north < 64.0 and 3.0 <= east < 12.0:
        zone = 32
    elif north >= 72.0 and 0.0 <= east < 42.0:
        zone = 31 + 2 * int((east + 3.0) // 12.0)
    return zone, north < 0.0


def transverse_mercator(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Project positions onto a transverse Mercator plane with unit scale on the central meridian.

    `lat` (n,) [rad]. `lon` (n,): from the central meridian [rad].
    Returns: east, north [m], and meridian convergence [rad]: azimuth minus grid azimuth; (n,) each. Accurate to
    nanometres within 35 deg of the meridian.
    """
    tau, lon = np.tan(lat), (lon + math.pi) % (2.0 * math.pi) - math.pi
    sigma = np.sinh(_E * np.arctanh(_E * tau / np.hypot(1.0, tau)))  # eq. 7-9
    conformal = tau * np.hypot(1.0, sigma) - sigma * np.hypot(1.0, tau)
    xi = np.arctan2(conformal, np.cos(lon))  # eq. 10
    eta = np.arcsinh(np.sin(lon) / np.hypot(conformal, np.cos(lon)))
    north, east, p, q = xi.copy(), eta.copy(), np.ones_like(xi), np.zeros_like(xi)
    for j, row in enumerate(_ALPHA, 1):
        alpha = sum(coefficient * _N ** (j + k) for k, coefficient in enumerate(row))
        north += alpha * np.sin(2 * j * xi) * np.cosh(2 * j * eta)  # eq. 11
        east += alpha * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        p += 2 * j * alpha * np.cos(2 * j * xi) * np.cosh(2 * j * eta)  # eq. 12
        q += 2 * j * alpha * np.sin(2 * j * xi) * np.sinh(2 * j * eta)
    convergence = np.arctan2(conformal * np.tan(lon), np.hypot(1.0, conformal)) + np.arctan2(q, p)  # eq. 23
    return _RADIUS * east, _RADIUS * north, convergence


_DEGREES = np.array([DEG, DEG, 1.0])  # factors from degrees to radians for latitude and longitude; height in metres
KML_POINTS = 5000  # more points slow map programs without visible benefit
_KNOT = 1852.0 / 3600.0
_FIXED_SD, _FLOAT_SD = 0.1, 1.0  # horizontal sd [m] below which a .pos row has quality 1 or 2; else 5
_NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_HEAD = "# time [s], East, North, Up [m] from {:.9f} {:.9f} deg {:.4f} m, qx qy qz qw of Forward-Right-Down axes"
_FIX, _TWIST, _ODOMETRY = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Odometry"
_TOPICS = {_FIX: "/fix", _TWIST: "/vel", _ODOMETRY: "/odom"}
_HALF_ROLL = np.array([0.0, 1.0, 0.0, 0.0])  # quaternion from Forward-Left-Up to Forward-Right-Down


@dataclass(frozen=True, slots=True)
class Track:
    """Trajectory for export, with name, times and kind of height."""

    trajectory: Trajectory
    name: str
    utc: NDArray[np.datetime64] | None  # (n,) instants in UTC and in GPS time [ns]; None without a date
    gps: NDArray[np.datetime64] | None
    height: str  # ``ellipsoidal`` or ``msl``

    @property
    def degrees(self) -> FloatArray:
        """Latitude, longitude in [-180, 180) [deg], height [m], (n, 3)."""
        lla = self.trajectory.lla / _DEGREES
        lla[:, 1] = (lla[:, 1] + 180.0) % 360.0 - 180.0
        return np.asarray(lla, dtype=np.float64)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations of position [m] and velocity [m/s], (n, 6); NaN if unknown."""
        sd = self.trajectory.sd
        return np.full((len(self.trajectory.time), 6), np.nan) if sd is None else sd[:, :6]

    @property
    def of_week(self) -> FloatArray:
        """Seconds since the start of the first row's GPS week if the date is known, else the times [s], (n,)."""
        if self.gps is None:
            return self.trajectory.time
        since = (self.gps - np.datetime64("1980-01-06")) / np.timedelta64(1, "s")
        return np.asarray(since - since[0] // 604800.0 * 604800.0)

    def instants(self, of: str) -> NDArray[np.datetime64]:
        """Return instants in ``utc`` or ``gps``. Raises: ConfigError: the date is unknown."""
        times: NDArray[np.datetime64] | None = getattr(self, of)
        if times is None:
            raise ConfigError("output.no_date", where="--week", begin_s=float(self.trajectory.time[0]))
        return times


def gpx(track: Track) -> str:
    """Write GPX 1.1; its elevations are the heights of the run."""
    instants = np.datetime_as_string(track.instants("utc"), unit="us")
    points = (
        f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><ele>{h:.3f}</ele><time>{t}Z</time></trkpt>\n'
        for (lat, lon, h), t in zip(track.degrees.tolist(), instants.tolist(), strict=True)
    )
    title, about = escape(track.name, quote=False), f"elevations are {track.height} heights"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="insnav" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"<trk><name>{title}</name><desc>{about}</desc><trkseg>\n{''.join(points)}</trkseg></trk>\n</gpx>\n"
    )


def kml(track: Track) -> str:
    """Write KML, see `kml_text`."""
    return kml_text(track.trajectory, track.name)


def geojson(track: Track) -> str:
    """Write GeoJSON (RFC 7946): a line, cut at the date line into pieces of two points or more, and the times."""
    degrees = track.degrees
    cuts = np.flatnonzero(np.abs(np.diff(degrees[:, 1])) > 180.0) + 1
    pieces = [piece for piece in np.split(np.arange(len(degrees)), cuts) if len(piece) > 1]
    rows = np.array([row for piece in pieces for row in piece], dtype=int)
    places = [[round(lon, 9), round(lat, 9), round(h, 3)] for lat, lon, h in degrees.tolist()]
    times = [f"{t}Z" for t in np.datetime_as_string(track.utc[rows], unit="us")] if track.utc is not None else None
    feature = {
        "type": "Feature",
        "properties": {"name": track.name, "heights": track.height, "time_s": track.trajectory.time[rows].tolist()}
        | ({"times": times} if times else {}),
        "geometry": {"type": "MultiLineString", "coordinates": [[places[row] for row in piece] for piece in pieces]},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}, allow_nan=False) + "\n"


def tum(track: Track) -> str:
    """Write TUM, see `tum_files`."""
    return tum_files(track.trajectory, track.trajectory.time, {})["reference.tum"]


def euroc(track: Track) -> str:
    """Write EuRoC ground truth: nanoseconds, East, North, Up from the first epoch, velocity, attitude of FRD axes."""
    place, q, v = tangent_poses(track.trajectory)
    if track.utc is not None:
        stamps = (track.utc - np.datetime64(0, "ns")).astype(np.int64)
    else:
        stamps = np.round(track.trajectory.time * 1e9).astype(np.int64)
    head = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    head += "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1]"
    rows = np.column_stack([place, q, v]).tolist()
    lines = (f"{t}," + ",".join(f"{x:.9f}" for x in row) for t, row in zip(stamps.tolist(), rows, strict=True))
    return "\n".join([head, *lines, ""])


def pos(track: Track) -> str:
    """Write an RTKLIB solution in GPS time, with standard deviations and velocity; covariances of two axes are zero."""
    instants = np.datetime_as_string(track.instants("gps"), unit="us").tolist()
    sd = np.where(np.isfinite(track.sd), track.sd, 0.0)
    across = np.hypot(*track.sd[:, :2].T)
    quality = np.select([across < _FIXED_SD, across < _FLOAT_SD], [1, 2], 5).tolist()
    v = track.trajectory.v_n * [1.0, 1.0, -1.0]
    datum = "ellipsoidal" if track.height == "ellipsoidal" else "geodetic"
    lines = [
        f"% program   : insnav, {track.name}",
        "% (lat/lon/height=WGS84/" + datum + ",Q=1:sd < 0.1 m,2:sd < 1 m,5:more,ns=# of satellites, not known)",
        "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  "
        "sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn      sdve      sdvu     sdvne     sdveu     "
        "sdvun",
    ]
    for t, (lat, lon, h), q, s, (vn, ve, vu) in zip(
        instants, track.degrees.tolist(), quality, sd.tolist(), v.tolist(), strict=True
    ):
        day, clock = t.split("T")
        lines.append(
            f"{day.replace('-', '/')} {clock} {lat:14.9f} {lon:14.9f} {h:10.4f} {q:3d}   0 "
            f"{s[0]:8.4f} {s[1]:8.4f} {s[2]:8.4f}   0.0000   0.0000   0.0000   0.00    0.0 "
            f"{vn:10.5f} {ve:10.5f} {vu:10.5f} {s[3]:9.5f} {s[4]:9.5f} {s[5]:9.5f}   0.00000   0.00000   0.00000"
        )
    return "\n".join([*lines, ""])


def nmea(track: Track) -> str:
    """Write GGA, RMC, GST and HDT of each epoch; ellipsoidal heights are written with zero separation."""
    instants = np.datetime_as_string(track.instants("utc"), unit="us").tolist()
    heading = np.degrees(track.trajectory.rph[:, 2]) % 360.0
    lines: list[str] = []
    for t, (lat, lon, h), (vn, ve, _), sd, psi in zip(
        instants,
        track.degrees.tolist(),
        track.trajectory.v_n.tolist(),
        track.sd.tolist(),
        heading.tolist(),
        strict=True,
    ):
        clock = t[11:].replace(":", "")
        date = t[8:10] + t[5:7] + t[2:4]
        place = f"{_minutes(lat, 2)},{'N' if lat >= 0 else 'S'},{_minutes(lon, 3)},{'E' if lon >= 0 else 'W'}"
        course = np.degrees(np.arctan2(ve, vn)) % 360.0
        lines += [
            f"GNRMC,{clock},A,{place},{np.hypot(vn, ve) / _KNOT:.4f},{course:.4f},{date},,,A",
            f"GNGGA,{clock},{place},1,,,{h:.4f},M,{'0.0' if track.height == 'ellipsoidal' else ''},M,,",
        ]
        if np.isfinite(sd[:3]).all():
            lines.append(f"GNGST,{clock},,,,,{sd[0]:.4f},{sd[1]:.4f},{sd[2]:.4f}")
        if np.isfinite(psi):
            lines.append(f"GNHDT,{psi:.4f},T")
    sums = [np.bitwise_xor.reduce(np.frombuffer(plain_text(line).encode("ascii"), dtype=np.uint8)) for line in lines]
    return "".join(f"${line}*{total:02X}\r\n" for line, total in zip(lines, sums, strict=True))


def sbet(track: Track) -> bytes:
    """Write SBET: time, position, velocity, attitude, angle of the level axes, acceleration, angular rate.

    Times are seconds of the GPS week if the date is known. The level axes are North, East, Down: their angle is zero.
    Accelerations and rates are relative to the Earth, in body axes.
    """
    trajectory = track.trajectory
    rate, acceleration = body_motion(trajectory)
    lla = np.column_stack([track.degrees[:, :2] * DEG, trajectory.lla[:, 2]])
    columns = track.of_week, lla, trajectory.v_n, trajectory.rph, np.zeros(len(trajectory.time)), acceleration, rate
    return np.column_stack(columns).astype("<f8").tobytes()


def smrmsg(track: Track) -> bytes:
    """Write the RMS file of an SBET: time, standard deviations of position, velocity, attitude [arcmin]."""
    sd = track.trajectory.sd
    if sd is None:
        raise ConfigError("output.no_sd", where="--to")
    return np.column_stack([track.of_week, sd / ([1.0] * 6 + [DEG / 60.0] * 3)]).astype("<f8").tobytes()


def utm(track: Track) -> str:
    """Write CSV with UTM coordinates in the zone of the middle row, and the grid convergence.

    Raises: ConfigError: beyond 84 deg North or 80 deg South, where UTM ends.
    """
    lla = track.trajectory.lla
    if not (np.abs(lla[:, 0] - 2.0 * DEG) <= 82.0 * DEG).all():
        raise ConfigError("output.beyond_utm", where="--to")
    zone, south = utm_zone(*lla[len(lla) // 2, :2])
    east, north, convergence = transverse_mercator(lla[:, 0], lla[:, 1] - (6.0 * zone - 183.0) * DEG)
    names = {"easting_m": 500e3 + UTM_SCALE * east, "northing_m": 1e7 * south + UTM_SCALE * north}
    grid = {"zone": np.full(len(lla), f"{zone}{'S' if south else 'N'}"), "convergence_deg": convergence / DEG}
    return csv(track, {**names, **grid})


def ecef(track: Track) -> str:
    """Write CSV with Earth-centred, Earth-fixed position and velocity."""
    trajectory = track.trajectory
    v_e = np.einsum("nji,nj->ni", level_from_earth(trajectory.lla), trajectory.v_n)
    columns = np.hstack([earth_from_lla(trajectory.lla), v_e])
    return csv(track, dict(zip(("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"), columns.T, strict=True)))


def csv(track: Track, more: Mapping[str, NDArray[Any]] | None = None) -> str:
    """Write the columns of the solution as CSV, with UTC if known, and the columns `more`."""
    import pandas as pd

    table = pd.DataFrame({**track.trajectory.columns(), **(more or {})})
    if track.utc is not None:
        table["utc"] = [f"{instant}Z" for instant in np.datetime_as_string(track.utc, unit="us")]
    return str(table.to_csv(index=False, float_format="%.15g", lineterminator="\n"))


def _minutes(angle: float, digits: int) -> str:
    """Write degrees and minutes in NMEA format."""
    total = round(abs(angle) * 60.0, 7)
    return f"{int(total // 60):0{digits}d}{total % 60:010.7f}"


def write_kml(folder: Path, solution: Trajectory, name: str) -> Path:
    """Write ``track.kml`` into a folder, see `kml_text`; return its path."""
    path = folder / "track.kml"
    path.write_text(kml_text(solution, name), encoding="utf-8", newline="\n")
    return path


def kml_text(solution: Trajectory, name: str) -> str:
    """Write KML of the track on the ground, thinned to `KML_POINTS` points, with its start and end.

    The height is ellipsoidal, which map programs would take for height above sea level. The track is therefore clamped
    to the ground.
    """
    count = len(solution.time)
    rows = np.unique(np.linspace(0, count - 1, min(count, KML_POINTS)).round().astype(np.int64))
    lat, lon = np.degrees(solution.lla[rows, 0]), np.degrees(solution.lla[rows, 1])
    points = [
        f"{x:.8f},{y:.8f},{z:.3f}"
        for x, y, z in zip((lon + 180.0) % 360.0 - 180.0, lat, solution.lla[rows, 2], strict=True)
    ]
    parts = np.split(np.array(points), np.flatnonzero(np.abs(np.diff(lon)) > 180.0) + 1)  # cut at date line
    lines = "".join(
        f"<LineString><tessellate>1</tessellate><coordinates>{' '.join(part)}</coordinates></LineString>\n"
        for part in parts
        if len(part) > 1
    )
    marks = "".join(
        f"<Placemark><name>{label} {time:.1f} s</name><Point><coordinates>{point}</coordinates></Point></Placemark>\n"
        for label, time, point in (("start", solution.time[0], points[0]), ("end", solution.time[-1], points[-1]))
    )
    title = escape(plain_text(name), quote=False)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{title}</name>\n"
        '<Style id="track"><LineStyle><color>ffb27200</color><width>3</width></LineStyle></Style>\n'
        f"<Placemark><name>{title}</name><styleUrl>#track</styleUrl><MultiGeometry>\n{lines}"
        f"</MultiGeometry></Placemark>\n{marks}</Document></kml>\n"
    )


def tum_files(
    reference: Trajectory, time: FloatArray, errors: Mapping[str, tuple[FloatArray, FloatArray]]
) -> dict[str, str]:
    """Write TUM files of the reference and of each run at their common epochs; return their texts by file name.

    `time` (n,): the epochs [s]. `errors` (n, 3): name of each run, its position errors North, East, Down [m] and
    attitude errors roll, pitch, heading [rad].
    """
    rows = np.searchsorted(reference.time, time)
    lla, rph = reference.lla[rows], reference.rph[rows]
    place, turn = _in_tangent(lla)
    head = _HEAD.format(*lla[0] / _DEGREES)
    files = {"reference.tum": _poses_text(head, time, place, turn, rph)}
    for name, (position, attitude) in errors.items():
        moved = place + (turn @ position[:, :, None])[:, :, 0]
        files[f"{name}.tum"] = _poses_text(head, time, moved, turn, rph + attitude)
    return files


def _in_tangent(lla: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions (n, 3) in the tangent plane (East, North, Up) at the first; rotations to it from local NED."""
    place = np.column_stack(pymap3d.geodetic2enu(*(lla / _DEGREES).T, *lla[0] / _DEGREES))
    local, first = (dcm_from_quat(quat_earth_from_level(positions)) for positions in (lla, lla[:1]))
    return place, np.asarray(_NED_TO_ENU @ np.swapaxes(first, 1, 2) @ local)


def _poses_text(head: str, time: FloatArray, place: FloatArray, turn: FloatArray, rph: FloatArray) -> str:
    q = _attitude(turn, rph)
    lines = (" ".join(map(repr, row)) for row in np.column_stack([time, place, q[:, 1:], q[:, :1]]).tolist())
    return "\n".join([head, *lines]) + "\n"


def _attitude(turn: FloatArray, rph: FloatArray) -> FloatArray:
    """Return quaternions from body axes to the tangent plane, scalar first, (n, 4); NaN for unknown attitude."""
    known = np.isfinite(rph).all(axis=1)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(rph), 1))
    q[known] = quat_multiply(quat_from_dcm(turn[known]), quat_from_rph(rph[known]))
    return q


def tangent_poses(track: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions [m], scalar-first quaternions and velocities [m/s] in the tangent plane at the first epoch."""
    place, turn = _in_tangent(track.lla)
    return place, _attitude(turn, track.rph), np.einsum("nij,nj->ni", turn, track.v_n)


def bag(track: Track) -> bytes:
    """Write a ROS 1 bag; NavSatFix has the heights of the run.

    Raises: ConfigError: the date is unknown, or `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ConfigError("output.no_rosbags", reason=str(error)) from error
    instants = (track.instants("utc") - np.datetime64(0, "ns")).astype(np.int64).tolist()
    place, q, v = tangent_poses(track.trajectory)
    q = quat_multiply(q, _HALF_ROLL)
    level = track.trajectory.v_n[:, [1, 0, 2]] * [1.0, 1.0, -1.0]  # East, North, Up at each epoch, not at the first one
    body = np.einsum("nji,nj->ni", dcm_from_quat(q), v)
    sd = track.sd[:, [1, 0, 2]]  # covariance rows are East, North, Up
    known = np.asarray(np.isfinite(sd).all(axis=1))
    variance = np.where(known[:, None], sd, 0.0) ** 2
    store = get_typestore(Stores.ROS1_NOETIC)
    with tempfile.TemporaryDirectory(prefix="insnav-") as folder:
        path = Path(folder) / "track.bag"
        with Writer(path) as writer:
            to = {kind: writer.add_connection(topic, kind, typestore=store) for kind, topic in _TOPICS.items()}
            for i, (ns, lla) in enumerate(zip(instants, track.degrees.tolist(), strict=True)):
                head = struct.pack("<III", i, *divmod(ns, 10**9))
                covariance = np.diag(variance[i])
                fix = struct.pack("<bH12dB", 0, 1, *lla, *covariance.ravel(), 2 if known[i] else 0)
                twist, pose = np.zeros((6, 6)), np.zeros((6, 6))
                pose[:3, :3] = covariance
                odometry = (*place[i], *q[i, [1, 2, 3, 0]], *pose.ravel(), *body[i], 0.0, 0.0, 0.0, *twist.ravel())
                writer.write(to[_FIX], ns, head + _string("gps") + fix)
                writer.write(to[_TWIST], ns, head + _string("enu") + struct.pack("<6d", *level[i], 0.0, 0.0, 0.0))
                writer.write(
                    to[_ODOMETRY], ns, head + _string("enu") + _string("base_link") + struct.pack("<85d", *odometry)
                )
        return path.read_bytes()


def _string(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


WRITERS: dict[str, Callable[[Track], str | bytes]] = {
    writer.__name__: writer for writer in (gpx, kml, geojson, tum, euroc, pos, nmea, sbet, smrmsg, bag, csv, utm, ecef)
}
