"""Errors of the fixes that last are found where they are, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.filter.gps_noise import correlated_noise
from insnav.simulate import GpsErrors, corrupt_gps, gps_from_truth
from insnav.types import GpsData
from insnav.units import DEG
from tests.filter import drives
from tests.simulate.motions import Segment, drive

SEEDS = range(8)
WHITE = GpsErrors((1.5, 1.5, 3.0))
RTK = GpsErrors((0.02, 0.02, 0.03), velocity_noise=(0.03, 0.03, 0.05))


def aircraft() -> GpsData:
    """Half an hour at 200 m/s, with gentle turns."""
    turns = (Segment(40.0, turn=60 * DEG), Segment(40.0, turn=-60 * DEG))
    motion = drive((Segment(60.0, speed=200.0), *(turns * 22)), drives.PLACE, seed=1, heading=0.3)
    return gps_from_truth(motion, np.arange(1.0, motion.duration), np.zeros(3))


@pytest.mark.parametrize("interval", [0.2, 0.5])
def test_a_gauss_markov_error_is_found_with_its_share_and_time(interval):
    gps = drives.perfect_gps(interval, laps=8)
    errors = GpsErrors((0.5, 0.5, 1.0), (1.5, 1.5, 2.0), 20.0)
    found = [correlated_noise(corrupt_gps(gps, errors, seed), 0.0) for seed in SEEDS]
    assert None not in found
    share, time = np.median([(each.share, each.time) for each in found if each], axis=0)
    assert share == pytest.approx(0.9, abs=0.05)  # 1.5^2 of 1.5^2 + 0.5^2
    assert time == pytest.approx(20.0, rel=0.4)
    sd = np.median([each.sd for each in found if each], axis=0)
    np.testing.assert_allclose(sd[:2], 1.5, rtol=0.05)


@pytest.mark.parametrize("errors", [WHITE, RTK], ids=["white", "RTK"])
@pytest.mark.parametrize("interval", [0.2, 1.0])
def test_white_errors_do_not_last(interval, errors):
    gps = drives.perfect_gps(interval, laps=4)
    assert [correlated_noise(corrupt_gps(gps, errors, seed), 0.0) for seed in SEEDS] == [None] * len(SEEDS)


def test_nor_do_those_of_an_aircraft():
    gps = aircraft()
    assert [correlated_noise(corrupt_gps(gps, WHITE, seed), 0.0) for seed in SEEDS] == [None] * len(SEEDS)


@pytest.mark.parametrize(("lasting", "time"), [(1.3, 100.0), (2.5, 60.0)])
def test_on_a_short_drive_what_the_claimed_variance_lacks_is_taken_to_last(lasting, time):
    gps = drives.perfect_gps(1.0, laps=6)  # seven and a half minutes
    white = 0.55 * lasting
    errors = GpsErrors((white, white, 2 * white), (lasting, lasting, 2 * lasting), time, (0.05, 0.05, 0.1))
    found = [correlated_noise(corrupt_gps(gps, errors, seed), 0.0) for seed in SEEDS]
    assert None not in found
    share = [each.share for each in found if each]
    np.testing.assert_allclose(share, lasting**2 / (lasting**2 + white**2), atol=0.08)
    assert np.median([each.time for each in found if each]) == pytest.approx(time, rel=0.5)


def test_a_variance_that_nobody_claims_tells_nothing():
    gps = drives.perfect_gps(1.0, laps=4)
    errors = GpsErrors((0.7, 0.7, 1.4), (1.3, 1.3, 2.6), 100.0, (0.05, 0.05, 0.1))
    assert correlated_noise(corrupt_gps(gps, errors, 1), 0.0) is not None
    assert correlated_noise(corrupt_gps(gps, errors, 1), 0.0, reported=False) is None


def test_a_claim_that_a_long_record_refutes_is_not_believed():
    gps = drives.perfect_gps(1.0, laps=32)  # forty minutes
    errors = GpsErrors((0.7, 0.7, 1.4), velocity_noise=(0.05, 0.05, 0.1))
    for seed in SEEDS:
        fixes = corrupt_gps(gps, errors, seed)
        assert correlated_noise(replace(fixes, position_sd=2.5 * fixes.position_sd), 0.0) is None
