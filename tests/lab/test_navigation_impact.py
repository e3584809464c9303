"""Impact of a calibration on a minute of navigation: closed forms, and that known errors are corrected."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.imu import ImuErrors
from insnav.imu.model import AxisMap, DynamicMap, ErrorTerms, RawScale
from insnav.lab.calibration import MINUTE, CalibrationSd, navigation_impact
from insnav.units import DEG, G0, UG

B, EPS = 50.0 * UG, 10.0 * DEG / 3600.0


def test_an_accelerometer_bias_without_calibration_is_half_b_t_squared() -> None:
    at_rest, _ = navigation_impact(ImuErrors(accel_bias=np.array([B, 0.0, 0.0])), CalibrationSd())
    assert at_rest.without == pytest.approx(0.5 * B * MINUTE**2, rel=2e-3)
    assert at_rest.corrected < 1e-3 * at_rest.without


def test_a_gyro_bias_without_calibration_is_a_sixth_of_g_eps_t_cubed() -> None:
    at_rest, _ = navigation_impact(ImuErrors(gyro_bias=np.array([0.0, EPS, 0.0])), CalibrationSd())
    assert at_rest.without == pytest.approx(G0 * EPS * MINUTE**3 / 6.0, rel=3e-3)
    assert at_rest.corrected < 1e-3 * at_rest.without


def test_uncertainty_of_the_calibration_is_what_is_left() -> None:
    sd = np.full(3, B)
    at_rest, _ = navigation_impact(ImuErrors(accel_bias=np.full(3, 100.0 * B)), CalibrationSd(accel_bias=sd))
    # two horizontal axes; the draws scatter the root mean square of 24 by about a tenth
    assert at_rest.corrected == pytest.approx(np.sqrt(2.0) * 0.5 * B * MINUTE**2, rel=0.35)


def test_g_sensitivity_and_map_are_drawn_with_their_uncertainty() -> None:
    terms = ErrorTerms(g_sensitivity=np.full((3, 3), EPS / G0))
    known = ImuErrors(gyro_terms=terms)
    exact, _ = navigation_impact(known, CalibrationSd())
    # each horizontal gyro feels eps of 1 g
    assert exact.without == pytest.approx(np.sqrt(2.0) * G0 * EPS * MINUTE**3 / 6.0, rel=5e-3)
    assert exact.corrected < 1e-3 * exact.without
    rough, _ = navigation_impact(known, CalibrationSd(g_sensitivity=np.full((3, 3), EPS / G0)))
    assert rough.corrected == pytest.approx(exact.without, rel=0.35)
    bent = DynamicMap((None, AxisMap(np.array([-5.0, 0.0, 5.0]), np.array([0.01, EPS, 0.01])), None))
    at_rest, _ = navigation_impact(ImuErrors(gyro_map=bent), CalibrationSd())
    assert at_rest.corrected < 1e-2 * at_rest.without
    spread = (None, np.diag([1e-12, EPS**2, 1e-12]), None)
    loose, _ = navigation_impact(ImuErrors(gyro_map=bent), CalibrationSd(gyro_map=spread))
    assert loose.corrected == pytest.approx(G0 * EPS * MINUTE**3 / 6.0, rel=0.35)


def test_the_zero_of_volts_counts_as_a_bias() -> None:
    raw = RawScale("V", np.array([0.002, 0.0, 0.0]), np.full(3, 0.002 / B))
    at_rest, _ = navigation_impact(ImuErrors(accel_raw=raw), CalibrationSd())
    assert at_rest.without == pytest.approx(0.5 * B * MINUTE**2, rel=2e-3)


def test_corrected_sd_adds_what_is_independent() -> None:
    rng = np.random.default_rng(1)
    known = CalibrationSd(
        gyro_bias=np.array([1.0, 2.0, 3.0]),
        gyro_matrix=np.diag([0.1, 0.2, 0.3]),
        g_sensitivity=np.full((3, 3), 0.01),
        accel_bias=np.ones(3),
        accel_matrix=0.1 * np.eye(3)[[1, 2, 0]],
    )
    rate, force = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    of_rate, of_force = known.corrected(ImuErrors(), rate, force)
    shown = np.hypot([1.0, 2.0, 3.0], rate * [0.1, 0.2, 0.3])
    np.testing.assert_allclose(of_rate, np.hypot(shown, 0.01 * np.linalg.norm(force, axis=1)[:, None]))
    np.testing.assert_allclose(of_force, np.hypot(1.0, 0.1 * force[:, [1, 2, 0]]))
