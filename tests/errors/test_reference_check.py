"""A reference that is wrong is named, its wrong parts left out; a good one is left as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.errors.metrics import on_clock, position_errors
from insnav.errors.reference_check import check_reference
from insnav.exceptions import InputError
from insnav.findings import Code, Severity
from insnav.types import FloatArray, GpsData, Trajectory
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
    assert (event.code, event.severity, event.subject) == (Code.REF_CLOCK, Severity.WARNING, "ref")
    assert event["late_s"] == pytest.approx(late, abs=0.06)
    assert event["corrected_m"] < event["rms_m"]


def test_what_the_drive_itself_shows_is_not_put_on_the_reference(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    early = replace(truth, time=truth.time - 0.5)
    for delay in (0.48, 0.33):  # fixes without sigmas tell it to a third
        (event,) = check_reference(early, track, None, HERE, delay)[1]
        assert event.code is Code.REF_CLOCK_OF_IMU
        assert event["late_s"] == pytest.approx(-0.49, abs=0.005)
    for delay in (-0.48, 0.1):
        assert check_reference(early, track, None, HERE, delay)[1][0].code is Code.REF_CLOCK
    assert check_reference(early, track, None, HERE, np.nan)[1] == []


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
    assert event.code is Code.REF_POINT
    assert event["forward_m"] == pytest.approx(3.0, abs=0.3)
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
    blamed = {each.code for each in check_reference(truth, unsaid, None, HERE)[1]}
    assert {Code.REF_CLOCK, Code.REF_GEOID} <= blamed


@pytest.mark.parametrize("wrong", [-4.0, 73.0, 180.0])
def test_headings_of_other_axes_are_not_used(pair: tuple[Trajectory, Trajectory], wrong: float):
    track, truth = pair
    found, (event,) = check_reference(yawed(truth, wrong), track, None, HERE)
    assert event.code is Code.REF_HEADING_AXES
    assert np.cos(event["angle_rad"] - wrong * DEG) == pytest.approx(1.0, abs=1e-4)
    assert np.isnan(found.rph[:, 2]).all()
    np.testing.assert_array_equal(found.rph[:, :2], truth.rph[:, :2])


def test_where_the_solution_is_off_the_course_the_headings_are_kept(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    turned = yawed(track, 30.0)  # as of a yawed IMU
    found, (event,) = check_reference(truth, turned, None, HERE)
    assert event.code is Code.REF_HEADING_OFFSET
    assert event["angle_rad"] == pytest.approx(-30.0 * DEG, abs=0.5 * DEG)
    np.testing.assert_array_equal(found.rph, truth.rph)


def test_headings_before_the_reference_was_aligned_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    begin = np.arange(len(truth.time)) < 150
    wrong = np.where(begin, 120.0 * DEG, 0.0)[:, None] * [0.0, 0.0, 1.0]
    found, (event,) = check_reference(replace(truth, rph=truth.rph + wrong), track, None, HERE)
    assert event.code is Code.REF_HEADING_BEGIN
    assert event["angle_rad"] == pytest.approx(120.0 * DEG, abs=0.5 * DEG)
    assert (event.begin, event.end - event.begin) == (track.time[0], pytest.approx(75.0, abs=0.5))
    np.testing.assert_array_equal(np.isnan(found.rph[:, 2]), begin)


def test_velocities_that_prove_nothing_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    unknown = np.full_like(truth.lla, np.nan)
    gps = GpsData(truth.time, track.lla, truth.v_n, unknown, unknown)
    for reference in (truth, replace(truth, time=truth.time + 2.0)):  # whatever its clock says
        found, events = check_reference(reference, track, gps, HERE)
        assert events[0].code is Code.REF_VELOCITY_OF_GPS
        assert np.isnan(found.v_n).all()
    others = replace(gps, v_n=truth.v_n + np.random.default_rng(1).normal(0.0, 0.02, truth.v_n.shape))
    assert check_reference(truth, track, others, HERE)[1] == []


@pytest.mark.parametrize("lag", [-0.1, 0.13, 0.5])
def test_velocities_that_lag_are_moved(pair: tuple[Trajectory, Trajectory], lag: float):
    track, truth = pair
    old = np.column_stack([np.interp(truth.time - lag, truth.time, each) for each in truth.v_n.T])
    found, (event,) = check_reference(replace(truth, v_n=old), track, None, HERE)
    assert event.code is Code.REF_VELOCITY_LAG
    assert event["lag_s"] == pytest.approx(lag, abs=0.02)
    inside = slice(20, -20)
    off = [np.abs(each[inside] - truth.v_n[inside]).max() for each in (found.v_n, old)]
    assert off[0] < 0.35 * off[1]


def test_velocities_under_wrong_names_are_not_used(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    wrong = {
        Code.REF_VELOCITY_NAMES: truth.v_n[:, [1, 0, 2]] * [1.0, -1.0, 1.0],
        Code.REF_VELOCITY_UNIT: truth.v_n * 3.6,
    }
    for code, v_n in wrong.items():
        found, (event,) = check_reference(replace(truth, v_n=v_n), track, None, HERE)
        assert event.code is code
        assert dict(event.values) in ({"north": "-ve", "east": "vn"}, {"unit": "km/h"})
        assert np.isnan(found.v_n).all()


def fixes_of(track: Trajectory) -> GpsData:
    one = np.ones((len(track.time), 3))
    return GpsData(track.time, track.lla, track.v_n, one, 0.1 * one)


def test_another_drive_is_named_and_nothing_else_of_it(pair: tuple[Trajectory, Trajectory]):
    """Its heights were those of a geoid, and the sigmas of the fixes optimistic."""
    track, truth = pair
    back = replace(truth, lla=truth.lla[::-1])
    moved_away = replace(truth, lla=truth.lla[::-1] + np.array([0.1, 0.0, 70.0]))
    for other in (back, moved_away):
        found, (event,) = check_reference(other, track, fixes_of(track), HERE)
        assert found is other
        assert (event.code, event.severity) == (Code.REF_OTHER_DRIVE, Severity.WARNING)
        assert event["distance_m"] > 50.0
    # a reference elsewhere that moves alike has another datum, and one that a lost solution leaves is no other drive's
    shifted = replace(truth, lla=truth.lla + np.array([0.1, 0.0, 0.0]))
    lost = replace(track, lla=track.lla[::-1])
    for reference, mine in ((shifted, track), (truth, track), (truth, lost)):
        events = check_reference(reference, mine, fixes_of(track), HERE)[1]
        assert Code.REF_OTHER_DRIVE not in [event.code for event in events]


@pytest.mark.parametrize("off", [3600.0, -86400.0, 7.0 * 86400.0 - 18.0, 5400.0 + 18.0])
def test_whole_hours_and_leap_seconds_that_mend_its_clock_are_told(pair: tuple[Trajectory, Trajectory], off: float):
    track, truth = pair
    with pytest.raises(InputError, match=r"ref.no_common_time") as caught:
        check_reference(replace(truth, time=truth.time + off), track, fixes_of(track), HERE)
    assert caught.value.values["offset_s"] == -off
    assert caught.value.values["apart_m"] < 1.0
    with pytest.raises(InputError, match=r"ref.no_common_time") as caught:
        check_reference(replace(truth, time=truth.time + off, lla=truth.lla[::-1]), track, fixes_of(track), HERE)
    assert "offset_s" not in caught.value.values


def test_a_reference_or_a_solution_without_rows_has_no_time_in_common(pair: tuple[Trajectory, Trajectory]):
    track, truth = pair
    for reference, mine in ((truth.rows(slice(0)), track), (truth, track.rows(slice(0)))):
        with pytest.raises(InputError, match=r"ref.no_common_time") as caught:
            check_reference(reference, mine, fixes_of(track), HERE)
        assert () in caught.value.values.values()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (np.diag([1.0, -1.0]), "opposite_pitch"),
        (np.diag([-1.0, 1.0]), "opposite_roll"),
        (-np.eye(2), "opposite_both"),
        (np.eye(2)[::-1], "exchanged"),
        (np.eye(2) * DEG, "as_radians"),
        (np.eye(2), ""),
    ],
)
def test_roll_and_pitch_of_other_axes_are_not_used(pair: tuple[Trajectory, Trajectory], wrong: FloatArray, said: str):
    """But for a constant difference, which a mounting makes."""
    track, truth = pair
    tilt = np.column_stack([3.0 * np.sin(0.3 * truth.time), 2.0 * np.cos(0.17 * truth.time)]) * DEG
    mine = np.column_stack([np.interp(track.time, truth.time, each) for each in tilt.T])
    track = replace(track, rph=np.column_stack([mine, track.rph[:, 2]]))
    wrongly = replace(truth, rph=np.column_stack([tilt @ wrong.T + [0.03, -0.02], truth.rph[:, 2]]))
    found, events = check_reference(wrongly, track, None, HERE)
    assert [(each.code, each["reading"]) for each in events] == [(Code.REF_TILT_MISREAD, said)] * bool(said)
    assert np.isnan(found.rph).all() == bool(said)
