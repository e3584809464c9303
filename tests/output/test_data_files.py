"""Simulated files: canonical columns, enough digits, the same bytes for the same data."""

from __future__ import annotations

import gzip
from dataclasses import replace

import numpy as np
import pytest

from insnav.exceptions import OutputError
from insnav.output.data_files import write_data
from insnav.simulate import gps_from_truth, imu_from_truth, reference
from tests.simulate.motions import town

TRUTH = town(start=100000.0)


def table(text: str) -> tuple[list[str], np.ndarray]:
    header, *rows = text.splitlines()
    return header.split(","), np.array([[float(cell) for cell in row.split(",")] for row in rows])


@pytest.mark.parametrize(
    ("sampling", "columns", "digits"),
    [
        ("mean", "gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2", 6e-10),
        ("increment", "dtheta_x_rad,dtheta_y_rad,dtheta_z_rad,dvel_x_m_s,dvel_y_m_s,dvel_z_m_s", 6e-14),
    ],
)
def test_imu_file_holds_the_samples(tmp_path, sampling, columns, digits):
    imu = imu_from_truth(TRUTH, 100020.0 + np.arange(101) / 100, sampling)
    write_data(tmp_path / "imu.csv", imu)
    names, values = table((tmp_path / "imu.csv").read_text())
    assert names == ["time_s", *columns.split(",")]
    np.testing.assert_allclose(values[:, 0], imu.time, atol=1e-9)
    np.testing.assert_allclose(values[:, 1:], np.column_stack([imu.gyro, imu.accel]), atol=digits)


def test_compressed_file_is_the_same_text_and_the_same_bytes_every_time(tmp_path):
    imu = imu_from_truth(TRUTH, 100020.0 + np.arange(101) / 100)
    for name in ("a.csv", "b.csv.gz", "c.csv.gz"):
        write_data(tmp_path / name, imu)
    assert gzip.decompress((tmp_path / "b.csv.gz").read_bytes()) == (tmp_path / "a.csv").read_bytes()
    assert (tmp_path / "b.csv.gz").read_bytes() == (tmp_path / "c.csv.gz").read_bytes()
    assert (tmp_path / "b.csv.gz").read_bytes()[4:8] == bytes(4)  # no time of writing


def test_gps_file_leaves_out_what_is_not_known_and_a_gap_in_it_is_an_empty_cell(tmp_path):
    gps = gps_from_truth(TRUTH, 100000.0 + np.arange(1.0, 4.0), np.zeros(3))
    write_data(tmp_path / "gps.csv", gps)
    header, first, *_ = (tmp_path / "gps.csv").read_text().splitlines()
    assert header == "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s"
    np.testing.assert_allclose([float(cell) for cell in first.split(",")], [100001, 48, 11, 500, 0, 0, 0], atol=1e-6)
    v_n = gps.v_n.copy()
    v_n[1] = np.nan
    write_data(tmp_path / "gaps.csv", replace(gps, v_n=v_n, position_sd=np.full((3, 3), 1.5)))
    header, _, second, _ = (tmp_path / "gaps.csv").read_text().splitlines()
    assert header.endswith("vd_m_s,sd_n_m,sd_e_m,sd_d_m")
    assert second.endswith(",,,,1.5,1.5,1.5")


def test_reference_file_is_in_degrees_with_heading_below_360(tmp_path):
    ref = reference(TRUTH, 100000.0 + np.arange(0.0, 120.0, 0.5))
    rph = ref.rph.copy()
    rph[3, 2] = np.nextafter(2 * np.pi, 0.0)
    write_data(tmp_path / "ref.csv", replace(ref, rph=rph))
    names, values = table((tmp_path / "ref.csv").read_text())
    assert names[-3:] == ["roll_deg", "pitch_deg", "heading_deg"]
    assert values[3, 9] == 0.0
    np.testing.assert_allclose(np.radians(values[:, 1]), ref.lla[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.radians(values[10:, 7:]), ref.rph[10:], atol=1e-9)
    assert "-0," not in (tmp_path / "ref.csv").read_text()


def test_a_folder_that_is_not_there_is_said(tmp_path):
    with pytest.raises(OutputError) as error:
        write_data(tmp_path / "nowhere" / "ref.csv", reference(TRUTH, np.array([100001.0])))
    assert error.value.exit_code == 4
    assert "nowhere" in error.value.where
