"""White noise is found under vibration, and the preset chosen from it is not too good."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest

import insnav
from insnav.exceptions import InputError
from insnav.imu import identify, load_imu, nearest_preset, white_noise
from insnav.imu.noise_density import SLOW, mean_rate, rounding_changes, rounding_variance
from insnav.types import ImuData, Sampling
from tests.refusals import refused

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
ARW = np.radians(0.24) / 60.0  # [rad/sqrt(s)]
VRW = 0.06 / 60.0  # [m/s/sqrt(s)]
EARTH = 7.292115e-5  # [rad/s]


def still(seconds: float, rate: float, sampling: Sampling = "mean", seed: int = 1) -> ImuData:
    """White noise of density N has the standard deviation N sqrt(rate) in samples that are interval means."""
    rng = np.random.default_rng(seed)
    time = 1000.0 + np.arange(int(seconds * rate)) / rate
    scale = np.sqrt(rate) / (rate if sampling == "increment" else 1.0)
    gyro = 0.01 + ARW * scale * rng.standard_normal((time.size, 3))
    accel = np.array([0.1, 0.2, -9.8]) + VRW * scale * rng.standard_normal((time.size, 3))
    return ImuData(time, gyro, accel, sampling)


@pytest.mark.parametrize("rate", [10.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize("sampling", ["mean", "increment"])
def test_density_of_white_noise_is_found_at_any_rate(rate: float, sampling: Sampling) -> None:
    gyro, accel = white_noise(still(300.0, rate, sampling), 1000.0, 1300.0)
    np.testing.assert_allclose(gyro, ARW, rtol=0.06)
    np.testing.assert_allclose(accel, VRW, rtol=0.06)


@pytest.mark.parametrize(("seconds", "spread"), [(4.0, 0.25), (8.0, 0.15), (20.0, 0.07)])
def test_a_short_record_is_unbiased(seconds: float, spread: float) -> None:
    found = [white_noise(still(seconds, 100.0, seed=seed), 1000.0, 1100.0)[0] for seed in range(60)]
    # undivided by the quantile of chi-square they would be 24, 15 and 8 % low
    assert np.mean(found) / ARW == pytest.approx(1.0, abs=0.03)
    assert np.std(found) / ARW < spread


def test_rocking_and_an_idling_engine_are_not_noise() -> None:
    imu = still(60.0, 100.0)
    t = imu.time[:, None]
    rocking = np.radians(0.3) * np.sin(2 * np.pi * 1.3 * t + [0.0, 1.0, 2.0])
    engine = np.radians(2.0) * np.sin(2 * np.pi * 28.3 * t) + np.radians(0.1) * np.sin(2 * np.pi * 7.07 * t)
    drift = 1e-4 * (t - 1000.0)
    shaken = ImuData(imu.time, imu.gyro + rocking + engine + drift, imu.accel)
    assert np.min(np.std(shaken.gyro, axis=0)) > 10 * ARW * np.sqrt(100.0)
    np.testing.assert_allclose(white_noise(shaken, 1000.0, 1060.0)[0], ARW, rtol=0.15)


def test_what_shakes_to_and_fro_at_all_higher_frequencies_is_none_of_the_slow_noise() -> None:
    """Angles that an engine shakes, white from 0.7 to 10 Hz: ten times the noise there, none below."""
    found = []
    for seed in range(20):
        imu = still(60.0, 100.0, seed=seed)
        frequency = np.fft.rfftfreq(imu.time.size, 0.01)
        spectrum = np.fft.rfft(np.random.default_rng(seed + 99).standard_normal((imu.time.size, 3)), axis=0)
        spectrum[(frequency < 0.7) | (frequency > 10.0)] = 0.0
        shaken = ImuData(imu.time, imu.gyro + 10.0 * ARW * 10.0 * np.fft.irfft(spectrum, axis=0), imu.accel)
        assert white_noise(shaken, 1000.0, 1060.0)[0].min() > 5.0 * ARW
        found.append(white_noise(shaken, 1000.0, 1060.0, SLOW)[0] / ARW)
    assert np.mean(found) == pytest.approx(1.0, abs=0.1)
    assert np.std(found) < 0.3


def test_only_the_stretch_counts() -> None:
    imu = still(60.0, 100.0)
    imu.gyro[4000:] += np.random.default_rng(2).standard_normal((2000, 3))
    np.testing.assert_allclose(white_noise(imu, 1000.0, 1039.0)[0], ARW, rtol=0.15)
    assert np.min(white_noise(imu, 1040.0, 1060.0)[0]) > 100 * ARW


@pytest.mark.parametrize(("start", "end"), [(0.0, 60.0), (1060.0, 1100.0)])
def test_a_stretch_outside_the_record_is_refused(start: float, end: float) -> None:
    with refused(InputError, "imu.static_outside"):
        white_noise(still(60.0, 100.0), start, end)


@pytest.mark.parametrize(("end", "rate"), [(1002.0, 100.0), (1060.0, 2.0), (900.0, 100.0), (1000.0, 100.0)])
def test_too_short_or_too_slow_a_stretch_is_refused(end: float, rate: float) -> None:
    with refused(InputError, "imu.static_too_short"):
        white_noise(still(60.0, rate), 1000.0, end)


@pytest.mark.parametrize("name", ["consumer", "industrial", "navigation"])
def test_a_preset_finds_itself(name: str) -> None:
    spec = load_imu(name)
    found, sentence = nearest_preset(spec.gyro.random_walk, spec.accel.random_walk)
    assert found.name == name
    assert name in sentence
    np.testing.assert_array_equal(found.gyro.random_walk, spec.gyro.random_walk)


def test_neighbours_that_noise_cannot_tell_apart_give_the_least_accurate() -> None:
    tactical = load_imu("tactical")
    assert nearest_preset(tactical.gyro.random_walk, tactical.accel.random_walk)[0].name == "industrial"


def test_noise_is_raised_to_the_measured_and_never_lowered() -> None:
    spec = load_imu("consumer")
    gyro = spec.gyro.random_walk * np.array([0.9, 1.0, 5.0])
    accel = spec.accel.random_walk * np.array([0.9, 2.0, 1.0])
    found, _ = nearest_preset(gyro, accel)
    np.testing.assert_allclose(found.gyro.random_walk / spec.gyro.random_walk, [1.0, 1.0, 5.0])
    np.testing.assert_allclose(found.accel.random_walk / spec.accel.random_walk, [1.0, 2.0, 1.0])
    np.testing.assert_array_equal(found.accel.bias, spec.accel.bias)


def test_a_shaken_vehicle_does_not_hide_good_gyros() -> None:
    fog = np.full(3, np.radians(0.03) / 60.0)
    assert nearest_preset(fog, np.full(3, 100 * VRW), np.array([EARTH, 0.0, 0.0]))[0].name == "tactical"


def test_gyros_that_show_the_earth_rate_are_better_than_their_noise_says() -> None:
    noise = np.full(3, ARW)
    accel = np.full(3, VRW)
    assert nearest_preset(noise, accel, np.array([0.6, 0.0, -0.8]) * EARTH * 1.02)[0].name == "tactical"
    assert nearest_preset(noise, accel, np.array([0.6, 0.0, -0.8]) * EARTH * 1.2)[0].name == "consumer"


def test_gyro_bias_is_not_less_than_the_mean_rate_shows() -> None:
    spec = load_imu("navigation")
    rate = np.array([0.0, 0.0, 1.05 * EARTH])
    found, sentence = nearest_preset(spec.gyro.random_walk, spec.accel.random_walk, rate)
    np.testing.assert_allclose(found.gyro.bias, 0.05 * EARTH)
    assert "gyro bias of 0.75 deg/h" in sentence  # 5 % of 15.04 deg/h


def test_noise_free_data_are_no_error() -> None:
    time = np.arange(1000) / 100.0
    spec, _ = identify(ImuData(time, np.zeros((1000, 3)), np.zeros((1000, 3))), 0.0, 10.0)
    assert spec.name == "navigation"
    assert np.all(spec.gyro.random_walk > 0.0)


def test_the_mean_rate_of_increments_is_a_rate() -> None:
    rate = 100.0
    imu = still(60.0, rate, "increment")
    turning = ImuData(imu.time, imu.gyro - imu.gyro.mean(axis=0) + 0.02 / rate, imu.accel, "increment")
    spec, _ = identify(turning, 1000.0, 1060.0)
    np.testing.assert_allclose(spec.gyro.bias, 0.02 * np.sqrt(3.0), rtol=0.01)


def recorded(name: str) -> ImuData:
    path = SHARED / name / "imu.csv.gz"
    if not path.exists():
        pytest.skip(f"recorded data {name} are not beside the project (../shared/data)")
    table = pyarrow.csv.read_csv(path)
    columns = {key: table[key].to_numpy() for key in table.column_names}
    gyro, accel = (np.column_stack([columns[f"{key}_{axis}"] for axis in "xyz"]) for key in ("gyro", "accel"))
    return ImuData(columns["time"] - columns["time"][0], gyro, accel)


def test_recorded_bench_imu_has_its_known_noise() -> None:
    # 2.4 deg/sqrt(h) from the overlapping Allan deviation at 1 s: 147, 155, 139 deg/h
    gyro, _ = white_noise(recorded("static_adis16405_2h46"), 0.0, 10_000.0)
    np.testing.assert_allclose(np.degrees(gyro) * 60.0, [2.45, 2.58, 2.32], rtol=0.05)


def test_recorded_cars_are_consumer_grade() -> None:
    for name, end in (("rtklib_drive_20250708", 18.0), ("ixr_tsukishima_20210412", 60.0)):
        spec, _ = identify(recorded(name), 0.0, end)
        assert spec.name == "consumer"
        quietest = np.degrees(spec.gyro.random_walk.min()) * 60.0
        assert 0.2 < quietest < 0.4  # deg/sqrt(h)


def test_recorded_ring_lasers_show_the_earth_rate() -> None:
    spec, sentence = identify(recorded("psins_rlg_static"), 0.0, 1800.0)
    assert spec.name == "tactical"
    assert "Earth's rate" in sentence


@pytest.mark.parametrize("sampling", ["mean", "increment"])
def test_a_coarse_sensor_that_reads_a_constant_at_rest_has_the_noise_of_its_steps(sampling: Sampling) -> None:
    """Against the rounding errors themselves, of a car that turns after a rest."""
    step, rate, rng = 0.01, 100.0, np.random.default_rng(3)
    turns = np.cumsum(rng.standard_normal((6000, 3)), axis=0) * 0.002
    gyro = np.vstack([np.full((4000, 3), 1e-3), turns]) + 1e-4 * rng.standard_normal((10000, 3))
    read = np.round(gyro / step) * step
    error = (read - gyro)[4000:]
    found = white_noise(
        ImuData(
            (1.0 + np.arange(10000)) / rate,
            read / rate if sampling == "increment" else read,
            9.8 + 0.01 * rng.standard_normal((10000, 3)) / (rate if sampling == "increment" else 1.0),
            sampling,
        ),
        1.0,
        39.0,
    )[0]
    np.testing.assert_allclose(found, error.std(axis=0) / np.sqrt(rate), rtol=0.1)


def test_coarse_gyros_do_not_pass_for_those_of_an_aircraft() -> None:
    """Gyros in steps of 0.01 rad/s were taken for navigation grade: the drive was 7 m off with 86 m stated."""
    made = insnav.simulate("city", imu="automotive", seed=61)
    imu, rms, sd = made.imu.data, [], []
    dither = np.random.default_rng(1).uniform(-0.5, 0.5, imu.gyro.shape)
    for gyro in (imu.gyro / 0.01 + dither, imu.gyro / 0.01):
        drive = insnav.load(replace(imu, gyro=np.round(gyro) * 0.01), made.gps.data, made.reference.data)
        assert drive.imu_spec.name.startswith("consumer")
        found = drive.navigate().found
        rms.append(np.sqrt(np.mean(found.smoothed_errors.horizontal**2)))
        sd.append(np.sqrt(np.mean(found.run.smoothed.solution.sd[:, :2] ** 2)))
    assert rms[1] < 1.5 * rms[0]
    assert sd[1] < 1.5 * sd[0]


def test_a_coarse_gyro_has_the_variance_of_its_rounding_error_as_bias() -> None:
    """By Monte Carlo: mean errors of rounded constant rates, with little noise and with that of motion."""
    step, random, rates = 0.01, np.random.default_rng(3), 4000
    rate = random.uniform(-0.05, 0.05, rates)
    found = []
    for noise in (0.01 * step, 0.1 * step, step):
        samples = np.round((rate + noise * random.standard_normal((100, rates))) / step) * step
        found.append((np.mean((samples.mean(axis=0) - rate) ** 2), np.mean(rounding_variance(samples, np.array(step)))))
    np.testing.assert_allclose(*found[0], rtol=0.1)
    assert 1.0 < found[1][1] / found[1][0] < 2.0  # the noise is unknown: from none to a third of a step
    assert found[2][1] == 0.0
    gyro = 0.0032 + step * random.standard_normal((4000, 3))
    gyro[:2000] = 0.0032 + 0.01 * step * random.standard_normal((2000, 3))
    accel = [0.0, 0.0, -9.8] + 0.01 * random.standard_normal((4000, 3))
    (change,) = rounding_changes(ImuData(0.01 * np.arange(4000), np.round(gyro / step) * step, accel))
    assert change.time == pytest.approx(20.0, abs=1.0)
    np.testing.assert_allclose(change.before, step**2 / 12.0, rtol=0.06)
    np.testing.assert_array_equal(change.after, 0.0)


def test_a_coarse_gyro_cannot_show_the_earth_rate() -> None:
    """A car at rest had by chance a mean rate near the Earth's, and passed for tactical: outages were 21 m off."""
    random, step = np.random.default_rng(4), 0.01
    gyro = step * np.round(random.standard_normal((9000, 3)))
    gyro[:6000] = 0.0
    gyro[: 6000 : round(np.sqrt(3.0) * step / EARTH)] = step
    imu = ImuData(0.01 * np.arange(9000), gyro, [0.0, 0.0, -9.8] + 0.01 * random.standard_normal((9000, 3)))
    rate, rounded = mean_rate(imu, 0.0, 59.0)
    assert np.linalg.norm(rate) == pytest.approx(EARTH, rel=0.1)
    np.testing.assert_allclose(rounded, step / np.sqrt(12.0), rtol=0.03)
    spec, _ = identify(imu, 0.0, 59.0)
    assert spec.name == "consumer"


def test_fine_gyros_have_no_changes_by_rounding() -> None:
    assert rounding_changes(still(60.0, 100.0)) == ()
