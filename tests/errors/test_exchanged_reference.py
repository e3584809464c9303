"""A reference that is the fixes themselves, or the noisier one of two exchanged files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insnav
from insnav.errors.evaluated_run import same_positions
from insnav.filter.gps_noise import white_noise
from insnav.findings import Code, Severity, of_code
from insnav.types import GpsData, Trajectory
from insnav.units import DEG

CODES = Code.REF_NOISIER, Code.REF_SAME_AS_GPS, Code.RUN_OVERCONFIDENT


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """A car with a single receiver, and the exact motion."""
    imu, gps, ref = insnav.sample_drive()
    rounded = tmp_path_factory.mktemp("rounded") / "rounded.csv"
    table = pd.read_csv(gps)[["time_s", "lat_deg", "lon_deg", "height_m"]]
    table.round({"lat_deg": 7, "lon_deg": 7}).to_csv(rounded, index=False)
    return {"imu": imu, "gps": gps, "ref": ref, "rounded": rounded}


@pytest.mark.parametrize(
    ("gps", "ref", "light", "code"),
    [
        ("gps", "ref", "good", None),
        ("gps", "gps", "unknown", Code.REF_SAME_AS_GPS),
        ("gps", "rounded", "unknown", Code.REF_SAME_AS_GPS),
        ("ref", "gps", "unknown", Code.REF_NOISIER),
    ],
)
def test_the_verdict_says_what_the_reference_can_tell(files, gps, ref, light, code):
    result = insnav.load(files["imu"], files[gps], files[ref], imu=files["imu"].with_name("imu.toml")).navigate()
    verdict = result.page().verdict
    assert verdict is not None
    assert verdict.light == light, verdict
    assert [each.code for each in of_code(result.findings, *CODES)] == ([] if code is None else [code])
    if code is Code.REF_NOISIER:
        (found,) = of_code(result.findings, code)
        # the receiver of the sample drive: 1.5 m, 1.5 m, white
        assert found["reference_m"] == pytest.approx(1.5 * np.sqrt(2.0), rel=0.1)
        assert found["fixes_m"] < 1e-3
        assert found.severity is Severity.WARNING


def test_equal_positions_are_equal_after_rounding():
    rng = np.random.default_rng(3)
    lla = np.column_stack([rng.uniform(0.8, 0.81, 50), rng.uniform(0.2, 0.21, 50), np.zeros(50)])
    none = np.full((50, 3), np.nan)
    gps = GpsData(np.arange(50.0), lla, none, none, none)
    for step in (1e-7 * DEG, 1e-6 / 60.0 * DEG):  # degrees, and minutes as in NMEA
        other = Trajectory(gps.time, np.round(lla / step) * step, none, none)
        assert same_positions(gps, other)
        assert not same_positions(gps, replace(other, lla=other.lla + 3.0 * step))
    centimetre = lla + rng.standard_normal((50, 3)) * [2e-9, 2e-9, 0.0]
    assert not same_positions(gps, Trajectory(gps.time, centimetre, none, none))


def test_white_noise_is_found_under_a_motion():
    rng, time = np.random.default_rng(4), np.arange(4000) / 5.0
    motion = np.column_stack([3.0 * time**2, np.sin(0.1 * time)])
    found, count = white_noise(time, motion + 0.2 * rng.standard_normal((4000, 2)))
    assert found == pytest.approx(0.2 * np.sqrt(2.0), rel=0.05)
    assert count == 3997
    assert white_noise(time[:3], motion[:3]) == (0.0, 0)
