"""A simulated recording: each source of randomness by itself, ideal sensors exact, faults where they were put."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import ned_offset
from insnav.exceptions import ConfigError
from insnav.imu import correct, load_imu
from insnav.simulate.recording import (
    REFERENCE_RATE,
    load_gps,
    parse_fault,
    perfect_imu,
    simulate_recording,
    temperature_ramp,
    times,
)
from insnav.simulate.truth import imu_from_truth
from tests.refusals import refused
from tests.simulate.motions import town

TRUTH = town(start=1000.0)
IMU, GPS = load_imu("automotive"), load_gps("single")


def test_ideal_sensors_tell_the_truth():
    made = simulate_recording(TRUTH, None, None, 1, rate=50.0, sampling="increment")
    exact = imu_from_truth(TRUTH, times(TRUTH, 50.0), "increment")
    np.testing.assert_array_equal(made.imu.gyro, exact.gyro)
    np.testing.assert_array_equal(made.imu.accel, exact.accel)
    at = TRUTH.evaluate(made.gps.time)
    assert np.abs(ned_offset(made.gps.lla, at.lla)).max() < 1e-6
    np.testing.assert_allclose(made.gps.v_n, at.v_n, atol=1e-9)
    assert made.errors is None
    assert not made.lever_b.any()


def test_the_reference_covers_the_motion():
    made = simulate_recording(TRUTH, None, None, 1)
    np.testing.assert_allclose(made.reference.time[[0, -1]], [TRUTH.start, TRUTH.start + TRUTH.duration], atol=1e-6)
    assert np.median(np.diff(made.reference.time)) == pytest.approx(1.0 / REFERENCE_RATE)


def test_the_same_seed_gives_the_same_recording_and_another_one_another():
    first, again, other = (simulate_recording(TRUTH, IMU, GPS, seed, rate=20.0) for seed in (7, 7, 8))
    for name in ("gyro", "accel"):
        np.testing.assert_array_equal(getattr(first.imu, name), getattr(again.imu, name))
        assert not np.isclose(getattr(first.imu, name), getattr(other.imu, name), rtol=0, atol=1e-9).any(axis=0).all()
    np.testing.assert_array_equal(first.gps.lla, again.gps.lla)
    assert not np.array_equal(first.gps.lla, other.gps.lla)


def test_each_sensor_has_randomness_of_its_own():
    both = simulate_recording(TRUTH, IMU, GPS, 7, rate=20.0)
    np.testing.assert_array_equal(simulate_recording(TRUTH, IMU, None, 7, rate=20.0).imu.gyro, both.imu.gyro)
    np.testing.assert_array_equal(simulate_recording(TRUTH, None, GPS, 7, rate=20.0).gps.lla, both.gps.lla)
    quiet = replace(IMU, gyro=replace(IMU.gyro, random_walk=np.zeros(3)))
    np.testing.assert_array_equal(simulate_recording(TRUTH, quiet, GPS, 7, rate=20.0).imu.accel, both.imu.accel)


def test_what_was_measured_before_need_not_be_measured_again():
    perfect = perfect_imu(TRUTH, 20.0, "increment")
    once = simulate_recording(TRUTH, IMU, GPS, 7, rate=20.0, sampling="increment")
    np.testing.assert_array_equal(simulate_recording(TRUTH, IMU, GPS, 7, perfect=perfect).imu.gyro, once.imu.gyro)


def test_the_specimen_explains_the_samples():
    made = simulate_recording(TRUTH, IMU, None, 7, rate=20.0)
    exact = perfect_imu(TRUTH, 20.0)
    repaired = correct(made.imu, made.errors)
    # what is left is noise and in-run bias: far below the turn-on bias of several sensor units
    assert np.abs(np.mean(repaired.accel - exact.accel, axis=0)).max() < 0.01
    assert np.abs(np.mean(made.imu.accel - exact.accel, axis=0)).max() > 0.01


def test_a_fault_spoils_only_its_time():
    clean = simulate_recording(TRUTH, IMU, GPS, 7, rate=20.0)
    spoilt = simulate_recording(TRUTH, IMU, GPS, 7, rate=20.0, faults=(parse_fault("gps-outage@40s+20s"),))
    np.testing.assert_array_equal(spoilt.imu.gyro, clean.imu.gyro)
    lost = np.setdiff1d(clean.gps.time, spoilt.gps.time) - TRUTH.start
    assert len(lost) > 15
    assert lost.min() >= 40.0
    assert lost.max() <= 60.0


def test_temperature_goes_evenly_from_start_to_end():
    perfect = perfect_imu(TRUTH, 20.0)
    warm = temperature_ramp(perfect, (20.0, 50.0))
    np.testing.assert_allclose(warm[[0, -1]], [20.0, 50.0])
    np.testing.assert_allclose(np.diff(warm), 30.0 / (len(perfect.time) - 1))
    made = simulate_recording(TRUTH, IMU, None, 7, perfect=perfect, temperature=warm)
    np.testing.assert_array_equal(made.imu.temperature, warm)
    assert temperature_ramp(perfect, None) is None


@pytest.mark.parametrize("rate", [0.0, 0.1, 1e5, np.nan])
def test_a_rate_that_makes_no_sense_is_refused(rate):
    with refused(ConfigError, "sim.sampling_rate"):
        simulate_recording(TRUTH, None, None, 1, rate=rate)
