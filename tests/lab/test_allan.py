"""The Allan deviation against allantools, closed forms and chance itself."""

from __future__ import annotations

import allantools
import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code
from insnav.lab.noise.allan import (
    LONGEST_PART,
    allan_deviation,
    averaging_factors,
    between,
    chi_square_interval,
    covariance,
    even_record,
    freedom,
    smallest_step,
)
from insnav.types import ImuData
from tests.lab.signals import at_rest, noise
from tests.refusals import refused

INTERVAL = 0.005


@pytest.mark.parametrize("taus", ["log", "octave", (0.005, 0.1, 7.0, 300.0)])
def test_agrees_with_allantools(taus):
    rng = np.random.default_rng(3)
    n = 200_000
    values = np.column_stack([noise(rng, n, INTERVAL, N=1.0, K=k, R=r) + 9.8 for k, r in ((0, 0), (1, 0), (0, 0.01))])
    factors = averaging_factors(n, INTERVAL, taus)
    found = allan_deviation(values, INTERVAL, factors)
    for column in range(3):
        tau, expected, _, _ = allantools.oadev(values[:, column], rate=1.0 / INTERVAL, data_type="freq", taus=found.tau)
        np.testing.assert_allclose(tau, found.tau, rtol=1e-12)
        np.testing.assert_allclose(found.deviation[:, column], expected, rtol=1e-12)


def test_a_ramp_has_its_closed_form_at_every_time():
    factors = averaging_factors(10_000, 0.1)
    found = allan_deviation(2e-3 * 0.1 * np.arange(10_000.0)[:, None], 0.1, factors)
    np.testing.assert_allclose(found.deviation[:, 0], 2e-3 * found.tau / np.sqrt(2.0), rtol=1e-9)


def test_a_large_constant_does_no_harm():
    signal = np.random.default_rng(1).standard_normal((50_000, 1))
    factors = averaging_factors(50_000, 1.0)
    small, large = allan_deviation(signal, 1.0, factors), allan_deviation(signal + 1e4, 1.0, factors)
    np.testing.assert_allclose(large.deviation, small.deviation, rtol=1e-9)


def test_columns_do_not_depend_on_the_number_of_threads():
    values = np.random.default_rng(2).standard_normal((5000, 6))
    factors = averaging_factors(5000, 1.0, "octave")
    one, many = (allan_deviation(values, 1.0, factors, workers).deviation for workers in (1, 6))
    np.testing.assert_array_equal(one, many)


def test_default_times_span_the_record_and_are_about_ninety():
    factors = averaging_factors(3_600_000, INTERVAL)
    assert factors[0] == 1
    assert factors[-1] == 3_600_000 // LONGEST_PART
    assert 80 <= factors.size <= 90
    np.testing.assert_array_equal(averaging_factors(1000, 1.0, "octave"), [1, 2, 4, 8, 16, 32, 64, 128, 256])


@pytest.mark.parametrize("taus", [(0.001,), (600.0,), (-1.0,), (float("nan"),), ()])
def test_times_the_record_does_not_hold_are_refused(taus):
    with refused(ConfigError, "lab.taus"):
        averaging_factors(1000, 1.0, taus)


def test_increments_are_rates_times_their_interval():
    rng = np.random.default_rng(4)
    rest = at_rest(500, 0.01)
    rates = ImuData(rest.time, rng.standard_normal((500, 3)), rest.accel)
    parts = ImuData(rest.time, rates.gyro * 0.01, rates.accel * 0.01, "increment")
    np.testing.assert_allclose(even_record(parts).values, even_record(rates).values, rtol=1e-9, atol=1e-12)


def with_holes(n: int, missing: list[slice]) -> ImuData:
    kept = np.ones(n, dtype=bool)
    for hole in missing:
        kept[hole] = False
    time = 100.0 + 0.01 * np.arange(n)
    ramp = np.arange(n, dtype=float)[kept, None] * np.ones(3)
    return ImuData(time[kept], ramp, ramp)


def test_a_few_lost_samples_are_filled_and_noted():
    record = even_record(with_holes(20_000, [slice(500, 501), slice(9000, 9003)]))
    assert len(record.values) == 20_000
    np.testing.assert_allclose(record.values[:, 0], np.arange(20_000.0), atol=1e-9)
    assert record.notes[0].code == Code.ALLAN_FILLED
    assert (record.notes[0]["count"], record.notes[0]["gaps"]) == (4, 2)


