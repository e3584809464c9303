from __future__ import annotations

import itertools

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Severity
from insnav.input import read_imu
from insnav.input.interpret.physics import axes_matrix, course_of, heading_convention, turns_with_course
from insnav.input.readers.imu import parse_units
from tests.input.files import IMU_HEADER, G, noted, rolling, write
from tests.refusals import refused

PLAIN = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
TRUTH = rolling()


def _scaled(gyro: float = 1.0, accel: float = 1.0, time: float = 1.0) -> np.ndarray:
    rows = TRUTH.copy()
    rows[:, 0] *= time
    rows[:, 1:4] *= gyro
    rows[:, 4:7] *= accel
    return rows


def _check(data):
    np.testing.assert_allclose(data.time, TRUTH[:, 0], atol=2e-9)
    np.testing.assert_allclose(data.gyro, TRUTH[:, 1:4], atol=2e-9)
    np.testing.assert_allclose(data.accel, TRUTH[:, 4:7], atol=2e-8)


DEG = np.pi / 180
MIXES = {
    "rad/s and m/s^2": (1.0, 1.0),
    "deg/s and m/s^2": (1 / DEG, 1.0),
    "rad/s and g": (1.0, 1 / 9.80665),
    "deg/s and g": (1 / DEG, 1 / 9.80665),
    "rad/s and mg": (1.0, 1e3 / 9.80665),
    "deg/s and mg": (1 / DEG, 1e3 / 9.80665),
    "rad/s and ft/s^2": (1.0, 1 / 0.3048),
    "deg/s and mm/s^2": (1 / DEG, 1e3),
}


@pytest.mark.parametrize(("gyro", "accel"), MIXES.values(), ids=MIXES.keys())
def test_units_are_found_without_options_and_said(tmp_path, gyro, accel):
    reading = read_imu(write(tmp_path / "a.csv", _scaled(gyro, accel), PLAIN))
    _check(reading.data)
    (of_gyros,) = noted(reading, Code.UNITS_GYRO, Code.UNITS_GYRO_BY_RATE)
    assert of_gyros["unit"] == ("rad/s" if gyro == 1.0 else "deg/s")
    (of_accelerometers,) = noted(reading, Code.UNITS_ACCEL)
    assert of_accelerometers["gravity_m_s2"] == pytest.approx(9.8, abs=0.2)


@pytest.mark.parametrize("mix", list(MIXES)[1:])
def test_units_that_contradict_physics_are_refused_with_the_guess(tmp_path, mix):
    of_gyros, of_accelerometers = mix.split(" and ")
    code, unit = ("gyro_unit", of_gyros) if of_accelerometers == "m/s^2" else ("accel_unit", of_accelerometers)
    with refused(InputError, f"columns.{code}") as caught:
        read_imu(write(tmp_path / "a.csv", _scaled(*MIXES[mix]), IMU_HEADER))
    assert caught.value.values["unit"] == unit


@pytest.mark.parametrize(
    ("header", "gyro", "accel", "time"),
    [
        ("time_ms,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", 1 / DEG, 1 / 9.80665, 1e3),
        ("t[us],gyro_x[deg/h],gyro_y[deg/h],gyro_z[deg/h],ax,ay,az", 3600 / DEG, 1.0, 1e6),
        ("timestamp_ns,wx,wy,wz,acc_x (mg),acc_y (mg),acc_z (mg)", 1.0, 1e3 / 9.80665, 1e9),
    ],
)
def test_units_in_headers(tmp_path, header, gyro, accel, time):
    _check(read_imu(write(tmp_path / "a.csv", _scaled(gyro, accel, time), header)).data)


@pytest.mark.parametrize("unit", [1e3, 1e6, 1e9])
def test_unit_of_a_bare_time_is_found(tmp_path, unit):
    _check(read_imu(write(tmp_path / "a.csv", _scaled(time=unit), PLAIN)).data)
    with refused(InputError, "columns.time_unit"):
        read_imu(write(tmp_path / "a.csv", _scaled(time=unit), IMU_HEADER))


@pytest.mark.parametrize(
    "units", ["gyro=deg/s,accel=g", "deg/s, g", {"gyro": "dps", "accel": "G"}, "accel=g; gyro=°/s"]
)
def test_units_given_by_the_user(tmp_path, units):
    _check(read_imu(write(tmp_path / "a.csv", _scaled(1 / DEG, 1 / 9.80665), IMU_HEADER), units=units).data)


