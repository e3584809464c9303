"""Jumps and drags that no gate sees are found by the adjoint of the smoother, down to the size that is stated."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.earth import lla_offset
from insnav.filter import FilterSettings, Navigator
from insnav.filter.shocks import ATTITUDE, DRIFT, KINDS, Shocks, scatter, shocks
from insnav.filter.smoother import SmoothedErrors
from insnav.kernels.dynamics import NAV
from insnav.kernels.smoother import DRAG, SHOCK
from insnav.types import GpsData, ImuData, Innovations
from tests.filter import drives

SEEDS = range(5)
AT = 150.0  # begin of what is wrong [s]
EAST = np.array([0.0, 1.0, 0.0])


def smoothed(seed: int, kind: str = "", size: float = 0.0) -> SmoothedErrors:
    return navigated(seed, kind, size)[0]


def shown(seed: int, kind: str = "", size: float = 0.0) -> Shocks:
    return shocks(*navigated(seed, kind, size))


@lru_cache(maxsize=200)
def navigated(seed: int, kind: str, size: float) -> tuple[SmoothedErrors, Innovations]:
    """Smoother and innovations of a drive whose fixes are wrong from a time on."""
    rng = np.random.default_rng([140, seed])
    imu, gps = drives.noisy_imu(drives.perfect_imu(), drives.MODEL, rng), drives.noisy_gps(drives.perfect_gps(), rng)
    start = drives.begin(drives.MODEL, rng)
    if kind == "step":
        imu = replace(imu, gyro=imu.gyro + np.deg2rad(size) * 0.02 * np.outer(since(imu) >= 0.0, [0.0, 0.0, 1.0]))
    settings = FilterSettings(lever_b=drives.LEVER_B, output_interval=1.0, gates=drives.UNFAILING)
    wrong = WRONG[kind](gps, size) if kind in WRONG else gps
    navigator = Navigator(start.initial, drives.MODEL, wrong, start.alignment, 0.02, settings)
    navigator.feed(imu)
    found = navigator.history().smooth()
    rows = found.innovations[np.isfinite(found.innovations[:, 0])]
    noise = np.concatenate([gps.position_sd[0], gps.velocity_sd[0]])
    some = np.ones(rows.shape[0])
    time = found.time[np.isfinite(found.innovations[:, 0])]
    return found, Innovations(time, -rows[:, :6], np.sqrt(rows[:, 6:12] + noise**2), some, some, some > 0.0, some > 0.0)


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
    assert not any(shown(seed).surest for seed in SEEDS)


@pytest.mark.parametrize(("kind", "group", "size"), [("jump", 0, 3.0), ("drag", 1, 0.5), ("minute", 2, 0.2)])
def test_the_change_that_was_made_is_found_where_and_as_large_as_it_is(kind, group, size):
    for seed in SEEDS[:2]:
        change = shown(seed, kind, size).surest
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
        change = shown(seed, "step", 0.05).surest
        assert change.first == NAV
        assert change.time == pytest.approx(drives.truth().start + AT, abs=5.0)
        assert np.rad2deg(np.linalg.norm(change.change)) == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize(
    ("departs", "seen", "unseen"),
    [(0.0, [70.0, 200.0], [5.0, 50.0]), (80.0, [30.0, 60.0, 110.0], [5.0, 75.0, 95.0]), (1e4, [30.0, 90.0], [5.0])],
)
def test_a_change_is_looked_for_where_the_attitude_is_that_of_a_linear_model(departs, seen, unseen):
    found, innovations = navigated(0, "", 0.0)
    since_start, quiet = found.time - found.time[0], np.tile([1.0, 1.0, 0.0, 0.0, 0.1], 6)
    state = found.state.copy()
    state[:, 3:6] = np.outer(since_start >= departs, [10.0, 0.0, 0.0])
    for at in (*seen, *unseen):
        one = np.abs(since_start - at) < 0.6
        gains = np.where(one[:, None], [500.0, 1.0, 0.0, 0.0, 0.1] * 6, quiet)
        change = shocks(replace(found, state=state, shocks=gains), innovations).surest
        assert (change is not None) is (at in seen)
        assert change is None or change.begin == pytest.approx(found.time[0] + at, abs=1.0)


@pytest.mark.parametrize(("kind", "group"), [("jump", 0), ("drag", 1), ("minute", 2)])
def test_what_is_stated_as_seen_is_seen_and_half_of_it_is_not(kind, group):
    found = dict.fromkeys((0.5, 1.0), 0)
    for part in found:
        for seed in SEEDS[:4]:
            least = shown(seed).smallest[group]
            found[part] += bool(shown(seed, kind, part * float(least)).surest)
    print(f"{kind}: {found}")
    assert found[1.0] >= 3
    assert found[0.5] <= 1


@pytest.mark.parametrize("alike", [0.0, 0.5])
def test_noise_that_is_larger_than_stated_or_alike_for_long_counts_by_its_long_run_variance(alike):
    rng, n = np.random.default_rng(3), 4000
    u = rng.normal(size=(n, 6))
    for k in range(1, n):
        u[k] = alike * u[k - 1] + np.sqrt(1.0 - alike**2) * u[k]
    none, all_ = np.full(n, np.nan), np.ones(n, dtype=bool)
    time = np.arange(n) / 4.0
    of = [Innovations(time, size * u, np.ones((n, 6)), none, none, all_, all_) for size in (1.0, 1.4)]
    (once, count), (twice, _) = (scatter(each, time[80:-80]) for each in of)
    lags = sum(2.0 * (1.0 - lag / 4.0) * alike**lag for lag in (1, 2, 3))
    assert count.min() > 6 * 79
    assert np.mean(once / count) == pytest.approx(1.0 + lags, rel=0.07)
    assert np.mean(twice / count) == pytest.approx(1.9 * (1.0 + lags), rel=0.1)  # but for what lies beyond 3 sd


def test_no_change_is_named_where_noise_is_twice_what_is_stated():
    found, innovations = navigated(0, "", 0.0)
    gains = found.shocks.copy()
    gains[found.time.size // 2, 0] = 50.0
    assert shocks(replace(found, shocks=gains), innovations).surest is not None
    louder = replace(innovations, innovation=2.0 * innovations.innovation)
    assert shocks(replace(found, shocks=gains), louder).surest is None
