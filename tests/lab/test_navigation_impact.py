"""What a calibration is worth in a minute: closed forms, and that what is known is taken off."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.imu import ImuErrors
from insnav.imu.dynamic_map import AxisMap, DynamicMap
from insnav.imu.higher_order import ErrorTerms
from insnav.imu.raw_outputs import RawScale
from insnav.lab.navigation_impact import MINUTE, Calibrated, minute_effect
from insnav.units import DEG, G0, UG

B, EPS = 50.0 * UG, 10.0 * DEG / 3600.0


def test_an_accelerometer_bias_without_calibration_is_half_b_t_squared() -> None:
    at_rest, _ = minute_effect(Calibrated(ImuErrors(accel_bias=np.array([B, 0.0, 0.0]))))
    assert at_rest.without == pytest.approx(0.5 * B * MINUTE**2, rel=2e-3)
    assert at_rest.corrected < 1e-3 * at_rest.without


def test_a_gyro_bias_without_calibration_is_a_sixth_of_g_eps_t_cubed() -> None:
    at_rest, _ = minute_effect(Calibrated(ImuErrors(gyro_bias=np.array([0.0, EPS, 0.0]))))
    assert at_rest.without == pytest.approx(G0 * EPS * MINUTE**3 / 6.0, rel=3e-3)
    assert at_rest.corrected < 1e-3 * at_rest.without


def test_uncertainty_of_the_calibration_is_what_is_left() -> None:
    sd = np.full(3, B)
    at_rest, _ = minute_effect(Calibrated(ImuErrors(accel_bias=np.full(3, 100.0 * B)), accel_bias_sd=sd))
    # two horizontal axes; the draws scatter the root mean square of 24 by about a tenth
    assert at_rest.corrected == pytest.approx(np.sqrt(2.0) * 0.5 * B * MINUTE**2, rel=0.35)


def test_g_sensitivity_and_map_are_drawn_with_their_uncertainty() -> None:
    terms = ErrorTerms(g_sensitivity=np.full((3, 3), EPS / G0))
    known = ImuErrors(gyro_terms=terms)
    exact, _ = minute_effect(Calibrated(known))
    # each horizontal gyro feels eps of 1 g
    assert exact.without == pytest.approx(np.sqrt(2.0) * G0 * EPS * MINUTE**3 / 6.0, rel=5e-3)
    assert exact.corrected < 1e-3 * exact.without
    rough, _ = minute_effect(Calibrated(known, g_sensitivity_sd=np.full((3, 3), EPS / G0)))
    assert rough.corrected == pytest.approx(exact.without, rel=0.35)
    bent = DynamicMap(y=AxisMap(np.array([-5.0, 0.0, 5.0]), np.array([0.01, EPS, 0.01])))
    at_rest, _ = minute_effect(Calibrated(ImuErrors(gyro_map=bent)))
    assert at_rest.corrected < 1e-2 * at_rest.without
    spread = (None, np.diag([1e-12, EPS**2, 1e-12]), None)
    loose, _ = minute_effect(Calibrated(ImuErrors(gyro_map=bent), gyro_map_covariance=spread))
    assert loose.corrected == pytest.approx(G0 * EPS * MINUTE**3 / 6.0, rel=0.35)


def test_the_zero_of_volts_counts_as_a_bias() -> None:
    raw = RawScale("V", np.array([0.002, 0.0, 0.0]), np.full(3, 0.002 / B))
    at_rest, _ = minute_effect(Calibrated(ImuErrors(accel_raw=raw)))
    assert at_rest.without == pytest.approx(0.5 * B * MINUTE**2, rel=2e-3)


def test_corrected_sd_adds_what_is_independent() -> None:
    rng = np.random.default_rng(1)
    known = Calibrated(
        ImuErrors(),
        gyro_bias_sd=np.array([1.0, 2.0, 3.0]),
        gyro_matrix_sd=np.diag([0.1, 0.2, 0.3]),
        g_sensitivity_sd=np.full((3, 3), 0.01),
        accel_bias_sd=np.ones(3),
        accel_matrix_sd=0.1 * np.eye(3)[[1, 2, 0]],
    )
    rate, force = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    of_rate, of_force = known.corrected_sd(rate, force)
    shown = np.hypot([1.0, 2.0, 3.0], rate * [0.1, 0.2, 0.3])
    np.testing.assert_allclose(of_rate, np.hypot(shown, 0.01 * np.linalg.norm(force, axis=1)[:, None]))
    np.testing.assert_allclose(of_force, np.hypot(1.0, 0.1 * force[:, [1, 2, 0]]))
