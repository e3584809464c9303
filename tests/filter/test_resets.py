"""What the filter lives through, as sure as it says; and what resets it or stops it, by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.attitude import dcm_from_quat
from insnav.earth import ned_offset
from insnav.exceptions import InputError
from insnav.filter.estimate import Engine
from insnav.filter.navigate import navigate_recording
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import GivenStart, Start
from insnav.filter.receiver import LeverArm, Receiver
from insnav.findings import Code
from insnav.kernels.measurements import antenna
from insnav.simulate import Truth, gps_from_truth, imu_from_truth, reference
from insnav.types import GpsData, Run
from insnav.units import DEG, DEG_PER_H
from tests.filter import drives
from tests.filter import test_gates as gates
from tests.filter.drives import without_velocities
from tests.filter.test_gates import SPIKED, apart, kinds, moved, run_with
from tests.refusals import refused
from tests.simulate.motions import Segment, drive

recorded, untouched = gates.recorded, gates.untouched  # fixtures

RESET = Code.FILTER_RESET


def only(gps: GpsData, keep: np.ndarray) -> GpsData:
    return GpsData(*(getattr(gps, n)[keep] for n in ("time", "lla", "v_n", "position_sd", "velocity_sd")))


# ---- resets


def test_a_fix_that_admits_to_be_poor_does_not_lend_its_velocity(recorded, untouched):
    def change(gps):
        v, sd = gps.v_n.copy(), gps.position_sd.copy()
        v[SPIKED], sd[SPIKED] = [1e4, -1e4, 3e3], 200.0
        return replace(gps, v_n=v, position_sd=sd)

    run = run_with(recorded, change)
    assert kinds(run) == [Code.GATE_QUALITY, Code.GATE_PHYSICAL_VELOCITY]
    assert apart(run, untouched).max() <= 0.5


def test_a_receiver_without_a_fix_never_resets(recorded):
    """For half a minute the position is frozen and the fix type 0: as if there were no fixes."""
    tunnel = slice(SPIKED, SPIKED + 30)

    def frozen(gps):
        fix, lla = np.ones(gps.time.size, dtype=np.int64), gps.lla.copy()
        fix[tunnel], lla[tunnel] = 0, lla[SPIKED]
        return replace(gps, fix=fix, lla=lla)

    run = run_with(recorded, frozen)
    assert kinds(run) == [Code.GATE_QUALITY] * 30
    absent = run_with(recorded, lambda gps: only(gps, ~np.isin(np.arange(gps.time.size), np.r_[tunnel])))
    assert apart(run, absent).max() <= 0.01


def test_two_spikes_with_a_gap_between_are_no_row(recorded):
    def change(gps):
        gps = moved(gps, [SPIKED, SPIKED + 20], [300.0, 0.0, 0.0])
        gps = replace(gps, v_n=np.full_like(gps.v_n, np.nan))
        return only(gps, ~np.isin(np.arange(gps.time.size), np.arange(SPIKED + 1, SPIKED + 20)))

    run = run_with(recorded, change)
    assert kinds(run) == [Code.GATE_POSITION] * 2


@pytest.mark.parametrize("gap", [False, True])
def test_a_position_set_to_a_fix_is_as_unsure_as_lever_arm_and_delay(gap):
    """After a reset the antenna is as sure as the fix, by the derivative of the measurement."""
    start = drives.begin(drives.MODEL, np.random.default_rng(3))
    initial = replace(start.initial, v_n=np.array([12.0, -5.0, 1.0]))
    begin, gps = drives.Begin(initial, start.alignment), drives.perfect_gps()
    ready = drives.ready(drives.perfect_imu(), gps, begin, lever_b=np.zeros(3), lever_sd=0.7, delay_sd=0.05)
    estimate = Navigator(ready)._estimate
    if gap:
        fix = initial.covariance[:3, :3]
        estimate.go_on(initial, 10.0)
    else:
        fix = 9.0 * 0.1**2 * np.eye(3)
        estimate.restart(initial.time, np.zeros(6), np.full(3, 0.1), None)
    z, h = np.zeros(6), np.zeros((6, estimate.at.states))
    antenna(estimate.x, np.zeros(6), np.zeros(7), estimate.arm, 0.0, 0.0, gps.lla[0], np.zeros(3), z, h)
    h[:3, estimate.at.lever : estimate.at.lever + 3] = dcm_from_quat(estimate.x[6:])
    p = estimate.covariance
    if gap:  # the smoother's transition to it has no delay and no lever arm: the position is independent of both
        np.testing.assert_array_equal(p[:3, estimate.at.delay :], 0.0)
    else:
        np.testing.assert_allclose(h[:3] @ p @ h[:3].T, fix, atol=1e-12)
    np.testing.assert_allclose(
        p[:3, :3], fix + 0.7**2 * np.eye(3) + 0.05**2 * np.outer(initial.v_n, initial.v_n), atol=1e-12
    )


def test_slow_fixes_reset_too(recorded):
    """One fix in four seconds: a row of rejections is not broken by the pace of the receiver."""

    def change(gps):
        jumped = moved(gps, slice(SPIKED, None), [300.0, -400.0, 0.0])
        return only(jumped, np.arange(gps.time.size) % 4 == 0)

    assert kinds(run_with(recorded, change)).count(RESET) == 1


@pytest.mark.parametrize("velocity", ["none", "false"])
def test_a_permanent_jump_resets_once_whatever_the_velocities(recorded, velocity):
    """Without velocities, and with 1 km/s right where the reset is due."""
    jump = np.array([300.0, -400.0, 0.0])

    def change(gps):
        v = gps.v_n.copy()
        if velocity == "none":
            v[:] = np.nan
        else:
            v[SPIKED + 9 : SPIKED + 13] += 1e3
        return moved(replace(gps, v_n=v), slice(SPIKED, None), jump)

    run = run_with(recorded, change)
    (reset,) = (event for event in run.events if event.code is RESET)
    assert reset["distance_m"] == pytest.approx(500.0, abs=10.0)
    true = reference(drives.truth(3), run.solution.time)
    later = run.solution.time > reset.begin
    assert np.abs(run.solution.v_n - true.v_n)[later].max() < 12.0
    error = ned_offset(run.solution.lla, true.lla) - jump
    assert (np.abs(error) <= 4.0 * run.solution.sd[:, :3])[later].all()


@pytest.mark.parametrize("axis", range(3))
def test_a_gyro_bias_that_steps_is_found_after_one_reset(recorded, axis):
    """By half a degree a second, in bends and straight on: ten seconds of rejections, then right again."""
    imu, gps, start = recorded
    stepped, at = imu.gyro.copy(), 1100.0
    dt = float(np.median(np.diff(imu.time)))
    stepped[imu.time > at, axis] += 0.5 * DEG * dt
    run = drives.navigate(replace(imu, gyro=stepped), gps, start, drives.MODEL)
    assert kinds(run).count(RESET) <= 2
    true = reference(drives.truth(3), run.solution.time)
    error = np.abs(ned_offset(run.solution.lla, true.lla))
    later = run.solution.time > at + 60.0
    assert np.mean(error[later] <= 3.0 * run.solution.sd[later, :3]) > 0.97
    assert error[later].max() < 3.0


# ---- holes and poles


@pytest.mark.parametrize(
    ("begin", "length"),
    [*((time, length) for time in (1083.0, 1092.0, 1100.0, 1117.0) for length in (1.0, 2.0, 3.0)), (1130.0, 10.0)],
)
def test_a_hole_is_bridged_as_surely_as_it_says(begin, length):
    """In bends, on the straight, and the longest at rest."""
    ratios = []
    true = drives.truth(3)
    for seed in range(4):
        rng = np.random.default_rng([9, seed])
        imu = drives.noisy_imu(drives.perfect_imu(laps=3), drives.MODEL, rng)
        keep = (imu.time <= begin) | (imu.time > begin + length - 1e-3)
        imu = replace(imu, time=imu.time[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])
        gps = drives.noisy_gps(drives.perfect_gps(laps=3), rng)
        run = drives.navigate(imu, gps, drives.begin(drives.MODEL, rng, laps=3), drives.MODEL)
        late = run.solution.time > begin - 1.0
        at = reference(true, run.solution.time[late])
        turned = (run.solution.rph[late] - at.rph + np.pi) % (2 * np.pi) - np.pi
        error = np.column_stack([ned_offset(run.solution.lla[late], at.lla), run.solution.v_n[late] - at.v_n, turned])
        ratios.append(np.abs(error) / run.solution.sd[late])
        assert RESET not in kinds(run)
        assert run.solution.sd[:, 8].max() < 1.0  # not so unsure that a linear filter makes no sense
    print(f"inside 3 sd: {np.mean(np.array(ratios) <= 3.0):.3f}, largest {np.max(ratios):.1f} sd")
    # without noise of second order down to 0.979, and 6.9 sd
    assert np.mean(np.array(ratios) <= 3.0) >= 0.99
    assert np.max(ratios) < 5.0


def driven_at(lat_deg: float) -> tuple[Run, Truth]:
    lap = (Segment(10.0, speed=20.0), Segment(20.0), Segment(10.0, turn=90 * DEG), Segment(20.0))
    motion = drive(lap, np.array([lat_deg * DEG, 1.0, 100.0]), seed=2)
    imu = imu_from_truth(motion, np.arange(round(motion.duration * 50.0) + 1) / 50.0)
    gps = gps_from_truth(motion, np.arange(1.0, motion.duration), drives.LEVER_B)
    n = gps.time.size
    gps = replace(gps, position_sd=np.full((n, 3), 0.5), velocity_sd=np.full((n, 3), 0.1))
    at = motion.evaluate(imu.time[:1])
    start = Start(imu.time[0], at.lla[0], at.v_n[0], at.rph[0], np.full(3, 0.5), np.full(3, 0.1), np.full(3, 0.3 * DEG))
    receiver = Receiver(LeverArm(drives.LEVER_B))
    return navigate_recording(imu, gps, drives.SPEC, receiver, known=GivenStart(start)).run, motion


@pytest.mark.parametrize("lat_deg", [89.9, -89.9])
def test_ten_kilometres_from_a_pole_are_navigated(lat_deg):
    run, motion = driven_at(lat_deg)
    assert run.events == ()
    error = ned_offset(run.solution.lla, reference(motion, run.solution.time).lla)
    assert np.abs(error).max() < 0.1  # perfect sensors and fixes


def test_a_track_across_a_pole_ends_by_name():
    with refused(InputError, "filter.at_pole") as caught:
        driven_at(89.987)
    assert caught.value.exit_code == 3
    assert caught.value.where.startswith("t = ")


# ---- repairs


def test_a_repair_leaves_small_variances_alone():
    """A gyro bias of 0.01 deg/h beside a position of 100 m: ratio 4e30 of the variances."""
    sd = np.concatenate([np.full(3, 100.0), np.ones(6), np.full(3, 0.01 * DEG_PER_H), np.full(3, 1e-4), np.zeros(6)])
    p = np.diag(sd**2)
    p[3, 3] = -1e-6
    engine = Engine(p)
    assert engine.predict(np.eye(21), np.zeros((21, 21)), 0.0) is True
    assert engine.covariance[3, 3] >= 0.0
    np.testing.assert_allclose(np.delete(np.diag(engine.covariance), 3), np.delete(sd**2, 3), rtol=1e-9)
    np.testing.assert_array_equal(engine.covariance[15:], 0.0)  # 15 states: no scale factors
    np.testing.assert_array_equal(engine.covariance[:, 15:], 0.0)


# ---- between houses


@pytest.mark.parametrize(("grade", "seed"), [("automotive", 5), ("tactical", 3)])
def test_false_positions_of_streets_without_velocities_lose_no_filter(grade, seed):
    """Soft departures were stops, and the filter was reset to multipath: 82 and 5.1 m off, sd of 80 m and 14 m."""
    made = insnav.simulate("city", imu=grade, gps="urban", seed=seed)
    run = insnav.load(made.imu.data, without_velocities(made.gps.data)).navigate().found.run
    track, true = run.smoothed.solution, made.reference.data
    lla = np.array([np.interp(track.time, true.time, each) for each in true.lla.T]).T
    off, sd = ned_offset(track.lla, lla), track.sd[:, :3]
    assert np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))) < 2.5
    assert np.mean(np.abs(off) < 3.0 * sd) > 0.97
    assert np.sqrt(np.mean(sd[:, :2] ** 2)) < 3.0
    assert RESET not in {event.code for event in run.events}