def test_gaps_leave_the_longest_stretch_and_are_said():
    record = even_record(with_holes(20_000, [slice(5000, 6000), slice(16_000, 17_000)]))
    assert len(record.values) == 10_000
    assert record.start == pytest.approx(160.0)
    (stretch,) = record.notes
    assert (stretch.code, stretch["gaps"]) == (Code.ALLAN_LONGEST_STRETCH, 2)
    assert stretch["share"] == pytest.approx(10_000 / 18_000)
    assert (stretch.begin, stretch.end) == (pytest.approx(160.0), pytest.approx(259.99))


def test_timestamp_jitter_is_noted():
    rest = at_rest(1000, 0.01)
    shaken = rest.time + 0.002 * np.random.default_rng(1).uniform(-1.0, 1.0, 1000)
    assert not even_record(rest).notes
    (jitter,) = even_record(ImuData(shaken, rest.gyro, rest.accel)).notes
    assert jitter.code == Code.ALLAN_JITTER
    assert jitter["share_sd"] > jitter["limit_share"]


def test_short_records_are_refused():
    with refused(InputError, "lab.allan_short"):
        even_record(at_rest(99, 0.01))
    with refused(InputError, "lab.allan_short_stretch"):
        even_record(with_holes(150, [slice(70, 90)]))
    with refused(InputError, "lab.empty_part"):
        between(at_rest(200, 0.01), 10.0, 20.0)


def test_steps_are_seen():
    rng = np.random.default_rng(6)
    fine = rng.standard_normal(10_000)
    values = np.column_stack([np.round(fine / 0.25) * 0.25, fine, np.full(10_000, 3.0)])
    np.testing.assert_allclose(smallest_step(values), [0.25, 0.0, 0.0])


# Riley, NIST SP 1065, table of approximations for the overlapping Allan variance; n is the number of phase points
RILEY = {
    "white": (1, lambda n, m: (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)),
    "flicker": (2, lambda n, m: 5 * n**2 / (4 * m * (n + 3 * m))),
    "walk": (3, lambda n, m: (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2),
}


@pytest.mark.parametrize("kind", RILEY)
def test_degrees_of_freedom_are_about_those_of_the_handbook(kind):
    place, formula = RILEY[kind]
    n, factors = 4001, np.array([2, 5, 20, 100, 400, 1000])
    squares = np.zeros(5)
    squares[place] = 1.0
    allan = {1: 1.0 / factors, 2: np.full(6, 2.0 * np.log(2.0) / np.pi), 3: factors / 3.0}[place]
    own = freedom(allan, np.diag(covariance(factors, n - 1, 1.0, squares, np.inf, diagonal=True)))
    np.testing.assert_allclose(own, formula(n, factors.astype(float)), rtol=0.12)


def test_covariance_is_that_of_many_records():
    n, factors = 2000, np.array([1, 3, 10, 30, 100, 300])
    squares = np.array([0.09, 1.0, 0.0, 1e-4, 0.01])
    seen = np.array(
        [
            allan_deviation(
                noise(np.random.default_rng(i), n, 1.0, Q=0.3, N=1.0, K=0.01, sd=0.1, time=20.0)[:, None],
                1.0,
                factors,
                1,
            ).deviation[:, 0]
            ** 2
            for i in range(1500)
        ]
    )
    expected = covariance(factors, n, 1.0, squares, 20.0)
    size = np.sqrt(np.diag(expected))
    # the correlations of 1500 records scatter by 0.03, their standard deviations by 3 % and more as they are skewed
    np.testing.assert_allclose(seen.std(axis=0), size, rtol=0.12)
    np.testing.assert_allclose(np.corrcoef(seen.T), expected / np.outer(size, size), atol=0.1)


def test_intervals_hold_the_truth_as_often_as_they_say():
    n, factors = 3000, np.array([1, 10, 100, 500, 1000])
    truth = 1.0 / np.sqrt(factors)
    variance = np.diag(covariance(factors, n, 1.0, np.array([0.0, 1.0, 0.0, 0.0, 0.0]), np.inf, diagonal=True))
    inside = np.zeros(5)
    for seed in range(600):
        signal = noise(np.random.default_rng(seed), n, 1.0, N=1.0)[:, None]
        found = allan_deviation(signal, 1.0, factors, 1).deviation[:, 0]
        low, high = chi_square_interval(found, freedom(truth**2, variance), 0.9)
        inside += (low <= truth) & (truth <= high)
    # binomial with 600 trials: one standard deviation is 0.012; with two degrees of freedom, at a third of the record,
    # the squares are less spread than chi-square's, and the interval is on the safe side
    print(inside / 600)
    assert np.all(np.abs(inside[:4] / 600 - 0.9) < 0.04), inside / 600
    assert inside[4] / 600 > 0.87
