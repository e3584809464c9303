"""Drives from segments: what is commanded, how smoothly, and how closely the motion follows it."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import ConfigError
from insnav.simulate.motion.vehicle import Vehicle, drive
from insnav.simulate.profile import Profile, Segment, commands
from tests.simulate.motions import PLACE

STILL = {"velocity_shake": (0.0, 0.0, 0.0), "angle_shake": (0.0, 0.0, 0.0)}
PROFILE = Profile(
    (
        Segment(10.0),
        Segment(8.0, speed=12.0),
        Segment(6.0, turn=1.5, grade=0.1),
        Segment(5.0),
        Segment(7.0, speed=0.0, turn=-0.5),
        Segment(4.0),
    ),
    heading=6.0,
)


def test_every_segment_ends_where_it_says_and_steady():
    command = commands(PROFILE)
    ends = np.cumsum([segment.duration for segment in PROFILE.segments])
    np.testing.assert_allclose(
        command(ends),
        [[0, 6, 0], [12, 6, 0], [12, 7.5, 0.1], [12, 7.5, 0.1], [0, 7, 0.1], [0, 7, 0.1]],
        atol=1e-12,
    )
    np.testing.assert_allclose(command(ends, 1), 0.0, atol=1e-10)


def test_commands_are_continuous_in_four_derivatives_and_not_in_five():
    polynomials = commands(PROFILE).derivatives[0]
    joints = polynomials.x[1:-1]
    jumps = [np.abs(polynomials(joints, nu) - polynomials(np.nextafter(joints, 0.0), nu)).max() for nu in range(6)]
    assert max(jumps[:5]) < 1e-9
    assert jumps[5] > 0.1


def test_the_motion_follows_the_commands():
    truth = drive(PROFILE, PLACE, Vehicle(**STILL), seed=0, start=50.0)
    t = np.linspace(0.0, 40.0, 1000)
    speed, heading, grade = commands(PROFILE)(t).T
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


def test_a_car_leans_out_of_the_turn_and_lifts_its_nose_when_accelerating():
    truth = drive(PROFILE, PLACE, Vehicle(mount=(0.01, 0.02, 0.0), **STILL), seed=0)
    at = truth.evaluate(np.array([5.0, 14.0, 21.0]))
    rest, accelerating, right_turn = at.rph
    np.testing.assert_allclose(rest[:2], [0.01, 0.02], atol=1e-12)
    assert accelerating[1] > 0.03
    assert right_turn[0] < -0.01
    # To the right: the seat pushes the body to the right.
    assert at.f_b[2, 1] > 1.0


def test_vibration_has_its_size_at_speed_and_is_absent_at_rest():
    profile = Profile((Segment(20.0), Segment(10.0, speed=10.0), Segment(300.0)))
    car = Vehicle(velocity_shake=(0.01, 0.02, 0.04), angle_shake=(0.002, 0.001, 0.0005))
    truth = drive(profile, PLACE, car, seed=3)
    moving = truth.evaluate(np.arange(31.0, 330.0, 0.01))
    right = moving.v_n[:, 1]  # it goes North
    sizes = np.std(np.column_stack([moving.v_n[:, 0], right, moving.v_n[:, 2], moving.rph[:, :2]]), axis=0)
    np.testing.assert_allclose(sizes, np.array([0.01, 0.02, 0.04, 0.002, 0.001]) / 2, rtol=0.1)
    at_rest = truth.evaluate(np.arange(0.0, 19.0, 0.01))
    assert np.abs(at_rest.v_n).max() < 1e-9
    assert np.ptp(at_rest.f_b, axis=0).max() < 1e-7
    assert np.ptp(at_rest.w_ib_b, axis=0).max() < 1e-9


def test_the_seed_decides_the_vibration():
    profile = Profile((Segment(5.0, speed=10.0), Segment(5.0)))
    first, again, other = (drive(profile, PLACE, Vehicle(), seed=seed) for seed in ((1, 0), (1, 0), (1, 1)))
    t = np.array([7.0])
    assert np.array_equal(first.evaluate(t).f_b, again.evaluate(t).f_b)
    assert not np.array_equal(first.evaluate(t).f_b, other.evaluate(t).f_b)


@pytest.mark.parametrize(
    ("segment", "key"),
    [
        (Segment(0.0), "duration"),
        (Segment(np.nan), "duration"),
        (Segment(1.0, speed=-1.0), "speed"),
        (Segment(1.0, turn=np.inf), "turn"),
        (Segment(1.0, grade=1.5), "grade"),
    ],
)
def test_a_drive_that_cannot_be_driven_is_refused_by_name(segment, key):
    with pytest.raises(ConfigError) as error:
        commands(Profile((Segment(1.0), segment)))
    assert error.value.where == f"segment 2: {key}"


def test_an_empty_drive_and_too_wide_knots_are_refused():
    with pytest.raises(ConfigError, match="no segments"):
        commands(Profile(()))
    with pytest.raises(ConfigError, match="heading"):
        commands(Profile((Segment(1.0),), heading=np.nan))
    with pytest.raises(ConfigError, match="too far apart"):
        drive(PROFILE, PLACE, Vehicle(), seed=0, knot_spacing=0.1)
