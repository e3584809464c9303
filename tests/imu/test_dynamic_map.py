"""The piecewise map is continuous, has its exact inverse, and goes through correction, corruption and file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError
from insnav.imu import ImuErrors, calibration_to_toml, correct, corrupt, load_calibration
from insnav.imu.model import AxisMap, DynamicMap, ErrorTerms
from insnav.types import ImuData
from tests.refusals import problems_of, refused

BENT = AxisMap(np.array([-4.0, -1.0, 0.5, 3.0]), np.array([0.2, -0.1, 0.05, -0.3]))


def test_error_is_straight_between_knots_and_beyond() -> None:
    # by hand: at -2.5 the error is 0.05; at 4 it is -0.3 - 0.14
    np.testing.assert_allclose(BENT.apply(np.array([-1.0, -2.5, 4.0])), [-0.9, -2.55, 4.44], atol=1e-12)


def test_inverse_is_exact_and_the_map_continuous() -> None:
    rate = np.linspace(-6.0, 6.0, 4001)
    np.testing.assert_allclose(BENT.inverse(BENT.apply(rate)), rate, atol=1e-14)
    np.testing.assert_allclose(BENT.apply(BENT.inverse(rate)), rate, atol=1e-14)
    assert np.abs(np.diff(BENT.apply(rate))).max() < 1.4 * (rate[1] - rate[0])


@pytest.mark.parametrize(
    ("rate", "error", "code"),
    [
        ([0.0, 1.0], [0.0, 0.95], "imu.map_not_invertible"),
        ([0.0, 0.0], [0.0, 0.1], "imu.map_not_increasing"),
        ([0.0], [0.0], "imu.map_shape"),
        ([0.0, 1.0], [0.0, np.nan], "imu.map_not_increasing"),
    ],
)
def test_what_is_no_map_is_refused(rate: list[float], error: list[float], code: str) -> None:
    with refused(ConfigError, code):
        AxisMap(np.array(rate), np.array(error))


TERMS = ErrorTerms(asymmetry=np.array([1e-3, -2e-3, 0.0]), g_sensitivity=1e-4 * np.arange(9.0).reshape(3, 3))
SIZE = ErrorTerms(positions=np.array([[0.0, 0.1, 0.0], [0.2, 0.0, 0.1], [0.0, 0.0, 0.3]]))


@pytest.mark.parametrize("sampling", ["mean", "increment"])
@pytest.mark.parametrize("terms", [(None, None), (TERMS, None), (TERMS, SIZE)])
def test_correct_undoes_corrupt_also_from_the_file(
    tmp_path: Path, sampling: str, terms: tuple[ErrorTerms | None, ErrorTerms | None]
) -> None:
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(1, 401)
    scale = 0.01 if sampling == "increment" else 1.0
    imu = ImuData(time, scale * 3.0 * rng.normal(size=(400, 3)), scale * rng.normal(size=(400, 3)), sampling)
    matrix = np.eye(3) + 0.05 * rng.normal(size=(3, 3))
    gyro_terms, accel_terms = terms
    errors = ImuErrors(
        np.full(3, 0.1), matrix, gyro_map=DynamicMap((BENT, None, BENT)), gyro_terms=gyro_terms, accel_terms=accel_terms
    )
    (tmp_path / "calibration.toml").write_text(calibration_to_toml(errors))
    again = load_calibration(tmp_path / "calibration.toml")
    back = correct(corrupt(imu, errors), again)
    np.testing.assert_allclose(back.gyro, imu.gyro, atol=1e-12)
    np.testing.assert_allclose(back.accel, imu.accel, atol=1e-12)
    without = correct(corrupt(imu, errors), replace(errors, gyro_map=None))
    assert np.abs(without.gyro[:, [0, 2]] - imu.gyro[:, [0, 2]]).max() > 0.01 * scale
    np.testing.assert_allclose(without.gyro[:, 1], imu.gyro[:, 1], atol=2e-2 * scale)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[gyro.map.x]\nrate_rad_s = [0, 1]\nerror_rad_s = [0]", "gyro.map: imu.map_shape"),
        ("[gyro.map.x]\nrate_rad_s = [0, 1]", "gyro.map.x.error_rad_s: config.missing_key"),
        ("[gyro.map.q]\nrate_rad_s = [0, 1]", "gyro.map.q: config.unknown_key"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "calibration.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_calibration(tmp_path / "calibration.toml")
    (found,) = problems_of(caught.value)
    assert found.endswith(expected)
