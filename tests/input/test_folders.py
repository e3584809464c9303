"""Folders and archives of recordings: KITTI oxts, EuRoC, phones; written here by their descriptions, and real ones."""

from __future__ import annotations

import io
import shutil
import zipfile

import numpy as np
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.input import read_gps, read_imu, read_reference
from insnav.input.formats.registry import open_tables
from tests.input.files import G
from tests.input.recordings import FIXES, REAL, SAMPLES, UNIX, Motion, real, same_places
from tests.refusals import refused

FLU = np.array([1.0, -1.0, -1.0])


def kitti(motion: Motion = SAMPLES) -> dict[str, bytes]:
    """Files of an oxts folder by dataformat.txt: Forward-Left-Up, yaw from East counter-clockwise."""
    files, stamps = {}, []
    for i in range(0, len(motion.t), 10):
        yaw = np.radians(90.0 - motion.heading[i])
        v, w, f = motion.v_n[i], motion.gyro[i] * FLU, motion.accel[i] * FLU
        ahead = np.hypot(*v[:2])
        numbers = [*motion.lla[i], 0.01, 0.02, yaw, v[0], v[1], ahead, 0.0, -v[2], *f, *f, *w, *w, 0.05, 0.02]
        files[f"oxts/data/{i // 10:010d}.txt"] = (" ".join(map(repr, map(float, numbers))) + " 4 9 6 6 6\n").encode()
        instant = np.datetime64("2011-09-26T13:02:44") + np.timedelta64(round(motion.t[i] * 1e9), "ns")
        stamps.append(str(instant).replace("T", " "))
    files["oxts/timestamps.txt"] = ("\n".join(stamps) + "\n").encode()
    files["velodyne_points/timestamps.txt"] = b"2011-09-26 13:02:44.0\n"
    files["velodyne_points/data/0000000000.txt"] = b"1 2 3\n"
    return files