@pytest.mark.parametrize("units", ["furlong", "gyro=g", {"accel": "deg/s"}, "speed=m/s", "deg/s,rad/s"])
def test_units_that_are_none(units):
    with pytest.raises(ConfigError):
        parse_units(units)


def test_increments_of_the_gyro_alone_contradict_forces_with_a_unit(tmp_path):
    """The forces became increments, too, and lost their unit."""
    with refused(ConfigError, "input.rates_as_increments"):
        read_imu(write(tmp_path / "a.csv", _scaled(1 / DEG), IMU_HEADER), units="gyro=deg")


def test_no_gravity_at_all_is_refused(tmp_path):
    rows = _scaled(accel=5000.0)
    for header in (PLAIN, IMU_HEADER):
        with refused(InputError, "columns.no_gravity"):
            read_imu(write(tmp_path / "a.csv", rows, header))


def test_motion_that_tells_nothing_is_an_assumption(tmp_path):
    rows = TRUTH.copy()
    rows[:, 1:4] = np.random.default_rng(0).normal(0, 1e-3, (len(rows), 3))
    rows[:, 4:7] = np.random.default_rng(1).normal([0.0, 0.0, -G], 1e-2, (len(rows), 3))
    (assumed,) = noted(read_imu(write(tmp_path / "a.csv", rows, PLAIN)), Code.UNITS_GYRO_ASSUMED)
    assert assumed["unit"] == "rad/s"
    assert assumed.severity is Severity.ASSUMPTION


def test_gyros_that_turn_the_wrong_way_are_told(tmp_path):
    (wrong,) = noted(read_imu(write(tmp_path / "a.csv", _scaled(gyro=-1.0), PLAIN)), Code.UNITS_GYRO_WRONG_WAY)
    assert wrong.severity is Severity.WARNING
    assert wrong["correlation"] < -0.9


INCREMENTS = "time_s,dtheta_x_rad,dtheta_y_rad,dtheta_z_rad,dvel_x_m_s,dvel_y_m_s,dvel_z_m_s"


def test_increments_are_known_by_name(tmp_path):
    reading = read_imu(write(tmp_path / "a.csv", _scaled(0.01, 0.01), INCREMENTS))
    assert reading.data.sampling == reading.facts.sampling == "increment"
    np.testing.assert_allclose(reading.data.gyro, 0.01 * TRUTH[:, 1:4], atol=1e-9)
    np.testing.assert_allclose(reading.data.accel, 0.01 * TRUTH[:, 4:7], atol=1e-9)


def test_increments_in_degrees(tmp_path):
    header = "time_s,dtheta_x_deg,dtheta_y_deg,dtheta_z_deg,dvel_x,dvel_y,dvel_z"
    reading = read_imu(write(tmp_path / "a.csv", _scaled(0.01 / DEG, 0.01), header))
    np.testing.assert_allclose(reading.data.gyro, 0.01 * TRUTH[:, 1:4], atol=1e-9)


def test_bare_increments_are_refused_until_told(tmp_path):
    path = write(tmp_path / "a.csv", _scaled(0.01, 0.01), PLAIN)
    with refused(InputError, "columns.accel_increments"):
        read_imu(path)
    for options in ({"sampling": "increment"}, {"units": "gyro=rad,accel=m/s"}):
        data = read_imu(path, **options).data
        assert data.sampling == "increment"
        np.testing.assert_allclose(data.accel, 0.01 * TRUTH[:, 4:7], atol=1e-9)


def test_rates_named_as_increments_are_refused(tmp_path):
    with refused(InputError, "columns.accel_rates"):
        read_imu(write(tmp_path / "a.csv", TRUTH, INCREMENTS))


def test_units_of_increments_for_rates_in_g_are_refused(tmp_path):
    rates = TRUTH.copy()
    rates[:, 4:7] /= 9.80665
    with refused(InputError, "columns.accel_rates"):
        read_imu(write(tmp_path / "a.csv", rates, PLAIN), units="deg")
    rates[:, 4:7] *= 30.0
    with refused(InputError, "columns.no_gravity") as caught:
        read_imu(write(tmp_path / "b.csv", rates, PLAIN), units="deg")
    assert dict(caught.value.values)["shown"] == pytest.approx(30.0, rel=0.02)  # as in the file


