from __future__ import annotations

import json

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, Severity
from insnav.input import read_gps, read_imu
from tests.input.files import GPS_HEADER, IMU_HEADER, as_text, fixes, noted, rolling, write
from tests.refusals import refused
from tests.reversed_messages import as_shown

ROWS = rolling(1000)


def _read(tmp_path, rows, header=IMU_HEADER):
    return read_imu(write(tmp_path / "imu.csv", rows, header))


def _codes(reading):
    return [event.code for event in reading.events]


def _same(reading, rows):
    np.testing.assert_allclose(reading.data.time, rows[:, 0], atol=1e-9)
    np.testing.assert_allclose(reading.data.gyro, rows[:, 1:4], atol=1e-9)
    np.testing.assert_allclose(reading.data.accel, rows[:, 4:7], atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_rows_without_finite_numbers_are_left_out_run_by_run(tmp_path, value):
    rows = ROWS.copy()
    rows[100, 2] = rows[101, 6] = rows[500, 1] = rows[999, 4] = value
    reading = _read(tmp_path, rows)
    _same(reading, np.delete(ROWS, [100, 101, 500, 999], axis=0))
    assert _codes(reading) == [Code.ROWS_NAN] * 3
    assert [event["count"] for event in reading.events] == [2, 1, 1]
    assert {event.subject for event in reading.events} == {"imu"}
    assert reading.events[0].begin == pytest.approx(ROWS[100, 0])
    assert (reading.facts.n_rows, reading.facts.n_used) == (1000, 996)


def test_rows_without_a_time_are_left_out(tmp_path):
    rows = ROWS.copy()
    rows[0, 0] = rows[300, 0] = np.nan
    reading = _read(tmp_path, rows)
    _same(reading, np.delete(ROWS, [0, 300], axis=0))
    assert all(np.isfinite(event.begin) for event in reading.events)


def test_an_empty_column_is_named(tmp_path):
    rows = ROWS.copy()
    rows[:, 5] = np.nan
    with refused(InputError, "input.empty_column"):
        _read(tmp_path, rows)


def test_a_few_late_rows_are_sorted(tmp_path):
    rows = ROWS.copy()
    rows[[200, 203]] = rows[[203, 200]]
    reading = _read(tmp_path, rows)
    _same(reading, ROWS)
    assert _codes(reading) == [Code.ROWS_UNSORTED]
    assert reading.events[0]["count"] == 3  # rows 201, 202 and 200 come after a later one
    assert reading.events[0]["late_s"] == pytest.approx(0.03)


def test_disorder_is_refused(tmp_path):
    rows = np.random.default_rng(3).permutation(ROWS)
    with refused(InputError, "columns.disorder") as caught:
        _read(tmp_path, rows)
    first = int(np.flatnonzero(np.diff(rows[:, 0]) < 0)[0]) + 1
    assert caught.value.where.endswith(f"imu.csv:{first + 2}")


def test_a_file_that_runs_backwards_is_called_that(tmp_path):
    with refused(InputError, "columns.backwards"):
        _read(tmp_path, ROWS[::-1])
    for seed in range(6):
        with pytest.raises(InputError) as shuffled:
            _read(tmp_path, np.random.default_rng(seed).permutation(ROWS))
        assert shuffled.value.code != "columns.backwards"


@pytest.mark.parametrize(("at", "back"), [(600, 300.0), (600, 2.0), (993, 50.0)])
def test_a_clock_set_back_is_refused_naming_the_row(tmp_path, at, back):
    rows = ROWS.copy()
    rows[at:, 0] -= back
    with refused(InputError, "columns.jump_back") as caught:
        _read(tmp_path, rows)
    assert caught.value.where.endswith(f"imu.csv:{at + 2}")


def test_a_clock_set_back_a_little_in_a_long_file_is_refused_too(tmp_path):
    """The rows of the second that comes twice are few, and yet nothing came late."""
    rows = np.tile(ROWS, (20, 1))
    rows[:, 0] = ROWS[0, 0] + 0.01 * np.arange(len(rows))
    rows[:, 1:] += 1e-3 * np.sin(np.arange(len(rows)))[:, None]
    rows[5000:, 0] -= 1.003
    with refused(InputError, "columns.jump_back") as caught:
        _read(tmp_path, rows)
    assert caught.value.where.endswith("imu.csv:5002")


def test_a_block_of_rows_twice_is_no_clock_set_back(tmp_path):
    _same(_read(tmp_path, np.vstack([ROWS[:500], ROWS[495:]])), ROWS)


def test_equal_rows_are_dropped_and_counted(tmp_path):
    rows = np.insert(ROWS, [50, 50, 700], ROWS[[49, 49, 699]], axis=0)
    reading = _read(tmp_path, rows)
    _same(reading, ROWS)
    assert _codes(reading) == [Code.ROWS_DUPLICATE]
    assert reading.events[0]["count"] == 3


def test_of_rows_with_one_time_the_first_is_kept(tmp_path):
    other = ROWS[[49]].copy()
    other[0, 4] += 1.0
    reading = _read(tmp_path, np.insert(ROWS, [50], other, axis=0))
    _same(reading, ROWS)
    assert _codes(reading) == [Code.ROWS_SAME_TIME]
    assert reading.events[0]["count"] == 1


def test_a_coarse_time_column_is_refused(tmp_path):
    rows = ROWS.copy()
    rows[:, 0] = np.floor(rows[:, 0] * 30.0) / 30.0
    with refused(InputError, "columns.coarse_time"):
        _read(tmp_path, rows)


@pytest.mark.parametrize(("missing", "event"), [(1, False), (5, False), (6, True), (200, True)])
def test_gaps_are_events_when_longer_than_five_samples(tmp_path, missing, event):
    rows = np.delete(ROWS, np.arange(300, 300 + missing), axis=0)
    reading = _read(tmp_path, rows)
    _same(reading, rows)
    assert reading.facts.n_gaps == event
    if event:
        assert _codes(reading) == [Code.ROWS_GAP]
        assert reading.events[0]["gap_s"] == pytest.approx((missing + 1) / 100.0)
        assert reading.events[0]["limit_s"] == pytest.approx(0.065)
        assert reading.events[0].begin == pytest.approx(ROWS[299, 0])
        assert reading.facts.longest_gap_s == pytest.approx((missing + 1) / 100.0)
        assert reading.events[0]["missing"] == missing
    else:
        assert [each["count"] for each in noted(reading, Code.ROWS_SHORT_GAPS)] == [1]


@pytest.mark.parametrize("period", [604800.0, 86400.0])
def test_the_end_of_the_week_or_day_is_unwrapped(tmp_path, period):
    rows = rolling(1000, start=period - 5.0)
    wrapped = rows.copy()
    wrapped[:, 0] %= period
    reading = _read(tmp_path, wrapped)
    _same(reading, rows)
    (restart,) = noted(reading, Code.TIME_RESTARTS)
    assert (restart["count"], restart["period_s"]) == (1, period)


def test_events_come_in_order_of_time(tmp_path):
    rows = np.delete(ROWS, np.arange(100, 150), axis=0)
    rows[500, 1] = rows[20, 1] = np.nan
    reading = _read(tmp_path, rows)
    times = [event.begin for event in reading.events]
    assert times == sorted(times)
    assert len(times) == 3


def test_a_barometer_that_never_changes_is_none(tmp_path):
    rows = np.column_stack([rolling(1000), np.zeros(1000)])
    reading = read_imu(write(tmp_path / "imu.csv", rows, f"{IMU_HEADER},baro_height_m"))
    assert reading.data.baro is None
    assert [each.subject for each in noted(reading, Code.READ_COLUMNS_CONSTANT)] == ["baro_height_m"]
    rows[:, 7] = 100.0 + 0.01 * np.arange(1000)
    assert read_imu(write(tmp_path / "imu.csv", rows, f"{IMU_HEADER},baro_height_m")).data.baro is not None


def test_temperature_and_odometer(tmp_path):
    header = IMU_HEADER + ",temp,wheel_speed_kmh"
    rows = np.column_stack([ROWS, 20.0 + 0.001 * np.arange(1000), np.full(1000, 36.0)])
    rows[10:20, 7] = np.nan
    rows[5, 8] = np.nan
    data = _read(tmp_path, rows, header).data
    np.testing.assert_allclose(data.temperature, 20.0 + 0.001 * np.arange(1000), atol=1e-9)
    assert np.isnan(data.odometer[5])
    np.testing.assert_allclose(np.delete(data.odometer, 5), 10.0)


def test_facts_are_ready_for_json_and_people(tmp_path):
    reading = _read(tmp_path, ROWS)
    facts = json.loads(json.dumps(reading.facts.as_dict(), allow_nan=False))
    assert facts["rate_hz"] == pytest.approx(100.0)
    assert facts["n_rows"] == 1000
    assert len(facts["sha256"]) == 64
    assert facts["columns"]["gyro_x_rad_s"] == "gyro_x_rad_s [rad/s]"
    assert f"1000{as_shown(' rows, ')}" in reading.facts.lines()[0]


def test_the_same_file_gives_the_same_bytes(tmp_path):
    first, second = (_read(tmp_path, ROWS) for _ in range(2))
    assert first.facts == second.facts
    assert first.data.accel.tobytes() == second.data.accel.tobytes()


def test_digest_is_that_of_the_file(tmp_path):
    import hashlib

    reading = _read(tmp_path, ROWS)
    assert reading.facts.sha256 == hashlib.sha256((tmp_path / "imu.csv").read_bytes()).hexdigest()


def test_rows_of_a_gps_file_are_cleaned_alike(tmp_path):
    rows = fixes(60)
    rows[[5, 6]] = rows[[6, 5]]
    rows[20, 2] = np.nan
    rows = np.delete(rows, np.arange(40, 50), axis=0)
    text = as_text(rows, GPS_HEADER).rstrip("\n")
    path = tmp_path / "gps.csv"
    path.write_text(text[:-30])
    reading = read_gps(path)
    expected = [Code.ROWS_UNSORTED, Code.ROWS_NO_POSITION, Code.ROWS_GAP, Code.ROWS_CUT]
    assert _codes(reading) == expected
    assert {event.subject for event in reading.events} == {"gps"}
    assert reading.facts.n_used == 48


@pytest.mark.parametrize("row", [0, 150, -1])
def test_a_row_of_another_week_is_left_out(tmp_path, row):
    rows = rolling(400)
    rows[row, 0] += 604_800.0
    reading = read_imu(write(tmp_path / "imu.csv", rows, IMU_HEADER))
    assert len(reading.data.time) == 399
    assert reading.facts.n_gaps == 0
    assert Code.ROWS_STRAY in _codes(reading)


def _clock(seconds: np.ndarray) -> np.ndarray:
    return 10000.0 * (seconds // 3600) + 100.0 * (seconds // 60 % 60) + seconds % 60


@pytest.mark.parametrize("step", [0.2, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("gap", [False, True])
def test_times_as_digits_of_a_clock_are_read_and_said(tmp_path, step, gap):
    seconds = 43_100.0 + step * np.arange(round(900.0 / step))
    seconds = np.delete(seconds, slice(3, round(90.0 / step))) if gap else seconds
    rows = fixes(len(seconds))
    rows[:, 0] = _clock(seconds)
    reading = read_gps(write(tmp_path / "gps.csv", rows[:, :4], "time,lat,lon,alt"))
    np.testing.assert_allclose(reading.data.time, seconds, atol=1e-6)
    (clock,) = noted(reading, Code.TIME_OF_CLOCK)
    assert clock.severity is Severity.ASSUMPTION


@pytest.mark.parametrize(("step", "header"), [(1.0, "time"), (0.2, "time"), (1.0, "time_s"), (20.0, "time_s")])
def test_plain_seconds_with_gaps_are_no_digits_of_a_clock(tmp_path, step, header):
    """Of none, by chance, the last two digits are 60 to 99: 30 is followed by 101, and no second is lost."""
    seconds = np.arange(0.0, 900.0, step)
    seconds = seconds[seconds % 100.0 <= (30.0 if header == "time" else 59.0)]
    rows = fixes(len(seconds))
    rows[:, 0] = seconds
    reading = read_gps(write(tmp_path / "gps.csv", rows[:, :4], f"{header},lat,lon,alt"))
    np.testing.assert_allclose(reading.data.time, seconds, atol=1e-6)


def test_a_header_that_is_repeated_is_no_row(tmp_path):
    lines = as_text(fixes(40), GPS_HEADER).splitlines()
    (tmp_path / "gps.csv").write_text("\n".join([*lines[:20], lines[0], *lines[20:]]) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read_gps(tmp_path / "gps.csv").data.time, fixes(40)[:, 0])


@pytest.mark.parametrize("mark", [-9999.0, 99999.0, -99.0])
def test_numbers_that_stand_for_what_is_not_known_are_named(tmp_path, mark):
    """As rates they were "too much for rad/s: that looks like deg/s"."""
    rows = ROWS.copy()
    rows[300:310, 3] = mark
    with refused(InputError, "input.placeholder") as caught:
        _read(tmp_path, rows)
    assert caught.value.values["count"] == 10
    rows[301:310, 3] = ROWS[301:310, 3]
    if mark == -99.0:  # by chance, in a single row
        assert _read(tmp_path, rows).data.gyro.shape == (len(ROWS), 3)
        return
    with refused(InputError, "input.placeholder"):
        _read(tmp_path, rows)


@pytest.mark.parametrize("digits", ["0.302420", "222420.1", "332420.1"])
def test_a_damaged_time_within_the_week_is_left_out(tmp_path, digits):
    """One digit of an exponent deleted: the record began three days earlier, and its gap took 6 GB."""
    rows = rolling(3000, start=302400.0)
    rows[2000, 0] = float(digits)
    reading = _read(tmp_path, rows)
    assert Code.ROWS_STRAY in _codes(reading)
    np.testing.assert_allclose(reading.data.time, np.delete(rows[:, 0], 2000), atol=1e-6)
