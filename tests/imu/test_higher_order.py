"""Error terms beyond bias and matrix: written out by hand, taken off exactly, kept by the file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insnav.exceptions import ConfigError, InputError
from insnav.imu import ErrorTerms, ImuErrors, calibration_to_toml, correct, corrupt, load_calibration
from insnav.types import ImuData
from tests.refusals import refused


def errors(seed: int = 0, size: float = 1.0) -> ImuErrors:
    rng = np.random.default_rng(seed)

    def matrix() -> np.ndarray:
        return np.eye(3) + 0.02 * size * rng.standard_normal((3, 3))

    gyro = ErrorTerms(
        asymmetry=1e-3 * size * rng.standard_normal(3),
        quadratic=2e-3 * size * rng.standard_normal(3),
        bias_slope=1e-4 * size * rng.standard_normal(3),
        scale_slope=1e-4 * size * rng.standard_normal(3),
        g_sensitivity=1e-4 * size * rng.standard_normal((3, 3)),
    )
    accel = ErrorTerms(
        asymmetry=1e-3 * size * rng.standard_normal(3),
        quadratic=1e-4 * size * rng.standard_normal(3),
        bias_slope=1e-3 * size * rng.standard_normal(3),
        scale_slope=1e-4 * size * rng.standard_normal(3),
        positions=0.03 * size * rng.standard_normal((3, 3)),
    )
    return ImuErrors(
        0.01 * rng.standard_normal(3),
        matrix(),
        0.1 * rng.standard_normal(3),
        matrix(),
        temperature=20.0,
        gyro_terms=gyro,
        accel_terms=accel,
    )


def samples(sampling: str = "mean", seed: int = 1) -> ImuData:
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.01 + 0.002 * rng.uniform(size=300))
    dt = np.diff(time, prepend=time[0] - np.median(np.diff(time)))[:, None]
    span = dt if sampling == "increment" else 1.0
    gyro, accel = 3.0 * rng.standard_normal((300, 3)), 20.0 * rng.standard_normal((300, 3))
    return ImuData(time, gyro * span, accel * span, sampling=sampling, temperature=np.linspace(-10.0, 50.0, 300))


@pytest.mark.parametrize("sampling", ["mean", "instant", "increment"])
def test_correct_undoes_corrupt(sampling):
    imu = samples(sampling)
    for seed in range(5):
        back = correct(corrupt(imu, errors(seed)), errors(seed))
        np.testing.assert_allclose(back.gyro, imu.gyro, atol=1e-12 * np.abs(imu.gyro).max())
        np.testing.assert_allclose(back.accel, imu.accel, atol=1e-12 * np.abs(imu.accel).max())


def test_by_hand():
    """One sample, every term written out."""
    terms = ErrorTerms(
        asymmetry=np.array([0.01, 0.0, 0.0]),
        quadratic=np.array([0.0, 0.001, 0.0]),
        bias_slope=np.array([0.0, 0.0, 1e-3]),
        scale_slope=np.array([2e-4, 0.0, 0.0]),
        g_sensitivity=np.array([[0.0, 0.0, 1e-3], [0, 0, 0], [0, 0, 0]]),
    )
    known = ImuErrors(gyro_bias=np.array([0.1, 0.2, 0.3]), gyro_terms=terms)
    gyro, accel = np.array([[-2.0, 3.0, 0.5]] * 2), np.array([[0.0, 0.0, -9.8]] * 2)
    imu = ImuData(np.array([0.0, 1.0]), gyro, accel, temperature=np.array([35.0, 35.0]))
    shown = corrupt(imu, known).gyro[0]
    x = -2.0 * (1 + 2e-4 * 10.0) + 0.01 * 2.0 + 0.1 + 1e-3 * -9.8
    np.testing.assert_allclose(shown, [x, 3.0 + 0.001 * 9.0 + 0.2, 0.5 + 1e-2 + 0.3], rtol=1e-14)


def test_accelerometers_off_the_point_feel_the_turn():
    """A steady turn: an accelerometer at r feels -w^2 r along r (towards the axis)."""
    time = np.arange(100) / 100.0
    gyro = np.tile([0.0, 0.0, 2.0], (100, 1))
    positions = np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]])
    known = ImuErrors(accel_terms=ErrorTerms(positions=positions))
    shown = corrupt(ImuData(time, gyro, np.zeros((100, 3))), known).accel
    np.testing.assert_allclose(shown, np.tile([-0.4, -0.8, 0.0], (100, 1)), atol=1e-12)
    # and a spin-up about z: the y accelerometer on the x axis feels dw/dt r
    gyro = np.outer(3.0 * time, [0.0, 0.0, 1.0])
    known = ImuErrors(accel_terms=ErrorTerms(positions=np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0.0]])))
    shown = corrupt(ImuData(time, gyro, np.zeros((100, 3))), known).accel
    np.testing.assert_allclose(shown[:, 1], 0.3, atol=1e-12)


def test_temperature_must_be_known():
    imu = samples()
    cold = ImuData(imu.time, imu.gyro, imu.accel)
    for act in (corrupt, correct):
        with refused(InputError, "imu.no_temperature"):
            act(cold, errors())


def test_values_beyond_the_vertex_are_refused():
    known = ImuErrors(gyro_terms=ErrorTerms(quadratic=np.array([-1.0, 0.0, 0.0])))
    with refused(InputError, "imu.beyond_vertex"):
        correct(ImuData(np.array([0.0, 1.0]), np.ones((2, 3)), np.ones((2, 3))), known)


def test_the_file_keeps_every_bit(tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(calibration_to_toml(errors(3)))
    back = load_calibration(path)
    for name in ("asymmetry", "quadratic", "bias_slope", "scale_slope", "g_sensitivity", "positions"):
        np.testing.assert_array_equal(getattr(back.gyro_terms, name), getattr(errors(3).gyro_terms, name))
        np.testing.assert_array_equal(getattr(back.accel_terms, name), getattr(errors(3).accel_terms, name))


@given(st.floats(-0.4, 0.4), st.floats(-0.01, 0.01), st.floats(-20.0, 20.0))
def test_any_single_value_comes_back(asymmetry, quadratic, value):
    terms = ErrorTerms(asymmetry=np.full(3, asymmetry), quadratic=np.full(3, quadratic))
    slope = 1.0 + np.sign(value) * asymmetry + 2.0 * quadratic * value
    if slope <= 0.05:  # beyond or near the vertex: not a sensor
        return
    z = np.full((1, 3), value)
    np.testing.assert_allclose(terms.meant(terms.shown(z, None), None), z, rtol=1e-11, atol=1e-300)


def test_nonsense_is_refused():
    with refused(ConfigError, "imu.terms_shape"):
        ErrorTerms(quadratic=np.array([np.nan, 0.0, 0.0]))
    with refused(ConfigError, "imu.asymmetry"):
        ErrorTerms(asymmetry=np.full(3, 0.9))
