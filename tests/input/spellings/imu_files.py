"""Spellings of IMU files."""

from __future__ import annotations

import datetime
import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.input.spellings.recorded import DEG, G0, IMU_HEADERS, START, UNIX, drive, samples, table, text

SHORT = "time,gx,gy,gz,ax,ay,az"
FLU = np.diag([1.0, -1.0, -1.0])


def _csv(headers: str = SHORT, **how: object) -> Callable[[Path], Path]:
    spelled = {key: how.pop(key) for key in ("gyro", "accel", "matrix", "time") if key in how}
    return lambda folder: table(folder / "imu.csv", samples(headers, **spelled), **how)  # type: ignore[arg-type]


def _units(unit_gyro: float, unit_accel: float, headers: str, **how: object) -> Callable[[Path], Path]:
    return _csv(headers, gyro=unit_gyro, accel=unit_accel, **how)


def _turned(forward: str) -> np.ndarray:
    """From forward, right, down to a sensor whose x, y, z point so."""
    axes = {"F": (1, 0, 0), "B": (-1, 0, 0), "R": (0, 1, 0), "L": (0, -1, 0), "D": (0, 0, 1), "U": (0, 0, -1)}
    return np.array([axes[letter] for letter in forward], dtype=float)


def _yawed(degrees: float) -> np.ndarray:
    c, s = np.cos(degrees * DEG), np.sin(degrees * DEG)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _utc(t: np.ndarray, form: str, zone: float = 0.0, digits: int = 3) -> list[str]:
    """Times of the GPS week as text in UTC, or in a zone that is ahead of it by hours."""
    epoch = datetime.datetime(1970, 1, 1)
    times = (epoch + datetime.timedelta(seconds=round(UNIX + each + 3600.0 * zone, 4)) for each in t)
    return [_cut(each.strftime(form), digits) for each in times]


def _cut(text: str, digits: int) -> str:
    head, point, rest = text.partition("%")
    return head if not point else head + rest


def iso(form: str = "%Y-%m-%dT%H:%M:%S.%f", zone: float = 0.0) -> Callable[[np.ndarray], list[str]]:
    return lambda t: _utc(t, form, zone)


def digits(t: np.ndarray) -> list[str]:
    """Hours, minutes and seconds, UTC, in one number."""
    return [each.replace(":", "") for each in iso("%H:%M:%S.%f")(t)]


def _times(scale: float, offset: float = 0.0, decimals: int = 0) -> Callable[[np.ndarray], list[str]]:
    return lambda t: text((t + offset) * scale, decimals)


def _nanoseconds(t: np.ndarray) -> list[str]:
    return [str(round((UNIX + each) * 1e4) * 100_000) for each in t]


def rostopic(folder: Path) -> Path:
    time, *motion = samples("t,gx,gy,gz,ax,ay,az", _nanoseconds, matrix=FLU)
    stamps = time[1]
    zeros = ["0.0"] * len(stamps)
    columns = [("%time", stamps), ("field.header.seq", [str(i) for i in range(len(stamps))])]
    columns += [("field.header.stamp", stamps), ("field.header.frame_id", ["imu_link"] * len(stamps))]
    columns += [(f"field.orientation.{axis}", zeros) for axis in "xyzw"]
    columns += [(f"field.angular_velocity.{axis}", motion[i][1]) for i, axis in enumerate("xyz")]
    columns += [(f"field.angular_velocity_covariance{i}", zeros) for i in range(9)]
    columns += [(f"field.linear_acceleration.{axis}", motion[3 + i][1]) for i, axis in enumerate("xyz")]
    return table(folder / "imu.csv", columns)


def _two_columns(folder: Path) -> Path:
    motion = samples(SHORT)
    date, clock = iso("%Y-%m-%d")(drive().t), iso("%H:%M:%S.%f")(drive().t)
    return table(folder / "imu.csv", [("date", date), ("time", clock), *motion[1:]])


def parts_of_time(t: np.ndarray) -> list[tuple[str, list[str]]]:
    """Columns of date and clock, in UTC, as MT Manager of Xsens writes them."""
    moments = [datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=round(UNIX + each, 4)) for each in t]
    names = ("year", "month", "day", "hour", "minute", "second")
    columns = [(f"UTC_{name.title()}", [str(getattr(each, name)) for each in moments]) for name in names]
    return [("UTC_Nano", [str(each.microsecond * 1000) for each in moments]), *columns]


