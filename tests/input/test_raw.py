"""A file of volts or counts reads as the rates and forces it came from, by the lines of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code
from insnav.imu import ImuErrors, calibration_to_toml, load_calibration
from insnav.imu.model import RawScale
from insnav.input import read_imu
from insnav.input.readers.imu import unit_pairs
from tests.input.files import noted
from tests.refusals import problems_of, refused

GYRO = RawScale("V", np.array([0.2, -0.1, 0.0]), np.array([2.8, 2.7, -2.9]))
ACCEL = RawScale("LSB", np.array([10.0, -20.0, 0.0]), np.array([800.0, 810.0, 790.0]))
SCALES = {"gyro": GYRO, "accel": ACCEL}
HEADER = "time_s,gyro_x_v,gyro_y_v,gyro_z_v,accel_x_lsb,accel_y_lsb,accel_z_lsb"


def recording(path: Path, header: str = HEADER, volts: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    time = 0.01 * np.arange(1, 1001)
    rate = np.column_stack((0.2 * np.sin(time), 0.1 * np.cos(time), 0.3 * np.sin(2.0 * time)))
    force = np.array([0.1, -0.2, -9.81]) + 0.01 * rng.normal(size=(1000, 3))
    rows = np.column_stack((time, volts * (GYRO.zero + rate * GYRO.scale), ACCEL.zero + force * ACCEL.scale))
    np.savetxt(path, rows, "%.12g", ",", header=header, comments="")
    return rate, force


@pytest.mark.parametrize(("header", "volts"), [(HEADER, 1.0), (HEADER.replace("_v", "_mv"), 1000.0)])
def test_outputs_become_rates_and_forces(tmp_path: Path, header: str, volts: float) -> None:
    rate, force = recording(tmp_path / "imu.csv", header, volts)
    reading = read_imu(tmp_path / "imu.csv", units=SCALES)
    np.testing.assert_allclose(reading.data.gyro, rate, atol=1e-9)
    np.testing.assert_allclose(reading.data.accel, force, atol=1e-9)
    scaled = noted(reading, Code.READ_IMU_RAW_SCALED)
    assert {(each.subject, each["unit"], each["si_unit"]) for each in scaled} == {
        ("gyro", "V", "rad/s"),
        ("accel", "LSB", "m/s^2"),
    }


def test_without_the_calibration_volts_are_refused(tmp_path: Path) -> None:
    recording(tmp_path / "imu.csv")
    with refused(InputError, "columns.missing") as caught:
        read_imu(tmp_path / "imu.csv")
    assert caught.value.values["quantities"][0] == "gyro_x_rad_s"


@pytest.mark.parametrize(
    ("header", "options", "expected"),
    [
        (HEADER.replace("_v", "_lsb"), {}, "input.other_raw_unit"),
        (HEADER.replace("_v", "_rad_s"), {}, "columns.missing"),
        (HEADER, {"units": "deg/s,g"}, "input.unit_of_raw"),
    ],
)
def test_another_unit_than_that_of_the_calibration_is_refused(
    tmp_path: Path, header: str, options: dict[str, str], expected: str
) -> None:
    recording(tmp_path / "imu.csv", header)
    with pytest.raises((InputError, ConfigError)) as caught:
        read_imu(tmp_path / "imu.csv", units=[*unit_pairs(options.get("units")), *SCALES.items()])
    assert caught.value.code == expected


def test_raw_lines_go_through_the_file(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(calibration_to_toml(ImuErrors(gyro_raw=GYRO, accel_raw=ACCEL)))
    again = load_calibration(path)
    for raw, old in ((again.gyro_raw, GYRO), (again.accel_raw, ACCEL)):
        assert raw is not None
        assert raw.unit == old.unit
        np.testing.assert_array_equal(raw.zero, old.zero)
        np.testing.assert_array_equal(raw.scale, old.scale)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[gyro.raw]\nunit = "deg/s"\nzero = [0, 0, 0]\nscale_per_rad_s = [1, 1, 1]', "imu.raw_unit"),
        ('[gyro.raw]\nunit = "V"\nzero = [0, 0, 0]\nscale_per_rad_s = [1, 1, 0]', "imu.raw_unusable"),
        ('[gyro.raw]\nunit = "V"\nzero = [0, 0]\nscale_per_rad_s = [1, 1, 1]', "imu.raw_shape"),
        ('[gyro.raw]\nunit = "V"\nzero = [0, 0, 0]\nscale = [1, 1, 1]', "gyro.raw.scale: config.unknown_key"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert expected in " ".join(problems_of(caught.value))
