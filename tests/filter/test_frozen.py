"""Fixes that a receiver repeats while the vehicle goes on are none; a vehicle that is parked has its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.errors.evaluated_run import failure
from insnav.errors.metrics import position_errors
from insnav.filter.gates import without_frozen
from insnav.filter.navigate import navigate_recording
from insnav.filter.receiver import DELAY_SD, Delay, Receiver
from insnav.findings import NOT_MEASURED, Code, Finding, Severity, of_code
from insnav.imu import load_imu
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM, Recording, load_gps, simulate_recording
from insnav.types import GpsData, ImuData, Run
from tests.filter import drives

AT_REST = ImuData(np.arange(0.0, 120.0, 0.1), np.zeros((1200, 3)), np.tile([0.0, 0.0, -9.8], (1200, 1)))


@pytest.mark.parametrize(("coarse", "speed", "named"), [(1e-9, 2.4, True), (1e-5, 2.4, False), (1e-9, 0.3, False)])
def test_a_short_freeze_is_one_where_positions_are_written_finer_and_velocities_are_those_of_motion(
    coarse, speed, named
):
    """Five seconds in motion, one fix without velocity, and a minute at rest in which velocities drift by 0.3 m/s."""
    time, rows = np.arange(120.0), 6 if speed > 1.0 else 61
    v_n = np.tile([speed, 0.0, 0.0], (120, 1))
    noise = 0.3 * np.random.default_rng(1).standard_normal((120, 3))
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), time[:, None] * v_n + noise)
    lla[:, :2] = np.deg2rad(coarse) * np.round(np.rad2deg(lla[:, :2]) / coarse)
    lla[40 : 40 + rows], v_n[42] = lla[40], np.nan
    gps = GpsData(time, lla, v_n, np.ones((120, 3)), np.ones((120, 3)))
    found, said = without_frozen(gps, AT_REST)
    assert [event.code for event in said] == [Code.GPS_FROZEN] * named
    assert [(event["count"], event.begin, event.end) for event in said] == [(5, 40.0, 45.0)] * named
    assert np.flatnonzero(found.position_sd[:, 0] > 1.0).tolist() == [41, 42, 43, 44, 45] * named


def test_a_vehicle_at_rest_with_false_velocities_has_no_frozen_positions():
    """Fixes by RTK, which scatter by half of their standard deviation, while velocities are off by 8 m/s."""
    noise = 0.01 * np.random.default_rng(2).standard_normal((60, 3))
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (60, 1)), noise)
    v_n = np.tile([8.0, 0.0, 0.0], (60, 1))
    gps = GpsData(np.arange(60.0), lla, v_n, np.full((60, 3), 0.02), np.ones((60, 3)))
    found, (said,) = without_frozen(gps, AT_REST)
    np.testing.assert_array_equal(found.position_sd, gps.position_sd)
    assert said.code is Code.GPS_FROZEN_VELOCITY


@pytest.mark.parametrize(("speed", "frozen"), [(0.0, []), (20.0, [41])], ids=["at rest", "in motion"])
def test_a_false_velocity_at_rest_freezes_none_and_a_fix_that_is_repeated_in_motion_is_none(speed, frozen):
    """Positions written alike for 50 s and one velocity off by 5 m/s; one fix that is that of the second before."""
    v_n = np.tile([speed, 0.0, 0.0], (60, 1))
    scatter = 0.1 * np.random.default_rng(3).standard_normal((60, 3))
    scatter[10:] *= speed > 0.0
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (60, 1)), np.arange(60.0)[:, None] * v_n + scatter)
    lla[41] = lla[40]
    v_n[20] += 5.0 * (speed == 0.0)
    gps = GpsData(np.arange(60.0), lla, v_n, np.ones((60, 3)), np.ones((60, 3)))
    found, _ = without_frozen(gps, AT_REST)
    assert np.flatnonzero(found.position_sd[:, 0] > 1.0).tolist() == frozen


def city() -> Recording:
    truth = load_profile("city").truth((5, MOTION_STREAM))
    return simulate_recording(truth, load_imu("automotive"), load_gps("single"), 5)


def navigated(made: Recording, gps: GpsData, most: float) -> tuple[Run, Finding]:
    """Run with an unknown delay, and the finding on fixes; no horizontal error is larger than `most` [m]."""
    run = navigate_recording(made.imu, gps, load_imu("automotive"), Receiver(delay=Delay(sd=DELAY_SD))).run
    assert run.smoothed is not None
    errors = position_errors(run.smoothed.solution, made.reference)
    assert np.hypot(*errors.position[:, :2].T).max() < most
    (said,) = of_code(run.events, *NOT_MEASURED)
    return run, said


@pytest.mark.parametrize("velocities", [True, False], ids=["repeated velocities", "positions alone"])
def test_fixes_that_are_repeated_whole_are_none(velocities):
    """Velocities at which it stopped carried the solution 2.2 km away; positions alone were used, 0.5 km off."""
    made = city()
    stale, gps = slice(200, 320), made.gps if velocities else drives.without_velocities(made.gps)
    lla, v_n = gps.lla.copy(), gps.v_n.copy()
    lla[stale], v_n[stale] = lla[200], v_n[200]
    run, said = navigated(made, replace(gps, lla=lla, v_n=v_n), 15.0)
    assert said.code is Code.GPS_FROZEN
    assert said.severity is Severity.WARNING
    assert said["distance_m" if velocities else "scatter_m_s2"] > said["limit_m" if velocities else "limit_m_s2"]
    assert not failure(run)


@pytest.mark.parametrize(("since", "value"), [(0, 0.0), (200, 0.0), (200, None)], ids=["none", "zeros", "held"])
def test_velocities_that_stay_the_same_in_motion_are_none(since, value):
    """Loggers write zeros for what is not given: it was refused as never moving, 55 m off, or late by half a second."""
    made = city()
    v_n = made.gps.v_n.copy()
    v_n[since : since + 100 if value is None else None] = v_n[since] if value is None else value
    _, said = navigated(made, replace(made.gps, v_n=v_n), 6.0)
    assert said.code is Code.GPS_FROZEN_VELOCITY
    assert said["distance_m"] > said["limit_m"]


@pytest.mark.parametrize("held", [5.0, 0.0])
def test_of_a_held_velocity_the_first_is_measured_and_of_zeros_none(held):
    """A vehicle goes north ever faster; the receiver repeats its velocity, or says 0, for a minute."""
    time = np.arange(120.0)
    v_n = np.outer(0.25 * time, [1.0, 0.0, 0.0])
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), np.outer(0.125 * time**2, [1.0, 0.0, 0.0]))
    shaken = replace(AT_REST, accel=AT_REST.accel + np.sin(0.3 * AT_REST.time)[:, None] * [1.0, 0.0, 0.0])
    v_n[20:80] = [held, 0.0, 0.0]
    found, said = without_frozen(GpsData(time, lla, v_n, np.ones((120, 3)), np.ones((120, 3))), shaken)
    assert [event.code for event in said] == [Code.GPS_FROZEN_VELOCITY]
    lost = np.flatnonzero(np.isnan(found.v_n).any(axis=1))
    np.testing.assert_array_equal(lost, np.arange(21 if held else 20, 80))


def test_velocities_that_are_zero_at_rest_or_steady_in_motion_are_used():
    """Positions wander by metres; on a straight way they go where the velocity says."""
    time, noise = np.arange(120.0), np.cumsum(np.random.default_rng(4).standard_normal((120, 3)), axis=0)
    shaken = replace(AT_REST, accel=AT_REST.accel + np.sin(0.3 * AT_REST.time)[:, None] * [1.0, 0.0, 0.0])
    for speed in (0.0, 20.0):
        v_n = np.tile([speed, 0.0, 0.0], (120, 1))
        lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), time[:, None] * v_n + 0.5 * noise)
        gps = GpsData(time, lla, v_n, np.ones((120, 3)), np.ones((120, 3)))
        found, said = without_frozen(gps, shaken)
        assert said == []
        np.testing.assert_array_equal(found.v_n, v_n)


def test_fixes_that_go_straight_on_in_a_tunnel_are_none():
    """40 s of a country road: the delay was 22 sd off, 52 % of velocities inside 3 sd: theirs does not grow."""
    made = city()
    first, gps = 220, made.gps
    coasts, since = slice(first, first + 41), (gps.time - gps.time[first])[first : first + 41, None]
    lla, v_n = gps.lla.copy(), gps.v_n.copy()
    v_n[coasts] = v_n[first]
    assert np.linalg.norm(v_n[first]) > 5.0
    lla[coasts] = lla_offset(np.tile(lla[first], (41, 1)), since * v_n[first])
    _, said = navigated(made, replace(gps, lla=lla, v_n=v_n), 6.0)
    assert said.code is Code.GPS_EXTRAPOLATED
    assert said["duration_s"] == pytest.approx(40.0)


@pytest.mark.parametrize(("scatter", "straight", "named"), [(0.5, 10, True), (0.5, 60, False), (0.0, 10, False)])
def test_fixes_with_noise_of_their_own_on_a_straight_way_are_used(scatter, straight, named):
    """Velocities written in steps; and positions without any noise, as of programs, that go straight on for long."""
    time, rng = np.arange(120.0), np.random.default_rng(6)
    v_n = np.tile([20.0, 0.0, 0.0], (120, 1)) + 0.1 * rng.standard_normal((120, 3))
    v_n[40 : 40 + straight] = v_n[40]
    way = np.cumsum(np.vstack([np.zeros(3), 0.5 * (v_n[1:] + v_n[:-1])]), axis=0)
    noise = scatter * rng.standard_normal((120, 3))
    noise[40 : 40 + straight] = noise[40] if scatter else 0.5 * rng.standard_normal((straight, 3))
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), way + noise)
    gps = GpsData(time, lla, v_n, np.ones((120, 3)), np.ones((120, 3)))
    found, said = without_frozen(gps, AT_REST)
    assert [event.code for event in said] == [Code.GPS_EXTRAPOLATED] * named
    assert np.flatnonzero(found.position_sd[:, 0] > 1.0).tolist() == list(range(41, 50)) * named
    assert np.isnan(found.v_n[41:50]).all() == named


@pytest.mark.parametrize("jitter", [1e-3, 0.05])
def test_positions_that_repeat_but_for_jitter_are_frozen(jitter):
    """A motorway, 30 s: with 0.1 mm used they left 254 m; by gates alone 183 m, 97.8 % of positions inside 3 sd."""
    truth = load_profile("motorway").truth((12, MOTION_STREAM))
    made = simulate_recording(truth, load_imu("consumer"), load_gps("single"), 12)
    held = (made.gps.time > made.gps.time[0] + 160.0) & (made.gps.time < made.gps.time[0] + 190.0)
    lla, noise = made.gps.lla.copy(), jitter * np.random.default_rng(3).standard_normal((int(held.sum()), 3))
    lla[held] = lla_offset(np.tile(lla[held][0], (int(held.sum()), 1)), noise)
    found, said = without_frozen(replace(made.gps, lla=lla), made.imu)
    assert [each.code for each in said] == [Code.GPS_FROZEN]
    assert (held[1:] >= (found.position_sd[1:, 0] > 100.0)).all()
    assert np.mean(found.position_sd[held, 0] > 100.0) > 0.9
    assert without_frozen(made.gps, made.imu)[1] == []


def test_a_parked_vehicle_whose_receiver_holds_its_position_has_it():
    """As many receivers do; driven off after a minute."""
    time = np.arange(120.0)
    way = np.maximum(time - 60.0, 0.0)[:, None] * [5.0, 0.0, 0.0]
    lla = lla_offset(np.tile([0.8, 0.2, 100.0], (120, 1)), way)
    gps = GpsData(time, lla, np.full((120, 3), np.nan), np.ones((120, 3)), np.full((120, 3), np.nan))
    assert without_frozen(gps, AT_REST)[1] == []
    shaken = replace(AT_REST, accel=AT_REST.accel + np.sin(0.3 * AT_REST.time)[:, None] * [1.0, 0.0, 0.0])
    found, said = without_frozen(gps, shaken)
    assert len(said) == 1
    assert np.flatnonzero(found.position_sd[:, 0] > 1.0).tolist() == list(range(1, 61))
