"""Errors against a reference: truth from pymap3d, closed-form motion and known distributions."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from insnav.errors.metrics import (
    TrajectoryErrors,
    accuracy,
    accuracy_by_motion,
    at_point,
    nees,
    position_errors,
)
from insnav.exceptions import InputError
from insnav.types import Trajectory

LAT, LON, HEIGHT = np.radians(48.0), np.radians(11.5), 500.0


def circle(time, *, radius=100.0, rate=0.2, lat=LAT, lon=LON):
    """Horizontal circle at constant rate, nose along the track; positions by pymap3d."""
    phase = rate * time
    north, east = radius * np.sin(phase), radius * (1.0 - np.cos(phase))
    where = pymap3d.ned2geodetic(north, east, 0.0 * time, lat, lon, HEIGHT, deg=False)
    # On a plane tangent at the centre the height above the ellipsoid would curve away: keep it level.
    lla = np.column_stack((where[0], where[1], np.full_like(time, HEIGHT)))
    v_n = radius * rate * np.column_stack((np.cos(phase), np.sin(phase), 0.0 * time))
    rph = np.column_stack((0.0 * time, 0.0 * time, phase % (2.0 * np.pi)))
    return Trajectory(time, lla, v_n, rph)


def errors_of(position, *, sd=None, speed=None):
    n = len(position)
    nothing = np.full((n, 3), np.nan)
    return TrajectoryErrors(
        np.arange(n, dtype=float), position, nothing, nothing, sd, np.full(n, 5.0) if speed is None else speed
    )


def test_a_known_displacement_comes_back_in_metres_north_east_down():
    time = np.arange(0.0, 30.0, 0.1)
    true = circle(time)
    lat, lon, height = pymap3d.ned2geodetic(3.0, -4.0, 2.0, *true.lla.T, deg=False)
    wrong = Trajectory(time, np.column_stack((lat, lon, height)), true.v_n + np.array([0.1, 0.2, -0.3]), true.rph)
    errors = position_errors(wrong, true)
    np.testing.assert_allclose(errors.position, np.tile([3.0, -4.0, 2.0], (len(time), 1)), atol=2e-5)
    np.testing.assert_allclose(errors.velocity, np.tile([0.1, 0.2, -0.3], (len(time), 1)), atol=1e-12)


def test_between_its_samples_a_10_hz_estimate_adds_less_than_a_tenth_of_a_millimetre():
    estimate = circle(np.arange(0.0, 30.0, 0.1))  # 4 m/s^2: the chord of a straight line is 5 mm off
    errors = position_errors(estimate, circle(np.arange(0.03, 29.9, 0.07)))
    assert np.max(np.abs(errors.position)) < 1e-4
    assert np.max(np.abs(errors.velocity)) < 6e-3  # linear: a dt^2 / 8 of the jerk
    assert np.max(np.abs(errors.attitude)) < 1e-9  # constant rate


def test_without_velocity_the_positions_alone_give_the_curve():
    estimate = circle(np.arange(0.0, 30.0, 0.1))
    estimate = Trajectory(estimate.time, estimate.lla, np.full_like(estimate.v_n, np.nan), estimate.rph)
    errors = position_errors(estimate, circle(np.arange(1.03, 28.9, 0.07)))
    assert np.max(np.abs(errors.position)) < 1e-4


def test_epochs_outside_or_inside_a_gap_are_left_out():
    time = np.concatenate((np.arange(0.0, 10.05, 0.1), np.arange(15.0, 20.05, 0.1)))
    errors = position_errors(circle(time), circle(np.arange(-3.0, 25.0, 0.5)))
    assert errors.time[0] == 0.0
    assert errors.time[-1] == 20.0  # the estimate ends there but for rounding
    assert not ((errors.time > 10.01) & (errors.time < 14.99)).any()
    assert {10.0, 15.0} <= set(np.round(errors.time, 6))


def test_nothing_in_common_says_both_spans():
    with pytest.raises(InputError) as caught:
        position_errors(circle(np.arange(0.0, 10.0, 0.1)), circle(np.arange(1000.0, 1010.0)))
    assert caught.value.values["reference_s"] == pytest.approx((1000.0, 1009.0))
    assert caught.value.values["solution_s"] == pytest.approx((0.0, 9.9))


@pytest.mark.parametrize("count", [0, 1])
def test_an_estimate_too_short_to_interpolate_is_compared_where_it_is(count):
    estimate = circle(np.arange(5.0, 5.0 + count))
    if count == 0:
        with pytest.raises(InputError):
            position_errors(estimate, circle(np.arange(10.0)))
    else:
        errors = position_errors(estimate, circle(np.arange(10.0)))
        assert errors.time.tolist() == [5.0]
        np.testing.assert_allclose(errors.position, 0.0, atol=1e-9)


def test_the_lever_arm_moves_position_and_velocity_by_the_attitude():
    time = np.arange(0.0, 30.0, 0.1)
    lever = np.array([1.0, -2.0, 0.5])
    inner = circle(time)
    phase = 0.2 * time
    offset = np.column_stack(
        (
            lever[0] * np.cos(phase) - lever[1] * np.sin(phase),
            lever[0] * np.sin(phase) + lever[1] * np.cos(phase),
            np.full_like(time, lever[2]),
        )
    )
    lat, lon, height = pymap3d.ned2geodetic(*offset.T, *inner.lla.T, deg=False)
    turning = 0.2 * np.column_stack((-offset[:, 1], offset[:, 0], 0.0 * time))
    outer = Trajectory(time, np.column_stack((lat, lon, height)), inner.v_n + turning, inner.rph)
    errors = position_errors(inner, outer, lever_b=lever)
    np.testing.assert_allclose(errors.position, 0.0, atol=2e-5)
    np.testing.assert_allclose(errors.velocity[1:-1], 0.0, atol=1e-4)
    assert np.max(np.abs(position_errors(inner, outer).position)) > 0.4


def test_a_lever_arm_makes_no_speed_out_of_a_gap():
    time = np.concatenate((np.arange(0.0, 5.0, 0.1), np.arange(10.0, 15.0, 0.1)))
    inner = circle(time, rate=1.0)
    moved = at_point(inner, np.array([3.0, 0.0, 0.0]))
    np.testing.assert_allclose(np.linalg.norm(moved.v_n - inner.v_n, axis=1), 3.0, rtol=2e-3)


def test_heading_error_takes_the_short_way_and_interpolation_too():
    time = np.arange(0.0, 10.0)
    level = np.zeros_like(time)
    base = circle(time, rate=0.0)
    heading = np.radians(np.where(np.arange(10) % 2, 359.0, 1.0))
    estimate = Trajectory(time, base.lla, base.v_n, np.column_stack((level, level, heading)))
    true = np.column_stack((level, level, np.radians(359.5) + level))
    errors = position_errors(estimate, Trajectory(time, base.lla, base.v_n, true))
    np.testing.assert_allclose(np.degrees(errors.attitude[:, 2]), np.where(np.arange(10) % 2, -0.5, 1.5), atol=1e-9)
    halves = position_errors(estimate, Trajectory(time[:-1] + 0.5, base.lla[:-1], base.v_n[:-1], true[:-1]))
    np.testing.assert_allclose(np.degrees(halves.attitude[:, 2]), 0.5, atol=1e-9)


def test_the_date_line_is_no_jump():
    here = position_errors(circle(np.arange(0.0, 30.0, 0.1)), circle(np.arange(0.05, 29.0, 0.1)))
    there = position_errors(
        circle(np.arange(0.0, 30.0, 0.1), lon=np.pi), circle(np.arange(0.05, 29.0, 0.1), lon=-np.pi)
    )
    np.testing.assert_allclose(there.position, here.position, atol=1e-6)


def test_what_the_reference_does_not_know_is_none_and_never_nan():
    time = np.arange(0.0, 10.0, 0.1)
    true = circle(time)
    unknown = np.full_like(true.v_n, np.nan)
    table = accuracy(position_errors(true, Trajectory(time, true.lla, unknown, unknown)))
    assert table is not None
    assert table["heading_deg"] is None
    assert table["velocity_north_m_s"] is None
    assert table["velocity_horizontal_m_s"] is None
    assert table["north_m"]["rms"] < 1e-6


def test_cep50_and_r95_of_a_circular_normal_distribution():
    n = 1001  # quantiles of a Rayleigh distance in all directions: closed form, nothing drawn
    radius = np.sqrt(-2.0 * np.log1p(-(np.arange(n) + 0.5) / n))
    angle = 2.399963 * np.arange(n)
    table = accuracy(errors_of(np.column_stack((radius * np.cos(angle), radius * np.sin(angle), 0.0 * radius))))
    assert table is not None
    assert table["cep50_m"] == pytest.approx(1.1774, abs=0.003)
    assert table["r95_m"] == pytest.approx(2.4477, abs=0.01)
    assert table["horizontal_m"]["rms"] == pytest.approx(np.sqrt(2.0), rel=0.01)
    assert table["north_m"]["p95"] == pytest.approx(1.96, abs=0.05)
    assert table["n"] == n


def test_static_and_moving_epochs_are_counted_apart():
    position = np.zeros((10, 3))
    position[:4, 0], position[4:, 0] = 1.0, -2.0
    table = accuracy_by_motion(errors_of(position, speed=np.where(np.arange(10) < 4, 0.1, 3.0)))
    assert (table["static"]["n"], table["moving"]["n"], table["all"]["n"]) == (4, 6, 10)
    assert table["static"]["north_m"]["mean"] == 1.0
    assert table["moving"]["north_m"] == {"mean": -2.0, "rms": 2.0, "p95": 2.0, "max": 2.0}
    assert accuracy_by_motion(errors_of(position))["static"] is None


def test_nees_is_one_and_997_are_inside_when_the_sd_is_true():
    rng = np.random.default_rng(3)
    sd = np.tile([0.5, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], (20000, 1))
    found = nees(errors_of(rng.normal(size=(20000, 3)) * sd[:, :3], sd=sd))
    assert found is not None
    assert found["position"]["nees"] == pytest.approx(1.0, abs=0.02)
    assert found["position"]["inside_3_sd"] == pytest.approx(0.9973, abs=0.001)
    assert found["velocity"] is None
    doubled = nees(errors_of(rng.normal(size=(20000, 3)) * sd[:, :3], sd=0.5 * sd))
    assert doubled is not None
    assert doubled["position"]["nees"] == pytest.approx(4.0, abs=0.1)


def test_without_stated_sd_there_is_no_consistency():
    assert nees(errors_of(np.zeros((3, 3)))) is None
