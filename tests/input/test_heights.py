"""A file of heights needs a time and a height, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_gps
from insnav.input.readers.specific_force import read_heights
from tests.input.files import fixes, noted, write

T = np.arange(50) / 2.0
H = 100.0 + 3.0 * np.sin(T)


@pytest.mark.parametrize(
    ("header", "scale"),
    [("time_s,height_m", 1.0), ("t,alt", 1.0), ("t,baro_height_m", 1.0), ("t,height_msl_m", 1.0), ("t,h[km]", 1e-3)],
)
def test_headers_and_units(tmp_path: Path, header: str, scale: float):
    read = read_heights(write(tmp_path / "h.csv", np.column_stack([T, scale * H]), header))
    np.testing.assert_allclose(read.data.time, T)
    np.testing.assert_allclose(read.data.height, H, atol=1e-4)
    (longest,) = noted(read, Code.READ_HEIGHT_INTERPOLATED)
    assert longest["step_s"] == pytest.approx(0.5)


def test_a_reference_holds_heights_too(tmp_path: Path):
    rows = np.column_stack([T, np.full(T.size, 48.0), np.full(T.size, 11.0), H])
    read = read_heights(write(tmp_path / "ref.csv", rows, "time_s,lat_deg,lon_deg,height_m"))
    np.testing.assert_allclose(read.data.height, H, atol=1e-6)


def test_rows_that_are_no_numbers_are_left_out_and_told(tmp_path: Path):
    height = H.copy()
    height[20] = np.nan
    read = read_heights(write(tmp_path / "h.csv", np.column_stack([T, height]), "time_s,height_m"))
    assert len(read.data.time) == T.size - 1
    assert np.isfinite(read.data.height).all()
    assert len(read.events) == 1


@pytest.mark.parametrize("header", ["time_s,speed", "lat_deg,height_m"])
def test_what_is_missing_is_named(tmp_path: Path, header: str):
    with pytest.raises(InputError) as refused:
        read_heights(write(tmp_path / "h.csv", np.column_stack([T, H]), header))
    assert header.split(",")[0] in refused.value.details()[1][1]


@pytest.fixture
def grid(tmp_path: Path):
    """A grid of PROJ in the GTX format: south-west corner, steps, rows and columns, heights from the south."""
    lat, lon = np.mgrid[-90:91:5, -180:181:5].astype(float)
    head = np.array([-90.0, -180.0, 5.0, 5.0], dtype=">f8").tobytes() + np.array(lat.shape, dtype=">i4").tobytes()
    (tmp_path / "egm96_15.gtx").write_bytes(head + (0.5 * lat + 0.25 * lon).astype(">f4").tobytes())
    before = pyproj.datadir.get_data_dir()
    pyproj.datadir.set_data_dir(f"{before}:{tmp_path}")
    yield
    pyproj.datadir.set_data_dir(before)


@pytest.mark.parametrize("header", ["time_s,lat_deg,lon_deg,height_msl_m", "time_s,lat_rad,lon_rad,height_msl_m"])
def test_heights_above_sea_level_are_converted_with_an_installed_geoid(tmp_path: Path, grid: None, header: str):
    rows = fixes()[:, :4]
    if "rad" in header:
        rows[:, 1:3] = np.radians(rows[:, 1:3])
    read = read_gps(write(tmp_path / "gps.csv", rows, header))
    lat, lon = np.degrees(read.data.lla[:, :2]).T
    np.testing.assert_allclose(read.data.lla[:, 2], 500.0 + 0.5 * lat + 0.25 * lon, atol=1e-4)
    assert read.facts.height == "ellipsoidal"
    (added,) = noted(read, Code.READ_HEIGHT_GEOID_ADDED)
    assert (added["grid"], added["height_m"]) == ("us_nga_egm96_15.tif", pytest.approx(26.75, abs=0.01))


def test_heights_above_sea_level_stay_without_a_geoid_and_the_difference_is_stated(tmp_path: Path):
    read = read_gps(write(tmp_path / "gps.csv", fixes()[:, :4], "time_s,lat_deg,lon_deg,height_msl_m"))
    assert read.facts.height == "msl"
    np.testing.assert_allclose(read.data.lla[:, 2], 500.0)
    assert noted(read, Code.READ_HEIGHT_MSL)
