"""A window that starts from the smoothed drive knows how late the fixes are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.attitude import dcm_from_quat
from insnav.earth import ned_offset
from insnav.errors.outage.free_inertial import smoothed_start
from insnav.filter.navigator import Navigator
from insnav.filter.receiver import DELAY_SD
from tests.filter import drives


def test_the_state_of_a_smoothed_start_predicts_fixes_that_are_late():
    late, rng = 0.3, np.random.default_rng(4)
    imu = drives.noisy_imu(drives.perfect_imu(laps=2), drives.MODEL, rng)
    exact = drives.perfect_gps(laps=2)
    fixes = drives.noisy_gps(replace(exact, time=exact.time + late), rng)
    begin = drives.begin(drives.MODEL, rng, laps=2)
    rows = range(20, 120, 7)
    navigator = Navigator(drives.ready(imu, fixes, begin, delay_sd=DELAY_SD), marks=rows)
    navigator.feed(imu)
    run = navigator.finish()
    for row in rows:
        state = smoothed_start(navigator.kept[row], run, run.gps_delay)
        assert state is not None
        antenna = dcm_from_quat(state.x[6:]) @ drives.LEVER_B - state.further[0] * state.x[3:6]
        missed = ned_offset(state.x[:3], exact.lla[row]) + antenna
        assert np.linalg.norm(missed[:2]) < 0.6
