"""What is left of errors without the reference, what is inside, and what is common to all windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from insnav.errors.outage.free_inertial import Outage
from insnav.errors.outage.gnss_outage import growth, outage_growth, regression
from tests.errors.outage import drives

COUNT = 400


def outage_windows(error: np.ndarray, sd: float, reference_sd: float, count: int = COUNT) -> list[Outage]:
    """Windows of 10 s whose error, ``(n, 6)`` in all states, grows in proportion to time; smoothed it has an arch."""
    elapsed = np.arange(1.0, 11.0)
    shape = elapsed[:, None] / 10.0
    arch = np.sin(np.pi * elapsed / 11.0)[:, None]
    rng = np.random.default_rng(5)
    full = np.ones((10, 6))
    return [
        Outage(
            start=20.0 * k,
            length=10.0,
            elapsed=elapsed,
            error=error[k] * shape + reference_sd * rng.standard_normal((10, 6)),
            sd=sd * shape * full,
            smoothed=0.1 * error[k] * arch + reference_sd * rng.standard_normal((10, 6)),
            smoothed_sd=0.1 * sd * arch * full,
            reference_sd=reference_sd * full,
            heading=error[k, 0] * 0.01 * elapsed,
            heading_sd=sd * 0.01 * elapsed,
            speed=10.0,
        )
        for k in range(count)
    ]


def test_the_reference_is_in_all_but_the_corrected():
    error = np.random.default_rng(1).standard_normal((COUNT, 6)) * 3.0
    (found,) = outage_growth(outage_windows(error, 3.0, 2.0))
    at = found.column("vertical")
    assert found.rms[-1, at] == pytest.approx(np.sqrt(9.0 + 4.0), rel=0.1)
    assert found.corrected[-1, at] == pytest.approx(3.0, rel=0.12)
    assert found.low[-1, at] < 3.0 < found.high[-1, at]
    assert found.predicted[-1, at] == pytest.approx(3.0)
    assert found.rms[-1, at] < found.p95[-1, at] < found.largest[-1, at]
    assert not found.below_noise[-1, at]


def test_smoothed_errors_are_those_where_they_are_predicted_to_be_largest():
    """Picking the largest difference to noisy fixes would give their noise: 3 m where 0.3 m are right."""
    error = np.random.default_rng(2).standard_normal((COUNT, 6)) * 3.0
    (found,) = outage_growth(outage_windows(error, 3.0, 0.3))
    at = found.column("smoothed vertical")
    assert found.corrected[-1, at] == pytest.approx(0.3 * np.sin(np.pi * 6.0 / 11.0), rel=0.15)
    (noisy,) = outage_growth(outage_windows(error, 3.0, 1.0))
    assert noisy.low[-1, at] < 0.3 < max(noisy.high[-1, at], 0.5)


def test_what_is_below_the_noise_of_the_reference_is_not_zero():
    windows = outage_windows(np.zeros((COUNT, 6)), 0.1, 2.0)
    (found,) = outage_growth([replace(each, reference_sd=1.1 * each.reference_sd) for each in windows])
    at = found.column("horizontal")
    assert found.below_noise[-1, at]
    assert np.isnan(found.corrected[-1, at])
    assert found.rms[-1, at] == pytest.approx(2.0 * np.sqrt(2.0), rel=0.1)
    assert found.low[-1, at] == 0.0
    assert 0.0 <= found.high[-1, at] < 0.5


def test_an_error_common_to_all_windows_is_seen():
    rng = np.random.default_rng(3)
    own = rng.standard_normal((COUNT, 6))
    (apart,) = outage_growth(outage_windows(own, 1.0, 1e-3))
    (half,) = outage_growth(outage_windows(own + np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0]), 1.4, 1e-3))
    assert apart.common[-1].max() < 0.02
    np.testing.assert_allclose(half.common[-1, :3], 0.5, atol=0.08)


def test_inside_counts_every_axis():
    """North within 3 sd and East not are a half, not the whole."""
    windows = drives.windows()
    error = np.zeros_like(windows.error)
    error[..., 1] = 1e6
    found = growth(replace(windows, error=error))
    at = [found.column(name) for name in ("north", "east", "horizontal")]
    np.testing.assert_allclose(found.inside[:, at], np.broadcast_to([1.0, 0.0, 0.5], (len(found.times), 3)))


def test_turn_on_errors_of_one_sensor_are_one_sample_whatever_the_number_of_windows():
    """Chi-square with one degree of freedom: another sensor errs by 0.45 to 32 times as much in 95 of 100."""
    windows = drives.windows(uncalibrated=True)
    found = growth(windows)
    at = found.column("north")
    left = found.rms[-1, at]
    assert found.low[-1, at] < 1.02 * left / np.sqrt(chi2.ppf(0.975, 1.0))
    assert found.high[-1, at] > 0.98 * left / np.sqrt(chi2.ppf(0.025, 1.0))
    line = regression(windows)
    assert line.low < 0.75 * line.slope
    assert line.high > 3.0 * line.slope
