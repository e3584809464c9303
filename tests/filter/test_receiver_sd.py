"""Fixes without a standard deviation get that of their kind of fix; their scatter can only make it larger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.filter.gps_noise import FLOAT_SD, POSITION_FLOOR, with_sd
from insnav.findings import Code, of_code
from insnav.simulate import GpsErrors, corrupt_gps
from insnav.types import GpsData
from insnav.units import DEG
from tests.filter import drives

SMOOTH = GpsErrors((0.02, 0.02, 0.03), (1.2, 1.2, 2.0), 300.0, (0.05, 0.05, 0.05))  # metres that hardly change
NOISY = GpsErrors((5.0, 5.0, 8.0))


def without_sd(errors: GpsErrors, fix: int | None) -> GpsData:
    gps = corrupt_gps(drives.perfect_gps(0.2), errors, 1)
    kind = None if fix is None else np.full(gps.time.size, fix)
    return replace(gps, position_sd=np.full_like(gps.position_sd, np.nan), fix=kind)


@pytest.mark.parametrize(
    ("fix", "expected"), [(None, 1.5), (5, 1.5), (4, 1.0), (2, FLOAT_SD)], ids=["unknown", "single", "DGPS", "float"]
)
def test_a_small_scatter_is_never_taken_for_accuracy(fix, expected):
    gps, notes = with_sd(without_sd(SMOOTH, fix), scatter_alone=False)
    np.testing.assert_allclose(np.median(gps.position_sd[:, :2], axis=0), expected, rtol=0.2)
    assert notes[0].code is (Code.GPS_POSITION_SD_STAND_ALONE if fix is None else Code.GPS_POSITION_SD_FIX_TYPE)


def test_fixed_ambiguities_are_centimetres():
    gps, _ = with_sd(without_sd(GpsErrors((0.005, 0.005, 0.01), velocity_noise=(0.05,) * 3), 1), scatter_alone=False)
    assert np.median(gps.position_sd) < 0.1
    assert gps.position_sd.min() >= POSITION_FLOOR


def test_a_large_scatter_counts():
    gps, _ = with_sd(without_sd(NOISY, 4), scatter_alone=False)
    assert np.median(gps.position_sd[:, 0]) > 4.0


@pytest.mark.parametrize(("digits", "least"), [(4, 3.2), (5, 0.32), (6, 0.0), (9, 0.0)])
def test_rounded_positions_have_the_sigma_of_their_rounding(digits, least):
    """Claims of 1 cm beside steps of 11 m: the filter was lost."""
    rng = np.random.default_rng(1)
    degrees = np.round(48.0 + np.cumsum(rng.normal(0.0, 2e-4, (200, 2)), axis=0), digits)
    lla = np.column_stack([degrees * DEG, 300.0 + rng.normal(0.0, 0.1, 200)])
    one = np.full((200, 3), 0.01)
    gps, notes = with_sd(GpsData(np.arange(200.0), lla, np.zeros((200, 3)), one, one))
    assert np.min(gps.position_sd[:, 0]) == pytest.approx(max(least, 0.01), rel=0.02)
    assert np.all(gps.position_sd[:, 2] == 0.01)
    rounded = [note["decimals"] for note in of_code(notes, Code.GPS_ROUNDED_POSITION)]
    assert rounded == [digits] * (least > 0.0)
