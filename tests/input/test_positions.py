from __future__ import annotations

import numpy as np
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.findings import Code, Severity
from insnav.input import read_gps, read_reference
from insnav.messages import sentence
from tests.input.files import GPS_HEADER, IMU_HEADER, fixes, noted, rolling, write
from tests.refusals import refused

ROWS = fixes()
NAMES = GPS_HEADER.split(",")


def _gps(tmp_path, rows=ROWS, header=GPS_HEADER, **options):
    return read_gps(write(tmp_path / "gps.csv", rows, header), **options)


def _with(column: str, row: int | slice, value: float) -> np.ndarray:
    rows = ROWS.copy()
    rows[row, NAMES.index(column)] = value
    return rows


def test_canonical_columns(tmp_path):
    data = _gps(tmp_path).data
    np.testing.assert_allclose(data.time, ROWS[:, 0])
    np.testing.assert_allclose(np.degrees(data.lla[:, :2]), ROWS[:, 1:3], atol=1e-9)
    np.testing.assert_allclose(data.lla[:, 2], 500.0)
    np.testing.assert_allclose(data.v_n, ROWS[:, 4:7])
    np.testing.assert_allclose(data.position_sd, ROWS[:, 7:10])
    assert np.isnan(data.velocity_sd).all()
    assert data.fix is None
    assert data.heading is None


def test_order_of_columns_does_not_matter(tmp_path):
    order = np.random.default_rng(2).permutation(len(NAMES))
    data = _gps(tmp_path, ROWS[:, order], ",".join(NAMES[i] for i in order)).data
    np.testing.assert_array_equal(data.lla, _gps(tmp_path).data.lla)


def test_positions_in_radians_by_name(tmp_path):
    rows = ROWS.copy()
    rows[:, 1:3] = np.radians(rows[:, 1:3])
    data = _gps(tmp_path, rows, GPS_HEADER.replace("_deg", "_rad")).data
    np.testing.assert_allclose(data.lla[:, :2], rows[:, 1:3], atol=1e-9)


def test_positions_in_radians_are_known_by_their_velocity(tmp_path):
    rows = fixes(60)
    rows[:, 1:3] = np.radians(rows[:, 1:3])
    reading = _gps(tmp_path, rows, "time,lat,lon,alt,vn,ve,vd,sd_n,sd_e,sd_d")
    np.testing.assert_allclose(reading.data.lla[:, :2], rows[:, 1:3], atol=1e-8)
    assert [each["unit"] for each in noted(reading, Code.READ_ANGLES_BY_VELOCITY)] == ["rad"]


def test_positions_that_may_be_degrees_or_radians_are_refused(tmp_path):
    rows = fixes(60)[:, :4]
    rows[:, 1:3] = np.radians(rows[:, 1:3])
    with refused(InputError, "input.angle_unit_unclear"):
        _gps(tmp_path, rows, "time,lat,lon,alt")
    with refused(InputError, "input.positions_in_radians"):
        _gps(tmp_path, np.column_stack([rows, fixes(60)[:, 4:]]), "time,lat_deg,lon_deg,alt,vn,ve,vd,sd_n,sd_e,sd_d")


@pytest.mark.parametrize(("column", "name"), [(1, "latitudes"), (2, "longitudes")])
def test_one_angle_in_radians_beside_the_other_in_degrees_is_refused(tmp_path, column, name):
    """Longitudes so navigated to a solution 846 km off, without a warning."""
    rows = fixes(60)
    rows[:, 2] = 11.0 + 2e-5 * (rows[:, 0] - rows[0, 0])
    rows[:, 5] = 1.48
    rows[:, column] = np.radians(rows[:, column])
    with refused(InputError, "input.column_in_radians"):
        _gps(tmp_path, rows, "time,lat_deg,lon_deg,alt,vn,ve,vd,sd_n,sd_e,sd_d")


def test_degrees_near_the_origin_are_accepted(tmp_path):
    rows = fixes(60)
    rows[:, 1] -= 47.5
    rows[:, 2] = 0.3
    reading = _gps(tmp_path, rows, "time,lat,lon,alt,vn,ve,vd,sd_n,sd_e,sd_d")
    assert [each["unit"] for each in noted(reading, Code.READ_ANGLES_BY_VELOCITY)] == ["deg"]


def test_velocity_up_changes_its_sign(tmp_path):
    data = _gps(tmp_path, header=GPS_HEADER.replace("vd_m_s", "vu_m_s")).data
    np.testing.assert_allclose(data.v_n[:, 2], 0.2)


