"""Tables as the tools of practitioners write them: several time columns, several sensors, units nobody needs."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from scipy.integrate import cumulative_simpson

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_gps, read_imu, read_reference
from insnav.input.interpret.columns import match_header
from insnav.input.interpret.physics import find_time_unit
from insnav.input.interpret.schema import GPS_SCHEMA
from insnav.session.read import read
from tests.input.files import IMU_HEADER, fixes, noted, rolling
from tests.refusals import refused
from tests.reversed_messages import as_shown

START = 1_711_483_461.5  # [s]


def _table(path: Path, header: str, rows: np.ndarray, formats: str) -> Path:
    lines = [",".join(form % value for form, value in zip(formats.split(), row, strict=True)) for row in rows]
    path.write_text("\n".join([header, *lines, ""]))
    return path


def _stamped(rows: np.ndarray, late: float) -> np.ndarray:
    """Rows with a time of arrival, whole seconds and nanoseconds in front, as bagpy writes them."""
    seconds = np.floor(rows[:, 0])
    return np.column_stack([rows[:, 0] + late, seconds, np.round((rows[:, 0] - seconds) * 1e9), rows[:, 1:]])


def test_seconds_and_nanoseconds_of_the_sensor_come_before_the_time_of_arrival(tmp_path):
    names = "Time,header.stamp.secs,header.stamp.nsecs"
    imu = _stamped(rolling(start=START), 0.02)
    path = _table(tmp_path / "imu.csv", IMU_HEADER.replace("time_s", names), imu, "%.6f %d %d " + "%.6f " * 6)
    reading = read_imu(path)
    assert reading.data.time[:2] == pytest.approx([START, START + 0.01], abs=1e-6)
    (pair,) = noted(reading, Code.TIME_TWO_COLUMNS)
    assert pair["columns"] == ("header.stamp.secs", "header.stamp.nsecs")
    (other,) = noted(reading, Code.COLUMNS_TWICE)
    assert other["column"] == "Time"
    named = read_imu(path, columns={"time_s": "Time"})
    assert named.data.time[0] == pytest.approx(START + 0.02, abs=1e-6)
    assert not noted(named, Code.TIME_TWO_COLUMNS)


def test_fixes_have_their_time_in_two_columns_too(tmp_path):
    path = _table(
        tmp_path / "gps.csv",
        "Unix Time,Microseconds,latitude,longitude,altitude",
        np.array([[1_700_000_000 + i // 2, 500_000 * (i % 2), *row[1:4]] for i, row in enumerate(fixes(20))]),
        "%d %d %.8f %.8f %.3f",
    )
    reading = read_gps(path)
    assert np.diff(reading.data.time) == pytest.approx(0.5)
    assert reading.data.time[1] == 1_700_000_000.5


@pytest.mark.parametrize(("tick", "rate"), [(1e-4, 100.0), (1e-6, 60.0)])
def test_the_counter_of_samples_is_in_the_ticks_that_an_imu_can_have(tmp_path, tick, rate):
    imu = rolling(rate=rate)
    imu[:, 0] = np.round((imu[:, 0]) / tick)
    header = "SampleTimeFine,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z"
    path = _table(tmp_path / "imu.csv", header, imu, "%d " + "%.6f " * 6)
    assert read_imu(path).facts.rate_hz == pytest.approx(rate, rel=0.01)
    named = read_imu(path, columns={"time_us": "SampleTimeFine"})
    assert named.facts.rate_hz == pytest.approx(1e6 * tick * rate, rel=0.01)


def test_of_sensors_that_write_by_turns_the_first_is_read(tmp_path):
    first = rolling(n=600)
    second = first + np.array([0.0, 0.1, 0.0, 0.0, 0.3, 0.0, 0.0])
    both = np.insert(np.stack([first, second], axis=1).reshape(1200, 7), 1, np.tile([0, 1], 600), axis=1)
    header = IMU_HEADER.replace("time_s", "time_s,I")
    reading = read_imu(_table(tmp_path / "imu.csv", header, both, "%.3f %d " + "%.6f " * 6))
    np.testing.assert_allclose(reading.data.gyro, first[:, 1:4], atol=1e-6)
    (instance,) = noted(reading, Code.READ_ROWS_INSTANCE)
    assert (instance["column"], instance["count"], instance["number"]) == ("I", 2, 0.0)


def test_an_unknown_unit_refuses_only_a_column_that_is_needed(tmp_path):
    imu = np.column_stack([rolling(n=600), np.full(600, 25.0)])
    reading = read_imu(_table(tmp_path / "imu.csv", f"{IMU_HEADER},temperature [%]", imu, "%.6f " * 8))
    assert reading.data.temperature is None
    (left_out,) = noted(reading, Code.COLUMNS_UNUSED)
    assert left_out["columns"] == ("temperature [%]",)
    gps = _table(tmp_path / "gps.csv", "time,lat,lon,height [furlong]", fixes(20)[:, :4], "%.1f %.8f %.8f %.3f")
    with refused(InputError, "columns.unknown_unit"):
        read_gps(gps)


def test_the_number_of_a_message_is_no_unit_and_its_heading_of_zeros_no_heading(tmp_path):
    header = "GPS TOW,Lat [x8103],Long [x8103],MSL Height [x8103],Horz Acc [x8103],Yaw"
    rows = np.column_stack([fixes(20)[:, :4], np.full(20, 2.0), np.zeros(20)])
    reading = read_gps(_table(tmp_path / "gps.csv", header, rows, "%.1f %.8f %.8f %.3f %.1f %.1f"))
    assert reading.facts.height == "msl"
    assert reading.data.heading is None


@pytest.mark.parametrize(
    ("header", "height"),
    [
        ("alt,epv", "msl"),
        ("alt_ellipsoid,alt", "ellipsoidal"),
        ("Alt,altitude system", "msl"),
        ("alt,other", "ellipsoidal"),
    ],
)
def test_heights_are_what_their_program_defines(tmp_path, header, height):
    rows = np.column_stack([fixes(20)[:, :4], np.arange(20) + 500.0])
    path = _table(tmp_path / "gps.csv", f"time,lat,lon,{header}", rows, "%.1f %.8f %.8f %.3f %.3f")
    reading = read_gps(path)
    assert reading.facts.height == height
    assert reading.data.lla[0, 2] == 500.0


@pytest.mark.parametrize("height", ["", ",height_m"])
def test_samples_and_fixes_without_heights_stand_in_one_table(tmp_path, height):
    imu = rolling(n=3000)
    place = fixes(30)[np.repeat(np.arange(30), 100), 1:3]
    rows = np.column_stack([imu, place])
    lines = [",".join([f"{value:.9f}" for value in row] + [""] * bool(height)) for row in rows]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"{IMU_HEADER},lat_deg,lon_deg{height}", *lines, ""]))
    reading = read_gps(path)
    assert len(reading.data.time) == 30
    assert noted(reading, Code.READ_HEIGHT_MISSING)


def test_velocities_in_the_axes_of_the_vehicle_are_left_out(tmp_path):
    angle = np.linspace(0.0, 6.0, 121)  # at 10 m/s on a circle of 200 m
    north, east = 200.0 * np.sin(angle), 200.0 * (1.0 - np.cos(angle))
    place = [48.0 + north / 111.2e3, 11.0 + east / (111.2e3 * np.cos(np.radians(48.0)))]
    rows = np.column_stack([np.arange(121), *place, np.full(121, 500.0), np.full(121, 10.0), np.zeros((121, 2))])
    header = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s"
    reading = read_gps(_table(tmp_path / "gps.csv", header, rows, "%.1f %.9f %.9f %.3f %.3f %.3f %.3f"))
    assert np.isnan(reading.data.v_n).all()
    (left_out,) = noted(reading, Code.READ_VELOCITY_IN_VEHICLE)
    assert left_out["columns"] == ("vn_m_s", "ve_m_s", "vd_m_s")


@pytest.mark.parametrize(
    "sentence",
    ["$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A", "$VNYMR,1.0,2.0,3.0*45", "B562"],
)
def test_raw_sentences_in_a_column_do_not_decide_the_format(tmp_path, sentence):
    rows = [",".join([*(f"{value:.6f}" for value in row), f'"{sentence}"']) for row in rolling(n=600)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"{IMU_HEADER},raw", *rows, ""]))
    assert read_imu(path).facts.n_used == 600


def test_columns_are_not_suggested_against_their_names(tmp_path):
    """Of a table without latitudes, the longitudes were suggested as these, and accelerometers as positions."""
    place = fixes(40)
    rows = np.column_stack([place[:, 0], place[:, 2], place[:, 3], np.full(40, 9.0)])
    path = _table(tmp_path / "gps.csv", "time,Longitude,Altitude,numSats", rows, "%.1f %.8f %.3f %.1f")
    with refused(InputError, "columns.missing") as caught:
        read_gps(path)
    assert not caught.value.gives
    rows = np.column_stack([place[:, 0], place[:, 1:4] / 50.0])
    path = _table(tmp_path / "imu.csv", "time,X Accel,Y Accel,Z Accel", rows, "%.1f %.8f %.8f %.3f")
    with refused(InputError, "columns.missing") as caught:
        read_gps(path)
    assert not caught.value.gives


@pytest.mark.parametrize("device", ["", "inertial-6254.12345.", "6254.12345_", "3DM-GX5-25 6251_98765:"])
def test_channels_of_sensorconnect_follow_the_name_of_the_device(tmp_path, device):
    imu = rolling()
    names = [f"{device}scaled{sensor}{axis}" for sensor in ("Gyro", "Accel") for axis in "XYZ"]
    rows = np.column_stack([imu[:, :4], imu[:, 4:] / 9.80665])
    path = _table(tmp_path / "imu.csv", ",".join(["Time", *names]), rows, "%.6f " + "%.9f " * 6)
    reading = read_imu(path)
    np.testing.assert_allclose(reading.data.gyro, imu[:, 1:4], atol=1e-8)
    np.testing.assert_allclose(reading.data.accel, imu[:, 4:], atol=1e-7)


def test_datcon_names_the_device_before_a_colon(tmp_path):
    """DJI DatCon: the second IMU is not read, and heights are above sea level."""
    imu = rolling()
    names = [f"IMU_ATTI(0):{sensor}{axis}" for sensor in ("gyro", "accel") for axis in "XYZ"]
    header = ",".join(["Clock:offsetTime", *names, "GPS(0):Lat", "GPS(0):Long", "GPS(0):heightMSL"])
    place = fixes(30)[np.repeat(np.arange(30), 100), 1:4]
    rows = np.column_stack([imu[:, 0], np.degrees(imu[:, 1:4]), imu[:, 4:] / 9.80665, place])
    path = _table(tmp_path / "flight.csv", header, rows, "%.6f " + "%.9f " * 9)
    np.testing.assert_allclose(read_imu(path).data.gyro, imu[:, 1:4], atol=1e-8)
    assert read_gps(path).facts.height == "msl"


def test_empty_columns_of_a_date_do_not_hide_the_counter(tmp_path):
    """Text of Xsens MT Manager: the date is written twice, and empty without a receiver."""
    imu, dates = rolling(), "Year,Month,Day,Second,UTC_Nano,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second"
    rows = [[f"{round(row[0] * 1e4)}", *[""] * 11, *(f"{x:.9f}" for x in row[1:])] for row in imu]
    lines = [
        "// Start Time: Unknown",
        "// Sample rate: 100.0Hz",
        f"SampleTimeFine,{dates},Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z",
    ]
    path = tmp_path / "mt.txt"
    path.write_text("\n".join([line.replace(",", "\t") for line in lines] + ["\t".join(row) for row in rows]) + "\n")
    np.testing.assert_allclose(read_imu(path).data.time, imu[:, 0], atol=1e-6)


def test_tables_of_the_smartphone_decimeter_challenge(tmp_path):
    """Kaggle: messages of three sensors by turns, and one row a satellite with the least-squares position."""
    imu, place = rolling(), fixes(30)
    lines = ["MessageType,utcTimeMillis,elapsedRealtimeNanos,MeasurementX,MeasurementY,MeasurementZ,BiasX,BiasY,BiasZ"]
    for row in imu:
        for kind, x, y, z in (("UncalAccel", *row[4:]), ("UncalGyro", *row[1:4]), ("UncalMag", 1.0, 2.0, 3.0)):
            lines.append(f"{kind},{round(row[0] * 1e3)},1,{y:.9f},{x:.9f},{-z:.9f},0,0,0")
    path = tmp_path / "device_imu.csv"
    path.write_text("\n".join([*lines, ""]))
    reading = read_imu(path)
    np.testing.assert_allclose(reading.data.gyro, imu[:, 1:4], atol=1e-6)
    np.testing.assert_allclose(reading.data.accel, imu[:, 4:], atol=1e-6)
    lines = [
        "MessageType,utcTimeMillis,Svid,SvPositionXEcefMeters,WlsPositionXEcefMeters,WlsPositionYEcefMeters,WlsPositionZEcefMeters"
    ]
    for row in place:
        x, y, z = pymap3d.geodetic2ecef(*row[1:4])
        lines += [f"Raw,{round(row[0] * 1e3)},{number},2.1e7,{x:.4f},{y:.4f},{z:.4f}" for number in (3, 5, 9)]
    path = tmp_path / "device_gnss.csv"
    path.write_text("\n".join([*lines, ""]))
    reading = read_gps(path)
    np.testing.assert_allclose(reading.data.time, place[:, 0])
    np.testing.assert_allclose(np.degrees(reading.data.lla[:, 0]), place[:, 1], atol=1e-7)


def test_a_year_in_a_name_is_no_device():
    """ "since 1970" is no serial number, of which the rest would be a name."""
    assert match_header("height above 1985 z (ms)", GPS_SCHEMA) is None
    assert match_header("sats 2024(s)", GPS_SCHEMA) is None


@pytest.mark.parametrize("kind", ["xlsx", "ods", "xls"])
def test_a_spreadsheet_is_named_and_its_export_advised(tmp_path, kind):
    path = tmp_path / f"drive.{kind}"
    member = {"xlsx": "xl/workbook.xml", "ods": "content.xml"}.get(kind)
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("[Content_Types].xml", member or "x", "docProps/app.xml"):
            archive.writestr(name, "<xml/>")
    if member is None:
        path.write_bytes(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(5000))
    with refused(InputError, "format.other_data") as caught:
        read_imu(path)
    assert caught.value.values["kind"] == "a spreadsheet"
    assert as_shown("CSV") in caught.value.fix


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize(("unit", "bends"), [("rad", 0.3), ("rad", 2.0), ("deg", 0.07), ("deg", 2.0)])
def test_the_course_tells_the_unit_of_attitude_without_one(tmp_path, unit, bends, velocities, sign):
    """On small bends, headings in degrees are below two pi, too."""
    time = np.arange(0.0, 60.0, 0.5)
    course = 0.02 + bends * np.sin(0.2 * time)
    v = 10.0 * np.column_stack([np.cos(course), np.sin(course)])
    ned = cumulative_simpson(v, x=time, axis=0, initial=0.0)
    place = [48.0 + ned[:, 0] / 111.2e3, 11.0 + ned[:, 1] / (111.2e3 * np.cos(np.radians(48.0)))]
    angles = np.column_stack([np.full(len(time), 0.02), np.full(len(time), -0.01), sign * course])
    header = "time_s,lat_deg,lon_deg,height_m" + ",vn_m_s,ve_m_s,vd_m_s" * velocities + ",roll,pitch,yaw"
    moving = [*v.T, np.zeros(len(time))] if velocities else []
    shown = angles if unit == "rad" else np.degrees(angles)
    rows = np.column_stack([time, *place, np.full(len(time), 500.0), *moving, shown])
    reading = read_reference(_table(tmp_path / "ref.csv", header, rows, "%.9f " * rows.shape[1]))
    np.testing.assert_allclose(np.sin(reading.data.rph - angles), 0.0, atol=1e-6)
    code = Code.READ_ANGLES_ATTITUDE_BY_COURSE if unit == "rad" else Code.READ_ANGLES_ATTITUDE_ASSUMED
    (told,) = noted(reading, code)
    assert (told["columns"], told["unit"]) == (("roll", "pitch", "yaw"), unit)


def _same_samples(path: Path, imu: np.ndarray) -> None:
    reading = read_imu(path)
    np.testing.assert_allclose(reading.data.time - reading.data.time[0], imu[:, 0] - imu[0, 0], atol=1e-5)
    np.testing.assert_allclose(reading.data.gyro, imu[:, 1:4], atol=1e-8)
    np.testing.assert_allclose(reading.data.accel, imu[:, 4:], atol=1e-7)


def test_ros2_topic_echo_has_no_header(tmp_path):
    """All fields of sensor_msgs/Imu and sensor_msgs/NavSatFix in their order, with the frame in the third."""
    imu, place = rolling(), fixes(30)
    whole, nano = np.divmod(np.round((imu[:, 0] + START) * 1e9), 1e9)
    none, (gyro, accel) = (
        ",0.0" * 9,
        ([",".join(map(repr, row)) for row in part.tolist()] for part in (imu[:, 1:4], imu[:, 4:])),
    )
    lines = [
        f"{int(s)},{int(n)},imu,0.0,0.0,0.0,1.0{none},{w}{none},{f}{none}"
        for s, n, w, f in zip(whole, nano, gyro, accel, strict=True)
    ]
    (tmp_path / "imu.csv").write_text("\n".join(lines))
    _same_samples(tmp_path / "imu.csv", imu)
    lines = [
        f"{int(t + 1e6)},0,gps,0,1,{lat!r},{lon!r},{height!r},2.25,0.0,0.0,0.0,4.0,0.0,0.0,0.0,9.0,2"
        for t, lat, lon, height in place[:, :4].tolist()
    ]
    (tmp_path / "fix.csv").write_text("\n".join(lines))
    data = read_gps(tmp_path / "fix.csv").data
    np.testing.assert_allclose(np.degrees(data.lla[:, :2]), place[:, 1:3], atol=1e-12)
    np.testing.assert_allclose(data.position_sd[0], [2.0, 1.5, 3.0])


NAMES = {
    "PlotJuggler": "__time,/imu/data/angular_velocity/?,/imu/data/linear_acceleration/?",
    "HyperIMU": "Timestamp,icm45631 ICM45631 Gyroscope Non-wakeup.?,icm45631 ICM45631 Accelerometer Non-wakeup.?",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_behind_a_topic_or_a_chip(tmp_path, name):
    imu = rolling()
    time, gyro, accel = NAMES[name].split(",")
    header = ",".join([time, *(word.replace("?", axis) for word in (gyro, accel) for axis in "xyz")])
    rows = np.column_stack([imu[:, 0] + START, imu[:, 1:]])
    _same_samples(_table(tmp_path / "log.csv", header, rows, "%.6f " + "%.9f " * 6), imu)


@pytest.mark.parametrize(
    ("unit", "size", "step"), [("ms", 1e-3, 0.01), ("us", 1e-6, 0.1), ("ns", 1e-9, 1.0), ("s", 1.0, 1.0)]
)
def test_unix_time_has_the_unit_of_its_size(unit, size, step):
    """Fixes held in the rows of samples have steps of 20, which might be seconds."""
    time = (START + step * np.arange(100)) / size
    assert find_time_unit(time, None, slowest=45.0, where="gps.csv")[0] == unit


def test_sensors_by_turns_with_names(tmp_path):
    imu = rolling()
    rows = [f"{r[0]:.6f},{name}," + ",".join(f"{x:.9f}" for x in r[1:]) for r in imu for name in ("front", "rear")]
    path = tmp_path / "imu.csv"
    path.write_text("\n".join(["time,sensor_id,gx,gy,gz,ax,ay,az", *rows, ""]))
    _same_samples(path, imu)
    (found,) = noted(read_imu(path), Code.READ_ROWS_INSTANCE)
    assert (found["column"], found["number"], found["count"]) == ("sensor_id", "front", 2)


def test_a_time_column_named_for_samples_is_that_of_the_fixes_beside_them(tmp_path):
    imu, place = rolling(), fixes(30)[np.repeat(np.arange(30), 100), 1:4]
    rows = np.column_stack([imu, place])
    header = "Zeit,gx,gy,gz,ax,ay,az,lat,lon,height"
    path = _table(tmp_path / "log.csv", header, rows, "%.6f " + "%.9f " * 9)
    assert read(path, None, None, {"columns": {"time": "Zeit"}}).gps is not None
    assert read(path, None, read_reference_of(tmp_path), {"columns": {"time": "Zeit"}}).gps is not None


def read_reference_of(folder: Path) -> Path:
    """A reference, which is no reason to leave out the fixes of the log."""
    return _table(folder / "ref.csv", "time_s,lat_deg,lon_deg,height_m", fixes(30)[:, :4], "%.6f " + "%.9f " * 3)
