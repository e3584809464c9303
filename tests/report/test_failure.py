"""A run whose filter was lost is said to be so, first of all warnings, and ends with exit code 1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.evaluated_run import failure
from insnav.findings import Code, Finding, Severity
from tests.faults.conftest import healthy


def reset(time: float) -> Finding:
    return Finding.of(Code.FILTER_RESET, time, distance_m=100.0, limit_s=10.0)


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
    found = failure(run)
    assert (found is not None) == lost
    if found is not None:
        assert found.code is (Code.RUN_LOST if resets else Code.RUN_REJECTED)
        assert found.severity is Severity.UNUSABLE
        assert found["share"] == pytest.approx(rejected, abs=0.01)


def test_positions_that_all_others_contradict_are_a_failure_if_they_are_the_most():
    """A run that used no fix for seven of its eight minutes had no warning and rc 0."""
    run = healthy(0).run
    used = np.arange(len(run.innovations.time)) >= 0.6 * len(run.innovations.time)
    event = Finding.of(Code.GATE_RECORD_POSITION, 10.0, distance_m=1e6)
    run = replace(run, innovations=replace(run.innovations, used_position=used), events=(event,))
    found = failure(run)
    assert found is not None
    assert found.code is Code.RUN_CONTRADICTED
    assert found["share"] == pytest.approx(0.6, abs=0.01)


def test_a_solution_that_is_known_to_kilometres_beside_its_fixes_is_a_failure():
    run = healthy(0).run
    solution = run.solution
    assert solution.sd is not None
    lost = replace(run, solution=replace(solution, sd=solution.sd + np.r_[2000.0, 1500.0, np.zeros(7)]))
    found = failure(lost)
    assert found is not None
    assert found.code is Code.RUN_UNKNOWN
    assert found["sd_m"] == pytest.approx(2500.0, rel=0.01)
