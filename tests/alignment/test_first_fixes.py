"""False fixes at the start of a record: left out where those after them outvote them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.alignment.align import count_false_start
from insnav.earth import lla_offset
from insnav.findings import Code, of_code
from insnav.types import GpsData

PLACE = np.array([0.8, 0.2, 300.0])


def fixes(way: np.ndarray, sd: float, seed: int, *, velocities: np.ndarray | None = None) -> GpsData:
    """Return fixes each second along a way, North, East, Down (n, 3) [m], with white noise of `sd` [m]."""
    rng = np.random.default_rng(seed)
    lla = lla_offset(np.tile(PLACE, (len(way), 1)), way + sd * rng.standard_normal(way.shape))
    v_n = np.full_like(way, np.nan) if velocities is None else velocities
    return GpsData(np.arange(len(way), dtype=float), lla, v_n, np.full_like(way, sd), np.full_like(way, 0.1))


def circle(speed: float, radius: float, count: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Return way [m] and velocity [m/s] on a circle, in closed form."""
    angle = speed / radius * np.arange(count)
    none = np.zeros(count)
    way = radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), none])
    return way, speed * np.column_stack([np.cos(angle), np.sin(angle), none])


MOTIONS = {
    "at rest": (np.zeros((30, 3)), np.zeros((30, 3))),
    "straight": (np.outer(np.arange(30), [20.0, -10.0, 0.5]), np.tile([20.0, -10.0, 0.5], (30, 1))),
    "braking": (np.outer(25.0 * np.arange(30) - 0.4 * np.arange(30) ** 2, [1.0, 0.0, 0.0]), None),
    "circle": circle(15.0, 60.0),
}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("false", [0, 1, 2])
def test_false_fixes_at_the_start_are_counted(name: str, known: bool, false: int):
    way, velocity = MOTIONS[name]
    for seed in range(50):
        gps = fixes(way, 2.0, seed, velocities=velocity if known else None)
        lla = gps.lla.copy()
        lla[:false] = lla_offset(lla[:false], np.array([700.0, -800.0, 0.0]))
        assert count_false_start(replace(gps, lla=lla)) == false


def test_a_fix_before_a_long_gap_is_not_judged():
    way = np.zeros((30, 3))
    way[1:] = [500.0, 0.0, 0.0]  # the vehicle went there meanwhile
    gps = fixes(way, 1.0, 1)
    assert count_false_start(replace(gps, time=np.concatenate([[0.0], 60.0 + np.arange(29.0)]))) == 0


def test_few_fixes_are_not_judged():
    gps = fixes(np.zeros((4, 3)), 1.0, 1)
    assert count_false_start(replace(gps, lla=gps.lla + np.array([[1e-3, 0, 0]] + [[0, 0, 0]] * 3))) == 0


@pytest.mark.parametrize("given", [True, False])
def test_one_false_first_fix_costs_nothing(given: bool):
    """With the IMU model given this drive was 167 m off, with a standard deviation of 169 km."""
    made = insnav.simulate("city", imu="automotive", seed=57)
    inputs = {"imu": "automotive"} if given else {}
    lla = made.gps.data.lla.copy()
    lla[0] = lla_offset(lla[0], np.array([1100.0, 0.0, 0.0]))
    rms, sd = [], []
    for gps in (made.gps.data, replace(made.gps.data, lla=lla)):
        result = insnav.load(made.imu.data, gps, made.reference.data, **inputs).navigate()
        rms.append(np.sqrt(np.mean(result.found.smoothed_errors.horizontal**2)))
        sd.append(np.sqrt(np.mean(result.found.run.smoothed.solution.sd[:, :2] ** 2)))
    assert rms[1] < 1.1 * rms[0]
    assert 1.0 / 1.1 < sd[1] / sd[0] < 1.1
    (finding,) = of_code(result.findings, Code.ALIGN_FALSE_START)
    assert finding["count"] == 1
