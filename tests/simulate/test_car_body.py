"""A car body: it follows the commanded motion, leans and squats, and shakes in proportion to the speed."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.simulate.motion.moves import Vehicle
from tests.simulate.motions import PLACE, Segment, drive

STILL = {"velocity_shake": (0.0, 0.0, 0.0), "angle_shake": (0.0, 0.0, 0.0)}
SEGMENTS = (
    Segment(10.0),
    Segment(8.0, speed=12.0),
    Segment(6.0, turn=1.5, grade=0.1),
    Segment(5.0),
    Segment(7.0, speed=0.0, turn=-0.5),
    Segment(4.0),
)


def commands(t: np.ndarray) -> np.ndarray:
    """Speed [m/s], heading and grade [rad] of `SEGMENTS`, each a smooth step of degree nine."""
    ends = [(0.0, 6.0, 0.0), (12.0, 6.0, 0.0), (12.0, 7.5, 0.1), (12.0, 7.5, 0.1), (0.0, 7.0, 0.1), (0.0, 7.0, 0.1)]
    value, begin = np.tile([0.0, 6.0, 0.0], (len(t), 1)), 0.0
    for segment, before, after in zip(SEGMENTS, [(0.0, 6.0, 0.0), *ends], ends, strict=False):
        x = np.clip((t - begin) / segment.duration, 0.0, 1.0)[:, None]
        smooth = x**5 * (126 - 420 * x + 540 * x**2 - 315 * x**3 + 70 * x**4)
        value += smooth * (np.array(after) - before)
        begin += segment.duration
    return value


def test_the_motion_follows_the_commands():
    truth = drive(SEGMENTS, PLACE, heading=6.0, body=Vehicle(**STILL), seed=0, start=50.0)
    assert truth.duration == pytest.approx(40.0)
    t = np.linspace(0.0, 40.0, 1000)
    speed, heading, grade = commands(t).T
    at = truth.evaluate(50.0 + t)
    expected = np.column_stack(
        [
            speed * np.cos(grade) * np.cos(heading),
            speed * np.cos(grade) * np.sin(heading),
            -speed * np.sin(grade),
        ]
    )
    np.testing.assert_allclose(at.v_n, expected, atol=1e-7)
    np.testing.assert_allclose(np.cos(at.rph[:, 2] - heading), 1.0, atol=1e-12)
    assert np.all((at.rph[:, 2] >= 0.0) & (at.rph[:, 2] < 2 * np.pi))
    climbed = np.trapezoid(speed * np.sin(grade), t)
    assert at.lla[-1, 2] - PLACE[2] == pytest.approx(climbed, abs=1e-4)


def test_every_segment_ends_where_it_says_and_steady():
    ends = np.cumsum([segment.duration for segment in SEGMENTS])
    at = drive(SEGMENTS, PLACE, heading=6.0, body=Vehicle(**STILL), seed=0).evaluate(ends)
    np.testing.assert_allclose(np.linalg.norm(at.v_n, axis=1), [0, 12, 12, 12, 0, 0], atol=1e-7)
    np.testing.assert_allclose(np.cos(at.rph[:, 2] - [6, 6, 7.5, 7.5, 7, 7]), 1.0, atol=1e-12)
    np.testing.assert_allclose(at.rph[:, 0], 0.0, atol=1e-7)  # no turn left to lean out of
    np.testing.assert_allclose(at.rph[:, 1], [0, 0, 0.1, 0.1, 0.1, 0.1], atol=1e-7)  # nothing to squat from


def test_a_car_leans_out_of_the_turn_and_lifts_its_nose_when_accelerating():
    truth = drive(SEGMENTS, PLACE, heading=6.0, roll=0.01, pitch=0.02, body=Vehicle(**STILL), seed=0)
    at = truth.evaluate(np.array([5.0, 14.0, 21.0]))
    rest, accelerating, right_turn = at.rph
    np.testing.assert_allclose(rest[:2], [0.01, 0.02], atol=1e-12)
    assert accelerating[1] > 0.03
    assert right_turn[0] < -0.01
    # To the right: the seat pushes the body to the right.
    assert at.f_b[2, 1] > 1.0


def test_vibration_has_its_size_at_speed_and_is_absent_at_rest():
    body = Vehicle(velocity_shake=(0.01, 0.02, 0.04), angle_shake=(0.002, 0.001, 0.0005))
    truth = drive((Segment(20.0), Segment(10.0, speed=10.0), Segment(300.0)), PLACE, body=body, seed=3)
    moving = truth.evaluate(np.arange(31.0, 330.0, 0.01))
    right = moving.v_n[:, 1]  # it goes North
    sizes = np.std(np.column_stack([moving.v_n[:, 0], right, moving.v_n[:, 2], moving.rph[:, :2]]), axis=0)
    np.testing.assert_allclose(sizes, np.array([0.01, 0.02, 0.04, 0.002, 0.001]) / 2, rtol=0.1)
    at_rest = truth.evaluate(np.arange(0.0, 19.0, 0.01))
    assert np.abs(at_rest.v_n).max() < 1e-9
    assert np.ptp(at_rest.f_b, axis=0).max() < 1e-7
    assert np.ptp(at_rest.w_ib_b, axis=0).max() < 1e-9


def test_the_seed_decides_the_vibration():
    segments = (Segment(5.0, speed=10.0), Segment(5.0))
    first, again, other = (drive(segments, PLACE, seed=seed) for seed in ((1, 0), (1, 0), (1, 1)))
    t = np.array([7.0])
    assert np.array_equal(first.evaluate(t).f_b, again.evaluate(t).f_b)
    assert not np.array_equal(first.evaluate(t).f_b, other.evaluate(t).f_b)