def test_sampling_that_contradicts_the_columns_is_refused(tmp_path):
    increments = write(tmp_path / "a.csv", _scaled(0.01, 0.01), INCREMENTS)
    rates = write(tmp_path / "b.csv", TRUTH, IMU_HEADER)
    for path, options in (
        (increments, {"sampling": "mean"}),
        (rates, {"sampling": "increment"}),
        (increments, {"units": "gyro=deg/s"}),
        (rates, {"units": "gyro=deg", "sampling": "mean"}),
    ):
        with pytest.raises(ConfigError):
            read_imu(path, **options)


def test_rates_and_increments_do_not_mix(tmp_path):
    header = "time_s,dtheta_x,dtheta_y,dtheta_z,accel_x,accel_y,accel_z"
    with refused(InputError, "input.rates_and_increments"):
        read_imu(write(tmp_path / "a.csv", TRUTH, header))


def test_sampling_and_stamp_are_said(tmp_path):
    path = write(tmp_path / "a.csv", TRUTH, IMU_HEADER)
    reading = read_imu(path)
    assert (reading.data.sampling, reading.data.stamp) == ("mean", "end")
    (assumed,) = noted(reading, Code.READ_IMU_SAMPLING, Code.READ_IMU_SAMPLING_ASSUMED)
    assert assumed.severity is Severity.ASSUMPTION
    assert (assumed["sampling"], assumed["stamp"]) == ("mean", "end")
    assert assumed["options"] == ("--imu-sampling", "--imu-stamp")
    reading = read_imu(path, sampling="instant", stamp="mid")
    assert (reading.data.sampling, reading.data.stamp) == ("instant", "mid")
    (given,) = noted(reading, Code.READ_IMU_SAMPLING, Code.READ_IMU_SAMPLING_ASSUMED)
    assert given.severity is Severity.NOTE
    assert given["sampling"] == "instant"


# What a sensor with these axes reads when the body reads (f, r, d): written out by hand.
BY_HAND = {
    "FRD": lambda f, r, d: (f, r, d),
    "FLU": lambda f, r, d: (f, -r, -d),
    "RFU": lambda f, r, d: (r, f, -d),
    "BLD": lambda f, r, d: (-f, -r, d),
    "DRB": lambda f, r, d: (d, r, -f),
    "UFL": lambda f, r, d: (-d, f, -r),
}


@pytest.mark.parametrize("axes", BY_HAND)
def test_axes_bring_data_to_forward_right_down(tmp_path, axes):
    rows = TRUTH.copy()
    for start in (1, 4):
        rows[:, start : start + 3] = np.column_stack(BY_HAND[axes](*TRUTH[:, start : start + 3].T))
    reading = read_imu(write(tmp_path / "a.csv", rows, IMU_HEADER), axes=axes.lower())
    _check(reading.data)
    assert reading.facts.axes == axes


def test_there_are_24_right_handed_axes_and_all_are_rotations():
    found = 0
    for letters in itertools.permutations("FBRLDU", 3):
        try:
            matrix = axes_matrix("".join(letters))
        except ConfigError:
            continue
        found += 1
        np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
        np.testing.assert_array_equal(np.cross(matrix[:, 0], matrix[:, 1]), matrix[:, 2])
    assert found == 24


@pytest.mark.parametrize(
    ("axes", "code"), [("FRU", "left_handed"), ("FFD", "twice"), ("XYZ", "unknown"), ("FR", "unknown")]
)
def test_axes_that_are_none(axes, code):
    with refused(ConfigError, f"columns.axes_{code}"):
        axes_matrix(axes)


def test_z_up_is_refused_with_the_option_that_mends_it(tmp_path):
    rows = TRUTH.copy()
    rows[:, [2, 3, 5, 6]] *= -1.0
    path = write(tmp_path / "a.csv", rows, IMU_HEADER)
    with refused(InputError, "columns.axes_flu"):
        read_imu(path)
    _check(read_imu(path, axes="FLU").data)
    upside_down = read_imu(path, axes="FRD")
    np.testing.assert_allclose(upside_down.data.accel, rows[:, 4:7], atol=1e-9)


