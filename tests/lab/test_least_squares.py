"""Least squares against numpy's own, its uncertainty against Monte Carlo, and what it refuses by name."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.lab.calibration import coverage_factor, linear_fit, outliers
from tests.refusals import refused

X = np.linspace(-3.0, 5.0, 9)
LINE = np.column_stack((np.ones_like(X), X))


def test_values_and_covariance_are_those_of_polyfit() -> None:
    measured = 2.0 - 0.7 * X + np.random.default_rng(1).normal(size=9)
    fit = linear_fit(LINE, measured, ("zero", "slope"))
    value, covariance = np.polyfit(X, measured, 1, cov=True)
    np.testing.assert_allclose(fit.value, value[::-1], rtol=1e-12)
    np.testing.assert_allclose(fit.covariance, covariance[::-1, ::-1], rtol=1e-10)
    np.testing.assert_allclose(fit.residual, measured - np.polyval(value, X), atol=1e-12)
    assert fit.worst == np.argmax(np.abs(fit.residual))
    assert fit.rms == pytest.approx(np.sqrt(np.mean(fit.residual**2)))


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(2)
    truth, inside, trials = np.array([2.0, -0.7]), 0, 2000
    for _ in range(trials):
        fit = linear_fit(LINE[:5], LINE[:5] @ truth + rng.normal(size=5), ("zero", "slope"))  # three degrees of freedom
        inside += int(np.sum(np.abs(fit.value - truth) < fit.half_width(0.9)))
    assert inside / (2 * trials) == pytest.approx(0.9, abs=0.015)


def test_coverage_factor_is_the_tabulated_one() -> None:
    assert coverage_factor(4) == pytest.approx(2.776, abs=5e-4)  # every table of Student's t
    assert coverage_factor(np.inf) == pytest.approx(1.960, abs=5e-4)


def test_condition_does_not_depend_on_units() -> None:
    measured = 2.0 - 0.7 * X + np.sin(X)
    plain = linear_fit(LINE, measured, ("zero", "slope"))
    scaled = linear_fit(LINE * [1.0, 1e6], measured, ("zero", "slope"))
    assert scaled.condition == pytest.approx(plain.condition, rel=1e-9)
    assert scaled.value[1] == pytest.approx(plain.value[1] * 1e-6, rel=1e-9)


@pytest.mark.parametrize(
    ("design", "code", "values"),
    [
        (np.column_stack((np.ones(9), X, np.zeros(9))), "lab.parameters_idle", {"parameters": ("c",)}),
        (np.column_stack((X, np.ones(9), 3.0 * X)), "lab.parameters_mixed", {"parameters": ("a", "c")}),
        (
            np.column_stack((X, np.ones(9), X**2))[:3],
            "lab.few_measurements",
            {"parameters": ("a", "b", "c"), "limit": 4},
        ),
        (np.column_stack((X, np.ones(9), np.where(X > 4.5, np.nan, X**2))), "lab.not_finite", {"row": 9}),
    ],
)
def test_what_cannot_be_fitted_is_refused_by_name(design: np.ndarray, code: str, values: dict) -> None:
    with refused(InputError, code) as caught:
        linear_fit(design, np.arange(len(design), dtype=float), ("a", "b", "c"), where="bench.csv")
    assert values.items() <= caught.value.values.items()
    assert caught.value.where == "bench.csv"


def test_an_outlier_is_found_and_a_good_fit_has_none_as_often_as_stated() -> None:
    rng, alarms, trials = np.random.default_rng(4), 0, 2000
    for trial in range(trials):
        measured = 2.0 - 0.7 * X + rng.normal(size=9)
        alarms += bool(outliers(linear_fit(LINE, measured, ("zero", "slope")), LINE))
        if trial < 20:
            measured[6] += 30.0
            assert outliers(linear_fit(LINE, measured, ("zero", "slope")), LINE) == (6,)
    assert alarms / trials == pytest.approx(0.05, abs=0.015)
