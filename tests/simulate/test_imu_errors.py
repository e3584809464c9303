"""Simulated errors have the sizes they were asked for, and the same seed makes the same ones."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from insnav.exceptions import ConfigError
from insnav.imu import ImuSpec, SensorSpec
from insnav.simulate import GpsErrors, corrupt_gps, corrupt_imu, gps_from_truth, straight, without_fixes
from insnav.types import GpsData, ImuData
from tests.refusals import refused
from tests.simulate.motions import PLACE, town


def triple(value: float) -> np.ndarray:
    return np.full(3, value)


def still_imu(n: int, dt: float, sampling: str = "mean") -> ImuData:
    accel = np.tile([0.0, 0.0, -9.8], (n, 1)) * (dt if sampling == "increment" else 1.0)
    return ImuData(100.0 + dt * np.arange(1, n + 1), np.zeros((n, 3)), accel, sampling=sampling)


def spec(**gyro: object) -> ImuSpec:
    return ImuSpec("test", SensorSpec(**gyro), SensorSpec())


@pytest.mark.parametrize(("sampling", "power"), [("mean", -0.5), ("instant", -0.5), ("increment", 0.5)])
def test_white_noise_has_its_density(sampling, power):
    shown = corrupt_imu(still_imu(40000, 0.01, sampling), spec(random_walk=triple(2e-4)), 1).imu
    assert shown.gyro.std() == pytest.approx(2e-4 * 0.01**power, rel=0.02)
    assert np.all(shown.accel[:, :2] == 0.0)


def test_constant_errors_are_those_it_tells():
    sizes = {"bias": triple(1e-3), "scale_factor": triple(1e-3), "misalignment": triple(1e-3)}
    simulated = corrupt_imu(still_imu(10, 0.01), ImuSpec("test", SensorSpec(**sizes), SensorSpec(**sizes)), 5)
    matrix, bias = simulated.errors.accel_matrix, simulated.errors.accel_bias
    np.testing.assert_allclose(simulated.imu.accel[3], matrix @ [0.0, 0.0, -9.8] + bias, rtol=1e-14)
    np.testing.assert_allclose(simulated.imu.gyro[3], simulated.errors.gyro_bias)
    assert np.abs(simulated.errors.gyro_bias).min() > 0.0


def test_in_run_bias_has_its_spread_and_correlation_time():
    n, dt, tau = 200000, 0.1, 20.0
    simulated = corrupt_imu(still_imu(n, dt), spec(bias_instability=triple(1e-3), correlation_time=tau), 2)
    drift = simulated.gyro_bias
    assert drift.std() == pytest.approx(1e-3, rel=0.1)
    lag = int(tau / dt)
    assert np.mean(drift[lag:] * drift[:-lag]) / drift.var() == pytest.approx(np.exp(-1.0), abs=0.1)
    np.testing.assert_array_equal(simulated.imu.gyro, drift)
    # It starts anywhere in its spread, not at zero.
    firsts = [
        corrupt_imu(still_imu(2, dt), spec(bias_instability=triple(1e-3), correlation_time=tau), seed).gyro_bias[0]
        for seed in range(200)
    ]
    assert np.std(firsts) == pytest.approx(1e-3, rel=0.1)


def test_rate_random_walk_grows_with_the_root_of_time():
    walks = [
        corrupt_imu(still_imu(400, 0.25), spec(rate_random_walk=triple(1e-5)), seed).gyro_bias[-1]
        for seed in range(300)
    ]
    assert np.std(walks) == pytest.approx(1e-4, rel=0.1)


def test_resolution_leaves_multiples_of_the_step():
    shown = corrupt_imu(still_imu(1000, 0.01), spec(random_walk=triple(1e-3), resolution=triple(1e-3)), 3).imu
    steps = shown.gyro / 1e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(np.round(steps))) > 10


def test_a_new_error_does_not_change_the_others_and_the_seed_decides():
    imu = still_imu(50, 0.01)
    noise = corrupt_imu(imu, spec(random_walk=triple(1e-3)), (1, 2)).imu.gyro
    again = corrupt_imu(imu, spec(random_walk=triple(1e-3)), (1, 2)).imu.gyro
    biased = corrupt_imu(imu, spec(random_walk=triple(1e-3), bias=triple(1.0)), (1, 2))
    other = corrupt_imu(imu, spec(random_walk=triple(1e-3)), (1, 3)).imu.gyro
    assert np.array_equal(noise, again)
    np.testing.assert_allclose(biased.imu.gyro - biased.errors.gyro_bias, noise, atol=1e-14)
    assert not np.any(noise == other)


def test_the_antenna_is_where_the_lever_arm_says():
    truth = straight(PLACE, 0.0, np.pi / 2, 10.0, roll=0.0, pitch=0.0)  # facing East
    fix = gps_from_truth(truth, np.array([5.0]), np.array([2.0, 1.0, -3.0]))
    here, there = PLACE, fix.lla[0]
    ned = pymap3d.geodetic2ned(there[0], there[1], there[2], *here, deg=False)
    np.testing.assert_allclose(ned, [-1.0, 2.0, -3.0], atol=2e-6)
    np.testing.assert_allclose(fix.v_n, 0.0, atol=1e-12)


def test_the_antenna_velocity_is_the_derivative_of_its_position():
    truth, lever = town(), np.array([0.8, -0.3, -1.2])
    time, step = 40.0, 1e-3
    fixes = gps_from_truth(truth, time + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), lever)
    r = np.array([pymap3d.geodetic2ecef(*lla, deg=False) for lla in fixes.lla])
    v_e = (8 * (r[3] - r[1]) - (r[4] - r[0])) / (12 * step)
    east, north, up = pymap3d.ecef2enuv(*v_e, *fixes.lla[2, :2], deg=False)
    np.testing.assert_allclose(fixes.v_n[2], [north, east, -up], atol=1e-5)
    # The lever matters here: the vibration moves the antenna by more than the tolerance.
    assert np.abs(fixes.v_n[2] - truth.evaluate(np.array([time])).v_n[0]).max() > 1e-2


def still_fixes(n: int) -> GpsData:
    return gps_from_truth(straight(PLACE, 0.0, 0.0, float(n)), np.arange(1.0, n + 1.0), np.zeros(3))


def test_fixes_are_off_by_what_their_sd_says_and_stay_off_for_the_correlation_time():
    errors = GpsErrors((0.3, 0.3, 0.6), (0.4, 0.4, 0.8), correlation_time=10.0, velocity_noise=(0.1, 0.1, 0.2))
    true = still_fixes(20000)
    gps = corrupt_gps(true, errors, 4)
    ned = np.column_stack(pymap3d.geodetic2ned(*gps.lla.T, *PLACE, deg=False))
    np.testing.assert_allclose(gps.position_sd[0], [0.5, 0.5, 1.0])
    np.testing.assert_allclose(ned.std(axis=0), gps.position_sd[0], rtol=0.06)
    np.testing.assert_allclose((gps.v_n - true.v_n).std(axis=0), gps.velocity_sd[0], rtol=0.05)
    correlation = np.mean(ned[10:] * ned[:-10], axis=0) / ned.var(axis=0)
    np.testing.assert_allclose(correlation, 0.64 * np.exp(-1.0), atol=0.06)


def test_an_outage_takes_exactly_its_fixes():
    gps = without_fixes(corrupt_gps(still_fixes(30), GpsErrors((1.0, 1.0, 1.0)), 1), 10.0, 20.0)
    assert np.array_equal(gps.time, np.r_[np.arange(1.0, 11.0), np.arange(21.0, 31.0)])
    assert gps.lla.shape == gps.v_n.shape == gps.position_sd.shape == gps.velocity_sd.shape == (20, 3)


def test_a_perfect_receiver_is_refused():
    with refused(ConfigError, "sim.receiver_sizes"):
        corrupt_gps(still_fixes(3), GpsErrors((0.0, 1.0, 1.0)), 1)
    with refused(ConfigError, "sim.receiver_sizes"):
        corrupt_gps(still_fixes(3), GpsErrors((1.0, 1.0, 1.0), velocity_noise=(0.1, 0.0, 0.1)), 1)
