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


def test_an_error_as_large_as_the_note_says_is_said():
    drive = insnav.simulate("aircraft_pattern", imu="industrial", gps="dgps", seed=14)
    imu, gps = drive.imu.data, drive.gps.data
    imu, gps = imu.rows(imu.time < 400.0), gps.rows(gps.time < 400.0)
    right = insnav.load(imu, gps, lever_arm=(0.0, 0.0, 0.0)).navigate()
    (note,) = [note for note in right.notes if note.startswith("errors of the lever arm given")]
    assert not [text for text in right.page().warnings if "the antenna seems" in text]
    sizes = [float(value) for value in note.split()[-5].split(",")]
    wrong = insnav.load(imu, gps, lever_arm=(sizes[0], 0.0, 0.0)).navigate()
    assert [text for text in wrong.page().warnings if "the antenna seems" in text]
