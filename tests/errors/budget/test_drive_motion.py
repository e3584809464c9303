"""The covariance budget against recorded windows: two ways from one filter to the same errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.budget.error_budget import budget
from insnav.errors.budget.from_windows import (
    RecordedBudget,
    WindowSettings,
    recorded_budget,
    spec_in_windows,
    typical_window,
    window_motion,
    window_start_sources,
    with_recorded,
)
from insnav.errors.budget.sources import start_sources
from tests.errors.outage import drives

TIMES = (10.0, 30.0, 60.0)


@pytest.fixture(scope="module")
def both() -> dict[bool, RecordedBudget]:
    ready = drives.drawn(3)
    return {
        raw: recorded_budget(ready, drives.SPEC, None, WindowSettings(60.0, None, 15.0, uncalibrated=raw, replicas=0))
        for raw in (False, True)
    }


@pytest.mark.parametrize("raw", [False, True])
def test_sources_one_by_one_add_up_to_what_the_filter_predicts(both: dict[bool, RecordedBudget], raw: bool):
    windows = both[raw]
    motion, known = window_motion(windows, 60.0), window_start_sources(windows)
    found = with_recorded(budget(spec_in_windows(windows), motion, TIMES, known=known, runs=200), windows)
    part = windows.shown
    at = [int(np.argmin(np.abs(part.windows.grid - time))) for time in TIMES]
    predicted = np.sqrt(np.diagonal(part.windows.covariance[typical_window(part), at], axis1=1, axis2=2))[:, :6]
    by_sources = found.covariance.total[found.chosen, :6]
    print("by sources:", by_sources.round(3), "by the filter:", predicted.round(3), sep="\n")
    np.testing.assert_allclose(by_sources, predicted, rtol=0.05)
    np.testing.assert_allclose(found.analytic.total[found.chosen, :2], predicted[:, :2], rtol=0.1)
    assert found.simulated is not None
    # 200 runs of nine components at three times: one sd of their mean is 0.04
    assert found.simulated.nees[found.chosen] == pytest.approx(1.0, abs=0.15)


def test_the_window_of_a_budget_predicts_what_all_predict_together(both: dict[bool, RecordedBudget]):
    """Their recorded errors are told as RMS: of many windows that begin well and one lost, the median is none."""
    part, variance = both[False].calibrated, np.zeros((5, 1, 21, 21))
    variance[:, 0, 0, 0] = 1.0, 1.2, 1.4, 7.0, 21.0  # mean 6.3 m^2
    variance[:, 0, 2, 2] = 1.0, 1.0, 1.0, 2.0, 5.0  # mean 2 m^2
    assert typical_window(replace(part, windows=replace(part.windows, covariance=variance))) == 3


def test_the_motion_is_that_of_the_window(both: dict[bool, RecordedBudget]):
    windows = both[False]
    motion, truth = window_motion(windows, 60.0), drives.motion()
    start = windows.calibrated.windows.start[typical_window(windows.calibrated)]
    assert motion.truth.time[0] == pytest.approx(start, abs=0.05)
    there = truth.evaluate(motion.truth.time[::100])
    np.testing.assert_allclose(motion.truth.v_n[::100], there.v_n, atol=0.5)


def test_an_in_run_bias_is_what_is_new_since_the_start(both: dict[bool, RecordedBudget]):
    spec = spec_in_windows(both[False])
    gyro = drives.SPEC.gyro
    np.testing.assert_allclose(spec.gyro.bias_instability, 0.0)
    expected = np.sqrt(gyro.rate_random_walk**2 + 2.0 * gyro.bias_instability**2 / gyro.correlation_time)
    np.testing.assert_allclose(spec.gyro.rate_random_walk, expected)
    np.testing.assert_allclose(spec.gyro.bias, 0.0)  # that of the start is a source of its own


def test_the_sources_of_a_start_are_its_covariance():
    rng = np.random.default_rng(4)
    a = rng.standard_normal((21, 21)) * 10.0 ** rng.uniform(-6, 1, 21)[:, None]
    a[16:19] = 0.0  # states that are known
    covariance = a @ a.T
    found = start_sources(covariance)
    total = sum(source.sd**2 * np.outer(source.joint, source.joint) for source in found)
    scale = np.sqrt(np.diag(covariance)) + 1e-30
    np.testing.assert_allclose(total / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-7)
    assert len(found) == 18
    assert found[0].name == "accel bias x"
    assert found[0].sd == pytest.approx(scale[12])
