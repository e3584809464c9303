"""Noise of records with some of the six axes, of one column, of counts; and the IMU file of Kalibr."""

from __future__ import annotations

import numpy as np
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.imu import load_imu, to_kalibr
from insnav.units import DEG, G0
from tests.refusals import refused

RATE = 50.0
N = 6000


def _record(path, header, sd, mean=0.0, timed=True):
    """White noise in each column of a file."""
    names = header.split(",")
    values = mean + np.random.default_rng(3).normal(size=(N, len(names))) * sd
    columns = [np.arange(N) / RATE, *values.T] if timed else [*values.T]
    header = f"time_s,{header}" if timed else header
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9f")
    return path


def _random_walk(found, column):
    return found.models[column].coefficients["N"].value


def test_one_gyro_alone_has_its_noise_and_stands_in_for_the_others(tmp_path):
    outcome = insnav.allan(_record(tmp_path / "fog.csv", "gyro_z_deg_h", 3.0))
    found, wanted = outcome.found, 3.0 * DEG / 3600.0 / np.sqrt(RATE)
    assert [model is None for model in found.models] == [True, True, False, True, True, True]
    assert _random_walk(found, 2) == pytest.approx(wanted, rel=0.03)
    np.testing.assert_allclose(found.spec.gyro.random_walk, wanted, rtol=0.03)
    assert not found.spec.accel.random_walk.any()
    (alike,) = of_code(outcome.findings, Code.ALLAN_ALIKE)
    assert (alike.subject, alike["others"]) == ("gyro x, gyro y", ("gyro z",))
    assert not [*of_code(outcome.findings, Code.ALLAN_SILENT)]
    assert np.isnan(found.allan.deviation[:, [0, 1, 3, 4, 5]]).all()


def test_three_accelerometers_alone_have_their_unit_by_gravity(tmp_path):
    path = _record(tmp_path / "accel.csv", "accel_x,accel_y,accel_z", 1e-3, np.array([0.0, 0.0, 1.0]))
    found = insnav.allan(path).found
    assert _random_walk(found, 5) == pytest.approx(1e-3 * G0 / np.sqrt(RATE), rel=0.03)
    assert found.models[0] is None


def test_axes_may_point_anywhere(tmp_path):
    mean = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.8])
    header = "gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    found = insnav.allan(_record(tmp_path / "up.csv", header, 0.01, mean)).found
    assert _random_walk(found, 3) == pytest.approx(0.01 / np.sqrt(RATE), rel=0.03)


@pytest.mark.parametrize("header", ["gyro_z_deg_s", "gyro z (deg/s)"])
def test_one_column_without_times_needs_its_rate(tmp_path, header):
    path = _record(tmp_path / "one.csv", header, 0.1, timed=False)
    found = insnav.allan(path, rate=RATE).found
    assert _random_walk(found, 2) == pytest.approx(0.1 * DEG / np.sqrt(RATE), rel=0.03)
    with refused(InputError, "columns.missing"):
        insnav.allan(path)


def test_a_column_is_analysed_in_its_own_unit(tmp_path):
    path = tmp_path / "signal.txt"
    np.savetxt(path, np.random.default_rng(1).normal(size=1000))
    found = insnav.allan(path, column="1", rate=1.0).found
    assert _random_walk(found, 0) == pytest.approx(1.0, rel=0.05)
    timed = _record(tmp_path / "volts.csv", "volts,other", 2.0)
    assert _random_walk(insnav.allan(timed, column="volts").found, 0) == pytest.approx(2.0 / np.sqrt(RATE), rel=0.03)


def test_counts_have_their_scale_from_the_command_line(tmp_path):
    sd, mean = np.repeat([13.1, 163.84], 3), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 16384.0])
    path = _record(tmp_path / "raw.csv", "gx,gy,gz,ax,ay,az", sd, mean)
    found = insnav.allan(path, units="counts/(deg/s)=131,counts/g=16384").found
    assert _random_walk(found, 0) == pytest.approx(0.1 * DEG / np.sqrt(RATE), rel=0.03)
    assert _random_walk(found, 3) == pytest.approx(0.01 * G0 / np.sqrt(RATE), rel=0.03)


def test_the_file_of_kalibr_is_written_and_read(tmp_path):
    text = (
        "#Accelerometers\naccelerometer_noise_density: 0.002   # m/s^2/sqrt(Hz)\naccelerometer_random_walk: 2.0e-04\n"
    )
    text += (
        "gyroscope_noise_density: 0.00017\ngyroscope_random_walk: 2.0e-05\nrostopic: '/imu/data'\nupdate_rate: 50.0\n"
    )
    path = tmp_path / "imu.yaml"
    path.write_text(text)
    spec = load_imu(str(path))
    np.testing.assert_allclose(spec.accel.random_walk, 0.002)
    np.testing.assert_allclose(spec.accel.rate_random_walk, 2e-4)
    np.testing.assert_allclose(spec.gyro.random_walk, 1.7e-4)
    assert "gyro.bias" in spec.absent
    path.write_text(to_kalibr(spec, 50.0))
    again = load_imu(str(path))
    np.testing.assert_allclose(again.gyro.rate_random_walk, 2e-5)
