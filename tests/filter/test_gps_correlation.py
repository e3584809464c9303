"""With a known IMU, the innovations show which part of the errors of positions is time-correlated."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.noise_identification import with_known_noise
from insnav.simulate import GpsErrors, corrupt_gps
from tests.filter import drives

RTK = GpsErrors((0.02, 0.02, 0.03), velocity_noise=(0.03, 0.03, 0.05))


def estimated(errors: GpsErrors, seed: int, interval: float = 1.0) -> CorrelatedNoise:
    """Simulate a quarter of an hour, and estimate."""
    rng = np.random.default_rng([31, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=12), drives.MODEL, rng)
    gps = corrupt_gps(drives.perfect_gps(interval, laps=12), errors, seed)
    start = drives.begin(drives.MODEL, np.random.default_rng([5, seed]), 12)
    ready = drives.ready(imu, gps, start, drives.MODEL, gates=drives.UNFAILING)
    found = with_known_noise(ready, drives.SPEC, lasting=True, sizes=False)[0].receiver.correlated
    assert found is not None
    return found


@pytest.mark.parametrize("interval", [0.2, 1.0])
@pytest.mark.parametrize("time", [20.0, 60.0])
def test_a_gauss_markov_error_is_found_with_its_share_and_time(interval, time):
    errors = GpsErrors((0.5, 0.5, 1.0), (1.5, 1.5, 3.0), time, (0.05, 0.05, 0.1))
    found = [estimated(errors, seed, interval) for seed in range(3)]
    np.testing.assert_allclose([each.share for each in found], 0.9, atol=0.02)  # 1.5^2 of 1.5^2 + 0.5^2
    assert np.median([each.time for each in found]) == pytest.approx(time, rel=0.15)
    np.testing.assert_allclose(np.median([each.sd for each in found], axis=0)[:2], 1.5, rtol=0.1)


@pytest.mark.parametrize("errors", [GpsErrors((1.5, 1.5, 3.0)), RTK], ids=["white", "RTK"])
def test_white_errors_are_white(errors):
    shares = [estimated(errors, seed).share for seed in range(3)]
    assert max(shares) < 0.1