def test_longitude_goes_from_minus_180_to_180(tmp_path):
    rows = ROWS.copy()
    rows[:, 2] = np.linspace(179.9, 180.1, len(rows))
    data = _gps(tmp_path, rows).data
    expected = np.where(rows[:, 2] < 180.0, rows[:, 2], rows[:, 2] - 360.0)
    np.testing.assert_allclose(np.degrees(data.lla[:, 1]), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("column", "value"), [("lat_deg", 90.001), ("lat_deg", -91), ("lon_deg", 361), ("height_m", 5e5)]
)
def test_impossible_places_are_refused_naming_the_cell(tmp_path, column, value):
    with pytest.raises(InputError) as caught:
        _gps(tmp_path, _with(column, 7, value))
    assert caught.value.where.endswith(f"gps.csv:9:{column}")


def test_the_poles_are_possible(tmp_path):
    assert np.degrees(_gps(tmp_path, _with("lat_deg", slice(None), 90.0)).data.lla[0, 0]) == pytest.approx(90.0)


@pytest.mark.parametrize("column", ["sd_n_m", "sd_d_m"])
@pytest.mark.parametrize(
    ("rows", "value", "first", "code"),
    [(4, -1.0, 6, "input.bad_sd"), (slice(None), 0.0, 2, "input.zero_sd")],
)
def test_standard_deviations_must_be_positive(tmp_path, column, rows, value, first, code):
    with refused(InputError, code) as caught:
        _gps(tmp_path, _with(column, rows, value))
    assert caught.value.where.endswith(f"gps.csv:{first}:{column}")
    assert caught.value.values["column"] == column


def test_standard_deviations_rounded_to_zero_are_raised_to_the_smallest_of_their_column(tmp_path):
    rows = _with("sd_e_m", 3, 0.0)
    east = rows[:, NAMES.index("sd_e_m")]
    least = east[east > 0.0].min()
    reading = _gps(tmp_path, rows)
    assert reading.data.position_sd[3, 1] == least
    assert (reading.data.position_sd[[0, 1, 2], 1] > 0.0).all()
    (raised,) = noted(reading, Code.READ_SD_RAISED)
    assert (raised.subject, raised["count"], raised["sd_m"]) == ("sd_e_m", 1, least)


def test_empty_standard_deviation_and_velocity_are_not_known(tmp_path):
    rows = _with("sd_e_m", 3, np.nan)
    rows[8, 4:7] = np.nan
    reading = _gps(tmp_path, rows)
    assert np.isnan(reading.data.position_sd[3, 1])
    assert np.isnan(reading.data.v_n[8]).all()
    assert np.isfinite(reading.data.lla).all()
    assert reading.events == ()


def test_fixes_without_a_position_are_skipped(tmp_path):
    rows = _with("lon_deg", slice(3, 5), np.nan)
    rows[10, 3] = np.nan
    rows[20, 1:4] = 0.0
    reading = _gps(tmp_path, rows)
    assert {(each.code, each.subject) for each in reading.events} == {(Code.ROWS_NO_POSITION, "gps")}
    assert [each["count"] for each in reading.events] == [2, 1, 1]
    assert reading.facts.n_used == 26


def test_zero_zero_all_along_is_no_position(tmp_path):
    rows = ROWS.copy()
    rows[:, 1:3] = 0.0
    with refused(InputError, "columns.too_few_usable"):
        _gps(tmp_path, rows)


def test_zero_zero_is_a_place_when_others_are_near(tmp_path):
    rows = ROWS.copy()
    rows[:, 1] -= 48.0
    rows[:, 2] = 0.0
    assert _gps(tmp_path, rows).facts.n_used == 30


def test_fix_and_heading(tmp_path):
    rows = np.column_stack([ROWS[:, :4], np.tile([1.0, 2.0, np.nan], 10), np.linspace(-20, 350, 30)])
    rows[4, :] = [104.0, 0.0, 0.0, 0.0, 0.0, np.nan]
    reading = _gps(tmp_path, rows, "time_s,lat_deg,lon_deg,height_m,fix,heading_deg")
    data = reading.data
    np.testing.assert_array_equal(data.fix[:5], [1, 2, -1, 1, -1])
    assert data.fix.dtype == np.int64
    np.testing.assert_allclose(np.degrees(data.heading[0]), 340.0, atol=1e-9)
    assert (data.heading < 2 * np.pi).all()
    assert reading.facts.n_used == 29


@pytest.mark.parametrize(
    ("name", "option", "kind"),
    [
        ("alt", None, "ellipsoidal"),
        ("alt", "msl", "msl"),
        ("hMSL", None, "msl"),
        ("height", "ellipsoidal", "ellipsoidal"),
    ],
)
def test_what_heights_are_is_said(tmp_path, name, option, kind):
    reading = _gps(tmp_path, header=GPS_HEADER.replace("height_m", name), height=option)
    assert reading.facts.height == kind
    ellipsoidal = Code.READ_HEIGHT_ELLIPSOIDAL if option else Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED
    (height,) = noted(reading, Code.READ_HEIGHT_MSL, Code.READ_HEIGHT_ELLIPSOIDAL, Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED)
    assert height.code == (Code.READ_HEIGHT_MSL if kind == "msl" else ellipsoidal)
    assert (height.severity is Severity.NOTE) == (height.code is Code.READ_HEIGHT_ELLIPSOIDAL)


