"""Splines and least squares beside scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from insnav.spline import Spline, positive_parts


@pytest.mark.parametrize("count", [4, 5, 6, 50, 1000])
def test_a_spline_is_that_of_scipy(count):
    rng = np.random.default_rng(count)
    time = np.cumsum(np.where(rng.random(count) < 0.02, 60.0, rng.uniform(0.3, 1.5, count)))  # with gaps
    values = np.cumsum(rng.normal(size=(count, 2)), axis=0)
    at = rng.uniform(time[0] - 1.0, time[-1] + 1.0, 300)
    ours, theirs = Spline(time, values), CubicSpline(time, values)
    for order, found in enumerate(ours.changes(at), start=1):
        np.testing.assert_allclose(found, theirs(at, order), rtol=1e-9, atol=1e-9)
    integral = theirs.antiderivative()(at)
    np.testing.assert_allclose(ours.integral(at), integral, rtol=1e-9, atol=1e-9 * np.abs(integral).max())


@pytest.mark.parametrize("count", [1, 2, 3])
def test_parts_that_are_not_negative_are_those_of_scipy(count):
    rng = np.random.default_rng(count)
    for _ in range(50):
        terms, values = rng.normal(0.5, 1.0, (20, count)), rng.normal(size=20)
        parts, misfit = positive_parts(terms, values)
        expected, least = nnls(terms, values)
        np.testing.assert_allclose(parts, expected, atol=1e-12)
        assert misfit == pytest.approx(least, rel=1e-12)
