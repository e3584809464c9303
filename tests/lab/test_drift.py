"""Drift of gyros: coefficients found and taken off, the scalar filter by its definition, noise before and after."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import multivariate_normal

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.imu import ImuErrors, calibration_to_toml, load_calibration
from insnav.imu.model import ErrorTerms
from insnav.lab.bench_data import DriftRecord
from insnav.lab.drift import (
    P0,
    TAUS,
    Smoother,
    choose_smoother,
    computed_ramp,
    corrected_rates,
    drift_errors,
    drift_model,
    drift_study,
    power_fit,
    smooth,
    variance_inflation,
)
from insnav.lab.noise.allan import AllanDeviation, allan_deviation
from insnav.report.drift.page import drift_panels, rate_panels
from insnav.units import DEG, DEG_PER_SQRT_H, G0
from tests.lab.signals import noise
from tests.refusals import refused

INTERVAL = 0.1
TRUTH = {"A": 0.5 * DEG, "B": 2e-3, "c_T": 0.1 * DEG, "c_g": 0.1 * DEG / G0}  # of a typical MEMS part
LSB = DEG / 131.0


def bench(random: object = 0.0, *, steps: bool = False) -> DriftRecord:
    """100 s at rest, 0 to 10 r/min in 100 s, then constant; tilted and warmed all the while; x and z measured."""
    time = INTERVAL * np.arange(1, 3001)
    rate = 60.0 * DEG * np.clip((time - 100.0) / 100.0, 0.0, 1.0)
    temperature = 25.0 + 6.0 * (1.0 - np.exp(-time / 80.0))
    force = G0 * np.sin(np.radians(30.0) * np.sin(2.0 * np.pi * time / 150.0))
    drift = TRUTH["A"] + TRUTH["B"] * rate + TRUTH["c_T"] * (temperature - 25.0) + TRUTH["c_g"] * force
    z = rate + drift + random
    if steps:
        z = np.round(z / LSB) * LSB
    return DriftRecord("bench", time, ("z",), {"z": z}, {"z": rate}, {"z": force}, temperature)


def mems(seed: int) -> np.ndarray:
    return noise(np.random.default_rng(seed), 3000, INTERVAL, N=1.0 * DEG_PER_SQRT_H, sd=0.004 * DEG, time=20.0)


def test_drift_is_found_and_taken_off_exactly(tmp_path):
    record = bench()
    model = drift_model(record, "z")
    assert model.left_out == {}
    for term, value in TRUTH.items():
        assert model.value[term] == pytest.approx(value, rel=1e-9)
    (tmp_path / "c.toml").write_text(calibration_to_toml(drift_errors({"z": model})), encoding="utf-8")
    corrected = corrected_rates(record, load_calibration(str(tmp_path / "c.toml")))["z"]
    np.testing.assert_allclose(corrected, record.rate["z"], atol=1e-12)


def test_printed_uncertainty_holds_with_noise_that_lasts():
    inside, naive = [], []
    for seed in range(60):
        model = drift_model(bench(mems(seed), steps=True), "z")
        inside += [abs(model.value[term] - value) < model.half_width(term) for term, value in TRUTH.items()]
        naive += [abs(model.value[t] - v) < 1.96 * s for (t, v), s in zip(TRUTH.items(), model.fit.sd, strict=True)]
    assert np.mean(inside) > 0.89  # 95 %; of 240 that depend on one another
    assert np.mean(naive) < 0.85  # samples taken as independent promise too much


def test_means_scatter_as_those_of_a_known_process():
    rng = np.random.default_rng(2)
    white = np.mean([variance_inflation(rng.standard_normal(5000), 1)[0] for _ in range(50)])
    assert 1.0 < white < 1.5  # the largest of several counts
    decay = 0.9
    found = [variance_inflation(noise(rng, 20_000, 1.0, sd=1.0, time=-1.0 / np.log(decay)), 1)[0] for _ in range(50)]
    assert np.mean(found) == pytest.approx((1.0 + decay) / (1.0 - decay), rel=0.35)


def test_what_does_not_change_is_named_and_left_out():
    record = bench()
    still = DriftRecord("still", record.time, ("z",), record.gyro, {}, {}, None)
    assert set(drift_model(still, "z").left_out) == {"B", "c_T", "c_g"}
    why = drift_model(still, "z").left_out["c_T"]
    assert (why.code, why.subject, why["cause"]) == (Code.DRIFT_NO_COLUMN, "gyro z", "temperature")
    calm = DriftRecord("calm", record.time, ("z",), record.gyro, record.rate, record.force, 0.0 * record.time + 30.0)
    why = drift_model(calm, "z").left_out["c_T"]
    assert (why.code, why["spread_k"], why["limit_k"]) == (Code.DRIFT_CONSTANT, 0.0, 0.5)
    together = DriftRecord("both", record.time, ("z",), record.gyro, record.rate, {}, 25.0 + 10.0 * record.rate["z"])
    why = drift_model(together, "z").left_out["c_T"]
    assert why.code == Code.DRIFT_CONFOUNDED
    assert why["spread_k"] < why["limit_k"]


def test_the_filter_is_the_scalar_kalman_filter():
    values = np.random.default_rng(1).standard_normal(400) * DEG
    smoother = Smoother(1e-4 * DEG**2, 1e-2 * DEG**2, INTERVAL, False)
    out = smooth(values, smoother)
    kalman = KalmanFilter(1, 1)
    kalman.F, kalman.H, kalman.P = np.eye(1), np.eye(1), np.array([[DEG**2]])
    kalman.Q, kalman.R = np.array([[smoother.q]]), np.array([[smoother.r]])
    x, p, expected, peer = 0.0, P0, [], []
    for value in values:
        p += smoother.q
        gain = p / (p + smoother.r)
        x, p = x + gain * (value - x), (1.0 - gain) * p
        expected.append(x)
        kalman.predict()
        kalman.update(value)
        peer.append(kalman.x[0, 0])
    np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-12 * DEG)
    np.testing.assert_allclose(out, peer, rtol=0.0, atol=1e-12 * DEG)
    assert smoother.gain == pytest.approx(gain, rel=1e-12)


def test_the_likelihood_is_that_of_the_dense_covariance():
    rng = np.random.default_rng(4)
    n = 60
    values = np.cumsum(0.5 * rng.standard_normal(n)) + rng.standard_normal(n)
    found = choose_smoother(values, INTERVAL)

    def likelihood(q: float, r: float) -> float:
        covariance = (q + 2.0 * r) * np.eye(n - 1) - r * (np.eye(n - 1, k=1) + np.eye(n - 1, k=-1))
        return float(multivariate_normal(cov=covariance).logpdf(np.diff(values)))

    best = likelihood(found.q, found.r)
    for change in (0.9, 1.1):
        assert likelihood(change * found.q, found.r) < best
        assert likelihood(found.q, change * found.r) < best


def test_q_and_r_of_a_known_signal_are_found():
    ratios = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        values = np.cumsum(0.1 * rng.standard_normal(2000)) + rng.standard_normal(2000)
        found = choose_smoother(values, INTERVAL)
        assert not found.bounded
        ratios.append([found.q / 0.01, found.r])
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.08)


def test_white_noise_gets_the_slowest_filter_that_is_allowed():
    bounded = [choose_smoother(np.random.default_rng(s).standard_normal(1000), INTERVAL) for s in range(8)]
    assert sum(each.bounded for each in bounded) >= 4  # the likeliest Q of white noise is zero in most records
    assert max(each.time_constant for each in bounded) == pytest.approx(10.0, rel=0.01)  # a tenth of 100 s


def test_the_lag_of_a_ramp_is_that_of_the_gain():
    smoother = Smoother(4e-4 * DEG**2, 1e-2 * DEG**2, INTERVAL, False)
    answer = computed_ramp(smoother)
    assert answer.lag == pytest.approx(smoother.lag, rel=1e-6)
    assert answer.worst == pytest.approx(0.6 * DEG * smoother.lag, rel=1e-6)  # 10 r/min in 100 s
    found = drift_study(bench(mems(1), steps=True)).gyros[0]
    assert found.recorded is not None
    assert found.recorded.slope == pytest.approx(0.6 * DEG, rel=0.01)
    assert abs(found.recorded.lag - found.smoother.lag) < 0.02 * found.smoother.lag


def test_powers_of_tau_are_found_and_are_the_noises_of_the_standard():
    tau = np.array(TAUS)
    powers = np.array([3.0 * 0.2**2, 1.5**2, 0.5**2 * 2.0 * np.log(2.0) / np.pi, 0.3**2 / 3.0, 0.02**2 / 2.0])
    variance = sum(power * tau**m for m, power in zip(range(-2, 3), powers, strict=True))
    allan = AllanDeviation(tau, np.rint(tau / INTERVAL).astype(int), np.sqrt(variance)[:, None], 1000, INTERVAL)
    found = power_fit(allan, np.diag((0.1 * variance) ** 2))
    np.testing.assert_allclose([each.power for each in found.values()], powers, rtol=1e-6)
    np.testing.assert_allclose([each.value for each in found.values()], [0.2, 1.5, 0.5, 0.3, 0.02], rtol=1e-6)


def test_intervals_of_the_random_walk_hold_it():
    inside = []
    for seed in range(40):
        found = drift_study(bench(noise(np.random.default_rng(seed), 3000, INTERVAL, N=1.0 * DEG_PER_SQRT_H)))
        coefficient = found.gyros[0].corrected.coefficients["N"]
        inside.append(coefficient.low <= DEG_PER_SQRT_H <= coefficient.high)
    assert np.mean(inside) > 0.85  # 95 %, one sd 3.4 %


def test_fifty_of_a_hundred_seconds_have_one_degree_of_freedom():
    found = drift_study(bench(mems(3))).gyros[0].corrected
    assert found.allan.tau[-1] == pytest.approx(50.0)
    assert found.freedom[-1] == pytest.approx(1.0, abs=0.05)
    assert found.high[-1] / found.deviation[-1] > 10.0


def test_smoothing_lowers_short_times_and_not_the_bias_instability():
    """A bias that changes over minutes is there before and after; white noise at a tenth of a second is not."""
    n, time = 40_000, 60.0
    slow = noise(np.random.default_rng(6), n, INTERVAL, N=0.5 * DEG_PER_SQRT_H, sd=0.02 * DEG, time=time)
    stamps = INTERVAL * np.arange(1, n + 1)
    found = drift_study(DriftRecord("slow", stamps, ("x",), {"x": slow}, {}, {}, None)).gyros[0]
    assert found.smoothed.deviation[0] < 0.3 * found.corrected.deviation[0]
    smoothed = found.smoothed_rate[found.rest]
    factors = np.array([round(1.89 * time / INTERVAL)])  # where the process peaks
    before, after = (allan_deviation(x[:, None], INTERVAL, factors).deviation[0, 0] for x in (slow, smoothed))
    assert after == pytest.approx(before, rel=0.05)


def test_records_that_cannot_be_are_refused():
    record = bench()
    moving = DriftRecord("m", record.time, ("z",), record.gyro, {"z": record.rate["z"] + 1e-3}, {}, None)
    with refused(InputError, "lab.no_rest_first"):
        drift_study(moving)
    time = record.time + np.where(record.time > 50.0, 1.0, 0.0)
    with refused(InputError, "lab.gaps"):
        drift_study(DriftRecord("g", time, ("z",), record.gyro, {}, {}, None))
    with refused(InputError, "lab.times_not_increasing"):
        drift_study(DriftRecord("b", record.time[::-1], ("z",), record.gyro, {}, {}, None))
    with refused(InputError, "lab.rate_scale"):
        drift_model(DriftRecord("u", record.time, ("z",), {"z": record.gyro["z"] * DEG}, record.rate, {}, None), "z")
    with refused(InputError, "lab.constant_rate"):
        drift_study(DriftRecord("c", record.time, ("z",), {"z": np.zeros(3000)}, {}, {}, None))
    with refused(InputError, "lab.not_finite"):
        smooth(np.array([0.0, np.nan]), Smoother(1.0, 1.0, INTERVAL, False))


def test_the_correction_is_the_inverse_of_the_model_that_simulations_use():
    """One object that adds and removes: sensitivities by the axis and at 25 deg C."""
    model = drift_model(bench(), "z")
    errors = drift_errors({"z": model})
    expected = ImuErrors(
        gyro_bias=np.array([0.0, 0.0, TRUTH["A"]]),
        gyro_matrix=np.diag([1.0, 1.0, 1.0 + TRUTH["B"]]),
        gyro_terms=ErrorTerms(
            bias_slope=np.array([0.0, 0.0, TRUTH["c_T"]]), g_sensitivity=np.diag([0.0, 0.0, TRUTH["c_g"]])
        ),
    )
    np.testing.assert_allclose(errors.gyro_bias, expected.gyro_bias, rtol=1e-9)
    np.testing.assert_allclose(errors.gyro_matrix, expected.gyro_matrix, rtol=1e-9)
    assert errors.gyro_terms is not None
    assert expected.gyro_terms is not None
    np.testing.assert_allclose(errors.gyro_terms.bias_slope, expected.gyro_terms.bias_slope, rtol=1e-9)
    np.testing.assert_allclose(errors.gyro_terms.g_sensitivity, expected.gyro_terms.g_sensitivity, rtol=1e-8)


def test_the_figures_of_the_experiment_have_the_series_of_the_record():
    """Before and after on one axis over 100 s, Allan values solid and dashed at eight times, ramp, constant rate."""
    random = mems(3)
    study = drift_study(bench(random))
    rest, allan, _ = drift_panels(study)[:3]
    assert {c.name for c in rest.curves} == {"measured", "corrected", "smoothed"}
    of = {(curve.name, curve.kind): curve for curve in allan.curves}
    np.testing.assert_allclose(of["smoothed", "dashed"].x, TAUS)
    assert ("measured", "line") in of
    ramp, constant = rate_panels(study)[:2]
    record = study.record
    rate = record.rate[record.axes[0]]
    for panel, rows in ((ramp, np.arange(len(rate)) >= np.argmax(rate > 0.0)), (constant, rate == rate.max())):
        true = {curve.name: curve for curve in panel.curves}["corrected"]
        np.testing.assert_array_equal(true.x, record.time[rows])
        assert np.std(true.y - rate[rows] / DEG) < 0.3
