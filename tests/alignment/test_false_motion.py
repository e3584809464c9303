"""Receivers parked between houses: what moves the fixes is not what moves the vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.alignment.align import without_false_motion
from insnav.alignment.static import departure
from insnav.earth import lla_offset, ned_offset
from insnav.simulate import corrupt_gps, gps_from_truth
from insnav.strapdown import intervals
from tests.alignment.test_alignment import CAR, RECEIVER, log, started
from tests.filter.drives import without_velocities

REST = 150.0  # [s]


@pytest.fixture(scope="module")
def parked():
    """Samples, fixes without velocities, and the truth of a drive that begins with a rest."""
    record = log(started(rest=REST), CAR, 4)
    truth = record.truth
    gps = corrupt_gps(
        gps_from_truth(truth, truth.start + np.arange(0.5, truth.duration - 1.0), np.zeros(3)), RECEIVER, (4, 2)
    )
    return record.imu, without_velocities(gps), truth


def wandering(gps, truth, far: float):
    """Twice in the rest fixes are off, for 15 and for 10 s."""
    since, lla = gps.time - truth.start, gps.lla.copy()
    for begin, end, way in ((20.0, 35.0, [far, -far, 0.0]), (80.0, 90.0, [-far, 0.0, 0.0])):
        rows = (since > begin) & (since < end)
        lla[rows] = lla_offset(lla[rows], np.array(way))
    return replace(gps, lla=lla)


def error_of_heading(ready, truth) -> tuple[float, float]:
    found = ready.alignment
    off = found.rph[2] - truth.evaluate(np.array([found.time])).rph[0, 2]
    return float((off + np.pi) % (2.0 * np.pi) - np.pi), float(found.sd[2])


def test_a_rest_goes_on_while_only_fixes_move(parked):
    imu, gps, truth = parked
    ready = insnav.load(imu, wandering(gps, truth, 30.0)).until("align").ready
    assert ready.alignment.static[1] - truth.start > REST - 3.0
    plain = insnav.load(imu, gps).until("align").ready
    assert ready.alignment.static == pytest.approx(plain.alignment.static, abs=2.0)
    off, sd = error_of_heading(ready, truth)
    assert abs(off) < 3.0 * sd < 0.5


def test_a_vehicle_that_is_elsewhere_has_moved_whatever_its_samples_say(parked):
    imu, gps, truth = parked
    parts, rest = intervals(imu), (truth.start, truth.start + 19.0)
    some = wandering(gps, truth, 30.0)
    kept = without_false_motion(parts, some, rest)
    inside = some.time < truth.start + REST - 3.0
    assert np.ptp(kept.lla[inside], axis=0).max() == 0.0
    later = some.time > truth.start + REST + 3.0
    np.testing.assert_array_equal(kept.lla[later], some.lla[later])
    assert np.linalg.norm(ned_offset(kept.lla[:1], gps.lla[:1])) < 6.0
    spike = some.lla.copy()
    spike[100] = lla_offset(spike[100], np.array([150.0, 0.0, 0.0]))
    assert np.ptp(without_false_motion(parts, replace(some, lla=spike), rest).lla[inside], axis=0).max() == 0.0
    drifting = replace(gps, lla=lla_offset(gps.lla, np.outer(gps.time - truth.start, [0.3, 0.0, 0.0])))
    assert without_false_motion(parts, drifting, rest) is drifting
    far = wandering(gps, truth, 300.0)
    assert without_false_motion(parts, far, rest) is far
    assert without_false_motion(parts, some, None) is some


def test_a_departure_is_where_the_vehicle_departs(parked):
    imu, _, truth = parked
    for known in (5.0, 60.0, 140.0):
        at = departure(intervals(imu), (truth.start, truth.start + known)) - truth.start
        assert REST - 1.0 < at < REST + 2.0


def test_soft_departures_and_steps_of_a_second_are_told_apart(parked):
    imu, _, truth = parked
    pushed, knocked = imu.accel.copy(), imu.accel.copy()
    since = imu.time - truth.start
    step = float(np.median(np.diff(imu.time)))  # samples are increments
    pushed[(since > 100.0)] += [0.03 * step, 0.0, 0.0]  # seen by an IMU of this grade, by fixes much later
    knocked[(since > 100.0) & (since < 101.0)] += [0.4 * step, 0.0, 0.0]
    rest = (truth.start, truth.start + 30.0)
    assert departure(intervals(replace(imu, accel=pushed)), rest) - truth.start == pytest.approx(100.0, abs=1.0)
    assert departure(intervals(replace(imu, accel=knocked)), rest) - truth.start > REST - 1.0
