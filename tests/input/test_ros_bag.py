"""ROS bags, written by the `rosbags` package from a known motion, and real ones where they lie."""

from __future__ import annotations

import gc
import gzip

import numpy as np
import pytest

import insnav
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Severity, of_code
from insnav.input import read_gps, read_imu
from insnav.input.formats.registry import open_tables
from tests.input.files import noted
from tests.input.recordings import FIXES, REAL, SAMPLES, UNIX, real, same_places

pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from tests.refusals import refused

FLU = np.array([1.0, -1.0, -1.0])
IMU, FIX, TWIST = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistStamped"


def write_bag(path, *, kind="ros1", axes=FLU, imus=("/imu/data",), stamped=True, covariance_type=2, status=0):
    """Write a bag of the motion, messages 50 ms after what they tell of."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types = store.types
    if kind == "ros1":
        writer = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)

    def header(t):
        ns = round((UNIX + t) * 1e9) if stamped else 0
        stamp = types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
        extra = {"seq": 1} if kind == "ros1" else {}
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu_link", **extra)

    def vector(v):
        return types["geometry_msgs/msg/Vector3"](*map(float, v))

    messages = []
    with writer:
        connections = {name: writer.add_connection(name, IMU, typestore=store) for name in imus}
        connections |= {n: writer.add_connection(n, t, typestore=store) for n, t in (("/fix", FIX), ("/vel", TWIST))}
        for t, w, f in zip(SAMPLES.t, SAMPLES.gyro, SAMPLES.accel, strict=True):
            quaternion, nine = types["geometry_msgs/msg/Quaternion"](0.1, 0.2, 0.3, 0.9), np.arange(9.0)
            message = types[IMU](header(t), quaternion, nine, vector(w * axes), nine, vector(f * axes), nine)
            messages += [(t, connections[name], message, IMU) for name in imus]
        for t, lla, v in zip(FIXES.t, FIXES.lla, FIXES.v_n, strict=True):
            quality = types["sensor_msgs/msg/NavSatStatus"](status, 1)
            covariance = np.diag([0.04, 0.01, 0.09]).ravel()
            messages.append(
                (t, connections["/fix"], types[FIX](header(t), quality, *lla, covariance, covariance_type), FIX)
            )
            twist = types["geometry_msgs/msg/Twist"](vector([v[1], v[0], -v[2]]), vector([0, 0, 0]))
            messages.append((t, connections["/vel"], types[TWIST](header(t), twist), TWIST))
        for t, connection, message, name in sorted(messages, key=lambda each: each[0]):
            raw = store.serialize_ros1(message, name) if kind == "ros1" else store.serialize_cdr(message, name)
            writer.write(connection, round((UNIX + t + 0.05) * 1e9), raw)
    return path


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_bag_gives_what_was_written(tmp_path, kind):
    path = write_bag(tmp_path / "drive.bag", kind=kind)
    imu, gps = read_imu(path), read_gps(path)
    assert imu.facts.axes == "FLU"
    assert np.allclose(imu.data.time, UNIX + SAMPLES.t, atol=1e-6)
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(imu.data.accel, SAMPLES.accel)
    assert np.allclose(gps.data.time, UNIX + FIXES.t, atol=1e-6)
    assert same_places(gps.data, metres=1e-4)
    assert np.allclose(gps.data.position_sd, [0.1, 0.2, 0.3])
    assert np.allclose(gps.data.v_n, FIXES.v_n)
    if kind != "ros1":  # a file of it alone
        inside = next(each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
        assert np.array_equal(read_imu(inside).data.gyro, imu.data.gyro)


def test_packed_bags_are_read_too(tmp_path):
    path = write_bag(tmp_path / "drive.bag")
    packed = tmp_path / "anything"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert np.array_equal(read_imu(packed).data.gyro, read_imu(path).data.gyro)


def test_axes_that_point_down_are_taken_so(tmp_path):
    imu = read_imu(write_bag(tmp_path / "drive.bag", axes=np.ones(3)))
    assert imu.facts.axes == "FRD"
    assert np.allclose(imu.data.accel, SAMPLES.accel)


def test_several_imus_are_asked_for(tmp_path):
    path = write_bag(tmp_path / "drive.bag", imus=("/camera/imu", "/imu/data"))
    with refused(ConfigError, "format.several_sensors") as caught:
        insnav.load(path)
    assert caught.value.values["topics"] == ("/camera/imu", "/imu/data")
    drive = insnav.load(path, topic="/imu/data")
    assert drive.gps is not None
    assert [each.subject for each in noted(drive.imu, Code.READ_SOURCE)] == ["/imu/data"]


def test_headers_without_times_are_said(tmp_path):
    reading = read_imu(write_bag(tmp_path / "drive.bag", stamped=False))
    assert reading.data.time[0] == pytest.approx(UNIX + 0.05, abs=1e-6)
    assert noted(reading, Code.READ_TIME_OF_RECORDER)


def test_unknown_covariances_and_missing_fixes(tmp_path):
    gps = read_gps(write_bag(tmp_path / "a.bag", covariance_type=0))
    assert np.isnan(gps.data.position_sd).all()
    with pytest.raises(InputError):
        read_gps(write_bag(tmp_path / "b.bag", status=-1))


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_cut_and_damaged_bags_are_refused_or_read(tmp_path, kind):
    path = write_bag(tmp_path / "drive.bag", kind=kind)
    file = path if path.is_file() else next(each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
    whole, rng = file.read_bytes(), np.random.default_rng(2)
    for case in range(12):
        data = bytearray(whole)
        if case % 2:
            data = data[: rng.integers(20, len(whole))]
        for _ in range(3):
            data[rng.integers(len(data))] = rng.integers(256)
        file.write_bytes(data)
        for read in (read_imu, read_gps):
            try:
                found = read(file).data
            except (InputError, ConfigError):
                continue
            assert (np.diff(found.time) > 0.0).all()
    gc.collect()  # rosbags leaves some files open that it cannot read


def test_messages_that_the_index_lists_and_the_file_has_lost_are_a_warning(tmp_path):
    path = write_bag(tmp_path / "drive.bag", kind="mcap")
    file = next(each for each in path.iterdir() if each.suffix == ".mcap")
    whole = bytearray(file.read_bytes())
    file.write_bytes(whole)
    assert not [*of_code(read_imu(file).facts.evidence, Code.READ_ROWS_UNREADABLE)]
    middle = len(whole) // 2
    whole[middle : middle + 4096] = bytes(4096)
    file.write_bytes(whole)
    samples = read_imu(file)
    (lost,) = of_code(samples.facts.evidence, Code.READ_ROWS_UNREADABLE)
    assert lost.severity is Severity.WARNING
    assert (lost["of"], lost["count"]) == (len(SAMPLES.t), len(SAMPLES.t) - len(samples.data.time))


def test_a_bag_of_other_things_names_its_topics(tmp_path):
    path = tmp_path / "drive.bag"
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        message = store.types["std_msgs/msg/String"]("hello")
        writer.write(connection, 1, store.serialize_ros1(message, "std_msgs/msg/String"))
    with refused(InputError, "format.bag_no_data") as caught:
        open_tables(path)
    assert caught.value.values["found"] == ("/chatter (std_msgs/msg/String)",)


@real
def test_real_bags():
    imu = read_imu(REAL / "ros" / "husky_imu_navsatfix.bag")
    gps = read_gps(REAL / "ros" / "husky_imu_navsatfix.bag")
    assert (imu.facts.n_used, gps.facts.n_used) == (11_865, 989)
    assert imu.facts.rate_hz == pytest.approx(30.0, abs=0.1)
    assert np.allclose(imu.data.accel.mean(axis=0), (-0.2, -9.8, -0.1), atol=0.05)  # Forward, Left, Up in the bag
    assert np.allclose(np.degrees(gps.data.lla[0, :2]), (42.376, -71.147), atol=1e-3)
    for each in ("husky_ros2_sqlite_converted", "husky_ros2_mcap_converted"):
        part = read_imu(REAL / "ros" / each)
        assert part.facts.n_used == 1201
        first = np.searchsorted(imu.data.time, part.data.time[0])
        assert np.array_equal(part.data.accel, imu.data.accel[first : first + 1201])
        assert read_gps(REAL / "ros" / each).facts.n_used == 100
