"""Noise of simulated sensors against the Allan deviations that its coefficients mean (IEEE Std 952-1997, annex C)."""

from __future__ import annotations

import allantools
import numpy as np
import pytest

from insnav.imu import ClockSpec, ImuSpec, SensorSpec
from insnav.simulate import corrupt_imu
from insnav.types import ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, G0
from tests.refusals import refused

RATE = 20.0
ONE = np.ones(3)


def still(duration: float = 3600.0, sampling: str = "mean", rate: float = RATE) -> ImuData:
    time = np.arange(1, round(duration * rate) + 1) / rate
    accel = np.tile([0.0, 0.0, -G0], (len(time), 1))
    scale = 1.0 / rate if sampling == "increment" else 1.0
    return ImuData(time, np.zeros((len(time), 3)), accel * scale, sampling=sampling)


def allan(gyro: SensorSpec, taus: list[float], seeds: range, **options: object) -> np.ndarray:
    """Root of the mean overlapping Allan variance of three gyros of many simulated units."""
    total = np.zeros(len(taus))
    for seed in seeds:
        imu = corrupt_imu(still(**options), ImuSpec("test", gyro, SensorSpec()), seed).imu
        span = 1.0 / RATE if imu.sampling == "increment" else 1.0
        for axis in range(3):
            found = allantools.oadev(imu.gyro[:, axis] / span, rate=RATE, data_type="freq", taus=taus)
            np.testing.assert_allclose(found[0], taus)
            total += found[1] ** 2
    return np.sqrt(total / (3 * len(seeds)))


def gauss_markov(sd: float, time: float, tau: np.ndarray) -> np.ndarray:
    """IEEE Std 952-1997, equation C.19, from the correlation function sd^2 exp(-|t| / T)."""
    ratio = tau / time
    return sd * np.sqrt(2 / ratio * (1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio)))


@pytest.mark.parametrize("sampling", ["mean", "increment"])
def test_angle_random_walk(sampling):
    size = 0.3 * DEG_PER_SQRT_H
    tau = [0.5, 2.0, 10.0]
    found = allan(SensorSpec(random_walk=size * ONE), tau, range(2), sampling=sampling)
    np.testing.assert_allclose(found, size / np.sqrt(tau), rtol=0.05)


def test_rate_random_walk():
    size = 5.0 * DEG_PER_H / 60.0
    tau = [5.0, 20.0, 60.0]
    found = allan(SensorSpec(rate_random_walk=size * ONE), tau, range(12))
    np.testing.assert_allclose(found, size * np.sqrt(np.array(tau) / 3.0), rtol=0.05)


def test_in_run_bias():
    sd, time = 8.0 * DEG_PER_H, 60.0
    tau = np.array([5.0, 30.0, 113.0])
    found = allan(SensorSpec(bias_instability=sd * ONE, correlation_time=time), list(tau), range(12))
    np.testing.assert_allclose(found, gauss_markov(sd, time, tau), rtol=0.05)


def test_flicker_floor_is_flat():
    size = 10.0 * DEG_PER_H
    tau = [1.0, 5.0, 20.0, 60.0]
    found = allan(SensorSpec(flicker=size * ONE), tau, range(16))
    np.testing.assert_allclose(found, np.sqrt(2.0 * np.log(2.0) / np.pi) * size, rtol=0.05)


def test_rate_ramp():
    size = 20.0 * DEG_PER_H / 3600.0
    slopes = []
    for seed in range(200):
        made = corrupt_imu(still(10.0), ImuSpec("test", SensorSpec(rate_ramp=size * ONE), SensorSpec()), seed)
        slope = (made.imu.gyro[-1] - made.imu.gyro[0]) / (made.imu.time[-1] - made.imu.time[0])
        np.testing.assert_allclose(np.diff(made.imu.gyro, axis=0) * RATE, np.tile(slope, (199, 1)), atol=1e-14)
        slopes.append(slope)
    assert np.std(slopes) == pytest.approx(size, rel=0.08)


def test_quantisation():
    size = 2e-6
    # a rate that is no multiple of the step per interval, so that the remainder goes through all values
    imu = still(1200.0)
    imu = ImuData(
        imu.time, imu.gyro + np.array([0.0123, -0.0345, 0.0217]) * (1 + 0.1 * np.sin(imu.time))[:, None], imu.accel
    )
    total = np.zeros(3)
    exact = imu.gyro
    for seed in range(2):
        made = corrupt_imu(imu, ImuSpec("test", SensorSpec(quantisation=size * ONE), SensorSpec()), seed).imu
        assert np.abs(np.cumsum(made.gyro - exact, axis=0) / RATE).max() <= 0.5 * np.sqrt(12.0) * size * (1 + 1e-6)
        for axis in range(3):
            off = made.gyro[:, axis] - exact[:, axis]
            total += allantools.oadev(off, rate=RATE, data_type="freq", taus=[0.5, 2.0, 10.0])[1] ** 2
    np.testing.assert_allclose(np.sqrt(total / 6), np.sqrt(3.0) * size / np.array([0.5, 2.0, 10.0]), rtol=0.05)


