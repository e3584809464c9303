"""Windows of the short form over a drive: the terms left out explain the difference."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.errors.evaluated_run import short_windows, size_at
from insnav.exceptions import InputError
from insnav.simulate import imu_from_truth, reference
from insnav.types import ImuData, SensorErrors
from tests.simulate.motions import town


@pytest.fixture(scope="module")
def drive():
    truth = town()
    time = np.arange(12001) / 100.0
    return imu_from_truth(truth, time), reference(truth, np.arange(1201) / 10.0)


def test_the_dropped_terms_and_eulers_rule_explain_the_difference(drive):
    """What the terms left out do not explain is of first order in the sampling interval."""
    windows = short_windows(*drive)
    assert [w.start for w in windows] == pytest.approx([0.0, 60.0], abs=1e-6)
    window = windows[0]
    assert window.elapsed[-1] == pytest.approx(60.0)
    assert 0.3 < size_at(windows, "dropped", 60.0)[0] < 3.0
    assert size_at(windows, "untilted", 60.0)[0] > 10.0
    truth, quicker = town(), np.arange(48001) / 400.0
    fast = short_windows(imu_from_truth(truth, quicker), reference(truth, np.arange(1201) / 10.0))[0]
    assert np.hypot(*window.rest[-1, :2]) / np.hypot(*fast.rest[-1, :2]) == pytest.approx(4.0, rel=0.02)
    np.testing.assert_allclose(fast.dropped[-1], window.dropped[-1], atol=0.01)


def test_known_sensor_errors_are_taken_off(drive):
    imu, solution = drive
    wrong = np.array([2e-3, -1e-3, 1e-3, 0.05, -0.03, 0.02, 1e-3, -1e-3, 5e-4, 1e-3, 2e-3, -1e-3])
    bad = ImuData(
        imu.time,
        imu.gyro * (1 + wrong[6:9]) + 0.01 * wrong[:3],
        imu.accel * (1 + wrong[9:]) + 0.01 * wrong[3:6],
        "increment",
    )
    known = SensorErrors(np.zeros(1), wrong[None], np.zeros((1, 12)))
    ideal, mended = short_windows(*drive)[0], short_windows(bad, solution, known)[0]
    np.testing.assert_allclose(mended.position, ideal.position, atol=1e-3)
    assert np.abs(short_windows(bad, solution)[0].position - ideal.position).max() > 0.01


def test_windows_with_holes_do_not_count(drive):
    imu, solution = drive
    keep = (imu.time < 30.0) | (imu.time > 32.0)
    holed = ImuData(imu.time[keep], imu.gyro[keep], imu.accel[keep], "increment")
    (window,) = short_windows(holed, solution)
    assert window.start == pytest.approx(60.0, abs=1e-6)
    with pytest.raises(InputError, match=r"diagnosis.no_short_window"):
        short_windows(holed, reference(town(), np.arange(901) / 10.0))