def test_gravity_on_another_axis_is_a_note(tmp_path):
    rows = TRUTH[:, [0, 3, 2, 1, 6, 5, 4]] * [1, 1, 1, -1, 1, 1, -1]
    reading = read_imu(write(tmp_path / "a.csv", rows, IMU_HEADER))
    (axes,) = noted(reading, Code.AXES_ASSUMED)
    assert (axes["axis"], axes["way"]) == ("x", "down")
    assert axes["direction"] == pytest.approx((-1.0, 0.0, 0.0), abs=0.2)


def test_gyros_under_the_names_of_accelerometers_are_asked_for(tmp_path):
    time = 0.01 * np.arange(3000)
    turning, force = 0.002 * np.sin(time), np.full_like(time, -9.81)
    table = np.column_stack([time, turning, turning, force, turning, turning, turning])
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    np.savetxt(tmp_path / "imu.csv", table, fmt="%.6f", delimiter=",", header=header, comments="")
    with refused(InputError, "columns.gyros_as_accel"):
        read_imu(tmp_path / "imu.csv")


@pytest.mark.parametrize(
    ("bias", "unit", "code"), [(1.2, "deg/s", Code.UNITS_GYRO_STILL), (0.02, "rad/s", Code.UNITS_GYRO_ASSUMED)]
)
def test_a_rate_that_gravity_does_not_follow_is_a_bias_of_gyros_in_degrees(tmp_path, bias, unit, code):
    """Gyros of a static record in deg/s without a unit were read in rad/s: all their noise was 57.3 times too large."""
    rng, n = np.random.default_rng(4), 3000
    gyro = np.array([0.4, -bias, 0.1]) + 0.04 * rng.standard_normal((n, 3))
    gyro[:, 0] *= bias / 1.2
    accel = np.array([0.05, -0.1, -9.8]) + 0.01 * rng.standard_normal((n, 3))
    reading = read_imu(write(tmp_path / "a.csv", np.column_stack([np.arange(n) / 50.0, gyro, accel]), PLAIN))
    (found,) = noted(reading, code)
    assert found["unit"] == unit
    size = DEG if unit == "deg/s" else 1.0
    np.testing.assert_allclose(reading.data.gyro.std(axis=0)[1:], 0.04 * size, rtol=0.1)


@pytest.mark.parametrize(("gyro_sign", "accel_sign", "way"), [(1, 1, 1.0), (1, -1, -1.0), (-1, 1, -1.0)])
def test_turns_of_the_course_tell_a_sign(gyro_sign, accel_sign, way):
    time = np.arange(0.0, 120.0, 0.02)
    rate = 0.2 * np.sin(0.3 * time)  # clockwise
    noise = np.random.default_rng(2).normal(size=(len(time), 6))
    gyro = gyro_sign * (np.outer(rate, [0.0, 0.0, 1.0]) + 0.02 * noise[:, :3])
    accel = accel_sign * (np.array([0.0, 0.0, -9.8]) + 0.3 * noise[:, 3:])
    fixes = np.arange(1.0, 119.0)
    course = np.interp(fixes - 0.8, time, np.cumsum(rate) * 0.02)  # late
    v_n = 10.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros_like(course)])
    assert turns_with_course(time, gyro, accel, fixes, course_of(v_n)) == pytest.approx(way, abs=0.1)
    straight = np.tile([10.0, 0.0, 0.0], (len(fixes), 1))
    assert turns_with_course(time, gyro, accel, fixes, course_of(straight)) == 0.0
    assert turns_with_course(time, gyro, accel, fixes, course_of(0.1 * v_n)) == 0.0


@pytest.mark.parametrize(("sense", "offset"), [(1.0, 0.0), (-1.0, -90.0), (1.0, 90.0), (1.0, 35.0), (1.0, 4.0)])
def test_headings_have_their_sense_and_offset(sense, offset):
    course = np.linspace(0.0, 5.0, 60)
    v_n = 10.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros_like(course)])
    heading = sense * (course + offset * DEG)
    wanted = 0.0 if offset == 4.0 else offset * DEG  # slip makes as much
    assert heading_convention(sense, heading, v_n) == pytest.approx((sense, wanted))
    assert heading_convention(sense, heading, 0.1 * v_n) == pytest.approx((sense, 0.0 if sense > 0 else -90.0 * DEG))
