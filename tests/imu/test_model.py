"""The error model adds and removes exactly the same errors, whatever the sampling."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from insnav import spill
from insnav.exceptions import ConfigError, InputError
from insnav.imu import (
    ErrorTerms,
    ImuErrors,
    ImuSpec,
    SensorSpec,
    correct,
    corrupt,
    load_imu,
    sample_errors,
    sample_intervals,
)
from insnav.types import ImuData, Sampling
from tests.refusals import refused

TIME = np.array([0.0, 0.010, 0.021, 0.030, 0.041])  # real logs jitter


def errors() -> ImuErrors:
    return ImuErrors(
        gyro_bias=np.array([0.01, -0.02, 0.03]),
        gyro_matrix=np.array([[1.01, 0.02, 0.0], [0.0, 0.99, -0.03], [0.001, 0.0, 1.005]]),
        accel_bias=np.array([0.1, 0.2, -0.3]),
        accel_matrix=np.array([[0.98, 0.0, 0.01], [0.02, 1.02, 0.0], [0.0, -0.01, 1.0]]),
    )


def samples(sampling: Sampling) -> ImuData:
    rng = np.random.default_rng(5)
    return ImuData(TIME, rng.normal(size=(5, 3)), 9.8 * rng.normal(size=(5, 3)), sampling, temperature=np.full(5, 21.0))


@pytest.mark.parametrize("sampling", ["mean", "instant", "increment"])
def test_correct_and_corrupt_are_exact_inverses(sampling: Sampling) -> None:
    imu = samples(sampling)
    for there, back in ((corrupt, correct), (correct, corrupt)):
        result = back(there(imu, errors()), errors())
        np.testing.assert_allclose(result.gyro, imu.gyro, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(result.accel, imu.accel, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("positions", [np.zeros((3, 3)), np.full((3, 3), 0.01)], ids=["points", "sized"])
@pytest.mark.parametrize("sampling", ["mean", "increment"])
def test_blocks_are_corrected_as_the_whole(
    sampling: Sampling, positions: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(0.008, 0.012, 1000))
    imu = ImuData(time, rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3)), sampling, temperature=20.0 + time)
    terms = ErrorTerms(quadratic=np.full(3, 1e-4), bias_slope=np.full(3, 1e-3), positions=positions)
    known = replace(errors(), accel_terms=terms, gyro_terms=ErrorTerms(g_sensitivity=np.full((3, 3), 1e-3)))
    whole = correct(imu, known)
    monkeypatch.setattr(spill, "ROWS", 77)
    parts = correct(imu, known)
    np.testing.assert_allclose(parts.gyro, whole.gyro, rtol=1e-13, atol=0.0)
    np.testing.assert_allclose(parts.accel, whole.accel, rtol=1e-13, atol=0.0)
    np.testing.assert_allclose(
        corrupt(parts, known).accel, imu.accel, rtol=0.0, atol=1e-4 if positions.any() else 1e-12
    )


def test_errors_act_as_matrix_times_truth_plus_bias() -> None:
    # by hand: true rate (1, 2, 3) and force (0, 0, -10)
    imu = ImuData(np.array([0.0]), np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, 0.0, -10.0]]))
    shown = corrupt(imu, errors())
    np.testing.assert_allclose(shown.gyro, [[1.01 + 0.04 + 0.01, 1.98 - 0.09 - 0.02, 0.001 + 3.015 + 0.03]])
    np.testing.assert_allclose(shown.accel, [[-0.1 + 0.1, 0.2, -10.0 - 0.3]], atol=1e-15)


def test_bias_of_increments_grows_with_the_interval() -> None:
    zero = ImuData(TIME, np.zeros((5, 3)), np.zeros((5, 3)), "increment")
    shown = corrupt(zero, ImuErrors(gyro_bias=np.array([1.0, 0.0, 0.0]), accel_bias=np.array([0.0, 0.0, 2.0])))
    intervals = [0.0105, 0.010, 0.011, 0.009, 0.011]  # the first is the median spacing
    np.testing.assert_allclose(shown.gyro[:, 0], intervals)
    np.testing.assert_allclose(shown.accel[:, 2], 2.0 * np.array(intervals))


def test_everything_else_passes_through() -> None:
    imu = samples("increment")
    shown = corrupt(imu, errors())
    assert shown.sampling == "increment"
    assert shown.temperature is imu.temperature
    assert shown.time is imu.time
    assert not np.shares_memory(shown.gyro, imu.gyro)


def test_one_increment_has_no_interval() -> None:
    imu = ImuData(np.array([0.0]), np.zeros((1, 3)), np.zeros((1, 3)), "increment")
    with refused(InputError, "data.few_samples"):
        sample_intervals(imu)


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        ({"gyro_matrix": np.zeros((3, 3))}, "imu.matrix_not_invertible"),
        ({"accel_matrix": np.ones((3, 3))}, "imu.matrix_not_invertible"),
        ({"accel_bias": np.array([0.0, np.nan, 0.0])}, "imu.calibration_not_finite"),
        ({"gyro_bias": np.zeros(2)}, "imu.calibration_shape"),
    ],
)
def test_impossible_errors_are_refused(bad: dict[str, np.ndarray], code: str) -> None:
    with refused(ConfigError, code):
        ImuErrors(**bad)


def test_drawn_errors_have_the_standard_deviations_of_the_spec() -> None:
    spec = ImuSpec(
        "test",
        SensorSpec(bias=np.array([1.0, 2.0, 3.0]), scale_factor=np.full(3, 0.01), misalignment=np.full(3, 0.02)),
        SensorSpec(bias=np.full(3, 4.0), scale_factor=np.full(3, 0.03), misalignment=np.full(3, 0.04)),
    )
    rng = np.random.default_rng(7)
    drawn = [sample_errors(spec, rng) for _ in range(4000)]
    # 4000 draws know a standard deviation to 1.1 % (1 sigma)
    np.testing.assert_allclose(np.std([e.gyro_bias for e in drawn], axis=0), [1.0, 2.0, 3.0], rtol=0.05)
    np.testing.assert_allclose(np.std([e.accel_bias for e in drawn], axis=0), 4.0, rtol=0.05)
    for name, diagonal, off in (("gyro_matrix", 0.01, 0.02), ("accel_matrix", 0.03, 0.04)):
        expected = np.where(np.eye(3) > 0, diagonal, off)
        np.testing.assert_allclose(np.std([getattr(e, name) for e in drawn], axis=0), expected, rtol=0.05)


def test_a_perfect_imu_has_no_errors() -> None:
    perfect = sample_errors(ImuSpec("perfect", SensorSpec(), SensorSpec()), np.random.default_rng(0))
    np.testing.assert_array_equal(perfect.gyro_matrix, np.eye(3))
    np.testing.assert_array_equal(perfect.accel_bias, np.zeros(3))


def test_drawing_is_reproducible() -> None:
    spec = load_imu("tactical")
    first, second = (sample_errors(spec, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first.gyro_matrix, second.gyro_matrix)
    np.testing.assert_array_equal(first.accel_bias, second.accel_bias)


def test_importing_the_model_does_not_import_pydantic() -> None:
    code = "import insnav.imu, sys; sys.exit('pydantic' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
