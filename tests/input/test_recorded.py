from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import check_overlap, read_gps, read_imu, read_reference
from tests.input.files import SHARED, noted
from tests.refusals import refused

DATA = SHARED / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="recorded data (../shared/data) is not here")
_GYRO_UNIT = (
    Code.UNITS_GYRO,
    Code.UNITS_GYRO_ASSUMED,
    Code.UNITS_GYRO_BY_RATE,
    Code.UNITS_GYRO_WRONG_WAY,
    Code.UNITS_STATED,
)

# file, rows, rate [Hz], start [s]: counted with wc and read off the first lines
IMU = {
    "calib_ferraris_nilspod/imu.csv": (10376, 102.4, 0.0),
    "ixr_tsukishima_20210412/imu.csv.gz": (104704, 50.0, 111184.84),
    "psins_fog_mems_100s/imu.csv": (10001, 100.0, 0.0),
    "psins_rlg_static/imu.csv.gz": (184718, 100.0, 0.01),
    "rtklib_drive_20250708/imu.csv.gz": (54858, 99.97, 243261.729),
    "static_adis16405_2h46/imu.csv.gz": (1000000, 100.0, 0.0),
    "umn_thor75_uav/imu.csv.gz": (34811, 50.0, 0.041),
}
GPS = {
    "ixr_tsukishima_20210412/gps.csv": (10889, 5.0),
    "rtklib_drive_20250708/gps.csv": (2197, 4.0),
    "umn_thor75_uav/gps.csv": (674, 1.02),
}
REFERENCE = {
    "ixr_tsukishima_20210412/ref.csv": 10534,
    "psins_fog_mems_100s/ref.csv": 1000,
    "psins_rlg_static/ref.csv": 2,
    "umn_thor75_uav/onboard_nav/ref.csv": 33573,
}


@pytest.mark.parametrize(("name", "expected"), IMU.items())
def test_imu_files_are_understood_without_options(name, expected):
    reading = read_imu(DATA / name)
    rows, rate, start = expected
    facts = reading.facts
    assert (facts.n_rows, facts.n_used) == (rows, rows)
    assert facts.rate_hz == pytest.approx(rate, rel=1e-3)
    assert facts.start_s == pytest.approx(start)
    units = noted(reading, *_GYRO_UNIT)
    assert {each["unit"] for each in units if each.get("quantity") != "time"} == {"rad/s"}
    assert {each["unit"] for each in noted(reading, Code.UNITS_ACCEL, Code.UNITS_ACCEL_UNCALIBRATED)} == {"m/s^2"}
    assert np.isfinite(reading.data.gyro).all()
    assert (np.diff(reading.data.time) > 0).all()


def test_wheel_speed_is_read():
    odometer = read_imu(DATA / "ixr_tsukishima_20210412/imu.csv.gz").data.odometer
    assert odometer is not None
    assert 5.0 < np.nanmax(odometer) < 30.0


def test_raw_counts_are_refused():
    with refused(InputError, "columns.no_gravity"):
        read_imu(DATA / "calib_imutk_xsens/raw_counts.csv.gz")


@pytest.mark.parametrize(("name", "expected"), GPS.items())
def test_gps_files_are_understood_without_options(name, expected):
    reading = read_gps(DATA / name)
    assert reading.facts.n_used == expected[0]
    assert reading.facts.rate_hz == pytest.approx(expected[1], rel=0.02)
    lat_lon = np.degrees(reading.data.lla[:, :2])
    assert np.ptp(lat_lon, axis=0).max() < 0.1
    check_overlap(read_imu(DATA / name.replace("gps.csv", "imu.csv.gz")).data, reading.data)


def test_gps_values():
    data = read_gps(DATA / "rtklib_drive_20250708/gps.csv").data
    np.testing.assert_allclose(np.degrees(data.lla[0, :2]), [40.0966268, -105.1474483], atol=1e-10)
    np.testing.assert_allclose(data.v_n[0], [0.01, -0.002, -0.009])
    np.testing.assert_allclose(data.velocity_sd[0], 0.0587)
    assert data.fix is not None
    assert np.count_nonzero(data.fix == 1) == 2189  # from its README
    ixr = read_gps(DATA / "ixr_tsukishima_20210412/gps.csv").data
    assert np.isnan(ixr.position_sd).all()
    assert np.isnan(ixr.v_n[0]).all()


@pytest.mark.parametrize(("name", "rows"), REFERENCE.items())
def test_reference_files_are_understood_without_options(name, rows):
    reading = read_reference(DATA / name)
    assert reading.facts.n_used == rows
    assert np.isfinite(reading.data.lla).all()


def test_reference_values():
    fog = read_reference(DATA / "psins_fog_mems_100s/ref.csv").data
    np.testing.assert_allclose(np.degrees(fog.rph[0]), [1.4125, -3.1307, 1.2978], atol=1e-9)
    ixr = read_reference(DATA / "ixr_tsukishima_20210412/ref.csv")
    assert ixr.fix is not None
    assert np.count_nonzero(ixr.fix == 1) == 6778  # from its README
    np.testing.assert_allclose(read_reference(DATA / "psins_rlg_static/ref.csv").data.time, [0.01, 1847.18])
