"""A lever arm that is given wrong is said, with where the antenna is; one that is right is not."""

from __future__ import annotations

import numpy as np
import pytest

import insnav


@pytest.mark.parametrize(
    ("profile", "arm", "said"),
    [
        ("round_trip", (0.0, 0.0, 0.0), False),
        ("city", (0.0, 0.0, 0.0), False),
        ("city", (1.0, 0.0, 0.0), True),
        ("city", (0.0, -2.0, 0.0), True),
    ],
)
def test_a_wrong_lever_arm_is_said(profile, arm, said):
    drive = insnav.simulate(profile, imu="automotive", gps="dgps", seed=1)  # its antenna is at the IMU
    result = insnav.load(drive.imu.data, drive.gps.data, lever_arm=arm).navigate()
    found = [text for text in result.page().warnings if "the antenna seems" in text]
    assert bool(found) == said
    if found:
        estimate = np.array([float(value) for value in found[0].rpartition(" ")[2].split(",")])
        assert np.abs(estimate[:2]).max() < 0.3
