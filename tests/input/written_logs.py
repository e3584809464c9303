"""Logs of one known motion, written byte by byte as the specification of each format says."""

from __future__ import annotations

import binascii
import json
import struct
import zlib

import numpy as np

from tests.input.recordings import FIXES, SAMPLES, TOW, UNIX, WEEK, Motion

BOOT = 1000.0  # time of the start on the clock of a controller [s]


def ulog(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """PX4 User Guide, "ULog file format": header, formats, subscriptions, data."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    formats = [
        b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        b"int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;",
        b"vehicle_gps_position:uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;int32_t alt_ellipsoid;"
        b"float s_variance_m_s;float eph;float epv;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;"
        b"bool vel_ned_valid;uint8_t[2] _padding0;",
    ]
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    data += b"".join(message(b"F", each) for each in formats)
    data += message(b"A", b"\0" + struct.pack("<H", 0) + b"sensor_combined")
    data += message(b"A", b"\0" + struct.pack("<H", 1) + b"vehicle_gps_position")
    parts = []
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        body = struct.pack("<HQ3fIi3fI", 0, round((BOOT + t) * 1e6), *w, 10_000, 0, *f, 10_000)
        parts.append((t, message(b"D", body)))
    for t, lla, v in zip(fixes.t, fixes.lla, fixes.v_n, strict=True):
        place = (round(lla[0] * 1e7), round(lla[1] * 1e7), round((lla[2] - 30.0) * 1e3), round(lla[2] * 1e3))
        body = struct.pack("<HQ4i6fBB", 1, round((BOOT + t) * 1e6), *place, 0.2, 0.3, 0.5, *v, 6, 1)
        parts.append((t, message(b"D", body)))
    return data + b"".join(part for _, part in sorted(parts))


_DATAFLASH = (
    (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    (130, "GPS", "QBBIHBcLLefffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,U"),
    (131, "GPA", "QBCCCC", "TimeUS,I,VDop,HAcc,VAcc,SAcc"),
    (132, "IMU", "QBffffffB", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GH"),
    (133, "MSG", "QZ", "TimeUS,Message"),
)
_SIZES = dict(zip("bBMhHiIfdqQcCeELnNZ", (1, 1, 1, 2, 2, 4, 4, 4, 8, 8, 8, 2, 2, 4, 4, 4, 4, 16, 64), strict=True))


def _dataflash_rows(motion: Motion, fixes: Motion):
    parts = []
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        for number, more in ((0, 0.0), (1, 0.5)):
            parts.append((t, "IMU", (round((BOOT + t) * 1e6), number, *w, *(f + more), 1)))
    for t, lla, v in zip(fixes.t, fixes.lla, fixes.v_n, strict=True):
        course, speed = np.degrees(np.arctan2(v[1], v[0])) % 360.0, np.hypot(*v[:2])
        stamp = round((BOOT + t) * 1e6)
        gps = (stamp, 0, 6, round((TOW + t) * 1e3), WEEK, 20, 0.7, lla[0], lla[1], lla[2], speed, course, v[2], 1)
        parts += [(t, "GPS", gps), (t, "GPA", (stamp, 0, 1.2, 0.3, 0.5, 0.2))]
    return sorted(parts, key=lambda part: part[0])


def dataflash(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """ArduPilot, AP_Logger/README.md: binary."""
    kinds = {name: (number, letters) for number, name, letters, _ in _DATAFLASH}
    scale = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 1e7}
    pack = {"M": "B", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "n": "4s", "N": "16s", "Z": "64s"}

    def message(name: str, values: tuple) -> bytes:
        number, letters = kinds[name]
        values = tuple(round(v * scale[k]) if k in scale else v for k, v in zip(letters, values, strict=True))
        return b"\xa3\x95" + struct.pack("<B" + "".join(pack.get(k, k) for k in letters), number, *values)

    data = b""
    for number, name, letters, columns in _DATAFLASH:
        size = 3 + sum(_SIZES[each] for each in letters)
        data += message("FMT", (number, size, name.encode(), letters.encode(), columns.encode()))
    data += message("MSG", (1, b"hello"))
    return data + b"".join(message(name, values) for _, name, values in _dataflash_rows(motion, fixes))


def dataflash_text(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """The same, as ground stations write it."""
    lines = []
    for number, name, letters, columns in _DATAFLASH:
        size = 3 + sum(_SIZES[each] for each in letters)
        lines.append(f"FMT, {number}, {size}, {name}, {letters}, {columns}")
    lines += [
        ", ".join([name, *(f"{v!r}" for v in map(float, values))]) for _, name, values in _dataflash_rows(motion, fixes)
    ]
    return "\n".join([*lines, ""]).encode()


def _crc32(data: bytes) -> int:
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _novatel(number: int, t: float, body: bytes, *, short: bool = False) -> bytes:
    ms = round((TOW + t) * 1e3)
    if short:
        head = b"\xaa\x44\x13" + struct.pack("<BHHI", len(body), number, WEEK, ms)
    else:
        head = b"\xaa\x44\x12\x1c" + struct.pack(
            "<HBBHHBBHIIHH", number, 0, 32, len(body), 0, 0, 180, WEEK, ms, 0, 0, 1
        )
    return head + body + struct.pack("<I", _crc32(head + body))


STIM300 = np.radians(2.0**-21), 2.0**-22  # scales of increments [rad], [m/s], OM-20000169
IMU_CPT = 0.1 / (3600.0 * 256.0), 0.05 / 2.0**15


def novatel(
    motion: Motion = SAMPLES,
    fixes: Motion = FIXES,
    *,
    imu_type: int = 32,
    typed: bool = True,
    scales: tuple[float, float] = STIM300,
) -> bytes:
    """OM-20000169: BESTPOS, BESTVEL, INSPVAS, and RAWIMUSX of a STIM300, whose axes are Right, Forward, Up.

    `typed`: else RAWIMUS, which does not say of which IMU it is. `scales`: of increments of angle and velocity.
    """
    parts = [(-1.0, b"<OK\r\n[COM1]")]
    for t, lla, v, heading in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True):
        body = struct.pack("<IIddd", 0, 50, lla[0], lla[1], lla[2] - 30.0)
        body += struct.pack("<fI3f4sff4B4B", 30.0, 61, 0.1, 0.2, 0.3, b"AAAA", 1.0, 0.0, *bytes(8))
        parts.append((t, _novatel(42, t, body)))
        course, speed = np.degrees(np.arctan2(v[1], v[0])) % 360.0, np.hypot(*v[:2])
        parts.append((t, _novatel(99, t, struct.pack("<IIffdddf", 0, 50, 0.0, 0.0, speed, course, -v[2], 0.0))))
        body = struct.pack("<Id3d3d3dI", WEEK, TOW + t, *lla, v[0], v[1], -v[2], 0.5, -1.0, heading, 3)
        parts.append((t, _novatel(508, t, body, short=True)))
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        (wx, wy, wz), (fx, fy, fz) = (each[[1, 0, 2]] * [1, 1, -1] * 0.01 for each in (w, f))
        gyro, accel = scales
        counts = [round(x) for x in (fz / accel, -fy / accel, fx / accel, wz / gyro, -wy / gyro, wx / gyro)]
        head = struct.pack("<BBHd", 0, imu_type, WEEK, TOW + t) if typed else struct.pack("<Id", WEEK, TOW + t)
        parts.append((t, _novatel(1462 if typed else 325, t, head + struct.pack("<I6i", 0, *counts), short=True)))
    return b"".join(part for _, part in sorted(parts))


def novatel_ascii(fixes: Motion = FIXES, motion: Motion | None = None, kind: str = "NARROW_INT") -> bytes:
    """The same as text: BESTPOSA and BESTVELA, and RAWIMUSA if there are samples."""
    lines = []
    for t, w, f in zip(*((motion.t, motion.gyro, motion.accel) if motion else ((), (), ())), strict=True):
        (wx, wy, wz), (fx, fy, fz) = (each[[1, 0, 2]] * [1, 1, -1] * 0.01 for each in (w, f))
        gyro, accel = STIM300
        counts = [round(x) for x in (fz / accel, -fy / accel, fx / accel, wz / gyro, -wy / gyro, wx / gyro)]
        when = f"{WEEK},{TOW + t:.3f}"
        body = f"RAWIMUSA,{when};{WEEK},{TOW + t:.9f},000d0077,{','.join(map(str, counts))}"
        lines.append(f"%{body}*{_crc32(body.encode()):08x}\r\n")
    for t, lla, v in zip(fixes.t, fixes.lla, fixes.v_n, strict=True):
        head = f"COM1,0,60.0,FINESTEERING,{WEEK},{TOW + t:.3f},02000000,cdba,16248"
        place = f"SOL_COMPUTED,{kind},{lla[0]:.11f},{lla[1]:.11f},{lla[2] - 30.0:.4f},30.0000,WGS84,0.1,0.2,0.3"
        course, speed = np.degrees(np.arctan2(v[1], v[0])) % 360.0, np.hypot(*v[:2])
        for name, text in (
            ("BESTPOSA", f'{place},"AAAA",1.000,0.000,30,28,28,28,00,06,39,33'),
            ("BESTVELA", f"SOL_COMPUTED,NARROW_INT,0.000,0.000,{speed:.6f},{course:.6f},{-v[2]:.6f},0.0"),
        ):
            body = f"{name},{head};{text}"
            lines.append(f"#{body}*{_crc32(body.encode()):08x}\r\n")
    return "".join(lines).encode()


def sbf(motion: Motion = SAMPLES, fixes: Motion = FIXES, *, cartesian: bool = False) -> bytes:
    """mosaic-X5 Reference Guide: PVTGeodetic with covariances, or PVTCartesian; ExtSensorMeas, Forward, Left, Up."""
    import pymap3d

    def block(number: int, t: float, body: bytes) -> bytes:
        body = struct.pack("<IH", round((TOW + t) * 1e3), WEEK) + body
        body += bytes(-(8 + len(body)) % 4)
        rest = struct.pack("<HH", number, 8 + len(body)) + body
        return b"$@" + struct.pack("<H", binascii.crc_hqx(rest, 0)) + rest

    parts = []
    tail = struct.pack("<dfBBBBHHIBBHHHB", 0.0, 0.0, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    for t, lla, v in zip(fixes.t, fixes.lla, fixes.v_n, strict=True):
        if cartesian:
            r = pymap3d.geodetic2ecef(*lla)
            ve = pymap3d.enu2uvw(v[1], v[0], -v[2], lla[0], lla[1])
            parts.append((t, block(4006, t, struct.pack("<BB3d5f", 4, 0, *r, 30.0, *ve, 0.0) + tail)))
            isotropic = (0.04, 0.04, 0.04, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            parts.append((t, block(5905, t, struct.pack("<BB10f", 4, 0, *isotropic))))
        else:
            place = (np.radians(lla[0]), np.radians(lla[1]), lla[2])
            body = struct.pack("<BB3d5f", 4, 0, *place, 30.0, v[0], v[1], -v[2], -2e10) + tail
            parts.append((t, block(4007, t, body)))
            for number, sizes in ((5906, (0.01, 0.04, 0.09)), (5908, (1e-4, 4e-4, 9e-4))):
                parts.append((t, block(number, t, struct.pack("<BB10f", 4, 0, *sizes, 1.0, *[0.0] * 6))))
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        flip = np.array([1.0, -1.0, -1.0])
        sensors = struct.pack("<4B3d", 0, 0, 0, 0, *(f * flip)) + struct.pack(
            "<4B3d", 0, 0, 1, 0, *np.degrees(w * flip)
        )
        parts.append((t, block(4050, t, struct.pack("<BB", 2, 28) + sensors)))
    return b"".join(part for _, part in sorted(parts))


def gpx(fixes: Motion = FIXES, zone: str = "Z") -> bytes:
    """GPX 1.1, all in one line."""
    ahead = {"Z": 0, "+02:00": 7200}[zone]
    points = []
    for t, lla in zip(fixes.t, fixes.lla, strict=True):
        instant = np.datetime64(round((UNIX + t + ahead) * 1e3), "ms")
        place = f'<trkpt lat="{lla[0]:.9f}" lon="{lla[1]:.9f}"><ele>{lla[2]:.3f}</ele>'
        points.append(f"{place}<time>{instant}{zone}</time></trkpt>")
    head = '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><metadata><time>'
    head += '2020-01-01T00:00:00Z</time></metadata><trk><trkseg><trkpt lat="1" lon="2"/>'
    return (head + "".join(points) + "</trkseg></trk></gpx>").encode()


def gnss_logger(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """GnssLogger 3.0, phone on its back, top ahead: Right, Forward, Up."""
    head = "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
    head += "UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters,"
    head += "MockLocation"
    parts = []
    for t, lla, v, heading in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True):
        place = f"GPS,{lla[0]:.9f},{lla[1]:.9f},{lla[2]:.4f},{np.hypot(*v[:2]):.6f},3.0,{heading:.4f}"
        parts.append((t, f"Fix,{place},{round((UNIX + t) * 1e3)},0.3,5.0,1,6.0,0"))
        parts.append((t, f"Fix,NLP,{lla[0] + 0.01:.9f},{lla[1]:.9f},,0.0,500.0,,{round((UNIX + t) * 1e3)},,,1,,0"))
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        for kind, each in (("Accel", f), ("Gyro", w)):
            x, y, z = each[[1, 0, 2]] * [1, 1, -1]
            parts.append((t, f"Uncal{kind},{round((UNIX + t) * 1e3)},1,{x},{y},{z},0,0,0,3"))
    lines = ["# Header Description:", "# Version: v3.0.6.4", head]
    for kind, unit in (("Accel", "Mps2"), ("Gyro", "RadPerSec")):
        axes = ",".join(f"Uncal{kind}{axis}{unit}" for axis in "XYZ")
        lines.append(f"# Uncal{kind},utcTimeMillis,elapsedRealtimeNanos,{axes},BiasX,BiasY,BiasZ,Accuracy")
    return "\n".join([*lines, *(part for _, part in sorted(parts)), ""]).encode()


def inertial_explorer(fixes: Motion = FIXES, *, kind: str = "blanks", attitude: bool = True) -> bytes:
    """OM-20000166, appendix B: a header of free text, names, units, rows, a footer; kind: blanks, commas, dms, utc."""
    head = "\nProject:     drive\nProgram:     Inertial Explorer Version 8.70.5101\nProfile:     own\n"
    head += "IMU to GNSS Antenna Lever Arms:\n             x=-0.275, y=-0.055, z=0.144 m (x-right, y-fwd, z-up)\n\n"
    angle = "(+/-D M S)" if kind == "dms" else "(deg)"
    columns = [("Week", "(weeks)"), ("UTCTime" if kind == "utc" else "GPSTime", "(sec)"), ("Q", "")]
    columns += [("Latitude", angle), ("Longitude", angle), ("H-Ell", "(m)")]
    columns += [(each, "(m/s)") for each in ("VEast", "VNorth", "VUp")]
    columns += [(each, "(m)") for each in ("SDEast", "SDNorth", "SDHeight")]
    columns += [(each, "(deg)") for each in ("Heading", "Pitch", "Roll")] * attitude
    between = " , " if kind == "commas" else "  "
    lines = [between.join(f"{name:>12}" for name, _ in columns), "  ".join(f"{unit:>12}" for _, unit in columns)]
    for t, lla, v, heading in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True):
        place = [f"{each:.10f}" for each in lla[:2]]
        if kind == "dms":
            parts = [(abs(each), "-" if each < 0 else "") for each in lla[:2]]
            place = [f"{sign}{int(each)} {int(each * 60 % 60):02d} {each * 3600 % 60:08.5f}" for each, sign in parts]
        second = TOW + t - 18.0 * (kind == "utc")
        cells = [str(WEEK), f"{second:.3f}", "1", *place, f"{lla[2]:.4f}", f"{v[1]:.6f}", f"{v[0]:.6f}", f"{-v[2]:.6f}"]
        cells += ["0.2", "0.1", "0.3"] + [f"{(heading + 180.0) % 360.0 - 180.0:.9f}", "-1.0", "0.5"] * attitude
        lines.append(between.join(cells))
    return (head + "\n".join([*lines, "", "Footer: the end", ""])).encode()


def vbox(fixes: Motion = FIXES) -> bytes:
    """Racelogic, "VBO file format": sections, UTC, minutes north and west, km/h, metres above sea level."""
    head = "File created on 27/08/2025 at 12:00:05\r\n\r\n[header]\r\nsatellites\r\ntime\r\nlatitude\r\nlongitude\r\n"
    head += "velocity kmh\r\nheading\r\nheight\r\nvertical velocity m/s\r\n\r\n[channel units]\r\n\r\n[comments]\r\n"
    head += "(c) 2001 2003 Racelogic\r\nLog Rate (Hz) : 05.00\r\n\r\n[column names]\r\n"
    rows = [head + "sats time lat long velocity heading height vert-vel ", "", "[data]"]
    for t, lla, v, heading in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True):
        second = TOW % 86400.0 - 18.0 + t
        clock = f"{second // 3600:02.0f}{second % 3600 // 60:02.0f}{second % 60:06.3f}"
        place = f"{60 * lla[0]:+014.8f} {-60 * lla[1]:+014.8f}"
        speed = f"{3.6 * np.hypot(*v[:2]):07.3f} {heading:06.2f} {lla[2]:+09.2f} {-v[2]:+08.3f}"
        rows.append(f"{9 + 128:03d} {clock} {place} {speed}")
    return "\r\n".join([*rows, ""]).encode()


def openpilot(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """comma.ai, ``log.capnp`` as one JSON object a line: times since the start of the device in nanoseconds."""
    parts = []
    for t, w, f in zip(motion.t, motion.gyro, motion.accel, strict=True):
        now = round((BOOT + t) * 1e9)
        for kind, name, value in (("accelerometer", "acceleration", f), ("gyroscope", "gyroUncalibrated", w)):
            event = {"version": 1, "sensor": 1, "type": 1, "timestamp": now - 900, name: {"v": [*value], "status": 3}}
            parts.append((t, {"logMonoTime": now, "valid": True, kind: event}))
    for t, lla, v, heading in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True):
        fix = {"flags": 1, "latitude": lla[0], "longitude": lla[1], "altitude": lla[2], "speed": np.hypot(*v[:2])}
        fix |= {"bearingDeg": heading, "horizontalAccuracy": 1.0, "verticalAccuracy": 2.0, "speedAccuracy": 0.2}
        fix |= {"unixTimestampMillis": round((UNIX + t) * 1e3), "vNED": [*v]}
        parts.append((t, {"logMonoTime": round((BOOT + t) * 1e9), "valid": True, "gpsLocationExternal": fix}))
    parts.append((-1.0, {"logMonoTime": 1, "valid": True, "carState": {"vEgo": 3.0}}))
    return "".join(json.dumps(each) + "\n" for _, each in sorted(parts, key=lambda part: part[0])).encode()


def bdd100k(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> bytes:
    """BDD100K, "info": one document with arrays of records, in milliseconds since 1970 and g."""
    found: dict[str, object] = {"rideID": "a-b", "startTime": round(UNIX * 1e3), "timelapse": False}
    for name, times, rows in (("accelerometer", motion.t, motion.accel / 9.80665), ("gyro", motion.t, motion.gyro)):
        stamped = zip(times, rows, strict=True)
        found[name] = [
            {"timestamp": round((UNIX + t) * 1e3), **dict(zip("xyz", row, strict=True))} for t, row in stamped
        ]
    found["locations"] = [
        {"timestamp": round((UNIX + t) * 1e3), "latitude": a, "longitude": b, "speed": np.hypot(*v[:2]), "course": c}
        for t, (a, b, _), v, c in zip(fixes.t, fixes.lla, fixes.v_n, fixes.heading, strict=True)
    ]
    return json.dumps(found).encode()