def _xsens(folder: Path) -> Path:
    motion = samples("t,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z")
    count = [str(i) for i in range(len(motion[0][1]))]
    return table(folder / "imu.csv", [("PacketCounter", count), *parts_of_time(drive().t), *motion[1:]])


def _ticks(folder: Path) -> Path:
    """The counter begins anew on the way."""
    motion, t = samples("t,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z"), drive().t - START
    ticks = [str((round(each * 1e4) + 2**32 - 1_000_000) % 2**32) for each in t]
    return table(folder / "imu.csv", [("SampleTimeFine", ticks), *motion[1:]])


def _seconds_and_nanoseconds(folder: Path) -> Path:
    motion, t = samples(SHORT), UNIX + drive().t
    seconds = [str(int(each)) for each in t]
    rest = [str(round((each % 1.0) * 1e9)) for each in t]
    return table(folder / "imu.csv", [("header.stamp.secs", seconds), ("header.stamp.nsecs", rest), *motion[1:]])


def _week(folder: Path) -> Path:
    columns = samples(SHORT.replace("time", "tow"))
    return table(folder / "imu.csv", [("gps_week", ["2381"] * len(columns[0][1])), *columns])


def _increments(headers: str, gyro: float = 1.0, accel: float = 1.0) -> Callable[[Path], Path]:
    return _csv(headers, gyro=50.0 * gyro, accel=50.0 * accel)


def _encoded(encoding: str, end: str = "\n") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = table(folder / "imu.csv", samples(SHORT), end=end)
        path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
        return path

    return write


def _gzipped(folder: Path) -> Path:
    path = table(folder / "imu.csv", samples(SHORT))
    packed = folder / "imu.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    return packed


def _parquet(folder: Path) -> Path:
    import pyarrow as pa
    from pyarrow import parquet

    made = drive()
    names = IMU_HEADERS.split(",")
    values = np.column_stack([made.t, made.gyro, made.accel]).T
    stamps = [datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=round(UNIX + t, 4)) for t in made.t]
    arrays = [pa.array(stamps, pa.timestamp("us")), *(pa.array(each) for each in values[1:])]
    parquet.write_table(pa.table(arrays, names=["timestamp", *names[1:]]), folder / "imu.parquet")
    return folder / "imu.parquet"


def _extra_words(folder: Path) -> Path:
    columns = samples(SHORT)
    return table(
        folder / "imu.csv", [*columns, ("mode", ["auto"] * len(columns[0][1])), ("note", [""] * len(columns[0][1]))]
    )


def _beside(*headers: str, value: str = "0.5") -> Callable[[Path], Path]:
    """Further columns that no strapdown navigation needs."""

    def write(folder: Path) -> Path:
        columns = samples(SHORT)
        return table(folder / "imu.csv", [*columns, *((name, [value] * len(columns[0][1])) for name in headers)])

    return write


def _lines(change: Callable[[list[str]], list[str]], end: bytes = b"\n") -> Callable[[Path], Path]:
    """Lines of the file changed as a whole."""

    def write(folder: Path) -> Path:
        path = table(folder / "imu.csv", samples(SHORT))
        path.write_bytes("\n".join(change(path.read_text().splitlines())).encode() + end)
        return path

    return write


def _reversed(folder: Path) -> Path:
    return table(folder / "imu.csv", samples(SHORT)[::-1])


def _decimal_comma(folder: Path) -> Path:
    return table(folder / "imu.csv", samples(SHORT), delimiter=";", change=lambda row: row.replace(".", ","))


def _walk(folder: Path) -> Path:
    """Logger without a header: accelerometers, gyros, a counter of milliseconds; first row cut."""
    time, *motion = samples("t,gx,gy,gz,ax,ay,az", _times(1e3), gyro=DEG, accel=G0)
    path = table(folder / "imu.csv", [*motion[3:], *motion[:3], time], header=False)
    path.write_text(path.read_text()[25:])
    return path


def _without_gravity(folder: Path) -> Path:
    made = drive()
    columns = samples("time,gx,gy,gz,user_acceleration_x,user_acceleration_y,user_acceleration_z")
    free = made.accel - np.median(made.accel, axis=0)
    return table(
        folder / "imu.csv",
        [*columns[:4], *((f"acc_{axis}", text(free[:, i])) for i, axis in enumerate("xyz"))],
    )


