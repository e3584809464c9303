"""A delay of the fixes that changes within a drive is found, and taken back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.earth import ned_offset
from insnav.filter.delay_step import moved, with_one_delay
from insnav.filter.navigate import navigate_prepared
from insnav.filter.prepare import prepare
from insnav.findings import CONTRADICTIONS, Code, of_code
from insnav.imu import load_imu
from insnav.input import read_gps, read_imu
from insnav.types import DelayStep
from tests.filter.test_changes import ratios
from tests.filter.test_whole_record import AT, SETTINGS, recording, told
from tests.shared import recorded


def navigated(seed, fixes):
    settings = replace(SETTINGS, delay_sd=0.05)
    made, spec = recording(seed), load_imu("automotive")

    def once(gps, clock=(0.0, 0.0)):
        time = made.imu.time
        imu = replace(made.imu, time=time + clock[0] + clock[1] * (time - time[0]))
        ready = replace(prepare(imu, gps, spec, settings), rate=clock[1])
        return ready, navigate_prepared(ready, spec)

    return with_one_delay(once(fixes), fixes, once)[1]


@pytest.mark.parametrize(("seed", "seconds"), [(5, 0.5), (8, -0.2)])
def test_fixes_that_begin_to_lag_are_moved(seed, seconds):
    gps = recording(seed).gps
    begin = recording(seed).imu.time[0] + AT
    wrong = replace(gps, time=gps.time + seconds * (gps.time > begin))
    wrong = wrong.rows(np.diff(wrong.time, prepend=-np.inf) > 0.0)
    done = navigated(seed, wrong)
    ratio = ratios(done, recording(seed).reference)
    assert np.mean(ratio < 3.0) > 0.99
    (step,) = of_code(done.run.events, *CONTRADICTIONS)
    assert step.code is Code.CHANGE_DELAY
    assert step["delay_s"] == pytest.approx(seconds, abs=0.05)
    assert step.begin == pytest.approx(begin, abs=3.0)


def test_a_drift_of_the_clock_is_none():
    gps = recording(8).gps
    drifting = replace(gps, time=gps.time + 3e-4 * (gps.time - gps.time.mean()))
    done = navigated(8, drifting)
    assert not told(done)
    assert done.run.gps_delay == pytest.approx(0.0, abs=0.02)


def test_a_small_step_is_no_drift_of_the_clock():
    """The line through a step of 0.1 s fits better than no drift: 340 ppm, delay and heading wrong without a word."""
    drive = insnav.simulate("city", imu="consumer", gps="dgps", seed=47, faults=["gps-latency:0.1s@240s"])
    run = drive.navigate().found.run
    (step,) = of_code(run.events, *CONTRADICTIONS)
    assert step["delay_s"] == pytest.approx(0.1, abs=0.03)
    smoothed, truth = run.smoothed.solution, drive.reference.data
    off = ned_offset(smoothed.lla, np.column_stack([np.interp(smoothed.time, truth.time, x) for x in truth.lla.T]))
    assert np.mean(np.abs(off) < 3.0 * smoothed.sd[:, :3]) > 0.99


def test_without_one_nothing_is_moved():
    done = navigated(5, recording(5).gps)
    assert done.run.smoothed.delay_step is None
    assert not told(done)


def test_a_departure_is_no_step():
    """Without standard deviations: "fixes from 41 s on are 0.053 s earlier", three seconds after it starts to move."""
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data.beginning(200.0), read_gps(folder / "gps.csv").data
    unknown = np.full_like(gps.lla, np.nan)
    gps = replace(gps, position_sd=unknown, velocity_sd=unknown).rows(gps.time < imu.time[-1])
    run = insnav.load(imu, gps).navigate().found.run
    assert not any(of_code(run.events, Code.CHANGE_DELAY))


@pytest.mark.parametrize(
    ("before", "after", "expected"), [(0.0, 0.5, [0.0, 0.5]), (0.1, -0.4, [0.0, -0.5]), (-0.4, 0.1, [-0.5, 0.0])]
)
def test_fixes_are_put_on_the_smaller_delay(before, after, expected):
    late = moved(DelayStep(10.0, before, after), np.array([9.0, 10.0]))
    np.testing.assert_allclose(late, expected)