def test_only_fixes_have_an_option_for_their_heights(tmp_path):
    path = write(tmp_path / "log.csv", ROWS, GPS_HEADER.replace("height_m", "alt"))
    for read, named in ((read_gps, True), (read_reference, False)):
        (height,) = noted(read(path), Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED)
        assert ("--gps-height" in sentence(height)) == named


def test_of_two_heights_the_right_one_is_taken(tmp_path):
    rows = np.column_stack([ROWS[:, :4], ROWS[:, 3] - 47.0])
    header = "time,lat,lon,height,hMSL"
    np.testing.assert_allclose(_gps(tmp_path, rows, header).data.lla[:, 2], 500.0)
    np.testing.assert_allclose(_gps(tmp_path, rows, header, height="msl").data.lla[:, 2], 453.0)


def test_files_given_in_the_wrong_place_are_recognised(tmp_path):
    from insnav.input import read_imu

    with refused(InputError, "columns.missing") as caught:
        _gps(tmp_path, rolling(50), IMU_HEADER)
    assert caught.value.values["hint"] == "imu_as_positions"
    with refused(InputError, "columns.missing") as caught:
        read_imu(write(tmp_path / "gps.csv", ROWS, GPS_HEADER))
    assert caught.value.values["hint"] == "positions_as_imu"


def test_gps_time_of_milliseconds(tmp_path):
    rows = ROWS.copy()
    rows[:, 0] *= 1e3
    data = _gps(tmp_path, rows, GPS_HEADER.replace("time_s", "time")).data
    np.testing.assert_allclose(data.time, ROWS[:, 0])


def test_reference(tmp_path):
    header = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,roll_deg,pitch_deg,heading_deg,fix"
    rows = np.column_stack([ROWS[:, :7], np.tile([2.0, -3.0, -10.0, 1.0], (30, 1))])
    rows[4, 7:10] = np.nan
    reading = read_reference(write(tmp_path / "ref.csv", rows, header))
    np.testing.assert_allclose(np.degrees(reading.data.rph[0]), [2.0, -3.0, 350.0])
    assert np.isnan(reading.data.rph[4]).all()
    np.testing.assert_allclose(reading.data.v_n, rows[:, 4:7])
    np.testing.assert_array_equal(reading.fix, np.ones(30))


def test_what_is_zero_in_all_rows_of_a_moving_reference_is_not_given(tmp_path):
    """Programs write zeros for what they do not know: the errors were those of velocities of 40 m/s."""
    header = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,roll_deg,pitch_deg,heading_deg"
    way, zeros = np.arange(30.0), np.zeros((30, 6))
    moving = np.column_stack([way, 45.0 + 1e-4 * way, 7.0 + 1e-4 * way, 100.0 + way, zeros])
    reading = read_reference(write(tmp_path / "moving.csv", moving, header))
    assert np.isnan(reading.data.v_n).all()
    assert np.isnan(reading.data.rph).all()
    (unknown,) = noted(reading, Code.READ_COLUMNS_ZERO_IN_MOTION)
    assert unknown.severity is Severity.ASSUMPTION
    assert unknown["columns"] == ("vn", "ve", "vd", "heading", "roll", "pitch")
    level = moving.copy()
    level[:, 3], level[:, 4] = 100.0, 11.1
    level[:, 2] = 7.0  # straight north on a plain, all that may be zero
    reading = read_reference(write(tmp_path / "level.csv", level, header))
    assert np.isfinite(reading.data.v_n).all()
    assert np.isfinite(reading.data.rph).all()
    still = np.column_stack([way, np.tile([45.0, 7.0, 100.0], (30, 1)), zeros])
    assert np.isfinite(read_reference(write(tmp_path / "still.csv", still, header)).data.v_n).all()


def test_reference_of_two_rows_and_without_attitude(tmp_path):
    reading = read_reference(write(tmp_path / "ref.csv", ROWS[[0, 29], :4], "time,lat,lon,alt"))
    np.testing.assert_allclose(reading.data.time, [100.0, 129.0])
    assert np.isnan(reading.data.rph).all()
    assert reading.fix is None


