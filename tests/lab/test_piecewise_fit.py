"""Pieces: known borders are found, noise gets none, and the line is what least squares gives."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.lab.rate_sweep import FEWEST_POINTS, MOST, fit_pieces

X = np.arange(-300.0, 301.0, 10.0)
KNOTS, VALUES = np.array([-300.0, -150.0, -40.0, 90.0, 300.0]), np.array([-0.8, 0.1, -0.1, 0.3, -0.5])


def test_known_borders_are_found_exactly_in_any_order() -> None:
    order = np.random.default_rng(1).permutation(X.size)
    y = np.interp(X, KNOTS, VALUES)
    found = fit_pieces(X[order], y[order])
    np.testing.assert_allclose(found.knot, KNOTS)
    np.testing.assert_allclose(found.value, VALUES, atol=1e-12)
    np.testing.assert_allclose(found.slope, np.diff(VALUES) / np.diff(KNOTS), atol=1e-12)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-12)


def test_borders_are_found_in_noise_and_values_within_their_uncertainty() -> None:
    rng, inside, trials = np.random.default_rng(2), 0, 60
    for _ in range(trials):
        found = fit_pieces(X, np.interp(X, KNOTS, VALUES) + 0.01 * rng.normal(size=X.size))
        assert found.knot.size == KNOTS.size
        np.testing.assert_allclose(found.knot, KNOTS, atol=20.0)
        sd = np.sqrt(np.diag(found.covariance))
        inside += int(np.sum(np.abs(np.interp(KNOTS, found.knot, found.value) - VALUES) < 2.0 * sd))
    assert inside / (5 * trials) > 0.9


def test_noise_alone_gets_no_border_but_seldom() -> None:
    rng = np.random.default_rng(3)
    false = sum(not fit_pieces(X, rng.normal(size=X.size)).straight for _ in range(100))
    assert false <= 4  # 1 in 100 is promised: more than 4 come up in 3 of 1000 tests


def test_a_curve_gets_pieces_that_leave_little_and_are_not_too_short() -> None:
    rng = np.random.default_rng(4)
    curve = 0.5 * np.sin(X / 90.0)
    found = fit_pieces(X, curve + 0.005 * rng.normal(size=X.size))
    assert np.std(np.interp(X, found.knot, found.value) - curve) < 0.01 * np.ptp(curve)
    assert found.knot.size <= MOST + 1
    assert np.diff(found.knot).min() >= FEWEST_POINTS * 10.0


def test_left_out_is_what_a_fit_without_the_point_gives() -> None:
    rng = np.random.default_rng(5)
    y = np.interp(X, KNOTS, VALUES) + 0.01 * rng.normal(size=X.size)
    weight = rng.uniform(0.5, 3.0, X.size)
    found = fit_pieces(X, y, weight)
    hats = np.column_stack([np.interp(X, found.knot, row) for row in np.eye(found.knot.size)])
    for i in (0, 7, 30, 60):
        keep = np.arange(X.size) != i
        root = np.sqrt(weight[keep])
        value = np.linalg.lstsq(hats[keep] * root[:, None], y[keep] * root, rcond=None)[0]
        assert found.left_out[i] == pytest.approx(y[i] - hats[i] @ value, abs=1e-10)


def test_a_heavy_point_is_met_closely() -> None:
    weight = np.ones(X.size)
    weight[30] = 1e8
    y = np.random.default_rng(6).normal(size=X.size)
    found = fit_pieces(X, y, weight)
    assert np.interp(0.0, found.knot, found.value) == pytest.approx(y[30], abs=1e-5)


def test_nothing_but_zeros_is_straight() -> None:
    assert fit_pieces(X, np.zeros(X.size)).straight
