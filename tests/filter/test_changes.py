"""Biases that step, an IMU that is turned, fixes that jump or are dragged: modelled, or left open by the variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset, ned_offset
from insnav.errors.metrics import position_errors
from insnav.filter.changes import (
    AMBIGUOUS,
    FASTEST,
    IMU_CHANGED,
    VELOCITY,
    at_an_end,
    beyond,
    false_between,
    mixed,
    of_the_imu,
    offset,
    report_changes,
    resets_of,
)
from insnav.filter.gates import Trust
from insnav.filter.navigate import Navigated, navigate_recording
from insnav.filter.shocks import shocks
from insnav.filter.whole_record import false_at_an_end
from insnav.findings import CONTRADICTIONS, Code, Finding, Severity, of_code
from insnav.imu import load_imu
from insnav.kernels.dynamics import NAV
from insnav.simulate.faults import gps_drag, gps_jump
from insnav.simulate.gps_file import load_gps
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM, simulate_recording
from insnav.types import FloatArray, GpsData, ImuData, StateChange, Trajectory
from tests.filter.test_shocks import AT as SHOCK
from tests.filter.test_shocks import drives, shown
from tests.filter.test_shocks import navigated as smoothed
from tests.filter.test_whole_record import AT, SETTINGS, false, navigated, recording, span, told, undisturbed

UNDECIDED = (  # standard deviations cover two explanations
    Code.CHANGE_TURNED_AMBIGUOUS,
    Code.CHANGE_ATTITUDE_LOST_AMBIGUOUS,
    Code.CHANGE_GYRO_BIAS_AMBIGUOUS,
    Code.CHANGE_ACCEL_BIAS_AMBIGUOUS,
    Code.RECORD_VELOCITY_MISSED_AMBIGUOUS,
    Code.RECORD_JUMP,
    Code.RECORD_DRIFT,
    Code.RECORD_VELOCITY_STEP,
    Code.CHANGE_DELAY,
    Code.RECORD_AMBIGUOUS_BEGIN,
    Code.RECORD_AMBIGUOUS_END,
)


def ratios(done: Navigated, truth) -> FloatArray:
    """Error by standard deviation of the smoothed position, (n, 3)."""
    solution = done.run.smoothed.solution
    lla = np.column_stack([np.interp(solution.time, truth.time, column) for column in truth.lla.T])
    return np.abs(ned_offset(solution.lla, lla)) / solution.sd[:, :3]


def with_imu(seed: int, imu: ImuData) -> Navigated:
    return navigate_recording(imu, recording(seed).gps, load_imu("automotive"), SETTINGS)


@pytest.mark.parametrize(("seed", "axis"), [(5, 2), (8, 0)])
def test_a_gyro_bias_that_steps_is_found_and_taken_into_account(seed, axis):
    imu = recording(seed).imu
    step = np.deg2rad(0.5) * (imu.time > imu.time[0] + AT)
    scale = np.median(np.diff(imu.time)) if imu.sampling == "increment" else 1.0
    done = with_imu(seed, replace(imu, gyro=imu.gyro + scale * step[:, None] * np.eye(3)[axis]))
    assert np.mean(ratios(done, recording(seed).reference) < 3.0) > 0.99
    assert not any(of_code(done.run.events, Code.FILTER_RESET))
    (step,) = of_code(done.run.events, *CONTRADICTIONS)
    assert step.code is Code.CHANGE_GYRO_BIAS
    assert step.severity is Severity.WARNING
    assert step.subject == f"gyro {'xyz'[axis]}"
    assert step.begin == pytest.approx(imu.time[0] + AT, abs=2.0)
    assert step["rate_rad_s"] == pytest.approx(np.deg2rad(0.5), rel=0.1)


def test_an_imu_that_is_turned_in_its_place_is_found():
    imu = recording(5).imu
    turn, after = dcm_from_rph(np.deg2rad([0.0, 0.0, 90.0])), (imu.time > imu.time[0] + AT)[:, None]
    gyro, accel = (np.where(after, each @ turn, each) for each in (imu.gyro, imu.accel))
    done = with_imu(5, replace(imu, gyro=gyro, accel=accel))
    assert np.mean(ratios(done, recording(5).reference) < 3.0) > 0.99
    assert any(of_code(told(done), Code.CHANGE_TURNED, Code.CHANGE_TURNED_AMBIGUOUS))


def test_dragged_fixes_leave_open_which_are_true():
    gps = recording(5).gps
    done = navigated(5, gps_drag(gps, 2.0, span(gps, 60.0)))
    assert any(of_code(told(done), *UNDECIDED))
    assert np.mean(ratios(done, recording(5).reference) < 3.0) > 0.99
    assert done.run.smoothed.solution.sd[:, :2].max() < 120.0


@pytest.mark.parametrize("after", [25.0, 45.0])
def test_a_jump_for_good_soon_after_the_begin_leaves_open_which_are_true(after):
    """Of fixes that are few at the begin those after may be false: nothing was inside, by 40 standard deviations."""
    gps = recording(5).gps
    done = navigated(5, gps_jump(gps, 60.0, (gps.time[0] + after, gps.time[-1] + 1.0)))
    assert any(of_code(told(done), Code.RECORD_AMBIGUOUS_BEGIN))
    assert np.mean(ratios(done, recording(5).reference) < 3.0) > 0.99
    assert done.run.smoothed.solution.sd[:, :2].max() < 60.0


def test_what_changes_faster_than_a_drag_was_missed_by_the_imu():
    """As in a flight without GPS velocities, whose start of 9 m/s made standard deviations of kilometres."""
    for speed, imu in ((0.9 * FASTEST, False), (1.1 * FASTEST, True)):
        assert of_the_imu(StateChange(10.0, VELOCITY, np.array([speed, 0.0, 0.0]), 50.0)) is imu


def test_a_jump_that_is_barely_seen_is_in_the_standard_deviations():
    """Said to contradict, and not likelier than none: 55 % were inside three standard deviations."""
    gps = recording(5).gps
    done = navigated(5, gps_jump(gps, 7.0, (gps.time[0] + AT, np.inf)))
    assert any(of_code(told(done), *UNDECIDED))
    assert np.mean(ratios(done, recording(5).reference) < 3.0) > 0.99
    assert done.run.smoothed.solution.sd[:, :2].max() < 10.0


def rtk() -> tuple[ImuData, GpsData, Trajectory]:
    """Five minutes of a motorway by RTK."""
    truth = load_profile("motorway").truth((17, MOTION_STREAM))
    made = simulate_recording(truth, load_imu("tactical"), load_gps("rtk"), 17)
    imu, fixes = (each.rows(each.time < each.time[0] + 300.0) for each in (made.imu, made.gps))
    return imu, fixes, made.reference


def test_a_minute_of_drift_by_centimetres_is_in_the_standard_deviations_and_causes_no_reset():
    imu, fixes, truth = rtk()
    begin, end = span(fixes, 60.0)
    off = 0.02 * (fixes.time - begin) * ((fixes.time >= begin) & (fixes.time < end))
    dragged = replace(fixes, lla=lla_offset(fixes.lla, np.outer(off, [1.0, 0.0, 0.0])))
    done = navigate_recording(imu, dragged, load_imu("tactical"), SETTINGS)
    assert not any(of_code(done.run.events, Code.FILTER_RESET))
    assert np.mean(ratios(done, truth) < 3.0) > 0.99


def test_several_turns_are_gyros_that_lose_the_attitude():
    turns = tuple(StateChange(time, 6, np.array([0.0, 0.0, 0.1]), 100.0) for time in (50.0, 60.0, 120.0))
    (one,) = report_changes(turns[:2], IMU_CHANGED)
    assert one.code is Code.CHANGE_TURNED
    assert one["angle_rad"] == pytest.approx(0.2)
    (several,) = report_changes(turns, IMU_CHANGED)
    assert several.code is Code.CHANGE_ATTITUDE_LOST
    assert several["count"] == 3
    assert several["angle_rad"] == pytest.approx(0.1)
    assert (several.begin, several.end) == (50.0, 120.0)
    assert [each.code for each in report_changes(turns, AMBIGUOUS)] == [Code.CHANGE_ATTITUDE_LOST_AMBIGUOUS]


def test_a_jump_of_metres_by_a_receiver_good_to_centimetres_is_left_out():
    imu, fixes, truth = rtk()
    done = navigate_recording(imu, gps_jump(fixes, 3.0, span(fixes, 30.0)), load_imu("tactical"), SETTINGS)
    assert len(false(done)) == 150
    assert np.hypot(*position_errors(done.run.smoothed.solution, truth).position[:, :2].T).max() < 0.3


def test_the_clearest_changes_are_vectors():
    found = shown(0, "step", 0.05)
    change = found.likely[0]
    assert change.first == 9
    assert change.time == pytest.approx(drives.truth().start + SHOCK, abs=5.0)
    np.testing.assert_allclose(np.rad2deg(change.change), [0.0, 0.0, -0.05], atol=0.01)
    assert change.gain >= found.likely[-1].gain
    assert shown(0).likely == ()
    assert np.isfinite(shown(0, "minute", 0.5).likely[0].since)
    found, innovations = smoothed(0, "minute", 0.5)
    alone = replace(innovations, nis_velocity=np.full_like(innovations.nis_velocity, np.nan))
    assert not any(np.isfinite(each.since) for each in shocks(found, alone).likely)


def jump(time: float, metres: float) -> StateChange:
    return StateChange(time, 0, np.array([-metres, 0.0, 0.0]), 100.0)


def test_fixes_that_come_back_were_false_and_others_leave_it_open():
    gps = recording(5).gps
    begin = gps.time[0]
    there_and_back = jump(begin + 50.0, 5.0), jump(begin + 70.0, -4.9)
    trust = false_between(there_and_back, gps, 0.0)
    assert trust is not None
    np.testing.assert_array_equal(trust.false[0], (gps.time >= begin + 50.0) & (gps.time < begin + 70.0))
    assert not trust.false[1].any()
    assert false_between(there_and_back[:1], gps, 0.0) is None
    faster = StateChange(10.0, 3, np.array([0.0, -2.0, 0.0]), 100.0)
    np.testing.assert_allclose(offset((faster,), np.array([5.0, 10.0, 14.0]))[:, 1], [0.0, 0.0, 8.0])
    over = faster, StateChange(20.0, 3, np.array([0.0, 1.9, 0.0]), 100.0)
    np.testing.assert_allclose(offset(over, np.array([30.0, 99.0]))[:, 1], 20.0)


def test_the_variance_of_a_jump_is_that_of_both_explanations():
    """A third of the record before it: the later fixes are false with that probability."""
    run = undisturbed(5).run
    time = run.smoothed.solution.time
    at = time[0] + np.ptp(time) / 3.0
    wider = mixed(run, (jump(at, 30.0),))
    added = wider.smoothed.solution.sd[:, 0] ** 2 - run.smoothed.solution.sd[:, 0] ** 2
    np.testing.assert_allclose(added, np.where(time < at, 2.0 / 3.0, 1.0 / 3.0) * 900.0)
    np.testing.assert_array_equal(wider.smoothed.solution.sd[:, 1:], run.smoothed.solution.sd[:, 1:])


def test_a_reset_counts_as_a_jump_of_the_fixes_that_were_rejected():
    run = undisturbed(5).run
    found, used = run.innovations, run.innovations.used_position.copy()
    used[240:251] = False
    reset = Finding.of(Code.FILTER_RESET, found.time[250])
    (change,) = resets_of(replace(run, innovations=replace(found, used_position=used), events=(reset,)))
    assert change.time == found.time[240]
    np.testing.assert_allclose(offset((change,), found.time[[239, 240]])[1], found.innovation[250, :3])
    assert resets_of(run) == ()


@pytest.mark.parametrize(
    ("part", "codes"),
    [
        (slice(20), [Code.RECORD_AMBIGUOUS_BEGIN]),
        (slice(-20, None), [Code.RECORD_AMBIGUOUS_END]),
        (slice(100, 120), []),
    ],
)
def test_fixes_left_out_at_an_end_of_the_record_may_be_the_true_ones(part, codes):
    gps, run = recording(5).gps, undisturbed(5).run
    wrong = np.zeros((2, gps.time.size), dtype=np.bool_)
    wrong[0, part] = True
    far = replace(gps, lla=lla_offset(gps.lla, np.outer(wrong[0], [0.0, 30.0, 0.0])))
    wider, events = false_at_an_end(run, far, SETTINGS, Trust(wrong, np.zeros(wrong.shape)))
    assert [event.code for event in events] == codes
    assert [event["count"] for event in events] == [20] * len(codes)
    sd, before = (each.smoothed.solution.sd[:, 1] for each in (wider, run))
    assert (3.0 * sd > 30.0).all() if codes else (sd == before).all()


def test_where_a_gyro_fault_ends_no_bias_steps_beside_it():
    known = (StateChange(100.0, NAV, np.array([0.05, 0.0, 0.0]), 900.0, -np.inf),)
    step = StateChange(101.2, NAV, np.array([0.07, 0.01, 0.0]), 300.0)
    assert at_an_end(step, known)
    assert not at_an_end(step, ())
    assert not at_an_end(replace(step, time=120.0), known)
    assert not at_an_end(replace(step, change=np.array([0.01, 0.07, 0.0])), known)  # another gyro
    assert not at_an_end(replace(step, first=NAV + 3), known)  # no gyro at all


def test_what_standard_deviations_hold_is_no_contradiction():
    run = undisturbed(5).run
    solution = run.smoothed.solution
    at, sd = float(solution.time[2000]), solution.sd[2000, 0]
    small, large, drag = jump(at, 2.9 * sd), jump(at, 3.1 * sd), replace(jump(at, 0.1), first=VELOCITY)
    assert beyond(run, (small, large, replace(large, change=np.zeros(3)), drag)) == (large, drag)
    assert beyond(run, ()) == ()
