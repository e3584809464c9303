from __future__ import annotations

import math

import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code
from insnav.input.formats.table import ArrayCells, Table
from insnav.input.interpret.columns import match_header, require, suggest, understand
from insnav.input.interpret.schema import GPS_SCHEMA, IMU_SCHEMA, REFERENCE_SCHEMA
from tests.refusals import refused

# header -> key, and factor to SI (None: the header states no unit)
IMU = {
    "UncompAngularRateX": ("gyro_x", None),
    "UncompAccelZ": ("accel_z", None),
    "X Gyroscope": ("gyro_x", None),
    "time_s": ("time", 1.0),
    "time": ("time", None),
    "t": ("time", None),
    "Timestamp": ("time", None),
    "timestamp_ns": ("time", 1e-9),
    "time_us": ("time", 1e-6),
    "Time (ms)": ("time", 1e-3),
    "time[s]": ("time", 1.0),
    "gps_time": ("time", None),
    "SOW": ("time", None),
    "tow": ("time", None),
    "UTC": ("time", None),
    "gyro_x_rad_s": ("gyro_x", 1.0),
    "gyro_x": ("gyro_x", None),
    "GyroX": ("gyro_x", None),
    "GyrX": ("gyro_x", None),
    "gx": ("gyro_x", None),
    "gx_dps": ("gyro_x", math.pi / 180),
    "gyro_x[deg/s]": ("gyro_x", math.pi / 180),
    "gyro_x (°/s)": ("gyro_x", math.pi / 180),
    "Gyro X (deg/h)": ("gyro_x", math.pi / 180 / 3600),
    "wx": ("gyro_x", None),
    "omega_y": ("gyro_y", None),
    "gyr_z": ("gyro_z", None),
    "angular_velocity.x": ("gyro_x", None),
    "field.angular_velocity.z": ("gyro_z", None),
    "/imu/data/angular_velocity/y": ("gyro_y", None),
    "rotationRateX": ("gyro_x", None),
    "rotRateZ(rad/s)": ("gyro_z", 1.0),
    "gyro_rad[0]": ("gyro_x", None),
    "gyro_z_rad_per_s": ("gyro_z", 1.0),
    "imu_gyro_y_mdps": ("gyro_y", 1e-3 * math.pi / 180),
    "accel_x_m_s2": ("accel_x", 1.0),
    "accel_z": ("accel_z", None),
    "ax": ("accel_x", None),
    "acc_x_g": ("accel_x", 9.80665),
    "acc_x (mg)": ("accel_x", 9.80665e-3),
    "ay [m/s²]": ("accel_y", 1.0),
    "az(m/s^2)": ("accel_z", 1.0),
    "AccZ": ("accel_z", None),
    "fx": ("accel_x", None),
    "linear_acceleration.x": ("accel_x", None),
    "accelerometer_m_s2[2]": ("accel_z", None),
    "specific_force_y": ("accel_y", None),
    "dtheta_x_rad": ("dtheta_x", 1.0),
    "delta_angle_y": ("dtheta_y", None),
    "gyro_x [rad/sample]": ("dtheta_x", 1.0),
    "dvel_z_m_s": ("dvel_z", 1.0),
    "delta_v_x": ("dvel_x", None),
    "temperature_c": ("temperature", 1.0),
    "wheel_speed_mps": ("odometer", 1.0),
    "odometer (km/h)": ("odometer", 1 / 3.6),
}
GPS = {
    "lat": ("lat", None),
    "Latitude": ("lat", None),
    "latitude(deg)": ("lat", math.pi / 180),
    "lat_rad": ("lat", 1.0),
    "lon": ("lon", None),
    "lng": ("lon", None),
    "Longitude (°)": ("lon", math.pi / 180),
    "alt": ("height", None),
    "h": ("height", None),
    "hgt": ("height", None),
    "altitude_mm": ("height", 1e-3),
    "ellipsoidal height [m]": ("height", 1.0),
    "hMSL": ("height_msl", None),
    "vn": ("vn", None),
    "vel_n": ("vn", None),
    "velNorth": ("vn", None),
    "vel_e_m_s": ("ve", 1.0),
    "vd (cm/s)": ("vd", 1e-2),
    "vu": ("vu", None),
    "v_up": ("vu", None),
    "sd_n": ("sd_n", None),
    "std_n": ("sd_n", None),
    "sigma_e": ("sd_e", None),
    "sdn(m)": ("sd_n", 1.0),
    "sdu(m)": ("sd_d", 1.0),
    "sd_vn_m_s": ("sd_vn", 1.0),
    "std_ve": ("sd_ve", None),
    "sd_velocity_north_m_s": ("sd_vn", 1.0),
    "yaw": ("heading", None),
    "heading_deg": ("heading", math.pi / 180),
    "fix": ("fix", None),
    "Q": ("fix", None),
    "fix_type": ("fix", None),
    "nsat": ("satellites", None),
    "numSV": ("satellites", None),
    "satellites_used": ("satellites", None),
    "pDOP": ("dop", None),
    "HDOP": ("dop", None),
}


