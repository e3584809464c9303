"""Rows at round and at wanted epochs, and at another point: against the exact motion, closed forms and drawn errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.attitude import dcm_from_rph, quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat, wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.filter.error_model import initial_state
from insnav.filter.run_recorder import covariance_at, move_to_point
from insnav.simulate import imu_from_truth
from insnav.types import Alignment, Epochs, ImuData, Run, Trajectory
from tests.filter import drives

POINT = np.array([1.5, -0.7, -2.2])
RATE = 50.0


def shifted_imu(shift: float = 0.0037) -> ImuData:
    """Samples that fall on no round time, with the exact increments of the drive."""
    motion = drives.truth(1)
    return imu_from_truth(motion, motion.start + shift + np.arange(round(70.0 * RATE) + 1) / RATE, "increment")


def begin(time: float) -> drives.Begin:
    """The exact state at a sample."""
    at = drives.truth(1).evaluate(np.array([time]))
    alignment = Alignment(time, at.rph[0], drives.START_SD[6:], np.zeros(3), np.full(3, np.inf), None, *drives.GIVEN)
    sd = drives.START_SD[:3], drives.START_SD[3:6]
    return drives.Begin(initial_state(alignment, drives.MODEL, at.lla[0], at.v_n[0], *sd), alignment)


def navigated(**settings: object) -> Run:
    """Fixes without weight leave the motion to the samples."""
    imu, gps = shifted_imu(), drives.perfect_gps(laps=1)
    gps = replace(gps, position_sd=1e4 * gps.position_sd, velocity_sd=1e4 * gps.velocity_sd)
    return drives.navigate(imu, gps, begin(float(imu.time[0])), drives.MODEL, **settings)


@pytest.fixture(scope="module")
def exact():
    """The drive from exact samples, fixes and start, with poses of another point at epochs between the samples."""
    epochs = 1000.0 + np.sort(np.random.default_rng(5).uniform(1.0, 69.0, 200))
    return navigated(output_interval=0.1, epochs=epochs, point_b=POINT), epochs


def test_rows_fall_on_round_epochs_and_are_exact_there(exact):
    run, _ = exact
    for track in (run.solution, run.smoothed.solution):
        np.testing.assert_allclose(track.time, np.round(track.time, 1), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(np.diff(track.time), 0.1, rtol=0.0, atol=1e-9)
        at = drives.truth(1).evaluate(track.time)
        # half the change of rate and force times the square of the time to the end of the sample, up to 20 ms
        h = 1e-3
        before, after = drives.truth(1).evaluate(track.time - h), drives.truth(1).evaluate(track.time + h)
        spin = np.abs(wrap_pi(after.rph - 2.0 * at.rph + before.rph)).max() / h**2
        jerk = np.abs(after.v_n - 2.0 * at.v_n + before.v_n).max() / h**2
        assert np.abs(wrap_pi(track.rph - at.rph)).max() < 1.1 * spin * 0.02**2 / 2.0
        assert np.abs(track.v_n - at.v_n).max() < 1.1 * jerk * 0.02**2 / 2.0
        assert np.abs(ned_offset(track.lla, at.lla)).max() < 2e-3


def test_rows_are_round_in_unix_time(exact):
    """A quarter of a microsecond is the resolution there."""
    run, _ = exact
    later = 1.7e9
    imu, gps, start = shifted_imu(), drives.perfect_gps(laps=1), begin(float(shifted_imu().time[0]))
    start = drives.Begin(
        replace(start.initial, time=start.initial.time + later),
        replace(start.alignment, time=start.alignment.time + later),
    )
    gps = replace(gps, time=gps.time + later)
    unix = drives.navigate(replace(imu, time=imu.time + later), gps, start, drives.MODEL, output_interval=0.1)
    np.testing.assert_allclose(unix.solution.time - later, run.solution.time, rtol=0.0, atol=5e-7)


def test_poses_are_at_their_epochs_and_at_their_point(exact):
    run, epochs = exact
    np.testing.assert_allclose(run.poses.time, epochs, rtol=0.0, atol=1e-9)
    at, h = drives.truth(1).evaluate(epochs), 1e-4

    def place(time: np.ndarray) -> np.ndarray:
        here = drives.truth(1).evaluate(time)
        return lla_offset(here.lla, dcm_from_rph(here.rph) @ POINT)

    assert np.abs(ned_offset(run.poses.lla, place(epochs))).max() < 2e-3
    # the velocity of the point by differences of its exact positions
    v_n = ned_offset(place(epochs + h), place(epochs - h)) / (2 * h)
    assert np.abs(run.poses.v_n - v_n).max() < 2e-3
    assert np.abs(wrap_pi(run.poses.rph - at.rph)).max() < 1e-6


def test_the_epochs_leave_the_solution_as_it_is(exact):
    run, _ = exact
    alone = navigated(output_interval=0.1)
    assert alone.poses is None
    assert np.abs(ned_offset(alone.smoothed.solution.lla, run.smoothed.solution.lla)).max() < 2e-3
    np.testing.assert_array_equal(alone.solution.time, run.solution.time)
    np.testing.assert_allclose(alone.solution.sd, run.solution.sd, rtol=1e-3)


def test_rows_are_round_on_the_clock_of_the_fixes():
    """Fixes 8 ms late: the filter finds this, and moves the rows by it at constant rate: 3.8 rad/s^2 (8 ms)^2 / 2."""
    gps, late = drives.perfect_gps(laps=1), 0.008
    gps = replace(gps, time=gps.time + late, position_sd=0.02 * gps.position_sd, velocity_sd=0.1 * gps.velocity_sd)
    imu = shifted_imu()
    how = {"output_interval": 0.1, "delay_sd": 0.05, "epochs": np.array([1033.3333])}
    run = drives.navigate(imu, gps, begin(float(imu.time[0])), drives.MODEL, **how)
    assert run.gps_delay == pytest.approx(late, abs=5e-4)
    track = run.smoothed.solution
    np.testing.assert_allclose(track.time, np.round(track.time, 1), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.poses.time, 1033.3333, rtol=0.0, atol=1e-9)
    for some in (track, run.poses):
        at = drives.truth(1).evaluate(some.time - late)
        assert np.abs(wrap_pi(some.rph - at.rph)).max() < 5e-4
        assert np.abs(ned_offset(some.lla, at.lla)).max() < 0.02


def test_every_sample_and_epochs_between_them():
    epochs = 1000.0 + np.array([5.0, 5.0037, 5.0101, 5.0102, 30.0])
    run = navigated(output_interval=0.0, epochs=epochs, blocks=40)
    np.testing.assert_allclose(run.poses.time, epochs, rtol=0.0, atol=2e-6)
    assert (np.diff(run.solution.time) > 0.0).all()
    assert np.isin(np.round(shifted_imu().time[5:-5], 6), np.round(run.solution.time, 6)).all()


def test_a_point_of_a_turning_body_moves_on_its_own_circle():
    """The IMU on a circle of 20 m to the right, at 0.5 rad/s: 3 m to the left the circle is 23 m wide."""
    radius, rate, lat = 20.0, 0.5, 0.6
    time = np.arange(0.0, 12.0, 0.1)
    heading = rate * time
    lla = lla_offset(
        np.tile([lat, 0.1, 50.0], (time.size, 1)),
        radius * np.column_stack([np.sin(heading), 1.0 - np.cos(heading), 0.0 * time]),
    )
    v_n = radius * rate * np.column_stack([np.cos(heading), np.sin(heading), 0.0 * time])
    rph = np.column_stack([0.0 * time, 0.0 * time, heading % (2 * np.pi)])
    w_eb_b = np.tile([0.0, 0.0, rate], (time.size, 1))
    track = Trajectory(time, lla, v_n, rph)
    none = np.zeros((time.size, 9, 9))
    moved = move_to_point(track, w_eb_b, np.array([0.0, -3.0, 0.0]), none, np.zeros(3))
    np.testing.assert_allclose(np.linalg.norm(moved.v_n, axis=1), 23.0 * rate, rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(moved.v_n, v_n * 23.0 / 20.0, rtol=0.0, atol=2e-6)
    centre = lla_offset(np.array([lat, 0.1, 50.0]), np.array([0.0, radius, 0.0]))
    distance = np.linalg.norm(ned_offset(moved.lla, np.tile(centre, (time.size, 1))), axis=1)
    np.testing.assert_allclose(distance, 23.0, rtol=0.0, atol=1e-3)  # of a plane on the ellipsoid


def test_the_standard_deviations_of_a_point_are_those_of_drawn_errors():
    rng = np.random.default_rng(2)
    sqrt = rng.standard_normal((9, 9)) * np.array([*[0.3] * 3, *[0.05] * 3, *[0.01] * 3])[:, None]
    p, w, rate_sd = sqrt @ sqrt.T, np.array([0.3, -0.4, 0.8]), np.array([0.01, 0.02, 0.03])
    lla, v_n, rph = np.array([[0.7, 0.2, 90.0]]), np.array([[9.0, 4.0, -1.0]]), np.array([[0.2, -0.3, 2.1]])
    n = 40_000
    error = rng.multivariate_normal(np.zeros(9), p, n)
    q = quat_multiply(quat_from_rotvec(-error[:, 6:]), np.tile(quat_from_rph(rph[0]), (n, 1)))
    of_rph = wrap_pi(rph_from_quat(q) - rph)
    sd = np.concatenate([np.sqrt(np.diag(p))[:6], of_rph.std(axis=0)])[None]
    exact = move_to_point(Trajectory(np.zeros(1), lla, v_n, rph, sd), w[None], POINT, p[None], rate_sd)
    drawn = Trajectory(
        np.zeros(n), lla_offset(np.tile(lla, (n, 1)), error[:, :3]), v_n + error[:, 3:6], rph_from_quat(q)
    )
    none = np.zeros((n, 9, 9))
    moved = move_to_point(drawn, w + rate_sd * rng.standard_normal((n, 3)), POINT, none, np.zeros(3))
    off = np.hstack([ned_offset(moved.lla, np.tile(exact.lla, (n, 1))), moved.v_n - exact.v_n])
    np.testing.assert_allclose(off.std(axis=0), exact.sd[0, :6], rtol=0.02)
    # a rotation between the sensor axes and the IMU, not in the covariance, moves the point, too
    wider = replace(Trajectory(np.zeros(1), lla, v_n, rph, sd), sd=sd + np.array([0] * 8 + [0.05]))
    assert move_to_point(wider, w[None], POINT, p[None], rate_sd).sd[0, 0] > exact.sd[0, 0]


def test_the_covariance_is_linear_between_epochs():
    covariance = np.array([np.eye(9), 3.0 * np.eye(9)])
    epochs = Epochs(np.array([10.0, 12.0]), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 4)), covariance)
    found = covariance_at(np.array([9.0, 10.5, 13.0]), epochs)
    np.testing.assert_allclose(found[:, 0, 0], [1.0, 1.5, 3.0])
    none = Epochs(np.empty(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 9, 9)))
    assert not covariance_at(np.array([1.0]), none).any()
