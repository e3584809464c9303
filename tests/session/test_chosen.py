"""What is chosen before a drive is navigated, and where it is from: IMU specification, clock, place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.findings import Code, Finding, Severity, of_code
from insnav.imu import load_imu
from insnav.input.interpret.overlap import GPS_EPOCH, LEAP
from insnav.steps.given import given_imu
from insnav.steps.imu_noise import imu_from_rest, raise_given
from insnav.types import ImuData


def test_an_imu_specification_has_a_source(tmp_path):
    assert given_imu(None) is None
    spec = load_imu("tactical")
    assert given_imu(spec) == (spec, Finding.of(Code.IMU_MODEL_GIVEN, absent=()))
    assert given_imu("tactical")[1] == Finding.of(Code.IMU_MODEL_FILE, model="tactical", absent=())
    (tmp_path / "few.toml").write_text('[gyro]\nbias = "50 deg/h"\n')
    few = given_imu(tmp_path / "few.toml")[1]
    assert few.code is Code.IMU_MODEL_FILE
    assert "gyro.random_walk" in few["absent"]
    part = given_imu("STIM300")[1]
    assert (part.code, part["grade"]) == (Code.IMU_MODEL_PART, "tactical")


def test_without_rest_the_poorest_imu_is_assumed():
    drive = insnav.simulate("figure_eight", seed=1)
    for rest in (None, (0.0, 4.0)):
        spec, assumed = imu_from_rest(drive.imu.data, rest)
        assert (spec.name, assumed["preset"]) == ("consumer", "consumer")
        assert (assumed.code, assumed.severity) == (Code.IMU_MODEL_ASSUMED, Severity.ASSUMPTION)


def test_one_noisy_axis_at_rest_contradicts_a_given_specification():
    """Only the quietest axis was compared: a file was believed beside an axis with ten times its noise."""
    spec, random, rate = load_imu("automotive"), np.random.default_rng(3), 100.0
    density = spec.gyro.random_walk * [1.0, 1.0, 10.0]
    gyro = np.sqrt(rate) * density * random.normal(size=(2000, 3))
    accel = np.array([0.0, 0.0, -9.8]) + np.sqrt(rate) * spec.accel.random_walk * random.normal(size=(2000, 3))
    imu = ImuData(np.arange(2000) / rate, gyro, accel, "mean")
    raised, (found,) = raise_given(spec, imu, (0.0, 20.0))
    assert found.code is Code.GIVEN_IMU_MODEL
    assert found["noise_rad_sqrt_s"] == pytest.approx(density[2], rel=0.1)
    assert found["given_rad_sqrt_s"] == spec.gyro.random_walk[2]
    np.testing.assert_allclose(raised.gyro.random_walk, density, rtol=0.1)
    gyro[:, 2] /= 10.0
    assert raise_given(spec, replace(imu, gyro=gyro), (0.0, 20.0)) == (spec, ())


def test_unix_time_beside_gps_time_is_an_assumption():
    drive = insnav.simulate("figure_eight", imu="automotive", seed=1)
    gps, offset = drive.gps.data, GPS_EPOCH - LEAP
    found = insnav.load(drive.imu.data, replace(gps, time=gps.time + offset), imu="automotive")
    (clock,) = of_code(found.notes, Code.CLOCK_EPOCHS)
    assert clock["offset_s"] == offset
    assert clock.severity is Severity.ASSUMPTION
    np.testing.assert_allclose(found.imu.data.time, drive.imu.data.time + offset, rtol=0, atol=1e-6)
