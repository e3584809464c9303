"""The tests themselves: right size under no change, power under change, published example, dependence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from insnav.regression.evaluate import BY_KEY, METRICS, Metric
from insnav.regression.verdict import ALPHA, POWER, detectable_apart, holm, interval, shift, standard_error

SIZE = Metric("x_m", "x", "m", 0.0)


def test_seeds_are_compared_by_students_t():
    rng = np.random.default_rng(1)
    old, new = np.exp(rng.standard_normal((2, 12)))
    found = shift(old, new, SIZE, pieces=False)
    expected = stats.ttest_rel(np.log(new), np.log(old))
    assert found.p == pytest.approx(expected.pvalue, rel=1e-9)
    low, high = expected.confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((np.expm1(low), np.expm1(high)), rel=1e-9)
    assert found.change == pytest.approx(stats.gmean(new) / stats.gmean(old) - 1.0)


def test_holm_of_a_worked_example():
    # p = 0.01, 0.04, 0.03, 0.005: sorted times 4, 3, 2, 1 and never falling
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.9, 0.8]), [1.0, 1.0])


def test_correlated_pieces_have_a_smaller_effective_sample_size():
    """False calls at 5 % stay near 5 % though neighbours are correlated; taken as independent they would not."""
    rng = np.random.default_rng(3)
    false = {True: 0, False: 0}
    repeats = 300
    for _ in range(repeats):
        white = rng.standard_normal(41)
        old, new = np.ones(40), np.exp(white[1:] + 0.6 * white[:-1])
        for pieces in false:
            false[pieces] += shift(old, new, SIZE, pieces=pieces).p < 0.05
    share = {pieces: count / repeats for pieces, count in false.items()}
    print(share)
    assert share[True] < 0.09
    assert share[False] > 0.12


def test_the_error_by_blocks_is_that_of_independent_pieces_too():
    value = np.random.default_rng(4).standard_normal(60)
    by_blocks, degrees = standard_error(value, pieces=True)
    plain, _ = standard_error(value, pieces=False)
    assert by_blocks == pytest.approx(plain, rel=0.3)
    assert degrees == 29.0


def test_too_few_drives_change_nothing():
    assert shift(np.ones(4), 9.0 * np.ones(4), SIZE, pieces=False).p == 1.0


def test_what_is_not_known_does_not_count():
    old, new = np.ones(9), np.full(9, 2.0)
    new[[0, 5]] = np.nan
    found = shift(old, new, SIZE, pieces=False)
    assert found.change == pytest.approx(1.0)
    assert found.p == 0.0


def test_values_below_the_floor_are_as_good_as_none():
    counts = BY_KEY["rejected_fixes"]
    none = np.zeros(8)
    assert shift(none, none, counts, pieces=False).p == 1.0
    tiny = shift(np.full(8, 1e-9), np.full(8, 9e-9), BY_KEY["north_rms_m"], pieces=False)
    assert abs(tiny.change) < 1e-4


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.key)
def test_worse_is_worse_in_every_metric(metric: Metric):
    value = np.array([1.1, 1.3, 1.2, 1.25, 1.15])
    worse = shift(value, 1.5 * value, metric, pieces=False)
    assert worse.change > 0.25
    assert worse.p < 1e-6


def test_over_confidence_is_worse_than_as_much_caution():
    """NEES 0.5 -> 2: the same distance from one, but not the same."""
    nees = BY_KEY["nees_velocity"]
    scatter = np.exp(0.1 * np.random.default_rng(8).standard_normal(12))
    for old, new, worse in ((0.5, 2.0, True), (2.0, 0.5, False), (1.0, 1.3, True), (1.0, 0.7, True)):
        found = shift(old * scatter, new * scatter, nees, pieces=False)
        assert found.p < 1e-6
        assert (found.change > 0.05) is worse


def test_the_stated_change_is_found_as_often_as_stated():
    """Two versions that err independently: the change that `detectable_apart` names is significant in 80 % of cases."""
    rng, drives, figures, hits, repeats = np.random.default_rng(6), 16, 50, 0, 1000
    scatter = rng.standard_normal(drives)
    known = np.exp(0.3 * (scatter - scatter.mean()) / scatter.std(ddof=1))  # of the true scatter
    least = detectable_apart(known, SIZE, pieces=False, tests=figures)
    for _ in range(repeats):
        old, new = np.exp(0.3 * rng.standard_normal((2, drives)))
        hits += shift(old, new * (1.0 + least), SIZE, pieces=False).p < ALPHA / figures
    assert hits / repeats == pytest.approx(POWER, abs=0.04)
    assert np.isnan(detectable_apart(np.ones(4), SIZE, pieces=False, tests=1))


def test_an_interval_holds_the_typical_value_as_often_as_it_says():
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(400):
        _, low, high = interval(np.exp(rng.standard_normal(10)), SIZE, pieces=False)
        inside += low < 1.0 < high
    assert inside / 400 == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("alike", [0.0, 0.3, 0.6])
def test_intervals_of_successive_pieces_hold_the_truth_however_alike_they_are(alike: float):
    """Forty pieces of a first-order autoregression; with blocks of two alone 95, 94 and 79 %."""
    rng = np.random.default_rng(4)
    pieces = lfilter([np.sqrt(1.0 - alike**2)], [1.0, -alike], rng.normal(size=(300, 90)))[:, 50:]
    inside = [
        low <= 1.0 <= high
        for _, low, high in (interval(np.exp(v), BY_KEY["north_rms_m"], pieces=True) for v in 0.5 * pieces)
    ]
    assert 0.90 < np.mean(inside) < 0.995
