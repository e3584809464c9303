"""A run whose filter was lost is said to be so, first of all warnings, and ends with exit code 1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.findings import Code, Finding, untyped_event
from insnav.report.run.warnings import failure
from tests.faults.conftest import healthy


def reset(time: float) -> Finding:
    return untyped_event(time, Code.RESET, 100.0, 10.0, "m", "reset")


@pytest.mark.parametrize(
    ("rejected", "resets", "lost"), [(0.0, 0, False), (0.15, 5, False), (0.3, 2, False), (0.3, 3, True), (0.6, 0, True)]
)
def test_a_lost_filter_is_a_failure(rejected, resets, lost):
    run = healthy(0).run
    used = np.arange(run.innovations.time.shape[0]) >= rejected * run.innovations.time.shape[0]
    run = replace(
        run,
        innovations=replace(run.innovations, used_position=used),
        events=tuple(reset(10.0 * number) for number in range(resets)),
    )
    assert bool(failure(run)) == lost


def test_positions_that_all_others_contradict_are_a_failure_if_they_are_the_most():
    """A run that used no fix for seven of its eight minutes had no warning and rc 0."""
    run = healthy(0).run
    used = np.arange(len(run.innovations.time)) >= 0.6 * len(run.innovations.time)
    event = untyped_event(10.0, Code.GATE_RECORD_POSITION, 1e6, np.nan, "m", "not used")
    run = replace(run, innovations=replace(run.innovations, used_position=used), events=(event,))
    assert failure(run) == "the IMU and the others contradict 60 % of the positions"


def test_a_solution_that_is_known_to_kilometres_beside_its_fixes_is_a_failure():
    run = healthy(0).run
    solution = run.solution
    assert solution.sd is not None
    lost = replace(run, solution=replace(solution, sd=solution.sd + np.r_[2000.0, 1500.0, np.zeros(7)]))
    assert failure(lost) == "beside the fixes that were used it is known to 2.5e+03 m (1 sd) only"
