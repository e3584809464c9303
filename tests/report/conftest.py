"""Runs shared by the tests of reports."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun, judged
from insnav.errors.metrics import position_errors
from insnav.findings import Code, Finding, Severity
from insnav.imu import load_imu
from insnav.input.readers.reading import ReadingFacts
from insnav.report.save import page_facts
from insnav.result import Result
from insnav.types import Innovations, Run, SensorErrors, Trajectory
from tests.report.synthetic import drive


def stored(text: str, severity: Severity = Severity.NOTE, time: float = np.nan) -> Finding:
    """A finding whose words are given."""
    return Finding.of(Code.STORED_TEXT, time, severity=severity, text=text)


READING = {
    "imu": ReadingFacts(
        kind="IMU",
        path="drive.csv",
        sha256="ab" * 32,
        n_rows=36001,
        n_used=36000,
        start_s=0.0,
        end_s=600.0,
        rate_hz=100.0,
        n_gaps=2,
        longest_gap_s=0.31,
        columns={"time_s": "t [s]"},
        evidence=(stored("gravity is 9.81 at rest"),),
        axes="FRD",
    ),
    "gps": ReadingFacts("GPS", "gps.csv", "cd" * 32, 571, 571, 0.0, 600.0, 1.0, 0, 0.0, {}),
    "reference": ReadingFacts("reference", "ref.csv", "ef" * 32, 3001, 3001, 0.0, 600.0, 5.0, 0, 0.0, {}),
}


def result_of(run, errors=None, **more):
    """Judged result of a run, with nothing else known unless given."""
    found = EvaluatedRun(run, errors=errors)
    return judged(Result("run", found, **more), found)


def facts_of(run, errors=None, **more):
    """Content of its run.json."""
    return page_facts(result_of(run, errors, **more).page())


@pytest.fixture(scope="session")
def driven():
    """Run, fixes and truth of ten minutes with an outage of half a minute and three rejected fixes."""
    return drive(600.0, rate=5.0, outage=(400.0, 430.0))


@pytest.fixture(scope="session")
def navigated(driven):
    run, gps, true = driven
    found = EvaluatedRun(run, gps, position_errors(run.solution, true))
    result = Result(
        "run",
        found,
        READING,
        {"states": 21, "lever_arm_m": [0.1, -0.3, -0.2]},
        (load_imu("consumer"), stored("nearest to the noise at rest")),
        (stored("heading is not observable before 300 s"),),
    )
    return judged(result, found)


@pytest.fixture(scope="session")
def facts(navigated):
    return page_facts(navigated.page())


@pytest.fixture(scope="session")
def bare(driven):
    """The shortest run there can be: three rows, no fix, no sd, nothing estimated."""
    run, _, _ = driven
    solution = run.solution
    none = np.empty(0)
    return Run(
        Trajectory(solution.time[:3], solution.lla[:3], solution.v_n[:3], solution.rph[:3]),
        Innovations(none, np.empty((0, 6)), np.empty((0, 6)), none, none, none.astype(bool), none.astype(bool)),
        SensorErrors(none, np.empty((0, 12)), np.empty((0, 12))),
        (),
        run.alignment,
        run.epochs,
    )
