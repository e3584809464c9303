"""Sinusoidal noise: its Allan variance, what is found of it, and nothing where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.findings import Code, of_code
from insnav.lab.noise.allan import Sinusoid, allan_deviation, find_sinusoids
from insnav.lab.noise.static_noise import signal_noise, static_noise
from insnav.session.bench import allan
from insnav.types import ImuData
from tests.lab.signals import at_rest, noise

N, STEP = 20_000, 0.1


def line(frequency, amplitude, n=N, step=STEP, phase=0.7):
    return amplitude * np.sin(2.0 * np.pi * frequency * step * np.arange(n) + phase)


@pytest.mark.parametrize("frequency", [0.0137, 0.31, 4.3])
def test_the_allan_variance_of_a_line_is_that_of_its_samples(frequency):
    factors = np.array([1, 2, 3, 5, 8, 13, 40, 100, 300])
    measured = allan_deviation(line(frequency, 2.0, 200_000)[:, None], STEP, factors, 1)
    formula = Sinusoid(frequency, 0.0, 2.0, 0.0, 0.0).variance(measured.tau, STEP)
    np.testing.assert_allclose(measured.deviation[:, 0] ** 2, formula, rtol=2e-3, atol=1e-3 * formula.max())
    x = np.pi * frequency * measured.tau
    if frequency * STEP < 0.01:  # IEEE Std 952-1997: means of a continuous signal
        np.testing.assert_allclose(formula, 4.0 * (np.sin(x) ** 2 / x) ** 2, rtol=1e-4)


def test_lines_are_found_as_sure_as_they_say_wherever_they_are():
    off = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        frequency = float(np.exp(rng.uniform(np.log(0.05), np.log(4.7))))
        signal = noise(rng, N, STEP, N=1.0, K=0.02) + line(frequency, 0.5, phase=rng.uniform(0.0, 6.0))
        (found,) = find_sinusoids(signal, STEP)
        off.append([(found.amplitude - 0.5) / found.amplitude_sd, (found.frequency - frequency) / found.frequency_sd])
    np.testing.assert_array_less(np.abs(np.mean(off, axis=0)), 3.0 / np.sqrt(60.0))
    np.testing.assert_allclose(np.std(off, axis=0), 1.0, atol=3.0 / np.sqrt(120.0))


@pytest.mark.parametrize(
    "kinds",
    [
        {"N": 1.0},
        {"N": 1.0, "K": 0.1},
        {"K": 1.0},
        {"Q": 1.0},
        {"N": 1.0, "sd": 0.5, "time": 10.0},
        {"N": 1.0, "R": 3e-4},
    ],
    ids=lambda kinds: "+".join(kinds),
)
def test_records_without_a_line_show_none(kinds):
    for seed in range(20):
        signal = noise(np.random.default_rng(seed), N if seed % 2 else 3000, STEP, **kinds)
        assert find_sinusoids(signal, STEP) == ()


def test_vibration_that_changes_its_frequency_is_no_line():
    time = STEP * np.arange(N)
    white = noise(np.random.default_rng(1), N, STEP, N=1.0)
    assert find_sinusoids(white + np.sin(2.0 * np.pi * (1.0 + 2e-5 * time) * time), STEP) == ()


def test_two_lines_one_a_thousand_times_the_other():
    signal = 1e-3 * noise(np.random.default_rng(2), N, STEP, N=1.0) + line(1.7, 20.0) + line(0.3, 0.02)
    first, second = find_sinusoids(signal, STEP)
    assert first.amplitude == pytest.approx(20.0, rel=1e-4)
    assert second.frequency == pytest.approx(0.3, abs=4.0 * second.frequency_sd)
    assert second.amplitude == pytest.approx(0.02, abs=4.0 * second.amplitude_sd)


def test_other_coefficients_are_those_of_the_record_without_the_line():
    for seed in range(5):
        clean = noise(np.random.default_rng(seed), N, STEP, Q=0.3, N=1.0, K=0.1)
        before = signal_noise(clean[:, None], STEP)
        after = signal_noise((clean + line(0.8, 3.0))[:, None], STEP)
        still, shaken = before.models[0], after.models[0]
        assert still is not None
        assert shaken is not None
        assert [round(each.frequency, 3) for each in shaken.sinusoids] == [0.8]
        assert set(shaken.coefficients) == set(still.coefficients)
        assert shaken.misfit == 0.0
        for name, each in still.coefficients.items():
            assert shaken.coefficients[name].value == pytest.approx(each.value, abs=0.3 * each.sd)
        # and the model has the bump, within its intervals
        inside = (after.allan.deviation[:, 0] ** 2 / shaken.variance)[after.allan.tau < 5.0]
        np.testing.assert_allclose(inside, 1.0, atol=0.15)


def test_a_line_that_the_allan_deviation_does_not_show_changes_nothing():
    signal = noise(np.random.default_rng(3), 100_000, STEP, N=1.0)
    weak = line(4.0, 0.1, 100_000)
    assert len(find_sinusoids(signal + weak, STEP)) == 1
    model = signal_noise((signal + weak)[:, None], STEP).models[0]
    assert model is not None
    assert model.sinusoids == ()


def test_the_report_names_it_and_the_imu_file_is_without_it():
    rest = at_rest(30_000, 0.01)
    rng = np.random.default_rng(4)
    gyro = np.column_stack([noise(rng, 30_000, 0.01, N=1e-3) for _ in range(3)])
    accel = rest.accel + np.column_stack([noise(rng, 30_000, 0.01, N=1e-2) for _ in range(3)])
    quiet = static_noise(ImuData(rest.time, gyro, accel))
    shaken = gyro + line(25.0, 4e-3, 30_000, 0.01)[:, None] * [0.0, 1.0, 0.0]
    result = allan(ImuData(rest.time, shaken, accel))
    found = result.found
    (sinusoid,) = of_code(found.warnings, Code.ALLAN_SINUSOID)
    assert sinusoid.subject == "gyro y"
    assert sinusoid["amplitude_rad_s"] == (pytest.approx(4e-3, rel=0.02),)
    assert sinusoid["frequency_hz"] == (pytest.approx(25.0, abs=1e-3),)
    np.testing.assert_allclose(found.spec.gyro.random_walk, quiet.spec.gyro.random_walk, rtol=1e-3)
    table = next(section for section in result.page().sections if section.title == "Noise coefficients of the gyros")
    rows = {row[0].value: row for row in table.rows}
    items = {item.key: item for item in rows["y"]}
    assert items["sinusoid_1"].value == pytest.approx(4e-3, abs=3.0 * items["sinusoid_1"].sd)
    assert items["sinusoid_1_frequency"].value == pytest.approx(25.0, abs=1e-3)
    assert not any(item.key.startswith("sinusoid") for item in rows["x"])
