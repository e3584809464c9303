"""Jumps and drags that no gate sees are found by the adjoint of the smoother, down to the size that is stated."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.earth import lla_offset
from insnav.filter import FilterSettings, Navigator
from insnav.filter.shocks import ATTITUDE, DRIFT, KINDS, shocks
from insnav.filter.smoother import SmoothedErrors
from insnav.kernels.dynamics import NAV
from insnav.kernels.smoother import DRAG, SHOCK
from insnav.types import GpsData, ImuData
from tests.filter import drives

SEEDS = range(5)
AT = 150.0  # begin of what is wrong [s]
EAST = np.array([0.0, 1.0, 0.0])


@lru_cache(maxsize=200)
def smoothed(seed: int, kind: str = "", size: float = 0.0) -> SmoothedErrors:
    """Smoother of a drive whose fixes are wrong from a time on."""
    rng = np.random.default_rng([140, seed])
    imu, gps = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng), drives.noisy_gps(drives.perfect_gps(), rng)
    start = drives.begin(drives.MODEL, rng)
    if kind == "step":
        imu = replace(imu, gyro=imu.gyro + np.deg2rad(size) * 0.02 * np.outer(since(imu) >= 0.0, [0.0, 0.0, 1.0]))
    settings = FilterSettings(lever_b=drives.LEVER_B, output_interval=1.0, gates=drives.UNFAILING)
    wrong = WRONG[kind](gps, size) if kind in WRONG else gps
    navigator = Navigator(start.initial, drives.MODEL, wrong, start.alignment, 0.02, settings)
    navigator.feed(imu)
    return navigator.smoothed_errors()


def jump(gps: GpsData, size: float) -> GpsData:
    return replace(gps, lla=lla_offset(gps.lla, size * EAST * (since(gps) >= 0.0)[:, None]))


def drag(gps: GpsData, size: float) -> GpsData:
    """With velocities to match, to the end."""
    off = size * np.maximum(since(gps), 0.0)[:, None] * EAST
    return replace(gps, lla=lla_offset(gps.lla, off), v_n=gps.v_n + size * EAST * (since(gps) >= 0.0)[:, None])


def minute(gps: GpsData, size: float) -> GpsData:
    """Of drag while the velocities stay true."""
    return replace(gps, lla=lla_offset(gps.lla, size * np.clip(since(gps), 0.0, 60.0)[:, None] * EAST))


def since(data: GpsData | ImuData) -> np.ndarray:
    return np.asarray(data.time - drives.truth().start - AT)


WRONG = {"jump": jump, "drag": drag, "minute": minute}


def test_without_a_fault_the_gains_are_chi_square_distributed_and_nothing_is_said():
    for group, kind in enumerate(KINDS):
        gains = np.concatenate([smoothed(seed).shocks[:, SHOCK * group] for seed in SEEDS])
        gains = gains[np.isfinite(gains)]
        assert np.mean(gains) == pytest.approx(3.0, abs=1.2 if kind is DRIFT else 0.4)
        assert np.mean(gains > chi2.ppf(0.9, 3)) == pytest.approx(0.1, abs=0.12 if kind in (ATTITUDE, DRIFT) else 0.04)
        assert gains.max() < kind.limit
    assert not any(shocks(smoothed(seed)).surest for seed in SEEDS)


@pytest.mark.parametrize(("kind", "group", "size"), [("jump", 0, 3.0), ("drag", 1, 0.5), ("minute", 2, 0.2)])
def test_the_change_that_was_made_is_found_where_and_as_large_as_it_is(kind, group, size):
    for seed in SEEDS[:2]:
        change = shocks(smoothed(seed, kind, size)).surest
        found = np.linalg.norm(change.change)
        if group < 2:
            assert change.begin == pytest.approx(drives.truth().start + AT, abs=5.0)
            sd = np.nanmedian(smoothed(seed).shocks[:, SHOCK * group + 4])
            assert found == pytest.approx(size, abs=5.0 * sd)
        else:
            assert change.begin == pytest.approx(drives.truth().start + AT, abs=40.0)
            assert 0.4 * size < found / DRAG < 1.6 * size


def test_a_step_of_the_gyro_bias_is_found_where_and_as_large_as_it_is():
    for seed in SEEDS[:2]:
        change = shocks(smoothed(seed, "step", 0.05)).surest
        assert change.first == NAV
        assert change.time == pytest.approx(drives.truth().start + AT, abs=5.0)
        assert np.rad2deg(np.linalg.norm(change.change)) == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize(
    ("departs", "seen", "unseen"),
    [(0.0, [70.0, 200.0], [5.0, 50.0]), (80.0, [30.0, 60.0, 110.0], [5.0, 75.0, 95.0]), (1e4, [30.0, 90.0], [5.0])],
)
def test_a_change_is_looked_for_where_the_attitude_is_that_of_a_linear_model(departs, seen, unseen):
    found = smoothed(0)
    since_start, quiet = found.time - found.time[0], np.tile([1.0, 1.0, 0.0, 0.0, 0.1], 6)
    state = found.state.copy()
    state[:, 3:6] = np.outer(since_start >= departs, [10.0, 0.0, 0.0])
    for at in (*seen, *unseen):
        one = np.abs(since_start - at) < 0.6
        gains = np.where(one[:, None], [500.0, 1.0, 0.0, 0.0, 0.1] * 6, quiet)
        change = shocks(replace(found, state=state, shocks=gains)).surest
        assert (change is not None) is (at in seen)
        assert change is None or change.begin == pytest.approx(found.time[0] + at, abs=1.0)


@pytest.mark.parametrize(("kind", "group"), [("jump", 0), ("drag", 1), ("minute", 2)])
def test_what_is_stated_as_seen_is_seen_and_half_of_it_is_not(kind, group):
    found = dict.fromkeys((0.5, 1.0), 0)
    for part in found:
        for seed in SEEDS[:4]:
            least = shocks(smoothed(seed)).smallest[group]
            found[part] += bool(shocks(smoothed(seed, kind, part * float(least))).surest)
    print(f"{kind}: {found}")
    assert found[1.0] >= 3
    assert found[0.5] <= 1
