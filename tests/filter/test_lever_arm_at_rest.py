"""What nobody can see of a lever arm, the filter does not claim to see; noise shows none; the IMU is placed rightly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.errors.metrics import position_errors
from insnav.filter.navigator import Navigator
from insnav.findings import Code, Severity, of_code
from insnav.kernels.measurements import antenna, correct_with_arm
from insnav.session.simulation import plan_of, profiled
from insnav.simulate.recording import load_gps
from insnav.units import DEG

ARM = np.array([2.2, 0.5, -1.6])
AT = 22


def test_a_correction_moves_the_antenna_as_its_derivative_says():
    """Where attitude and lever arm are corrected together: their product would be 90 mm."""
    x = np.array([0.8, 0.1, 200.0, 0.0, 0.0, 0.0, 0.9, 0.1, -0.1, np.sqrt(1.0 - 0.83)])
    arm, correction, swung = np.zeros(12), np.zeros(12), np.zeros(3)
    lla, none = x[:3].copy(), np.zeros(3)
    error = np.zeros(25)
    error[:3], error[6:9], error[AT : AT + 3] = [0.3, -0.2, 0.1], [0.02, -0.01, 0.07], [-1.2, 0.4, 0.9]
    z, h = np.zeros(6), np.zeros((6, 25))
    quaternion = x[6:].copy()
    correct_with_arm(x, correction, error, AT, arm, swung)
    assert np.abs(x[6:] - quaternion).max() > 0.01
    antenna(x, np.zeros(6), np.zeros(7), arm, 0.0, 0.0, lla, none, z, h)
    q0, q = quaternion[0], quaternion[1:]
    by_arm = 2.0 * q0 * np.cross(q, error[AT:], axis=0) + 2.0 * np.cross(q, np.cross(q, error[AT:])) + error[AT:]
    np.testing.assert_allclose(z[:3], -error[:3] - by_arm, atol=1e-5)
    np.testing.assert_allclose(arm[:3], -error[AT:])


@pytest.fixture(scope="module")
def drive():
    """A minute of rest, heading off by 4 deg, then turns; RTK fixes of an antenna 2.8 m from the IMU."""
    plan = plan_of(
        profiled("figure_eight", 9028),
        {"imu": "automotive", "gps": replace(load_gps("rtk"), lever_b=ARM), "seed": 9028},
    )
    made = plan.measured()
    imu, gps = made.imu, made.gps
    end = imu.time[0] + 170.0
    return insnav.load(imu.rows(imu.time < end), gps=gps.rows(gps.time < end)), made.reference


def test_rest_shows_neither_lever_arm_nor_heading(drive):
    drive, _ = drive
    ready = drive.until("noise").ready
    navigator = Navigator(ready)
    start = ready.imu.time[0]
    before = np.sqrt(np.diagonal(navigator._estimate.covariance))
    navigator.feed(ready.imu.rows(ready.imu.time < start + 55.0))
    after, at = np.sqrt(np.diagonal(navigator._estimate.covariance)), navigator._estimate.at
    assert (after[at.lever : at.lever + 3] > 0.9 * before[at.lever : at.lever + 3]).all()
    assert after[8] > 0.75 * before[8]


def test_positions_at_rest_and_later_are_inside_three_sd(drive):
    drive, reference = drive
    run = drive.navigate().found.run
    assert (np.abs(run.lever_b - ARM) < 3.0 * run.lever_sd).all()
    for solution in (run.solution, run.smoothed.solution):
        error = position_errors(solution, reference)
        inside = np.abs(error.position) <= 3.0 * error.sd[:, :3]
        assert inside.mean() > 0.97
        assert inside[error.time < error.time[0] + 55.0].mean() > 0.97


@pytest.mark.parametrize(("profile", "seed"), [("tunnel", 42), ("tunnel", 43), ("motorway", 43)])
def test_noise_of_gyros_makes_an_arm_no_shorter(profile, seed):
    """Gyros of 3 deg/sqrt(h) between few turns: it was 15 to 33 cm short, 5 to 10 standard deviations."""
    gps = replace(load_gps("rtk"), lever_b=ARM)
    made = plan_of(profiled(profile, seed), {"imu": "adxl103-class", "gps": gps, "seed": seed}).measured()
    end = made.imu.time[0] + 260.0
    some = made.imu.rows(made.imu.time < end), made.gps.rows(made.gps.time < end)
    run = insnav.load(*some, imu="adxl103-class").navigate().found.run
    assert (np.abs(run.lever_b - ARM) < 3.0 * run.lever_sd).all()
    assert (run.lever_sd_alone < 0.1).all()


@pytest.mark.parametrize("noise", [0.0, 1.0 * DEG])
def test_noise_of_gyros_that_hides_an_arm_is_said_and_takes_none_that_is_given(noise):
    """Of an aircraft, by RTK: fixes show an arm of a fifth of its length then, however long they go on."""
    gps = replace(load_gps("rtk"), lever_b=ARM)
    made = plan_of(profiled("aircraft_pattern", 42), {"imu": "industrial", "gps": gps, "seed": 42}).measured()
    end = made.imu.time[0] + 300.0
    imu, fixes = made.imu.rows(made.imu.time < end), made.gps.rows(made.gps.time < end)
    imu = replace(imu, gyro=imu.gyro + noise * np.random.default_rng(1).standard_normal(imu.gyro.shape))
    free, given = (insnav.load(imu, fixes, **arm).navigate() for arm in ({}, {"lever_arm": tuple(ARM)}))
    assert any(of_code(free.findings, Code.NOISE_HIDES_LEVER_ARM)) == bool(noise)
    assert (np.abs(free.found.run.lever_b - ARM) < 3.0 * free.found.run.lever_sd).all()
    error = position_errors(free.found.run.smoothed.solution, made.reference)
    assert np.mean(np.abs(error.position) <= 3.0 * error.sd[:, :3]) > 0.97
    warned = [each for each in given.findings if each.severity >= Severity.WARNING]
    assert [each.code for each in warned] == [Code.GIVEN_LEVER_ARM_KEPT] * bool(noise)  # and that is all
    np.testing.assert_array_equal(given.found.run.lever_b, ARM)
    run = free.found.run
    assert (np.abs(run.lever_b - ARM) < 3.0 * run.lever_sd_alone).all() == (not noise)  # what is said of noise is true


@pytest.mark.parametrize("seed", [15355, 15310])
def test_the_smoothed_track_before_a_gap_is_as_good_as_stated(seed):
    """Where the position after it was told lever arm and delay, and the smoother was not, its sd before was zero."""
    gps = replace(load_gps("rtk"), lever_b=np.array([-0.2, 0.1, -0.9]))
    made = plan_of(profiled("figure_eight", seed), {"imu": "consumer", "gps": gps, "seed": seed}).measured()
    begin = made.imu.time[0]
    rows = (made.imu.time < begin + 250.0) & (np.abs(made.imu.time - begin - 155.0) > 6.0)
    fixes = made.gps.rows(made.gps.time < begin + 250.0)
    run = insnav.load(made.imu.rows(rows), gps=replace(fixes, time=fixes.time + 0.3)).navigate().found.run
    track = run.smoothed.solution
    before = track.rows(track.time < begin + 149.0)
    errors = position_errors(replace(before, time=before.time - 0.3), made.reference)
    assert np.mean(np.abs(errors.position) <= 3.0 * errors.sd[:, :3]) > 0.97
    assert before.sd[:, :3].min() > 0.003
