"""Standard deviations where fixes before or after a lasting jump may be false."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from insnav.filter.ambiguity import Jump, resets_of, widen_by_jumps
from insnav.filter.navigate import navigate_recording
from insnav.findings import Code, Finding
from insnav.imu import load_imu
from insnav.types import Run
from tests.explain.test_faults import RECEIVER, recording

NORTH = np.array([1.0, 0.0, 0.0])


@lru_cache(maxsize=1)
def undisturbed() -> Run:
    made = recording(5)
    return navigate_recording(made.imu, made.gps, load_imu("automotive"), RECEIVER).run


def added(wider: Run) -> np.ndarray:
    """Variance of the smoothed position that is added, (n, 3)."""
    return wider.smoothed.solution.sd[:, :3] ** 2 - undisturbed().smoothed.solution.sd[:, :3] ** 2


def test_the_variance_of_a_jump_is_that_of_both_explanations():
    """A third of the record before it: the later fixes are false with that probability."""
    run = undisturbed()
    time = run.smoothed.solution.time
    at = time[0] + np.ptp(time) / 3.0
    wider = widen_by_jumps(run, (Jump(at, 30.0 * NORTH),))
    np.testing.assert_allclose(added(wider)[:, 0], np.where(time < at, 2.0 / 3.0, 1.0 / 3.0) * 900.0)
    np.testing.assert_array_equal(wider.smoothed.solution.sd[:, 1:], run.smoothed.solution.sd[:, 1:])


def test_a_jump_that_is_taken_back_leaves_the_ends_as_they_are():
    run = undisturbed()
    time = run.smoothed.solution.time
    begin, end = time[0] + 100.0, time[-1] - 100.0
    wider = widen_by_jumps(run, (Jump(begin, 30.0 * NORTH), Jump(end, -30.0 * NORTH)))
    np.testing.assert_allclose(added(wider)[:, 0], 900.0 * ((time >= begin) & (time < end)), atol=1e-9)


def test_a_reset_counts_as_a_jump_of_the_fixes_that_were_rejected():
    run = undisturbed()
    found, used = run.innovations, run.innovations.used_position.copy()
    used[240:251] = False
    reset = Finding.of(Code.FILTER_RESET, found.time[250])
    (reset,) = resets_of(replace(run, innovations=replace(found, used_position=used), events=(reset,)))
    assert reset.begin == found.time[240]
    np.testing.assert_array_equal(reset.moved, found.innovation[250, :3])
    assert resets_of(run) == ()


def test_poses_before_the_jump_have_the_sd_of_the_solution_there():
    run = undisturbed()
    solution = run.smoothed.solution
    wider = widen_by_jumps(
        replace(run, poses=solution.rows(slice(0, 50))), (Jump(float(solution.time[900]), 30.0 * NORTH),)
    )
    np.testing.assert_array_equal(wider.poses.sd, wider.smoothed.solution.sd[:50])