def _csv(header: str, *columns: np.ndarray) -> bytes:
    rows = [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    return "\n".join([header, *rows, ""]).encode()


def phyphox(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> dict[str, bytes]:
    """Files of a phyphox export of a phone on its back, top ahead: Right, Forward, Up; sensors at their own times."""
    axes = '"Time (s)","X ({0})","Y ({0})","Z ({0})"'
    f, w = motion.accel[:, [1, 0, 2]] * [1, 1, -1], motion.gyro[:, [1, 0, 2]] * [1, 1, -1]
    speed = np.hypot(*fixes.v_n[:, :2].T)
    head = '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Velocity (m/s)","Direction (°)"'
    head += ',"Horizontal Accuracy (m)","Vertical Accuracy (°)"'
    accuracy = np.full(len(speed), 3.0)
    return {
        "Accelerometer.csv": _csv(axes.format("m/s^2"), motion.t + 0.004, f),
        "Gyroscope.csv": _csv(axes.format("rad/s"), motion.t, w),
        "Location.csv": _csv(head, fixes.t, fixes.lla, speed, fixes.heading, accuracy, 2.0 * accuracy),
        "meta/device.csv": b"property,value\n",
    }


def sensor_logger(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> dict[str, bytes]:
    """Files of a Sensor Logger export; times are Unix time in nanoseconds."""

    def ns(t: np.ndarray) -> list[int]:
        return [round((UNIX + each) * 1e9) for each in t]

    def triad(motion: Motion, v: np.ndarray) -> bytes:
        rows = zip(ns(motion.t), motion.t.tolist(), *v[:, ::-1].T.tolist(), strict=True)
        return "\n".join(["time,seconds_elapsed,z,y,x", *(",".join(map(str, row)) for row in rows), ""]).encode()

    f, w = motion.accel[:, [1, 0, 2]] * [1, 1, -1], motion.gyro[:, [1, 0, 2]] * [1, 1, -1]
    gravity = np.tile([0.0, 0.0, G], (len(f), 1))
    head = "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,"
    head += "altitude,longitude,latitude"
    n, speed = len(fixes.t), np.hypot(*fixes.v_n[:, :2].T)
    columns = [np.full(n, 5.0), np.full(n, 0.3), np.full(n, 6.0), np.full(n, 3.0), speed, fixes.heading]
    rows = zip(ns(fixes.t), fixes.t.tolist(), *(c.tolist() for c in (*columns, *fixes.lla.T[::-1])), strict=True)
    return {
        "TotalAcceleration.csv": triad(motion, f),
        "Accelerometer.csv": triad(motion, f - gravity),
        "Gravity.csv": triad(motion, gravity),
        "Gyroscope.csv": triad(motion, w),
        "Location.csv": "\n".join([head, *(",".join(map(str, row)) for row in rows), ""]).encode(),
        "Metadata.csv": b"version,device\n1,phone\n",
    }


def as_zip(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            archive.writestr(f"drive/{name}", data)
    return buffer.getvalue()


@pytest.fixture(params=["folder", "zip"])
def save(request, tmp_path):
    def write(files: dict[str, bytes]):
        place = tmp_path / "recording"
        if request.param == "zip":
            place.write_bytes(as_zip(files))
            return place
        for name, data in files.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(data)
        return place

    return write


def test_kitti(save):
    path = save(kitti())
    every = Motion(SAMPLES.t[::10])
    imu, gps, reference = read_imu(path), read_gps(path), read_reference(path)
    assert imu.facts.axes == "FLU"
    assert np.allclose(imu.data.accel, every.accel)
    assert np.allclose(imu.data.gyro, every.gyro)
    assert same_places(gps.data, every, 1e-4)
    assert np.allclose(gps.data.v_n, every.v_n)
    assert np.allclose(gps.data.position_sd, [0.05, 0.05, 0.1])
    assert gps.facts.height == "msl"
    rph = np.degrees(reference.data.rph)
    assert np.allclose(rph[:, :2], np.degrees([0.01, -0.02]))
    assert np.allclose((rph[:, 2] - every.heading + 180.0) % 360.0, 180.0)


def test_kitti_that_does_not_fit_together_is_refused(save):
    files = kitti()
    files["oxts/timestamps.txt"] = files["oxts/timestamps.txt"].split(b"\n", 1)[1]
    with refused(InputError, "format.kitti_count") as caught:
        read_gps(save(files))
    assert caught.value.values == {"times": 81, "epochs": 82}


def test_an_epoch_that_is_cut_is_named(save):
    files = kitti()
    files["oxts/data/0000000007.txt"] = files["oxts/data/0000000007.txt"][:99]
    with refused(InputError, "format.kitti_epoch") as caught:
        read_gps(save(files))
    assert "0000000007.txt" in caught.value.where


def test_euroc(save):
    header = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    header += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    rows = [
        ",".join(map(str, [round((UNIX + t) * 1e9), *w, *f]))
        for t, w, f in zip(SAMPLES.t, SAMPLES.gyro.tolist(), SAMPLES.accel.tolist(), strict=True)
    ]
    data = read_imu(save({"mav0/imu0/data.csv": "\n".join([header, *rows]).encode(), "mav0/body.yaml": b"x"})).data
    assert np.allclose(data.time, UNIX + SAMPLES.t, atol=1e-6)
    assert np.allclose(data.accel, SAMPLES.accel)
    assert np.allclose(data.gyro, SAMPLES.gyro)


@pytest.mark.parametrize("export", [phyphox, sensor_logger])
def test_phones(save, export):
    path = save(export())
    start = UNIX if export is sensor_logger else 0.0
    imu, gps = read_imu(path), read_gps(path)
    assert imu.facts.axes == "RFU"
    assert np.allclose(imu.data.accel, [0.0, 2.5, -G], atol=1e-9)
    assert np.allclose(imu.data.gyro, [0.0, 0.0, 0.25], atol=1e-12)
    assert abs(gps.data.time[0] - start) < 1e-6
    assert same_places(gps.data)
    side = 3.0 / np.sqrt(-2.0 * np.log(0.32))
    assert np.allclose(gps.data.position_sd, [side, side, 6.0])


def test_gravity_that_the_phone_has_taken_off_is_added_again_or_refused_by_name(save):
    files = sensor_logger()
    del files["TotalAcceleration.csv"]
    both = save(files)
    assert np.allclose(read_imu(both).data.accel, [0.0, 2.5, -G], atol=1e-9)
    del files["Gravity.csv"]
    shutil.rmtree(both) if both.is_dir() else both.unlink()
    with refused(InputError, "format.phone_no_gravity"):
        open_tables(save(files))
    linear = phyphox()
    linear["Linear Accelerometer.csv"] = linear.pop("Accelerometer.csv")
    shutil.rmtree(both) if both.is_dir() else both.unlink()
    with refused(InputError, "format.phone_no_gravity"):
        open_tables(save(linear))


def gopro(motion: Motion = SAMPLES, fixes: Motion = FIXES, axes: str = " (z,x,y)") -> dict[str, bytes]:
    """Tables of GoPro telemetry: Right, Forward, Up as z, x, y; milliseconds of the video, and dates."""
    f, w = motion.accel[:, [2, 1, 0]] * [-1, 1, 1], motion.gyro[:, [2, 1, 0]] * [-1, 1, 1]

    def rows(head: str, t: np.ndarray, values: np.ndarray) -> bytes:
        start = np.datetime64("2024-01-01T10:00:00.000")
        lines = [
            ",".join(
                [repr(1e3 * float(t)), f"{start + np.timedelta64(round(1e3 * float(t)), 'ms')}Z", *map(repr, each)]
            )
            for t, each in zip(t, values.tolist(), strict=True)
        ]
        return "\n".join([f"cts,date,{head}", *lines, ""]).encode()

    place = rows("GPS (Lat.) [deg],GPS (Long.) [deg],GPS (Alt.) [m]", fixes.t, fixes.lla)
    sensors = {"ACCL": ("Accelerometer", "m/s2", f), "GYRO": ("Gyroscope", "rad/s", w)}
    tables = {
        f"video-{short}.csv": rows(f'"{long}{axes} [{unit}]",1,2', motion.t, values)
        for short, (long, unit, values) in sensors.items()
    }
    return {"video-GPS5.csv": place, **tables}


def simulator(motion: Motion = SAMPLES, fixes: Motion = FIXES) -> dict[str, bytes]:
    """Folder of gnss-ins-sim: a file for each quantity, times in files of their own."""

    def named(words: str) -> str:
        name, axes, unit = words.split(":")
        return ",".join(f"{name}_{axis} ({unit})" for axis in axes.split())

    v = fixes.v_n
    return {
        "time.csv": _csv("time (sec)", motion.t),
        "gyro-0.csv": _csv(named("gyro:x y z:deg/s"), np.degrees(motion.gyro)),
        "accel-0.csv": _csv(named("accel:x y z:m/s^2"), motion.accel),
        "ref_accel.csv": _csv(named("ref_accel:x y z:m/s^2"), 0.0 * motion.accel),
        "gps_time.csv": _csv("gps_time (sec)", fixes.t),
        "gps-0.csv": _csv(
            "gps_lat (deg),gps_lon (deg),gps_alt (m),gps_vN (m/s),gps_vE (m/s),gps_vD (m/s)", fixes.lla, v
        ),
        "ref_pos.csv": _csv("ref_pos_lat (deg),ref_pos_lon (deg),ref_pos_alt (m)", motion.lla),
    }


@pytest.mark.parametrize("axes", [" (z,x,y)", ""])
def test_tables_of_a_camera(save, axes):
    path = save(gopro(axes=axes))
    mounting = "RFU" if axes else "URF"
    imu, gps = read_imu(path, axes=mounting), read_gps(path)
    assert np.allclose(imu.data.accel, [0.0, 2.5, -G], atol=1e-9)
    assert np.allclose(imu.data.gyro, [0.0, 0.0, 0.25], atol=1e-12)
    assert np.allclose(imu.data.time, SAMPLES.t)
    assert same_places(gps.data)


def test_a_folder_of_a_simulator(save):
    path = save(simulator())
    imu, gps, reference = read_imu(path), read_gps(path), read_reference(path)
    assert np.allclose(imu.data.time, SAMPLES.t)
    assert np.allclose(imu.data.accel, SAMPLES.accel)
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert same_places(gps.data)
    assert np.allclose(gps.data.v_n, FIXES.v_n)
    assert np.allclose(reference.data.time, SAMPLES.t)
    files = simulator()
    files["time.csv"] = files["time.csv"].rsplit(b"\n", 2)[0]
    with refused(InputError, "format.phone_no_time"):
        read_imu(save({f"other/{name}": data for name, data in files.items()}))


@pytest.mark.parametrize("files", [kitti(), phyphox(), sensor_logger(), gopro(), simulator()])
def test_a_folder_needs_no_option(save, files):
    drive = insnav.load(save(files))
    assert drive.gps is not None
    assert drive.imu.facts.n_gaps == 0


@real
def test_real_kitti():
    data = read_gps(REAL / "kitti" / "2011_09_26_drive_0002_oxts").data
    assert len(data.time) == 77
    assert np.allclose(np.degrees(data.lla[0, :2]), (49.0145, 8.4324), atol=1e-4)
    moved = np.diff(data.lla[:, :2], axis=0) * [6.367e6, 6.367e6 * np.cos(data.lla[0, 0])]
    mean = 0.5 * (data.v_n[1:, :2] + data.v_n[:-1, :2])
    assert np.median(np.abs(moved / np.diff(data.time)[:, None] - mean)) < 0.1
    heading = read_reference(REAL / "kitti" / "2011_09_26_drive_0002_oxts").data.rph[:, 2]
    course = np.arctan2(data.v_n[:, 1], data.v_n[:, 0])
    assert np.degrees(np.abs((heading - course + np.pi) % (2.0 * np.pi) - np.pi)).max() < 3.0


@real
def test_real_phyphox():
    path = REAL / "phone" / "phyphox_walk"
    imu, gps = read_imu(path), read_gps(path)
    assert imu.facts.n_used == 10_575
    assert imu.facts.rate_hz == pytest.approx(100.7, abs=0.05)
    assert len(gps.data.time) == 35
    assert np.allclose(np.degrees(gps.data.lla[0, :2]), (43.565, 1.3925), atol=1e-3)
    assert gps.data.position_sd[0, 0] == pytest.approx(669.386 / 1.5096, rel=1e-4)


def test_the_two_files_of_imu_tk_are_one_recording(save):
    """Tedaldi et al., imu_tk: time, x, y, z of the accelerometers and of the gyros, without a header or units."""
    files = {}
    for name, rows in (("xsens_acc.mat", SAMPLES.accel), ("xsens_gyro.mat", SAMPLES.gyro)):
        table = np.column_stack([SAMPLES.t, rows])
        files[name] = "".join("   ".join(f"{x:.12e}" for x in row) + "\n" for row in table).encode()
    reading = read_imu(save(files))
    assert np.allclose(reading.data.accel, SAMPLES.accel)
    assert np.allclose(reading.data.gyro, SAMPLES.gyro)
