"""Bench data in memory: arrays, data frames and insnav's own types give what files give."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.imu import calibration_to_toml
from insnav.session.bench import acceptance, allan, bench_gravity, calibrate, drift
from insnav.types import ImuData
from tests.lab.hand import G, random_record
from tests.lab.published import lab_file

RATES = np.array([-80.0, -60.0, -40.0, -20.0, -10.0, 0.0, 10.0, 20.0, 40.0, 60.0, 80.0])


def rate_table(scale: float = 0.05) -> pd.DataFrame:
    output = 0.2 + scale * RATES + 1e-4 * np.sin(np.arange(RATES.size))
    return pd.DataFrame({"rate_deg_s": RATES, "output_v": output})


def at_rest(n: int = 20_000) -> ImuData:
    rng = np.random.default_rng(3)
    gyro, accel = 1e-3 * rng.normal(size=(n, 3)), 0.01 * rng.normal(size=(n, 3)) + [0.0, 0.0, -9.8]
    return ImuData(0.01 * np.arange(1, n + 1), gyro, accel)


def test_allan_of_a_plain_array() -> None:
    signal = 0.5 * np.random.default_rng(1).normal(size=(50_000, 2))
    signal[:, 1] = 1.0
    found = allan(signal, rate=100.0, taus=[0.1, 1.0]).found
    np.testing.assert_allclose(found.allan.tau, [0.1, 1.0])
    model = found.models[0]
    assert model is not None
    assert model.coefficients["N"].value == pytest.approx(0.05, rel=0.02)
    assert found.models[1] is None  # never changes
    one = allan(signal[:, 0], rate=100.0, taus=[0.1, 1.0]).found
    np.testing.assert_array_equal(one.allan.deviation, found.allan.deviation[:, :1])


@pytest.mark.parametrize("options", [{}, {"rate": 0.0}])
def test_an_array_needs_a_rate(options: dict) -> None:
    with pytest.raises(ConfigError, match="rate"):
        allan(np.zeros(1000), **options)


def test_allan_of_an_imu_in_memory() -> None:
    imu = at_rest()
    found = allan(imu, taus=[0.1, 1.0]).found
    again = allan((imu.gyro, imu.accel), rate=100.0, taus=[0.1, 1.0]).found
    np.testing.assert_allclose(again.allan.deviation, found.allan.deviation, rtol=1e-9)
    np.testing.assert_allclose(again.spec.gyro.random_walk, 1e-4, rtol=0.05)
    part = allan(imu, static=(10.0, 60.0)).found
    assert part.allan.length == pytest.approx(50.0, abs=0.05)


def test_a_rate_table_in_memory_is_that_of_the_file(tmp_path: Path) -> None:
    frame = rate_table()
    frame.to_csv(tmp_path / "rates.csv", index=False)
    found, read = (calibrate("gyro", each, name="bench").found for each in (frame, tmp_path / "rates.csv"))
    assert found.errors is not None
    assert found.errors.gyro_raw is not None
    assert read.errors is not None
    assert calibration_to_toml(found.errors) == calibration_to_toml(read.errors)
    assert [each.label for each in found.parameters] == ["sensor zero U0", "sensor scale factor K"]
    assert found.impact[0].corrected < found.impact[0].without
    three = calibrate("gyro", [rate_table(0.05), rate_table(0.06), rate_table(0.07)]).found
    assert three.errors is not None
    assert three.errors.gyro_raw is not None
    np.testing.assert_allclose(three.errors.gyro_raw.scale, np.degrees([0.05, 0.06, 0.07]), rtol=1e-3)


def test_the_other_triad_is_carried_over_and_leaves_the_impact(tmp_path: Path) -> None:
    accel = calibrate("accel", lab_file("accel_tumble_12.csv")).found
    assert accel.errors is not None
    (tmp_path / "accel.toml").write_text(calibration_to_toml(accel.errors))
    alone, both = (calibrate("gyro", rate_table(), add=each).found for each in (None, tmp_path / "accel.toml"))
    assert both.errors is not None
    assert both.errors.accel_raw is not None
    np.testing.assert_allclose(both.errors.accel_raw.scale, accel.errors.accel_raw.scale)
    assert both.impact == alone.impact


def test_poses_from_arrays_in_units_and_in_counts() -> None:
    rng = np.random.default_rng(5)
    ideal = random_record(rng, 14)
    noise = rng.normal(size=(2, len(ideal.time), 3))
    imu = replace(ideal, gyro=ideal.gyro + 1e-3 * noise[0], accel=ideal.accel + 0.01 * noise[1])
    found = calibrate("poses", imu, gravity=G, name="x").found
    arrays = calibrate("poses", (imu.time, imu.gyro, imu.accel), gravity=G, name="x").found
    assert found.errors is not None
    assert arrays.errors is not None
    np.testing.assert_allclose(arrays.errors.accel_matrix, found.errors.accel_matrix, atol=1e-9)
    counts = calibrate("poses", (imu.time, 1e3 * imu.gyro, 1e3 * imu.accel), gravity=G, counts=True).found
    assert counts.errors is not None
    assert counts.errors.accel_raw is not None
    np.testing.assert_allclose(counts.errors.accel_raw.scale, 1e3 * np.diag(found.detail.accel.matrix), rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "error", "word"),
    [
        (lambda: calibrate("table", rate_table()), ConfigError, "lab.no_method"),
        (lambda: calibrate("poses", ["a.csv", "b.csv"]), ConfigError, "lab.one_file"),
        (lambda: calibrate("gyro", rate_table(), spike_limit=-1.0), ConfigError, "lab.spike_limit"),
        (lambda: calibrate("gyro", rate_table(), gravity=981.0), ConfigError, "lab.gravity"),
        (lambda: calibrate("gyro", [rate_table()] * 2), InputError, "lab.not_three_sensors"),
        (lambda: calibrate("gyro", "none.csv"), InputError, "none.csv"),
        (lambda: acceptance(), ConfigError, "session.nothing_to_accept"),
        (lambda: bench_gravity(None, None), ConfigError, "session.no_gravity"),
        (lambda: bench_gravity(9.8, 45.0), ConfigError, "session.gravity_twice"),
        (lambda: bench_gravity(None, 91.0), ConfigError, "session.bad_latitude"),
    ],
)
def test_what_cannot_be_is_refused(call, error: type[Exception], word: str) -> None:
    with pytest.raises(error) as caught:
        call()
    assert word in str(caught.value)


def test_normal_gravity() -> None:
    gravity, source = bench_gravity(None, 45.0, 0.0)
    somigliana = 9.7803253359 * (1.0 + 0.00193185265241 * 0.5) / np.sqrt(1.0 - 0.00669437999013 * 0.5)  # WGS-84
    assert gravity == pytest.approx(somigliana, abs=1e-7)
    assert "45 deg" in source


def test_acceptance_and_drift_of_data_in_memory() -> None:
    biases = pd.DataFrame({"powerup": np.arange(5.0), "gyro_x_bias_deg_s": [0.1, 0.12, 0.11, 0.09, 0.1]})
    found = acceptance(powerups=[biases]).found
    assert [each.name for each in found.files] == ["data in memory"]
    assert found.sensors[0].repeatability is not None
    assert np.degrees(found.sensors[0].repeatability.sd) == pytest.approx(np.std(biases.iloc[:, 1], ddof=1))
    time = 0.1 * np.arange(3000)
    rng = np.random.default_rng(7)
    frame = pd.DataFrame({"time_s": time, "gyro_x_deg_s": 0.1 + 0.01 * rng.normal(size=time.size)})
    study = drift(frame).found
    assert study.gyros[0].model.value["A"] == pytest.approx(np.radians(0.1), rel=0.02)
    assert study.file is not None
    assert study.file.name == "data in memory"