@pytest.mark.parametrize("headers", ["#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]", "time,px,py,pz"])
def test_positions_in_a_room_are_named_as_such(tmp_path, headers):
    path = tmp_path / "data.csv"
    path.write_text("\n".join([headers, *(f"{i}000000000,1.{i},2.0,3.0" for i in range(9)), ""]))
    with refused(InputError, "input.local_positions"):
        read_gps(path)


def test_exchanged_angles_are_no_degrees_and_minutes(tmp_path):
    west = ROWS.copy()
    west[:, 1], west[:, 2] = -105.1 + 0.001 * np.arange(len(west)), 40.1  # both would be ddmm.mmmm
    for rows in (west, west[:, [0, 1, 2, 3]]):
        with refused(InputError, "input.exchanged_by_value") as caught:
            _gps(tmp_path, rows, ",".join(NAMES[: rows.shape[1]]))
        columns = caught.value.gives["columns"]
        assert columns == {"lat": NAMES[2], "lon": NAMES[1]}
        assert len(_gps(tmp_path, west[:, :4], ",".join(NAMES[:4]), columns=columns).data.time) == len(west)


def test_fixes_that_a_log_repeats_are_used_once(tmp_path):
    once = fixes(60)
    held = np.repeat(once, 10, axis=0)
    held[:, 0] = once[0, 0] + 0.1 * np.arange(len(held))
    reading = _gps(tmp_path, held)
    np.testing.assert_allclose(reading.data.time, held[::10, 0], atol=1e-6)
    np.testing.assert_array_equal(reading.data.lla, _gps(tmp_path, once).data.lla)
    assert reading.facts.rate_hz == pytest.approx(1.0)
    (repeated,) = reading.events
    assert repeated.code is Code.ROWS_REPEATED
    assert repeated.severity is Severity.ASSUMPTION
    assert (repeated["count"], repeated["rows"], repeated.begin) == (540, 600, pytest.approx(held[1, 0]))


def test_fixes_that_a_log_with_holes_repeats_are_used_once(tmp_path):
    twice = np.repeat(fixes(300), 2, axis=0)
    twice[:, 0] = twice[0, 0] + 0.5 * np.arange(len(twice))
    left = np.random.default_rng(3).random(len(twice)) > 0.2
    assert len(_gps(tmp_path, twice[left]).data.time) == len(np.unique(twice[left, 1]))


def test_positions_that_repeat_at_rest_are_all_used(tmp_path):
    rows = fixes(120)
    rows[:60, 1:4] = rows[0, 1:4]  # of few digits, before the drive
    assert len(_gps(tmp_path, rows).data.time) == 120


def test_what_loggers_write_for_not_known_is_not_known(tmp_path):
    """Fix types that are all 0, and no heights at all; each was refused."""
    rows = "time,lat,lon,fix,nsat\n" + "".join(f"{t},48.0,{11.0 + 1e-4 * t},0,9\n" for t in range(20))
    (tmp_path / "flat.csv").write_text(rows)
    flat = read_gps(tmp_path / "flat.csv")
    assert flat.data.fix is None
    assert not flat.data.lla[:, 2].any()
    (no_heights, no_types) = noted(flat, Code.READ_HEIGHT_MISSING, Code.READ_COLUMNS_FIX_ZERO)
    assert (no_heights.subject, no_types.subject) == ("gps", "fix")
    (tmp_path / "other.csv").write_text(rows.replace("fix", "elevation2"))
    with refused(InputError, "columns.missing"):
        read_gps(tmp_path / "other.csv")
    (tmp_path / "tow.csv").write_text(rows.replace("nsat", "gps_tow"))
    assert not read_gps(tmp_path / "tow.csv").data.lla[:, 2].any()


def test_fixes_in_the_rows_of_the_samples_need_no_gps_file(tmp_path):
    """They were said not to be there."""
    drive = insnav.simulate("bends", imu="automotive", gps="single", seed=3, rate=20.0)
    imu, gps = drive.imu.data, drive.gps.data
    row = np.maximum(np.searchsorted(gps.time, imu.time, side="right") - 1, 0)
    place = np.column_stack([np.rad2deg(gps.lla[row, :2]), gps.lla[row, 2]])
    rows = np.column_stack([imu.time, imu.gyro, imu.accel, place])
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,lat_deg,lon_deg,height_m"
    np.savetxt(tmp_path / "merged.csv", rows, delimiter=",", header=header, comments="", fmt="%.10f")
    found = insnav.load(tmp_path / "merged.csv")
    assert found.gps is not None
    assert abs(len(found.gps.data.time) - len(gps.time)) < 3
    rows[:, 7] += 1e-9 * np.arange(len(rows))
    np.savetxt(tmp_path / "solved.csv", rows, delimiter=",", header=header, comments="", fmt="%.10f")
    assert insnav.load(tmp_path / "solved.csv").gps is None  # new in every row: a solution