@pytest.mark.parametrize(("header", "expected"), IMU.items())
def test_imu_spellings_are_understood(header, expected):
    _check(header, expected, IMU_SCHEMA)


@pytest.mark.parametrize(("header", "expected"), GPS.items())
def test_gps_spellings_are_understood(header, expected):
    _check(header, expected, GPS_SCHEMA)


def _check(header, expected, schema):
    found, _ = understand([header], None, schema)
    key, factor = expected
    assert list(found) == [key]
    if factor is None:
        assert found[key].unit is None
    else:
        assert found[key].unit is not None
        assert found[key].factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    "header",
    ["battery", "mag_x", "gyro_bias_x", "pressure", "lat_lon", "angular_velocity_covariance[0]", "", "x"],
)
def test_other_columns_are_left_alone(header):
    assert match_header(header, IMU_SCHEMA) is None
    assert match_header(header, GPS_SCHEMA) is None


def _table(headers, units=None):
    return Table("a.csv", "", tuple(headers), ArrayCells((), str), units)


def test_units_row_gives_the_units():
    found, _ = understand(["time", "gx", "ax"], ["(ms)", "deg/s", "g"], IMU_SCHEMA)
    assert [f.unit for f in found.values()] == ["ms", "deg/s", "g"]


def test_unknown_unit_is_refused_with_choices():
    for headers, units in ((["gyro_x [furlong]"], None), (["gyro_x"], ["furlong"])):
        found, _ = understand(headers, units, IMU_SCHEMA)
        with refused(InputError, "columns.unknown_unit") as caught:
            require(found, ["gyro_x"], _table(headers, units), IMU_SCHEMA)
        assert caught.value.values["text"] == "furlong"
        assert "deg/s" in caught.value.values["units"]


def test_an_unknown_unit_of_a_column_that_is_not_needed_leaves_the_column_out():
    headers = ["time", "gyro_x", "temperature [%]"]
    found, notes = understand(headers, None, IMU_SCHEMA)
    require(found, ["time", "gyro_x"], _table(headers), IMU_SCHEMA)
    assert found.keys() == {"time", "gyro_x"}
    assert [(note.code, note["columns"]) for note in notes] == [(Code.COLUMNS_UNUSED, ("temperature [%]",))]
    with refused(InputError, "columns.unknown_unit") as caught:
        require(found, ["temperature"], _table(headers), IMU_SCHEMA)
    assert "degC" in caught.value.values["units"]


def test_duplicate_header_is_refused():
    with refused(InputError, "columns.header_twice"):
        understand(["time", "gx", "gx"], None, IMU_SCHEMA)


def test_two_columns_for_one_quantity_prefer_the_plainer_and_say_so():
    found, notes = understand(["gps_tow", "time"], None, GPS_SCHEMA)
    assert found["time"].header == "time"
    (note,) = notes
    assert note.code is Code.COLUMNS_TWICE
    assert (note["column"], note["quantity"], note["used"]) == ("gps_tow", "time", "time")


def test_a_name_without_prefix_is_preferred():
    found, notes = understand(["sensor_gyro_x", "gyro_x", "imu_gyro_x"], None, IMU_SCHEMA)
    assert found["gyro_x"].header == "gyro_x"
    assert [note.code for note in notes] == [Code.COLUMNS_TWICE] * 2


def test_two_equal_spellings_are_refused():
    with refused(InputError, "columns.ambiguous"):
        understand(["gyro_x", "Gyro X"], None, IMU_SCHEMA)


def test_columns_given_by_the_user_win():
    found, _ = understand(["gx", "foo"], None, IMU_SCHEMA, columns={"gyro_x_dps": "foo"})
    assert (found["gyro_x"].header, found["gyro_x"].unit) == ("foo", "deg/s")
    found, _ = understand(["fix"], None, GPS_SCHEMA, columns={"fix": ""})
    assert not found


