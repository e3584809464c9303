"""The guards around filterpy: nothing that is not a number passes, and repairs are counted."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from insnav.exceptions import DivergenceError
from insnav.filter.estimate import MAX_REPAIRS, Engine

N = 21


def covariance() -> np.ndarray:
    a = np.random.default_rng(5).standard_normal((N, N))
    return a @ a.T + np.eye(N)


def measurement(m: int = 6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6)
    return rng.standard_normal(m), rng.standard_normal((m, N)), np.diag(rng.uniform(0.5, 2.0, m))


@pytest.mark.parametrize("m", [3, 6])
def test_update_is_the_conditional_expectation(m):
    # independent route: information form, P+ = (P^-1 + H' R^-1 H)^-1, x = P+ H' R^-1 z
    p, (z, h, r) = covariance(), measurement(m)
    engine = Engine(p)
    error, repaired = engine.update(z, h, r, 0.0)
    after = np.linalg.inv(np.linalg.inv(p) + h.T @ np.linalg.inv(r) @ h)
    np.testing.assert_allclose(engine.covariance, after, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(error, after @ h.T @ np.linalg.inv(r) @ z, rtol=1e-8, atol=1e-9)
    assert not repaired


def test_every_update_starts_from_zero():
    z, h, r = measurement()
    engine = Engine(covariance())
    engine.update(z, h, r, 0.0)
    error, _ = engine.update(np.zeros(6), h, r, 0.0)
    np.testing.assert_array_equal(error, 0.0)


def test_an_error_handed_out_is_not_changed_later():
    z, h, r = measurement()
    engine = Engine(covariance())
    first, _ = engine.update(z, h, r, 0.0)
    kept = first.copy()
    engine.update(2 * z, h, r, 1.0)
    np.testing.assert_array_equal(first, kept)


def test_prediction_is_that_of_the_covariance_equation():
    rng = np.random.default_rng(7)
    p, f = covariance(), np.eye(N) + 0.1 * rng.standard_normal((N, N))
    q = np.diag(rng.uniform(0.0, 1.0, N))
    engine = Engine(p)
    assert engine.predict(f, q, 0.0) is False
    np.testing.assert_allclose(engine.covariance, f @ p @ f.T + q, rtol=1e-12)
    np.testing.assert_array_equal(engine.covariance, engine.covariance.T)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_measurement_that_is_not_finite_is_refused_before_it_spoils_anything(which, bad):
    parts = list(measurement())
    parts[which] = parts[which].copy()
    parts[which].flat[0] = bad
    engine = Engine(covariance())
    with pytest.raises(DivergenceError, match="measurement") as caught:
        engine.update(*parts, 12.5)
    assert "12.500" in caught.value.where
    np.testing.assert_array_equal(engine.covariance, covariance())


@pytest.mark.parametrize("variance", [0.0, -1.0])
def test_a_variance_that_is_not_positive_is_refused(variance):
    z, h, r = measurement()
    r[2, 2] = variance
    with pytest.raises(DivergenceError, match=r"filter.bad_measurement"):
        Engine(covariance()).update(z, h, r, 0.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_covariance_that_is_not_finite_is_an_error(bad):
    f = np.eye(N)
    f[3, 4] = bad
    # inf times zero is the NaN that is looked for
    with (
        np.errstate(invalid="ignore"),
        pytest.raises(DivergenceError, match=r"filter.not_finite") as caught,
    ):
        Engine(covariance()).predict(f, np.zeros((N, N)), 3.0)
    assert caught.value.exit_code == 3


def test_a_negative_variance_is_repaired_and_counted():
    engine = Engine(np.eye(N))
    q = np.zeros((N, N))
    q[4, 4] = -1.5
    assert engine.predict(np.eye(N), q, 0.0) is True
    assert engine.repairs == 1
    assert np.linalg.eigvalsh(engine.covariance).min() >= 0.0
    np.testing.assert_allclose(np.delete(np.diag(engine.covariance), 4), 1.0)
    assert engine.predict(np.eye(N), np.zeros((N, N)), 0.0) is False


def test_too_many_repairs_are_divergence():
    engine = Engine(np.eye(N))
    q = np.zeros((N, N))
    q[4, 4] = -2.0
    for _ in range(MAX_REPAIRS):
        engine.predict(np.eye(N), q, 0.0)
    with pytest.raises(DivergenceError, match=r"filter.no_variance"):
        engine.predict(np.eye(N), q, 0.0)


def test_the_covariance_handed_in_is_not_changed():
    p = covariance()
    z, h, r = measurement()
    engine = Engine(p)
    engine.update(z, h, r, 0.0)
    np.testing.assert_array_equal(p, covariance())
    replacement = np.eye(N)
    engine.replace_covariance(replacement)
    engine.update(z, h, r, 0.0)
    np.testing.assert_array_equal(replacement, np.eye(N))


def test_filterpy_is_loaded_without_most_of_scipy_until_a_function_needs_it():
    code = (
        "import sys\nfrom insnav.filter.estimate import KalmanFilter\n"
        "assert not {'scipy.stats', 'scipy.ndimage', 'scipy.linalg', 'filterpy.stats'} & set(sys.modules)\n"
        "kalman = KalmanFilter(1, 1)\nkalman.H[:] = 1.0\nkalman.update(2.0)\n"
        "assert 'scipy.stats' not in sys.modules\nprint(kalman.log_likelihood)\n"
        "import filterpy.stats\nprint(filterpy.stats.logpdf(2.0, 0.0, 2.0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found, expected = done.stdout.split()
    assert float(found) == float(expected)
