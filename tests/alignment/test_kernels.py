"""Kernels of the alignment against scipy and numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insnav.kernels.alignment import level_history, mean_rotation, window_scatter


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_rotation_between_vectors_is_that_of_scipy(sign):
    rng = np.random.default_rng(3)
    felt, true = rng.normal(size=(6, 12, 3)), Rotation.random(6, rng=rng)
    seen = sign * np.array([turn.apply(some) for turn, some in zip(true, felt, strict=True)])
    seen += 0.05 * rng.normal(size=seen.shape)
    each, mean, away = np.empty((6, 3, 3)), np.empty((3, 3)), np.empty(6)
    mean_rotation(seen, felt, np.ones(6), sign, each, mean, away)
    for found, a, b in zip(each, seen, felt, strict=True):
        np.testing.assert_allclose(found, sign * Rotation.align_vectors(sign * a, b)[0].as_matrix(), atol=1e-12)
    assert np.linalg.det(mean) == pytest.approx(sign)
    np.testing.assert_allclose(away, np.linalg.norm(each - mean, axis=(1, 2)), atol=1e-12)


def test_a_window_that_is_turned_does_not_turn_the_mean():
    """One of ten by 90 deg, which would turn the mean by 6 deg if it counted as the others do."""
    rng = np.random.default_rng(4)
    felt = rng.normal(size=(10, 12, 3))
    seen = felt + 0.001 * rng.normal(size=felt.shape)
    seen[3] = felt[3] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    mean = np.empty((3, 3))
    mean_rotation(seen, felt, np.ones(10), 1.0, np.empty((10, 3, 3)), mean, np.empty(10))
    assert Rotation.from_matrix(mean).magnitude() < np.deg2rad(0.5)


@pytest.mark.parametrize("instant", [True, False])
def test_means_and_scatter_of_windows_are_those_of_numpy(instant):
    rng = np.random.default_rng(5)
    dt, samples = rng.uniform(0.01, 0.02, 43), rng.normal(3.0, 1.0, (2, 43, 3))
    mean, loud = np.empty((2, 4, 3)), np.empty((2, 4))
    window_scatter(dt, *samples, instant, 10, 3, 0, 4, mean, loud)
    rates = (samples if instant else samples / dt[:, None])[:, 3:].reshape(2, 4, 10, 3)
    np.testing.assert_allclose(mean, rates.mean(axis=2), rtol=1e-13)
    np.testing.assert_allclose(loud, np.linalg.norm(rates.std(axis=2), axis=-1), rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_turn_and_level_velocity_do_not_depend_on_the_mounting(seed: int) -> None:
    """Closed form of a vehicle that stands, turns at 0.2 rad/s and gains 3 m/s; the IMU is turned at random in it."""
    step, mount = 0.01, Rotation.random(random_state=seed).as_matrix()
    time = step * (np.arange(800) + 0.5)
    rate, ahead = np.where(time > 2.0, 0.2, 0.0), np.where((time > 3.0) & (time < 6.0), 1.0, 0.0)
    speed, none = np.cumsum(ahead) * step, np.zeros(800)
    gyro = np.column_stack([none, none, rate]) @ mount
    force = np.column_stack([ahead, speed * rate, none - 9.81]) @ mount
    turn, change = np.empty(801), np.empty((801, 2))
    level_history(np.full(800, step), step * gyro, step * force, np.zeros(3), 1e6, turn, change)
    np.testing.assert_allclose(turn[1:], np.cumsum(rate) * step, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(change[1:], axis=1), speed, atol=0.02)
    # in axes that do not turn with the vehicle: 3 m/s gained at headings of 0.2 to 0.8 rad, then 0.4 rad more
    direction = np.unwrap(np.arctan2(change[601:, 1], change[601:, 0]))
    np.testing.assert_allclose(direction - direction[0], 0.2 * step * np.arange(200), atol=5e-3)


def test_the_level_bias_of_gyros_shows_in_gravity_at_rest() -> None:
    """Gravity holds the down axis against it; a twentieth is lost in the first time constant, 10 s of 200 s."""
    mount, bias = Rotation.random(random_state=4).as_matrix(), np.array([1e-3, -2e-3, 1.5e-3])
    n, step = 20_000, 0.01
    down, found = mount.T @ [0.0, 0.0, 1.0], np.zeros(3)
    force = np.tile(-9.81 * step * down, (n, 1))
    level_history(
        np.full(n, step), np.tile(step * bias, (n, 1)), force, found, 10.0, np.empty(n + 1), np.empty((n + 1, 2))
    )
    np.testing.assert_allclose(found, 0.95 * (bias - (bias @ down) * down), atol=5e-5)
