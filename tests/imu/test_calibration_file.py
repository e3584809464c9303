"""The calibration file reads, writes exactly what it read, and names every mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError
from insnav.imu import ImuErrors, calibration_to_toml, load_calibration
from tests.refusals import problems_of, refused

EXAMPLE = """
name = "bench IMU 7"
date = 2025-03-14
temperature_c = 24.5
[gyro]
bias = ["12 deg/h", "-3 deg/h", "0.5 deg/h"]
matrix = [[1.001, 0.0002, 0], [0, 0.9995, 0.0001], [0.0, 0.0, 1.0003]]
[accel]
bias = ["1.2 mg", "-0.4 mg", "3 mg"]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "calibration.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_calibration_is_read_in_si(tmp_path: Path) -> None:
    errors = load_calibration(write(tmp_path, EXAMPLE))
    np.testing.assert_allclose(errors.gyro_bias, np.radians([12.0, -3.0, 0.5]) / 3600.0)
    np.testing.assert_allclose(errors.accel_bias, np.array([1.2, -0.4, 3.0]) * 9.80665e-3)
    assert errors.gyro_matrix[0, 1] == 0.0002
    assert errors.gyro_matrix[1, 2] == 0.0001
    np.testing.assert_array_equal(errors.accel_matrix, np.eye(3))  # absent: perfect
    assert (errors.name, errors.date, errors.temperature) == ("bench IMU 7", "2025-03-14", 24.5)


def test_what_is_written_reads_back_exactly(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    errors = ImuErrors(
        rng.normal(size=3),
        np.eye(3) + 0.01 * rng.normal(size=(3, 3)),
        rng.normal(size=3),
        np.eye(3) + 0.01 * rng.normal(size=(3, 3)),
        name='a "name"',
        date="2025-03-14",
        temperature=-12.25,
    )
    again = load_calibration(write(tmp_path, calibration_to_toml(errors)))
    for key in ("gyro_bias", "gyro_matrix", "accel_bias", "accel_matrix"):
        np.testing.assert_array_equal(getattr(again, key), getattr(errors, key))
    assert (again.name, again.date, again.temperature) == (errors.name, errors.date, errors.temperature)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[gyro]\nmatrix = [[1, 0], [0, 1]]", "gyro.matrix: config.no_matrix_of_numbers"),
        ("[gyro]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, nan]]", "gyro.matrix: config.no_finite_number"),
        ('[gyro]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, "1"]]', "gyro.matrix: config.no_finite_number"),
        ("[gyro]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, true]]", "gyro.matrix: config.no_finite_number"),
        (f"[gyro]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 0x{'f' * 900}]]", "gyro.matrix: config.no_finite_number"),
        ("[gyro]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 0]]", "gyro.matrix: imu.matrix_not_invertible"),
        ('[accel]\nbias = "1 deg/h"', "accel.bias: unit.of_other_dimension"),
        ("[gyro]\nmatrx = 1", "gyro.matrx: config.unknown_key"),
        ("date = 5\n[gyro]", "date: imu.no_date"),
        ('temperature_c = "warm"\n[gyro]', "temperature_c: config.no_finite_number"),
        ('name = "nothing"', "calibration.toml: imu.empty_calibration"),
    ],
)
def test_every_mistake_is_named(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_calibration(write(tmp_path, text))
    (found,) = problems_of(caught.value)
    assert found.endswith(expected)
    assert "calibration.toml" in caught.value.where


def test_a_missing_file_is_a_configuration_error(tmp_path: Path) -> None:
    with refused(ConfigError, "config.unreadable"):
        load_calibration(tmp_path / "none.toml")