def test_one_source_does_not_change_another():
    small = {"random_walk": 1e-4 * ONE}
    first = corrupt_imu(still(20.0), ImuSpec("test", SensorSpec(**small), SensorSpec(**small)), 3).imu
    both = {**small, "flicker": 1e-3 * ONE, "rate_ramp": 1e-5 * ONE}
    plain = corrupt_imu(still(20.0), ImuSpec("test", SensorSpec(**both), SensorSpec(**small)), 3).imu
    alone = {"flicker": 1e-3 * ONE, "rate_ramp": 1e-5 * ONE}
    only = corrupt_imu(still(20.0), ImuSpec("test", SensorSpec(**alone), SensorSpec(**small)), 3).imu
    np.testing.assert_allclose(plain.gyro, first.gyro + only.gyro, atol=1e-15)
    np.testing.assert_array_equal(plain.accel, first.accel)


def test_range_and_resolution():
    imu = still(10.0)
    swing = 2.0 * np.sin(imu.time)[:, None] * [1.0, 0.5, 0.1]
    spec = ImuSpec(
        "test", SensorSpec(range=np.array([1.0, 0.0, 1.0]), resolution=np.array([0.0, 0.01, 0.3])), SensorSpec()
    )
    made = corrupt_imu(ImuData(imu.time, swing, imu.accel), spec, 1).imu.gyro
    np.testing.assert_allclose(made[:, 0], np.clip(swing[:, 0], -1.0, 1.0), atol=1e-15)
    np.testing.assert_allclose(made[:, 1] / 0.01, np.round(swing[:, 1] / 0.01), atol=1e-9)
    assert set(np.round(made[:, 2], 9)) <= {0.0, 0.3, -0.3}


def test_vibration_rectification():
    imu = still(20.0, rate=200.0)
    shaken = imu.accel + 3.0 * np.sin(2 * np.pi * 30.0 * imu.time)[:, None] * [1.0, 0.0, 0.0]
    spec = ImuSpec("test", SensorSpec(), SensorSpec(vibration_rectification=1e-4 * ONE))
    made = corrupt_imu(ImuData(imu.time, imu.gyro, shaken), spec, 1)
    off = (made.imu.accel - shaken)[400:-400].mean(axis=0)
    np.testing.assert_allclose(off, [1e-4 * 4.5, 0.0, 0.0], rtol=0.02, atol=1e-9)


def test_clock():
    imu = still(100.0)
    spec = ImuSpec("test", SensorSpec(), SensorSpec(), clock=ClockSpec(0.25, 1e-4, 1e-3, 20.0, 0.5))
    made = corrupt_imu(imu, spec, 2)
    assert 0 < len(imu.time) - len(made.imu.time) < 300
    assert len(made.gyro_bias) == len(made.imu.time)
    late = made.imu.time - imu.time[np.searchsorted(imu.time, made.imu.time - 0.25 - 0.02)]
    slope, offset = np.polyfit(made.imu.time, late, 1)
    assert slope == pytest.approx(1e-4, abs=2e-5)
    assert offset == pytest.approx(0.25, abs=1e-3)
    assert np.std(late - slope * made.imu.time - offset) == pytest.approx(1e-3, rel=0.1)
    assert np.all(np.diff(made.imu.time) > 0.0)


def test_temperature_is_needed_and_used():
    imu = still(10.0)
    spec = ImuSpec("test", SensorSpec(bias_slope=0.01 * DEG * ONE, scale_slope=1e-4 * ONE), SensorSpec())
    from insnav.exceptions import InputError

    with refused(InputError, "imu.no_temperature"):
        corrupt_imu(imu, spec, 1)
    warm = np.linspace(25.0, 45.0, len(imu.time))
    made = corrupt_imu(imu, spec, 1, temperature=warm)
    np.testing.assert_array_equal(made.imu.temperature, warm)
    slope = made.errors.gyro_terms.bias_slope
    assert np.abs(slope).max() > 0.0
    np.testing.assert_allclose(made.imu.gyro, (warm - 25.0)[:, None] * slope, atol=1e-15)
