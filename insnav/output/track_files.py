"""A trajectory in the formats of other programs: GPX, KML, GeoJSON, TUM, EuRoC, RTKLIB .pos, NMEA, ROS bag, CSV.

Times are what the format wants: UTC in GPX, GeoJSON, NMEA, bags and CSV, GPS time in .pos, nanoseconds in EuRoC.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from html import escape

import numpy as np

from insnav.output.kml import kml_text
from insnav.output.ros import bag
from insnav.output.track import Track
from insnav.output.tum import tangent_poses, tum_files
from insnav.plain_text import plain_text

_KNOT = 1852.0 / 3600.0
_FIXED_SD, _FLOAT_SD = 0.1, 1.0  # horizontal deviations up to which a .pos row is of quality 1, 2; else 5 [m]


def gpx(track: Track) -> str:
    """GPX 1.1; its elevations are the heights of the run."""
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
    """KML, as beside a run."""
    return kml_text(track.trajectory, track.name)


def geojson(track: Track) -> str:
    """GeoJSON (RFC 7946): a line, cut at the date line, with the times of its points."""
    place = track.degrees
    cuts = np.flatnonzero(np.abs(np.diff(place[:, 1])) > 180.0) + 1
    lines = [
        [[round(lon, 9), round(lat, 9), round(h, 3)] for lat, lon, h in part.tolist()]
        for part in np.split(place, cuts)
        if len(part) > 1
    ]
    times = [f"{t}Z" for t in np.datetime_as_string(track.utc, unit="us")] if track.utc is not None else None
    feature = {
        "type": "Feature",
        "properties": {"name": track.name, "heights": track.height, "time_s": track.trajectory.time.tolist()}
        | ({"times": times} if times else {}),
        "geometry": {"type": "MultiLineString", "coordinates": lines},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}, allow_nan=False) + "\n"


def tum(track: Track) -> str:
    """TUM, see `insnav.output.tum`."""
    return tum_files(track.trajectory, track.trajectory.time, {})["reference.tum"]


def euroc(track: Track) -> str:
    """EuRoC ground truth: nanoseconds, East, North, Up from the first epoch, attitude of Forward-Right-Down axes."""
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
    """RTKLIB solution in GPS time, with standard deviations and velocity; cross terms are not kept: zero."""
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
    """GGA, RMC, GST and HDT of each epoch; an ellipsoidal height is written as altitude with a separation of zero."""
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
    return "".join(f"${line}*{_checksum(line):02X}\r\n" for line in lines)


def csv(track: Track) -> str:
    """Columns of the solution, and UTC if it is known."""
    columns = {key: np.asarray(column) for key, column in track.trajectory.columns().items()}
    utc = np.datetime_as_string(track.utc, unit="us") if track.utc is not None else None
    lines = [",".join([*columns, *(["utc"] if utc is not None else [])])]
    for i, row in enumerate(np.column_stack([*columns.values()]).tolist()):
        cells = ["" if x != x else f"{x:.15g}" for x in row]
        lines.append(",".join(cells + ([f"{utc[i]}Z"] if utc is not None else [])))
    return "\n".join([*lines, ""])


WRITERS: dict[str, Callable[[Track], str | bytes]] = {
    each.__name__: each for each in (gpx, kml, geojson, tum, euroc, pos, nmea, bag, csv)
}


def _minutes(angle: float, digits: int) -> str:
    """Degrees and minutes, as NMEA has them."""
    total = round(abs(angle) * 60.0, 7)
    return f"{int(total // 60):0{digits}d}{total % 60:010.7f}"


def _checksum(text: str) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(plain_text(text).encode("ascii"), dtype=np.uint8)))