def test_what_is_to_be_copied_is_quoted_and_seconds_of_a_minute_are_no_time():
    headers = ["time stampp", "lat", "lon", "alt"]
    found, _ = understand(headers, None, GPS_SCHEMA)
    with pytest.raises(InputError) as caught:
        require(found, ["time"], _table(headers), GPS_SCHEMA, gives={"columns": {"time": "time stampp"}})
    assert "--columns 'time=time stampp'" in caught.value.fix
    headers = ["Hour", "Minute", "Second", "lat", "lon", "alt"]
    found, _ = understand(headers, None, GPS_SCHEMA)
    with pytest.raises(InputError) as caught:
        require(found, ["time"], _table(headers), GPS_SCHEMA, hint="wrong", gives={"columns": {}})
    assert caught.value.code == "columns.time_in_parts"
    assert not caught.value.gives


@pytest.mark.parametrize(
    ("key", "header", "unit"),
    [
        ("height", "P5 [ft]", "ft"),
        ("height", "hoehe_ft", "ft"),
        ("height", "P5", None),
        ("vn", "nord_m_s", "m/s"),
        ("time", "zeit_ms", "ms"),
        ("gyro_x", "w1 (deg/s)", "deg/s"),
        ("gyro_x_deg_s", "w1 (deg/s)", "deg/s"),
        ("gyro_x_rad_s", "w1", "rad/s"),
        ("gyro_x", "turn_x_m", None),
    ],
)
def test_the_unit_of_a_column_that_is_named_is_that_of_its_header(key, header, unit):
    """Unless the header has none: heights in feet were metres, 1161 m off without a word."""
    found, _ = understand([header, "other"], None, IMU_SCHEMA + GPS_SCHEMA, columns={key: header})
    (column,) = found.values()
    assert column.unit == unit
    below, _ = understand(["P5", "other"], ["ft", ""], GPS_SCHEMA, columns={"height": "P5"})
    assert below["height"].unit == "ft"
    with refused(ConfigError, "columns.unit_conflict"):
        understand(["P5 [ft]"], None, GPS_SCHEMA, columns={"height_m": "P5 [ft]"})


def test_wrong_columns_option_suggests():
    with refused(ConfigError, "columns.no_such_column") as caught:
        understand(["wheel"], None, IMU_SCHEMA, columns={"odometer": "whel"})
    assert caught.value.values["close"] == "wheel"
    with refused(ConfigError, "columns.unknown_quantity") as caught:
        understand(["wheel"], None, IMU_SCHEMA, columns={"odometre": "wheel"})
    assert caught.value.values["close"] == "odometer"


# Slips of the pen: the suggestion must name the right column among decoys.
SLIPS = {
    "gyro_x": ["gryo_x", "gyrox_1", "girox", "gyro_xx", "gyroo_x", "gyo_x", "gyro_x_raw"],
    "accel_z": ["acel_z", "accell_z", "accelz_raw", "acceel_z", "acc_zz", "aceleration_z", "accel_z_m_s"],
    "time": ["tme", "timee", "time_sec_", "timstamp", "tiem", "timestmap"],
    "lat": ["lattitude", "latitud", "latt", "latitide", "laitude"],
    "lon": ["longitud", "lonn", "longtitude", "logitude"],
    "height": ["heigth", "hight", "altitud", "heigh", "alttitude"],
}


def test_did_you_mean_is_right_nine_times_in_ten():
    decoys = ["led", "pressure", "mag_y", "status", "volts", "battery", "counter"]
    tried, right = 0, 0
    for key, slips in SLIPS.items():
        quantity = next(q for q in (*IMU_SCHEMA, *GPS_SCHEMA) if q.key == key)
        for slip in slips:
            tried += 1
            right += suggest(quantity, [*decoys, slip]) == slip
    assert right >= 0.9 * tried
    assert suggest(IMU_SCHEMA[1], decoys) is None


def test_missing_column_names_what_was_found_and_what_may_be_meant():
    headers = ["time", "gyro_x", "gyro_y", "girozz", "note"]
    found, _ = understand(headers, None, IMU_SCHEMA)
    with pytest.raises(InputError, match="gyro_z_rad_s") as caught:
        require(found, ("time", "gyro_z"), _table(headers), IMU_SCHEMA)
    assert "--columns gyro_z=girozz" in caught.value.fix
    assert "note" in caught.value.why


def test_roll_pitch_heading_of_a_reference():
    found, _ = understand(["roll", "pitch_deg", "yaw(rad)"], None, REFERENCE_SCHEMA)
    assert [found[key].unit for key in ("roll", "pitch", "heading")] == [None, "deg", "rad"]
