from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.input import check_overlap
from insnav.types import GpsData, ImuData
from tests.refusals import refused

WEEK = 604800.0
UNIX = 2374 * WEEK + 315964800.0 - 18.0  # Unix time at the start of GPS week 2374: 2025-07-05 23:59:42 UTC


def _imu(start: float, length: float = 600.0) -> ImuData:
    time = start + np.linspace(0.0, length, 100)
    return ImuData(time, np.zeros((100, 3)), np.zeros((100, 3)))


def _gps(start: float, length: float = 600.0) -> GpsData:
    time = start + np.linspace(0.0, length, 60)
    unknown = np.full((60, 3), np.nan)
    return GpsData(time, np.zeros((60, 3)), unknown, unknown, unknown)


def test_recordings_that_overlap_pass():
    check_overlap(_imu(0.0), _gps(100.0))
    check_overlap(_imu(0.0), _gps(-590.0))
    check_overlap(_imu(0.0, 1e5), _gps(50.0))


CASES = {
    "weeks of GPS time": (243300.0, 243300.0 + 2374 * WEEK, 2374 * WEEK, "weeks"),
    "one week": (243300.0 + WEEK, 243300.0, -WEEK, "weeks"),
    "days": (50000.0, 243300.0 - 0.0, 2 * 86400.0, "days"),
    "Unix against seconds of the week": (UNIX + 243300.0, 243300.0, -UNIX, "Unix"),
    "Unix against GPS time": (UNIX + 243300.0, 2374 * WEEK + 243300.0, -(315964800.0 - 18.0), "Unix"),
    "GPS time against Unix": (2374 * WEEK + 5.0, UNIX + 5.0, 315964800.0 - 18.0, "Unix"),
}


@pytest.mark.parametrize(("imu", "gps", "offset", "word"), CASES.values(), ids=CASES.keys())
def test_well_known_offsets_are_named(imu, gps, offset, word):
    length = 60000.0 if word == "days" else 600.0
    with pytest.raises(InputError) as caught:
        check_overlap(_imu(imu, length), _gps(gps, length))
    assert caught.value.values["offset_s"] == pytest.approx(offset)
    assert caught.value.values["imu_begin_s"] == pytest.approx(imu)
    assert caught.value.values["gps_begin_s"] == pytest.approx(gps)


def test_leap_seconds_of_a_short_recording():
    with pytest.raises(InputError) as caught:
        check_overlap(_imu(1000.0, 10.0), _gps(1018.0, 10.0))
    assert caught.value.values["offset_s"] == 18.0


@pytest.mark.parametrize(("factor", "word"), [(1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
def test_scaled_times_are_named(factor, word):
    imu, gps = _imu(243300.0), _gps(243300.0)
    with pytest.raises(InputError) as caught:
        check_overlap(ImuData(imu.time * factor, imu.gyro, imu.accel), gps)
    assert (caught.value.code, caught.value.values["clock"]) == ("columns.clock_unit", "imu")
    with pytest.raises(InputError) as caught:
        check_overlap(imu, GpsData(gps.time * factor, gps.lla, gps.v_n, gps.v_n, gps.v_n))
    assert (caught.value.code, caught.value.values["clock"]) == ("columns.clock_unit", "gps")


def test_a_clock_from_power_up_is_told():
    with refused(InputError, "columns.clock_restarted") as caught:
        check_overlap(_imu(3.0), _gps(243300.25))
    assert caught.value.values["offset_s"] == 243297.25


def test_unrelated_recordings_get_no_wrong_advice():
    with pytest.raises(InputError) as caught:
        check_overlap(_imu(243300.0), _gps(243300.0 + 20000.0))
    assert caught.value.code == "columns.no_overlap"