def _frame(headers: str, *, without_time: bool = False, unit: float = 1.0) -> Callable[[Path], object]:
    def make(folder: Path) -> object:
        import pandas as pd

        made = drive()
        values = np.column_stack([made.t, made.gyro / unit, made.accel])
        frame = pd.DataFrame(values, columns=headers.split(","))
        return frame.drop(columns=headers.split(",")[0]) if without_time else frame

    return make


# name -> writer; what is understood without an option
UNDERSTOOD: dict[str, Callable[[Path], object]] = {
    "canonical": _csv(IMU_HEADERS),
    "units in brackets": _units(
        DEG, G0, "Time [s],GyroX [deg/s],GyroY [deg/s],GyroZ [deg/s],AccX [g],AccY [g],AccZ [g]"
    ),
    "units as suffix": _units(DEG, G0, "t,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"),
    "no units, deg/s and g": _units(DEG, G0, SHORT),
    "no units, SI": _csv(),
    "units in words": _units(
        DEG,
        1.0,
        "Time (s),Angular velocity X (°/s),Angular velocity Y (°/s),Angular velocity Z (°/s),"
        "Acceleration X (m/s²),Acceleration Y (m/s²),Acceleration Z (m/s²)",
    ),
    "row of units": _units(DEG, 1e-3 * G0, SHORT, under="s,deg/s,deg/s,deg/s,mg,mg,mg"),
    "millidegrees and milli-g": _units(
        1e-3 * DEG, 1e-3 * G0, "t,gyr_x_mdps,gyr_y_mdps,gyr_z_mdps,acc_x_mg,acc_y_mg,acc_z_mg"
    ),
    "degrees an hour": _units(DEG / 3600, 1.0, "t,gyro_x (deg/h),gyro_y (deg/h),gyro_z (deg/h),fx,fy,fz"),
    "EuRoC": _csv(
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
        "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
        time=_nanoseconds,
    ),
    "counted from one": _csv("t,w_1,w_2,w_3,f_1,f_2,f_3"),
    "counted from one, no underscore": _csv("t,gyro1,gyro2,gyro3,acc1,acc2,acc3"),
    "counted from one, in brackets": _csv("t,gyro[1],gyro[2],gyro[3],accel[1],accel[2],accel[3]"),
    "counted from zero": _csv("t,gyro[0],gyro[1],gyro[2],accel[0],accel[1],accel[2]"),
    "counted from zero, no brackets": _csv("t,w_0,w_1,w_2,f_0,f_1,f_2"),
    "PX4": _csv(
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],accelerometer_m_s2[0],accelerometer_m_s2[1],"
        "accelerometer_m_s2[2]",
        time=_times(1e6),
    ),
    "increments": _increments("t,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z"),
    "increments in degrees": _increments(
        "t,dtheta_x (deg),dtheta_y (deg),dtheta_z (deg),dvel_x (m/s),dvel_y (m/s),dvel_z (m/s)", DEG
    ),
    "iPhone in G": _units(
        1.0,
        G0,
        "loggingTime(s),gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s),"
        "accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G)",
    ),
    "with dots": _csv("t,imu.gyro.x,imu.gyro.y,imu.gyro.z,imu.accel.x,imu.accel.y,imu.accel.z"),
    "with slashes": _csv(
        "Time,/imu/data/angular_velocity/x,/imu/data/angular_velocity/y,/imu/data/angular_velocity/z,"
        "/imu/data/linear_acceleration/x,/imu/data/linear_acceleration/y,/imu/data/linear_acceleration/z"
    ),
    "sensor names": _csv(
        "timestamp,gyroscope_x,gyroscope_y,gyroscope_z,accelerometer_x,accelerometer_y,accelerometer_z"
    ),
    "rotation rates": _csv("t,RotationRateX,RotationRateY,RotationRateZ,AccelerationX,AccelerationY,AccelerationZ"),
    "axis first": _csv("time,x_gyro,y_gyro,z_gyro,x_acc,y_acc,z_acc"),
    "p, q, r": _csv("t,p,q,r,ax,ay,az"),
    "roll, pitch and yaw rate": _csv("t,roll_rate,pitch_rate,yaw_rate,ax,ay,az"),
    "omega and f": _csv("t,omega_x,omega_y,omega_z,f_x,f_y,f_z"),
    "Xsens": _csv("UTC_Nano,Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z", time=_nanoseconds),
    "Arduino": _units(DEG, G0, "millis,GyroX,GyroY,GyroZ,AccX,AccY,AccZ", time=_times(1e3)),
    "capital letters": _units(
        DEG, 1.0, "TIME_S,GYRO_X_DPS,GYRO_Y_DPS,GYRO_Z_DPS,ACCEL_X_MPS2,ACCEL_Y_MPS2,ACCEL_Z_MPS2"
    ),
    "radians by the second": _csv("t,wx_radps,wy_radps,wz_radps,ax_mps2,ay_mps2,az_mps2"),
    "delta angles": _increments("t,delta_angle_x,delta_angle_y,delta_angle_z,delta_v_x,delta_v_y,delta_v_z"),
    "temperature": _beside("temperature_c", value="31.5"),
    "magnetometer": _beside("mag_x", "mag_y", "mag_z"),
    "quaternion": _beside("qw", "qx", "qy", "qz"),
    "attitude": _beside("roll", "pitch", "yaw"),
    "odometer": _beside("wheel_speed (km/h)", value="0.0"),
    "counter": _beside("sample", "status", value="7"),
    "empty cells beside": _beside("pressure", value=""),
    "empty lines": _lines(lambda lines: [each for line in lines for each in (line, "")]),
    "comments between": _lines(lambda lines: [*lines[:50], "# note", *lines[50:]]),
    "no line end": _lines(lambda lines: lines, b""),
    "zeros at the end": _lines(lambda lines: lines, b"\n" + bytes(4096)),
    "exponents": _csv(time=lambda t: [f"{each:.10e}" for each in t]),
    "plus signs": _csv(change=lambda row: row.replace(",", ",+").replace("+-", "-")),
    "decimal comma": _decimal_comma,
    "tabs": _csv(delimiter="\t"),
    "blanks": _csv(delimiter="   "),
    "bars": _csv(delimiter="|"),
    "blanks after commas": _csv(delimiter=", "),
    "comma at the end": _csv(change=lambda row: row + ","),
    "carriage returns": _csv(end="\r\n"),
    "byte order mark": _encoded("utf-8-sig"),
    "UTF-16": _encoded("utf-16"),
    "comments before": _csv(before="# logger 1.2\n# started at noon\n"),
    "header as comment": _csv("# " + SHORT),
    "quoted": _csv(change=lambda row: ",".join(f'"{cell}"' for cell in row.split(","))),
    "gzip": _gzipped,
    "parquet with timestamps": _parquet,
    "columns in reverse": _reversed,
    "words beside": _extra_words,
    "no header": _csv(header=False),
    "no header, cut, counter last": _walk,
    "milliseconds": _csv(time=_times(1e3)),
    "microseconds": _csv(time=_times(1e6)),
    "nanoseconds": _csv(time=_times(1e9)),
    "milliseconds named": _csv(SHORT.replace("time", "time_ms"), time=_times(1e3)),
    "seconds of the week and week": _week,
    "Xsens, UTC": _xsens,
    "text of SensorLog": _csv(SHORT.replace("time", "loggingTime(txt)"), time=iso("%Y-%m-%d %H:%M:%S.%f +0000")),
    "ISO with Z": _csv(time=iso("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO with offset": _csv(time=iso("%Y-%m-%dT%H:%M:%S.%f+02:00", 2.0)),
    "ISO with offset, no colon": _csv(time=iso("%Y-%m-%dT%H:%M:%S.%f-0530", -5.5)),
    "ISO in UTC by name": _csv(time=iso("%Y-%m-%d %H:%M:%S.%f UTC")),
    "ISO without zone": _csv(time=iso()),
    "ISO with a blank": _csv(time=iso("%Y-%m-%d %H:%M:%S.%f")),
    "slashes": _csv(time=iso("%Y/%m/%d %H:%M:%S.%f")),
    "German date": _csv(time=iso("%d.%m.%Y %H:%M:%S.%f")),
    "MATLAB date": _csv(time=iso("%d-%b-%Y %H:%M:%S.%f")),
    "US date": _csv(time=iso("%m/%d/%Y %I:%M:%S.%f %p")),
    "date and time in two columns": _two_columns,
    "data frame": _frame(IMU_HEADERS),
    "data frame in degrees": _frame("t,gx_dps,gy_dps,gz_dps,ax,ay,az", unit=DEG),
}
# as above, with fixes on the same clock
CLOCKS: dict[str, tuple[Callable[[Path], object], Callable[[np.ndarray], list[str]]]] = {
    "Unix seconds": (_csv(time=_times(1.0, UNIX, 4)), _times(1.0, UNIX, 3)),
    "Unix milliseconds": (_csv(time=_times(1e3, UNIX)), _times(1e3, UNIX)),
    "Unix nanoseconds": (_csv(time=_nanoseconds), _nanoseconds),
    "time of day": (_csv(time=iso("%H:%M:%S.%f")), iso("%H:%M:%S.%f")),
    "time of day, local": (_csv(time=iso("%H:%M:%S.%f", 7.0)), iso("%H:%M:%S.%f", 7.0)),
    "clock, digits beside": (
        _csv(time=iso("%H:%M:%S.%f")),
        lambda t: [each.replace(":", "") for each in iso("%H:%M:%S.%f")(t)],
    ),
    "over midnight": (_csv(time=iso("%H:%M:%S.%f", 6.4975)), iso("%H:%M:%S.%f", 6.4975)),
    "ROS stamps": (_seconds_and_nanoseconds, _times(1.0, UNIX, 3)),
    "ticks of Xsens": (_ticks, _times(1.0, 2.0**32 * 1e-4 - 100.0 - START, 3)),
    "from zero": (_csv(time=_times(1.0, -408640.0, 4)), _times(1.0, -408640.0, 3)),
}
# sensors turned in the vehicle: where x, y, z point, or yaw; found from the drive
TURNED: dict[str, np.ndarray] = {
    **{letters: _turned(letters) for letters in ("FLU", "RFU", "BLD", "RBD", "LFD", "BRU", "FUR", "FDL", "DRB", "UFL")},
    **{f"yaw {degrees:g}": _yawed(degrees) for degrees in (30.0, -45.0, 90.0, 180.0)},
}
# name -> writer, the code of the error, its values that lead to the answer, and the options with which the file is
# understood (None: it needs another file)
REFUSED: dict[str, tuple[Callable[[Path], object], str, dict[str, object], dict[str, object] | None]] = {
    "without gravity": (_without_gravity, "columns.gravity_removed", {}, None),
    "counts": (_units(1e-4, 5e-4, SHORT), "columns.no_gravity", {}, None),
    "not in m/s^2": (_units(1.0, G0, IMU_HEADERS), "columns.accel_unit", {"unit": "g"}, {"units": "accel=g"}),
    "not in rad/s": (_units(DEG, 1.0, IMU_HEADERS), "clock.gyro_unit", {"unit": "deg/s"}, {"units": "gyro=deg/s"}),
    "left-handed": (_csv(matrix=np.diag([1.0, -1.0, 1.0])), "mounting.left_handed", {}, None),
    "gyros inverted": (_csv(gyro=-1.0), "mounting.gyros_wrong_way", {"axes": ("x", "y", "z")}, None),
    "increments named rates": (_increments(SHORT), "columns.accel_increments", {}, {"sampling": "increment"}),
    "two times a gyro": (_csv("time,gx,gx,gz,ax,ay,az"), "columns.header_twice", {"column": "gx"}, None),
    "unknown names": (
        _csv("time,alpha,beta,gamma,ax,ay,az"),
        "columns.missing",
        {"guess": "gyro_x=alpha,gyro_y=beta,gyro_z=gamma", "option": "--columns"},
        {"columns": {"gyro_x": "alpha", "gyro_y": "beta", "gyro_z": "gamma"}},
    ),
    "misspelled": (
        _csv("time,gyor_x,gyro_y,gyro_z,ax,ay,az"),
        "columns.missing",
        {"meant": "gyro_x=gyor_x", "option": "--columns"},
        {"columns": {"gyro_x": "gyor_x"}},
    ),
    "ambiguous date": (
        _csv(time=lambda t: [f"08/07/2025 {each}" for each in iso("%H:%M:%S.%f")(t)]),
        "format.ambiguous_dates",
        {},
        None,
    ),
    "no times": (
        lambda folder: table(folder / "imu.csv", samples(SHORT)[1:]),
        "columns.missing",
        {"example": "time"},
        None,
    ),
}
