"""Injected sensor errors are found again, and the regression is one where predictions are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.diagnosis.causes import CAUSES, diagnose, fit_sensors
from insnav.errors.outage.gnss_outage import regression
from insnav.units import DEG_PER_H, G0, UG
from tests.errors.outage import drives


def test_ten_degrees_per_hour_and_a_milli_g_are_recovered():
    fit = fit_sensors(drives.windows(uncalibrated=True), drives.injected().model)
    accel, gyro = fit.accel * drives.SIGNS / UG, fit.gyro * drives.SIGNS / DEG_PER_H
    print(f"accelerometers {accel.round(1)} ug, gyros {gyro.round(3)} deg/h, misfit {fit.spread:.2f}")
    np.testing.assert_allclose(accel, 1000.0, rtol=0.05)
    np.testing.assert_allclose(gyro[:2], 10.0, rtol=0.05)
    # heading drifts show only while the vehicle accelerates
    assert abs(gyro[2] - 10.0) < 3.0 * fit.gyro_sd[2] / DEG_PER_H
    assert (np.abs(accel - 1000.0) < 4.0 * fit.accel_sd / UG).all()
    assert (np.abs(gyro - 10.0) < 4.0 * fit.gyro_sd / DEG_PER_H).all()
    assert 0.3 < fit.spread < 2.0
    assert fit.level_observable


def test_a_filter_that_has_found_them_leaves_little():
    raw, left = (fit_sensors(drives.windows(uncalibrated=r), drives.injected().model) for r in (True, False))
    assert np.abs(left.accel).max() < 0.1 * np.abs(raw.accel).min()
    assert np.abs(left.gyro[:2]).max() < 0.1 * np.abs(raw.gyro[:2]).min()


def test_on_one_heading_bias_and_tilt_are_not_separately_observable():
    windows = drives.windows(uncalibrated=True)
    rows = np.flatnonzero(windows.motion == "straight")[:2]
    assert not fit_sensors(windows.only(rows), drives.injected().model).level_observable


def test_straight_windows_show_the_projected_errors():
    windows = drives.windows(uncalibrated=True, length=30.0)
    found = diagnose(windows, drives.injected().model)
    assert found.steady
    assert found.windows.count < windows.count
    # on any heading, north and east together have both level biases: sqrt(2) of one
    total = {cause: np.hypot(*(axis.causes[i].rms for axis in found.axes)) for i, cause in enumerate(CAUSES)}
    print({name: float(value) for name, value in total.items()})
    assert total["acceleration"] / G0 * 1e3 == pytest.approx(np.sqrt(2.0), rel=0.05)
    assert total["drift"] / DEG_PER_H == pytest.approx(np.sqrt(2.0) * 10.0, rel=0.1)
    for axis in found.axes:
        for name, cause in zip(CAUSES, axis.causes, strict=True):
            assert cause.explained, (axis.axis, name, cause)
            if name != "velocity":
                assert cause.spec_sd == pytest.approx(cause.filter_sd, rel=0.35)


def test_errors_beyond_the_stated_ones_are_unexplained():
    windows = drives.windows(uncalibrated=True, length=30.0)
    tenth = np.diag(np.concatenate([np.ones(9), np.full(12, 0.1)]))
    stated = replace(windows, start_covariance=tenth @ windows.start_covariance @ tenth)
    found = diagnose(stated, drives.injected().model)
    assert not any(axis.causes[1].explained for axis in found.axes)
    assert found.axes[0].leading in (1, 2)


def test_windows_that_jump_are_set_aside():
    windows = drives.windows(uncalibrated=True, length=30.0)
    error = windows.error.copy()
    jumped = int(np.flatnonzero(windows.motion == "straight")[0])
    error[jumped, 12:, 0] += 20.0
    found = diagnose(replace(windows, error=error), drives.injected().model)
    clean = diagnose(windows, drives.injected().model)
    assert found.rough == clean.rough + 1
    assert found.axes[0].causes[1].rms == pytest.approx(clean.axes[0].causes[1].rms, rel=0.2)


def test_the_slope_is_one_where_predictions_are_right():
    windows = drives.windows()
    rng = np.random.default_rng(2)
    root = np.linalg.cholesky(windows.covariance + 1e-12 * np.eye(6))

    def one():
        made = (root @ rng.standard_normal((*windows.error.shape, 1)))[..., 0]
        return replace(windows, error=made + windows.reference_sd * rng.standard_normal(made.shape))

    draws = [one() for _ in range(30)]
    found = [regression(each) for each in draws]
    slopes = np.array([each.slope for each in found])
    held = sum(each.low <= 1.0 <= each.high for each in found)
    print(
        f"slope {slopes.mean():.3f} +- {slopes.std():.3f}, {held} of 30 intervals hold one; R² {found[0].r_squared:.2f}"
    )
    assert slopes.mean() == pytest.approx(1.0, abs=0.02)
    assert held >= 24
    assert 0.2 < found[0].r_squared < 0.8
    twice = regression(replace(draws[0], error=2.0 * draws[0].error))
    assert twice.slope == pytest.approx(2.0 * slopes[0], rel=1e-9)
    assert twice.low > 1.2
