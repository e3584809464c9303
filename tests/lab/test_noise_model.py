"""Noise coefficients: found as put in, as sure as they say, and only those that are there."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.findings import Code, of_code
from insnav.imu import ImuSpec, SensorSpec, load_imu, to_toml
from insnav.input import read_imu
from insnav.lab.noise.allan import AXES, NAMES, allan_deviation, averaging_factors, basis, fit_noise
from insnav.lab.noise.static_noise import PEAK, PEAK_TIME, static_noise, temperature_correlation
from insnav.simulate.sensor_errors import corrupt_imu
from insnav.types import ImuData
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, UG
from tests.lab.signals import at_rest, noise
from tests.shared import recorded


def fitted(values, interval):
    return fit_noise(allan_deviation(values[:, None], interval, averaging_factors(len(values), interval), 1))


def test_gauss_markov_peaks_where_the_standard_says():
    tau = np.geomspace(0.01, 100.0, 20001)
    curve = np.sqrt(basis(tau, 1.0)[:, NAMES.index("GM")])
    assert tau[np.argmax(curve)] == pytest.approx(PEAK_TIME, rel=1e-3)
    assert curve.max() == pytest.approx(PEAK, rel=1e-4)
    assert curve.max() == pytest.approx(0.437 * np.sqrt(2.0), rel=2e-3)  # in the standard's q sqrt(T)


@pytest.mark.parametrize(
    "truth",
    [
        {"N": 1.0},
        {"N": 1.0, "Q": 0.3},
        {"N": 1.0, "K": 0.1},
        {"N": 1.0, "sd": 0.5, "time": 10.0},
    ],
    ids=lambda truth: "+".join(truth),
)
def test_what_was_put_in_is_found_and_nothing_else(truth):
    found = fitted(noise(np.random.default_rng(11), 100_000, 0.1, **truth), 0.1)
    expected = {"GM" if name == "sd" else name: value for name, value in truth.items() if name != "time"}
    assert set(found.coefficients) == set(expected)
    for name, value in expected.items():
        each = found.coefficients[name]
        assert abs(each.value - value) < 3.5 * each.sd
    if "time" in truth:
        assert abs(found.correlation_time - truth["time"]) < 3.5 * found.correlation_time_sd


def test_a_ramp_is_found_beside_the_white_noise():
    for seed in range(4):
        truth = {"N": 1.0, "R": 3e-4}
        found = fitted(noise(np.random.default_rng(seed), 100_000, 0.1, **truth), 0.1).coefficients
        for name, value in truth.items():
            assert abs(found[name].value - value) < 3.5 * found[name].sd


def test_intervals_of_coefficients_hold_the_truth_and_false_terms_are_rare():
    truth = {"Q": 0.3, "N": 1.0, "K": 0.1}
    inside, false = [], 0
    for seed in range(20):
        found = fitted(noise(np.random.default_rng(seed), 20_000, 0.1, **truth), 0.1).coefficients
        inside += [found[name].low <= truth[name] <= found[name].high for name in truth if name in found]
        false += len(set(found) - set(truth))
    assert len(inside) >= 58  # of 60
    assert np.mean(inside) > 0.87  # 95 %, one standard deviation is 3 %
    assert false <= 2


def test_correlated_weights_do_better_than_plain_least_squares_of_logarithms():
    """The same points, each as good as any other: four times the scatter of the random walk and more."""
    ours, plain = [], []
    for seed in range(10):
        signal = noise(np.random.default_rng(seed), 20_000, 0.1, N=1.0, K=0.1)
        allan = allan_deviation(signal[:, None], 0.1, averaging_factors(20_000, 0.1), 1)
        ours.append(fit_noise(allan).coefficients["N"].value)
        columns = basis(allan.tau, 1.0)[:, [1, 3]]
        weights = 1.0 / allan.deviation[:, :1] ** 2
        squares = np.linalg.lstsq(columns * weights, np.ones(allan.tau.size), rcond=None)[0]
        plain.append(np.sqrt(abs(squares[0])))
    assert np.std(plain) > 3.0 * np.std(ours)
    assert np.mean(ours) == pytest.approx(1.0, abs=0.005)


def test_datasheet_to_simulated_record_to_the_same_figures(tmp_path):
    """Every noise that simulations know comes back within 5 %, through the file.

    Each axis of the accelerometers has a noise of its own beside the white one, so that none hides another.
    """
    n, interval = 1_000_000, 0.1
    gyro = SensorSpec(
        bias_instability=np.full(3, 30.0 * DEG_PER_H),
        correlation_time=20.0,
        random_walk=np.array([0.3, 0.4, 0.5]) * DEG_PER_SQRT_H,
        quantisation=np.full(3, 4.0 * DEG / 3600.0),
    )
    walk = 12.0 * UG
    accel = SensorSpec(
        random_walk=np.full(3, 0.05 * M_S_PER_SQRT_H),
        rate_random_walk=np.array([walk, 0.0, 0.0]),
        flicker=np.array([0.0, 80.0 * UG, 0.0]),
        rate_ramp=np.array([0.0, 0.0, 500.0 * UG / 3600.0]),
    )
    simulated = corrupt_imu(at_rest(n, interval), ImuSpec("datasheet", gyro, accel), 5)
    noises = static_noise(simulated.imu)
    (tmp_path / "imu.toml").write_text(to_toml(noises.spec), encoding="utf-8")
    found = load_imu(str(tmp_path / "imu.toml"))
    np.testing.assert_allclose(found.gyro.random_walk, gyro.random_walk, rtol=0.05)
    np.testing.assert_allclose(found.gyro.quantisation, gyro.quantisation, rtol=0.05)
    np.testing.assert_allclose(found.gyro.bias_instability.mean(), gyro.bias_instability[0], rtol=0.05)
    np.testing.assert_allclose(found.gyro.correlation_time, 20.0, rtol=0.15)  # as sure as the record makes it
    np.testing.assert_allclose(found.accel.random_walk, accel.random_walk, rtol=0.05)
    np.testing.assert_allclose(found.accel.rate_random_walk[0], walk, rtol=0.05)
    flicker = noises.models[4]
    assert flicker is not None
    np.testing.assert_allclose(flicker.coefficients["B"].value, accel.flicker[1], rtol=0.05)
    # the slope is drawn: the one of this specimen is meant
    slope = np.abs(simulated.accel_bias[-1, 2] - simulated.accel_bias[0, 2]) / (interval * (n - 1))
    np.testing.assert_allclose(found.accel.rate_ramp[2], slope, rtol=0.05)
    for zero in (found.gyro.rate_random_walk, found.gyro.rate_ramp, found.accel.rate_ramp[:2]):
        assert not np.any(zero)


def test_the_file_is_read_back_and_leaves_out_what_was_not_seen(tmp_path):
    rest = at_rest(30_000, 0.1)
    rng = np.random.default_rng(8)
    gyro = np.column_stack([noise(rng, 30_000, 0.1, N=1e-4, K=1e-5) for _ in range(3)])
    found = static_noise(ImuData(rest.time, gyro, rest.accel), name="unit 7")
    (tmp_path / "imu.toml").write_text(to_toml(found.spec), encoding="utf-8")
    again = load_imu(str(tmp_path / "imu.toml"))
    np.testing.assert_allclose(again.gyro.random_walk, found.spec.gyro.random_walk, rtol=1e-12)
    np.testing.assert_allclose(again.gyro.rate_random_walk, found.spec.gyro.rate_random_walk, rtol=1e-12)
    for key in ("gyro.bias", "gyro.scale_factor", "gyro.misalignment", "accel.bias", "accel.random_walk"):
        assert key in again.absent
    (silent,) = of_code(found.warnings, Code.ALLAN_SILENT)
    assert silent.subject == "accel x, accel y, accel z"
    assert Code.ALLAN_UNSEEN in {each.code for each in found.notes}


def test_a_record_too_short_for_its_floor_gives_a_bound_and_says_so():
    rest = at_rest(20_000, 0.01)
    rng = np.random.default_rng(9)
    gyro = 1e-3 * rng.standard_normal((20_000, 3))
    found = static_noise(ImuData(rest.time, gyro, rest.accel + gyro))
    assert "gyro x" in next(of_code(found.warnings, Code.ALLAN_SHORT)).subject
    bound = next(of_code(found.notes, Code.ALLAN_BIAS_BOUND))
    floor = found.floors[0]
    assert floor is not None
    assert not floor.reached
    assert (bound.subject, bound["tau_s"]) == ("gyro x", pytest.approx(floor.tau))
    assert found.spec.gyro.bias_instability[0] == pytest.approx(floor.value / PEAK)


def test_steps_temperature_and_ramps_are_pointed_out():
    n = 40_000
    rest = at_rest(n, 0.1)
    rng = np.random.default_rng(10)
    temperature = 20.0 + 5.0 * np.arange(n) / n
    gyro = np.column_stack([noise(rng, n, 0.1, N=1e-4) for _ in range(3)])
    gyro[:, 0] += 1e-4 * temperature
    accel = rest.accel + np.round(rng.standard_normal((n, 3)) * 0.01 / 0.02) * 0.02
    warnings = static_noise(ImuData(rest.time, gyro, accel, temperature=temperature)).warnings
    found = {each.code: each for each in warnings}
    assert len(found) == len(warnings)
    assert found[Code.BENCH_TEMPERATURE]["change_k"] == pytest.approx(5.0, abs=1e-3)
    follows = found[Code.ALLAN_TEMPERATURE]
    assert (follows.subject, follows["correlation"]) == ("gyro x", (pytest.approx(1.0, abs=5e-3),))
    coarse = found[Code.ALLAN_COARSE]
    assert coarse.subject == "accel x, accel y, accel z"
    np.testing.assert_allclose(coarse["random_walk_m_s_sqrt_s"], 0.02 * np.sqrt(0.1 / 12.0), rtol=1e-6)
    assert found[Code.ALLAN_RAMP].subject == "gyro x"


def test_vibration_of_a_changing_frequency_is_pointed_out_and_widens_the_intervals():
    n = 100_000
    rest = at_rest(n, 0.01)
    rng = np.random.default_rng(12)
    gyro = np.column_stack([noise(rng, n, 0.01, N=1e-3) for _ in range(3)])
    gyro[:, 1] += 4e-3 * np.sin(2.0 * np.pi * (1.2 + 0.1 * rest.time / rest.time[-1]) * rest.time)
    found = static_noise(ImuData(rest.time, gyro, rest.accel))
    (misfit,) = of_code(found.warnings, Code.ALLAN_MISFIT)
    assert misfit.subject == "gyro y"
    assert misfit["share"][0] > misfit["limit_share"]
    still, shaken = found.models[0], found.models[1]
    assert still is not None
    assert shaken is not None
    assert shaken.coefficients["N"].sd > 3.0 * still.coefficients["N"].sd


def test_rounding_makes_the_white_noise_it_is_said_to_make():
    rng = np.random.default_rng(13)
    rounded = np.round(rng.uniform(-50.0, 50.0, 100_000))  # uniform over many steps: what is lost is independent
    lost = rounded - np.random.default_rng(13).uniform(-50.0, 50.0, 100_000)
    found = allan_deviation(lost[:, None], 0.04, np.array([1]))
    assert found.deviation[0, 0] * np.sqrt(0.04) == pytest.approx(np.sqrt(0.04 / 12.0), rel=0.01)


def test_correlation_with_a_constant_is_zero():
    assert temperature_correlation(np.ones((600, 2)), np.arange(600.0)).tolist() == [0.0, 0.0]


def test_recorded_adis16405_has_the_noise_it_is_known_for():
    """The README's own table of deviations; 2.4 deg/sqrt(h); floors of 26 to 30 deg/h at 100 s."""
    imu = read_imu(recorded("static_adis16405_2h46") / "imu.csv.gz").data
    found = static_noise(imu, (0.1, 1.0, 10.0, 100.0, 1000.0))
    table = np.array([[451, 147, 48, 26, 19], [475, 155, 54, 30, 45], [430, 139, 46, 29, 61]]).T
    print(found.allan.deviation[:, :3] / DEG_PER_H)
    np.testing.assert_allclose(found.allan.deviation[:, :3] / DEG_PER_H, table, rtol=0.05)
    print(found.spec.gyro.random_walk / DEG_PER_SQRT_H)
    np.testing.assert_allclose(found.spec.gyro.random_walk / DEG_PER_SQRT_H, 2.4, rtol=0.15)
    floors = [floor.value / DEG_PER_H for floor in found.floors[1:3] if floor is not None]
    np.testing.assert_allclose(floors, [30.0, 29.0], rtol=0.15)
    for axis in range(3):  # one step is 0.05 deg/s
        steps = np.diff(np.unique(imu.gyro[:, axis]))
        assert steps.min() == pytest.approx(0.05 * DEG, rel=0.01), AXES[axis]
