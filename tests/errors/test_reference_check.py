"""A reference that is wrong is named, its wrong parts left out; a good one is left as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.errors.metrics import on_clock, position_errors
from insnav.errors.reference_check import check_reference
from insnav.types import GpsData, Trajectory
from insnav.units import DEG
from tests.errors.test_reference_offset import driven, moved

SIZE = 0.5  # of the errors of the solution [m]
HERE = np.zeros(3)


@pytest.fixture(scope="module")
def pair() -> tuple[Trajectory, Trajectory]:
    track, truth = driven(3, SIZE)
    sd = np.tile([SIZE] * 3 + [0.05] * 3 + [0.2 * DEG] * 3, (len(track.time), 1))
    return replace(track, sd=sd), truth


def yawed(track: Trajectory, angle: float) -> Trajectory:
    return replace(track, rph=track.rph + np.array([0.0, 0.0, angle * DEG]))


def test_a_good_reference_is_left_as_it_is(pair: tuple[Trajectory, Trajectory]):
    for seed in range(5):
        track, truth = driven(seed, SIZE)
        assert check_reference(truth, replace(track, sd=pair[0].sd), None, HERE) == (truth, [])


@pytest.mark.parametrize("late", [-5.0, -0.5, 0.2, 1.0, 18.0])
def test_its_clock_is_found_and_not_moved(pair: tuple[Trajectory, Trajectory], late: float):
    track, truth = pair
    found, (event,) = check_reference(replace(truth, time=truth.time + late), track, None, HERE)
    np.testing.assert_array_equal(found.time, truth.time + late)  # a system under test does not mend its judge
    assert event.value == pytest.approx(late, abs=0.06)
    assert f"{'ahead of' if late > 0 else 'behind'} the solution" in event.action


def test_what_the_drive_itself_shows_is_not_put_on_the_reference(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    early = replace(truth, time=truth.time - 0.5)
    for delay in (0.48, 0.33):  # fixes without sigmas tell it to a third
        (event,) = check_reference(early, track, None, HERE, {"s": delay})[1]
        assert "has the time of the samples, 0.49 s behind that of fixes" in event.action
    for delay in (-0.48, 0.1):
        assert "the clock of the reference" in check_reference(early, track, None, HERE, {"s": delay})[1][0].action
    assert check_reference(early, track, None, HERE, {"s": np.nan})[1] == []


def test_errors_on_another_clock_are_those_of_a_reference_that_was_right(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    right, late = (position_errors(track, replace(truth, time=truth.time + by)) for by in (0.0, 2.0))
    found = on_clock(late, track, 2.0)
    same = right.rows(np.isin(right.time, found.time - 2.0))
    np.testing.assert_array_equal(same.time, found.time - 2.0)
    np.testing.assert_allclose(found.position, same.position, atol=0.02)


def test_another_point_of_the_vehicle_is_no_clock(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    found, (event,) = check_reference(moved(truth, np.array([3.0, 0.0, 0.0])), track, None, HERE)
    assert "another point of the vehicle" in event.action
    np.testing.assert_array_equal(found.time, truth.time)


def test_a_solution_that_drifted_without_fixes_blames_neither_clock_nor_heights(pair: tuple[Trajectory, Trajectory]):
    """25 fixes, then minutes of inertial navigation: the clock of a right reference was said to be 150.9 s off."""
    track, truth = pair
    age = np.maximum(track.time - track.time[0] - 25.0, 0.0)[:, None]
    drift = age**2 * np.array([0.0, 0.0, 0.002]) + np.minimum(age, 10.0) * track.v_n * 0.1
    sd = track.sd + np.pad(np.abs(drift), ((0, 0), (0, 6)))
    drifted = replace(track, lla=lla_offset(track.lla, drift), sd=sd)
    assert np.mean(drift[:, 2]) > 10.0
    assert check_reference(truth, drifted, None, HERE)[1] == []
    unsaid = replace(drifted, sd=None)  # it is what is stated that tells
    blamed = " ".join(each.action for each in check_reference(truth, unsaid, None, HERE)[1])
    assert "the clock of the reference" in blamed
    assert "heights differ" in blamed


@pytest.mark.parametrize("wrong", [-4.0, 73.0, 180.0])
def test_headings_of_other_axes_are_not_used(pair: tuple[Trajectory, Trajectory], wrong: float):
    track, truth = pair
    found, (event,) = check_reference(yawed(truth, wrong), track, None, HERE)
    assert np.cos(event.value * DEG - wrong * DEG) == pytest.approx(1.0, abs=1e-4)
    assert "course" in event.action
    assert np.isnan(found.rph[:, 2]).all()
    np.testing.assert_array_equal(found.rph[:, :2], truth.rph[:, :2])


def test_where_the_solution_is_off_the_course_the_headings_are_kept(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    turned = yawed(track, 30.0)  # as of a yawed IMU
    found, (event,) = check_reference(truth, turned, None, HERE)
    assert "does not tell" in event.action
    np.testing.assert_array_equal(found.rph, truth.rph)


def test_headings_before_the_reference_was_aligned_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    begin = np.arange(len(truth.time)) < 150
    wrong = np.where(begin, 120.0 * DEG, 0.0)[:, None] * [0.0, 0.0, 1.0]
    found, (event,) = check_reference(replace(truth, rph=truth.rph + wrong), track, None, HERE)
    assert "120 deg off in the first 75 s" in event.action
    np.testing.assert_array_equal(np.isnan(found.rph[:, 2]), begin)


def test_velocities_that_prove_nothing_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    unknown = np.full_like(truth.lla, np.nan)
    gps = GpsData(truth.time, track.lla, truth.v_n, unknown, unknown)
    for reference in (truth, replace(truth, time=truth.time + 2.0)):  # whatever its clock says
        found, events = check_reference(reference, track, gps, HERE)
        assert "those of the fixes" in events[0].action
        assert np.isnan(found.v_n).all()
    others = replace(gps, v_n=truth.v_n + np.random.default_rng(1).normal(0.0, 0.02, truth.v_n.shape))
    assert check_reference(truth, track, others, HERE)[1] == []


@pytest.mark.parametrize("lag", [-0.1, 0.13, 0.5])
def test_velocities_that_lag_are_moved(pair: tuple[Trajectory, Trajectory], lag: float):
    track, truth = pair
    old = np.column_stack([np.interp(truth.time - lag, truth.time, each) for each in truth.v_n.T])
    found, (event,) = check_reference(replace(truth, v_n=old), track, None, HERE)
    assert event.value == pytest.approx(lag, abs=0.02)
    inside = slice(20, -20)
    off = [np.abs(each[inside] - truth.v_n[inside]).max() for each in (found.v_n, old)]
    assert off[0] < 0.35 * off[1]


def test_velocities_under_wrong_names_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    found, (event,) = check_reference(replace(truth, v_n=truth.v_n[:, [1, 0, 2]]), track, None, HERE)
    assert "north and east are exchanged" in event.action
    assert np.isnan(found.v_n).all()
