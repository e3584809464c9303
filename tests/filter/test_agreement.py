"""Fixes against the smoothed track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.earth import lla_offset, ned_offset
from insnav.filter.agreement import residuals
from insnav.filter.navigate import navigate_recording
from insnav.filter.receiver import LeverArm
from insnav.imu import load_imu
from insnav.simulate import gps_from_truth
from insnav.simulate.motion import load_profile
from insnav.simulate.recording import MOTION_STREAM
from tests.explain.test_faults import RECEIVER, recording


def test_velocities_are_compared_at_the_antenna():
    """Two metres ahead of the IMU the antenna swings by a metre per second in a bend: no velocity is false there."""
    made, ahead = recording(5), np.array([2.0, 0.0, 0.0])
    truth = load_profile("city").truth((5, MOTION_STREAM))
    exact = gps_from_truth(truth, made.gps.time, ahead), gps_from_truth(truth, made.gps.time, np.zeros(3))
    moved = ned_offset(exact[0].lla, exact[1].lla)
    gps = replace(made.gps, lla=lla_offset(made.gps.lla, moved), v_n=made.gps.v_n + exact[0].v_n - exact[1].v_n)
    done = navigate_recording(made.imu, gps, load_imu("automotive"), replace(RECEIVER, lever_arm=LeverArm(ahead)))
    left = residuals(done.run, done.ready)[0][1]
    assert np.abs(left[np.isfinite(left)]).max() < 0.5
