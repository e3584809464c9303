"""Runs shared by the tests of reports."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.errors.metrics import position_errors
from insnav.report.run.quantities import run_facts
from insnav.types import Innovations, Run, SensorErrors, Trajectory
from tests.report.synthetic import drive

READING = {
    "imu": {
        "path": "drive.csv",
        "sha256": "ab" * 32,
        "n_rows": 36001,
        "n_used": 36000,
        "start_s": 0.0,
        "end_s": 600.0,
        "rate_hz": 100.0,
        "n_gaps": 2,
        "longest_gap_s": 0.31,
        "evidence": ["gravity is 9.81 at rest"],
        "axes": "FRD",
    },
    "gps": {"path": "gps.csv", "n_rows": 571, "start_s": 0.0, "end_s": 600.0, "rate_hz": 1.0, "n_gaps": 0},
}


@pytest.fixture(scope="session")
def driven():
    """Run, fixes and truth of ten minutes with an outage of half a minute and three rejected fixes."""
    return drive(600.0, rate=5.0, outage=(400.0, 430.0))


@pytest.fixture(scope="session")
def facts(driven):
    run, _, true = driven
    return run_facts(
        run,
        reading=READING,
        configuration={"states": 21, "lever_arm_m": [0.1, -0.3, -0.2]},
        imu_model={"name": "consumer", "chosen": "nearest to the noise at rest"},
        errors=position_errors(run.solution, true),
        reference_name="ref.csv",
        warnings=["heading is not observable before 300 s"],
    )


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
